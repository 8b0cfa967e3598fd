//! OME-Zarr images (NGFF 0.4 on Zarr 2, 0.5 on Zarr 3) and bare Zarr arrays, in local folders.
//!
//! NGFF's scale and translation map indices to the world, in the units of its axes; they are taken for the centres of
//! voxels, as its coordinates are elsewhere. Axes go by their names: x, y and z, and t and c, of which one point and
//! one channel is read. Chunks are read layer by layer, so that only the chunks of one z are in memory.
//!
//! Sources: the specifications of [Zarr 2](https://zarr-specs.readthedocs.io/en/latest/v2/v2.0.html),
//! [Zarr 3](https://zarr-specs.readthedocs.io/en/latest/v3/core/index.html) and
//! [NGFF](https://ngff.openmicroscopy.org/0.5/index.html).

mod array;
mod axes;
mod chunks;
mod codec;
mod document;
mod multiscale;

use super::image::{About, Header, Image, Values};
use super::options::Options;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use array::Array;
use axes::Axes;
use chunks::Chunks;
use document::Document;
use std::path::{Path, PathBuf};

/// Bytes of memory that a voxel may come to cost once it is in a grid: a value in a leaf of OpenVDB and one beside it.
const VOXEL_BYTES: u64 = 9;

/// Folder of an image or array that `path` names: itself, or where the metadata lies that it names.
fn folder(path: &Path) -> Option<PathBuf> {
    let holds = |folder: &Path| document::NAMES.iter().any(|name| folder.join(name).is_file());
    if path.is_dir() {
        return holds(path).then(|| path.to_path_buf());
    }
    let name = path.file_name()?.to_str()?;
    document::NAMES.contains(&name).then(|| path.parent().unwrap_or(Path::new("")).to_path_buf())
}

/// True if a folder holds an image or array of Zarr, or a file is the metadata of one.
pub(crate) fn is_zarr(path: &Path) -> bool {
    folder(path).is_some()
}

/// Opens an image or array.
///
/// # Errors
/// If the metadata cannot be read or contradicts the specifications, the array has axes beside x, y, z, t and c, it is
/// packed by a codec that is not read, it does not say how large its voxels are and neither do the options, or a layer
/// of chunks does not fit into the limits.
pub(crate) fn open(path: &Path, options: &Options, limits: Limits) -> Result<Image> {
    let folder = folder(path).ok_or_else(|| {
        Error::invalid("no Zarr image or array: neither zarr.json nor .zarray, .zattrs or .zgroup is there")
            .at(path)
            .hint("name the folder of the image")
    })?;
    let document = Document::read(&folder, limits)?;
    if document.is_array() {
        return bare(&folder, &document, options, limits);
    }
    if let Some(multiscales) = document.multiscales() {
        return multiscale::open(&folder, multiscales, options, limits);
    }
    // Converters of microscopes' formats put each image of a file into a numbered group.
    let first = folder.join("0");
    if is_zarr(&first)
        && let Some(multiscales) = Document::read(&first, limits)?.multiscales()
    {
        let mut image = multiscale::open(&first, multiscales, options, limits)?;
        image.header.notes.push("the group holds several images; '0' was read, name the folder of another".into());
        return Ok(image);
    }
    Err(Error::unsupported("a Zarr group without an image (no 'multiscales' in its attributes)")
        .at(&folder)
        .hint("name the folder of an image or of an array in it"))
}

/// Opens an array that no image's metadata describes.
fn bare(folder: &Path, document: &Document, options: &Options, limits: Limits) -> Result<Image> {
    let place = |e: Error| e.at(folder);
    let array = Array::parse(document).map_err(place)?;
    let mut notes = Vec::new();
    let axes = Axes::of_array(document, &array, &mut notes).map_err(place)?;
    let Some(index_to_world) = options.placement().map_err(place)? else {
        return Err(Error::invalid("a bare array does not say how large its voxels are")
            .at(folder)
            .hint("give ⟨voxel_size⟩ or ⟨spacing⟩, or name the folder of the image that the array belongs to"));
    };
    image(folder, array, axes, (None, index_to_world, notes), options, limits)
}

/// Image of an array whose axes and placement are known.
fn image(
    folder: &Path,
    array: Array,
    axes: Axes,
    (name, index_to_world, mut notes): (Option<String>, crate::math::Affine, Vec<String>),
    options: &Options,
    limits: Limits,
) -> Result<Image> {
    let place = |e: Error| e.at(folder);
    let point = axes.choose(&array, options, &mut notes).map_err(place)?;
    let size = axes.size(&array).map_err(place)?;
    let values = if array.sample.is_integer() { Values::Integer } else { Values::Real };
    let about = About { sample: Some(array.sample), ..About::default() };
    let header = Header { name, size, components: 1, values, index_to_world, about, notes };
    let chunks = Chunks::new(folder, array, axes, point, limits).map_err(place)?;
    Ok(Image { header, slices: Box::new(chunks) })
}
