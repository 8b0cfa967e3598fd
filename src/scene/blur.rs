//! Blur of a camera's picture: by an aperture that is no point, and by its motion while the shutter is open.

use crate::error::{Error, Result};
use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use std::f64::consts::PI;

/// Opening through which a camera gathers light: a disc, or a regular polygon, about its position and across its
/// viewing axis. What lies at the distance of focus is sharp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aperture {
    /// Radius of the disc, or of the polygon's corners, in world units.
    pub radius: f64,
    /// Distance along the viewing axis to what is sharp, in world units.
    pub focus: f64,
    /// Number of the polygon's corners; 0 for a disc.
    pub blades: u32,
    /// Angle in radians by which the polygon is turned against the clock, as seen along the viewing axis from behind
    /// the camera. At 0 the middle of an edge lies to the right.
    pub rotation: f64,
    /// Height of the opening over its width: above 1 for the blur of anamorphic lenses, which is higher than wide.
    pub ratio: f64,
}

impl Aperture {
    /// Creates a disc.
    pub fn disc(radius: f64, focus: f64) -> Self {
        Self { radius, focus, blades: 0, rotation: 0.0, ratio: 1.0 }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// If one cannot be used.
    fn checked(self) -> Result<Self> {
        let Self { radius, focus, blades, rotation, ratio } = self;
        let refused = |what: String| {
            Err(Error::invalid(what)
                .hint("correct the aperture of the camera, or give ⟨aperture=0⟩ for sharp pictures"))
        };
        if !(radius >= 0.0 && radius.is_finite()) {
            return refused(format!("a radius of the aperture of {radius} must be finite and not negative"));
        }
        if !(focus > 0.0 && focus.is_finite()) {
            return refused(format!("a distance of focus of {focus} must be positive and finite"));
        }
        if !(ratio > 0.0 && ratio.is_finite() && rotation.is_finite()) {
            return refused(format!("an aperture of ratio {ratio} and rotation {rotation} cannot be used"));
        }
        if matches!(blades, 1 | 2) || blades > 1000 {
            return refused(format!("an aperture of {blades} blades is no polygon: 3 to 1000, or 0 for a disc"));
        }
        Ok(self)
    }

    /// Returns the point of the opening, right and up of its middle in world units, that two numbers in [0, 1) stand
    /// for. Even numbers give points that cover it evenly.
    fn point(&self, [u, v]: [f64; 2]) -> DVec2 {
        let unit = match self.blades {
            0 => disc([u, v]),
            blades => self.polygon(f64::from(blades), [u, v]),
        };
        self.radius * unit * DVec2::new(1.0 / self.ratio, 1.0)
    }

    /// Returns a point of a regular polygon with corners on the unit circle: of the triangle that the first number
    /// chooses, evenly.
    fn polygon(&self, blades: f64, [u, v]: [f64; 2]) -> DVec2 {
        let (triangle, u) = ((u * blades).floor(), (u * blades).fract());
        let outwards = u.sqrt();
        let (along, across) = (outwards, outwards * (2.0 * v - 1.0));
        let half = PI / blades;
        let at = DVec2::new(along * half.cos(), across * half.sin());
        DVec2::from_angle(self.rotation + 2.0 * half * triangle).rotate(at)
    }
}

/// Maps the unit square to the unit disc, so that equal areas stay equal and neighbours stay close (Shirley & Chiu
/// 1997).
fn disc([u, v]: [f64; 2]) -> DVec2 {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    if a == 0.0 && b == 0.0 {
        return DVec2::ZERO;
    }
    let (radius, angle) =
        if a.abs() > b.abs() { (a, 0.25 * PI * (b / a)) } else { (b, 0.5 * PI - 0.25 * PI * (a / b)) };
    radius * DVec2::from_angle(angle)
}

/// Motion of a camera while its shutter is open: camera-to-world motions as it opens and closes. The camera itself
/// stands where it is in the middle of that time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shutter {
    /// Camera-to-world motion as the shutter opens.
    pub start: DMat4,
    /// Camera-to-world motion as the shutter closes.
    pub end: DMat4,
    /// Times at which the shutter opens and closes, in frames after that of the picture; none where they are unknown,
    /// so that nothing but the camera moves.
    pub open: Option<[f64; 2]>,
}

impl Shutter {
    /// Returns the camera-to-world motion at a time from 0, as the shutter opens, to 1, as it closes, of a camera that
    /// has `middle` halfway. Positions move evenly along lines, and axes turn evenly, before the middle and after it.
    pub(crate) fn at(&self, middle: DMat4, time: f64) -> DMat4 {
        if time < 0.5 { between(self.start, middle, 2.0 * time) } else { between(middle, self.end, 2.0 * time - 1.0) }
    }
}

