//! Transfer functions: spikes, steps, equal densities and lobes without width.

use super::fixtures::{SLAB, along_x, field, noise, slab, unit};
use super::{Area, Case, Formula, Naive, off, relative, worse};
use crate::error::Result;
use crate::math::{Aabb, Ray};
use crate::real::Real;
use crate::render::differentiable::{Accumulators, Adjoint, ParameterGradient};
use crate::render::dvr::{Dvr, Precision, Tape};
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::Bricks;
use crate::scene::medium::{Medium, Source};
use crate::scene::table::{Table, TableGradient};
use crate::scene::transfer::{Lobe, Transfer};
use glam::DVec3;
use std::sync::Arc;

pub(super) const CASES: &[Case] = &[
    Case {
        name: "function-spike",
        area: Area::TransferFunction,
        hazard: "a spike of extinction, 0.1 to 1e-6 wide, missed between samples",
        remedy: "cells cut where the density crosses a point of the function",
        naive_formula: "samples a voxel apart",
        figure: "relative error of the optical depth",
        bound: 1e-6,
        naive: Naive::Fails(1.0),
        measured: spike,
    },
    Case {
        name: "function-step",
        area: Area::TransferFunction,
        hazard: "light, and its derivatives by voxels and by the step, where the function jumps",
        remedy: "cells cut at the jump, whose move is a derivative of its own",
        naive_formula: "samples a voxel apart, differentiated",
        figure: "largest error of light and of derivatives by length",
        bound: 1e-7,
        naive: Naive::Fails(1e-2),
        measured: step,
    },
    Case {
        name: "coincident-points",
        area: Area::TransferFunction,
        hazard: "slope between two points at one density",
        remedy: "slope of the side above; 0 within a step",
        naive_formula: "difference of values over difference of densities",
        figure: "largest error of the slopes",
        bound: 0.0,
        naive: Naive::Fails(f64::INFINITY),
        measured: coincident_points,
    },
    Case {
        name: "outside-the-function",
        area: Area::TransferFunction,
        hazard: "gradient by voxels whose density lies beyond the last point",
        remedy: "value of the last point, gradient 0",
        naive_formula: "the last line, extended",
        figure: "largest component of the gradient, which is 0",
        bound: 0.0,
        naive: Naive::Fails(1e-2),
        measured: outside,
    },
    Case {
        name: "equal-densities",
        area: Area::TransferFunction,
        hazard: "pre-integration between equal densities, from the faintest to the most opaque",
        remedy: "value at the middle where densities are equal",
        naive_formula: "difference of cumulative sums over difference of densities: 0/0",
        figure: "largest error of color and alpha",
        bound: 4e-7,
        naive: Naive::Fails(f64::INFINITY),
        measured: equal_densities,
    },
    Case {
        name: "nearly-equal-densities",
        area: Area::TransferFunction,
        hazard: "value and gradient of pre-integration between densities that differ by 1e-7",
        remedy: "value at the middle and its derivative where densities are nearly equal",
        naive_formula: "difference of cumulative sums over difference of densities, in single precision",
        figure: "relative error of optical depth and gradient",
        bound: 2e-6,
        naive: Naive::Fails(1e-3),
        measured: nearly_equal_densities,
    },
    Case {
        name: "narrow-lobes",
        area: Area::TransferFunction,
        hazard: "derivatives of Gaussian lobes of deviation 0.1 to 1e-30",
        remedy: "logarithm of the deviation, at least half a cell of the table",
        naive_formula: "derivative by the deviation σ, which divides by σ³, in single precision",
        figure: "error of the derivatives, relative to the largest",
        bound: 1e-8,
        naive: Naive::Fails(f64::INFINITY),
        measured: narrow_lobes,
    },
];

fn medium(transfer: &Transfer, extinction: f64) -> Result<Medium> {
    Ok(Medium::new(extinction, Source::Transfer(Arc::new(transfer.table()?))))
}

