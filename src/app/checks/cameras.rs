//! Contradictions of the cameras with the silhouettes in their pictures.

use super::Finding;
use crate::inverse::observation::Observation;
use crate::inverse::observation::depth_map::DepthMap;
use crate::math::Ray;
use crate::scene::camera::Projection;
use glam::{DMat3, DVec2, DVec3};

/// Contradictions of the cameras with the silhouettes.
pub(crate) fn cameras(observation: &Observation) -> Vec<Finding> {
    let mut findings: Vec<Finding> = observation.maps.iter().filter_map(intrinsics).collect();
    findings.sort_by_key(|f| !f.certain);
    findings.truncate(1);
    if !findings.iter().any(|f| f.certain) {
        findings.extend(aims(observation));
    }
    findings
}

/// Focal lengths and principal points that no lens has.
fn intrinsics(map: &DepthMap) -> Option<Finding> {
    let camera = &map.camera;
    let name = Some(map.name.as_str());
    let ratio = (camera.focal.x / camera.focal.y).max(camera.focal.y / camera.focal.x);
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let off = ((camera.centre - 0.5 * size).abs() / size).max_element();
    if ratio > 4.0 {
        return Some(Finding::certain(
            name,
            format!(
                "the focal lengths are {} and {} pixels: pixels would be {ratio:.1} times as long as wide",
                camera.focal.x, camera.focal.y
            ),
            "correct 'fl_x' and 'fl_y' in transforms.json; they are equal for square pixels",
        ));
    }
    if off > 1.0 {
        return Some(Finding::doubtful(
            name,
            format!(
                "the principal point is ({}, {}), far outside of the picture of {} x {} pixels",
                camera.centre.x, camera.centre.y, camera.width, camera.height
            ),
            "correct 'cx' and 'cy' in transforms.json; they are half of 'w' and 'h' for a lens without shift",
        ));
    }
    (ratio > 2.1).then(|| {
        Finding::doubtful(
            name,
            format!("the focal lengths are {} and {} pixels, far apart", camera.focal.x, camera.focal.y),
            "check 'fl_x' and 'fl_y' in transforms.json; they are equal for square pixels",
        )
    })
}

/// A silhouette, and the ray through its middle.
struct Aim<'a> {
    map: &'a DepthMap,
    low: DVec2,
    high: DVec2,
    ray: Ray,
}

impl<'a> Aim<'a> {
    fn new(map: &'a DepthMap) -> Option<Self> {
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for i in (0..map.transmittance.len()).filter(|i| map.shows(*i)) {
            let pixel = DVec2::new((i % map.width) as f64, (i / map.width) as f64);
            (low, high) = (low.min(pixel), high.max(pixel + 1.0));
        }
        let middle = 0.5 * (low + high);
        low.cmple(high).all().then(|| Self { map, low, high, ray: map.camera.ray(middle.x, middle.y) })
    }

    /// How far a point lies from the silhouette's middle, in its half sizes; sides at which the picture cuts the medium
    /// off say nothing. Infinite behind the camera, unless the medium fills the picture: the camera may stand inside
    /// it.
    fn offset(&self, point: DVec3) -> f64 {
        let size = DVec2::new(self.map.width as f64, self.map.height as f64);
        if self.low.max_element() < 1.0 && (size - self.high).max_element() < 1.0 {
            return 0.0;
        }
        let Some((pixel, _)) = self.map.camera.project(point) else { return f64::INFINITY };
        let half = 0.5 * (self.high - self.low) + 1.0;
        let off = pixel - 0.5 * (self.low + self.high);
        let axis = |k: usize| {
            let cut = if off[k] < 0.0 { self.low[k] < 1.0 } else { self.high[k] > size[k] - 1.0 };
            if cut { 0.0 } else { off[k].abs() / half[k] }
        };
        axis(0).max(axis(1))
    }
}

/// Half sizes of a silhouette within which the medium's middle lies: 1 for cameras that are right.
const AIMED: f64 = 1.3;

/// Cameras whose silhouettes surround no common point.
fn aims(observation: &Observation) -> Option<Finding> {
    let aims: Vec<Aim> = observation.maps.iter().filter_map(Aim::new).collect();
    if aims.len() < 3 {
        return None;
    }
    let point = closest_point(&aims)?;
    let offsets: Vec<f64> = aims.iter().map(|aim| aim.offset(point)).collect();
    let wrong = offsets.iter().filter(|m| **m > AIMED).count();
    let (worst, _) = offsets.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
    if wrong == 0 {
        return far(&aims, point);
    }
    if 2 * wrong > aims.len() {
        return Some(Finding::certain(
            None,
            format!(
                "the cameras contradict one another: no point lies within the silhouettes of most of the {} views",
                aims.len()
            ),
            "check the cameras ('transform_matrix' is camera-to-world, looking down -Z, Y up; 'cx', 'cy', 'fl_x' and \
             'fl_y' in pixels), or give the region with ⟨bounds⟩",
        ));
    }
    let camera = &aims[worst].map.camera;
    let at = camera.position();
    Some(Finding::certain(
        Some(&aims[worst].map.name),
        format!(
            "this camera has nothing in common with the others: it stands at ({}, {}, {}), and what the other views \
             show around ({:.4}, {:.4}, {:.4}) lies {}{}",
            at.x,
            at.y,
            at.z,
            point.x,
            point.y,
            point.z,
            if offsets[worst].is_finite() { "beside its silhouette" } else { "behind it" },
            if wrong > 1 { format!(" ({wrong} of {} views are like that)", aims.len()) } else { String::new() }
        ),
        "correct the frame's 'transform_matrix' (camera-to-world, looking down -Z, Y up), take the view out, or give \
         the region with ⟨bounds⟩",
    ))
}

