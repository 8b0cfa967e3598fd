//! The gauge of cameras: what pictures do not tell, for the whole scene may be moved, turned and scaled with them.

use crate::scene::camera::Camera;
use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use nalgebra::{SMatrix, SVector};

/// A similarity about a centre: rotation vector, translation in units of the region's size, logarithm of the scale.
type Similarity = SVector<f64, 7>;

/// Linearisations, of which each leaves about the square of what was left before.
const STEPS: usize = 4;
/// Step of the derivatives' central differences, in the units of a similarity.
const DIFFERENCE: f64 = 1e-5;
/// Eigenvalues below this share of the largest say nothing: one camera does not tell how far its scene is away.
const SINGULAR: f64 = 1e-9;

/// Moves all cameras by the one similarity by which they see `points` nearest to where the cameras of `given` see them,
/// by least squares in pixels. What they see of a volume that is moved with them stays the same but for its scale, so
/// that the volume that they tell lies where the given cameras have it.
pub fn align(cameras: &mut [Camera], given: &[Camera], points: &[DVec3]) {
    let centre = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let size = points.iter().map(|p| p.distance(centre)).fold(0.0, f64::max);
    for _ in 0..STEPS {
        let (mut matrix, mut right) = (SMatrix::<f64, 7, 7>::zeros(), Similarity::zeros());
        for (camera, given) in cameras.iter().zip(given) {
            for point in points {
                let seen = |by: &Similarity| camera.project(moved(*point, by, centre, size)).map(|(pixel, _)| pixel);
                let derivative = |k: usize| -> Option<DVec2> {
                    let [ahead, behind] = [DIFFERENCE, -DIFFERENCE].map(|step| {
                        let mut by = Similarity::zeros();
                        by[k] = step;
                        seen(&by)
                    });
                    Some((ahead? - behind?) / (2.0 * DIFFERENCE))
                };
                let rows: Option<Vec<DVec2>> = (0..7).map(derivative).collect();
                let (Some(rows), Some((to, _)), Some(from)) = (rows, given.project(*point), seen(&Similarity::zeros()))
                else {
                    continue;
                };
                for axis in 0..2 {
                    let row = Similarity::from_fn(|k, _| rows[k][axis]);
                    matrix.ger(1.0, &row, &row, 1.0);
                    right += (to - from)[axis] * row;
                }
            }
        }
        let spectrum = matrix.symmetric_eigen();
        let least = SINGULAR * spectrum.eigenvalues.max();
        let along = spectrum.eigenvectors.tr_mul(&right);
        let scaled = along.zip_map(&spectrum.eigenvalues, |a, v| if v > least && v > 0.0 { a / v } else { 0.0 });
        let step = spectrum.eigenvectors * scaled;
        // The points go to where they are seen rightly; the cameras go the other way.
        let turn = DMat3::from_quat(rotation_of(&step)).transpose();
        let (shift, scale) = (size * DVec3::new(step[3], step[4], step[5]), (-step[6]).exp());
        for camera in cameras.iter_mut() {
            let position = scale * (turn * (camera.position() - centre - shift)) + centre;
            let axes = turn * DMat3::from_mat4(camera.camera_to_world);
            camera.camera_to_world = DMat4::from_mat3_translation(axes, position);
        }
    }
}

fn rotation_of(similarity: &Similarity) -> DQuat {
    DQuat::from_scaled_axis(DVec3::new(similarity[0], similarity[1], similarity[2]))
}

fn moved(point: DVec3, by: &Similarity, centre: DVec3, size: f64) -> DVec3 {
    by[6].exp() * (rotation_of(by) * (point - centre)) + centre + size * DVec3::new(by[3], by[4], by[5])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Aabb;
    use crate::scene::orbit::{self, Layout};
    use crate::scene::up::Up;

    fn points() -> [DVec3; 8] {
        Aabb { min: DVec3::ZERO, max: DVec3::ONE }.inner_corners()
    }

    #[test]
    fn a_similarity_of_all_cameras_is_taken_back() {
        let given = orbit::cameras(&[DVec3::ZERO, DVec3::ONE], 12, Layout::Sphere, 32, 32, 40.0, Up::Z);
        let centre = DVec3::splat(0.5);
        let turn = DQuat::from_scaled_axis(DVec3::new(0.05, -0.1, 0.02));
        let mut moved: Vec<Camera> = given.clone();
        for camera in &mut moved {
            let position = 1.1 * (turn * (camera.position() - centre)) + centre + DVec3::new(0.03, 0.04, -0.02);
            let axes = DMat3::from_quat(turn) * DMat3::from_mat4(camera.camera_to_world);
            camera.camera_to_world = DMat4::from_mat3_translation(axes, position);
        }
        align(&mut moved, &given, &points());
        for (a, b) in moved.iter().zip(&given) {
            assert!(a.camera_to_world.abs_diff_eq(b.camera_to_world, 1e-6), "{a:?} {b:?}");
        }
    }

    /// Two directions of each camera nearly compensate each other in its picture: they do not move the scene.
    #[test]
    fn parallax_hardly_moves_the_scene() {
        let given = orbit::cameras(&[DVec3::ZERO, DVec3::ONE], 5, Layout::Ring, 32, 32, 20.0, Up::Z);
        let mut moved = given.clone();
        let right = moved[0].camera_to_world.x_axis.truncate();
        let distance = moved[0].position().distance(DVec3::splat(0.5));
        let up = moved[0].camera_to_world.y_axis.truncate();
        moved[0] = moved[0].moved(&crate::scene::camera::CameraGradient {
            position: 0.05 * distance * right,
            rotation: 0.05 * up,
            ..Default::default()
        });
        let before = moved[1].position();
        align(&mut moved, &given, &points());
        assert!(moved[1].position().distance(before) < 0.01 * distance, "{}", moved[1].position() - before);
    }

    #[test]
    fn one_camera_stays_where_it_is() {
        let given = orbit::cameras(&[DVec3::ZERO, DVec3::ONE], 1, Layout::Ring, 32, 32, 40.0, Up::Z);
        let mut moved = given.clone();
        align(&mut moved, &given, &points());
        assert!(moved[0].camera_to_world.abs_diff_eq(given[0].camera_to_world, 1e-12));
    }
}
