//! The camera of a picture of a volume.

use crate::scene::camera::Camera;
use crate::scene::orbit;
use crate::scene::up::Up;
use glam::DVec3;

/// Direction from the volume to the camera in a world whose z axis is up: from the front, a little from the right and
/// from above.
const DIRECTION: DVec3 = DVec3::new(0.45, -0.8, 0.4);

/// Angle of view in degrees.
const ANGLE: f64 = 30.0;

/// Returns a camera from which points fill a picture whose longer side has `side` pixels; the shorter side follows from
/// their extent. The picture stands upright with respect to `up`.
pub(in crate::app) fn around(points: &[DVec3], side: usize, up: Up) -> Camera {
    let side = side as u32;
    let direction = Up::Z.turn(up) * DIRECTION.normalize();
    let square = orbit::fitted(points, direction, [side, side], ANGLE, up);
    let mut reach = [0.0_f64; 2];
    for (pixel, _) in points.iter().filter_map(|point| square.project(*point)) {
        let from_middle = (pixel - 0.5 * f64::from(side)).abs();
        reach = [reach[0].max(from_middle.x), reach[1].max(from_middle.y)];
    }
    let sides = reach.map(|half| ((2.0 * half).ceil() as u32 + 2).clamp(side / 3, side));
    orbit::fitted(points, direction, sides, ANGLE, up)
}
