//! Opacity entropy of a picture (Ji & Shen 2006; Weiss & Westermann 2021, eq. 11), the larger the better.
//!
//! With the opacities α of N pixels, `p = α / S` and `S = Σ α`, it is `H = -Σ p ln p / ln N`, from 0 (one pixel
//! holds all) to 1 (all hold the same). Written as
//!
//! ```text
//! H  = (ln S - A / S) / ln N,    A = Σ α ln α
//! dH = (A / S² · Σ dα - 1 / S · Σ ln α dα) / ln N
//! ```
//! pixels without opacity add nothing, and value and derivative follow from sums over the pixels: one walk
//! gives both; no pixel's derivative is needed in advance.

use crate::differentiate::gradient::camera_jacobian::Rows;
use crate::render::differentiable::Differentiable;
use glam::DVec3;
use std::iter::Sum;

/// Opacity per pixel below which a picture is blank: beneath what 32-bit densities resolve.
const BLANK: f64 = 1e-12;
/// Stands for `ln α` where α is zero: there dα is, too.
const LEAST: f64 = 1e-30;

/// Derivative of a radiance by its alpha, as a loss.
const ALPHA: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

/// Sums over pixels, and their derivatives by a rotation of the camera about a centre.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Sums {
    /// `Σ α`.
    alpha: f64,
    /// `Σ α ln α`.
    log: f64,
    /// `Σ dα`.
    turned: DVec3,
    /// `Σ ln α dα`.
    turned_log: DVec3,
}

impl Sums {
    fn add(&mut self, alpha: f64, turned: DVec3) {
        let log = alpha.max(LEAST).ln();
        self.alpha += alpha;
        self.log += alpha * log;
        self.turned += turned;
        self.turned_log += log * turned;
    }

    fn entropy(&self, pixels: usize) -> Entropy {
        let (s, n) = (self.alpha, pixels as f64);
        if s < BLANK * n || pixels < 2 {
            return Entropy { value: 0.0, by_turn: DVec3::ZERO, blank: s < BLANK * n };
        }
        let scale = 1.0 / n.ln();
        Entropy {
            value: scale * (s.ln() - self.log / s),
            by_turn: scale / s * (self.log / s * self.turned - self.turned_log),
            blank: false,
        }
    }
}

impl Sum for Sums {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::default(), |a, b| Self {
            alpha: a.alpha + b.alpha,
            log: a.log + b.log,
            turned: a.turned + b.turned,
            turned_log: a.turned_log + b.turned_log,
        })
    }
}

/// Entropy of what a camera sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Entropy {
    /// From 0 to 1.
    pub value: f64,
    /// Derivative with respect to a rotation of the camera about a centre: a vector along the axis, world axes, in
    /// radians. Zero if it was not requested.
    pub by_turn: DVec3,
    /// True if no pixel has any opacity; value and derivative are zero then.
    pub blank: bool,
}

/// Entropy of a picture.
pub fn value(rows: &Rows<'_, impl Differentiable<Real = f32>>) -> Entropy {
    let sums = rows.fold(|_| true, &[], |sums: &mut Sums, _, rendered, _| sums.add(rendered[3], DVec3::ZERO));
    sums.into_iter().sum::<Sums>().entropy(rows.pixels())
}

/// Entropy of a picture, and its derivative as the camera moves about `centre` as a rigid body: its position p by
/// `ω × (p - centre)`, its axes by ω.
pub fn gradient(rows: &Rows<'_, impl Differentiable<Real = f32>>, centre: DVec3) -> Entropy {
    let arm = rows.camera.position() - centre;
    let sums = rows.fold(
        |_| true,
        &[ALPHA],
        |sums: &mut Sums, _, rendered, by| sums.add(rendered[3], arm.cross(by[0].position) + by[0].rotation),
    );
    sums.into_iter().sum::<Sums>().entropy(rows.pixels())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(alphas: &[f64]) -> Entropy {
        let mut sums = Sums::default();
        alphas.iter().for_each(|a| sums.add(*a, DVec3::ZERO));
        sums.entropy(alphas.len())
    }

    #[test]
    fn it_is_the_papers_formula() {
        let alphas = [0.2, 0.9, 0.0, 0.4, 1.0];
        let s: f64 = alphas.iter().sum();
        let p = alphas.iter().filter(|a| **a > 0.0).map(|a| a / s);
        let expected = -p.map(|p| p * p.log2()).sum::<f64>() / 5_f64.log2();
        assert!((of(&alphas).value - expected).abs() < 1e-15);
    }

    #[test]
    fn the_ends_of_its_range() {
        assert!((of(&[0.3; 7]).value - 1.0).abs() < 1e-15);
        assert!(of(&[0.0, 0.7, 0.0]).value.abs() < 1e-15);
        let blank = of(&[0.0; 4]);
        assert!(blank.blank && blank.value == 0.0);
        assert_eq!(of(&[0.5]).value, 0.0, "ln 1 is zero");
    }

    #[test]
    fn the_derivative_is_that_of_the_value() {
        let alphas = [0.2, 0.9, 0.05, 0.4];
        let derivatives = [0.3, -0.5, 0.02, 0.1];
        let at = |h: f64| of(&std::array::from_fn::<f64, 4, _>(|i| alphas[i] + h * derivatives[i])).value;
        let mut sums = Sums::default();
        for (alpha, derivative) in alphas.iter().zip(derivatives) {
            sums.add(*alpha, DVec3::new(derivative, 0.0, 0.0));
        }
        let difference = (at(1e-6) - at(-1e-6)) / 2e-6;
        assert!((sums.entropy(4).by_turn.x - difference).abs() < 1e-9);
    }
}
