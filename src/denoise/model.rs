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
