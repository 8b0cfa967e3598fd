//! Bound of the work of a comparison, and its progress.

use crate::scene::grid::LEAF_VOXELS;

/// Bound of the work of a comparison of volumes on different lattices. (On one lattice all voxels are always compared,
/// which takes a fraction of the time.)
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effort {
    /// Largest number of blocks of 8³ voxels that are compared voxel by voxel.
    pub(super) blocks: usize,
}

impl Effort {
    /// All voxels.
    pub const ALL: Self = Self { blocks: usize::MAX };

    /// About so many voxels, one block of 8³ at least.
    pub fn voxels(count: u64) -> Self {
        Self { blocks: usize::try_from(count / LEAF_VOXELS as u64).unwrap_or(usize::MAX).max(1) }
    }
}

/// Receives how many of how many steps of a comparison are done.
pub type OnStep<'s> = &'s (dyn Fn(u64, u64) + Sync);
