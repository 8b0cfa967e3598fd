//! Light along straight rays: opacities near 0 and 1, depths from 1 to 10⁴, detail thinner than a step.

use super::fixtures::{SLAB, along_x, field, lumps, rays, slab, slanted, unit};
use super::{Area, Case, Formula, Naive, off, relative, worse};
use crate::error::Result;
use crate::math::Ray;
use crate::real::{Lanes, Real};
use crate::render::differentiable::{Accumulators, Adjoint, Differentiable, ParameterGradient};
use crate::render::dvr::{Dvr, Precision, Tape};
use crate::render::emission_absorption::Radiance;
use crate::render::preshaded::Preshaded;
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::Bricks;
use crate::scene::medium::{Medium, Source};
use crate::scene::transfer::Transfer;
use glam::DVec3;
use std::sync::Arc;

pub(super) const CASES: &[Case] = &[
    Case {
        name: "thin-samples",
        area: Area::Dvr,
        hazard: "gradient by voxels of samples of optical depth 1e-8 to 1",
        remedy: "backward recursion of the radiance behind each sample",
        naive_formula: "inversion of the blend",
        figure: "error of the gradient, relative to its largest component",
        bound: 1.5e-6,
        naive: Naive::Holds("opacities that differ from 1 by more than their rounding can be divided by"),
        measured: |formula| opacities(formula, -8..=0),
    },
    Case {
        name: "dense-samples",
        area: Area::Dvr,
        hazard: "gradient by voxels of samples of optical depth 10 to 1000, whose opacity rounds to 1",
        remedy: "backward recursion of the radiance behind each sample",
        naive_formula: "inversion of the blend, which divides by 1 - opacity",
        figure: "error of the gradient, relative to its largest component",
        bound: 1e-6,
        naive: Naive::Fails(1e-2),
        measured: |formula| opacities(formula, 1..=3),
    },
    Case {
        name: "opaque-samples",
        area: Area::Dvr,
        hazard: "gradient by voxels of samples of optical depth 1e4 to 1e6",
        remedy: "backward recursion of the radiance behind each sample",
        naive_formula: "inversion of the blend, which is 0/0",
        figure: "error of the gradient, relative to its largest component; the naive formula's least",
        bound: 5e-7,
        naive: Naive::Fails(1e-2),
        measured: |formula| opacities(formula, 4..=6),
    },
    Case {
        name: "faint-emission",
        area: Area::Dvr,
        hazard: "radiance of a slab of optical depth 1e-8 to 100, whose opacity cancels",
        remedy: "-expm1(-x)",
        naive_formula: "1 - exp(-x) in single precision",
        figure: "relative error of the radiance",
        bound: 4e-7,
        naive: Naive::Fails(0.1),
        measured: faint_emission,
    },
    Case {
        name: "deep-rays",
        area: Area::Dvr,
        hazard: "gradient at optical depth 1 to 1e4 in 16 to 200 steps",
        remedy: "logarithm of the transmittance in double precision, replayed",
        naive_formula: "inversion of the blend",
        figure: "error of the gradient, relative to its largest component",
        bound: 2e-6,
        naive: Naive::Fails(1e-2),
        measured: |formula| deep_gradients(formula, &[1.0, 0.1]),
    },
    Case {
        name: "long-rays",
        area: Area::Dvr,
        hazard: "gradient at optical depth 1 to 1e4 in 10 000 steps, which add up in few voxels",
        remedy: "logarithm of the transmittance in double precision, replayed",
        naive_formula: "inversion of the blend",
        figure: "error of the gradient, relative to its largest component",
        bound: 1e-6,
        naive: Naive::Fails(1e-2),
        measured: |formula| deep_gradients(formula, &[0.002]),
    },
    Case {
        name: "drifting-inversion",
        area: Area::Dvr,
        hazard: "gradient at optical depth 15, where no sample is opaque and the ray nearly is",
        remedy: "backward recursion of the radiance behind each sample",
        naive_formula: "inversion of the blend, which drifts",
        figure: "error of the gradient, relative to its largest component",
        bound: 4e-7,
        naive: Naive::Fails(5e-4),
        measured: drifting_inversion,
    },
    Case {
        name: "transmittance-product",
        area: Area::Dvr,
        hazard: "transmittance at optical depth 1 to 1e4 in 10 to 10 000 steps, which underflows",
        remedy: "sum of optical depths in double precision",
        naive_formula: "product of 1 - opacity in single precision",
        figure: "relative error of the optical depth",
        bound: 1e-6,
        naive: Naive::Fails(1.0),
        measured: transmittance_product,
    },
    Case {
        name: "opaque-pre-shaded",
        area: Area::Dvr,
        hazard: "gradient by colors and extinctions of a pre-shaded volume of optical depth 1 to 1e5",
        remedy: "backward sum over the points behind each segment",
        naive_formula: "inversion of the transmittance",
        figure: "error of the gradient, relative to its largest component",
        bound: 2e-6,
        naive: Naive::Fails(1e-2),
        measured: opaque_pre_shaded,
    },
    Case {
        name: "derivative-by-differences",
        area: Area::Dvr,
        hazard: "derivative of the alpha of a pixel by the density scale, for scales from 1e-4 to 1",
        remedy: "adjoint",
        naive_formula: "difference quotient of pixels in single precision, steps of 1e-3 of the scale",
        figure: "relative error of the derivative",
        bound: 4e-7,
        naive: Naive::Fails(1e-3),
        measured: by_differences,
    },
    Case {
        name: "thin-shell",
        area: Area::Dvr,
        hazard: "a dense shell of one voxel, missed between samples",
        remedy: "exact integral of every cell",
        naive_formula: "samples four voxels apart",
        figure: "largest error of the optical depth on 200 rays",
        bound: 1e-4,
        naive: Naive::Fails(0.5),
        measured: thin_shell,
    },
    Case {
        name: "early-stop",
        area: Area::Dvr,
        hazard: "light behind the place where a ray ends early",
        remedy: "transmittance times the brightest of medium and background as the bound",
        naive_formula: "the transmittance alone as the bound",
        figure: "largest error of a pixel, divided by its bound",
        bound: 1.0,
        naive: Naive::Fails(1.1),
        measured: early_stop,
    },
];

