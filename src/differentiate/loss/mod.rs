//! Losses on pictures: values and derivatives with respect to every pixel.
//!
//! A local loss is a mean over pixels: its derivative follows from each pixel alone, so that value and gradient of a
//! ray take one walk. A global loss is a function of a whole picture.

pub mod prior;

use crate::metrics::ssim;

/// Red, green, blue and alpha = 1 - transmittance.
pub type Rgba = [f64; 4];

/// A loss on pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// Mean of `|c - c'|` over pixels and colors.
    L1,
    /// Mean of `(c - c')²` over pixels and colors.
    L2,
    /// Mean of `r² / 2` where `|r| ≤ delta`, `delta (|r| - delta / 2)` beyond, `r = c - c'` (Huber 1964).
    Huber {
        /// Difference from which on the loss grows linearly.
        delta: f64,
    },
    /// Mean over pixels of `(ln T - ln T')²`, both transmittances clamped to a floor; the derivative of a pixel below
    /// it is zero.
    LogTransmittance {
        /// Least transmittance.
        floor: f64,
    },
    /// Mean over pixels and colors.
    Mean,
    /// Entropy of the alphas, relative to that of equal alphas: `H = -Σ p log p / log N`, `p = α / Σ α` (Ji & Shen
    /// 2006; Weiss & Westermann 2021, eq. 11, whose sign makes it negative). Value and derivative of a blank picture
    /// are zero.
    OpacityEntropy,
    /// `1 - SSIM`, mean over the colors (`ssim`), for signals of this peak.
    Dissimilarity {
        /// Range of the signal.
        peak: f64,
    },
}

/// The pixels that a loss's derivative with respect to one pixel depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// The pixel alone: value and gradient need one walk.
    Local,
    /// The whole picture: rays are walked again once it is known.
    Global,
}

/// Sum of alphas below which a picture counts as blank.
const BLANK: f64 = 1e-9;

impl Loss {
    /// Returns the pixels that a derivative depends on.
    pub fn reach(&self) -> Reach {
        match self {
            Self::OpacityEntropy | Self::Dissimilarity { .. } => Reach::Global,
            _ => Reach::Local,
        }
    }

    /// True if the loss compares with a target picture.
    pub fn compares(&self) -> bool {
        !matches!(self, Self::Mean | Self::OpacityEntropy)
    }

    /// Returns value and derivatives of one pixel, before the mean over pixels; zero for global losses.
    pub fn pixel(&self, rendered: &Rgba, target: &Rgba) -> (f64, Rgba) {
        let by_color = |f: &dyn Fn(f64) -> (f64, f64)| {
            let (mut sum, mut derivative) = (0.0, [0.0; 4]);
            for c in 0..3 {
                let (value, by) = f(rendered[c] - target[c]);
                sum += value / 3.0;
                derivative[c] = by / 3.0;
            }
            (sum, derivative)
        };
        match *self {
            // At zero every number from -1 to 1 is a subgradient; zero asks for nothing.
            Self::L1 => by_color(&|r| (r.abs(), if r == 0.0 { 0.0 } else { r.signum() })),
            Self::L2 => by_color(&|r| (r * r, 2.0 * r)),
            Self::Huber { delta } => by_color(&|r| {
                if r.abs() <= delta { (0.5 * r * r, r) } else { (delta * (r.abs() - 0.5 * delta), delta * r.signum()) }
            }),
            Self::LogTransmittance { floor } => {
                let transmittance = 1.0 - rendered[3];
                let off = (transmittance.max(floor) / (1.0 - target[3]).max(floor)).ln();
                let derivative = if transmittance > floor { -2.0 * off / transmittance } else { 0.0 };
                (off * off, [0.0, 0.0, 0.0, derivative])
            }
            Self::Mean => ((rendered[0] + rendered[1] + rendered[2]) / 3.0, [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, 0.0]),
            Self::OpacityEntropy | Self::Dissimilarity { .. } => (0.0, [0.0; 4]),
        }
    }

