//! Surfaces of grids as meshes, and level sets of meshes, by OpenVDB's `volumeToMesh` and `meshToVolume`.

use super::ffi;
use super::native::NativeGrid;
use crate::error::{Code, Error, Result};
use crate::formats::mesh::Mesh;
use crate::text::bytes as human;
use glam::{DMat3, DVec3};
use std::collections::HashSet;
use std::ptr::{NonNull, null_mut};

/// Bytes for each cell that a surface passes: its point and polygons on either side of the border, with what the
/// extraction keeps beside them.
const CELL_BYTES: f64 = 320.0;
/// Bytes for each leaf that a surface passes: the signs of its cells, and their places among the points.
const SIGN_LEAF_BYTES: f64 = 8192.0;
/// Bytes for each leaf of a narrow band: distances and numbers of polygons, of a thread and of all, and a copy of the
/// distances.
const BAND_LEAF_BYTES: u64 = 2 * 2 * 2208 + 2048;
/// Bytes of the nodes above leaves, of 128 and 4096 voxels' edge, in each of six trees.
const NODE_BYTES: [u64; 2] = [6 * 38_000, 6 * 270_000];
/// Largest index of a voxel, beyond which indices of 32 bits do not reach.
const FARTHEST: f64 = (1 << 30) as f64;

/// A surface on the native side.
struct Surface(NonNull<ffi::RawSurface>);

impl Drop for Surface {
    /// Frees points and polygons.
    fn drop(&mut self) {
        // SAFETY: owned, and freed once.
        unsafe { ffi::surface_free(self.0.as_ptr()) }
    }
}

impl NativeGrid {
    /// Returns the surface on which the grid has the value `iso`, in world space: quads, and triangles where
    /// `adaptivity`, from 0 to 1, lets OpenVDB merge flat parts. Corners run counterclockwise as seen from outside,
    /// which is where values are below `iso`, or above with `below_inside`, as in level sets.
    ///
    /// # Errors
    /// If the grid holds neither floats nor doubles, its transform is not affine, or values beside the surface are NaN
    /// or infinite.
    pub fn isosurface(&self, iso: f64, adaptivity: f64, below_inside: bool) -> Result<Mesh> {
        let map = self.info()?.affine()?;
        let mut raw = null_mut();
        // SAFETY: the grid is alive and `raw` a valid place for the handle.
        ffi::call(|s| unsafe { ffi::surface_new(self.as_ptr(), iso, adaptivity, &mut raw, s) })
            .map_err(self.named())?;
        let surface = Surface(NonNull::new(raw).ok_or_else(|| Error::native("no surface handle"))?);
        let mut counts = ffi::SurfaceCounts::default();
        // SAFETY: the handle is alive and `counts` a valid place.
        ffi::call(|s| unsafe { ffi::surface_count(surface.0.as_ptr(), &mut counts, s) })?;
        if counts.finite == 0 {
            return Err(self.named()(
                Error::invalid("values beside the surface are NaN or infinite, so that it has no place there")
                    .hint("set them to 0 first, from VDB to VDB: ⟨convert.repair⟩"),
            ));
        }
        if counts.points > u32::MAX as usize || (3 * counts.triangles + 4 * counts.quads) > u32::MAX as usize {
            return Err(self.named()(
                Error::unsupported(format!("the surface has {} points, more than meshes can number", counts.points))
                    .hint("resample the grid to larger voxels first: ⟨convert.resample⟩"),
            ));
        }
        let mirrored = DMat3::from_mat4(map.matrix()).determinant() < 0.0;
        let (mut points, mut triangles, mut quads) =
            (vec![[0.0_f64; 3]; counts.points], vec![[0_u32; 3]; counts.triangles], vec![[0_u32; 4]; counts.quads]);
        // SAFETY: the arrays have the lengths that `counts` says.
        ffi::call(|s| unsafe {
            ffi::surface_copy(
                surface.0.as_ptr(),
                &counts,
                (mirrored != below_inside).into(),
                points.as_mut_ptr(),
                triangles.as_mut_ptr(),
                quads.as_mut_ptr(),
                s,
            )
        })?;
        drop(surface);
        let vertices = points.into_iter().map(|p| map.to_world(DVec3::from_array(p))).collect();
        let corners = quads.iter().flatten().chain(triangles.iter().flatten()).copied().collect();
        let lengths = quads.iter().map(|_| 4).chain(triangles.iter().map(|_| 3));
        let ends = lengths.scan(0, |end, length| {
            *end += length;
            Some(*end)
        });
        Ok(Mesh { vertices, corners, ends: ends.collect() })
    }

    /// Estimate of the bytes that [`NativeGrid::isosurface`] needs beside the grid itself.
    ///
    /// # Errors
    /// If the grid has no values (points).
    pub(crate) fn isosurface_bytes(&self, iso: f64) -> Result<u64> {
        let passed = self.passed(iso)?;
        let bytes = passed.leaves * SIGN_LEAF_BYTES + passed.cells * CELL_BYTES;
        Ok(bytes.min(1e18) as u64 + (1 << 20))
    }