const EMISSION: Source = Source::Linear([0.5, 1.0, 0.25]);

/// Returns the gradient of rgb·(1, 2, 3) + alpha along one ray by the voxels.
fn gradient<R: Precision>(
    field: &Bricks<R>,
    medium: &Medium,
    rule: Quadrature,
    adjoint: Adjoint,
    ray: &Ray,
) -> Result<Vec<f64>> {
    let dvr = Dvr::new(field, medium.clone())?.quadrature(rule).early_stop(0.0).over([0.3, 0.2, 0.1]);
    let (mut by, mut shared, mut tape) =
        (vec![R::ZERO; field.values.len()], ParameterGradient::default(), Tape::default());
    let weights = [R::ONE, R::of(2.0), R::of(3.0), R::ONE];
    let sinks = Accumulators { voxels: Some(&mut by), table: None, ray: None, shared: &mut shared };
    dvr.vjp(ray, &mut |_| weights, adjoint, sinks, &mut tape);
    Ok(by.into_iter().map(Real::f64).collect())
}

/// The error of gradients in single precision, for samples of optical depth `10^exponent`.
fn opacities(formula: Formula, exponents: std::ops::RangeInclusive<i32>) -> Result<f64> {
    let (narrow, wide): (Bricks<f32>, Bricks<f64>) = (field(16, unit()?, lumps(16))?, field(16, unit()?, lumps(16))?);
    let adjoint = match formula {
        Formula::Cumulo => Adjoint::Tape,
        Formula::Naive => Adjoint::Inversion,
    };
    let (rule, ray) = (Quadrature::Midpoint(1.0), slanted());
    let errors = exponents.clone().map(|exponent| {
        let medium = Medium::new(10_f64.powi(exponent), EMISSION);
        let expected = gradient(&wide, &medium, rule, Adjoint::Tape, &ray)?;
        Ok(relative(&gradient(&narrow, &medium, rule, adjoint, &ray)?, &expected))
    });
    let errors: Vec<f64> = errors.collect::<Result<_>>()?;
    // Of opaque samples the inversion fails on each: the least error tells it.
    let each = formula == Formula::Naive && *exponents.start() > 3;
    Ok(if each { errors.into_iter().fold(f64::INFINITY, f64::min) } else { errors.into_iter().fold(0.0, worse) })
}

fn faint_emission(formula: Formula) -> Result<f64> {
    let field: Bricks<f32> = slab(1.0)?;
    (-8..=2).try_fold(0.0, |most, exponent| {
        let depth = 10_f64.powi(exponent);
        let extinction = depth / SLAB;
        let found = match formula {
            Formula::Cumulo => {
                let dvr = Dvr::new(&field, Medium::new(extinction, Source::Linear([1.0; 3])))?.early_stop(0.0);
                dvr.radiance(&along_x()).rgb[0]
            }
            Formula::Naive => {
                let alpha = 1.0 - (-extinction as f32).exp();
                let blend = |(light, open): (f32, f32)| (light + open * alpha, open * (1.0 - alpha));
                f64::from((0..SLAB as u32).fold((0.0, 1.0), |state, _| blend(state)).0)
            }
        };
        Ok(worse(most, off(found, -(-depth).exp_m1())))
    })
}

