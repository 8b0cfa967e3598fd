//! NRRD with packed values. The placement is held exactly, shear included.

use super::{number, packed, values};
use crate::error::Result;
use crate::formats::atomic;
use crate::formats::imaging::placement::swap_lps_ras;
use crate::formats::imaging::source::Source;
use crate::formats::sample::Sample;
use glam::DVec4;
use std::path::Path;

fn type_name(sample: Sample) -> &'static str {
    match sample {
        Sample::U8 => "uint8",
        Sample::I8 => "int8",
        Sample::U16 => "uint16",
        Sample::I16 => "int16",
        Sample::U32 => "uint32",
        Sample::I32 => "int32",
        Sample::U64 => "uint64",
        Sample::I64 => "int64",
        // No grid has halves.
        Sample::F16 | Sample::F32 => "float",
        Sample::F64 => "double",
    }
}

/// Writes a file.
pub(crate) fn write(path: &Path, source: &Source) -> Result<Vec<String>> {
    source.count()?;
    let map = swap_lps_ras(source.index_to_world.matrix());
    let vector = |v: DVec4| format!("({},{},{})", number(v.x), number(v.y), number(v.z));
    let mut sizes: Vec<String> = source.size.iter().map(ToString::to_string).collect();
    let mut directions = [map.x_axis, map.y_axis, map.z_axis].map(vector).to_vec();
    let mut kinds = vec!["domain"; 3];
    if source.components > 1 {
        sizes.insert(0, source.components.to_string());
        directions.insert(0, "none".into());
        kinds.insert(0, "vector");
    }
    let header = format!(
        "NRRD0004\ntype: {}\ndimension: {}\nspace: left-posterior-superior\nsizes: {}\nspace directions: {}\nkinds: \
         {}\nendian: little\nencoding: gzip\nspace origin: {}\n\n",
        type_name(source.sample),
        sizes.len(),
        sizes.join(" "),
        directions.join(" "),
        kinds.join(" "),
        vector(map.w_axis)
    );
    atomic::write(path, |draft| {
        draft.write(header.as_bytes())?;
        packed(draft, |put| values(source, put))
    })?;
    Ok(Vec::new())
}
