//! The active voxels of a grid as a list of values, and the fields that other values of them make.

use crate::error::Result;
use crate::real::Real;
use crate::scene::bricks::{BRICK, Bricks, Topology};
use crate::scene::dense::End;
use crate::scene::grid::{Grid, LEAF_VOXELS};
use crate::scene::topology::NONE;
use glam::IVec3;
use std::sync::Arc;

/// Active voxels of a grid. All others, and the background, keep the grid's values.
#[derive(Debug, Clone)]
pub struct Active {
    base: Bricks<f32>,
    /// Numbers of the active voxels among those that bricks own, 512 a brick, ascending.
    voxels: Vec<usize>,
}

impl Active {
    /// Creates the list of a grid's active voxels; `base` is the grid arranged in bricks with separate values.
    ///
    /// # Errors
    /// If there are more bricks than can be addressed.
    pub fn new(grid: &Grid, base: &Bricks<f32>, end: End) -> Result<Self> {
        let mut places = Vec::new();
        for leaf in grid.leaves.iter().filter(|leaf| leaf.active != [0; 8]) {
            places.push((IVec3::from_array(leaf.origin) >> 3, leaf.active));
        }
        for tile in grid.tiles.iter().filter(|tile| tile.active) {
            let (low, edge) = (IVec3::from_array(tile.origin) >> 3, tile.dim / 8);
            let offsets = (0..edge).flat_map(|x| (0..edge).flat_map(move |y| (0..edge).map(move |z| [x, y, z])));
            places.extend(offsets.map(|offset| (low + IVec3::from_array(offset), [u64::MAX; 8])));
        }
        // Values of a brick are corners of cells of the bricks below it, which must be there whatever the values are.
        let around = places.iter().flat_map(|(brick, _)| {
            (0..8).map(move |corner| *brick - IVec3::new(corner >> 2 & 1, corner >> 1 & 1, corner & 1))
        });
        let topology = Arc::new(Topology::new(base.topology.bricks().iter().copied().chain(around))?);
        let domain = if end == End::Fading { topology.bounds() } else { base.domain };
        let mut values = vec![base.background; topology.len() * BRICK];
        for (brick, values) in topology.bricks().iter().zip(values.chunks_mut(BRICK)) {
            if let Some(stored) = base.brick(*brick) {
                values.copy_from_slice(stored);
            }
        }
        let mut voxels = Vec::new();
        for (brick, active) in places {
            let number = topology.find(brick) as usize;
            let active = (0..LEAF_VOXELS).filter(|i| active[i >> 6] >> (i & 63) & 1 == 1);
            voxels.extend(active.map(|i| number * LEAF_VOXELS + i));
        }
        voxels.sort_unstable();
        Ok(Self { base: Bricks { topology, values, domain, ..base.clone() }, voxels })
    }

    /// Returns the number of active voxels.
    pub fn len(&self) -> usize {
        self.voxels.len()
    }

    /// True if no voxel is active.
    pub fn is_empty(&self) -> bool {
        self.voxels.is_empty()
    }

    /// Returns the bytes that a field of such voxels takes.
    pub fn bytes<V>(&self) -> u64 {
        (self.base.values.len() * size_of::<V>()) as u64
    }

    /// Returns the grid's values of the active voxels.
    pub fn values(&self) -> Vec<f32> {
        let reference = self.base.reference;
        let of = |voxel: &usize| (reference + f64::from(self.base.values[self.own(*voxel)])) as f32;
        self.voxels.iter().map(of).collect()
    }

    /// Returns the index coordinates of the active voxels.
    pub fn coordinates(&self) -> Vec<[i32; 3]> {
        let bricks = self.base.topology.bricks();
        let of = |voxel: &usize| (8 * bricks[voxel / LEAF_VOXELS] + local(*voxel)).to_array();
        self.voxels.iter().map(of).collect()
    }

