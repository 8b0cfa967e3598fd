//! Exponential moving average: the history of colors that follows the motion, clamped to the colors around (temporal
//! anti-aliasing; Karis 2014). It serves for comparison.

use super::feature::{follow, neighbourhood};
use super::frame::{Denoised, Frame};
use super::reprojection::around;
use crate::error::Result;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// State between frames.
#[derive(Debug, Default)]
pub(crate) struct Ema {
    size: [usize; 2],
    /// Colors and the number of frames they rest on.
    history: Vec<[f32; 4]>,
}

/// Returns what a picture was at the place that a pixel shows; `None` if it was not seen.
#[inline(always)]
pub(super) fn reprojected<const N: usize>(frame: &Frame<'_>, before: &[[f32; N]], at: usize) -> Option<[f32; N]> {
    if before.is_empty() {
        return None;
    }
    let place = Vec2::new((at % frame.size[0]) as f32, (at / frame.size[0]) as f32);
    let found = around(frame.size, place + frame.motion.map_or(Vec2::ZERO, |motion| motion[at]))?;
    Some(found.sum(before).map(|value| value / found.covered))
}

impl Ema {
    /// Forgets all, as at a cut.
    pub(crate) fn reset(&mut self) {
        self.history.clear();
    }

    /// Denoises the next frame with the share `alpha` of the history.
    ///
    /// # Errors
    /// If the frame does not have as many colors, or motions, as pixels.
    pub(crate) fn denoise(&mut self, frame: &Frame<'_>, alpha: f32) -> Result<Denoised> {
        frame.check()?;
        if self.size != frame.size {
            self.history.clear();
            self.size = frame.size;
        }
        let pixel = |at: usize| {
            let range = neighbourhood(frame.color, frame.size, [at % frame.size[0], at / frame.size[0]]);
            let color = frame.color[at];
            match (reprojected(frame, &self.history, at), range.filter(|_| color.is_finite())) {
                (Some([r, g, b, count]), Some(range)) => {
                    let mixed = follow(Vec3::new(r, g, b), color, range, alpha);
                    mixed.extend(count + 1.0).to_array()
                }
                (Some(history), None) => history,
                (None, Some(_)) => color.extend(1.0).to_array(),
                (None, None) => [0.0; 4],
            }
        };
        let next: Vec<[f32; 4]> = (0..frame.color.len()).into_par_iter().with_min_len(1024).map(pixel).collect();
        self.history = next;
        let color = self.history.iter().map(|[r, g, b, _]| Vec3::new(*r, *g, *b)).collect();
        Ok(Denoised { color, confidence: self.history.iter().map(|pixel| pixel[3]).collect(), ..Denoised::default() })
    }
}
