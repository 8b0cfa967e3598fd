//! Gradient of a density, for the normals of its surfaces.

use crate::scene::bricks::Bricks;
use glam::{DMat3, DVec3};

/// Returns the gradient of the density per world length at an index position, by differences over a voxel to each side:
/// the derivative of the interpolated density jumps between cells, and shading would show them.
///
/// With a `scale`, a standard deviation in voxels, it is that of the density filtered by the binomial kernel
/// `(1, 2, 1) / 4` along the other axes, and by differences as far apart (the operator of Sobel in three dimensions,
/// stretched): the noise of a scan is averaged out of it.
pub(crate) fn gradient(field: &Bricks<f32>, index: DVec3, scale: f64) -> DVec3 {
    let by_index = if scale > 0.0 { filtered(field, index, scale) } else { differences(field, index) };
    // Gradients are covectors: the transpose of the inverse map takes them to world space.
    DMat3::from_mat4(field.transform.inverse_matrix()).transpose() * by_index
}

fn differences(field: &Bricks<f32>, index: DVec3) -> DVec3 {
    let slope = |axis: DVec3| 0.5 * f64::from(field.sample(index + axis) - field.sample(index - axis));
    DVec3::from_array(DVec3::AXES.map(slope))
}

fn filtered(field: &Bricks<f32>, index: DVec3, scale: f64) -> DVec3 {
    // The binomial kernel has a variance of half its spacing squared.
    let spacing = std::f64::consts::SQRT_2 * scale;
    let mut sum = DVec3::ZERO;
    for place in 0..27 {
        let offset = glam::IVec3::new(place / 9 - 1, place / 3 % 3 - 1, place % 3 - 1);
        let smooth = offset.abs().to_array().map(|away| if away == 0 { 0.5 } else { 0.25 });
        if offset == glam::IVec3::ZERO {
            continue;
        }
        let offset = offset.as_dvec3();
        let value = f64::from(field.sample(index + spacing * offset));
        let [x, y, z] = smooth;
        sum += value * offset * DVec3::new(y * z, x * z, x * y);
    }
    sum / (2.0 * spacing)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::math::Affine;
    use crate::scene::bricks::Topology;
    use glam::IVec3;
    use std::sync::Arc;

    /// Of a linear density the gradient is exact, in a voxel that is no cube, at every scale.
    #[test]
    fn linear_densities_have_their_slope() {
        let all = (0..64).map(|i| IVec3::new(i / 16, i / 4 % 4, i % 4));
        let matrix = glam::DMat4::from_scale(DVec3::new(0.5, 2.0, 1.0));
        let topology = Arc::new(Topology::new(all).unwrap());
        let mut field = Bricks::<f32>::zeros(topology.clone(), Affine::new(matrix).unwrap());
        let slope = DVec3::new(0.3, -0.2, 0.7);
        field.values = (0..topology.len())
            .flat_map(|brick| {
                let origin = 8 * topology.bricks()[brick];
                (0..729).map(move |i| {
                    let at = origin + IVec3::new(i / 81, i / 9 % 9, i % 9);
                    (5.0 + slope.dot(at.as_dvec3())) as f32
                })
            })
            .collect();
        for scale in [0.0, 0.5, 2.0] {
            let found = gradient(&field, DVec3::new(15.3, 14.1, 16.9), scale);
            let wanted = slope / DVec3::new(0.5, 2.0, 1.0);
            assert!((found - wanted).length() < 1e-5, "{scale}: {found} {wanted}");
        }
    }
}
