//! Cameras by the name of a side, by angles, or by the positions of the eye and of what it looks at.

use super::camera::{Camera, Projection};
use super::orbit::aimed;
use super::up::Up;
use crate::scene::blur::Blur;
use glam::{DMat3, DMat4, DVec2, DVec3};

/// Side of a volume that a camera faces.
///
/// Anatomical names are those of a world whose axes are right, anterior, superior, whatever axis points upwards. The
/// others are relative to the up axis, as modelling programs have them: with Z up, the front is -Y and the right +X;
/// with Y up, the front is +Z.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// Patient's front, +Y.
    Anterior,
    /// Patient's back, -Y.
    Posterior,
    /// Left, -X: that of a patient and, seen from the front, that of an object.
    Left,
    /// Right, +X.
    Right,
    /// Patient's head, +Z, with anterior at the picture's top.
    Superior,
    /// Patient's feet, -Z, with anterior at the picture's top and the patient's left at its right.
    Inferior,
    /// Front.
    Front,
    /// Back.
    Back,
    /// Top, with the back at the picture's top.
    Top,
    /// Bottom, with the front at the picture's top.
    Bottom,
    /// Corner between front, right and top, from which the three axes are equally long.
    Iso,
}

/// Direction from which a camera sees a volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bearing {
    /// Angle about the up axis in degrees: 0 is the front, 90 the right.
    pub azimuth: f64,
    /// Angle above the horizontal plane in degrees, from -90 to 90.
    pub elevation: f64,
    /// Axis that points upwards.
    pub up: Up,
}

impl Side {
    /// Returns the direction of the side in a world with this up axis.
    pub fn bearing(self, up: Up) -> Bearing {
        let (azimuth, elevation, up) = match self {
            Self::Anterior => (180.0, 0.0, Up::Z),
            Self::Posterior => (0.0, 0.0, Up::Z),
            Self::Superior => (0.0, 90.0, Up::Z),
            Self::Inferior => (180.0, -90.0, Up::Z),
            Self::Left => (-90.0, 0.0, up),
            Self::Right => (90.0, 0.0, up),
            Self::Front => (0.0, 0.0, up),
            Self::Back => (180.0, 0.0, up),
            Self::Top => (0.0, 90.0, up),
            Self::Bottom => (0.0, -90.0, up),
            Self::Iso => (45.0, 2.0_f64.sqrt().recip().atan().to_degrees(), up),
        };
        Bearing { azimuth, elevation, up }
    }
}

/// Sine and cosine of an angle in degrees; exact at multiples of 90.
fn sin_cos(degrees: f64) -> (f64, f64) {
    let turn = degrees.rem_euclid(360.0);
    match turn {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        _ => turn.to_radians().sin_cos(),
    }
}

impl Bearing {
    /// Returns the camera's axes in the world: right, up and backwards, towards the camera. Straight above and below,
    /// they are the limits of the ones beside.
    pub fn axes(self) -> DMat3 {
        let (sin_a, cos_a) = sin_cos(self.azimuth);
        let (sin_e, cos_e) = sin_cos(self.elevation);
        let right = DVec3::new(cos_a, sin_a, 0.0);
        let back = DVec3::new(cos_e * sin_a, -cos_e * cos_a, sin_e);
        let turn = Up::Z.turn(self.up);
        // Added to 0, so that no zero is negative.
        let clean = |v: DVec3| turn * v + 0.0;
        DMat3::from_cols(clean(right), clean(back.cross(right)), clean(back))
    }
}

/// Where a camera stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stand {
    /// In a direction from the middle of what it sees, at a distance in world units; none for the one at which the
    /// bounding ball subtends the angle of view.
    Around(Bearing, Option<f64>),
    /// At a position in the world.
    At {
        /// Position of the camera.
        eye: DVec3,
        /// Position that is in the middle of the picture; none for the middle of what it sees.
        target: Option<DVec3>,
        /// Axis that points upwards.
        up: Up,
    },
}

/// Picture and lens of cameras.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Width and height of the picture in pixels.
    pub size: [u32; 2],
    /// Angle of view in degrees: that of the bounding ball where the distance is open, else that across the shorter
    /// side of the picture.
    pub field_of_view: f64,
    /// Mapping from pixels to rays.
    pub projection: Projection,
}