/// Returns the rigid motion on the way from one to another, at a share from 0 to 1 of it: positions lie on a line, and
/// axes turn evenly. Both motions are mirrored, or neither is.
pub fn between(from: DMat4, to: DMat4, share: f64) -> DMat4 {
    let mirror = mirror_of(from);
    let place = |m: DMat4| m.w_axis.truncate();
    let position: DVec3 = place(from).lerp(place(to), share);
    let turned = axes(from * mirror).slerp(axes(to * mirror), share);
    DMat4::from_rotation_translation(turned, position) * mirror
}

/// Returns the rigid motion on the way from one to another as [`between`] does, but by one even turn about a fixed axis
/// and an even shift along it: of cameras on a circle, which look inwards, positions stay on it.
pub fn between_on_arc(from: DMat4, to: DMat4, share: f64) -> DMat4 {
    let mirror = mirror_of(from);
    let (a, b) = (from * mirror, to * mirror);
    let (axis, angle) = (axes(b) * axes(a).inverse()).to_axis_angle();
    if angle < 1e-9 {
        return between(from, to, share);
    }
    let start = a.w_axis.truncate();
    let shift = b.w_axis.truncate() - start;
    let along = shift.dot(axis) * axis;
    let across = shift - along;
    let centre = start + 0.5 * across + 0.5 / (0.5 * angle).tan() * axis.cross(across);
    let turn = DQuat::from_axis_angle(axis, share * angle);
    let position = centre + turn * (start - centre) + share * along;
    DMat4::from_rotation_translation(turn * axes(a), position) * mirror
}

/// Returns the axes of a rigid motion that is not mirrored.
fn axes(motion: DMat4) -> DQuat {
    DQuat::from_mat3(&DMat3::from_mat4(motion))
}

/// Returns the map that takes a mirror out of a rigid motion, and back.
fn mirror_of(motion: DMat4) -> DMat4 {
    DMat4::from_scale(DVec3::new(motion.determinant().signum(), 1.0, 1.0))
}

/// Aperture and shutter of a camera, which blur its picture.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Blur {
    /// Opening that light passes; none for a point, which makes all sharp.
    pub aperture: Option<Aperture>,
    /// Motion while the shutter is open; none for a camera at rest.
    pub shutter: Option<Shutter>,
}

impl Blur {
    /// Checks the aperture, and drops one that is a point. The motions of the shutter are those of cameras, which are
    /// checked as such.
    ///
    /// # Errors
    /// If a number of the aperture cannot be used.
    pub fn checked(self) -> Result<Self> {
        let aperture = self.aperture.map(Aperture::checked).transpose()?.filter(|aperture| aperture.radius > 0.0);
        Ok(Self { aperture, ..self })
    }

    /// True if nothing blurs the picture.
    #[inline(always)]
    pub fn is_none(&self) -> bool {
        self.aperture.is_none() && self.shutter.is_none()
    }

