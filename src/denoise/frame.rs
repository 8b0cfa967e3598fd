//! A frame, as it comes and denoised.

use super::ahead::Ahead;
use super::estimate::Estimate;
use crate::error::{Error, Result};
use glam::{Vec2, Vec3};

/// A frame.
#[derive(Debug, Clone, Copy, Default)]
pub struct Frame<'f> {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Scene-linear colors, row by row from the top. Pixels that are not finite are filled in.
    pub color: &'f [Vec3],
    /// For each pixel the place of what it shows in the frame denoised before, minus its place here, in pixels to the
    /// right and downwards; not finite where it was not seen. `None` for a picture at rest.
    pub motion: Option<&'f [Vec2]>,
    /// Alpha, which guides what looks for outlines.
    pub alpha: Option<&'f [f32]>,
    /// Histories of the pixels over the frames that follow, where they are known.
    pub ahead: Option<&'f Ahead>,
}

impl Frame<'_> {
    /// Checks that there are as many colors, motions, alphas and histories as pixels.
    ///
    /// # Errors
    /// If not.
    pub(crate) fn check(&self) -> Result<()> {
        let [width, height] = self.size;
        let count = width * height;
        let lengths = [Some(self.color.len()), self.motion.map(<[Vec2]>::len), self.alpha.map(<[f32]>::len)];
        let fits = self.ahead.is_none_or(|ahead| ahead.size() == self.size);
        if count > 0 && fits && lengths.into_iter().flatten().all(|length| length == count) {
            return Ok(());
        }
        Err(Error::invalid(format!(
            "colors, motions and alphas number {lengths:?}, and there are {width}x{height} pixels"
        )))
    }
}

/// A denoised frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Denoised {
    /// Colors, row by row from the top.
    pub color: Vec<Vec3>,
    /// Number of samples that each color rests on, counted by their weights and ages.
    pub confidence: Vec<f32>,
    /// Estimate of the noise that came in and of the error that is left, where frames before and after tell it.
    pub estimate: Option<Estimate>,
    /// Root mean squares of the noise that came in and of the error that is left, around each pixel; negative where
    /// unknown. Empty if no map is wanted, or none can be told.
    pub map: Vec<[f32; 2]>,
}
