//! Gauss-Legendre quadrature with four points on 0..1, exact to degree 7: of a cubic density it keeps the integral, the
//! integral up to each point, and the integral of the square.
//!
//! Vectors of four hold one point in each lane.

use crate::real::Real;
use crate::real::{LANES, Lanes};

/// Quadrature points on 0..1.
pub(crate) const NODES: [f64; LANES] =
    [0.069_431_844_202_973_71, 0.330_009_478_207_571_87, 0.669_990_521_792_428_1, 0.930_568_155_797_026_3];

/// Quadrature weights of [`NODES`].
pub(crate) const WEIGHTS: [f64; LANES] =
    [0.173_927_422_568_726_93, 0.326_072_577_431_273_07, 0.326_072_577_431_273_07, 0.173_927_422_568_726_93];

/// Row k: weights that integrate a cubic from 0 to point k (the matrix of the collocation method of
/// order 8; Hairer, Nørsett & Wanner 1993, sect. II.7).
pub(crate) const UP_TO: [[f64; LANES]; LANES] = [
    [0.086_963_711_284_363_46, -0.026_604_180_084_998_793, 0.012_627_462_689_404_725, -0.003_555_149_685_795_683],
    [0.188_118_117_499_868_07, 0.163_036_288_715_636_54, -0.027_880_428_602_470_895, 0.006_735_500_594_538_155],
    [0.167_191_921_974_188_77, 0.353_953_006_033_743_97, 0.163_036_288_715_636_54, -0.014_190_694_931_141_143],
    [0.177_482_572_254_522_6, 0.313_445_114_741_868_35, 0.352_676_757_516_271_86, 0.086_963_711_284_363_46],
];

/// Coefficients, from the constant up, of the polynomial that is one at the first point and zero at the others; its
/// argument runs from -1 to 1. The last point's polynomial is the mirror image.
const OUTER: [f64; LANES] =
    [-0.092_326_598_440_728_82, 0.107_214_847_635_239_9, 0.798_762_063_028_367_2, -0.927_567_508_504_868_3];
/// Coefficients, from the constant up, of the polynomial that is one at the second point and zero at the others; the
/// third point's polynomial is the mirror image.
const INNER: [f64; LANES] =
    [0.592_326_598_440_728_8, -1.742_234_191_045_093_8, -0.798_762_063_028_367_2, 2.349_431_175_944_382_6];

/// Converts a constant to the kernel's precision.
#[inline(always)]
pub(crate) fn lanes<R: Real>(c: [f64; LANES]) -> R::Lanes {
    R::Lanes::load([R::of(c[0]), R::of(c[1]), R::of(c[2]), R::of(c[3])])
}

/// Returns `Σ_k v_k rows_k`.
#[inline(always)]
fn combine<R: Real>(rows: &[[f64; LANES]; LANES], v: R::Lanes) -> R::Lanes {
    let [a, b, c, d] = v.store();
    let all = <R::Lanes as Lanes<R>>::splat;
    (lanes::<R>(rows[0]) * all(a) + lanes::<R>(rows[1]) * all(b))
        + (lanes::<R>(rows[2]) * all(c) + lanes::<R>(rows[3]) * all(d))
}

/// Returns the integrals over 0..1 of four segments at once, from the values at each point.
#[inline(always)]
pub(crate) fn integral<R: Real>([a, b, c, d]: [R::Lanes; LANES]) -> R::Lanes {
    let all = |v: f64| R::Lanes::splat(R::of(v));
    all(WEIGHTS[0]) * (a + d) + all(WEIGHTS[1]) * (b + c)
}

/// Returns the integrals from 0 to each point of the cubic with these values at the points.
#[inline(always)]
pub(crate) fn integrals_up_to<R: Real>(v: R::Lanes) -> R::Lanes {
    combine::<R>(&transposed(UP_TO), v)
}

/// Applies the transpose of [`integrals_up_to`].
#[inline(always)]
pub(crate) fn integrals_up_to_transposed<R: Real>(v: R::Lanes) -> R::Lanes {
    combine::<R>(&UP_TO, v)
}

const fn transposed(m: [[f64; LANES]; LANES]) -> [[f64; LANES]; LANES] {
    let mut t = m;
    let mut i = 0;
    while i < LANES * LANES {
        t[i / LANES][i % LANES] = m[i % LANES][i / LANES];
        i += 1;
    }
    t
}

