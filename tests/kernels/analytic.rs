//! Closed forms: what the renderer must give without any reference picture.

use crate::common::fields::{self, field, grid, lumps, odd, rays, unit};
use cumulo::math::{Affine, Ray};
use cumulo::render::dvr::Dvr;
use cumulo::render::quadrature::Quadrature;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::medium::{Medium, Source};
use glam::DVec3;

/// Adaptive-free reference: Simpson on 1/64-voxel steps of the trilinear interpolant itself. On a
/// cubic Simpson is exact; only the steps that straddle a face of a cell err, by O(h²) of a kink.
fn simpson(f: &Bricks<f64>, ray: &Ray, value: impl Fn(f64) -> f64) -> f64 {
    let (a, b) = f.world_bounds().clip(ray).unwrap();
    let n = ((b - a) * 64.0 / f.transform.voxel_size().min_element()).ceil() as usize;
    let h = (b - a) / n as f64;
    let at = |t: f64| value(f.sample(f.transform.to_index(ray.at(t))));
    (0..n)
        .map(|i| {
            let t = a + i as f64 * h;
            h / 6.0 * (at(t) + 4.0 * at(t + 0.5 * h) + at(t + h))
        })
        .sum()
}

/// A slab of constant density with its linear falloff of one voxel outside: every ray along an axis
/// has optical depth σ · n exactly, whatever the direction of travel.
#[test]
fn slab_along_each_axis() {
    let f: Bricks<f32> = field(16, unit(), |_| 0.25);
    let dvr = Dvr::new(&f, Medium::absorbing(2.0)).unwrap().over([1.0; 3]);
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut direction = DVec3::ZERO;
            direction[axis] = sign;
            let ray = Ray::new(DVec3::splat(7.3) - 50.0 * direction, direction);
            let depth = dvr.medium.optical_depth(&ray);
            // 15 between the outermost centres, half a voxel of falloff at each end; f32 sums of at
            // most 17 terms within each of 3 bricks.
            assert!((depth - 2.0 * 0.25 * 16.0).abs() < 16.0 * 8.0 * f64::from(f32::EPSILON), "{axis} {sign} {depth}");
            let seen = dvr.pixel(&ray);
            assert!((f64::from(seen.transmittance) - (-8.0_f64).exp()).abs() < 1e-8);
            assert!((seen.rgb[1] - seen.transmittance).abs() < 1e-8, "white background through absorption");
        }
    }
}

/// The density is linear in space, so the optical depth between two points inside is the mean of the
/// two densities times the distance, for any affine map.
#[test]
fn linear_ramp_under_any_affine_map() {
    for transform in [unit(), odd(), Affine::uniform(1e-4, DVec3::splat(1e3)).unwrap()] {
        let ramp = |p: DVec3| 0.5 + 0.02 * p.x + 0.03 * p.y + 0.01 * p.z;
        let f: Bricks<f64> = field(24, transform, ramp);
        let dvr = Dvr::new(&f, Medium::absorbing(1.0)).unwrap().early_stop(0.0);
        let cut = |a: DVec3, b: DVec3| {
            // The ray goes on to the far side; take the part from b onwards off.
            let (wa, wb) = (transform.to_world(a), transform.to_world(b));
            let direction = (wb - wa).normalize();
            let of = |origin| dvr.optical_depth(&Ray::new(origin, direction));
            (of(wa) - of(wb), (wb - wa).length())
        };
        for (a, b) in [
            (DVec3::new(1.0, 2.0, 3.0), DVec3::new(20.5, 18.25, 9.0)),
            (DVec3::new(20.0, 3.0, 19.0), DVec3::new(2.5, 19.0, 2.0)),
            (DVec3::new(4.0, 4.0, 4.0), DVec3::new(4.0, 4.0, 16.0)),
        ] {
            let (depth, length) = cut(a, b);
            // The voxels are stored as f32 before they are widened: 2^-24 relative.
            let expected = 0.5 * (ramp(a) + ramp(b)) * length;
            assert!((depth - expected).abs() < 2e-7 * expected, "{depth} {expected}");
        }
    }
}

