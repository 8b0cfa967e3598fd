//! What photographs show beside the region of a reconstruction.

use super::Warning;
use crate::inverse::observation::Observation;
use crate::inverse::observation::depth_map::{DepthMap, Limit};
use crate::math::Aabb;

/// Share of the medium's opacities, over all pixels, from which on a warning is due.
const MUCH: f64 = 0.02;

/// Returns a warning if photographs show much of the medium in pixels that count as empty, or beside the world box of
/// the unknowns: matter as faint as noise, or a background that is not even.
pub(crate) fn left_out(observation: &Observation, bounds: &Aabb) -> Option<Warning> {
    let photographs = observation.maps.iter().filter(|map| map.limit == Limit::Light);
    let [outside, pixels, total] =
        photographs.map(|map| opacities(map, bounds)).fold([0.0; 3], |a, b| std::array::from_fn(|i| a[i] + b[i]));
    let (share, mean) = (outside / total, outside / pixels);
    (total > 0.0 && share > MUCH).then(|| {
        Warning::new(
            format!(
                "{:.1} % of what the photographs show of the medium lies outside of the region, where they count as \
                 empty: {:.3} % of the contrast in each such pixel on average",
                100.0 * share,
                100.0 * mean
            ),
            "parts of the medium as faint as the noise are left out: pictures with less noise, as means of several of \
             the same moment, show them. A background that is not even looks the same: subtract a picture without the \
             medium",
        )
    })
}

/// Returns the sum of the opacities outside of the region, the number of their pixels, and the sum over all pixels.
fn opacities(map: &DepthMap, bounds: &Aabb) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for (i, transmittance) in map.transmittance.iter().enumerate().filter(|(_, t)| t.is_finite()) {
        let opacity = 1.0 - f64::from(*transmittance);
        let ray = || map.camera.ray((i % map.width) as f64 + 0.5, (i / map.width) as f64 + 0.5);
        if !map.shown[i] || bounds.clip(&ray()).is_none() {
            sums[0] += opacity;
            sums[1] += 1.0;
        }
        sums[2] += opacity;
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::blur::Blur;
    use crate::scene::camera::{Camera, Projection};
    use glam::{DMat4, DVec2, DVec3};

    const SIDE: usize = 16;

    fn photograph(opacity: impl Fn(usize) -> f32, shown: impl Fn(usize) -> bool) -> Observation {
        let camera = Camera {
            camera_to_world: DMat4::IDENTITY,
            projection: Projection::Orthographic,
            focal: DVec2::ONE,
            centre: DVec2::splat(0.5 * SIDE as f64),
            width: SIDE as u32,
            height: SIDE as u32,
            near: 0.0,
            blur: Blur::default(),
        };
        let map = DepthMap {
            camera,
            width: SIDE,
            height: SIDE,
            transmittance: (0..SIDE * SIDE).map(|i| 1.0 - opacity(i)).collect(),
            shown: (0..SIDE * SIDE).map(shown).collect(),
            noise: 0.0,
            limit: Limit::Light,
            name: "view".into(),
            means: None,
        };
        Observation { maps: vec![map], clean: false }
    }

    #[test]
    fn what_is_faint_or_outside_is_told() {
        let all = Aabb { min: DVec3::splat(-100.0), max: DVec3::splat(100.0) };
        // Half of the pixels are opaque by a half, the others by a hundredth of that.
        let left = |i: usize| i % SIDE < SIDE / 2;
        let faint = photograph(|i| if left(i) { 0.5 } else { 0.005 }, left);
        assert_eq!(left_out(&faint, &all), None, "1 % is not much");
        let fainter = photograph(|i| if left(i) { 0.5 } else { 0.02 }, left);
        let told = left_out(&fainter, &all).map(|warning| warning.what).unwrap_or_default();
        assert!(told.starts_with("3.8 % ") && told.contains(" 2.000 % of the contrast"), "{told}");
        // A box that no ray crosses leaves everything out.
        let beside = Aabb { min: DVec3::new(20.0, -9.0, -9.0), max: DVec3::splat(30.0) };
        let told = left_out(&faint, &beside).map(|warning| warning.what).unwrap_or_default();
        assert!(told.starts_with("100.0 % "), "{told}");
        // What is darker than the background outweighs what is lighter.
        let noisy = photograph(|i| if left(i) { 0.5 } else { [0.1, -0.1][i % 2] }, left);
        assert_eq!(left_out(&noisy, &all), None);
    }
}