/// Returns the coefficients, from the constant up, of the cubics with these values at each point, for four segments at
/// once; the argument runs from -1 to 1.
#[inline(always)]
pub(crate) fn coefficients<R: Real>([a, b, c, d]: [R::Lanes; LANES]) -> [R::Lanes; LANES] {
    let all = |v: f64| R::Lanes::splat(R::of(v));
    let (even, odd) = ([a + d, b + c], [a - d, b - c]);
    let coefficient = |k: usize| {
        let [outer, inner] = if k.is_multiple_of(2) { even } else { odd };
        all(OUTER[k]) * outer + all(INNER[k]) * inner
    };
    [coefficient(0), coefficient(1), coefficient(2), coefficient(3)]
}

/// Returns bounds of cubics over -1..1: the least and the greatest of their Bézier points.
#[inline(always)]
pub(crate) fn hull<R: Real>([a, b, c, d]: [R::Lanes; LANES]) -> (R::Lanes, R::Lanes) {
    let third = R::Lanes::splat(R::of(1.0 / 3.0));
    let (even, odd) = (a + c, b + d);
    let (mid_even, mid_odd) = (a - third * c, third * b - d);
    let (p, q, r, s) = (even - odd, mid_even - mid_odd, mid_even + mid_odd, even + odd);
    (p.lesser(q).lesser(r.lesser(s)), p.greater(q).greater(r.greater(s)))
}

/// Radius of the circle on which [`error`] bounds the integrand.
const RADIUS: f64 = 5.0;
/// Quadrature error of the four points for `Σ (v / RADIUS)ⁿ` over -1..1, summed over all even n from 8 on.
const LOST: f64 = 3.252_618_1e-8;

