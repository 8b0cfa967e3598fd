//! Files that belong to one series.

use super::element::damaged;
use super::file::{self, File, Identity};
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
pub(crate) fn paths(folder: &Path) -> Result<Vec<PathBuf>> {
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
pub(crate) fn begins_as_dicom(path: &Path) -> bool {
    input::start(path, 132).is_ok_and(|start| super::is_dicom(&start))
}

/// Files of one series.
pub(crate) struct Series {
    /// Descriptions of the files, in order of their names.
    pub files: Vec<File>,
    /// Number of the file that was named; none where a folder was.
    pub named: Option<usize>,
}

/// Reads the descriptions of the files of one series: that of `path` if it is a file, else the only one of the folder,
/// or that which `wanted` names.
///
/// # Errors
/// If there is no such series, several and none is named, or a file of the folder cannot be read that is one of the
/// series or may be.
pub(crate) fn gather(path: &Path, wanted: Option<&str>, limits: Limits, notes: &mut Vec<String>) -> Result<Series> {
    if path.is_dir() {
        let files = Folder::read(path, limits)?.series(wanted, notes)?;
        return Ok(Series { files, named: None });
    }
    if !begins_as_dicom(path) {
        return Err(Error::invalid("no DICOM file: 'DICM' is expected behind the first 128 bytes")
            .at(path)
            .hint("name a file of the series, or the folder in which its files lie"));
    }
    let one = file::read(path, limits).map_err(|e| e.at(path))?;
    if let Some(wanted) = wanted.filter(|wanted| *wanted != one.series) {
        return Err(Error::invalid(format!("the file is of the series {}, and not of {wanted}", one.series))
            .at(path)
            .hint("name a file of that series, or the folder in which its files lie"));
    }
    if one.frames > 1 || one.series.is_empty() {
        return Ok(Series { files: vec![one], named: Some(0) });
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let files = Folder::read(folder, limits)?.series(Some(&one.series), notes)?;
    // A file that was replaced in the meantime is no longer among those of its series.
    let named = files.iter().position(|file| file.path.file_name() == path.file_name());
    let named = named.ok_or_else(|| damaged("the file changed while its series was read").at(path))?;
    Ok(Series { files, named: Some(named) })
}

/// Files of a folder, by what they turned out to be.
struct Folder<'p> {
    path: &'p Path,
    series: BTreeMap<String, Vec<File>>,
    /// Files that begin as DICOM files do and cannot be read as images.
    unread: Vec<Unread>,
    /// Files that do not begin as DICOM files do.
    others: Vec<PathBuf>,
}

/// A DICOM file that is no image, or a damaged one.
struct Unread {
    path: PathBuf,
    error: Error,
}

impl<'p> Folder<'p> {
    fn read(folder: &'p Path, limits: Limits) -> Result<Self> {
        let mut found = Self { path: folder, series: BTreeMap::new(), unread: Vec::new(), others: Vec::new() };
        for path in paths(folder)? {
            if !begins_as_dicom(&path) {
                found.others.push(path);
                continue;
            }
            match file::read(&path, limits) {
                Ok(file) => found.series.entry(file.series.clone()).or_default().push(file),
                Err(error) => found.unread.push(Unread { error: error.at(&path), path }),
            }
        }
        Ok(found)
    }

    /// Files of the series that `wanted` names, else of the only one.
    fn series(mut self, wanted: Option<&str>, notes: &mut Vec<String>) -> Result<Vec<File>> {
        let listed =
            |(uid, files): (&String, &Vec<File>)| format!("{uid} ({}, {} files)", files[0].description, files.len());
        let list = self.series.iter().map(listed).collect::<Vec<_>>().join("; ");
        if self.series.is_empty() {
            return Err(match self.unread.pop() {
                Some(unread) => self.unread.into_iter().next().unwrap_or(unread).error,
                None => Error::invalid("the folder holds no DICOM file")
                    .at(self.path)
                    .hint("name the folder in which the files of the series lie"),
            });
        }
        let chosen = match wanted {
            Some(uid) => self.series.remove(uid).map(|files| (uid.to_owned(), files)),
            None if self.series.len() > 1 => {
                return Err(Error::invalid(format!("the folder holds several series: {list}"))
                    .at(self.path)
                    .hint("choose one with ⟨series=UID⟩"));
            }
            None => self.series.pop_first(),
        };
        let (uid, files) = chosen.ok_or_else(|| {
            Error::invalid(format!("no series {}; the folder holds {list}", wanted.unwrap_or_default()))
                .at(self.path)
                .hint("choose one of these with ⟨series=UID⟩")
        })?;
        self.refuse_lost(&uid, &files, notes)?;
        Ok(files)
    }

    /// Refuses a folder with a file that cannot be read and is one of the series, or may be: what is left would be
    /// another volume. Files of other series, and files that are no images, are noted.
    fn refuse_lost(self, series: &str, files: &[File], notes: &mut Vec<String>) -> Result<()> {
        let advice =
            "copy the file again from where it was made, or move it out of the folder if it is none of the series";
        let mut passed: Vec<Unread> = Vec::new();
        for unread in self.unread {
            match file::identity(&unread.path) {
                Identity::Series(other) if other != series => passed.push(unread),
                Identity::Directory => passed.push(unread),
                Identity::Series(_) => {
                    let what = format!("a file of the series cannot be read: {}", unread.error.what());
                    return Err(unread.error.saying(what).instead(advice));
                }
                Identity::Unknown => {
                    let what = format!("a file that may be one of the series cannot be read: {}", unread.error.what());
                    return Err(unread.error.saying(what).instead(advice));
                }
            }
        }
        if let Some(first) = passed.first() {
            let count = passed.len();
            let (name, what) = (file_name(&first.path), first.error.what());
            notes.push(format!(
                "{count} DICOM file(s) of the folder were passed over, the first, {name}, because: {what}"
            ));
        }
        match self.others.iter().find(|path| is_named_as_slice(path, files)) {
            Some(lost) => {
                Err(damaged("the file has the name of a slice, and no DICOM begins in it").at(lost).instead(advice))
            }
            None => Ok(()),
        }
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// True if a file has an ending of DICOM, or the name of a slice but for its numbers. Files that systems hide have
/// neither.
fn is_named_as_slice(path: &Path, files: &[File]) -> bool {
    let name = file_name(path);
    let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
    let alike = || files.iter().any(|file| unnumbered(&file_name(&file.path)) == unnumbered(&name));
    !name.starts_with('.') && (super::ENDINGS.iter().any(|e| ending == *e) || alike())
}

/// Name with one character for every number in it.
fn unnumbered(name: &str) -> String {
    let mut shape = String::new();
    for c in name.chars() {
        let c = if c.is_ascii_digit() { '0' } else { c };
        if c != '0' || !shape.ends_with('0') {
            shape.push(c);
        }
    }
    shape
}