fn deep_gradients(formula: Formula, steps: &[f64]) -> Result<f64> {
    let (narrow, wide): (Bricks<f32>, Bricks<f64>) = (field(16, unit()?, lumps(16))?, field(16, unit()?, lumps(16))?);
    let adjoint = match formula {
        Formula::Cumulo => Adjoint::Replay,
        Formula::Naive => Adjoint::Inversion,
    };
    let mut most = 0.0;
    for depth in [1.0, 10.0, 200.0, 1e4] {
        let medium = Medium::new(depth / 6.0, EMISSION);
        for rule in steps.iter().map(|step| Quadrature::Midpoint(*step)) {
            let expected = gradient(&wide, &medium, rule, Adjoint::Replay, &slanted())?;
            most = worse(most, relative(&gradient(&narrow, &medium, rule, adjoint, &slanted())?, &expected));
        }
    }
    Ok(most)
}

fn drifting_inversion(formula: Formula) -> Result<f64> {
    let (narrow, wide): (Bricks<f32>, Bricks<f64>) = (field(16, unit()?, |_| 1.0)?, field(16, unit()?, |_| 1.0)?);
    let ray = Ray::new(DVec3::new(-9.0, 7.5, 7.5), DVec3::X);
    let (medium, rule) = (Medium::new(15.0 / 16.0, EMISSION), Quadrature::Midpoint(0.05));
    let adjoint = match formula {
        Formula::Cumulo => Adjoint::Tape,
        Formula::Naive => Adjoint::Inversion,
    };
    let expected = gradient(&wide, &medium, rule, Adjoint::Tape, &ray)?;
    Ok(relative(&gradient(&narrow, &medium, rule, adjoint, &ray)?, &expected))
}

fn transmittance_product(formula: Formula) -> Result<f64> {
    let field: Bricks<f32> = slab(1.0)?;
    let function = Arc::new(Transfer::Identity { domain: [0.0, 2.0], color: [1.0, 0.5, 0.2] }.table()?);
    let mut most = 0.0;
    for depth in [1.0, 10.0, 200.0, 1e4] {
        for steps in [10, 100, 1000, 10_000] {
            if formula == Formula::Naive {
                let alpha = 1.0 - (-(depth as f32) / steps as f32).exp();
                let open = (0..steps).fold(1.0_f32, |open, _| open * (1.0 - alpha));
                most = worse(most, off(-f64::from(open).ln(), depth));
                continue;
            }
            let rule = Quadrature::Midpoint(SLAB / f64::from(steps));
            for source in [Source::Grey([0.0; 3]), EMISSION, Source::Transfer(function.clone())] {
                let medium = Medium::new(depth / SLAB, source);
                let dvr = Dvr::new(&field, medium)?.quadrature(rule).early_stop(0.0);
                most = worse(most, off(dvr.optical_depth(&along_x()), depth));
            }
        }
    }
    Ok(most)
}

/// Returns the gradient of red + 2 green + 3 blue + transmittance along one ray by a pre-shaded volume.
fn shaded_gradient<R: Real>(thick: f64, adjoint: Adjoint) -> Result<Vec<f64>>
where
    for<'f> Preshaded<'f, R>: Differentiable<Voxel = R::Lanes, Real = R>,
{
    let density: Bricks<R> = field(16, unit()?, lumps(16))?;
    let mut volume = Bricks::<R::Lanes>::zeros(density.topology.clone(), density.transform);
    for (voxel, density) in volume.values.iter_mut().zip(&density.values) {
        let density = density.f64();
        *voxel = R::Lanes::load([thick, 0.5 * thick, 0.2 * thick, thick].map(|v| R::of(v * density)));
    }
    let renderer = Preshaded::<R>::new(&volume).early_stop(0.0).over([0.3, 0.2, 0.1]);
    let zero = R::Lanes::splat(R::ZERO);
    let (mut by, mut shared) = (vec![zero; volume.values.len()], ParameterGradient::default());
    let weights = [R::ONE, R::of(2.0), R::of(3.0), R::ONE];
    let sinks = Accumulators { voxels: Some(&mut by), table: None, ray: None, shared: &mut shared };
    renderer.vjp(&slanted(), &mut |_| weights, adjoint, sinks, &mut Default::default());
    Ok(by.into_iter().flat_map(|lanes| lanes.store().map(Real::f64)).collect())
}

