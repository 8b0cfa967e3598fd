//! Meshes of polygons: PLY, Wavefront OBJ and glTF.

pub(crate) mod builder;
pub(crate) mod gltf;
pub(crate) mod obj;
pub(crate) mod ply;
pub(crate) mod topology;

use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use crate::scene::surfaces::TRIANGLE_BYTES;
use glam::DVec3;
use std::path::Path;

/// Polygons whose corners are numbers of vertices. Corners run counterclockwise as seen from outside.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Positions of the vertices in world units.
    pub vertices: Vec<DVec3>,
    /// Numbers of the corners' vertices, polygon after polygon; all are below the number of vertices.
    pub corners: Vec<u32>,
    /// For each polygon, the number of corners of all polygons up to it; ascending by at least 3.
    pub ends: Vec<u32>,
}

impl Mesh {
    /// Corners of the polygons, one after another.
    pub fn polygons(&self) -> impl Iterator<Item = &[u32]> + '_ {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(from, to)| &self.corners[from as usize..*to as usize])
    }
}

impl Mesh {
    /// Returns the corners of triangles that fill the polygons, for rays to meet, each with the number of its polygon.
    ///
    /// # Errors
    /// If the edges of a polygon cross each other, or a tree of the triangles does not fit into the limits.
    pub(crate) fn surface(&self, limits: Limits) -> Result<Vec<(usize, [DVec3; 3])>> {
        let count = self.triangles().count() as u64;
        if count.saturating_mul(TRIANGLE_BYTES) > limits.max_memory {
            return Err(Error::unsupported(format!("{count} triangles do not fit in memory"))
                .coded(Code::MemoryLimit)
                .hint("simplify the mesh, or raise ⟨max_memory⟩"));
        }
        let triangles = self.filled().ok_or_else(|| {
            Error::unsupported("the edges of a polygon cross each other, and its triangles are not known")
                .hint("triangulate the mesh where it is exported")
        })?;
        let at = |corner: u32| self.vertices[corner as usize];
        Ok(triangles.into_iter().map(|(polygon, corners)| (polygon, corners.map(at))).collect())
    }
}

/// How meshes of a format are read and written.
#[derive(Debug)]
pub struct MeshFormat {
    /// Reads a file.
    pub(crate) read: fn(&Path, Limits) -> Result<Mesh>,
    /// Writes a file; none if files of the format are read alone.
    pub(crate) write: Option<fn(&Path, &Mesh) -> Result<()>>,
}

impl MeshFormat {
    /// Reads a file of this format.
    ///
    /// # Errors
    /// If the file cannot be read, contradicts its format, has no polygons, a polygon names a vertex that is not there,
    /// a coordinate is not finite, or the mesh does not fit into the limits. The error names the file.
    pub fn read(&self, path: &Path, limits: Limits) -> Result<Mesh> {
        let _reading = Reading::begin(path);
        let mesh =
            (self.read)(path, limits).and_then(|mesh| if mesh.ends.is_empty() { Err(empty(&mesh)) } else { Ok(mesh) });
        mesh.map_err(|e| e.at(path))
    }

    /// Reads the triangles of a file of this format, corners in its coordinates, for rays to meet.
    ///
    /// # Errors
    /// As [`Self::read`], or if the edges of a polygon cross each other, or a tree of the triangles does not fit into
    /// the limits. The error names the file.
    pub fn triangles(&self, path: &Path, limits: Limits) -> Result<Vec<[DVec3; 3]>> {
        let surface = self.read(path, limits)?.surface(limits).map_err(|e| e.at(path))?;
        Ok(surface.into_iter().map(|(_, corners)| corners).collect())
    }

    /// Writes a file of this format.
    ///
    /// # Errors
    /// If files of the format are read alone, or the file cannot be written; whatever stood there stays then.
    pub fn write(&self, path: &Path, mesh: &Mesh) -> Result<()> {
        let write = self.write.ok_or_else(|| {
            Error::unsupported("meshes of this format are read alone")
                .at(path)
                .hint("give a name that ends in .ply or .obj")
        });
        write?(path, mesh)
    }
}

fn empty(mesh: &Mesh) -> Error {
    Error::invalid(format!("{} vertices and no polygons; a surface of polygons is expected", mesh.vertices.len()))
        .hint("export the object as a mesh with faces; points and curves have no inside")
}

/// True if single precision moves no vertex by more than a ten-thousandth of the mesh's mean edge, for files whose
/// programs expect 32-bit floats.
pub(crate) fn fits_single(mesh: &Mesh) -> bool {
    let largest = mesh.vertices.iter().fold(0.0_f64, |most, v| most.max(v.abs().max_element()));
    let (mut sum, mut count) = (0.0, 0.0);
    for polygon in mesh.polygons() {
        let [a, b] = [polygon[0], polygon[1]].map(|c| mesh.vertices[c as usize]);
        sum += a.distance(b);
        count += 1.0;
    }
    largest < f64::from(f32::MAX) && largest * f64::from(f32::EPSILON) * count <= 2e-4 * sum
}
