//! Linear models of a pixel's color by its feature, learned recursively.
//!
//! The model `I ≈ p β` has the predictor `p = [1, z]` of a feature z of three channels, and four coefficients for each
//! channel of the color. Weighted recursive least squares with the forgetting factor λ minimises `Σ λ^age w (I - p
//! β)²`. It is usually stated for the inverse `P` of the information matrix `R = Σ λ^age w pᵀp` (Ljung & Söderström
//! 1987; the paper's equations 9 to 14). That form divides by λ what no sample confirms, so that `P` grows without
//! bound where the feature stays the same, and rounding makes it indefinite. This one keeps `R` and the moments `Σ
//! λ^age w pᵀI`, which are sums of what was seen and cannot grow, and solves for β with a ridge.

use glam::Vec3;

/// Predictor of a color: 1 and a feature.
pub(crate) type Predictor = [f32; 4];

/// Coefficients of the three channels by component of the predictor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Coefficients(pub [Vec3; 4]);

impl Coefficients {
    /// Coefficients that predict the feature itself.
    pub(crate) const FEATURE: Self = Self([Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z]);

    /// Returns the color that a predictor stands for.
    #[inline(always)]
    pub(crate) fn predict(&self, predictor: &Predictor) -> Vec3 {
        self.0.iter().zip(predictor).fold(Vec3::ZERO, |sum, (beta, p)| sum + *beta * *p)
    }
}

/// Returns the predictor of a feature.
#[inline(always)]
pub(crate) fn predictor(feature: Vec3) -> Predictor {
    [1.0, feature.x, feature.y, feature.z]
}

/// Sums over the samples of a pixel, from which its model follows.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Model {
    /// Upper triangle of the information matrix, row by row.
    information: [f32; 10],
    /// Moments of the color by component of the predictor.
    moments: [Vec3; 4],
}

/// Place in the triangle of the elements of each row, from the diagonal on.
const ROWS: [usize; 4] = [0, 4, 7, 9];

/// Ridge as a share of the information's diagonal: more than rounding takes from its eigenvalues, less than noise adds.
const RIDGE: f32 = 1e-3;

impl Model {
    /// Returns the element of the information matrix in a row and a column.
    #[inline(always)]
    fn information(&self, row: usize, column: usize) -> f32 {
        let (row, column) = (row.min(column), row.max(column));
        self.information[ROWS[row] + column - row]
    }

    /// Returns how many samples the model rests on, each counted by its weight and age.
    #[inline(always)]
    pub(crate) fn samples(&self) -> f32 {
        self.information[0]
    }

    /// Adds a share of another model.
    #[inline(always)]
    pub(crate) fn add(&mut self, other: &Self, share: f32) {
        for (own, other) in self.information.iter_mut().zip(other.information) {
            *own += share * other;
        }
        for (own, other) in self.moments.iter_mut().zip(other.moments) {
            *own += share * other;
        }
    }

    /// Forgets a part, so that the share `by` stays, and learns a color with a weight.
    #[inline(always)]
    pub(crate) fn learn(&mut self, predictor: &Predictor, color: Vec3, weight: f32, by: f32) {
        for row in 0..4 {
            for column in row..4 {
                let element = &mut self.information[ROWS[row] + column - row];
                *element = by * *element + weight * predictor[row] * predictor[column];
            }
            self.moments[row] = by * self.moments[row] + weight * predictor[row] * color;
        }
    }

    /// Returns the coefficients. Where nothing was learned they predict the feature.
    ///
    /// The equations `(R + ridge) (β - β₀) = m - R β₀` are scaled to a diagonal of 1, which makes them the same for
    /// colors of any brightness, and solved by Cholesky's method. The ridge keeps every pivot above what rounding takes
    /// from it.
    #[inline(always)]
    pub(crate) fn solve(&self) -> Coefficients {
        let scale: [f32; 4] = std::array::from_fn(|i| {
            let diagonal = self.information(i, i);
            // Subnormal numbers have too few digits to be divided by.
            if diagonal >= f32::MIN_POSITIVE { diagonal.sqrt().recip() } else { 0.0 }
        });
        let Coefficients(prior) = Coefficients::FEATURE;
        let mut right: [Vec3; 4] = std::array::from_fn(|row| {
            let predicted = (0..4).fold(Vec3::ZERO, |sum, column| sum + self.information(row, column) * prior[column]);
            scale[row] * (self.moments[row] - predicted)
        });
        let mut lower = [[0.0_f32; 4]; 4];
        for column in 0..4 {
            for row in column..4 {
                let mut sum = scale[row] * scale[column] * self.information(row, column);
                if row == column {
                    sum += RIDGE;
                }
                for k in 0..column {
                    sum -= lower[row][k] * lower[column][k];
                }
                lower[row][column] =
                    if row == column { sum.max(0.1 * RIDGE).sqrt() } else { sum / lower[column][column] };
            }
        }
        for row in 0..4 {
            for k in 0..row {
                right[row] -= lower[row][k] * right[k];
            }
            right[row] /= lower[row][row];
        }
        for row in (0..4).rev() {
            for k in row + 1..4 {
                right[row] -= lower[k][row] * right[k];
            }
            right[row] /= lower[row][row];
        }
        Coefficients(std::array::from_fn(|i| prior[i] + scale[i] * right[i]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cheap hash to 0..1.
    fn noise(seed: u32) -> f32 {
        let h = (seed ^ 0x9E37_79B9).wrapping_mul(0x85EB_CA6B);
        ((h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35) >> 8) as f32 / (1 << 24) as f32
    }

    /// The channels in another order.
    fn turned(color: Vec3) -> Vec3 {
        Vec3::new(color.z, color.x, color.y)
    }

    /// The textbook's recursion for the inverse of the information matrix, equations 9 to 14.
    struct Inverse {
        covariance: [[f32; 4]; 4],
        beta: [Vec3; 4],
    }

    impl Inverse {
        fn new() -> Self {
            let covariance = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1e3 } else { 0.0 }));
            Self { covariance, beta: [Vec3::ZERO; 4] }
        }

        fn learn(&mut self, p: &Predictor, color: Vec3, weight: f32, lambda: f32) {
            let dot = |a: &[f32; 4], b: &[f32; 4]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
            let ahead: [f32; 4] = std::array::from_fn(|i| dot(&self.covariance[i], p));
            let gain = ahead.map(|v| v / (lambda / weight + dot(&ahead, p)));
            let error = color - Coefficients(self.beta).predict(p);
            let row: [f32; 4] = std::array::from_fn(|j| (0..4).map(|i| p[i] * self.covariance[i][j]).sum());
            for i in 0..4 {
                self.beta[i] += gain[i] * error;
                for j in 0..4 {
                    self.covariance[i][j] = (self.covariance[i][j] - gain[i] * row[j]) / lambda;
                }
            }
        }

        /// True while all is finite and the diagonal positive.
        fn holds(&self) -> bool {
            let finite =
                self.covariance.iter().flatten().all(|v| v.is_finite()) && self.beta.iter().all(|b| b.is_finite());
            finite && (0..4).all(|i| self.covariance[i][i] > 0.0)
        }
    }

