//! VTK's regular grids: image data in XML (`.vti`) and structured points of the legacy format (`.vtk`).
//!
//! Coordinates are taken as they are. Point data have their values at the grid's points. A cell is centred half a spacing
//! further in along each axis that has cells.

mod base64;
mod blocks;
mod legacy;
mod tags;
mod xml;

pub use legacy::open as open_legacy;
pub use xml::{is_xml, open as open_xml};

use super::image::{Header, Values};
use super::placement;
use crate::error::Result;
use crate::formats::sample::Sample;
use crate::math::Affine;
use glam::DVec3;

/// Largest number of arrays of a file.
const MOST_ARRAYS: usize = 256;

/// Points of a grid, and where they lie.
#[derive(Debug, Clone, Copy)]
struct Lattice {
    /// Number of points along each axis.
    points: [usize; 3],
    /// Map from the number of a point along each axis, from 0, to the world.
    to_world: Affine,
}

impl Lattice {
    /// Number of values along each axis: of points, or of cells, of which a flat axis has one.
    fn size(&self, cells: bool) -> [usize; 3] {
        self.points.map(|n| if cells { n.saturating_sub(1).max(1) } else { n })
    }

    fn header(&self, name: &str, (sample, components): (Sample, usize), cells: bool) -> Result<Header> {
        let inside = DVec3::from_array(self.points.map(|n| if cells && n > 1 { 0.5 } else { 0.0 }));
        let values = if sample.is_integer() { Values::Integer } else { Values::Real };
        let index_to_world = placement::shifted(&self.to_world, inside)?;
        let name = Some(name.to_owned()).filter(|n| !n.is_empty());
        Ok(Header { name, size: self.size(cells), components, values, index_to_world, notes: Vec::new() })
    }
}