    /// Returns value and derivatives of a picture with rows of `width` pixels. Pixels that are not finite in either
    /// picture are ignored; they count as equal where windows contain them.
    pub fn picture(&self, rendered: &[Rgba], target: Option<&[Rgba]>, width: usize) -> (f64, Vec<Rgba>) {
        let black = [0.0; 4];
        let target_at = |i: usize| target.map_or(&black, |t| &t[i]);
        let compared = |i: usize| rendered[i].iter().chain(target_at(i)).all(|v| v.is_finite());
        match self {
            Self::OpacityEntropy => {
                let alpha: Vec<f64> =
                    (0..rendered.len()).map(|i| if compared(i) { rendered[i][3] } else { 0.0 }).collect();
                let (value, derivatives) = entropy(&alpha, (0..rendered.len()).filter(|i| compared(*i)).count());
                (value, derivatives.into_iter().map(|s| [0.0, 0.0, 0.0, s]).collect())
            }
            Self::Dissimilarity { peak } => {
                let (mut value, mut derivatives) = (0.0, vec![[0.0; 4]; rendered.len()]);
                for c in 0..3 {
                    let plane = |p: &dyn Fn(usize) -> f64| -> Vec<f64> {
                        (0..rendered.len()).map(|i| if compared(i) { p(i) } else { 0.0 }).collect()
                    };
                    let (a, b) = (plane(&|i| rendered[i][c]), plane(&|i| target_at(i)[c]));
                    let (similarity, gradient) = ssim::gradient(&a, &b, width, *peak);
                    value += (1.0 - similarity) / 3.0;
                    for i in (0..rendered.len()).filter(|i| compared(*i)) {
                        derivatives[i][c] = -gradient[i] / 3.0;
                    }
                }
                (value, derivatives)
            }
            _ => {
                let share = 1.0 / (0..rendered.len()).filter(|i| compared(*i)).count().max(1) as f64;
                let mut sum = 0.0;
                let derivatives = rendered.iter().enumerate().map(|(i, pixel)| {
                    if !compared(i) {
                        return [0.0; 4];
                    }
                    let (value, derivative) = self.pixel(pixel, target_at(i));
                    sum += value;
                    derivative.map(|s| share * s)
                });
                let derivatives = derivatives.collect();
                (share * sum, derivatives)
            }
        }
    }
}

