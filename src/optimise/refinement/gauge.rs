//! The gauge of cameras: what pictures do not tell, for the whole scene may be moved, turned and scaled with them.

use crate::scene::camera::Camera;
use glam::{DMat3, DMat4, DQuat, DVec3};
use nalgebra::{SMatrix, SVector};

/// Unknowns of a similarity: rotation, translation over the distance, and logarithm of the scale.
type Similarity = SVector<f64, 7>;

/// Linearisations, of which each leaves the square of what was left before.
const STEPS: usize = 4;

/// Moves all cameras by the one similarity about `centre` that brings them nearest to those of `given`: rotations in
/// radians and positions in units of the distance count alike, by least squares. What the cameras see of a volume that
/// is moved with them stays the same, but for its scale.
pub fn align(cameras: &mut [Camera], given: &[Camera], centre: DVec3) {
    for _ in 0..STEPS {
        let (mut matrix, mut right) = (SMatrix::<f64, 7, 7>::zeros(), Similarity::zeros());
        for (camera, given) in cameras.iter().zip(given) {
            let distance = given.position().distance(centre).max(f64::MIN_POSITIVE);
            let (turn, from) = (rotation(camera, given), (camera.position() - centre) / distance);
            let to = (given.position() - camera.position()) / distance;
            for (a, axis) in DVec3::AXES.into_iter().enumerate() {
                let mut rotated = Similarity::zeros();
                rotated[a] = 1.0;
                let lever = from.cross(axis);
                let along = axis / distance;
                let moved = Similarity::from([lever.x, lever.y, lever.z, along.x, along.y, along.z, from[a]]);
                for (row, residual) in [(rotated, turn[a]), (moved, to[a])] {
                    matrix.ger(1.0, &row, &row, 1.0);
                    right += residual * row;
                }
            }
        }
        // The scale of one camera, or the place of several at one point, is not determined; then all stays.
        let Some(step) = matrix.cholesky().map(|split| split.solve(&right)) else { return };
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(step[0], step[1], step[2])));
        let (shift, scale) = (DVec3::new(step[3], step[4], step[5]), step[6].exp());
        for camera in cameras.iter_mut() {
            let position = scale * (turn * (camera.position() - centre)) + centre + shift;
            let axes = turn * DMat3::from_mat4(camera.camera_to_world);
            camera.camera_to_world = DMat4::from_mat3_translation(axes, position);
        }
    }
}

/// The rotation that turns the axes of the camera `from` into those of `to`: a rotation vector along world axes.
pub fn rotation(from: &Camera, to: &Camera) -> DVec3 {
    let axes = |camera: &Camera| DMat3::from_mat4(camera.camera_to_world);
    DQuat::from_mat3(&(axes(to) * axes(from).transpose())).to_scaled_axis()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::orbit::{self, Layout};
    use crate::scene::up::Up;

    #[test]
    fn a_similarity_of_all_cameras_is_taken_back() {
        let given = orbit::cameras(&[DVec3::ZERO, DVec3::ONE], 12, Layout::Sphere, 32, 32, 40.0, Up::Z);
        let centre = DVec3::splat(0.5);
        let turn = DQuat::from_scaled_axis(DVec3::new(0.05, -0.1, 0.02));
        let mut moved: Vec<Camera> = given.clone();
        for camera in &mut moved {
            let position = 1.1 * (turn * (camera.position() - centre)) + DVec3::new(0.3, 0.4, -0.2);
            let axes = DMat3::from_quat(turn) * DMat3::from_mat4(camera.camera_to_world);
            camera.camera_to_world = DMat4::from_mat3_translation(axes, position);
        }
        align(&mut moved, &given, centre);
        for (a, b) in moved.iter().zip(&given) {
            assert!(a.camera_to_world.abs_diff_eq(b.camera_to_world, 1e-9), "{a:?} {b:?}");
        }
    }

    #[test]
    fn one_camera_stays_where_it_is() {
        let given = orbit::cameras(&[DVec3::ZERO, DVec3::ONE], 1, Layout::Ring, 32, 32, 40.0, Up::Z);
        let mut moved = given.clone();
        align(&mut moved, &given, DVec3::splat(0.5));
        assert!(moved[0].camera_to_world.abs_diff_eq(given[0].camera_to_world, 1e-12));
    }
}
