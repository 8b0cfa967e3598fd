//! Cameras placed around a volume.

use crate::scene::blur::Blur;
use crate::scene::camera::{Camera, Projection};
use crate::scene::up::Up;
use glam::{DMat4, DVec2, DVec3};

/// Distribution of views around a volume.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// Evenly over the whole sphere by the golden angle, with no two views on one line.
    #[default]
    Sphere,
    /// Evenly on the horizontal circle around the up axis.
    Ring,
}

/// Places `count` perspective cameras of `width` x `height` pixels around `points` so that each sees all points; on a
/// sphere with margins of the same width on opposite sides, on a ring around the points' middle.
/// `field_of_view` is the angle in degrees that the bounding sphere of the points subtends; it sets the cameras'
/// distance. Cameras stand upright with respect to `up`, and [`Layout::Ring`] circles that axis.
pub fn cameras(
    points: &[DVec3],
    count: usize,
    layout: Layout,
    width: u32,
    height: u32,
    field_of_view: f64,
    up: Up,
) -> Vec<Camera> {
    let (centre, radius) = ball(points);
    let half = (0.5 * field_of_view).to_radians();
    let distance = radius.max(f64::MIN_POSITIVE) / half.sin();
    let directions: Vec<DVec3> = (0..count).map(|i| Up::Z.turn(up) * direction(i, count, layout)).collect();
    let eye = |d: &DVec3| {
        let eye = Camera::look_at(centre + distance * *d, centre, up.vector());
        match layout {
            Layout::Sphere => aimed(eye, points),
            // A turntable does not sway.
            Layout::Ring => eye,
        }
    };
    let eyes: Vec<_> = directions.iter().map(eye).collect();
    // All cameras share one focal length: the largest that keeps every point in every picture.
    let reach = eyes.iter().fold(DVec2::splat(f64::MIN_POSITIVE), |reach, eye| {
        let to_camera = eye.inverse();
        points.iter().fold(reach, |reach, point| {
            let p = to_camera.transform_point3(*point);
            reach.max(DVec2::new(p.x.abs(), p.y.abs()) / -p.z)
        })
    });
    let size = DVec2::new(f64::from(width), f64::from(height));
    // One pixel of margin on each side shows the silhouette's outside.
    let focal = ((0.5 * size - 1.0).max(DVec2::splat(0.5)) / reach).min_element();
    eyes.into_iter()
        .map(|camera_to_world| Camera {
            camera_to_world,
            projection: Projection::Perspective,
            focal: DVec2::splat(focal),
            centre: 0.5 * size,
            width,
            height,
            near: 0.0,
            blur: Blur::default(),
        })
        .collect()
}

/// Most steps of [`aimed`]; two or three suffice unless the outermost points change.
const STEPS: usize = 20;

/// Returns a camera moved sideways, along its picture's rows and columns, until the outermost points lie equally far
/// from the middle on opposite sides.
pub(super) fn aimed(camera_to_world: DMat4, points: &[DVec3]) -> DMat4 {
    let to_camera = camera_to_world.inverse();
    let seen: Vec<DVec3> = points.iter().map(|point| to_camera.transform_point3(*point)).collect();
    let moved = |axis: usize| {
        let mut by = 0.0;
        for _ in 0..STEPS {
            let from_middle = |p: &DVec3| ((p[axis] - by) / -p.z, -1.0 / p.z);
            let (low, high) = seen
                .iter()
                .map(from_middle)
                .fold(((f64::INFINITY, 0.0), (f64::NEG_INFINITY, 0.0)), |(low, high), at| {
                    (if at.0 < low.0 { at } else { low }, if at.0 > high.0 { at } else { high })
                });
            // Newton's step for the sum of both, which falls with each unit moved by the inverse of each distance.
            let step = (low.0 + high.0) / (low.1 + high.1);
            if !step.is_finite() {
                break;
            }
            by += step;
        }
        by
    };
    camera_to_world * DMat4::from_translation(DVec3::new(moved(0), moved(1), 0.0))
}

