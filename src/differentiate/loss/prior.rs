//! Priors on volumes and transfer functions: values with derivatives.
//!
//! Differences are measured in units of a density or extinction that counts as 1, so that one weight suits volumes of
//! any units.

use crate::error::{Error, Result};
use crate::real::Real;
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::neighbours::Neighbours;
use crate::scene::table::Rgbs;
use crate::scene::transfer::Transfer;
use crate::text::serde_as_text;
use rayon::prelude::*;
use std::fmt;
use std::str::FromStr;

/// A prior with its weight relative to the loss of the pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weighted<P> {
    /// Kind of prior.
    pub prior: P,
    /// Weight of the prior.
    pub weight: f64,
}

/// Prior on neighbouring voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VolumePrior {
    /// Mean of squared differences of neighbours (Weiss & Westermann 2021, eq. 12, in three dimensions): smooth fields.
    Smooth,
    /// Total variation (Rudin, Osher & Fatemi 1992): mean over voxels of `√(|∇x|² + ε²) - ε`, ∇ the differences to the
    /// next voxels along x, y and z. Piecewise constant fields, whose edges may be sharp.
    TotalVariation,
}

/// Prior on neighbouring texels, or points, of a transfer function.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransferPrior {
    /// Mean of the squared differences of all four channels (Weiss & Westermann 2021, eq. 12).
    Smooth,
    /// Mean of the squared differences of red, green and blue alone; the extinction is not regularised.
    SmoothColors,
}

/// A prior on voxels or on a transfer function.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Prior {
    /// Prior on voxels.
    Volume(VolumePrior),
    /// Prior on a transfer function.
    Transfer(TransferPrior),
}

/// Differences, in units of the value that counts as 1, below which the total variation is quadratic: noise of single
/// precision and of half floats is not an edge.
const EPSILON: f64 = 1e-3;

impl VolumePrior {
    /// Adds the derivative of `weight` times the prior on `x`, 512 voxels a brick, to `gradient`, and returns the
    /// value. `count` is the number of voxels that the mean is over: those that are unknown.
    pub(crate) fn add<R: Real>(
        self,
        weight: f64,
        x: &[R],
        neighbours: &Neighbours,
        count: usize,
        gradient: &mut [R],
    ) -> f64 {
        match self {
            Self::Smooth => smooth(weight / (3 * count.max(1)) as f64, x, neighbours, gradient),
            Self::TotalVariation => variation(weight / count.max(1) as f64, x, neighbours, gradient),
        }
    }
}

/// Returns `x[neighbour] - x[voxel]` for the neighbours below (0) and above (1) along each axis; zero where there is no
/// brick.
fn differences<R: Real>(x: &[R], all: &[Option<usize>; 6], voxel: usize, side: usize) -> [f64; 3] {
    std::array::from_fn(|axis| all[2 * axis + side].map_or(0.0, |neighbour| x[neighbour].f64() - x[voxel].f64()))
}

fn smooth<R: Real>(weight: f64, x: &[R], neighbours: &Neighbours, gradient: &mut [R]) -> f64 {
    let of = |(brick, gradient): (usize, &mut [R])| {
        let mut sum = 0.0;
        for (i, gradient) in gradient.iter_mut().enumerate() {
            let voxel = brick * LEAF_VOXELS + i;
            let all = neighbours.of_voxel(voxel);
            let [below, above] = [0, 1].map(|side| differences(x, &all, voxel, side));
            sum += above.iter().map(|d| d * d).sum::<f64>();
            let laplacian: f64 = below.iter().chain(&above).sum();
            *gradient -= R::of(2.0 * weight * laplacian);
        }
        sum
    };
    // In order, whatever the number of threads.
    let sums: Vec<f64> = gradient.par_chunks_mut(LEAF_VOXELS).enumerate().map(of).collect();
    weight * sums.iter().sum::<f64>()
}

fn variation<R: Real>(weight: f64, x: &[R], neighbours: &Neighbours, gradient: &mut [R]) -> f64 {
    let length = |voxel: usize| {
        let [dx, dy, dz] = differences(x, &neighbours.of_voxel(voxel), voxel, 1);
        (dx * dx + dy * dy + dz * dz + EPSILON * EPSILON).sqrt()
    };
    let lengths: Vec<f64> = (0..x.len()).into_par_iter().map(length).collect();
    gradient.par_iter_mut().enumerate().for_each(|(voxel, gradient)| {
        let all = neighbours.of_voxel(voxel);
        let [below, above] = [0, 1].map(|side| differences(x, &all, voxel, side));
        let mut divergence = above.iter().sum::<f64>() / lengths[voxel];
        for (axis, difference) in below.iter().enumerate() {
            divergence += all[2 * axis].map_or(0.0, |neighbour| difference / lengths[neighbour]);
        }
        *gradient -= R::of(weight * divergence);
    });
    weight * lengths.iter().map(|l| l - EPSILON).sum::<f64>()
}

