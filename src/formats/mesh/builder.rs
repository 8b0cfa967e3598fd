//! A mesh in the course of its reading, of which no part takes more memory than allowed.

use super::Mesh;
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::text::bytes as human;
use glam::DVec3;

/// Bytes that a vertex, a corner and a polygon take, thrice where a list is moved to a longer one.
const VERTEX: u64 = 3 * 24;
const CORNER: u64 = 3 * 4;
const POLYGON: u64 = 3 * 4;

/// A mesh in the course of its reading.
pub(crate) struct Builder {
    mesh: Mesh,
    bytes: u64,
    limits: Limits,
}

impl Builder {
    pub(crate) fn new(limits: Limits) -> Self {
        Self { mesh: Mesh::default(), bytes: 0, limits }
    }

    /// Number of the vertices so far.
    pub(crate) fn vertices(&self) -> usize {
        self.mesh.vertices.len()
    }

    fn take(&mut self, bytes: u64) -> Result<()> {
        self.bytes += bytes;
        if self.bytes <= self.limits.max_memory && self.mesh.corners.len() < u32::MAX as usize / 2 {
            return Ok(());
        }
        let (needed, allowed) = (human(self.bytes), human(self.limits.max_memory));
        Err(Error::unsupported(format!("the mesh needs more than {needed}, {allowed} are allowed"))
            .coded(Code::MemoryLimit)
            .hint("raise ⟨max_memory⟩ if the file is to be trusted, or decimate the mesh where it was made"))
    }

    /// Adds a vertex.
    ///
    /// # Errors
    /// If a coordinate is not finite, or the mesh gets too large.
    pub(crate) fn vertex(&mut self, position: DVec3) -> Result<()> {
        self.take(VERTEX)?;
        if !position.is_finite() {
            let [x, y, z] = position.to_array();
            return Err(Error::invalid(format!(
                "vertex {} lies at {x}, {y}, {z}; numbers are expected",
                self.vertices()
            ))
            .hint("correct the vertex, or export the mesh again; its vertices must have finite coordinates"));
        }
        self.mesh.vertices.push(position);
        Ok(())
    }

    /// Adds a polygon by the numbers of its vertices, from 0, which need not be there yet.
    ///
    /// # Errors
    /// If there are fewer than three, or the mesh gets too large.
    pub(crate) fn polygon(&mut self, corners: &[u32]) -> Result<()> {
        self.take(POLYGON + CORNER * corners.len() as u64)?;
        if corners.len() < 3 {
            let number = self.mesh.ends.len();
            return Err(Error::invalid(format!(
                "polygon {number} has {} corners; 3 or more are expected",
                corners.len()
            ))
            .hint("delete loose edges and points where the mesh was made, and export it again"));
        }
        self.mesh.corners.extend_from_slice(corners);
        self.mesh.ends.push(self.mesh.corners.len() as u32);
        Ok(())
    }

    /// Returns the mesh.
    ///
    /// # Errors
    /// If a polygon names a vertex that is not there.
    pub(crate) fn finish(self) -> Result<Mesh> {
        let count = self.mesh.vertices.len();
        let missing = |(number, polygon): (usize, &[u32])| {
            polygon.iter().find(|corner| **corner as usize >= count).map(|corner| (number, *corner))
        };
        if let Some((number, corner)) = self.mesh.polygons().enumerate().find_map(missing) {
            return Err(Error::invalid(format!(
                "polygon {number} names vertex {corner}, counted from 0; the mesh has {count} vertices"
            ))
            .hint("the file is damaged or cut off; export the mesh again where it was made"));
        }
        Ok(self.mesh)
    }
}
