//! Differences of two pictures or of two volumes, and the boundaries between the materials of a volume.
//!
//! Pictures are compared by their color channels in scene-linear values; alpha has a separate figure. Pixels in which
//! either picture has a NaN or infinite sample are left out and counted.

pub mod boundaries;
pub mod error;
pub mod flicker;
pub mod flip;
pub mod heatmap;
pub mod interval;
pub(crate) mod ssim;
pub mod statistical;
pub mod volume;

use crate::error::{Error, Result};
use crate::scene::film::Film;
use serde::{Serialize, Serializer};
use std::borrow::Cow;

/// Differences of a picture `a` from a reference `b` of equal size.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Comparison {
    /// Peak signal-to-noise ratio in dB; infinite for identical colors, which JSON writes as `null`.
    #[serde(serialize_with = "finite_or_null")]
    #[schemars(with = "Option<f64>")]
    pub psnr_db: f64,
    /// Structural similarity, mean over the color channels; 1 for identical colors.
    pub ssim: f64,
    /// Relative mean squared error: the mean of (a - b)² / (b² + 0.01) over pixels and color channels.
    pub rel_mse: f64,
    /// Largest absolute difference of a color channel.
    pub max_abs: f64,
    /// Root mean square difference over pixels and color channels.
    pub rms: f64,
    /// Largest absolute difference of alpha.
    pub alpha_max_abs: f64,
    /// Signal peak that `psnr_db` and `ssim` refer to.
    pub peak: f64,
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Number of pixels left out because one of the pictures is NaN or infinite there.
    pub non_finite_pixels: usize,
    /// Number of pixels left out in which the two pictures are not identical.
    pub non_finite_differences: usize,
}

/// Serialises a finite number, or `null` in the place of infinity and NaN, which JSON does not have.
fn finite_or_null<S: Serializer>(value: &f64, serializer: S) -> std::result::Result<S::Ok, S::Error> {
    if value.is_finite() { serializer.serialize_f64(*value) } else { serializer.serialize_none() }
}

impl Comparison {
    /// True if no color or alpha sample differs by more than `tolerance`, and pixels that are not finite are identical.
    pub fn within(&self, tolerance: f64) -> bool {
        self.max_abs <= tolerance && self.alpha_max_abs <= tolerance && self.non_finite_differences == 0
    }
}

/// Peak of a reference's signal: its largest absolute finite color, but at least 1.
/// Pictures between black and white are thus measured against white, brighter ones against their own maximum.
pub fn peak(reference: &Film) -> f64 {
    let colors = reference.rgba.iter().flat_map(|p| &p[..3]);
    colors.filter(|v| v.is_finite()).fold(1.0, |m, v| f64::from(v.abs()).max(m))
}

/// Upper bound in bytes of the memory that [`compare`] and a heat map of films of this size need beside the films.
pub fn working_memory(width: usize, height: usize) -> u64 {
    // Both films are copied where pixels are left out, and one plane of each is extracted. A heat map is made after
    // these are freed and needs less: differences, colors and the PNG.
    const PER_PIXEL: u64 = 2 * 16 + 2 * 4;
    let pixels = (width as u64).saturating_mul(height as u64);
    pixels.saturating_mul(PER_PIXEL).saturating_add(ssim::working_memory(width))
}

