//! Arrays of all voxels of a box as fields.
//!
//! An array has the shape [nx, ny, nz], its last axis is the fastest, and its entry [i, j, k] is the value at the
//! centre of the voxel with index coordinates (i, j, k).

use crate::error::{Error, Result};
use crate::math::{Aabb, Affine};
use crate::scene::bricks::{BRICK, Bricks, CELLS, EDGE, Topology, Voxel, slot};
use crate::scene::topology;
use glam::IVec3;
use rayon::prelude::*;
use std::sync::Arc;

/// Bricks of the voxels of a box.
#[derive(Debug, Clone)]
pub struct Dense {
    shape: [usize; 3],
    transform: Affine,
    topology: Arc<Topology>,
    /// Index-space box outside which the medium is empty.
    domain: Aabb,
    /// Brick coordinates of the lowest brick, and the number of bricks along each axis.
    low: i32,
    count: [usize; 3],
}

/// How a field ends at the outermost voxels of its box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Values fall to 0 within one voxel, as in a grid whose other voxels are 0.
    Fading,
    /// The medium ends at the outermost voxels' centres, since a transfer function may show the values beyond them.
    Cut,
}

impl Dense {
    /// Creates the bricks of an array of this shape; `transform` maps index coordinates to the world.
    ///
    /// # Errors
    /// If an axis has no voxel, or there are more than can be addressed.
    pub fn new(shape: [usize; 3], transform: Affine, end: End) -> Result<Self> {
        if shape.contains(&0) {
            return Err(Error::invalid(format!("an array of shape {shape:?} has no voxels"))
                .hint("give one of three axes, x, y and z, each of one voxel or more"));
        }
        let many = || {
            Error::unsupported(format!("an array of shape {shape:?} has more voxels than can be addressed"))
                .hint("give a part of it, or a coarser one")
        };
        // The cells below the first voxels, in which values rise from 0, belong to bricks of their own.
        let low = if end == End::Fading { -1 } else { 0 };
        let beyond = shape.map(|n| if end == End::Fading { n.div_ceil(CELLS) } else { (n - 1).div_ceil(CELLS).max(1) });
        let count = beyond.map(|n| n + usize::from(end == End::Fading));
        let bricks = count.iter().try_fold(1_usize, |product, n| product.checked_mul(*n)).ok_or_else(many)?;
        topology::addressable(bricks).map_err(|_| many())?;
        let all = (0..bricks).map(|i| {
            let [_, y, z] = count;
            IVec3::from_array([i / (y * z), i / z % y, i % z].map(|v| v as i32)) + low
        });
        let topology = Arc::new(Topology::new(all)?);
        let domain = match end {
            End::Fading => topology.bounds(),
            End::Cut => Aabb { min: glam::DVec3::ZERO, max: glam::DVec3::from_array(shape.map(|n| (n - 1) as f64)) },
        };
        Ok(Self { shape, transform, topology, domain, low, count })
    }

    /// Returns the number of voxels along each axis.
    pub fn shape(&self) -> [usize; 3] {
        self.shape
    }

    /// Returns the bytes that a field of such voxels takes.
    pub fn bytes<V>(&self) -> u64 {
        (self.topology.len() * BRICK * size_of::<V>()) as u64
    }

    /// Arranges the values of all voxels, in the array's order, in bricks; beyond them lies 0. `voxel` converts a
    /// value. The field lies in `memory`, if that is what a field of these bricks had before.
    pub fn field<T: Copy + Sync, V: Voxel>(
        &self,
        values: &[T],
        voxel: impl Fn(T) -> V + Sync,
        memory: Vec<V>,
    ) -> Bricks<V> {
        let all = self.topology.len() * BRICK;
        let mut field = Bricks {
            topology: Arc::clone(&self.topology),
            values: if memory.len() == all { memory } else { vec![V::default(); all] },
            background: V::default(),
            reference: 0.0,
            transform: self.transform,
            domain: self.domain,
        };
        let [_, ny, nz] = self.shape;
        let within = |at: i32, axis: usize| usize::try_from(at).ok().filter(|at| *at < self.shape[axis]);
        field.values.par_chunks_mut(BRICK).zip(self.topology.bricks().par_iter()).for_each(|(out, brick)| {
            let first = CELLS as i32 * *brick;
            let from = first.z.max(0);
            let length = (nz as i64 - i64::from(from)).min(i64::from(first.z) + EDGE as i64 - i64::from(from));
            let Some(length) = usize::try_from(length).ok().filter(|length| *length > 0) else { return };
            for x in 0..EDGE {
                let Some(i) = within(first.x + x as i32, 0) else { continue };
                for y in 0..EDGE {
                    let Some(j) = within(first.y + y as i32, 1) else { continue };
                    let row = (i * ny + j) * nz + from as usize;
                    let to = slot(x, y, (from - first.z) as usize);
                    let (out, row) = (&mut out[to..to + length], &values[row..row + length]);
                    // Most rows are whole, and quick as such.
                    match (out.as_chunks_mut::<EDGE>().0, row.as_chunks::<EDGE>().0) {
                        ([out], [row]) => *out = row.map(&voxel),
                        _ => out.iter_mut().zip(row).for_each(|(out, value)| *out = voxel(*value)),
                    }
                }
            }
        });
        field
    }