impl TransferPrior {
    /// Returns the prior on `values` of ascending density, extinctions in units of `unit`, and its derivatives.
    pub(crate) fn evaluate(self, values: &[Rgbs], unit: f64) -> (f64, Vec<Rgbs>) {
        let channels = match self {
            Self::Smooth => 4,
            Self::SmoothColors => 3,
        };
        let share = 1.0 / (channels * values.len().saturating_sub(1).max(1)) as f64;
        let (mut value, mut derivatives) = (0.0, vec![[0.0; 4]; values.len()]);
        for (i, pair) in values.windows(2).enumerate() {
            for c in 0..channels {
                let unit = if c == 3 { unit } else { 1.0 };
                let difference = (pair[1][c] - pair[0][c]) / unit;
                value += share * difference * difference;
                let derivative = 2.0 * share * difference / unit;
                derivatives[i][c] -= derivative;
                derivatives[i + 1][c] += derivative;
            }
        }
        (value, derivatives)
    }

    /// Returns the prior on a transfer function, and its derivatives with respect to the function's
    /// [`parameters`](Transfer::parameters).
    ///
    /// # Errors
    /// If the function has neither texels nor points.
    pub(crate) fn evaluate_transfer(self, transfer: &Transfer, unit: f64) -> Result<(f64, Vec<f64>)> {
        Ok(match transfer {
            Transfer::Texture { texels, .. } => {
                let (value, derivatives) = self.evaluate(texels, unit);
                (value, derivatives.into_iter().flatten().collect())
            }
            Transfer::Piecewise { points } => {
                let values: Vec<Rgbs> = points.iter().map(|[_, r, g, b, s]| [*r, *g, *b, *s]).collect();
                let (value, derivatives) = self.evaluate(&values, unit);
                (value, derivatives.into_iter().flat_map(|[r, g, b, s]| [0.0, r, g, b, s]).collect())
            }
            Transfer::Gaussians { .. } | Transfer::Identity { .. } | Transfer::Labels { .. } => {
                return Err(Error::unsupported("a smoothness prior needs a transfer function of texels or points")
                    .hint("this one is smooth by its kind: leave the prior out"));
            }
        })
    }
}

/// Priors that texts name.
pub(crate) trait Named: Copy + PartialEq + 'static {
    /// Name of each prior.
    const NAMES: &'static [(&'static str, Self)];
}

impl Named for VolumePrior {
    const NAMES: &'static [(&'static str, Self)] = &[("smooth", Self::Smooth), ("tv", Self::TotalVariation)];
}

impl Named for Prior {
    const NAMES: &'static [(&'static str, Self)] = &[
        ("smooth", Self::Volume(VolumePrior::Smooth)),
        ("tv", Self::Volume(VolumePrior::TotalVariation)),
        ("tf", Self::Transfer(TransferPrior::Smooth)),
        ("tf-rgb", Self::Transfer(TransferPrior::SmoothColors)),
    ];
}

impl<P: Named> FromStr for Weighted<P> {
    type Err = Error;

    /// Parses `NAME=WEIGHT`.
    fn from_str(text: &str) -> Result<Self> {
        let (name, weight) = text.split_once('=').unwrap_or((text, ""));
        let prior = P::NAMES.iter().find(|(own, _)| *own == name).map(|(_, prior)| *prior);
        let weight = weight.parse::<f64>().ok().filter(|w| w.is_finite() && *w >= 0.0);
        prior.zip(weight).map(|(prior, weight)| Self { prior, weight }).ok_or_else(|| {
            let names: Vec<String> = P::NAMES.iter().map(|(name, _)| format!("{name}=WEIGHT")).collect();
            Error::invalid(format!("prior '{text}': expected {}, such as smooth=0.5", names.join(", ")))
        })
    }
}

impl<P: Named> fmt::Display for Weighted<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = P::NAMES.iter().find(|(_, prior)| *prior == self.prior).map_or("", |(name, _)| name);
        write!(f, "{name}={}", self.weight)
    }
}