/// Returns the entropy `H = (ln S - A / S) / ln N`, `S = Σ α`, `A = Σ α ln α`, without a division by a single α, and
/// its derivatives `dH/dα = (A / S - ln α) / (S ln N)`. The derivative of a clear pixel is infinite; it counts as zero,
/// because no voxel that could change the pixel lies on its ray.
fn entropy(alpha: &[f64], count: usize) -> (f64, Vec<f64>) {
    let sum: f64 = alpha.iter().map(|a| a.max(0.0)).sum();
    if sum < BLANK || count < 2 {
        return (0.0, vec![0.0; alpha.len()]);
    }
    let mean = alpha.iter().filter(|a| **a > 0.0).map(|a| a * a.ln()).sum::<f64>() / sum;
    let most = (count as f64).ln();
    let derivative = |a: &f64| if *a > 0.0 { (mean - a.ln()) / (sum * most) } else { 0.0 };
    ((sum.ln() - mean) / most, alpha.iter().map(derivative).collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    const LOSSES: [Loss; 7] = [
        Loss::L1,
        Loss::L2,
        Loss::Huber { delta: 0.2 },
        Loss::LogTransmittance { floor: 1e-4 },
        Loss::Mean,
        Loss::OpacityEntropy,
        Loss::Dissimilarity { peak: 1.0 },
    ];

    fn pictures(width: usize, height: usize) -> (Vec<Rgba>, Vec<Rgba>) {
        let wave = |i: usize, c: usize, k: f64| 0.5 + 0.4 * (k * i as f64 + 1.7 * c as f64).sin();
        let of = |k: f64| (0..width * height).map(|i| std::array::from_fn(|c| wave(i, c, k))).collect();
        (of(0.37), of(0.41))
    }

    #[test]
    fn derivatives_match_central_differences() {
        for (width, height) in [(5, 4), (16, 13)] {
            let (rendered, target) = pictures(width, height);
            for loss in LOSSES {
                let (_, derivatives) = loss.picture(&rendered, Some(&target), width);
                let largest = derivatives.iter().flatten().fold(0.0_f64, |m, s| m.max(s.abs()));
                assert!(largest > 0.0, "{loss:?}");
                for (i, derivative) in derivatives.iter().enumerate().step_by(7) {
                    for c in 0..4 {
                        let at = |h: f64| {
                            let mut perturbed = rendered.clone();
                            perturbed[i][c] += h;
                            loss.picture(&perturbed, Some(&target), width).0
                        };
                        let expected = (at(1e-5) - at(-1e-5)) / 2e-5;
                        // h² f''' and 1e-16 / h; derivatives are of order 1 / pixels.
                        assert!(
                            (derivative[c] - expected).abs() < 1e-6 * largest,
                            "{loss:?} {i} {c} {derivative:?} {expected}"
                        );
                    }
                }
            }
        }
    }

    /// A local loss is the mean of its pixels.
    #[test]
    fn local_losses_add_up() {
        let (rendered, target) = pictures(6, 5);
        for loss in LOSSES.into_iter().filter(|l| l.reach() == Reach::Local) {
            let mean = rendered.iter().zip(&target).map(|(a, b)| loss.pixel(a, b).0).sum::<f64>() / 30.0;
            assert!((loss.picture(&rendered, Some(&target), 6).0 - mean).abs() < 1e-14, "{loss:?}");
        }
    }

    #[test]
    fn equal_pictures_ask_for_nothing() {
        let (rendered, _) = pictures(12, 12);
        for loss in LOSSES.into_iter().filter(Loss::compares) {
            let (value, derivatives) = loss.picture(&rendered, Some(&rendered), 12);
            assert!(value.abs() < 1e-14, "{loss:?} {value}");
            // A maximum of the similarity: its derivative is the rounding of terms of order 1.
            assert!(derivatives.iter().flatten().all(|s| s.abs() < 1e-13), "{loss:?}");
        }
    }

    #[test]
    fn blank_pictures_have_no_entropy() {
        for alpha in [0.0, 1e-13] {
            let (value, derivatives) = Loss::OpacityEntropy.picture(&[[0.5, 0.5, 0.5, alpha]; 20], None, 5);
            assert_eq!(value, 0.0);
            assert!(derivatives.iter().flatten().all(|s| *s == 0.0));
        }
        assert_eq!(Loss::OpacityEntropy.picture(&[[1.0; 4]], None, 1).0, 0.0, "one pixel");
        assert_eq!(Loss::OpacityEntropy.picture(&[], None, 1).0, 0.0, "none");
    }

    #[test]
    fn equal_alphas_have_all_the_entropy_and_one_pixel_none() {
        let (value, derivatives) = Loss::OpacityEntropy.picture(&[[0.0, 0.0, 0.0, 0.3]; 16], None, 4);
        assert!((value - 1.0).abs() < 1e-15);
        assert!(derivatives.iter().flatten().all(|s| s.abs() < 1e-15), "it is the maximum");
        let mut one = vec![[0.0; 4]; 16];
        one[3][3] = 0.7;
        let (value, derivatives) = Loss::OpacityEntropy.picture(&one, None, 4);
        assert!(value.abs() < 1e-15 && derivatives.iter().flatten().all(|s| s.is_finite()));
    }

    #[test]
    fn what_is_not_finite_asks_for_nothing() {
        let (mut rendered, mut target) = pictures(12, 12);
        target[5] = [f64::NAN; 4];
        rendered[7][3] = f64::INFINITY;
        for loss in LOSSES {
            let (value, derivatives) = loss.picture(&rendered, Some(&target), 12);
            assert!(value.is_finite() && derivatives.iter().flatten().all(|s| s.is_finite()), "{loss:?}");
            assert_eq!((derivatives[5], derivatives[7]), ([0.0; 4], [0.0; 4]), "{loss:?}");
        }
    }

    #[test]
    fn beneath_the_floor_nothing_pulls() {
        let loss = Loss::LogTransmittance { floor: 1e-3 };
        let (value, derivative) = loss.pixel(&[0.0, 0.0, 0.0, 1.0], &[0.0, 0.0, 0.0, 0.5]);
        assert!((value - 500.0_f64.ln().powi(2)).abs() < 1e-12);
        assert_eq!(derivative, [0.0; 4]);
    }
}
