//! Fusion of what two denoisers found for a frame, one that came from the frames before and one from those after.

use super::frame::Denoised;
use rayon::prelude::*;

/// Returns the mean of two results, each weighted by its confidence: the samples that it rests on. What lags behind the light
/// in one direction of time runs ahead in the other, so that both errors cancel where the light changes steadily.
pub fn fused(mut forward: Denoised, backward: &Denoised) -> Denoised {
    let pixels = forward.color.par_iter_mut().zip(&mut forward.confidence);
    let others = backward.color.par_iter().zip(&backward.confidence);
    pixels.zip(others).with_min_len(1 << 14).for_each(|((color, confidence), (other, others))| {
        let sum = *confidence + others;
        if sum > 0.0 {
            *color = *color + (*other - *color) * (others / sum);
            *confidence = sum;
        }
    });
    forward
}