#[test]
fn exact_quadrature_is_the_integral_of_the_interpolant() {
    for transform in [unit(), odd()] {
        let f: Bricks<f64> = field(24, transform, lumps(24));
        let dvr = Dvr::new(&f, Medium::absorbing(1.0)).unwrap().early_stop(0.0);
        for ray in rays(f.world_bounds(), 40, 1) {
            let (depth, reference) = (dvr.optical_depth(&ray), simpson(&f, &ray, |d| d));
            // Kinks at about 100 faces, each costing at most h² Δslope / 6 with h = 1/64 voxel.
            assert!((depth - reference).abs() < 1e-4, "{depth} {reference}");
        }
    }
}

/// A Gaussian blob, fine against its width, against the closed form of its line integral.
#[test]
fn gaussian_blob_converges_to_its_line_integral() {
    let error = |n: i32| {
        let s = 0.1 * f64::from(n);
        let centre = DVec3::splat(0.5 * f64::from(n));
        let f: Bricks<f64> = field(n, unit(), |p| (-(p - centre).length_squared() / (2.0 * s * s)).exp());
        let dvr = Dvr::new(&f, Medium::absorbing(1.0 / s)).unwrap();
        let direction = DVec3::new(0.6, 0.48, 0.64);
        let off = DVec3::new(0.8, -0.36, -0.48) * 0.7 * s;
        let depth = dvr.optical_depth(&Ray::new(centre + off - 3.0 * f64::from(n) * direction, direction));
        (depth - (2.0 * std::f64::consts::PI).sqrt() * (-0.5 * 0.7_f64 * 0.7).exp()).abs()
    };
    let (coarse, fine) = (error(32), error(64));
    // Trilinear interpolation convolves with a triangle of variance 1/6 voxel: σ² grows by 1/(6 σ²)
    // relatively, the integral of a unit-height blob changes by no more than twice that. Second
    // order, too: halving the voxel quarters the error.
    let s = 6.4_f64;
    assert!(coarse / fine > 3.5 && fine < 2.5 * 2.0 / (6.0 * s * s), "{coarse} {fine}");
}

/// Order of the constant-step rules, from the error at two step sizes.
#[test]
fn quadratures_have_their_order() {
    let f: Bricks<f64> = field(24, odd(), lumps(24));
    let medium = Medium::new(1.5, Source::Linear([1.0, 0.5, 0.25]));
    let rays = rays(f.world_bounds(), 60, 5);
    let dvr = |q| Dvr::new(&f, medium.clone()).unwrap().quadrature(q).early_stop(0.0).over([0.2; 3]);
    let exact: Vec<f64> = rays.iter().map(|r| dvr(Quadrature::Exact).pixel(r).rgb[0]).collect();
    let error = |q| {
        let d = dvr(q);
        let e2: f64 = rays.iter().zip(&exact).map(|(r, e)| (d.pixel(r).rgb[0] - e).powi(2)).sum();
        (e2 / rays.len() as f64).sqrt()
    };
    let order = |q: fn(f64) -> Quadrature| (error(q(0.2)) / error(q(0.05))).log2() / 2.0;
    let (midpoint, riemann) = (order(Quadrature::Midpoint), order(Quadrature::Riemann));
    // The field vanishes at both ends of the ray, where a left sum is as good as a trapezium; the
    // cut last step and the source's curvature leave it between first and second order.
    assert!(midpoint > 1.8, "{midpoint}");
    assert!(riemann > 0.9, "{riemann}");
    assert!(error(Quadrature::Midpoint(0.05)) < 1e-4);
}

/// A linear source against a brute-force double integral.
#[test]
fn linear_source_is_integrated_with_its_absorption() {
    let f: Bricks<f64> = field(16, unit(), lumps(16));
    for extinction in [0.01, 1.0, 50.0] {
        let medium = Medium::new(extinction, Source::Linear([1.0, 2.0, 0.0]));
        let dvr = Dvr::new(&f, medium.clone()).unwrap().early_stop(0.0).over([0.0; 3]);
        for ray in rays(f.world_bounds(), 10, 9) {
            let (a, b) = f.world_bounds().clip(&ray).unwrap();
            let n = 200_000;
            let h = (b - a) / f64::from(n);
            let (mut depth, mut emitted) = (0.0_f64, 0.0);
            for i in 0..n {
                let d = f.sample(ray.at(a + (f64::from(i) + 0.5) * h));
                emitted += (-depth).exp() * -(-extinction * d * h).exp_m1() * d;
                depth += extinction * d * h;
            }
            let seen = dvr.pixel(&ray);
            // 1e-7 a piece where it matters, some 30 pieces, and the brute force's own h².
            assert!((seen.rgb[0] - emitted).abs() < 3e-6 * emitted.max(1.0), "{extinction} {} {emitted}", seen.rgb[0]);
            assert!((seen.rgb[1] - 2.0 * seen.rgb[0]).abs() < 1e-12);
        }
    }
}