    /// Returns the point of the aperture, right and up of the camera in world units, that two numbers in [0, 1) stand
    /// for, and the distance of focus; none for a point.
    pub(super) fn point(&self, numbers: [f64; 2]) -> Option<(DVec2, f64)> {
        self.aperture.map(|aperture| (aperture.point(numbers), aperture.focus))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// Means over a fine grid of numbers.
    fn moments(aperture: &Aperture) -> (DVec2, DVec2, f64) {
        // A multiple of the numbers of blades.
        let n = 420;
        let (mut mean, mut squares, mut furthest) = (DVec2::ZERO, DVec2::ZERO, 0.0_f64);
        for i in 0..n * n {
            let numbers = [i % n, i / n].map(|k| (f64::from(k) + 0.5) / f64::from(n));
            let point = aperture.point(numbers);
            mean += point;
            squares += point * point;
            furthest = furthest.max(point.length());
        }
        let count = f64::from(n * n);
        (mean / count, squares / count, furthest)
    }

    /// Second moments in closed form: R²/4 of a disc about each axis, R² (2 + cos 2π/n) / 12 of a regular polygon.
    #[test]
    fn apertures_are_covered_evenly() {
        for (blades, expected) in [(0_u32, 0.25), (3, 1.5 / 12.0), (4, 2.0 / 12.0), (6, 2.5 / 12.0)] {
            let aperture = Aperture { blades, rotation: 0.3, ..Aperture::disc(2.0, 1.0) };
            let (mean, squares, furthest) = moments(&aperture);
            assert!(mean.length() < 1e-3, "{blades} {mean}");
            assert!((squares / 4.0 - expected).abs().max_element() < 1e-3, "{blades} {squares} {expected}");
            assert!(furthest <= 2.0 && furthest > 1.9, "{blades} {furthest}");
        }
        let (_, wide, _) = moments(&Aperture { ratio: 2.0, ..Aperture::disc(1.0, 1.0) });
        assert!((wide.y / wide.x - 4.0).abs() < 1e-3, "{wide}");
    }

    #[test]
    fn a_polygon_has_an_edge_to_the_right_unless_it_is_turned() {
        let square = Aperture { blades: 4, ..Aperture::disc(1.0, 1.0) };
        // The square's edges are parallel to the axes, at 1/√2.
        let most = (0..100).map(|i| square.point([0.2499999, f64::from(i) / 100.0]).x).fold(0.0, f64::max);
        assert!((most - 0.5_f64.sqrt()).abs() < 1e-3, "{most}");
        // Against the clock: an edge's middle is up to the right.
        let third = Aperture { blades: 3, rotation: 0.5, ..Aperture::disc(1.0, 1.0) };
        let middle = third.point([0.333_333, 0.5]);
        assert!(middle.abs_diff_eq(0.5 * DVec2::from_angle(0.5), 1e-3), "{middle}");
        let turned = Aperture { rotation: 0.25 * PI, ..square };
        assert!(turned.point([0.24999999, 0.0]).abs_diff_eq(DVec2::new(1.0, 0.0), 1e-3), "a corner");
    }

    #[test]
    fn a_camera_turns_and_moves_evenly() {
        let quarter = DMat4::from_rotation_translation(DQuat::from_rotation_z(0.5 * PI), DVec3::new(2.0, 0.0, 4.0));
        let eighth = DMat4::from_rotation_translation(DQuat::from_rotation_z(0.25 * PI), DVec3::new(1.0, 0.0, 2.0));
        assert!(between(DMat4::IDENTITY, quarter, 0.5).abs_diff_eq(eighth, 1e-12));
        let shutter = Shutter { start: DMat4::IDENTITY, end: quarter, open: None };
        assert!(shutter.at(eighth, 0.25).abs_diff_eq(between(DMat4::IDENTITY, quarter, 0.25), 1e-12));
        for (time, expected) in [(0.0, DMat4::IDENTITY), (0.5, eighth), (1.0, quarter)] {
            assert!(shutter.at(eighth, time).abs_diff_eq(expected, 1e-12), "{time}");
        }
    }

    #[test]
    fn mirrored_cameras_move_as_others_do_and_arcs_are_kept() {
        let mirror = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        let at = |angle: f64| {
            let eye = 3.0 * DVec3::new(angle.cos(), angle.sin(), 0.4);
            crate::scene::camera::Camera::look_at(eye, DVec3::new(0.0, 0.0, 0.4), DVec3::Z)
        };
        let (a, b) = (at(0.3), at(1.1));
        assert!(between_on_arc(a, b, 0.25).abs_diff_eq(at(0.5), 1e-12), "a quarter of the arc");
        assert!(between_on_arc(a * mirror, b * mirror, 0.25).abs_diff_eq(at(0.5) * mirror, 1e-12));
        assert!(between(a * mirror, b * mirror, 0.4).abs_diff_eq(between(a, b, 0.4) * mirror, 1e-12));
        let shifted = DMat4::from_translation(DVec3::Y) * a;
        assert!(between_on_arc(a, shifted, 0.5).abs_diff_eq(between(a, shifted, 0.5), 1e-12), "without a turn");
    }

    #[test]
    fn apertures_that_cannot_be_used_are_refused() {
        let good = Aperture::disc(0.1, 3.0);
        assert_eq!(
            Blur { aperture: Some(Aperture::disc(0.0, 3.0)), shutter: None }.checked().unwrap(),
            Blur::default()
        );
        for wrong in [
            Aperture { radius: -1.0, ..good },
            Aperture { radius: f64::NAN, ..good },
            Aperture { focus: 0.0, ..good },
            Aperture { blades: 2, ..good },
            Aperture { ratio: 0.0, ..good },
            Aperture { rotation: f64::INFINITY, ..good },
        ] {
            assert!(wrong.checked().unwrap_err().remedy().is_some(), "{wrong:?}");
        }
    }
}
