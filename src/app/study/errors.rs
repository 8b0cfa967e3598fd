//! Errors of pictures against a reference, in units of its RMS radiance.

use crate::error::{Error, Result};
use crate::scene::film::Film;
use serde::{Deserialize, Serialize};

/// Errors of a result against the reference, in units of the reference's root mean square.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Errors {
    /// Root mean square error.
    pub rms: f64,
    /// Error that 99 % of the pixels or parameters stay below.
    pub percentile_99: f64,
    /// Largest error.
    pub largest: f64,
}

/// Returns the root mean square of the colors of pictures, over pixels that are finite.
///
/// # Errors
/// If all of them are black.
pub(super) fn scale(films: &[Film]) -> Result<f64> {
    let colors = || films.iter().flat_map(|film| &film.rgba).flat_map(|p| &p[..3]).filter(|v| v.is_finite());
    let square: f64 = colors().map(|v| f64::from(*v).powi(2)).sum();
    let rms = (square / colors().count().max(1) as f64).sqrt();
    if rms > 0.0 {
        return Ok(rms);
    }
    Err(Error::invalid("the pictures are black: errors have no scale")
        .hint("check the grid, ⟨density_scale⟩, the light and the cameras"))
}

impl Errors {
    /// Returns the errors of pictures, in units of `scale`. Of a pixel counts the color that differs most, but for the
    /// root mean square, which is over all colors. Pixels that are not finite are left out.
    pub(super) fn of_films(films: &[Film], reference: &[Film], scale: f64) -> Self {
        let pixels = films.iter().zip(reference).flat_map(|(a, b)| a.rgba.iter().zip(&b.rgba));
        let differences = |(a, b): (&[f32; 4], &[f32; 4])| -> [f64; 3] {
            std::array::from_fn(|c| (f64::from(a[c]) - f64::from(b[c])).abs() / scale)
        };
        let finite = |d: &[f64; 3]| d.iter().all(|v| v.is_finite());
        let (mut square, mut largest) = (0.0, Vec::new());
        for difference in pixels.map(differences).filter(finite) {
            square += difference.iter().map(|d| d * d).sum::<f64>();
            largest.push(difference.into_iter().fold(0.0, f64::max));
        }
        Self::of(square, 3 * largest.len(), largest)
    }

    /// Returns the errors of which the squares of `count` numbers add up to `square`, and the largest of each pixel or
    /// parameter are `largest`.
    pub(super) fn of(square: f64, count: usize, mut largest: Vec<f64>) -> Self {
        largest.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| largest.get((largest.len().saturating_sub(1) as f64 * share) as usize).copied();
        Self {
            rms: (square / count.max(1) as f64).sqrt(),
            percentile_99: at(0.99).unwrap_or(0.0),
            largest: at(1.0).unwrap_or(0.0),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn errors_are_relative_to_the_reference() {
        let film = |v: f32| Film::of(10, 10, vec![[v, v, v, 1.0]; 100]);
        let (reference, mut other) = (vec![film(0.5)], film(0.5));
        assert_eq!(scale(&reference).unwrap(), 0.5);
        other.rgba[7] = [0.5, 1.0, 0.5, 1.0];
        let errors = Errors::of_films(&[other.clone()], &reference, 0.5);
        assert_eq!((errors.largest, errors.percentile_99), (1.0, 0.0));
        assert!((errors.rms - (1.0 / 300.0_f64).sqrt()).abs() < 1e-12);
        other.rgba[7][0] = f32::NAN;
        assert_eq!(Errors::of_films(&[other], &reference, 0.5).largest, 0.0);
        assert!(scale(&[film(0.0)]).is_err());
    }
}
