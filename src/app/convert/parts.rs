//! Grids of one file or of several, which become those of one: which of them, under which names, with which metadata.

use super::sources::{self, GridSource};
use super::{ConvertSettings, Edits};
use crate::app::provenance::RESUMABLE;
use crate::error::{Code, Error, Result};
use crate::formats::vdb::File;
use crate::scene::grid::MetaValue;
use std::collections::BTreeMap;

/// Grids of one file that are written, in this order.
pub(super) struct Part<'f> {
    pub file: &'f File,
    /// Unique names in the file.
    pub names: Vec<String>,
    pub sources: Vec<GridSource>,
    /// New names by the unique ones, of `rename`.
    renames: BTreeMap<String, String>,
}

/// Returns the number of the only file that has a grid of this name.
fn holder(files: &[File], name: &str) -> Result<usize> {
    let mut holders = (0..files.len()).filter(|number| files[*number].find(name).is_ok());
    match (holders.next(), holders.next()) {
        (Some(only), None) => Ok(only),
        (Some(one), Some(other)) => Err(Error::invalid(format!(
            "there is a grid '{name}' in {} too; which of them is meant?",
            files[one].path().display()
        ))
        .at(files[other].path())
        .hint(format!("rename one of them in its own file first with ⟨convert.rename={name}=NAME⟩"))),
        (None, _) => match files {
            [only] => only.find(name).map(|_| 0),
            _ => {
                let listed = |file: &File| file.entries().iter().map(|e| format!("'{}'", e.name)).collect::<Vec<_>>();
                let all: Vec<String> = files.iter().flat_map(listed).collect();
                Err(Error::invalid(format!("no grid '{name}'; the files have {}", all.join(", ")))
                    .coded(Code::NoSuchGrid)
                    .at(files[0].path())
                    .hint("name one of these"))
            }
        },
    }
}

impl ConvertSettings {
    /// Returns the grids that are written, file by file.
    ///
    /// # Errors
    /// If a grid that an option names is in none of the files or in several, or is not among those of `grid`.
    pub(super) fn parts<'f>(&self, files: &'f [File]) -> Result<Vec<Part<'f>>> {
        let part = |file| Part { file, names: Vec::new(), sources: Vec::new(), renames: BTreeMap::new() };
        let mut parts: Vec<Part> = files.iter().map(part).collect();
        for name in &self.grid {
            let part = &mut parts[holder(files, name)?];
            let name = part.file.find(name)?.name.clone();
            // A grid that is named twice counts once.
            if !part.names.contains(&name) {
                part.names.push(name);
            }
        }
        if self.grid.is_empty() {
            parts.iter_mut().for_each(|p| p.names = p.file.entries().iter().map(|e| e.name.clone()).collect());
        }
        for (old, new) in &self.rename {
            let part = &mut parts[holder(files, old)?];
            let name = part.file.find(old)?.name.clone();
            if !part.names.contains(&name) {
                return Err(Error::invalid(format!("⟨rename={old}={new}⟩: that grid is not among those of ⟨grid⟩"))
                    .hint("name it with ⟨grid⟩ too, or leave the renaming out"));
            }
            part.renames.insert(name, new.clone());
        }
        for part in &mut parts {
            let Edits { split, merge, eval, .. } = &self.edits;
            part.sources = sources::sources((split, merge, eval), part.file, &part.names)?;
        }
        Ok(parts)
    }

    /// Returns the names of the output's grids: those of `rename`, else of `names`, else of the files.
    ///
    /// # Errors
    /// If grids of two files would have one name.
    pub(super) fn new_names(&self, parts: &[Part<'_>], warnings: &mut Vec<String>) -> Result<Vec<String>> {
        let (mut names, mut renamed, mut owners) = (Vec::new(), Vec::new(), Vec::new());
        for part in parts {
            for source in &part.sources {
                let own = source.names(part.file)?;
                let rename = match source {
                    GridSource::Whole(name) => part.renames.get(name),
                    _ => None,
                };
                renamed.extend(own.iter().map(|_| rename));
                owners.extend(own.iter().map(|_| part.file));
                names.extend(own.into_iter().map(|own| rename.cloned().unwrap_or(own)));
            }
        }
        if let Some(convention) = self.edits.names {
            let (given, remarks) = convention.apply(&names);
            warnings.extend(remarks);
            names = given.into_iter().zip(renamed).map(|(given, renamed)| renamed.cloned().unwrap_or(given)).collect();
        }
        let mut taken: BTreeMap<&str, &File> = BTreeMap::new();
        for (name, owner) in names.iter().zip(owners) {
            let Some(other) = taken.insert(name, owner).filter(|other| !std::ptr::eq(*other, owner)) else { continue };
            return Err(Error::invalid(format!("{} has a grid '{name}' too", other.path().display()))
                .part(format!("grid '{name}'"))
                .at(owner.path())
                .hint(format!(
                    "rename one of them in its own file first with ⟨convert.rename={name}=NAME⟩, or choose \
                     grids with ⟨grid⟩"
                )));
        }
        Ok(names)
    }
}

/// Checks that files may become one as they lie: that none states another up axis than the first one that states any.
///
/// # Errors
/// If two files state different up axes.
pub(crate) fn check_up(files: &[File], warnings: &mut Vec<String>) -> Result<()> {
    let Some((first, stated)) = files.iter().find_map(|file| Some((file, file.up()?))) else { return Ok(()) };
    for file in files {
        let name = file.path().display();
        match file.up() {
            Some(other) if other.up != stated.up => {
                return Err(Error::invalid(format!(
                    "the file is {}-up ({}), and {} is {}-up ({})",
                    other.up.name(),
                    other.reason,
                    first.path().display(),
                    stated.up.name(),
                    stated.reason
                ))
                .at(file.path())
                .hint("turn one of them first: ⟨convert.up=z⟩ or ⟨convert.up=y⟩"));
            }
            Some(_) => {}
            None => warnings.push(format!(
                "{name} does not state its up axis; its grids are taken as they lie, among others that are {}-up",
                stated.up.name()
            )),
        }
    }
    Ok(())
}

/// Metadata of all files but the first one, as far as those before do not state the same entries. Other values of the
/// same entries are left out with a warning.
///
/// # Errors
/// If metadata cannot be read.
pub(crate) fn further_metadata(files: &[File], warnings: &mut Vec<String>) -> Result<BTreeMap<String, MetaValue>> {
    let mut known = files[0].metadata()?;
    let mut further = BTreeMap::new();
    for file in &files[1..] {
        let mut left_out = Vec::new();
        for (name, value) in file.metadata()? {
            match known.get(&name) {
                Some(kept) if *kept == value => {}
                Some(_) => left_out.push(format!("'{name}'")),
                None => {
                    further.insert(name.clone(), value.clone());
                    known.insert(name, value);
                }
            }
        }
        if !left_out.is_empty() {
            let (name, entries) = (file.path().display(), left_out.join(", "));
            warnings.push(format!(
                "metadata of {name} was left out, of which a file before it has other values: {entries}"
            ));
        }
    }
    if known.contains_key(RESUMABLE) {
        // What was edited is no longer what a search has left, to go on from.
        further.insert(RESUMABLE.to_owned(), MetaValue::Text(String::new()));
    }
    Ok(further)
}
