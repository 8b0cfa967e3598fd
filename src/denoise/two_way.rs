//! Fusion of what two denoisers found for a frame, one that came from the frames before and one from those after.

use super::frame::Denoised;

/// Returns the mean of two results, each weighted by its confidence: the samples that it rests on. What lags behind the light
/// in one direction of time runs ahead in the other, so that both errors cancel where the light changes steadily.
pub fn fused(mut forward: Denoised, backward: &Denoised) -> Denoised {
    let pixels = forward.color.iter_mut().zip(&mut forward.confidence);
    for ((color, confidence), (other, others)) in pixels.zip(backward.color.iter().zip(&backward.confidence)) {
        let sum = *confidence + others;
        if sum > 0.0 {
            *color = *color + (*other - *color) * (others / sum);
            *confidence = sum;
        }
    }
    forward
}
