//! Adjacency of bricks and of their voxels, 512 a brick.

use crate::scene::bricks::{NONE, Topology};
use crate::scene::grid::LEAF_VOXELS;
use glam::IVec3;

/// Distance of neighbours along x, y, z in a brick.
const STRIDES: [usize; 3] = [64, 8, 1];

/// Face neighbours of the bricks and voxels of a topology.
#[derive(Debug, Clone)]
pub struct Neighbours(Vec<[[u32; 2]; 3]>);

impl Neighbours {
    /// Looks up the neighbours of each brick of a topology.
    pub fn new(topology: &Topology) -> Self {
        let adjacent =
            |b: &IVec3| [IVec3::X, IVec3::Y, IVec3::Z].map(|a| [topology.find(*b - a), topology.find(*b + a)]);
        Self(topology.bricks().iter().map(adjacent).collect())
    }

    /// Returns the numbers of the bricks below and above a brick along an axis, or [`NONE`].
    pub(crate) fn of_brick(&self, brick: usize, axis: usize) -> [u32; 2] {
        self.0[brick][axis]
    }

    /// Returns the voxels below and above along x, y and z; `None` outside of the bricks.
    pub(crate) fn of_voxel(&self, voxel: usize) -> [Option<usize>; 6] {
        let (brick, i) = (voxel / LEAF_VOXELS, voxel % LEAF_VOXELS);
        std::array::from_fn(|k| {
            let (axis, up) = (k / 2, k % 2 == 1);
            let stride = STRIDES[axis];
            let at = (i / stride) & 7;
            match (at, up) {
                (0, false) | (7, true) => {
                    let other = self.0[brick][axis][usize::from(up)];
                    let neighbour = if up { i - 7 * stride } else { i + 7 * stride };
                    (other != NONE).then(|| other as usize * LEAF_VOXELS + neighbour)
                }
                (_, true) => Some(voxel + stride),
                (_, false) => Some(voxel - stride),
            }
        })
    }
}