/// Bounds, for four segments at once, the error of the four points for `∫ σ (d - d̄) e^{-τ}` over a segment, `τ(t) =
/// ∫₀ᵗ σ`. `density` holds coefficients of the cubic, `mean` is the mean density d̄. `depth` is the optical depth of
/// the whole segment at its middle's density, and `slope` its change with the density: `σ` is `depth` plus `slope`
/// times the density's difference from that of the middle.
///
/// Each coefficient of the integrand's Taylor series about the middle is at most that of a majorant, made of the
/// magnitudes of the cubics' coefficients; the majorant's are bounded by its value on a circle (Cauchy). `σ (d - d̄)`
/// itself, of degree 6, is integrated exactly. Where the majorant bounds nothing, the integral and its sum of four are
/// both at most a few times the largest difference.
#[inline(always)]
pub(crate) fn error<R: Real>(density: [R::Lanes; LANES], mean: R::Lanes, depth: R::Lanes, slope: R::Lanes) -> R::Lanes {
    let all = |v: f64| R::Lanes::splat(R::of(v));
    let [m0, m1, m2, m3] = [density[0], density[1].abs(), density[2].abs(), density[3].abs()];
    let r = RADIUS;
    let tail = all(r) * m1 + (all(r * r) * m2 + all(r * r * r) * m3);
    let (depth, slope) = (depth.abs(), slope.abs());
    let varied = (m0 - mean).abs() + tail;
    let half = all(0.5);
    let reach = depth + slope * (all(r / 2.0) * m1 + (all(r * r / 3.0) * m2 + all(r * r * r / 4.0) * m3));
    let reach = half * all(r) * reach;
    // e^x - 1 ≤ x (1 + x/2 (1 + x/3 · 4)) up to x = 3; beyond that nothing is claimed.
    let x = reach.lesser(all(3.0));
    let growth = x * (all(1.0) + half * x * (all(1.0) + all(4.0 / 3.0) * x));
    let bound = half * (depth + slope * tail) * varied * all(LOST) * growth + (reach - x) * all(1e30) * varied;
    bound.lesser(all(8.0) * varied)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec4;
    use proptest::prelude::*;

    fn cubic(density: [f64; LANES], u: f64) -> f64 {
        let (v, w) = ([2.0 * u - 1.0, 1.0 - 2.0 * u], density);
        let basis = |c: [f64; LANES], v: f64| c[0] + v * (c[1] + v * (c[2] + v * c[3]));
        basis(OUTER, v[0]) * w[0] + basis(INNER, v[0]) * w[1] + basis(INNER, v[1]) * w[2] + basis(OUTER, v[1]) * w[3]
    }

    /// `∫ σ (d - reference) e^{-τ}` over 0..1 by the points alone, `σ = a + b d`.
    fn four(density: [f64; LANES], [a, b]: [f64; 2], reference: f64) -> f64 {
        let sigma = density.map(|d| a + b * d);
        let tau = integrals_up_to::<f64>(DVec4::from(sigma)).to_array();
        (0..LANES).map(|k| WEIGHTS[k] * sigma[k] * (density[k] - reference) * (-tau[k]).exp()).sum()
    }

    /// Integrates as `four` does, in 64 pieces: more accurate by 9 orders of magnitude.
    fn fine(density: [f64; LANES], line: [f64; 2], reference: f64) -> f64 {
        let (mut total, mut depth, n) = (0.0, 0.0, 64.0);
        for piece in 0..64 {
            let part = NODES.map(|node| cubic(density, (f64::from(piece) + node) / n));
            total += f64::exp(-depth) * four(part, line.map(|v| v / n), reference);
            depth += integral::<f64>(part.map(|d| DVec4::splat(line[0] + line[1] * d)))[0] / n;
        }
        total
    }

    fn bound(density: [f64; LANES], [a, b]: [f64; 2], mean: f64) -> f64 {
        let c = coefficients::<f64>(density.map(DVec4::splat));
        let all = DVec4::splat;
        error::<f64>(c, all(mean), all(a) + all(b) * c[0], all(b))[0]
    }

    fn mean(density: [f64; LANES]) -> f64 {
        integral::<f64>(density.map(DVec4::splat))[0]
    }

    proptest! {
        #[test]
        fn the_bound_holds(
            density in prop::array::uniform4(0.0..1.0_f64),
            line in prop::array::uniform2((-3.0..1.5_f64).prop_map(|e| 10_f64.powf(e))),
        ) {
            // The cubic through any four values may dip below zero: such are none of ours.
            prop_assume!((0..=20).all(|i| cubic(density, f64::from(i) / 20.0) >= 0.0));
            let mean = mean(density);
            let lost = (four(density, line, mean) - fine(density, line, mean)).abs();
            let bound = bound(density, line, mean);
            prop_assert!(lost <= bound + 1e-15, "{lost:e} > {bound:e}");
        }

        #[test]
        fn the_hull_holds(density in prop::array::uniform4(-1.0..1.0_f64)) {
            let (least, most) = hull::<f64>(coefficients::<f64>(density.map(DVec4::splat)));
            for i in 0..=20 {
                let value = cubic(density, f64::from(i) / 20.0);
                prop_assert!(least[0] <= value + 1e-12 && value <= most[0] + 1e-12);
            }
        }

        /// Depths are exact, and so is the integral of the square.
        #[test]
        fn cubics_are_integrated_exactly(c in prop::array::uniform4(-1.0..1.0_f64)) {
            let power = |u: f64, n: i32| u.powi(n) / f64::from(n);
            let values = NODES.map(|u| c[0] + u * (c[1] + u * (c[2] + u * c[3])));
            let up_to = integrals_up_to::<f64>(DVec4::from(values)).to_array();
            for (u, got) in NODES.into_iter().zip(up_to) {
                let expected: f64 = (0..4).map(|k| c[k as usize] * power(u, k + 1)).sum();
                prop_assert!((got - expected).abs() < 1e-15, "{got} {expected}");
            }
            let square: f64 = (0..LANES).map(|k| WEIGHTS[k] * values[k] * values[k]).sum();
            let expected: f64 = (0..4).flat_map(|i| (0..4).map(move |j| (i, j)))
                .map(|(i, j)| c[i as usize] * c[j as usize] * power(1.0, i + j + 1)).sum();
            prop_assert!((square - expected).abs() < 1e-14);
        }

        #[test]
        fn the_transpose_is_one(v in prop::array::uniform4(-1.0..1.0_f64), w in prop::array::uniform4(-1.0..1.0_f64)) {
            let (v, w) = (DVec4::from(v), DVec4::from(w));
            let (left, right) = (integrals_up_to::<f64>(v).dot(w), v.dot(integrals_up_to_transposed::<f64>(w)));
            prop_assert!((left - right).abs() < 1e-15);
        }
    }

    /// Not so loose that it would cost: smooth cells of optical depth 0.3 are left whole.
    #[test]
    fn the_bound_is_of_use() {
        let density = NODES.map(|u| 0.7 + u * (0.3 - 0.1 * u));
        let bound = bound(density, [0.0, 0.3], mean(density));
        assert!(bound < 4e-7, "{bound:e}");
    }
}