/// Places cameras that look at `points`. They share one focal length: of parallel rays, and where no distance or eye is
/// stated, the largest that keeps every point in every picture.
pub fn cameras(points: &[DVec3], stands: &[Stand], view: View) -> Vec<Camera> {
    let middle = middle(points);
    let radius = points.iter().map(|point| point.distance(middle)).fold(0.0, f64::max);
    let half = (0.5 * view.field_of_view).to_radians();
    let size = view.size.map(f64::from);
    let size = DVec2::new(size[0], size[1]);
    let parallel = view.projection == Projection::Orthographic;
    let fits = |stand: &Stand| parallel || matches!(stand, Stand::Around(_, None));
    let motion = |stand: &Stand| match *stand {
        Stand::Around(bearing, distance) => {
            let axes = bearing.axes();
            let away = distance.unwrap_or(radius.max(f64::MIN_POSITIVE) / half.sin());
            let motion = DMat4::from_mat3_translation(axes, middle + away * axes.z_axis);
            match (parallel, distance) {
                (true, _) => centred(motion, points),
                (false, None) => aimed(motion, points),
                (false, Some(_)) => motion,
            }
        }
        Stand::At { eye, target, up } => Camera::look_at(eye, target.unwrap_or(middle), up.vector()),
    };
    let motions: Vec<DMat4> = stands.iter().map(motion).collect();
    let fitting = motions.iter().zip(stands).filter(|(_, stand)| fits(stand));
    let reach = fitting.fold(DVec2::splat(f64::MIN_POSITIVE), |reach, (motion, _)| {
        let to_camera = motion.inverse();
        points.iter().fold(reach, |reach, point| {
            let p = to_camera.transform_point3(*point);
            reach.max(DVec2::new(p.x.abs(), p.y.abs()) / if parallel { 1.0 } else { -p.z })
        })
    });
    // One pixel of margin on each side shows the silhouette's outside.
    let fitted = ((0.5 * size - 1.0).max(DVec2::splat(0.5)) / reach).min_element();
    let stated = 0.5 * size.min_element() / half.tan();
    let camera = |(camera_to_world, stand): (DMat4, &Stand)| Camera {
        camera_to_world,
        projection: view.projection,
        focal: DVec2::splat(if fits(stand) { fitted } else { stated }),
        centre: 0.5 * size,
        width: view.size[0],
        height: view.size[1],
        near: 0.0,
        blur: Blur::default(),
    };
    motions.into_iter().zip(stands).map(camera).collect()
}

/// Returns the middle of the box of points in the world, which cameras look at; the origin without any.
pub fn middle(points: &[DVec3]) -> DVec3 {
    let ends = [f64::INFINITY, f64::NEG_INFINITY].map(DVec3::splat);
    let [low, high] = points.iter().fold(ends, |[low, high], point| [low.min(*point), high.max(*point)]);
    if points.is_empty() { DVec3::ZERO } else { 0.5 * (low + high) }
}

