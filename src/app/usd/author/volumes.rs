//! Volumes of a stage, read from their files.

use super::content::{DENSITY, Source};
use crate::app::checks::Warning;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::sequence::{Frames, Pattern};
use crate::formats::usd::fields::{self, GridField};
use crate::formats::usd::write::names::Names;
use crate::formats::usd::write::places::relative;
use crate::formats::usd::write::volume::{VolumeFrame, VolumePrim};
use crate::formats::vdb::File;
use std::path::{Path, PathBuf};

/// Files of a volume, by time code where it is a sequence.
pub(super) fn files(source: &Source, frames: Option<Frames>) -> Result<Vec<(Option<u32>, PathBuf)>> {
    numbered(&source.file, frames)
}

/// Returns a file, or those of a sequence by time code.
pub(super) fn numbered(file: &Path, frames: Option<Frames>) -> Result<Vec<(Option<u32>, PathBuf)>> {
    let Some(pattern) = Pattern::parse(file) else {
        return Ok(vec![(None, file.to_path_buf())]);
    };
    let numbers = match frames {
        Some(frames) => frames.numbers().collect(),
        None => pattern.numbers()?,
    };
    Ok(numbers.into_iter().map(|number| (Some(number), pattern.path(number))).collect())
}

/// Reads the grids of a volume's files.
///
/// # Errors
/// If a file cannot be read, has none of the grids that are asked for, or no grid of densities by the name given.
pub(super) fn volume(
    source: &Source,
    files: &[(Option<u32>, PathBuf)],
    grids: &[String],
    stage: &Path,
    limits: Limits,
    seen: &mut dyn FnMut(),
) -> Result<VolumePrim> {
    let Some((_, first)) = files.first() else { return Err(Error::invalid("no file").at(&source.file)) };
    let parts = parts(source, first, limits)?;
    let mut frames = Vec::with_capacity(files.len());
    for (time, path) in files {
        let plays = |field: &GridField| source.parts.iter().any(|(_, grid)| field.is_called(grid));
        let wanted = |field: &GridField| grids.is_empty() || grids.contains(&field.name) || plays(field);
        let fields: Vec<GridField> = fields::read(path, limits)?.into_iter().filter(wanted).collect();
        frames.push(VolumeFrame { time: *time, path: relative(path, stage)?, fields });
        seen();
    }
    let has = |name: &str| frames.iter().any(|frame| frame.fields.iter().any(|field| field.is_called(name)));
    for name in grids.iter().chain(source.parts.iter().map(|(_, grid)| grid)) {
        if !has(name) {
            let there = fields::read(first, limits)?;
            let found = there.iter().map(|field| format!("'{}'", field.name)).collect::<Vec<_>>().join(", ");
            return Err(Error::invalid(format!("no grid '{name}'; the file has {found}"))
                .at(first)
                .hint("name one of these, or leave the option out"));
        }
    }
    if frames.iter().all(|frame| frame.fields.is_empty()) {
        return Err(Error::invalid("the file has no grids that a field of USD can hold")
            .at(first)
            .hint("check the export settings of the program that made it"));
    }
    let transfer = source.transfer.as_ref().map(|path| relative(path, stage)).transpose()?;
    let placement = source.placement.map(|map| map.matrix());
    Ok(VolumePrim { name: name(&source.file), frames, placement, parts, medium: source.medium.clone(), transfer })
}

/// Returns the grids that play a part; the densities are those that rendering takes, unless another grid is named.
///
/// # Errors
/// If the file cannot be read, or a grid plays two parts, which no stage can say.
fn parts(source: &Source, first: &Path, limits: Limits) -> Result<Vec<(&'static str, String)>> {
    let mut parts = source.parts.clone();
    if !parts.iter().any(|(part, _)| *part == DENSITY) {
        // A file without densities, of velocities for one, is a volume as well.
        parts.extend(File::open(first, limits)?.density_name().ok().map(|grid| (DENSITY, grid)));
    }
    for (i, (part, grid)) in parts.iter().enumerate() {
        if let Some((before, _)) = parts[..i].iter().find(|(_, other)| other == grid) {
            return Err(Error::unsupported(format!("grid '{grid}' is both {before} and {part}"))
                .at(first)
                .hint("a field of a stage plays one part: copy the grid under another name with `cumulo convert`"));
        }
    }
    Ok(parts)
}

/// Returns a name for a volume's prim: that of its file up to the first dot or the number of a frame.
fn name(file: &Path) -> String {
    let stem = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let end = stem.find(['.', '#', '%']).unwrap_or(stem.len());
    Names::default().take(stem[..end].trim_end_matches(['_', '-']))
}

/// Returns remarks on a sequence: frames that are missing, and grids that some frames lack.
pub(super) fn remarks(volume: &VolumePrim) -> Vec<Warning> {
    let mut all = Vec::new();
    let times: Vec<u32> = volume.frames.iter().filter_map(|frame| frame.time).collect();
    let gaps: Vec<String> = times
        .windows(2)
        .filter(|pair| pair[1] > pair[0] + 1)
        .map(|pair| format!("{}-{}", pair[0] + 1, pair[1] - 1))
        .collect();
    if !gaps.is_empty() {
        all.push(Warning::new(
            format!("{}: frames {} have no file", volume.name, gaps.join(", ")),
            "USD shows the frame before in their place; write the missing frames, or accept that",
        ));
    }
    for frame in &volume.frames {
        for field in frame.fields.iter().filter(|field| field.voxel.is_none()) {
            all.push(Warning::new(
                format!("{}: grid '{}' has a transform that is not affine", frame.path, field.name),
                "its box is not part of the extent; resample it onto a linear transform for programs that need it",
            ));
        }
    }
    all
}