    /// Returns the grid with other values of its active voxels, in their order.
    pub fn field<R: Real>(&self, values: &[R]) -> Bricks<R> {
        let Bricks { topology, background, reference, transform, domain, .. } = &self.base;
        let mut stored: Vec<R> = self.base.values.iter().map(|v| R::of(f64::from(*v))).collect();
        for (voxel, value) in self.voxels.iter().zip(values) {
            // The data's values are stored as differences to their reference.
            let value = if *reference == 0.0 { *value } else { R::of(value.f64() - reference) };
            topology.slots(*voxel).into_iter().flatten().for_each(|slot| stored[slot] = value);
        }
        Bricks {
            topology: Arc::clone(topology),
            values: stored,
            background: R::of(f64::from(*background)),
            reference: *reference,
            transform: *transform,
            domain: *domain,
        }
    }

    /// Adds derivatives with respect to stored values onto the active voxels: the transpose of [`Active::field`].
    pub fn gather<R: Real>(&self, stored: &[R]) -> Vec<R> {
        let sum = |voxel: &usize| {
            let slots = self.base.topology.slots(*voxel).into_iter().flatten();
            slots.fold(R::ZERO, |sum, slot| sum + stored[slot])
        };
        self.voxels.iter().map(sum).collect()
    }

    /// Place of an owned voxel among the stored values of its brick.
    fn own(&self, voxel: usize) -> usize {
        self.base.topology.slots(voxel)[0].unwrap_or(NONE as usize)
    }
}

/// Coordinates of an owned voxel within its brick.
fn local(voxel: usize) -> IVec3 {
    let i = (voxel % LEAF_VOXELS) as i32;
    IVec3::new(i >> 6, i >> 3 & 7, i & 7)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::math::Affine;
    use crate::scene::grid::{GridClass, Leaf, Tile, voxel_offset};
    use glam::{DMat4, DVec3};

    fn grid() -> Grid {
        let mut leaf = Leaf { origin: [8, 0, -8], values: [0.0; LEAF_VOXELS], active: [0; 8] };
        for (i, at) in [[0, 0, 0], [3, 4, 5], [7, 7, 7]].into_iter().enumerate() {
            let offset = voxel_offset(at);
            leaf.values[offset] = 1.0 + i as f32;
            leaf.active[offset >> 6] |= 1 << (offset & 63);
        }
        Grid {
            name: "density".into(),
            class: GridClass::FogVolume,
            transform: Affine::new(DMat4::IDENTITY).unwrap(),
            background: 0.0,
            leaves: vec![leaf],
            tiles: vec![Tile { origin: [16, 8, 0], dim: 8, value: 0.5, active: true }],
            metadata: std::collections::BTreeMap::default(),
        }
    }

    #[test]
    fn fields_of_the_grids_own_values_are_the_grid() {
        let grid = grid();
        let base = Bricks::<f32>::from_grid(&grid, u64::MAX).unwrap();
        let active = Active::new(&grid, &base, End::Fading).unwrap();
        assert_eq!(active.len(), 3 + LEAF_VOXELS);
        let field = active.field(&active.values());
        for at in [[11.0, 4.0, -3.0], [8.0, 0.0, -8.0], [15.5, 7.0, -1.0], [16.0, 8.0, 0.0], [23.5, 15.0, 7.0]] {
            let at = DVec3::from_array(at);
            assert_eq!(field.sample(at), base.sample(at), "{at}");
        }
        let moved: Vec<f64> = (0..active.len()).map(|i| 1.0 + i as f64).collect();
        let field = active.field(&moved);
        for (at, value) in active.coordinates().into_iter().zip(&moved) {
            assert_eq!(field.sample(IVec3::from_array(at).as_dvec3()), *value, "{at:?}");
        }
        let weights: Vec<f64> = (0..field.values.len()).map(|i| ((5 * i) % 17) as f64).collect();
        let along: f64 = field.values.iter().zip(&weights).map(|(v, w)| v * w).sum();
        let back: f64 = moved.iter().zip(active.gather(&weights)).map(|(v, w)| v * w).sum();
        assert_eq!(along, back);
    }
}