serde_as_text!(Weighted<VolumePrior>);
serde_as_text!(Weighted<Prior>);

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::scene::bricks::Topology;
    use glam::IVec3;

    /// Two bricks side by side and one that touches neither face.
    fn field() -> (Neighbours, Vec<f64>) {
        let topology = Topology::new([IVec3::ZERO, IVec3::X, IVec3::new(3, 1, 0)]).unwrap();
        let x = (0..3 * LEAF_VOXELS).map(|i| (0.7 * i as f64).sin() + (0.013 * i as f64).cos()).collect();
        (Neighbours::new(&topology), x)
    }

    #[test]
    fn derivatives_by_voxel_match_central_differences() {
        let (neighbours, x) = field();
        for prior in [VolumePrior::Smooth, VolumePrior::TotalVariation] {
            let value = |x: &[f64]| prior.add(0.7, x, &neighbours, 1000, &mut vec![0.0; x.len()]);
            let mut gradient = vec![0.0; x.len()];
            prior.add(0.7, &x, &neighbours, 1000, &mut gradient);
            // Corners, faces between bricks and beyond them, the inside.
            for i in [0, 7, 63, 73, 448, 511, 512, 575, 700, 1023, 1024, 1100, 1535] {
                let at = |h: f64| {
                    let mut perturbed = x.clone();
                    perturbed[i] += h;
                    value(&perturbed)
                };
                let expected = (at(1e-5) - at(-1e-5)) / 2e-5;
                assert!((gradient[i] - expected).abs() < 1e-9, "{prior:?} {i} {} {expected}", gradient[i]);
            }
            assert!(gradient.iter().sum::<f64>().abs() < 1e-14, "{prior:?}: a level more changes nothing");
        }
    }

    /// Density over 0..7.
    type Shape = fn(f64) -> f64;

    /// An edge costs its height by total variation, however wide it is; smoothness asks for a wide one.
    #[test]
    fn edges_and_ramps() {
        let topology = Topology::new([IVec3::ZERO]).unwrap();
        let neighbours = Neighbours::new(&topology);
        let value = |prior: VolumePrior, of: Shape| {
            let x: Vec<f64> = (0..LEAF_VOXELS).map(|i| of((i % 8) as f64)).collect();
            prior.add(1.0, &x, &neighbours, LEAF_VOXELS, &mut vec![0.0; LEAF_VOXELS])
        };
        let (edge, ramp): (Shape, Shape) = (|z| f64::from(z > 3.5), |z| z / 7.0);
        let [sharp, wide] = [edge, ramp].map(|of| value(VolumePrior::TotalVariation, of));
        assert!((sharp / (1.0 / 8.0) - 1.0).abs() < 2e-3 && (sharp / wide - 1.0).abs() < 1e-2, "{sharp} {wide}");
        let [sharp, wide] = [edge, ramp].map(|of| value(VolumePrior::Smooth, of));
        assert!((sharp - 1.0 / 24.0).abs() < 1e-15 && (sharp / wide - 7.0).abs() < 1e-12, "{sharp} {wide}");
    }

    #[test]
    fn derivatives_by_texel_and_point_match_central_differences() {
        let wave = |i: usize, c: usize| 0.5 + 0.4 * (1.3 * i as f64 + 2.1 * c as f64).sin();
        let texels = (0..6).map(|i| std::array::from_fn(|c| wave(i, c))).collect();
        let points = (0..4).map(|i| std::array::from_fn(|c| if c == 0 { i as f64 } else { wave(i, c) })).collect();
        for transfer in [Transfer::Texture { domain: [0.0, 1.0], texels }, Transfer::Piecewise { points }] {
            let parameters: Vec<f64> = transfer.parameters().iter().map(|p| p.1).collect();
            for prior in [TransferPrior::Smooth, TransferPrior::SmoothColors] {
                let (_, derivatives) = prior.evaluate_transfer(&transfer, 3.0).unwrap();
                for i in 0..parameters.len() {
                    let at = |h: f64| {
                        let mut perturbed = parameters.clone();
                        perturbed[i] += h;
                        prior.evaluate_transfer(&transfer.with_parameters(&perturbed), 3.0).unwrap().0
                    };
                    let expected = (at(1e-5) - at(-1e-5)) / 2e-5;
                    assert!((derivatives[i] - expected).abs() < 1e-9, "{prior:?} {i} {} {expected}", derivatives[i]);
                }
            }
        }
        assert!(
            TransferPrior::Smooth
                .evaluate_transfer(&Transfer::Gaussians { domain: [0.0, 1.0], lobes: vec![] }, 1.0)
                .is_err()
        );
    }

    /// Equation 12 of the paper, by hand.
    #[test]
    fn smoothness_of_texels_is_the_papers() {
        let texels = [[0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 4.0], [1.0, 0.5, 0.0, 4.0]];
        let (all, _) = TransferPrior::Smooth.evaluate(&texels, 2.0);
        assert!((all - (1.0 + 4.0 + 0.25) / 8.0).abs() < 1e-15);
        let (colors, derivatives) = TransferPrior::SmoothColors.evaluate(&texels, 2.0);
        assert!((colors - 1.25 / 6.0).abs() < 1e-15 && derivatives.iter().all(|s| s[3] == 0.0));
        assert_eq!(TransferPrior::Smooth.evaluate(&texels[..1], 2.0), (0.0, vec![[0.0; 4]]));
    }

    #[test]
    fn names_round_trip_and_nonsense_is_refused() {
        for text in ["smooth=0.5", "tv=1", "tf=0.4", "tf-rgb=0"] {
            assert_eq!(text.parse::<Weighted<Prior>>().unwrap().to_string(), text);
        }
        for text in ["smooth", "tv=", "tv=-1", "tv=nan", "tv=inf", "rough=1", ""] {
            assert!(text.parse::<Weighted<Prior>>().unwrap_err().to_string().contains("tv=WEIGHT"), "{text}");
        }
        assert!("tf=1".parse::<Weighted<VolumePrior>>().is_err() && "tv=1".parse::<Weighted<VolumePrior>>().is_ok());
    }
}