    /// Makes a level set of a closed mesh: floats on cubic voxels of edge `voxel` in world units, of which voxel
    /// (0, 0, 0) has its centre at the origin, with distances up to `half_width` voxels to either side of the surface.
    /// What no way leads to from outside is inside, so that cavities are filled.
    ///
    /// # Errors
    /// If the band needs more than `max_memory` bytes, the mesh spans more voxels than there are indices, or OpenVDB
    /// reports an error.
    pub(crate) fn from_mesh(mesh: &Mesh, voxel: f64, half_width: f32, name: &str, max_memory: u64) -> Result<Self> {
        let points: Vec<[f64; 3]> = mesh.vertices.iter().map(|v| (*v / voxel).to_array()).collect();
        let corners = mesh.at_most_quads();
        band_bytes(&points, &corners, f64::from(half_width), max_memory).map_err(|found| {
            let error = match found {
                Refusal::Far => {
                    Error::unsupported(format!("voxels of {voxel} are too small for a mesh of this extent"))
                }
                Refusal::Memory => {
                    let left = human(max_memory);
                    Error::unsupported(format!("the narrow band needs more than the {left} that are left for it"))
                        .coded(Code::MemoryLimit)
                }
            };
            error.hint("choose a larger ⟨voxel_size⟩ or a smaller ⟨half_width⟩, or raise ⟨max_memory⟩")
        })?;
        let polygons = ffi::Polygons {
            points: points.as_ptr(),
            point_count: points.len(),
            corners: corners.as_ptr(),
            polygon_count: corners.len(),
        };
        let mut raw = null_mut();
        // SAFETY: the arrays have the lengths that `polygons` says, all corners are numbers of points, or the mark of a
        // triangle, and `raw` is a valid place for the handle.
        ffi::call(|s| unsafe { ffi::grid_from_polygons(&polygons, voxel, half_width, &mut raw, s) })?;
        // SAFETY: fresh from the shim.
        let mut made = unsafe { Self::own(raw, name.to_owned()) }?;
        made.set_name(name)?;
        Ok(made)
    }

    /// Returns how much of a level set of cubic voxels of edge `voxel` in world units lies inside.
    ///
    /// # Errors
    /// If the grid has no values (points).
    pub(crate) fn inside(&self, voxel: f64) -> Result<Inside> {
        let mut inside = Inside::default();
        let mut include = |value: f32, count: f64| {
            // OpenVDB has tiny distances below 0 beside what encloses nothing.
            if f64::from(value) < -1e-5 * voxel {
                inside.voxels += count;
            }
            inside.volume += count * (0.5 - f64::from(value) / voxel).clamp(0.0, 1.0);
        };
        self.for_each_leaf(|leaf| {
            leaf.values.iter().for_each(|v| include(*v, 1.0));
            true
        })?;
        self.tiles()?.iter().for_each(|tile| include(tile.value[0], f64::from(tile.dim).powi(3)));
        inside.volume *= voxel.powi(3);
        Ok(inside)
    }
}

/// How much of a level set lies inside.
#[derive(Debug, Default)]
pub(crate) struct Inside {
    /// Number of voxels whose centres lie inside.
    pub voxels: f64,
    /// Volume in cubic world units. Of a voxel that the surface passes, the part counts that lies inside of a plane at
    /// its distance, parallel to a face: exact in sum for planes, and a little too large for convex bodies.
    pub volume: f64,
}

/// Why a narrow band is not made.
#[derive(Debug, PartialEq)]
enum Refusal {
    /// Voxels of the band lie beyond the indices that there are.
    Far,
    /// The band needs more bytes than there are.
    Memory,
}

/// Nodes of a narrow band, by their places in units of their edges: leaves, and nodes of 128 and of 4096 voxels.
#[derive(Default)]
struct Band {
    leaves: HashSet<[i32; 3]>,
    nodes: [HashSet<[i32; 3]>; 2],
    bytes: u64,
}

impl Band {
    fn add(&mut self, leaf: [i32; 3]) {
        if self.leaves.insert(leaf) {
            self.bytes += BAND_LEAF_BYTES;
            for (level, shift) in [4, 9].into_iter().enumerate() {
                if self.nodes[level].insert(leaf.map(|c| c >> shift)) {
                    self.bytes += NODE_BYTES[level];
                }
            }
        }
    }
}

/// A triangle with the half width of its band.
struct Slab {
    low: DVec3,
    high: DVec3,
    corner: DVec3,
    normal: DVec3,
    half_width: f64,
}

impl Slab {
    fn new([a, b, c]: [DVec3; 3], half_width: f64) -> Self {
        // Where there is no normal, the box alone tells.
        let normal = (b - a).cross(c - a).normalize_or_zero();
        Self { low: a.min(b).min(c) - half_width, high: a.max(b).max(c) + half_width, corner: a, normal, half_width }
    }