fn spike(formula: Formula) -> Result<f64> {
    fn depth<R: Precision>(width: f64, rule: Quadrature) -> Result<f64> {
        let field: Bricks<R> = field(16, unit()?, |p| p.x / 15.0)?;
        let at = |density: f64, extinction: f64| [density, 1.0, 1.0, 1.0, extinction];
        let points = vec![at(0.5 - width, 0.0), at(0.5, 2.0 / width), at(0.5 + width, 0.0)];
        let medium = medium(&Transfer::Piecewise { points }, 0.1)?;
        Ok(Dvr::new(&field, medium)?.quadrature(rule).early_stop(0.0).optical_depth(&along_x()))
    }
    // The spike's area in density is 2; a unit of density is 15 units of length, and then one that the last voxel
    // fades over.
    const EXPECTED: f64 = 0.1 * 2.0 * (15.0 + 1.0);
    let rule = match formula {
        Formula::Cumulo => Quadrature::Exact,
        Formula::Naive => Quadrature::Midpoint(1.0),
    };
    [1e-1, 1e-3, 1e-6].into_iter().try_fold(0.0, |most, width| {
        // Points nearer to each other than single precision tells apart are for double precision.
        let found = if width < 1e-2 { depth::<f64>(width, rule)? } else { depth::<f32>(width, rule)? };
        Ok(worse(most, off(found, EXPECTED)))
    })
}

/// A step of the function, met where the density is a ramp: light has a closed form, and so have its derivatives by the
/// step's density and by all voxels at once.
fn step(formula: Formula) -> Result<f64> {
    const RISE: f64 = 1.0 / 32.0;
    const BACKGROUND: [f32; 3] = [0.5, 0.25, 0.125];
    let mut field: Bricks<f32> = field(24, unit()?, |p| RISE * p.x)?;
    field.domain = Aabb { min: DVec3::ZERO, max: DVec3::splat(23.0) };
    let (below, above) = ([1.0, 0.5, 0.0, 0.05], [0.0, 0.25, 1.0, 0.2]);
    let point = |[r, g, b, s]: [f64; 4]| [0.4, r, g, b, s];
    let table = Arc::new(Transfer::Piecewise { points: vec![point(below), point(above)] }.table()?);
    let medium = Medium::new(1.0, Source::Transfer(table.clone()));
    let rule = match formula {
        Formula::Cumulo => Quadrature::Exact,
        Formula::Naive => Quadrature::Midpoint(1.0),
    };
    let dvr = Dvr::new(&field, medium)?.quadrature(rule).early_stop(0.0).over(BACKGROUND);
    let ray = Ray::new(DVec3::new(-2.0, 7.3, 6.8), DVec3::X);
    let (met, length) = (0.4 / RISE, 23.0);
    let (near, far) = ((-below[3] * met).exp(), (-above[3] * (length - met)).exp());
    let mut most = 0.0;
    for c in 0..3 {
        let background = f64::from(BACKGROUND[c]);
        let behind = above[c] * (1.0 - far) + far * background;
        let light = below[c] * (1.0 - near) + near * behind;
        // By the length at which the step is met.
        let expected = near * below[3] * (below[c] - behind) - near * far * above[3] * (above[c] - background);
        let mut voxels = vec![0.0; field.values.len()];
        let (mut by, mut shared) = (TableGradient::zeros(&table), ParameterGradient::default());
        let sinks = Accumulators { voxels: Some(&mut voxels), table: Some(&mut by), ray: None, shared: &mut shared };
        let mut weight = [0.0; 4];
        weight[c] = 1.0;
        let seen = dvr.vjp(&ray, &mut |_| weight, Adjoint::Tape, sinks, &mut Tape::default());
        let by_step = RISE * by.by_knot(&table).iter().sum::<f64>();
        let by_voxels = RISE * voxels.iter().map(|v| v.f64()).sum::<f64>();
        let errors = [seen.rgb[c].f64() - light, by_step - expected, by_voxels + expected];
        most = errors.into_iter().map(f64::abs).fold(most, worse);
    }
    Ok(most)
}

fn coincident_points(formula: Formula) -> Result<f64> {
    let value = |v: f64| [v, 2.0 * v, 0.5, 1.0 + v];
    let (knots, values) = (vec![0.0, 0.25, 0.5, 0.5, 1.0], [0.0, 1.0, 0.5, 2.0, 0.0].map(value).to_vec());
    let table = Table::new(knots.clone(), values.clone())?;
    let expected = [(-1.0, 0.0), (0.1, 4.0), (0.3, -2.0), (0.5, -4.0), (0.7, -4.0), (2.0, 0.0)];
    let errors = expected.into_iter().map(|(density, slope)| match formula {
        Formula::Cumulo => (table.slope(density)[0] - slope).abs(),
        Formula::Naive => {
            // The first piece that reaches the density, found from below.
            let piece = knots.iter().position(|knot| *knot >= density).unwrap_or(knots.len() - 1).max(1);
            let piece = if knots.get(piece + 1) == Some(&density) { piece + 1 } else { piece };
            let found = (values[piece][0] - values[piece - 1][0]) / (knots[piece] - knots[piece - 1]);
            (found - slope).abs()
        }
    });
    Ok(errors.fold(0.0, worse))
}

