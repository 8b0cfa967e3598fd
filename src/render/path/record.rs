//! What a path meets, in order, for derivatives by what it is made of.

use glam::Vec3;

/// Event of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum PathEvent {
    /// A collision with a medium of this density, of whose extinction the albedo is scattered.
    Scattered {
        /// Density of the medium.
        density: f32,
    },
    /// Light that reaches the camera along the path so far.
    Arrived(Vec3),
    /// Light of the source that a collision with a medium of this density sends along the path so far, of which the
    /// share that is not scattered is emitted.
    Emitted {
        /// Density of the medium.
        density: f32,
        /// Light before that share.
        light: Vec3,
    },
}