    /// While the textbook's form holds, both have learned the same from varied colors.
    #[test]
    fn both_forms_learn_the_same() {
        let (mut model, mut inverse) = (Model::default(), Inverse::new());
        let mut p = predictor(Vec3::ZERO);
        for frame in 0..60 {
            let feature = Vec3::new(noise(3 * frame), noise(3 * frame + 1), noise(3 * frame + 2));
            let color = Vec3::new(0.3, 0.2, 0.1) + Vec3::new(0.5, 1.0, 0.2) * turned(feature);
            p = predictor(feature);
            let weight = 0.2 + 0.8 * noise(1000 + frame);
            model.learn(&p, color, weight, 0.998);
            inverse.learn(&p, color, weight, 0.998);
        }
        let [a, b] = [model.solve().predict(&p), Coefficients(inverse.beta).predict(&p)];
        assert!((a - b).abs().max_element() < 5e-3, "{a} {b}");
    }

    /// A hundred thousand frames of input without variety leave the model finite, near to what it saw and as definite
    /// as before; the textbook's form fails on some of it.
    #[test]
    fn models_stay_definite_where_the_inverse_form_fails() {
        type Input = fn(u32) -> Vec3;
        let inputs: [(&str, Input); 5] = [
            ("constant", |_| Vec3::new(0.8, 0.4, 0.2)),
            ("grey", |frame| Vec3::splat(0.5 + 0.1 * noise(frame))),
            ("black", |_| Vec3::ZERO),
            ("spiky", |frame| if frame % 997 == 0 { Vec3::splat(1e4) } else { Vec3::new(0.3, 0.2, 0.1) }),
            ("x1000", |frame| 1000.0 * Vec3::new(noise(frame), 0.5, noise(frame ^ 77))),
        ];
        let mut failed = 0;
        for lambda in [0.95_f32, 0.998] {
            for (name, input) in inputs {
                let (mut model, mut inverse, mut holds) = (Model::default(), Inverse::new(), true);
                let mut most = 0.0_f32;
                for frame in 0..100_000 {
                    let color = input(frame);
                    // A history follows the color slowly.
                    let p = predictor(0.75 * input(frame.saturating_sub(1)) + 0.25 * color);
                    model.learn(&p, color, 1.0, lambda);
                    if holds {
                        inverse.learn(&p, color, 1.0, lambda);
                        holds = inverse.holds();
                    }
                    let found = model.solve().predict(&p);
                    most = most.max(color.max_element());
                    assert!(found.is_finite() && found.abs().max_element() <= 3.0 * most, "{name} {frame}: {found}");
                }
                assert!((model.samples() * (1.0 - lambda) - 1.0).abs() < 1e-2, "{name}: {}", model.samples());
                failed += u32::from(!holds);
            }
        }
        assert!(failed >= 2, "the textbook's form failed on {failed} inputs");
    }

    #[test]
    fn nothing_learned_is_the_feature() {
        let p = predictor(Vec3::new(3.0, 1.0, 2.0));
        assert_eq!(Model::default().solve().predict(&p), Vec3::new(3.0, 1.0, 2.0));
    }

    /// Brighter light of the same picture gives brighter predictions of the same picture.
    #[test]
    fn predictions_scale_with_the_light() {
        let of = |light: f32| {
            let mut model = Model::default();
            for frame in 0..50 {
                let feature = light * Vec3::new(noise(frame), noise(frame + 99), 0.3);
                model.learn(&predictor(feature), turned(feature) * 0.5 + 0.1 * light, 1.0, 0.99);
            }
            model.solve().predict(&predictor(light * Vec3::splat(0.4))) / light
        };
        for light in [1e-12_f32, 1e-3, 1e3, 1e12] {
            assert!((of(light) / of(1.0) - 1.0).abs().max_element() < 2e-3, "{light}: {} {}", of(light), of(1.0));
        }
    }
}
