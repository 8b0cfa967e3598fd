//! Numbers without a header, whose layout the caller states.

use super::image::{About, Header, Image, Values};
use super::input::{self, Packing};
use super::options::Options;
use super::stream::Binary;
use crate::error::{Error, Result};
use crate::formats;
use std::path::Path;

/// Opens a file of numbers, x fastest, z slowest.
///
/// # Errors
/// If the layout or the spacing is not stated, or the file has not exactly as many bytes as the layout says.
pub(crate) fn open(path: &Path, options: &Options) -> Result<Vec<Image>> {
    let layout = options.raw.ok_or_else(|| {
        Error::invalid("a file without a header does not say what is in it").hint("give ⟨dims=X,Y,Z⟩ and ⟨type⟩")
    })?;
    let index_to_world = options.placement()?.ok_or_else(|| {
        Error::invalid("a file without a header does not say how large its voxels are")
            .hint("give ⟨spacing=X,Y,Z⟩, and ⟨origin⟩ if the first voxel is not at the world's origin")
    })?;
    let expected = input::byte_count(layout.size, 1, layout.sample.bytes()).and_then(|n| n.checked_add(layout.skip));
    let length = formats::input::open(path)?.metadata().map_err(|e| Error::io(path, e))?.len();
    if expected != Some(length) {
        let [x, y, z] = layout.size;
        let expected = expected.map_or_else(|| "more than 2⁶⁴".to_owned(), |n| n.to_string());
        return Err(Error::invalid(format!(
            "the file has {length} bytes; {x} x {y} x {z} voxels of {} after {} bytes make {expected}",
            layout.sample.name(),
            layout.skip
        ))
        .hint("correct ⟨dims⟩, ⟨type⟩ or ⟨skip⟩"));
    }
    let reader = input::values(path, layout.skip, Packing::Plain, 0)?;
    let values = if layout.sample.is_integer() { Values::Integer } else { Values::Real };
    let about = About { sample: Some(layout.sample), ..About::default() };
    let header =
        Header { name: None, size: layout.size, components: 1, values, index_to_world, about, notes: Vec::new() };
    Ok(vec![Image { header, slices: Box::new(Binary::new(reader, layout.sample, layout.endian)) }])
}
