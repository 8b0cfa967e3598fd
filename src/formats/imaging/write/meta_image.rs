//! MetaImage: `.mha` with its values, and `.mhd` with values in a `.raw` beside it.

use super::{numbers, values};
use crate::error::{Error, Result};
use crate::formats::atomic::{self, Batch};
use crate::formats::imaging::placement::swap_lps_ras;
use crate::formats::imaging::source::Source;
use crate::formats::sample::Sample;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

fn type_name(sample: Sample) -> &'static str {
    match sample {
        Sample::U8 => "MET_UCHAR",
        Sample::I8 => "MET_CHAR",
        Sample::U16 => "MET_USHORT",
        Sample::I16 => "MET_SHORT",
        Sample::U32 => "MET_UINT",
        Sample::I32 => "MET_INT",
        Sample::U64 => "MET_ULONG_LONG",
        Sample::I64 => "MET_LONG_LONG",
        // No grid has halves.
        Sample::F16 | Sample::F32 => "MET_FLOAT",
        Sample::F64 => "MET_DOUBLE",
    }
}

/// Header that names the file of values, and what other programs may not understand.
fn header(source: &Source, data: &str) -> (String, Vec<String>) {
    let map = swap_lps_ras(source.index_to_world.matrix());
    let columns = [map.x_axis, map.y_axis, map.z_axis].map(|c| c.truncate());
    let spacing = columns.map(|c| c.length());
    let directions: Vec<f64> = columns.iter().zip(spacing).flat_map(|(c, s)| (*c / s).to_array()).collect();
    let (a, b, c) = (columns[0] / spacing[0], columns[1] / spacing[1], columns[2] / spacing[2]);
    let sheared = [a.dot(b), b.dot(c), a.dot(c)].iter().any(|cosine| cosine.abs() > 1e-6);
    let notes = if sheared {
        vec![
            "the voxels are sheared: the directions are written as they are, and some programs expect right angles"
                .into(),
        ]
    } else {
        Vec::new()
    };
    let [x, y, z] = source.size;
    let channels = if source.components > 1 {
        format!("ElementNumberOfChannels = {}\n", source.components)
    } else {
        String::new()
    };
    let text = format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n\
         TransformMatrix = {}\nOffset = {}\nCenterOfRotation = 0 0 0\nElementSpacing = {}\nDimSize = {x} {y} \
         {z}\n{channels}ElementType = {}\nElementDataFile = {data}\n",
        numbers(directions),
        numbers(map.w_axis.truncate().to_array()),
        numbers(spacing),
        type_name(source.sample)
    );
    (text, notes)
}

/// Writes header and values to one file.
pub(crate) fn write(path: &Path, source: &Source) -> Result<Vec<String>> {
    source.count()?;
    let (text, notes) = header(source, "LOCAL");
    atomic::write(path, |draft| {
        draft.write(text.as_bytes())?;
        values(source, |bytes| draft.write(bytes))
    })?;
    Ok(notes)
}

/// Writes the header to `path` and the values to a file beside it; both appear, or neither.
pub(crate) fn write_apart(path: &Path, source: &Source) -> Result<Vec<String>> {
    source.count()?;
    let data = path.with_extension("raw");
    let name = data.file_name().and_then(|n| n.to_str()).filter(|n| n.chars().all(|c| !c.is_control()));
    let name = name.ok_or_else(|| {
        Error::invalid("a header cannot name a file whose name is no text").hint("choose another name")
    })?;
    let (text, notes) = header(source, name);
    let mut batch = Batch::new();
    let raw = batch.add(&data)?;
    let failed = |e| Error::io(&data, e).hint("nothing was changed; make room there, or name another folder");
    let mut file = BufWriter::new(File::create(&raw).map_err(failed)?);
    values(source, |bytes| file.write_all(bytes).map_err(failed))?;
    file.into_inner().map_err(|e| failed(e.into_error()))?.sync_all().map_err(failed)?;
    let place = batch.add(path)?;
    std::fs::write(&place, text).map_err(|e| Error::io(path, e))?;
    batch.commit()?;
    Ok(notes)
}