/// Places a perspective camera in a direction from the middle of `points`, whose pictures of `width` x `height` pixels
/// they fill, upright with respect to `up`: the principal point is shifted so that the points' outline lies in the
/// middle. `field_of_view` is the angle in degrees that the bounding sphere of the points subtends; it sets the
/// camera's distance.
pub fn fitted(points: &[DVec3], direction: DVec3, [width, height]: [u32; 2], field_of_view: f64, up: Up) -> Camera {
    let (centre, radius) = ball(points);
    let distance = radius.max(f64::MIN_POSITIVE) / (0.5 * field_of_view).to_radians().sin();
    let camera_to_world = Camera::look_at(centre + distance * direction, centre, up.vector());
    let to_camera = camera_to_world.inverse();
    let on_plane = |point: &DVec3| {
        let p = to_camera.transform_point3(*point);
        DVec2::new(p.x, -p.y) / -p.z
    };
    let low = points.iter().map(on_plane).fold(DVec2::INFINITY, DVec2::min);
    let high = points.iter().map(on_plane).fold(DVec2::NEG_INFINITY, DVec2::max);
    let size = DVec2::new(f64::from(width), f64::from(height));
    let extent = (high - low).max(DVec2::splat(f64::MIN_POSITIVE));
    // One pixel of margin on each side shows the silhouette's outside.
    let focal = ((size - 2.0).max(DVec2::ONE) / extent).min_element();
    let middle = if points.is_empty() { DVec2::ZERO } else { 0.5 * (low + high) };
    let focal = if focal.is_finite() { focal } else { size.min_element() };
    Camera {
        camera_to_world,
        projection: Projection::Perspective,
        focal: DVec2::splat(focal),
        centre: 0.5 * size - focal * middle,
        width,
        height,
        near: 0.0,
        blur: Blur::default(),
    }
}

/// Centre and radius of a bounding ball, slightly larger than the smallest one (Ritter 1990).
pub(super) fn ball(points: &[DVec3]) -> (DVec3, f64) {
    let Some(first) = points.first() else { return (DVec3::ZERO, 0.0) };
    let farthest = |from: DVec3| {
        let by_distance = |a: &&DVec3, b: &&DVec3| a.distance_squared(from).total_cmp(&b.distance_squared(from));
        points.iter().max_by(by_distance).copied().unwrap_or(from)
    };
    let a = farthest(*first);
    let b = farthest(a);
    let (mut centre, mut radius) = (0.5 * (a + b), 0.5 * a.distance(b));
    for p in points {
        let distance = p.distance(centre);
        if distance > radius {
            radius = 0.5 * (radius + distance);
            centre += (distance - radius) / distance * (*p - centre);
        }
    }
    (centre, radius)
}

