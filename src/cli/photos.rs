//! The pictures of a capture, and which of them are held out.

use crate::error::{Error, Result};
use crate::formats::exr;
use crate::formats::vdb::Limits;
use crate::optimise::observation::Photo;
use crate::scene::capture::{Capture, Frame};
use rayon::prelude::*;

/// Reads all pictures.
///
/// # Errors
/// If one cannot be read or has another size than its camera, or they do not fit in memory.
pub fn read(capture: &Capture, layer: Option<&str>, limits: Limits) -> Result<Vec<Photo>> {
    let pixels: u64 = capture.frames.iter().map(|f| u64::from(f.camera.width) * u64::from(f.camera.height)).sum();
    // Colours, depths and weights, and the rays that the solver walks.
    if pixels * 48 > limits.max_memory {
        return Err(Error::unsupported(format!("{pixels} pixels do not fit in memory"))
            .hint("use fewer or smaller pictures, or raise --max-memory"));
    }
    let read = |frame: &Frame| {
        let film = exr::read_picture_within(&frame.picture, layer, limits)?;
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

/// Numbers of the held-out views, evenly spaced: `count` of them, or one if there are `enough` views.
///
/// # Errors
/// If no view would be left.
pub fn held_out(count: Option<usize>, views: usize, enough: usize) -> Result<Vec<usize>> {
    let count = count.unwrap_or(usize::from(views >= enough));
    if count >= views {
        return Err(Error::invalid(format!("--held-out {count} leaves none of the {views} views"))
            .hint("hold out fewer views than there are"));
    }
    Ok((0..count).map(|i| (2 * i + 1) * views / (2 * count)).collect())
}
