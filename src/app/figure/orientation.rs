//! How the axes of the world lie in a picture: a cube with anatomical letters, or a triad of axes.

use super::drawing::{Anchor, Color, Drawing, Point, Style};
use crate::scene::camera::Camera;
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Mark of the axes of the world in a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Orientation {
    /// Cube whose faces have the letters of right (+X), left, anterior (+Y), posterior, superior (+Z) and inferior.
    Anatomical,
    /// Axes X, Y and Z.
    Axes,
}

/// Colors of the axes X, Y and Z, for dark and light pictures alike.
const COLORS: [Color; 3] = [[214, 69, 65], [78, 154, 6], [66, 113, 214]];
/// Letters of the positive and negative side of each axis.
const LETTERS: [[&str; 2]; 3] = [["R", "L"], ["A", "P"], ["S", "I"]];

/// A face of the cube that is turned to the camera.
#[derive(Debug, Clone, PartialEq)]
struct Face {
    letter: &'static str,
    axis: usize,
    /// Corners in the picture, in halves of an edge, x to the right and y downwards.
    corners: [DVec2; 4],
    /// Cosine of the angle between its normal and the direction to the camera.
    facing: f64,
}

/// Returns a direction of the world as the camera shows it: to the right, downwards and towards the camera.
fn to_camera(camera: &Camera, direction: DVec3) -> DVec3 {
    let v = camera.camera_to_world.transpose().transform_vector3(direction);
    DVec3::new(v.x, -v.y, v.z)
}

/// Returns the faces of a cube that a camera sees by parallel rays, the one that is turned to it most last.
fn faces(camera: &Camera) -> Vec<Face> {
    let mut faces = Vec::new();
    for (axis, letters) in LETTERS.iter().enumerate() {
        for (letter, sign) in letters.iter().zip([1.0, -1.0]) {
            let normal = sign * DVec3::AXES[axis];
            let facing = to_camera(camera, normal).z;
            // Faces that are seen from their edge are lines.
            if facing < 1e-6 {
                continue;
            }
            let (u, v) = (DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]);
            let corners = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
            let corners = corners.map(|(a, b)| to_camera(camera, normal + a * u + b * v).truncate());
            faces.push(Face { letter, axis, corners, facing });
        }
    }
    faces.sort_by(|a, b| a.facing.total_cmp(&b.facing));
    faces
}

/// Draws a mark around a position; `size` is the font size in points, and `ink` the color of lines and letters of axes.
pub(super) fn draw(orientation: Orientation, drawing: &mut Drawing, camera: &Camera, at: Point, size: f64, ink: Color) {
    match orientation {
        Orientation::Anatomical => cube(drawing, camera, at, size),
        Orientation::Axes => triad(drawing, camera, at, size, ink),
    }
}

/// Half of the extent of a mark in font sizes.
const REACH: f64 = 2.2;

impl Orientation {
    /// Distance in font sizes from a picture's edges to the middle of a mark in its corner.
    pub(super) fn inset(self) -> f64 {
        match self {
            Self::Anatomical => REACH + 0.4,
            // The letters stand beyond the axes.
            Self::Axes => REACH + 0.9,
        }
    }
}

fn cube(drawing: &mut Drawing, camera: &Camera, [x, y]: Point, size: f64) {
    // Half an edge, so that the cube's diagonal has room.
    let half = REACH * size / 3_f64.sqrt();
    for Face { letter, axis, corners, facing } in faces(camera) {
        let outline: Vec<Point> = corners.iter().map(|c| [x + half * c.x, y + half * c.y]).collect();
        // Lighter the more it is turned to the camera.
        let shade = 0.55 + 0.45 * facing;
        let color = COLORS[axis].map(|c| (shade * (255.0 - 0.45 * (255.0 - f64::from(c)))) as u8);
        let closed = outline.iter().chain(&outline[..1]).copied().collect();
        drawing.area(outline, color);
        drawing.line(closed, 0.06 * size, [30; 3]);
        if facing > 0.3 {
            let middle = 0.25 * corners.iter().sum::<DVec2>();
            let size = size * (0.5 + 0.7 * facing);
            let at = [x + half * middle.x, y + half * middle.y + 0.36 * size];
            drawing.text(letter, at, Anchor::Middle, Style { size, bold: true, color: [20; 3] });
        }
    }
}

fn triad(drawing: &mut Drawing, camera: &Camera, [x, y]: Point, size: f64, ink: Color) {
    let length = (REACH - 0.6) * size;
    let mut axes: Vec<(usize, DVec3)> = DVec3::AXES.iter().map(|axis| to_camera(camera, *axis)).enumerate().collect();
    // Those that point away from the camera lie behind the others.
    axes.sort_by(|a, b| a.1.z.total_cmp(&b.1.z));
    for (axis, direction) in axes {
        let color = COLORS[axis];
        let end = DVec2::new(x, y) + length * direction.truncate();
        drawing.line(vec![[x, y], end.to_array()], 0.16 * size, color);
        let flat = direction.truncate().length();
        if flat > 0.25 {
            let along = direction.truncate() / flat;
            let across = along.perp();
            let head = [end + 0.45 * size * along, end + 0.22 * size * across, end - 0.22 * size * across];
            drawing.area(head.map(|p| p.to_array()).to_vec(), color);
        }
        // Beside the origin, where an axis points at the camera or away from it.
        let label =
            if flat > 0.25 { end + 0.95 * size * direction.truncate() / flat } else { end + DVec2::splat(0.7 * size) };
        let style = Style { size, bold: true, color: ink };
        drawing.text(["X", "Y", "Z"][axis], [label.x, label.y + 0.36 * size], Anchor::Middle, style);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::aim::{Side, Stand, View, cameras};
    use crate::scene::camera::Projection;
    use crate::scene::up::Up;

    fn from(side: Side) -> Camera {
        let view = View { size: [64, 64], field_of_view: 40.0, projection: Projection::Orthographic };
        cameras(&[DVec3::ZERO, DVec3::ONE], &[Stand::Around(side.bearing(Up::Z), None)], view)[0]
    }

    #[test]
    fn a_cube_shows_the_side_that_the_camera_faces() {
        for (side, letter) in [
            (Side::Anterior, "A"),
            (Side::Posterior, "P"),
            (Side::Left, "L"),
            (Side::Right, "R"),
            (Side::Superior, "S"),
            (Side::Inferior, "I"),
        ] {
            let faces = faces(&from(side));
            assert_eq!(faces.iter().map(|f| f.letter).collect::<Vec<_>>(), [letter], "{side:?}");
            assert!((faces[0].facing - 1.0).abs() < 1e-12);
            assert!(faces[0].corners.iter().all(|c| (c.abs() - 1.0).length() < 1e-12));
        }
        // From the corner of front, right and top, all three are turned to the camera alike.
        let corner = faces(&from(Side::Iso));
        let mut letters: Vec<_> = corner.iter().map(|f| f.letter).collect();
        letters.sort_unstable();
        assert_eq!(letters, ["P", "R", "S"]);
        assert!(corner.iter().all(|f| (f.facing - 3_f64.sqrt().recip()).abs() < 1e-12));
    }

    #[test]
    fn directions_are_to_the_right_downwards_and_towards() {
        let camera = from(Side::Anterior);
        assert!((to_camera(&camera, DVec3::X) - DVec3::NEG_X).length() < 1e-12, "the patient's right is at the left");
        assert!((to_camera(&camera, DVec3::Y) - DVec3::Z).length() < 1e-12);
        assert!((to_camera(&camera, DVec3::Z) - DVec3::NEG_Y).length() < 1e-12, "up");
    }
}