fn outside(formula: Formula) -> Result<f64> {
    let points = vec![[0.2, 1.0, 0.5, 0.0, 0.1], [0.9, 0.0, 0.0, 1.0, 0.4]];
    let mut most = 0.0;
    for rule in [Quadrature::Exact, Quadrature::PREINTEGRATED, Quadrature::Midpoint(0.5)] {
        match formula {
            Formula::Cumulo => {
                let field: Bricks<f32> = slab(2.0)?;
                let medium = medium(&Transfer::Piecewise { points: points.clone() }, 0.1)?;
                let by = gradient(&field, &medium, rule)?;
                most = by.into_iter().map(f64::abs).fold(most, worse);
            }
            Formula::Naive => {
                // The derivative of the transmittance by the density of a slab, whose extinction goes on as a line.
                let slope = (0.4 - 0.1) / (0.9 - 0.2);
                let depth = 0.1 * SLAB * (0.4 + slope * (2.0 - 0.9));
                most = worse(most, 0.1 * SLAB * slope * (-depth).exp());
            }
        }
    }
    Ok(most)
}

/// Returns the gradient of rgb·(1, 2, 3) + alpha along a ray by the voxels.
fn gradient<R: Precision>(field: &Bricks<R>, medium: &Medium, rule: Quadrature) -> Result<Vec<f64>> {
    let dvr = Dvr::new(field, medium.clone())?.quadrature(rule).early_stop(0.0).over([0.3, 0.2, 0.1]);
    let (mut by, mut shared, mut tape) =
        (vec![R::ZERO; field.values.len()], ParameterGradient::default(), Tape::default());
    let weights = [R::ONE, R::of(2.0), R::of(3.0), R::ONE];
    let sinks = Accumulators { voxels: Some(&mut by), table: None, ray: None, shared: &mut shared };
    dvr.vjp(&along_x(), &mut |_| weights, Adjoint::Tape, sinks, &mut tape);
    Ok(by.into_iter().map(Real::f64).collect())
}

/// Constant densities have the closed form `L = c (1 - e^{-σ l}) + e^{-σ l} · background`.
fn equal_densities(formula: Formula) -> Result<f64> {
    const BACKGROUND: f64 = 0.25;
    let step = vec![
        [0.2, 1.0, 0.5, 0.0, 1.0],
        [0.5, 0.8, 0.4, 0.2, 2.0],
        [0.5, 0.1, 0.2, 0.3, 3.0],
        [0.9, 0.0, 0.0, 1.0, 4.0],
    ];
    let mut most = 0.0;
    for points in [step, vec![[0.4, 0.3, 0.6, 0.9, 1.5]]] {
        let table = Arc::new(Transfer::Piecewise { points }.table()?);
        for density in [0.0625, 0.25, 0.5, 0.75, 2.0, 1e30] {
            let (field, value): (Bricks<f32>, _) = (slab(density)?, table.at(density));
            for extinction in [1e-8, 1e-3, 0.1, 1e6] {
                let open = (-SLAB * extinction * value[3]).exp();
                let found = match formula {
                    Formula::Cumulo => {
                        let medium = Medium::new(extinction, Source::Transfer(table.clone()));
                        let dvr = Dvr::new(&field, medium)?.quadrature(Quadrature::PREINTEGRATED).early_stop(0.0);
                        dvr.over([BACKGROUND as f32; 3]).pixel(&along_x()).rgba().map(f64::from)
                    }
                    Formula::Naive => {
                        let sums = |density| table.integral(0.0, density).map(|v| extinction * SLAB * v);
                        let ([from, to], [front, back]) = ([density; 2], [sums(density), sums(density)]);
                        let [r, g, b, depth] = [0, 1, 2, 3].map(|c| (back[c] - front[c]) / (to - from));
                        let share = (1.0 - (-depth).exp()) / depth;
                        [r * share, g * share, b * share, 1.0 - (-depth).exp()]
                    }
                };
                let color = |c: usize| value[c] * (1.0 - open) + open * BACKGROUND;
                let expected = [color(0), color(1), color(2), 1.0 - open];
                most = (0..4).map(|c| (found[c] - expected[c]).abs()).fold(most, worse);
            }
        }
    }
    Ok(most)
}

