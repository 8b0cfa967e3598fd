//! VTK's regular grids: image data in XML (`.vti`) and structured points of the legacy format (`.vtk`).
//!
//! Coordinates are taken as they are. Point data have their values at the grid's points. A cell is centred half a
//! spacing further in along each axis that has cells.

mod base64;
mod blocks;
mod legacy;
mod tags;
mod xml;

pub(crate) use legacy::open as open_legacy;
pub(crate) use xml::{is_xml, open as open_xml};

use super::image::{About, Header, Image, Slices, Values};
use super::options::Options;
use super::placement;
use super::text::excerpt;
use crate::error::Result;
use crate::formats::sample::Sample;
use crate::math::Affine;
use glam::DVec3;

/// Largest number of arrays of a file.
const MOST_ARRAYS: usize = 256;

/// An array of a file, one value or three at each point or cell.
#[derive(Debug)]
struct Array<P> {
    name: String,
    sample: Sample,
    components: usize,
    /// True for values of cells, false for those of points.
    cells: bool,
    /// Where the values lie.
    place: P,
}

/// Images of the arrays that are wanted, whose values `slices` opens; the first one notes what was left out.
///
/// # Errors
/// If no array is left, or the values of one cannot be opened.
fn images<P>(
    arrays: &[Array<P>],
    lattice: &Lattice,
    left_out: Vec<String>,
    options: &Options,
    slices: impl Fn(&Array<P>) -> Result<Box<dyn Slices>>,
) -> Result<Vec<Image>> {
    let image = |array: &Array<P>| {
        let slices = slices(array).map_err(|e| e.part(format!("array '{}'", excerpt(&array.name))))?;
        Ok(Image { header: lattice.header(array)?, slices })
    };
    let wanted = arrays.iter().filter(|a| options.wants(&a.name));
    let mut images = wanted.map(image).collect::<Result<Vec<_>>>()?;
    let Some(first) = images.first_mut() else {
        return Err(options.no_array(&arrays.iter().map(|a| a.name.clone()).collect::<Vec<_>>()));
    };
    first.header.notes.extend(left_out);
    Ok(images)
}

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

    fn header<P>(&self, array: &Array<P>) -> Result<Header> {
        let Array { cells, components, .. } = *array;
        let inside = DVec3::from_array(self.points.map(|n| if cells && n > 1 { 0.5 } else { 0.0 }));
        let values = if array.sample.is_integer() { Values::Integer } else { Values::Real };
        let index_to_world = placement::shifted(&self.to_world, inside)?;
        let name = Some(array.name.clone()).filter(|n| !n.is_empty());
        let (size, about) = (self.size(cells), About::default());
        Ok(Header { name, size, components, values, index_to_world, about, notes: Vec::new() })
    }
}