/// World coordinates so large that their roundings are seen.
fn far(aims: &[Aim<'_>], point: DVec3) -> Option<Finding> {
    let pixel = |aim: &Aim| match aim.map.camera.projection {
        Projection::Perspective => aim.map.camera.position().distance(point) / aim.map.camera.focal.max_element(),
        Projection::Orthographic => 1.0 / aim.map.camera.focal.max_element(),
    };
    let finest = aims.iter().map(pixel).fold(f64::INFINITY, f64::min);
    let largest =
        aims.iter().map(|a| a.map.camera.position().abs().max_element()).fold(point.abs().max_element(), f64::max);
    // Single-precision transforms, and voxel numbers of 32 bits.
    (largest > 4e8 * finest).then(|| {
        Finding::certain(
            None,
            format!(
                "cameras and volume lie {largest:.3e} from the origin, and a pixel covers {finest:.3e}: coordinates of \
                 voxels that far out cannot be held"
            ),
            "move cameras and volume to the origin: subtract their common offset from each 'transform_matrix'",
        )
    })
}

/// The point nearest to most of the central rays: the sum of distances is least there (iteratively reweighted least
/// squares), so that a few wrong cameras do not draw it away.
fn closest_point(aims: &[Aim<'_>]) -> Option<DVec3> {
    let mut weights = vec![1.0; aims.len()];
    let mut point = DVec3::ZERO;
    // Near the rays' origins numbers are small, wherever the scene lies.
    let origin = aims[0].ray.origin;
    for _ in 0..50 {
        let (mut a, mut b, mut sum) = (DMat3::ZERO, DVec3::ZERO, 0.0);
        for (aim, weight) in aims.iter().zip(&weights) {
            let d = aim.ray.direction;
            let across = *weight * (DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z));
            a += across;
            b += across * (aim.ray.origin - origin);
            sum += weight;
        }
        if a.determinant().abs() < 1e-6 * f64::powi(sum, 3) {
            return None;
        }
        point = a.inverse() * b;
        let distance = |aim: &Aim| {
            let from = point - (aim.ray.origin - origin);
            (from - aim.ray.direction * from.dot(aim.ray.direction)).length()
        };
        let all: Vec<f64> = aims.iter().map(distance).collect();
        let floor = 1e-2 * all.iter().sum::<f64>() / all.len() as f64;
        let largest = all.iter().fold(0.0_f64, |m, d| m.max(*d));
        if largest <= 0.0 {
            break;
        }
        weights = all.iter().map(|d| largest / d.max(floor).max(f64::MIN_POSITIVE)).collect();
        let top = weights.iter().fold(0.0_f64, |m, w| m.max(*w));
        weights.iter_mut().for_each(|w| *w /= top);
    }
    Some(point + origin).filter(|p| p.is_finite())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::inverse::observation::depth_map::Limit;
    use crate::scene::blur::Blur;
    use crate::scene::camera::Camera;
    use glam::DMat4;

    const SIDE: usize = 16;

    /// A view whose medium covers the pixels for which `covered` holds.
    fn view(camera_to_world: DMat4, covered: impl Fn(usize, usize) -> bool) -> DepthMap {
        let side = SIDE as u32;
        let camera = Camera {
            camera_to_world,
            projection: Projection::Perspective,
            focal: DVec2::splat(SIDE as f64),
            centre: DVec2::splat(0.5 * SIDE as f64),
            width: side,
            height: side,
            near: 0.0,
            blur: Blur::default(),
        };
        let depth: Vec<f32> = (0..SIDE * SIDE).map(|i| f32::from(u8::from(covered(i % SIDE, i / SIDE)))).collect();
        DepthMap {
            camera,
            width: SIDE,
            height: SIDE,
            transmittance: depth.iter().map(|d: &f32| (-d).exp()).collect(),
            shown: (0..SIDE * SIDE).map(|i| covered(i % SIDE, i / SIDE)).collect(),
            noise: 0.0,
            limit: Limit::Voxels,
            name: "view".into(),
            means: None,
        }
    }

    fn around() -> Vec<DepthMap> {
        let middle = |x: usize, y: usize| (6..10).contains(&x) && (6..10).contains(&y);
        let eyes = [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y, DVec3::new(0.7, 0.7, 0.2)];
        eyes.map(|eye| view(Camera::look_at(8.0 * eye, DVec3::ZERO, DVec3::Z), middle)).into()
    }

    /// A camera inside the medium that looks away from its middle sees nothing else.
    #[test]
    fn a_camera_inside_the_medium_contradicts_no_other() {
        let outwards = Camera::look_at(DVec3::new(0.1, 0.0, 0.0), DVec3::new(5.0, 0.0, 0.0), DVec3::Z);
        let findings = |covered: fn(usize, usize) -> bool| {
            let mut maps = around();
            maps.push(view(outwards, covered));
            cameras(&Observation { maps, clean: true })
        };
        assert_eq!(findings(|_, _| true), []);
        // One that sees a small silhouette where the others see nothing does.
        let wrong = findings(|x, y| (6..10).contains(&x) && (6..10).contains(&y));
        assert!(wrong.len() == 1 && wrong[0].certain && wrong[0].warning.what.contains("behind it"), "{wrong:?}");
    }
}
