//! Viewpoints on a sphere around a volume: cameras at a fixed distance from its centre, facing it.
//!
//! A viewpoint is a frame of axes (right, up, back), where `back` is the unit vector from the centre to the camera. A
//! step is a rotation about an axis perpendicular to `back`: the exponential map of the sphere, which transports the up
//! vector along. Without longitude and latitude, poles are points like any other.

use crate::error::{Code, Error, Result};
use crate::scene::blur::Blur;
use crate::scene::camera::{Camera, Projection};
use crate::scene::orbit::{self, Layout};
use crate::scene::up::Up;
use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use std::f64::consts::FRAC_PI_4;

/// Sine of the angle between `back` and the vertical below which the roll of a frame is undefined.
const POLE: f64 = 0.05;

/// Cameras of one lens around a ball that lies inside the picture from every viewpoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// World-space point that the cameras face.
    pub centre: DVec3,
    /// Distance from the centre to the cameras, in world units.
    pub distance: f64,
    /// Focal length in pixels.
    pub focal: f64,
    /// Width and height of the pictures in pixels.
    pub size: [u32; 2],
    /// Axis with respect to which cameras stand upright.
    pub up: Up,
}

impl Sphere {
    /// The sphere around `points` from which their bounding ball subtends an angle of `field_of_view` degrees and fills
    /// the shorter side of the picture but for one pixel on each side.
    ///
    /// # Errors
    /// If there are no points.
    pub fn around(points: &[DVec3], size: [u32; 2], field_of_view: f64, up: Up) -> Result<Self> {
        if points.is_empty() {
            return Err(Error::invalid("the grid is empty: there is nothing to look at").coded(Code::EmptyGrid));
        }
        let (centre, radius) = orbit::ball(points);
        let half = (0.5 * field_of_view).to_radians();
        let reach = (0.5 * f64::from(size[0].min(size[1])) - 1.0).max(0.5);
        let distance = radius.max(f64::MIN_POSITIVE) / half.sin();
        Ok(Self { centre, distance, focal: reach / half.tan(), size, up })
    }

    /// Scales the pictures and the focal length by `factor`; each side keeps at least one pixel.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let size = self.size.map(|n| ((f64::from(n) * factor).round() as u32).max(1));
        let shorter = |s: [u32; 2]| f64::from(s[0].min(s[1]));
        Self { focal: self.focal * shorter(size) / shorter(self.size), size, ..*self }
    }

    /// Camera at the viewpoint with the given axes (right, up, back).
    pub fn camera(&self, axes: &DMat3) -> Camera {
        let size = DVec2::new(f64::from(self.size[0]), f64::from(self.size[1]));
        Camera {
            camera_to_world: DMat4::from_mat3_translation(*axes, self.centre + self.distance * axes.z_axis),
            projection: Projection::Perspective,
            focal: DVec2::splat(self.focal),
            centre: 0.5 * size,
            width: self.size[0],
            height: self.size[1],
            near: 0.0,
            blur: Blur::default(),
        }
    }
}

/// Axes (right, up, back) of the camera in the given direction from the centre that stands upright with respect to
/// `up`.
pub fn upright(direction: DVec3, up: Up) -> DMat3 {
    DMat3::from_mat4(Camera::look_at(direction, DVec3::ZERO, up.vector()))
}

/// Removes the roll from a viewpoint's axes. Near a pole, where the roll is undefined, the axes are returned unchanged.
pub(crate) fn levelled(axes: &DMat3, up: Up) -> DMat3 {
    if axes.z_axis.cross(up.vector()).length() < POLE { *axes } else { upright(axes.z_axis.normalize(), up) }
}

/// Axes after a step: a rotation vector in radians with components along `right` and `up`. The step has equal
/// components in the axes before and after it.
pub fn stepped(axes: &DMat3, step: DVec2) -> DMat3 {
    let turn = DQuat::from_scaled_axis(axes.x_axis * step.x + axes.y_axis * step.y);
    let moved = DMat3::from_quat(turn) * *axes;
    // Axes are orthonormalised so that rounding does not add up over a path.
    let back = moved.z_axis.normalize();
    let right = moved.y_axis.cross(back).normalize();
    DMat3::from_cols(right, back.cross(right), back)
}

