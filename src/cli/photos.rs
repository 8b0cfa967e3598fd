//! The pictures of a capture.

use crate::error::{Error, Result};
use crate::formats::exr;
use crate::formats::vdb::Limits;
use crate::optimise::observation::Photo;
use crate::scene::capture::{Capture, Frame};
use rayon::prelude::*;

/// Reads all pictures.
///
/// # Errors
/// If one cannot be read, is not of its camera's size, or all together do not fit in memory.
pub fn read(capture: &Capture, layer: Option<&str>, limits: Limits) -> Result<Vec<Photo>> {
    let pixels: u64 = capture.frames.iter().map(|f| u64::from(f.camera.width) * u64::from(f.camera.height)).sum();
    // Colours, depths and weights, and the rays that the solver walks.
    if pixels * 48 > limits.max_memory {
        return Err(Error::unsupported(format!("{pixels} pixels do not fit in memory"))
            .hint("use fewer or smaller pictures, or raise --max-memory"));
    }
    let read = |frame: &Frame| {
        let film = exr::read_picture(&frame.picture, layer)?;
        let (w, h) = (frame.camera.width as usize, frame.camera.height as usize);
        if (film.width, film.height) != (w, h) {
            return Err(Error::invalid(format!(
                "the picture has {}x{} pixels, transforms.json says {w}x{h}",
                film.width, film.height
            ))
            .at(&frame.picture)
            .hint("correct 'w' and 'h' together with 'fl_x', 'fl_y', 'cx' and 'cy', or leave them out"));
        }
        Ok(Photo { camera: frame.camera, film, name: frame.picture.display().to_string() })
    };
    capture.frames.par_iter().map(read).collect()
}