fn nearly_equal_densities(formula: Formula) -> Result<f64> {
    let value = |p: DVec3| 0.3 + 1e-7 * noise(p.x as u64);
    let points = vec![[0.2, 1.0, 0.5, 0.0, 1.0], [0.5, 0.8, 0.4, 0.2, 2.0]];
    let transfer = Transfer::Piecewise { points };
    let (table, medium) = (transfer.table()?, medium(&transfer, 0.05)?);
    let wide: Bricks<f64> = field(16, unit()?, value)?;
    let depth = Dvr::new(&wide, medium.clone())?.early_stop(0.0).optical_depth(&along_x());
    if formula == Formula::Naive {
        let sum = |density: f32| table.integral(0.0, density.into())[3] as f32;
        let at = |x: u32| value(DVec3::new(x.into(), 0.0, 0.0)) as f32;
        let part = |x: u32| 0.05 * (sum(at(x + 1)) - sum(at(x))) / (at(x + 1) - at(x));
        let expected = |x: u32| 0.05 * table.at(f64::from(0.5 * (at(x) + at(x + 1))))[3];
        return Ok((0..15).map(|x| off(f64::from(part(x)), expected(x))).fold(0.0, worse));
    }
    let narrow: Bricks<f32> = field(16, unit()?, value)?;
    let dvr = Dvr::new(&narrow, medium.clone())?.quadrature(Quadrature::PREINTEGRATED).early_stop(0.0);
    // The fall-off at the faces is not of equal densities: the same rule on both sides.
    let wide_depth = Dvr::new(&wide, medium.clone())?.quadrature(Quadrature::PREINTEGRATED).early_stop(0.0);
    let value = off(dvr.optical_depth(&along_x()), wide_depth.optical_depth(&along_x()));
    let expected = gradient(&wide, &medium, Quadrature::PREINTEGRATED)?;
    let slopes = relative(&gradient(&narrow, &medium, Quadrature::PREINTEGRATED)?, &expected);
    // Both must be near to the integral, too.
    let inexact = off(wide_depth.optical_depth(&along_x()), depth) > 0.01;
    Ok(if inexact { f64::INFINITY } else { worse(value, slopes) })
}

fn narrow_lobes(formula: Formula) -> Result<f64> {
    let mut most = 0.0;
    for ln_width in [-2.3, -5.0, -7.5, -20.0, -60.0, -69.0] {
        let of = |mean: f64, ln_width: f64| Transfer::Gaussians {
            domain: [0.0, 1.0],
            lobes: vec![Lobe { mean, ln_width, rgbs: [1.0, 0.5, 0.2, 2.0] }],
        };
        let weight = |knot: usize| 0.5 + noise(knot as u64);
        let sum = |transfer: &Transfer| -> Result<f64> {
            let table = transfer.table()?;
            Ok(table.values().iter().enumerate().map(|(k, v)| weight(k) * v[3]).sum())
        };
        let transfer = of(0.4, ln_width);
        let difference = |mean: f64, width: f64| -> Result<f64> {
            let at = |h: f64| sum(&of(0.4 + h * mean, ln_width + h * width));
            // Of fourth order.
            let h = 2e-6;
            Ok((8.0 * (at(h)? - at(-h)?) - (at(2.0 * h)? - at(-2.0 * h)?)) / (12.0 * h))
        };
        let expected = [difference(1.0, 0.0)?, difference(0.0, 1.0)?];
        let found = match formula {
            Formula::Cumulo => {
                let table = transfer.table()?;
                let mut by = TableGradient::zeros(&table);
                for (knot, piece) in by.pieces.iter_mut().skip(1).enumerate() {
                    piece[0][3] = weight(knot);
                }
                let by = transfer.chain(&by)?;
                [by[0], by[1]]
            }
            Formula::Naive => {
                let (width, mean) = (ln_width.exp() as f32, 0.4_f32);
                let by = |knot: usize| {
                    let d = knot as f32 / 512.0 - mean;
                    let value = 2.0 * (-d * d / (2.0 * width * width)).exp() * weight(knot) as f32;
                    [value * d / (width * width), value * d * d / (width * width * width) * width]
                };
                let all = (0..=512).map(by).fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
                all.map(f64::from)
            }
        };
        most = worse(most, relative(&found, &expected));
    }
    Ok(most)
}
