//! Normal equations of one camera: what its picture asks of its pose, and of the focal length.

use crate::scene::camera::{Camera, CameraGradient};
use glam::{DMat3, DVec3};
use nalgebra::{SMatrix, SVector};
use std::iter::Sum;

/// Rotation about the camera's right, up and back (radians), then position along them (in units of the distance to
/// what is seen): of like size in a picture.
pub type Pose = SVector<f64, 6>;
type Square = SMatrix<f64, 6, 6>;

/// Eigenvalues below this share of the largest say nothing: 32-bit densities leave errors of 1e-6 in derivatives, and
/// these are squared.
const SINGULAR: f64 = 1e-10;

/// Camera axes and the unit of position, fixed for one linearisation.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    axes: DMat3,
    focal: [f64; 2],
    distance: f64,
}

impl Frame {
    /// Creates the frame of a camera whose subject is at a distance, in world units.
    pub fn new(camera: &Camera, distance: f64) -> Self {
        Self { axes: DMat3::from_mat4(camera.camera_to_world), focal: camera.focal.to_array(), distance }
    }

    /// A derivative with respect to the pose, and to the logarithm of the focal length.
    pub fn derivative(&self, by: &CameraGradient) -> (Pose, f64) {
        let own = |v: DVec3| self.axes.transpose() * v;
        let (r, p) = (own(by.rotation), self.distance * own(by.position));
        (Pose::new(r.x, r.y, r.z, p.x, p.y, p.z), by.focal.x * self.focal[0] + by.focal.y * self.focal[1])
    }

    /// Returns the displacement of a camera from another one.
    pub(crate) fn displacement(&self, from: &Camera, to: &Camera) -> Pose {
        let own = |v: DVec3| self.axes.transpose() * v;
        let (r, p) = (own(from.rotation_to(to)), own(to.position() - from.position()) / self.distance);
        Pose::new(r.x, r.y, r.z, p.x, p.y, p.z)
    }

    /// The camera after a step of the pose and of the logarithm of the focal length.
    pub fn moved(&self, camera: &Camera, step: &Pose, focal: f64) -> Camera {
        let rotation = self.axes * DVec3::new(step[0], step[1], step[2]);
        let position = self.axes * (self.distance * DVec3::new(step[3], step[4], step[5]));
        let focal = camera.focal * focal.exp_m1();
        camera.moved(&CameraGradient { position, rotation, focal, ..CameraGradient::default() })
    }
}

/// Sums over the rows J of the Jacobian and what is left r: `Σ J Jᵀ`, `Σ J r`, `Σ r²`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Normal {
    matrix: Square,
    /// Of pose and focal length.
    cross: Pose,
    focal: f64,
    right: Pose,
    focal_right: f64,
    /// Sum of squared residuals.
    pub error: f64,
    /// Number of residuals.
    pub count: u64,
}

impl Normal {
    /// Adds a row.
    pub fn add(&mut self, (pose, focal): &(Pose, f64), residual: f64) {
        self.matrix.ger(1.0, pose, pose, 1.0);
        self.cross += *focal * pose;
        self.focal += focal * focal;
        self.right += residual * pose;
        self.focal_right += residual * focal;
        self.error += residual * residual;
        self.count += 1;
    }

    /// With a Gaussian prior of standard deviation `1 / √weight` around a pose that lies `displacement` behind.
    #[must_use]
    pub(crate) fn with_prior(mut self, displacement: &Pose, weight: f64) -> Self {
        self.matrix += weight * Square::identity();
        self.right -= weight * displacement;
        self.error += weight * displacement.norm_squared();
        self
    }

    /// Root of the mean squared residual; zero if there are none.
    pub fn rms(&self) -> f64 {
        (self.error / self.count.max(1) as f64).sqrt()
    }

    /// Splits the matrix.
    pub fn spectrum(&self) -> Spectrum {
        let split = self.matrix.symmetric_eigen();
        let largest = split.eigenvalues.max();
        Spectrum { vectors: split.eigenvectors, values: split.eigenvalues, least: SINGULAR * largest }
    }
}

impl Sum for Normal {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::default(), |a, b| Self {
            matrix: a.matrix + b.matrix,
            cross: a.cross + b.cross,
            focal: a.focal + b.focal,
            right: a.right + b.right,
            focal_right: a.focal_right + b.focal_right,
            error: a.error + b.error,
            count: a.count + b.count,
        })
    }
}

/// The directions in which a pose is known, and how well.
#[derive(Debug, Clone, Copy)]
pub struct Spectrum {
    vectors: Square,
    values: Pose,
    least: f64,
}

impl Spectrum {
    /// Largest eigenvalue: what damping is measured by.
    pub fn largest(&self) -> f64 {
        self.values.max()
    }

    /// Number of directions that the picture says nothing about.
    pub fn undetermined(&self) -> usize {
        self.values.iter().filter(|v| !self.determines(**v)).count()
    }

    fn determines(&self, value: f64) -> bool {
        value > self.least && value > 0.0
    }

