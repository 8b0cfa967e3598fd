//! Files that belong to one series.

use super::file::{self, File};
use crate::error::{Error, Result};
use crate::formats::imaging::input;
use crate::formats::limits::Limits;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Most files of a folder that are looked at.
const MOST_FILES: usize = 100_000;

/// Files of a folder, or of the folder of a file, in order of their names.
///
/// # Errors
/// If the folder cannot be read, or holds too many files.
pub fn paths(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))? {
        let path = entry.map_err(|e| Error::io(folder, e))?.path();
        if path.is_file() {
            paths.push(path);
        }
        if paths.len() > MOST_FILES {
            return Err(Error::unsupported(format!("the folder has more than {MOST_FILES} files"))
                .at(folder)
                .hint("move the series into a folder of its own"));
        }
    }
    paths.sort();
    Ok(paths)
}

/// True if a file can be read and begins as DICOM files do.
pub fn begins_as_dicom(path: &Path) -> bool {
    input::start(path, 132).is_ok_and(|start| super::is_dicom(&start))
}

/// Reads the descriptions of the files of one series: that of `path` if it is a file, else the only one of the folder, or
/// that which `wanted` names.
///
/// # Errors
/// If there is no such series, several and none is named, or a file of it cannot be read.
pub fn gather(path: &Path, wanted: Option<&str>, limits: Limits, notes: &mut Vec<String>) -> Result<Vec<File>> {
    let (folder, wanted) = if path.is_dir() {
        (path, wanted.map(str::to_owned))
    } else {
        if !begins_as_dicom(path) {
            return Err(Error::invalid("no DICOM file: 'DICM' is expected behind the first 128 bytes")
                .at(path)
                .hint("name a file of the series, or the folder in which its files lie"));
        }
        let one = file::read(path, limits).map_err(|e| e.at(path))?;
        if one.frames > 1 || one.series.is_empty() {
            return Ok(vec![one]);
        }
        let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        (parent, Some(wanted.map_or(one.series, str::to_owned)))
    };
    let mut all: BTreeMap<String, Vec<File>> = BTreeMap::new();
    let mut unread: Option<Error> = None;
    let mut passed = 0;
    for path in paths(folder)?.iter().filter(|p| begins_as_dicom(p)) {
        match file::read(path, limits).map_err(|e| e.at(path)) {
            Ok(file) => all.entry(file.series.clone()).or_default().push(file),
            // A folder may hold reports and directories beside the series.
            Err(error) => {
                passed += 1;
                unread.get_or_insert(error);
            }
        }
    }
    let listed =
        |(uid, files): (&String, &Vec<File>)| format!("{uid} ({}, {} files)", files[0].description, files.len());
    let list = all.iter().map(listed).collect::<Vec<_>>().join("; ");
    let series = match (&wanted, all.len()) {
        (Some(uid), _) => all.remove(uid),
        (None, 0 | 1) => all.pop_first().map(|(_, files)| files),
        (None, _) => {
            return Err(Error::invalid(format!("the folder holds several series: {list}"))
                .at(folder)
                .hint("choose one with --series UID"));
        }
    };
    match (series, unread) {
        (Some(series), unread) => {
            if let Some(error) = unread {
                notes.push(format!(
                    "{passed} files of the folder were passed over, the first because: {}",
                    error.what()
                ));
            }
            Ok(series)
        }
        (None, Some(error)) if all.is_empty() => Err(error),
        (None, _) if all.is_empty() => Err(Error::invalid("the folder holds no DICOM file")
            .at(folder)
            .hint("name the folder in which the files of the series lie")),
        (None, _) => Err(Error::invalid(format!("no series {}; the folder holds {list}", wanted.unwrap_or_default()))
            .at(folder)
            .hint("choose one of these with --series UID")),
    }
}
