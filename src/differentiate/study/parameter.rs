//! Parameters by name: what a study of gradients differentiates by, one at a time.

use crate::differentiate::gradient::views::{ActiveParameters, Direction, Gradient};
use crate::differentiate::study::subject::Subject;
use crate::render::differentiable::ParameterGradient;
use crate::scene::bricks::{Bricks, Topology};
use crate::scene::camera::{Camera, CameraGradient};
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::transfer::Transfer;
use glam::IVec3;

/// A number that pictures depend on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parameter {
    /// The quadrature's step, in voxels.
    Step,
    /// Part of a view's camera: one of [`CAMERA`].
    Camera {
        /// The view's number.
        view: usize,
        /// Number of the part.
        part: usize,
    },
    /// Number of one of the transfer function's [`parameters`](Transfer::parameters).
    Transfer(usize),
    /// One of the numbers that a voxel is made of.
    Voxel {
        /// The voxel's number among those that bricks own, 512 a brick.
        voxel: usize,
        /// The number's, among the [`CHANNELS`](Subject::CHANNELS).
        channel: usize,
    },
    /// A color channel of the background.
    Background(usize),
    /// Extinction per unit of density.
    Extinction,
}

/// Parts of a camera: world units, radians about world axes, the camera's unit of focal lengths, pixels.
pub const CAMERA: [&str; 10] = [
    "position.x",
    "position.y",
    "position.z",
    "rotation.x",
    "rotation.y",
    "rotation.z",
    "focal.x",
    "focal.y",
    "centre.x",
    "centre.y",
];

/// A step in one part of a camera.
pub(crate) fn camera_step(part: usize, by: f64) -> CameraGradient {
    let mut step = CameraGradient::default();
    match part {
        0..3 => step.position[part] = by,
        3..6 => step.rotation[part - 3] = by,
        6..8 => step.focal[part - 6] = by,
        _ => step.centre[part - 8] = by,
    }
    step
}

fn camera_part(of: &CameraGradient, part: usize) -> f64 {
    match part {
        0..3 => of.position[part],
        3..6 => of.rotation[part - 3],
        6..8 => of.focal[part - 6],
        _ => of.centre[part - 8],
    }
}

/// Value of a part: a rotation is measured from where the camera is.
pub(crate) fn camera_value(camera: &Camera, part: usize) -> f64 {
    let (position, rotation) = (camera.position(), glam::DVec3::ZERO);
    camera_part(&CameraGradient { position, rotation, focal: camera.focal, centre: camera.centre }, part)
}

/// Index coordinates of an owned voxel.
pub(crate) fn coordinates(topology: &Topology, voxel: usize) -> IVec3 {
    let i = (voxel % LEAF_VOXELS) as i32;
    8 * topology.bricks()[voxel / LEAF_VOXELS] + IVec3::new(i >> 6, i >> 3 & 7, i & 7)
}

/// Parameters that a gradient must hold for these derivatives, and all voxels if `voxels` is true.
pub(crate) fn active_parameters(parameters: &[Parameter], voxels: bool, knots: Option<usize>) -> ActiveParameters {
    let any = |f: fn(&Parameter) -> bool| parameters.iter().any(f);
    ActiveParameters {
        voxels: voxels || any(|p| matches!(p, Parameter::Voxel { .. })),
        knots: knots.filter(|_| any(|p| matches!(p, Parameter::Transfer(_)))),
        rays: any(|p| matches!(p, Parameter::Camera { .. } | Parameter::Step)),
    }
}

/// A parameter's derivative in a gradient; `by_transfer` is by the transfer function's parameters.
pub(crate) fn derivative<V: Subject>(
    of: &Gradient<V>,
    topology: &Topology,
    by_transfer: &[f64],
    parameter: Parameter,
) -> f64 {
    match parameter {
        Parameter::Step => of.step,
        Parameter::Camera { view, part } => camera_part(&of.cameras[view], part),
        Parameter::Transfer(i) => by_transfer[i],
        Parameter::Voxel { voxel, channel } => {
            topology.slots(voxel).into_iter().flatten().map(|slot| of.voxels[slot].channel(channel)).sum()
        }
        Parameter::Background(c) => of.shared.background[c],
        Parameter::Extinction => of.shared.extinction,
    }
}

/// The direction in which a parameter alone changes.
///
/// # Errors
/// If the transfer function has no table.
pub(crate) fn direction<V: Subject>(
    parameter: Parameter,
    field: &Bricks<V>,
    transfer: Option<&Transfer>,
) -> crate::error::Result<Direction<V>> {
    let shared = ParameterGradient::default();
    Ok(match parameter {
        Parameter::Step => Direction::Step(1.0),
        Parameter::Camera { view, part } => Direction::Camera(view, camera_step(part, 1.0)),
        Parameter::Transfer(i) => match transfer {
            Some(transfer) => {
                let mut one = vec![0.0; i + 1];
                one[i] = 1.0;
                Direction::Table(transfer.push(&one)?)
            }
            None => Direction::Shared(shared),
        },
        Parameter::Voxel { voxel, channel } => {
            let mut stored = vec![V::default(); field.values.len()];
            let one = V::default().with(channel, 1.0);
            field.topology.slots(voxel).into_iter().flatten().for_each(|slot| stored[slot] = one);
            Direction::Voxels(stored)
        }
        Parameter::Background(c) => {
            let mut background = [0.0; 3];
            background[c] = 1.0;
            Direction::Shared(ParameterGradient { background, ..shared })
        }
        Parameter::Extinction => Direction::Shared(ParameterGradient { extinction: 1.0, ..shared }),
    })
}
