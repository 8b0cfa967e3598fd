//! Reconstruction: parameters that must not be negative, pictures that show nothing, cameras above a pole.

use super::fixtures::{field, lumps, unit};
use super::{Area, Case, Formula, Naive, off, worse};
use crate::cancel::Cancel;
use crate::differentiate::gradient::camera_jacobian::Rows;
use crate::error::Result;
use crate::inverse::solver::adam::Adam;
use crate::inverse::solver::ascent::{Ascent, Evaluation};
use crate::inverse::solver::softplus;
use crate::inverse::viewpoint::entropy;
use crate::render::dvr::Dvr;
use crate::scene::blur::Blur;
use crate::scene::bricks::Bricks;
use crate::scene::camera::{Camera, Projection};
use crate::scene::medium::Medium;
use crate::scene::sphere::upright;
use crate::scene::up::Up;
use glam::{DMat3, DVec2, DVec3};

pub(super) const CASES: &[Case] = &[
    Case {
        name: "softplus",
        area: Area::Reconstruction,
        hazard: "extinction ln(1 + e^u) and its inverse, for u from -80 to 1000",
        remedy: "max(u, 0) + log1p(exp(-|u|)); y + ln(-expm1(-y))",
        naive_formula: "ln(1 + e^u) and ln(e^y - 1) in single precision",
        figure: "relative error of value and inverse",
        bound: 1e-14,
        naive: Naive::Fails(1.0),
        measured: softplus_values,
    },
    Case {
        name: "negative-extinction",
        area: Area::Reconstruction,
        hazard: "descent to an extinction of 0, beyond which a medium would amplify light",
        remedy: "steps of Adam projected onto x ≥ 0",
        naive_formula: "steps of Adam, wherever they lead",
        figure: "transmittance above 1 at the end",
        bound: 0.0,
        naive: Naive::Fails(0.1),
        measured: negative_extinction,
    },
    Case {
        name: "blank-picture",
        area: Area::Reconstruction,
        hazard: "entropy, and its gradient by the viewpoint, of pictures with empty pixels and of an empty picture",
        remedy: "ln S - Σ α ln α / S; 0 and blank below an opacity of 1e-12 a pixel",
        naive_formula: "-Σ p ln p with p = α / Σ α",
        figure: "error of the entropy",
        bound: 1e-8,
        naive: Naive::Fails(f64::INFINITY),
        measured: blank_picture,
    },
    Case {
        name: "camera-at-a-pole",
        area: Area::Reconstruction,
        hazard: "ascent from the pole to the best viewpoint, which lies to the side",
        remedy: "unit vector, steps in its tangent plane, exponential map",
        naive_formula: "longitude and latitude, whose gradient vanishes at the pole",
        figure: "angle to the best viewpoint in radians",
        bound: 2e-8,
        naive: Naive::Fails(1.0),
        measured: camera_at_a_pole,
    },
];

fn softplus_values(formula: Formula) -> Result<f64> {
    let mut most = 0.0;
    for u in [-80.0, -30.0, -17.0, -3.0, 0.0, 1.0, 20.0, 100.0, 1000.0] {
        // By the series where the exponential is small, by the definition else.
        let e = (-f64::abs(u)).exp();
        let tail = if e < 1e-6 { e - 0.5 * e * e } else { (1.0 + e).ln() };
        let expected = u.max(0.0) + tail;
        let share = if u < 0.0 { e / (1.0 + e) } else { 1.0 / (1.0 + e) };
        let [value, slope, inverse] = match formula {
            Formula::Cumulo => {
                let [value, slope] = softplus::value(u);
                [value, slope, softplus::inverse(value)]
            }
            Formula::Naive => {
                let value = (1.0 + (u as f32).exp()).ln();
                let slope = (u as f32).exp() / (1.0 + (u as f32).exp());
                [value, slope, (value.exp() - 1.0).ln()].map(f64::from)
            }
        };
        most = [off(value, expected), off(slope, share), (inverse - u).abs() / u.abs().max(1.0)]
            .into_iter()
            .fold(most, worse);
    }
    Ok(most)
}