fn opaque_pre_shaded(formula: Formula) -> Result<f64> {
    let adjoint = match formula {
        Formula::Cumulo => Adjoint::Tape,
        Formula::Naive => Adjoint::Inversion,
    };
    [0.2, 2.0, 30.0, 2e4].into_iter().try_fold(0.0, |most, thick| {
        let expected = shaded_gradient::<f64>(thick, Adjoint::Tape)?;
        Ok(worse(most, relative(&shaded_gradient::<f32>(thick, adjoint)?, &expected)))
    })
}

fn by_differences(formula: Formula) -> Result<f64> {
    let (narrow, wide): (Bricks<f32>, Bricks<f64>) = (field(16, unit()?, lumps(16))?, field(16, unit()?, lumps(16))?);
    let by_extinction = |light: &Radiance| -light.depth * light.transmittance();
    [1e-4, 1e-2, 1.0].into_iter().try_fold(0.0, |most, scale| {
        let medium = |by: f64| Medium::absorbing(scale * by);
        let expected = Dvr::new(&wide, medium(1.0))?.early_stop(0.0).radiance(&slanted());
        let expected = -by_extinction(&expected) / scale;
        let found = match formula {
            Formula::Cumulo => {
                let dvr = Dvr::new(&narrow, medium(1.0))?.early_stop(0.0).over([0.0; 3]);
                let (mut shared, mut tape) = (ParameterGradient::default(), Tape::default());
                let sinks = Accumulators { voxels: None, table: None, ray: None, shared: &mut shared };
                dvr.vjp(&slanted(), &mut |_| [0.0, 0.0, 0.0, 1.0], Adjoint::Tape, sinks, &mut tape);
                shared.extinction
            }
            Formula::Naive => {
                let alpha = |by: f64| -> Result<f32> {
                    Ok(Dvr::new(&narrow, medium(by))?.early_stop(0.0).over([0.0; 3]).pixel(&slanted()).rgba()[3])
                };
                f64::from((alpha(1.001)? - alpha(0.999)?) / (2e-3 * scale) as f32)
            }
        };
        Ok(worse(most, off(found, expected)))
    })
}

fn thin_shell(formula: Formula) -> Result<f64> {
    let field: Bricks<f64> = field(25, unit()?, |p| f64::from((p - DVec3::splat(12.0)).length().round() == 9.0))?;
    let with = |rule| Ok(Dvr::new(&field, Medium::absorbing(1.0))?.quadrature(rule).early_stop(0.0));
    let reference = with(Quadrature::Midpoint(0.01))?;
    let dvr = with(match formula {
        Formula::Cumulo => Quadrature::Exact,
        Formula::Naive => Quadrature::Midpoint(4.0),
    })?;
    let rays = rays(field.world_bounds(), 200, 21);
    let errors = rays.iter().map(|ray| (dvr.optical_depth(ray) - reference.optical_depth(ray)).abs());
    Ok(errors.fold(0.0, worse))
}

/// The error must not only stay below the bound, but also come near enough for the bound to be of use.
fn early_stop(formula: Formula) -> Result<f64> {
    const LEAST: f64 = 0.2;
    let field: Bricks<f64> = field(160, unit()?, |p| 0.3 + 0.2 * (0.2 * p.x).sin() * (0.15 * p.y + 0.1 * p.z).cos())?;
    let points = vec![[0.1, 3.0, 0.5, 0.1, 0.0], [0.3, 0.2, 5.0, 0.1, 0.2], [0.5, 0.1, 0.2, 0.9, 0.4]];
    let function = Arc::new(Transfer::Piecewise { points }.table()?);
    let rays = rays(field.world_bounds(), 60, 5);
    let mut most = 0.0;
    for source in [Source::Grey([4.0, 0.5, 0.0]), Source::Linear([9.0, 1.0, 0.0]), Source::Transfer(function)] {
        let medium = Medium::new(0.1, source);
        for rule in [Quadrature::Exact, Quadrature::PREINTEGRATED, Quadrature::Midpoint(0.5)] {
            let whole = Dvr::new(&field, medium.clone())?.quadrature(rule).early_stop(0.0).over([0.5, 2.0, 0.1]);
            let ended = whole.clone().with(|dvr| dvr.early_stop(LEAST));
            let errors = rays.iter().flat_map(|ray| {
                let [a, b] = [&whole, &ended].map(|dvr| dvr.pixel(ray).rgba());
                (0..4).map(move |c| (a[c] - b[c]).abs())
            });
            let (error, bound) = (errors.fold(0.0, worse), ended.left_out());
            if whole.left_out() != 0.0 || error <= 1e-3 * bound {
                return Ok(f64::INFINITY);
            }
            most = worse(most, if formula == Formula::Cumulo { error / bound } else { error / LEAST });
        }
    }
    Ok(most)
}