/// A grey source: `c (1 - T) + T b`, with the transmittance of the integral. Where source and background are alike, the
/// volume is invisible; that holds for any transmittance, so other backgrounds are seen through it as well.
#[test]
fn furnace() {
    let f: Bricks<f64> = field(16, odd(), lumps(16));
    let medium = Medium::new(3.0, Source::Grey([0.7; 3]));
    let dvr = |background| Dvr::new(&f, medium.clone()).unwrap().early_stop(0.0).over(background);
    let behind = [0.7_f32, 0.1, 0.95];
    let (mut least, mut most) = (1.0_f64, 0.0_f64);
    for ray in rays(f.world_bounds(), 50, 3) {
        assert!((dvr([0.7; 3]).pixel(&ray).rgb[2] - f64::from(0.7_f32)).abs() < 1e-12);
        let transmittance = (-3.0 * simpson(&f, &ray, |d| d)).exp();
        (least, most) = (least.min(transmittance), most.max(transmittance));
        let seen = dvr(behind).pixel(&ray);
        // Depths are off by less than 1e-4, as above, times the extinction; T changes by T times that.
        let tolerance = 3.0 * 1e-4 * transmittance;
        assert!((seen.transmittance - transmittance).abs() < tolerance, "{} {transmittance}", seen.transmittance);
        for c in 0..3 {
            let (source, background) = (f64::from(0.7_f32), f64::from(behind[c]));
            let expected = source * (1.0 - transmittance) + transmittance * background;
            // Where they are alike nothing is left but rounding.
            let tolerance = tolerance * (source - background).abs() + 1e-12;
            assert!((seen.rgb[c] - expected).abs() < tolerance, "channel {c}: {} {expected}", seen.rgb[c]);
        }
    }
    assert!(least < 0.2 && most > 0.8, "rays through thick and thin: {least} to {most}");
}

#[test]
fn f32_follows_f64() {
    let g = grid(40, odd(), lumps(40));
    let (narrow, wide) =
        (Bricks::<f32>::from_grid(&g, 1 << 30).unwrap(), Bricks::<f64>::from_grid(&g, 1 << 30).unwrap());
    let (a, b) = (
        Dvr::new(&narrow, Medium::absorbing(4.0)).unwrap().early_stop(0.0),
        Dvr::new(&wide, Medium::absorbing(4.0)).unwrap().early_stop(0.0),
    );
    for ray in rays(wide.world_bounds(), 500, 11) {
        let (a, b) = (a.optical_depth(&ray), b.optical_depth(&ray));
        // Within a brick positions round to 8 · 2^-24 voxels and up to 24 terms are added.
        assert!((a - b).abs() <= 4e-6 * b.max(0.1), "{a} {b}");
    }
}

/// Slopes are the difference quotients of the interpolated density, which is linear along each axis of a cell.
#[test]
fn slopes_are_difference_quotients() {
    let f: Bricks<f64> = field(12, odd(), lumps(12));
    for k in 0..500_u64 {
        let at = DVec3::new(fields::noise(3 * k), fields::noise(3 * k + 1), fields::noise(3 * k + 2)) * 11.0;
        let cell = at.floor();
        // Within the cell, the whole edge is as good as a short step.
        let quotient = |axis: usize| {
            let (mut low, mut high) = (at, at);
            (low[axis], high[axis]) = (cell[axis], cell[axis] + 1.0 - 1e-9);
            (f.sample(high) - f.sample(low)) / (1.0 - 1e-9)
        };
        let expected = DVec3::new(quotient(0), quotient(1), quotient(2));
        assert!((f.slopes(at) - expected).length() < 1e-6, "{at}: {} {expected}", f.slopes(at));
    }
    assert_eq!(f.slopes(DVec3::splat(500.0)), DVec3::ZERO);
}
