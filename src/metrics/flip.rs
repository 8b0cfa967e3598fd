//! FLIP, a difference that approximates what people see when they flip between two pictures (Andersson et al. 2020), by
//! NVIDIA's implementation.

use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageRgb8, FlipPool, flip};

/// Memory in bytes that a pixel needs while the difference is computed: pictures in several color spaces, and filtered.
pub const PIXEL_BYTES: u64 = 256;

/// Returns the mean FLIP of a picture against a reference: 0 for none, 1 for the largest difference. Both are display
/// values (sRGB), three bytes per pixel, as 67 pixels per degree of the view show them.
pub fn mean(picture: &[u8], reference: &[u8], [width, height]: [u32; 2]) -> f64 {
    let [picture, reference] = [picture, reference].map(|data| FlipImageRgb8::with_data(width, height, data));
    FlipPool::from_image(&flip(reference, picture, DEFAULT_PIXELS_PER_DEGREE)).mean().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_pictures_do_not_differ_and_black_from_white_most() {
        let [black, white, grey] = [0_u8, 255, 128].map(|v| vec![v; 3 * 32 * 24]);
        assert_eq!(mean(&grey, &grey, [32, 24]), 0.0);
        assert!(mean(&black, &white, [32, 24]) > 0.9);
        let little = mean(&vec![130; 3 * 32 * 24], &grey, [32, 24]);
        assert!(little > 0.0 && little < 0.1, "{little}");
    }
}