/// Compares picture `a` with the reference `b`.
///
/// # Errors
/// If the sizes differ or there is no pixel.
pub fn compare(a: &Film, b: &Film) -> Result<Comparison> {
    if (a.width, a.height) != (b.width, b.height) {
        return Err(Error::invalid(format!(
            "pictures of different sizes: {}x{} and {}x{}",
            a.width, a.height, b.width, b.height
        ))
        .hint("render or crop them to the same size"));
    }
    if a.rgba.is_empty() {
        return Err(Error::invalid("pictures without pixels cannot be compared").hint("render them again"));
    }
    let finite = |p: &[f32; 4]| p.iter().all(|v| v.is_finite());
    let (mut a, mut b) = (Cow::Borrowed(a), Cow::Borrowed(b));
    let (mut left_out, mut unlike) = (0, 0);
    if !a.rgba.iter().chain(&b.rgba).all(finite) {
        for (p, q) in a.to_mut().rgba.iter_mut().zip(&mut b.to_mut().rgba) {
            if !finite(p) || !finite(q) {
                let same = |(x, y): (&f32, &f32)| x == y || (x.is_nan() && y.is_nan());
                left_out += 1;
                unlike += usize::from(!p.iter().zip(q.iter()).all(same));
                // Set equal and black, such pixels add nothing to any sum; the means are over the others.
                (*p, *q) = ([0.0; 4], [0.0; 4]);
            }
        }
    }
    let peak = peak(&b);
    let errors = error::colors(&a, &b, a.rgba.len() - left_out);
    Ok(Comparison {
        psnr_db: error::psnr_db(errors.mse, peak),
        ssim: ssim::films(&a, &b, peak),
        rel_mse: errors.rel_mse,
        max_abs: errors.max_abs,
        rms: errors.mse.sqrt(),
        alpha_max_abs: errors.alpha_max_abs,
        peak,
        size: [a.width, a.height],
        non_finite_pixels: left_out,
        non_finite_differences: unlike,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(value: f32) -> Film {
        Film::of(16, 12, vec![[value, value, value, 1.0]; 192])
    }

    #[test]
    fn identical_pictures_have_no_error_and_null_for_the_infinite() {
        let c = compare(&grey(0.3), &grey(0.3)).unwrap();
        assert_eq!((c.psnr_db, c.ssim, c.rel_mse, c.max_abs), (f64::INFINITY, 1.0, 0.0, 0.0));
        assert!(c.within(0.0));
        let json = serde_json::to_value(&c).unwrap();
        assert!(json["psnr_db"].is_null());
        assert_eq!(json["ssim"], 1.0);
    }

    #[test]
    fn the_peak_is_the_references_if_it_is_brighter_than_white() {
        // Differences of 1 against a peak of 10: 20 dB; against a peak of 1 (darker reference): 0 dB.
        assert!((compare(&grey(9.0), &grey(10.0)).unwrap().psnr_db - 20.0).abs() < 1e-12);
        assert!(compare(&grey(1.0), &grey(0.0)).unwrap().psnr_db.abs() < 1e-12);
    }

    #[test]
    fn what_is_not_finite_is_left_out_and_counted() {
        let (mut a, mut b) = (grey(0.5), grey(0.25));
        a.rgba[5][0] = f32::NAN;
        b.rgba[5][0] = f32::NAN;
        let c = compare(&a, &b).unwrap();
        // The pixel's other channels differ, so it counts as different; the rest differs by 1/4.
        assert_eq!((c.non_finite_pixels, c.non_finite_differences, c.max_abs), (1, 1, 0.25));
        assert!((c.rms - 0.25).abs() < 1e-15);
        let c = compare(&a, &a.clone()).unwrap();
        assert_eq!((c.non_finite_pixels, c.non_finite_differences), (1, 0));
        assert!(c.within(0.0));
        b = grey(0.5);
        let c = compare(&a, &b).unwrap();
        assert!(!c.within(1e9), "NaN against a number is a difference");
    }

    #[test]
    fn alpha_alone_is_a_difference() {
        let mut a = grey(0.5);
        a.rgba[7][3] = 0.5;
        let c = compare(&a, &grey(0.5)).unwrap();
        assert_eq!((c.max_abs, c.alpha_max_abs), (0.0, 0.5));
        assert!(!c.within(0.4) && c.within(0.5));
    }

    #[test]
    fn sizes_must_agree() {
        let message = compare(&grey(0.0), &Film::new(12, 16)).unwrap_err().to_string();
        assert!(message.contains("16x12") && message.contains("12x16"), "{message}");
        assert!(compare(&Film::new(0, 0), &Film::new(0, 0)).is_err());
    }
}