/// Of `(x + 1)²` and `(x - 0.5)²`, only the second has its minimum where it is allowed.
fn negative_extinction(formula: Formula) -> Result<f64> {
    let (mut x, mask, mut adam) = ([1.0_f32; 2], [1.0; 2], Adam::new(2, 0.02));
    for _ in 0..2000 {
        let gradient = [2.0 * (x[0] + 1.0), 2.0 * (x[1] - 0.5)];
        match formula {
            Formula::Cumulo => adam.step(&mut x, &gradient, &mask),
            Formula::Naive => adam.step_free(&mut x, &gradient),
        }
    }
    let reached = (x[1] - 0.5).abs() < 1e-3;
    Ok(if reached { (f64::from(-x[0]).exp() - 1.0).max(0.0) } else { f64::INFINITY })
}

fn blank_picture(formula: Formula) -> Result<f64> {
    let mut most = 0.0;
    let camera = Camera {
        camera_to_world: Camera::look_at(DVec3::new(40.0, 8.0, 30.0), DVec3::splat(8.0), DVec3::Z),
        projection: Projection::Perspective,
        focal: DVec2::splat(20.0),
        centre: DVec2::splat(12.0),
        width: 24,
        height: 24,
        near: 0.0,
        blur: Blur::default(),
    };
    // From nothing to opaque; all pictures have pixels that nothing is seen in.
    let lumps = lumps(16);
    for (share, extinction) in [(0.0, 1.0), (1.0, 1e-30), (1.0, 1e-6), (1.0, 1.0), (1.0, 1e4)] {
        let field: Bricks<f32> = field(16, unit()?, |p| share * lumps(p))?;
        let renderer = Dvr::new(&field, Medium::absorbing(extinction))?.over([0.0; 3]);
        let rows =
            Rows { renderer: &renderer, reference: None, camera: &camera, rays_per_edge: 1, cancel: &Cancel::NEVER };
        let alphas = rows.fold(|_| true, &[], |all: &mut Vec<f64>, _, rendered, _| all.push(rendered[3])).concat();
        let (sum, count): (f64, _) = (alphas.iter().sum(), alphas.len() as f64);
        let blank = sum < 1e-12 * count;
        let term = |alpha: &f64| if *alpha > 0.0 { alpha / sum * (alpha / sum).ln() } else { 0.0 };
        let expected = if blank { 0.0 } else { -alphas.iter().map(term).sum::<f64>() / count.ln() };
        let found = match formula {
            Formula::Cumulo => {
                let found = entropy::gradient(&rows, DVec3::splat(8.0));
                let still = !blank || found.by_turn == DVec3::ZERO;
                let sound = found.blank == blank && found.by_turn.is_finite() && still;
                if sound { [entropy::value(&rows).value, found.value] } else { [f64::NAN; 2] }
            }
            Formula::Naive => [-alphas.iter().map(|a| a / sum * (a / sum).ln()).sum::<f64>() / count.ln(); 2],
        };
        most = found.into_iter().map(|found| (found - expected).abs()).fold(most, worse);
    }
    Ok(most)
}

fn camera_at_a_pole(formula: Formula) -> Result<f64> {
    // The height of a plane over the sphere: its top is the plane's normal, a quarter turn from the pole's meridian.
    let top = DVec3::new(0.0, 1.0, 0.2).normalize();
    let reached = match formula {
        Formula::Cumulo => {
            let evaluate = |axes: &DMat3| {
                let by_turn = axes.z_axis.cross(top);
                let gradient = DVec2::new(by_turn.dot(axes.x_axis), by_turn.dot(axes.y_axis));
                Some(Evaluation { value: axes.z_axis.dot(top), gradient })
            };
            let mut ascent = Ascent::new(upright(DVec3::Z, Up::Z));
            ascent.climb([1e-9, 0.0], 60, evaluate);
            ascent.axes.z_axis
        }
        Formula::Naive => {
            let at = |longitude: f64, latitude: f64| {
                let ((y, x), (z, across)) = (longitude.sin_cos(), latitude.sin_cos());
                DVec3::new(across * x, across * y, z)
            };
            let (mut longitude, mut latitude) = (0.0_f64, std::f64::consts::FRAC_PI_2);
            for _ in 0..60 {
                let by_longitude = latitude.cos() * DVec3::new(-longitude.sin(), longitude.cos(), 0.0).dot(top);
                let by_latitude = at(longitude, latitude + std::f64::consts::FRAC_PI_2).dot(top);
                longitude += 0.2 * by_longitude;
                latitude += 0.2 * by_latitude;
            }
            at(longitude, latitude)
        }
    };
    Ok(reached.cross(top).length().atan2(reached.dot(top)))
}
