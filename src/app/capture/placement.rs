//! Moving and scaling of a capture's world.

use crate::error::{Error, Result};
use crate::math::Aabb;
use crate::scene::camera::Projection;
use crate::scene::capture::Capture;
use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

/// Place of the world of a capture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Placement {
    /// Factor of all lengths, before the offset; none for 1.
    pub scale: Option<f64>,
    /// Translation of the scaled world; none for 0.
    pub offset: Option<[f64; 3]>,
    /// True to move the point that all cameras look at, by least squares, to the origin; before the scale.
    pub recenter: bool,
}

impl Placement {
    /// Returns the map from the old world to the new one, if there is any change.
    ///
    /// # Errors
    /// If the cameras look at no common point.
    pub(super) fn map(&self, capture: &Capture) -> Result<Option<DMat4>> {
        let Self { scale, offset, recenter } = *self;
        if scale.is_none() && offset.is_none() && !recenter {
            return Ok(None);
        }
        let centre = if recenter { target(capture)? } else { DVec3::ZERO };
        let scale = DMat4::from_scale(DVec3::splat(scale.unwrap_or(1.0)));
        Ok(Some(
            DMat4::from_translation(offset.map_or(DVec3::ZERO, DVec3::from_array))
                * scale
                * DMat4::from_translation(-centre),
        ))
    }
}

/// Moves a capture by a map of uniform scale without rotation, such that its pictures stay right: extinctions are per
/// length, and near distances and the pixels of orthographic cameras lengths.
pub(super) fn moved(mut capture: Capture, map: DMat4) -> Capture {
    let scale = map.x_axis.x;
    for frame in &mut capture.frames {
        let camera = &mut frame.camera;
        camera.camera_to_world.w_axis = map.transform_point3(camera.position()).extend(1.0);
        camera.near *= scale;
        if camera.projection == Projection::Orthographic {
            camera.focal /= scale;
        }
    }
    capture.density_scale /= scale;
    capture.lattice = capture.lattice.map(|lattice| map * lattice);
    capture
}

/// Returns the point with the least sum of squared distances to the cameras' axes.
fn target(capture: &Capture) -> Result<DVec3> {
    let (mut matrix, mut right) = (glam::DMat3::ZERO, DVec3::ZERO);
    let mut positions = Aabb::EMPTY;
    for frame in &capture.frames {
        let (forward, position) = (frame.camera.forward(), frame.camera.position());
        let across = glam::DMat3::IDENTITY
            - glam::DMat3::from_cols(forward * forward.x, forward * forward.y, forward * forward.z);
        matrix += across;
        right += across * position;
        positions = positions.including(position);
    }
    // The determinant of n views from all sides is near (2 n / 3)³; of parallel axes it is 0.
    let count = capture.frames.len() as f64;
    if matrix.determinant() < 1e-6 * count.powi(3) {
        return Err(Error::invalid("⟨recenter⟩: the cameras look along parallel lines, at no common point")
            .hint("give ⟨offset⟩ instead"));
    }
    Ok(matrix.inverse() * right)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::formats::transforms;

    #[test]
    fn a_moved_capture_shows_the_same() {
        let dir = tempfile::tempdir().unwrap();
        let json = r#"{"w": 4, "h": 4, "fl_x": 5, "near": 0.5, "density_scale": 3,
            "lattice": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]], "frames": [
            {"file_path": "a", "transform_matrix": [[1,0,0,2],[0,1,0,1],[0,0,1,9],[0,0,0,1]]},
            {"file_path": "b", "transform_matrix": [[0,0,1,9],[0,1,0,1],[-1,0,0,-1],[0,0,0,1]]}]}"#;
        std::fs::write(dir.path().join("transforms.json"), json).unwrap();
        let capture = transforms::load(dir.path()).unwrap();
        let placement = Placement { scale: Some(0.5), offset: Some([0.0, 0.0, 7.0]), recenter: true };
        // The axes meet at (2, 1, -1): along -z at x = 2, y = 1, and along -x at y = 1, z = -1.
        let map = placement.map(&capture).unwrap().unwrap();
        assert!((map.transform_point3(DVec3::new(2.0, 1.0, -1.0)) - DVec3::new(0.0, 0.0, 7.0)).length() < 1e-12);
        let after = moved(capture.clone(), map);
        let point = DVec3::new(1.7, 1.2, -0.4);
        for (a, b) in capture.frames.iter().zip(&after.frames) {
            let ((pixel, depth), (same, half)) =
                (a.camera.project(point).unwrap(), b.camera.project(map.transform_point3(point)).unwrap());
            assert!((pixel - same).length() < 1e-12 && (0.5 * depth - half).abs() < 1e-12);
        }
        assert_eq!((after.density_scale, after.frames[0].camera.near), (6.0, 0.25));
        assert_eq!(after.lattice.unwrap().x_axis.x, 0.5);
        let one = Capture { frames: capture.frames[..1].to_vec(), ..capture };
        assert!(placement.map(&one).is_err());
    }
}
