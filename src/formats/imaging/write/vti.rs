//! VTK's image data in XML, with raw values appended.

use super::{numbers, values};
use crate::error::{Error, Result};
use crate::formats::atomic;
use crate::formats::imaging::source::Source;
use crate::formats::sample::Sample;
use crate::text::printable;
use glam::DMat3;
use quick_xml::escape::escape;
use std::path::Path;

/// Cosine of two axes from which on they are not orthogonal: beyond what directions in single precision leave.
const SHEAR: f64 = 1e-6;

fn type_name(sample: Sample) -> &'static str {
    match sample {
        Sample::U8 => "UInt8",
        Sample::I8 => "Int8",
        Sample::U16 => "UInt16",
        Sample::I16 => "Int16",
        Sample::U32 => "UInt32",
        Sample::I32 => "Int32",
        Sample::U64 => "UInt64",
        Sample::I64 => "Int64",
        // No grid has halves.
        Sample::F16 | Sample::F32 => "Float32",
        Sample::F64 => "Float64",
    }
}

/// Writes a file with one array of point data.
pub(crate) fn write(path: &Path, source: &Source, name: &str) -> Result<Vec<String>> {
    let map = source.index_to_world.matrix();
    let linear = DMat3::from_mat4(map);
    let spacing = [linear.x_axis, linear.y_axis, linear.z_axis].map(|c| c.length());
    let turn = DMat3::from_cols(linear.x_axis / spacing[0], linear.y_axis / spacing[1], linear.z_axis / spacing[2]);
    let cosines = [turn.x_axis.dot(turn.y_axis), turn.y_axis.dot(turn.z_axis), turn.x_axis.dot(turn.z_axis)];
    if cosines.iter().any(|c| c.abs() > SHEAR) {
        return Err(Error::unsupported("the voxels are sheared, which image data of VTK cannot hold")
            .hint("write .nrrd or .nii, which can, or resample to cubic voxels first: ⟨convert.resample⟩"));
    }
    let bytes = source.count()? * source.sample.bytes() as u64;
    let [x, y, z] = source.size.map(|n| n - 1);
    let extent = format!("0 {x} 0 {y} 0 {z}");
    let name = printable(name);
    let name = escape(&*name);
    let head = format!(
        "<?xml version=\"1.0\"?>\n\
         <VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n\
         <ImageData WholeExtent=\"{extent}\" Origin=\"{}\" Spacing=\"{}\" Direction=\"{}\">\n\
         <Piece Extent=\"{extent}\">\n<PointData {}=\"{name}\">\n\
         <DataArray type=\"{}\" Name=\"{name}\" NumberOfComponents=\"{}\" format=\"appended\" offset=\"0\"/>\n\
         </PointData>\n</Piece>\n</ImageData>\n<AppendedData encoding=\"raw\">\n_",
        numbers(map.w_axis.truncate().to_array()),
        numbers(spacing),
        numbers(turn.transpose().to_cols_array()),
        if source.components > 1 { "Vectors" } else { "Scalars" },
        type_name(source.sample),
        source.components
    );
    atomic::write(path, |draft| {
        draft.write(head.as_bytes())?;
        draft.write(&bytes.to_le_bytes())?;
        values(source, |bytes| draft.write(bytes))?;
        draft.write(b"\n</AppendedData>\n</VTKFile>\n")
    })?;
    Ok(Vec::new())
}