    /// Adds the leaves that meet the slab, of a cube of `edge` leaves, a power of two, at the place of its first leaf.
    /// Stops where the band exceeds `limit` bytes.
    fn collect(&self, at: [i32; 3], edge: i32, band: &mut Band, limit: u64) {
        let low = DVec3::from_array(at.map(|c| 8.0 * f64::from(c)));
        let half = 4.0 * f64::from(edge);
        let apart = low.cmpgt(self.high).any() || (low + 2.0 * half).cmplt(self.low).any();
        let distance = (low + half - self.corner).dot(self.normal).abs();
        let reach = half * self.normal.abs().element_sum() + self.half_width;
        if apart || distance > reach || band.bytes > limit {
            return;
        }
        if edge == 1 {
            return band.add(at);
        }
        let edge = edge / 2;
        for i in 0..8 {
            self.collect(
                [at[0] + edge * (i >> 2), at[1] + edge * (i >> 1 & 1), at[2] + edge * (i & 1)],
                edge,
                band,
                limit,
            );
        }
    }
}

/// Estimate of the bytes that the level set of polygons in index space takes while it is made, with a band of
/// `half_width` voxels to either side.
///
/// # Errors
/// If it exceeds `limit`, or lies where voxels have no indices.
fn band_bytes(points: &[[f64; 3]], corners: &[[u32; 4]], half_width: f64, limit: u64) -> Result<u64, Refusal> {
    if points.iter().flatten().any(|c| c.is_nan() || c.abs() + half_width > FARTHEST) {
        return Err(Refusal::Far);
    }
    // A cell more: where the band ends, leaves are made and then cleared.
    let width = half_width + 1.0;
    let mut band = Band { bytes: 1 << 20, ..Band::default() };
    let point = |corner: u32| DVec3::from_array(points[corner as usize]);
    for &[a, b, c, d] in corners {
        let second = (d != u32::MAX).then(|| [point(a), point(c), point(d)]);
        for triangle in [[point(a), point(b), point(c)]].into_iter().chain(second) {
            let slab = Slab::new(triangle, width);
            let first = (slab.low / 8.0).floor();
            let span = ((slab.high / 8.0).floor() - first).max_element() + 1.0;
            let edge = (span as i32 as u32).next_power_of_two() as i32;
            slab.collect(first.as_ivec3().to_array(), edge, &mut band, limit);
        }
        if band.bytes > limit {
            return Err(Refusal::Memory);
        }
    }
    Ok(band.bytes)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// A tetrahedron of an edge in voxels about a place.
    fn tetrahedron(edge: f64, at: f64) -> Mesh {
        let corner = |i: i32| DVec3::new(f64::from(i & 1), f64::from(i >> 1), f64::from((i >> 1) ^ (i & 1)));
        let vertices = (0..4).map(|i| at + edge * corner(i)).collect();
        Mesh { vertices, corners: vec![0, 1, 2, 0, 3, 1, 0, 2, 3, 1, 3, 2], ends: vec![3, 6, 9, 12] }
    }

    #[test]
    fn bands_are_estimated_from_above_and_not_far_above() {
        for (edge, half_width) in [(3.0, 3.0), (40.0, 3.0), (200.0, 3.0), (200.0, 1.0), (60.0, 12.0)] {
            let mesh = tetrahedron(edge, 0.3);
            let points: Vec<_> = mesh.vertices.iter().map(|v| v.to_array()).collect();
            let bytes = band_bytes(&points, &mesh.at_most_quads(), half_width, u64::MAX).unwrap();
            let made = NativeGrid::from_mesh(&mesh, 1.0, half_width as f32, "s", u64::MAX).unwrap();
            let leaves = made.info().unwrap().leaf_count;
            let estimated = (bytes - (1 << 20)) / BAND_LEAF_BYTES;
            assert!(estimated >= leaves && leaves > 0, "{edge} {half_width}: {estimated} {leaves}");
        }
    }

    #[test]
    fn what_has_no_room_is_told_before_it_is_made() {
        let refused =
            |mesh: &Mesh, voxel, limit| NativeGrid::from_mesh(mesh, voxel, 3.0, "s", limit).unwrap_err().to_string();
        let mesh = tetrahedron(1.0, 0.0);
        assert!(refused(&mesh, 1e-4, 100 << 20).contains("band needs"));
        assert!(refused(&mesh, 1e-12, u64::MAX).contains("too small"));
        // A node of 4096 voxels takes more than the leaf in it.
        let mut apart = Mesh::default();
        for i in 0..300 {
            let one = tetrahedron(1.0, f64::from(i) * 5000.0);
            apart.vertices.extend(one.vertices);
            apart.corners.extend(one.corners.iter().map(|c| c + 4 * i as u32));
        }
        apart.ends = (1..=1200).map(|i| 3 * i).collect();
        assert!(refused(&apart, 1.0, 300 << 20).contains("band needs"));
    }
}