/// Unit vector from the centre to view `i` of `count`, in a world whose z axis is up.
pub fn direction(i: usize, count: usize, layout: Layout) -> DVec3 {
    let i = i as f64;
    let count = count as f64;
    match layout {
        Layout::Sphere => {
            let z = 1.0 - 2.0 * (i + 0.5) / count;
            let (sin, cos) = (std::f64::consts::PI * (3.0 - 5.0_f64.sqrt()) * i).sin_cos();
            let r = (1.0 - z * z).sqrt();
            DVec3::new(r * cos, r * sin, z)
        }
        Layout::Ring => {
            let (sin, cos) = (std::f64::consts::TAU * i / count).sin_cos();
            DVec3::new(cos, sin, 0.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Aabb;

    #[test]
    fn every_corner_is_in_every_picture() {
        let bounds = Aabb { min: DVec3::new(-3.0, 1.0, 2.0), max: DVec3::new(1.0, 2.0, 12.0) };
        for layout in [Layout::Sphere, Layout::Ring] {
            for camera in cameras(&bounds.corners(), 17, layout, 64, 40, 40.0, Up::Y) {
                for corner in bounds.corners() {
                    let (p, _) = camera.project(corner).unwrap();
                    assert!(p.min_element() > 0.9 && p.x < 63.1 && p.y < 39.1, "{layout:?} {p}");
                }
            }
        }
    }

    /// A box, and a tetrahedron whose middle is not that of its bounding ball.
    #[test]
    fn margins_are_even() {
        let bounds = Aabb { min: DVec3::new(-3.0, 1.0, 2.0), max: DVec3::new(1.0, 2.0, 12.0) };
        let lopsided = [DVec3::ZERO, DVec3::new(9.0, 0.0, 1.0), DVec3::new(0.0, 2.0, 1.0), DVec3::new(0.5, 0.0, 7.0)];
        for (points, layout) in [(&bounds.corners()[..], Layout::Sphere), (&lopsided[..], Layout::Sphere)] {
            for camera in cameras(points, 7, layout, 64, 54, 40.0, Up::Z) {
                let pixels: Vec<DVec2> = points.iter().map(|point| camera.project(*point).unwrap().0).collect();
                let low = pixels.iter().copied().fold(DVec2::INFINITY, DVec2::min);
                let high = pixels.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
                let margins = low - (DVec2::new(64.0, 54.0) - high);
                assert!(margins.abs().max_element() < 1e-6, "{low} {high}");
            }
        }
    }

    #[test]
    fn a_y_up_ring_is_the_z_up_ring_turned() {
        let bounds = Aabb { min: DVec3::new(-3.0, 1.0, 2.0), max: DVec3::new(1.0, 2.0, 12.0) };
        let turn = Up::Z.turn_map(Up::Y);
        let turned: Vec<DVec3> = bounds.corners().iter().map(|c| turn.transform_point3(*c)).collect();
        for layout in [Layout::Sphere, Layout::Ring] {
            let z_up = cameras(&bounds.corners(), 7, layout, 64, 40, 40.0, Up::Z);
            let y_up = cameras(&turned, 7, layout, 64, 40, 40.0, Up::Y);
            for (z, y) in z_up.iter().zip(&y_up) {
                // Entries are below 100, and each is the same sum in another order.
                assert!((turn * z.camera_to_world).abs_diff_eq(y.camera_to_world, 1e-12));
                assert!((z.focal.x - y.focal.x).abs() < 1e-12 * z.focal.x);
                assert!(y.camera_to_world.x_axis.y.abs() < 1e-12, "the horizon is level");
            }
        }
    }

    #[test]
    fn a_fitted_outline_touches_two_opposite_sides() {
        let bounds = Aabb { min: DVec3::new(-3.0, 1.0, 2.0), max: DVec3::new(1.0, 2.0, 12.0) };
        for direction in [DVec3::X, DVec3::new(0.4, -0.8, 0.3).normalize(), DVec3::Z] {
            let camera = fitted(&bounds.corners(), direction, [64, 40], 40.0, Up::Z);
            let pixels: Vec<DVec2> = bounds.corners().iter().map(|c| camera.project(*c).unwrap().0).collect();
            let low = pixels.iter().copied().fold(DVec2::INFINITY, DVec2::min);
            let high = pixels.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
            assert!(low.min_element() > 0.99 && high.x < 63.01 && high.y < 39.01, "{low} {high}");
            let fills = [0, 1].map(|a| (low[a] - 1.0).abs() < 1e-6 && (high[a] - [63.0, 39.0][a]).abs() < 1e-6);
            assert!(fills[0] || fills[1], "{low} {high}");
        }
    }

    #[test]
    fn the_sphere_is_covered_evenly() {
        let sum: DVec3 = (0..200).map(|i| direction(i, 200, Layout::Sphere)).sum();
        assert!(sum.length() < 2.0, "{sum}");
    }
}