    /// Solves with damping; what the picture says nothing about stays as it is.
    fn solve(&self, right: &Pose, damping: f64) -> Pose {
        let along = self.vectors.transpose() * right;
        let scaled = along.zip_map(&self.values, |a, v| if self.determines(v) { a / (v + damping) } else { 0.0 });
        self.vectors * scaled
    }
}

/// Steps of several cameras, and of the focal length that they share if it is to be found: their normal equations
/// are an arrow, solved by eliminating the poses (Levenberg's damping). Gives the steps, that of the focal length's
/// logarithm, and the decrease of the error that they predict.
pub fn steps(equations: &[(Normal, Spectrum)], damping: f64, with_focal: bool) -> (Vec<Pose>, f64, f64) {
    let focal = if with_focal {
        let (mut matrix, mut right) = (0.0, 0.0);
        for (normal, spectrum) in equations {
            let eliminated = spectrum.solve(&normal.cross, damping);
            matrix += normal.focal - normal.cross.dot(&eliminated);
            right += normal.focal_right - normal.right.dot(&eliminated);
        }
        let all: f64 = equations.iter().map(|(normal, _)| normal.focal).sum();
        if matrix > SINGULAR * all { right / (matrix + damping) } else { 0.0 }
    } else {
        0.0
    };
    let mut predicted = 0.0;
    let poses = equations
        .iter()
        .map(|(normal, spectrum)| {
            let step = spectrum.solve(&(normal.right - focal * normal.cross), damping);
            predicted += 2.0 * (step.dot(&normal.right) + focal * normal.focal_right)
                - step.dot(&(normal.matrix * step))
                - 2.0 * focal * step.dot(&normal.cross)
                - focal * focal * normal.focal;
            step
        })
        .collect();
    (poses, focal, predicted)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(count: usize, seed: f64) -> Vec<(Pose, f64)> {
        // Squares keep the rows from being combinations of a few.
        let value = |k: usize| (seed + 1.7 * (k * k) as f64).sin();
        (0..count).map(|i| (Pose::from_fn(|r, _| value(11 * i + r)), value(11 * i + 7))).collect()
    }

    #[test]
    fn a_linear_problem_is_solved_in_one_step() {
        let truth = [Pose::new(0.1, -0.2, 0.3, 0.05, 0.2, -0.1), Pose::new(-0.3, 0.1, 0.0, 0.2, -0.2, 0.4)];
        let equations: Vec<(Normal, Spectrum)> = truth
            .iter()
            .enumerate()
            .map(|(i, truth)| {
                let mut normal = Normal::default();
                for row in rows(40, i as f64) {
                    normal.add(&row, row.0.dot(truth) + 0.07 * row.1);
                }
                (normal, normal.spectrum())
            })
            .collect();
        let (poses, focal, predicted) = steps(&equations, 0.0, true);
        assert!((focal - 0.07).abs() < 1e-12);
        for (pose, truth) in poses.iter().zip(&truth) {
            assert!((pose - truth).norm() < 1e-12);
        }
        let error: f64 = equations.iter().map(|(normal, _)| normal.error).sum();
        assert!((predicted - error).abs() < 1e-12 * error, "all of the error is explained");
    }

    /// With the prior, the step leads to the minimum of the squares of residuals and displacement together.
    #[test]
    fn a_prior_draws_back() {
        let truth = Pose::new(0.1, -0.2, 0.3, 0.05, 0.2, -0.1);
        let displacement = Pose::new(-0.1, 0.2, 0.1, 0.0, 0.05, 0.3);
        let residuals = |step: Pose| rows(40, 2.0).into_iter().map(move |row| (row, row.0.dot(&(truth - step))));
        let at = |step: &Pose| {
            let mut normal = Normal::default();
            residuals(*step).for_each(|((pose, _), residual)| normal.add(&(pose, 0.0), residual));
            normal.with_prior(&(displacement + step), 7.0)
        };
        let normal = at(&Pose::zeros());
        let (poses, _, predicted) = steps(&[(normal, normal.spectrum())], 0.0, false);
        let least = at(&poses[0]).error;
        assert!((normal.error - least - predicted).abs() < 1e-9 * normal.error);
        for k in 0..6 {
            for sign in [-1e-3, 1e-3] {
                assert!(at(&(poses[0] + sign * Pose::ith(k, 1.0))).error > least);
            }
        }
    }

    #[test]
    fn what_is_not_seen_stays() {
        let mut normal = Normal::default();
        for (mut row, _) in rows(40, 0.0) {
            row[4] = -row[0];
            normal.add(&(row, 0.0), row[0]);
        }
        let spectrum = normal.spectrum();
        assert_eq!(spectrum.undetermined(), 1);
        let (poses, _, _) = steps(&[(normal, spectrum)], 0.0, true);
        // Of all that explain it, the shortest: half on each.
        assert!((poses[0] - Pose::new(0.5, 0.0, 0.0, 0.0, -0.5, 0.0)).norm() < 1e-9, "{}", poses[0]);
        let blank = Normal::default();
        assert_eq!(blank.spectrum().undetermined(), 6);
        assert_eq!(steps(&[(blank, blank.spectrum())], 0.0, true).0[0], Pose::zeros());
    }
}