/// Unit vectors to start a search from.
/// Eight are those of Weiss & Westermann (2021), sect. 5.1: longitudes 45°, 135°, 225°, 315° at latitudes ±45°. Other
/// counts are spread evenly.
pub fn starts(count: usize, up: Up) -> Vec<DVec3> {
    if count != 8 {
        return fibonacci(count, up);
    }
    let corner = |i: usize| {
        let (y, x) = (FRAC_PI_4 * (2 * (i % 4) + 1) as f64).sin_cos();
        let level = if i < 4 { FRAC_PI_4.sin() } else { -FRAC_PI_4.sin() };
        DVec3::new(x * FRAC_PI_4.cos(), y * FRAC_PI_4.cos(), level)
    };
    (0..8).map(|i| Up::Z.turn(up) * corner(i)).collect()
}

/// Unit vectors spread evenly over the sphere: a Fibonacci lattice about the up axis.
pub fn fibonacci(count: usize, up: Up) -> Vec<DVec3> {
    (0..count).map(|i| Up::Z.turn(up) * orbit::direction(i, count, Layout::Sphere)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rigid(axes: &DMat3) -> bool {
        (*axes * axes.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-14) && axes.determinant() > 0.0
    }

    #[test]
    fn steps_pass_over_the_pole_and_come_back() {
        let from = upright(DVec3::new(0.3, 0.0, 1.0).normalize(), Up::Z);
        let step = DVec2::new(-0.6, 0.02);
        let over = stepped(&from, step);
        assert!(rigid(&over) && over.z_axis.angle_between(from.z_axis) - step.length() < 1e-12);
        assert!(over.y_axis.dot(from.y_axis) > 0.5, "up is carried along, not turned: {over:?}");
        assert!(stepped(&over, -step).abs_diff_eq(from, 1e-13));
        let half = stepped(&stepped(&from, 0.5 * step), 0.5 * step);
        assert!(half.abs_diff_eq(over, 1e-13), "a step keeps its two numbers: {half:?} {over:?}");
    }

    #[test]
    fn frames_are_upright_but_at_the_poles() {
        for d in fibonacci(50, Up::Z).into_iter().chain([DVec3::Z, DVec3::NEG_Z]) {
            let axes = levelled(&upright(d, Up::Z), Up::Z);
            assert!(rigid(&axes) && axes.z_axis.abs_diff_eq(d, 1e-14));
            assert!(axes.x_axis.z.abs() < 1e-14, "{d}");
        }
        let rolled = DMat3::from_rotation_z(1.0);
        assert_eq!(levelled(&rolled, Up::Z), rolled);
        let tilted = levelled(&rolled, Up::Y);
        assert!(tilted.x_axis.y.abs() < 1e-14 && tilted.z_axis == rolled.z_axis, "level with respect to y");
    }

    #[test]
    fn the_ball_fills_the_shorter_side() {
        let points = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(5.0, 2.0, 3.0)];
        let sphere = Sphere::around(&points, [80, 60], 40.0, Up::Z).unwrap();
        assert_eq!(sphere.centre, DVec3::new(3.0, 2.0, 3.0));
        for s in [sphere, sphere.scaled(0.25)] {
            let camera = s.camera(&upright(DVec3::new(0.2, -0.5, 0.6).normalize(), Up::Z));
            // Point where a ray is tangent to a ball of radius 2.
            let (sin, cos) = 20_f64.to_radians().sin_cos();
            let m = DMat3::from_mat4(camera.camera_to_world);
            let touch = s.centre + 2.0 * (m.z_axis * sin + m.y_axis * cos);
            let (p, _) = camera.project(touch).unwrap();
            let margin = f64::from(s.size[1]) / 60.0;
            assert!((p - DVec2::new(0.5 * f64::from(s.size[0]), margin)).length() < 1e-9, "{p}");
        }
        assert!(Sphere::around(&[], [8, 8], 40.0, Up::Z).is_err());
    }

    #[test]
    fn eight_starts_are_the_papers() {
        let all = starts(8, Up::Z);
        assert!(all.iter().all(|d| (d.length() - 1.0).abs() < 1e-15 && (d.z.abs() - 0.5_f64.sqrt()).abs() < 1e-15));
        assert!(all.iter().all(|d| (d.x.abs() - 0.5).abs() < 1e-15 && (d.y.abs() - 0.5).abs() < 1e-15));
        assert_eq!((starts(1, Up::Z).len(), starts(13, Up::Y).len()), (1, 13));
    }
}