    /// Adds derivatives with respect to stored values onto the voxels, in the array's order: the transpose of
    /// [`Dense::field`].
    pub fn gather<V: Voxel>(&self, stored: &[V]) -> Vec<V> {
        let [nx, ny, nz] = self.shape;
        let mut out = vec![V::default(); nx * ny * nz];
        let [_, by, bz] = self.count;
        // Bricks that store an index, and where in them it stands.
        let places = |at: usize, axis: usize| {
            let (brick, local) = ((at / CELLS) as i32 - self.low, at % CELLS);
            let own = usize::try_from(brick).ok().filter(|b| *b < self.count[axis]).map(|b| (b, local));
            let below = (local == 0 && brick > 0).then(|| (brick as usize - 1, CELLS));
            own.into_iter().chain(below)
        };
        out.par_chunks_mut((ny * nz).max(1)).enumerate().for_each(|(i, plane)| {
            for (bx, x) in places(i, 0) {
                for j in 0..ny {
                    let row = &mut plane[j * nz..(j + 1) * nz];
                    for (bj, y) in places(j, 1) {
                        for b in 0..bz {
                            let number = (bx * by + bj) * bz + b;
                            let first = CELLS as i64 * (b as i64 + i64::from(self.low));
                            let (from, to) = (first.max(0) as usize, nz.min((first + EDGE as i64) as usize));
                            let at = number * BRICK + slot(x, y, (from as i64 - first) as usize);
                            let stored = &stored[at..][..to.saturating_sub(from)];
                            // Most rows are whole, and quick as such.
                            match (stored.as_chunks::<EDGE>().0, row[from..from + stored.len()].as_chunks_mut().0) {
                                ([stored], [sums]) => add::<V>(sums, stored),
                                _ => row[from..].iter_mut().zip(stored).for_each(|(sum, v)| *sum += *v),
                            }
                        }
                    }
                }
            }
        });
        out
    }
}

/// Adds a row of a brick.
#[inline(always)]
fn add<V: Voxel>(sums: &mut [V; EDGE], stored: &[V; EDGE]) {
    sums.iter_mut().zip(stored).for_each(|(sum, v)| *sum += *v);
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use glam::{DMat4, DVec3};

    fn affine() -> Affine {
        Affine::new(DMat4::IDENTITY).unwrap()
    }

    /// Every voxel is found where it lies, and what lies beyond is 0.
    #[test]
    fn fields_have_the_values_of_their_array() {
        for shape in [[1, 1, 1], [2, 8, 9], [17, 3, 16], [8, 8, 8]] {
            let count: usize = shape.iter().product();
            let values: Vec<f64> = (0..count).map(|i| 1.0 + i as f64).collect();
            for end in [End::Fading, End::Cut] {
                let field = Dense::new(shape, affine(), end).unwrap().field(&values, |v| v, Vec::new());
                for (i, value) in values.iter().enumerate() {
                    let [_, ny, nz] = shape;
                    let at = [i / (ny * nz), i / nz % ny, i % nz];
                    let at = DVec3::from_array(at.map(|v| v as f64));
                    // On the upper faces a cut field has no cells: its rays end there.
                    let last = DVec3::from_array(shape.map(|n| (n - 1) as f64));
                    if end == End::Fading || at.cmplt(last).all() {
                        assert_eq!(field.sample(at), *value, "{shape:?} {end:?} {at}");
                    }
                }
                // Rays end on faces, give or take a rounding.
                let last = DVec3::from_array(shape.map(|n| (n - 1) as f64));
                for (at, value) in [(DVec3::splat(-1e-17), values[0]), (last + 1e-15, values[count - 1])] {
                    assert!(end == End::Fading || (field.sample_at_end(at) - value).abs() < 1e-12, "{shape:?} {at}");
                }
                if end == End::Fading {
                    assert_eq!(field.sample(DVec3::splat(-0.5)), 0.125, "half a voxel beside a corner of 1");
                }
            }
        }
        assert!(Dense::new([4, 0, 4], affine(), End::Cut).is_err());
        assert!(Dense::new([1 << 20; 3], affine(), End::Cut).is_err());
        assert!(Dense::new([usize::MAX; 3], affine(), End::Fading).is_err());
    }

    /// `⟨field(v), w⟩ = ⟨v, gather(w)⟩`.
    #[test]
    fn gathering_is_the_transpose_of_arranging() {
        for shape in [[1, 1, 1], [2, 8, 9], [17, 3, 16], [9, 24, 7]] {
            for end in [End::Fading, End::Cut] {
                let dense = Dense::new(shape, affine(), end).unwrap();
                let count: usize = shape.iter().product();
                let values: Vec<f64> = (0..count).map(|i| ((7 * i) % 13) as f64).collect();
                let field = dense.field(&values, |v| v, Vec::new());
                let weights: Vec<f64> = (0..field.values.len()).map(|i| ((5 * i) % 17) as f64).collect();
                let along: f64 = field.values.iter().zip(&weights).map(|(v, w)| v * w).sum();
                let back: f64 = values.iter().zip(dense.gather(&weights)).map(|(v, w)| v * w).sum();
                assert_eq!(along, back, "{shape:?} {end:?}");
            }
        }
    }
}