/// Returns a camera moved sideways until the points' extent along its rows and columns is centred on its axis.
fn centred(camera_to_world: DMat4, points: &[DVec3]) -> DMat4 {
    let to_camera = camera_to_world.inverse();
    let seen = points.iter().map(|point| to_camera.transform_point3(*point));
    let (low, high) = seen.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    let by = 0.5 * (low + high);
    if by.is_finite() {
        camera_to_world * DMat4::from_translation(DVec3::new(by.x, by.y, 0.0))
    } else {
        camera_to_world
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Aabb;

    const SIDES: [Side; 11] = [
        Side::Anterior,
        Side::Posterior,
        Side::Left,
        Side::Right,
        Side::Superior,
        Side::Inferior,
        Side::Front,
        Side::Back,
        Side::Top,
        Side::Bottom,
        Side::Iso,
    ];

    fn view(projection: Projection) -> View {
        View { size: [64, 40], field_of_view: 40.0, projection }
    }

    fn corners() -> [DVec3; 8] {
        Aabb { min: DVec3::new(-3.0, 1.0, 2.0), max: DVec3::new(1.0, 2.0, 12.0) }.corners()
    }

    /// The axes of the world at the picture's right, top and before it, as radiologists and modelling programs show
    /// them.
    #[test]
    fn sides_are_where_their_names_say() {
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        let cases = [
            (Side::Anterior, Up::Z, [-x, z, y]),
            (Side::Anterior, Up::Y, [-x, z, y]),
            (Side::Posterior, Up::Z, [x, z, -y]),
            (Side::Left, Up::Z, [-y, z, -x]),
            (Side::Right, Up::Z, [y, z, x]),
            (Side::Superior, Up::Z, [x, y, z]),
            (Side::Inferior, Up::Z, [-x, y, -z]),
            (Side::Front, Up::Z, [x, z, -y]),
            (Side::Back, Up::Z, [-x, z, y]),
            (Side::Top, Up::Z, [x, y, z]),
            (Side::Bottom, Up::Z, [x, -y, -z]),
            (Side::Front, Up::Y, [x, y, z]),
            (Side::Right, Up::Y, [-z, y, x]),
            (Side::Left, Up::Y, [z, y, -x]),
            (Side::Top, Up::Y, [x, -z, y]),
        ];
        for (side, up, [right, top, towards]) in cases {
            let axes = side.bearing(up).axes();
            assert_eq!([axes.x_axis, axes.y_axis, axes.z_axis], [right, top, towards], "{side:?} {up:?}");
        }
        let iso = Side::Iso.bearing(Up::Z).axes();
        assert!((iso.z_axis - DVec3::new(1.0, -1.0, 1.0).normalize()).length() < 1e-15, "{iso}");
    }

    #[test]
    fn axes_are_those_of_a_camera_that_looks_at_the_middle() {
        for (azimuth, elevation) in [(10.0, 20.0), (-130.0, -75.0), (720.5, 0.0)] {
            for up in [Up::Y, Up::Z] {
                let axes = Bearing { azimuth, elevation, up }.axes();
                let expected = Camera::look_at(axes.z_axis, DVec3::ZERO, up.vector());
                assert!(axes.abs_diff_eq(DMat3::from_mat4(expected), 1e-14), "{axes}");
            }
        }
    }

    #[test]
    fn every_corner_is_in_every_picture_and_one_touches_the_margin() {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let stands = SIDES.map(|side| Stand::Around(side.bearing(Up::Z), None));
            let cameras = cameras(&corners(), &stands, view(projection));
            let pixels = cameras.iter().flat_map(|c| corners().map(|corner| c.project(corner).unwrap().0));
            let least = pixels.map(|p| p.min_element().min(64.0 - p.x).min(40.0 - p.y)).fold(f64::INFINITY, f64::min);
            assert!((least - 1.0).abs() < 1e-6, "{projection:?} {least}");
            assert!(cameras.iter().all(|camera| camera.focal == cameras[0].focal), "panels have one scale");
        }
    }

    #[test]
    fn a_stated_distance_and_angle_are_kept() {
        let middle = middle(&corners());
        let bearing = Side::Iso.bearing(Up::Z);
        let camera = cameras(&corners(), &[Stand::Around(bearing, Some(3.0))], view(Projection::Perspective))[0];
        assert!((camera.position().distance(middle) - 3.0).abs() < 1e-12);
        let (top, bottom) = (camera.ray(32.0, 0.0).direction, camera.ray(32.0, 40.0).direction);
        assert!((top.angle_between(bottom).to_degrees() - 40.0).abs() < 1e-9, "across the shorter side");
        let (eye, target) = (DVec3::new(20.0, 1.0, 3.0), DVec3::new(1.0, 2.0, 3.0));
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let stand = Stand::At { eye, target: Some(target), up: Up::Z };
            let camera = cameras(&corners(), &[stand], view(projection))[0];
            assert_eq!(camera.position(), eye);
            assert!((camera.project(target).unwrap().0 - DVec2::new(32.0, 20.0)).length() < 1e-9);
        }
    }

    /// Of parallel rays the picture's height is the extent of what it shows, whatever the distance.
    #[test]
    fn parallel_rays_fit_the_extent() {
        for distance in [None, Some(50.0)] {
            let stand = Stand::Around(Side::Front.bearing(Up::Z), distance);
            let camera = cameras(&corners(), &[stand], view(Projection::Orthographic))[0];
            // 10 units of height are 38 pixels.
            assert!((camera.focal.y - 3.8).abs() < 1e-12, "{}", camera.focal);
            assert!((camera.position().x + 1.0).abs() < 1e-12 && (camera.position().z - 7.0).abs() < 1e-12);
        }
    }
}
