//! Meshes of a stage, read from their files.

use super::content::MeshSource;
use super::volumes::numbered;
use crate::error::{Error, Result};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::registry;
use crate::formats::sequence::Frames;
use crate::formats::usd::write::mesh::MeshPrim;
use crate::formats::usd::write::names::Names;
use std::path::PathBuf;

/// Reads a mesh, or the meshes of its frames, and returns it with its files.
///
/// # Errors
/// If a file cannot be read, or is no mesh by its name.
pub(super) fn mesh(
    source: &MeshSource,
    frames: Option<Frames>,
    names: &mut Names,
    limits: Limits,
) -> Result<(MeshPrim, Vec<PathBuf>)> {
    let files = numbered(&source.file, frames)?;
    let read = |(time, path): &(Option<u32>, PathBuf)| match registry::by_name(path).map(|format| format.kind) {
        Some(FileKind::Mesh(format)) => Ok((*time, format.read(path, limits)?)),
        _ => Err(Error::unsupported("no mesh by its name").at(path).hint("give a PLY, OBJ or glTF file")),
    };
    let frames = files.iter().map(read).collect::<Result<Vec<_>>>()?;
    let name = source.file.file_name().unwrap_or_default().to_string_lossy();
    let name = names.take(name.split('.').next().unwrap_or_default());
    let prim = MeshPrim { name, frames, placement: source.placement, material: source.material };
    Ok((prim, files.into_iter().map(|(_, path)| path).collect()))
}
