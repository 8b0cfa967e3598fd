//! What earlier runs have left where outputs are to be written. It is decided here alone what may be replaced, which
//! frames stay as they are, and what a search goes on from.

use super::outputs::Content;
use super::provenance::{self, INPUTS, Provenance, RESUMABLE, SETTINGS, VDB_INPUTS};
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::vdb::File;
use crate::formats::{exr, input, png, protected, transforms};
use crate::scene::grid::MetaValue;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// State of the place where an output is to be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Standing {
    /// No file.
    Nothing,
    /// A file that the same settings made.
    Own,
    /// A file that other settings made, or one that does not state its settings.
    Other,
    /// A picture that was cut short: a file of 0 bytes, or an OpenEXR file whose header cannot be read.
    Damaged,
}

/// Largest stage in bytes that is looked at for the settings that made it.
const MOST_BYTES: u64 = 1 << 28;

impl Standing {
    /// Judges a capture's JSON.
    pub(crate) fn of_capture(json: &Path, own: &Provenance) -> Self {
        match provenance(json) {
            _ if !json.exists() => Self::Nothing,
            Some(earlier) if own.same_settings(&earlier.settings) => Self::Own,
            _ => Self::Other,
        }
    }

    /// Judges a USD stage as text.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(crate) fn of_stage(stage: &Path, own: &Provenance) -> Result<Self> {
        if !stage.exists() {
            return Ok(Self::Nothing);
        }
        let read = || input::bytes(stage, MOST_BYTES, "a stage of this command");
        let bytes = protected::unprotected(stage, read)?;
        let text = String::from_utf8_lossy(&bytes);
        let stated = text.lines().find_map(|line| line.trim().strip_prefix("string \"settings\" = "));
        Ok(if stated.is_some_and(|stated| own.same_settings(stated.trim_matches('"'))) {
            Self::Own
        } else {
            Self::Other
        })
    }

    /// Judges a picture in OpenEXR or PNG, whose `attribute` holds the hash of the settings that made it.
    fn of_picture(picture: &Path, attribute: &str, own: &Provenance) -> Self {
        match attributes(picture).get(attribute) {
            _ if !picture.exists() => Self::Nothing,
            Some(earlier) if own.same_settings(earlier) => Self::Own,
            _ if protected::unprotected(picture, || exr::is_damaged(picture)) => Self::Damaged,
            _ => Self::Other,
        }
    }
}

/// Attributes of a picture that state what it was made by.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Keys {
    /// Attribute of the hash of the settings.
    pub settings: &'static str,
    /// Attribute of the hashes of the inputs.
    pub inputs: &'static str,
}

impl Keys {
    /// Attributes of rendered pictures.
    pub(crate) const RENDERED: Self = Self { settings: SETTINGS, inputs: INPUTS };
}

/// How a run treats pictures that stand where its own go.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Policy<'p> {
    /// Provenance of the run.
    pub own: &'p Provenance,
    pub keys: Keys,
    /// True to replace pictures of other settings, and damaged ones.
    pub overwrite: bool,
    /// True to leave the run's own pictures as they are, and to replace damaged ones.
    pub resume: bool,
}

/// Result that an earlier run has left of a frame that is to be made.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Earlier {
    /// Nothing that counts.
    None,
    /// A picture that was made from something else than this file is now.
    Outdated(PathBuf),
    /// The picture that would be made.
    Whole,
}

impl Policy<'_> {
    /// Judges what stands at the place of a picture.
    pub(crate) fn standing(&self, picture: &Path) -> Standing {
        Standing::of_picture(picture, self.keys.settings, self.own)
    }

    /// Makes sure that a picture replaces nothing but what the same settings wrote before, or what may be replaced.
    ///
    /// # Errors
    /// If a picture of other settings, or a damaged one, would be replaced.
    pub(crate) fn check(&self, picture: &Path) -> Result<()> {
        let (what, hint) = match self.standing(picture) {
            _ if self.overwrite => return Ok(()),
            Standing::Nothing | Standing::Own => return Ok(()),
            Standing::Damaged if self.resume => return Ok(()),
            Standing::Damaged => {
                ("the picture that lies here is damaged or incomplete, and cannot be read", "⟨overwrite⟩ replaces it")
            }
            Standing::Other => (
                "a picture lies here that another command made, and would be replaced",
                "give another name, or ⟨overwrite⟩ to replace it",
            ),
        };
        Err(Error::invalid(what).coded(Code::OutputExists).at(picture).hint(hint))
    }

    /// Returns what an earlier run has left of a frame with these pictures. `needs` are files that they are made from,
    /// as far as they are known without them.
    pub(crate) fn left(&self, pictures: &[PathBuf], needs: &[PathBuf]) -> Earlier {
        // One that was cut short is made again like one that is missing.
        let stands = |picture: &PathBuf| self.standing(picture) == Standing::Own && is_whole(picture);
        if !(self.resume && pictures.iter().all(stands)) {
            return Earlier::None;
        }
        let changed = |picture: &PathBuf| {
            let attributes = attributes(picture);
            let named = attributes.get(self.keys.inputs).map_or("", String::as_str);
            Provenance::changed(named, needs.iter().map(PathBuf::as_path))
        };
        pictures.iter().find_map(changed).map_or(Earlier::Whole, Earlier::Outdated)
    }
}

/// Makes sure that a capture and its pictures replace only files that the same settings wrote before.
///
/// # Errors
/// If another capture, or a picture, would be replaced; the error names it.
pub(crate) fn spare_captures(json: &Path, pictures: &[PathBuf], own: &Provenance) -> Result<()> {
    let (what, place) = match Standing::of_capture(json, own) {
        Standing::Own => return Ok(()),
        Standing::Nothing => match pictures.iter().find(|picture| picture.exists()) {
            Some(picture) => ("a picture lies here that would be replaced", picture.as_path()),
            None => return Ok(()),
        },
        _ => ("another capture lies here, and would be replaced with its pictures", json),
    };
    let hint = "give another folder, or ⟨overwrite⟩ to replace it";
    Err(Error::invalid(what).coded(Code::OutputExists).at(place).hint(hint))
}

/// Makes sure that a document whose text states the settings that made it, an SVG or a PDF, replaces nothing but what
/// the same settings wrote before, or what may be replaced.
///
/// # Errors
/// If a document of other settings would be replaced, or what lies there cannot be read.
pub(crate) fn spare_document(path: &Path, own: &Provenance, overwrite: bool) -> Result<()> {
    if overwrite || !path.exists() {
        return Ok(());
    }
    let bytes = protected::unprotected(path, || input::bytes(path, MOST_BYTES, "a document of this command"))?;
    let stated = format!("{SETTINGS}={}", own.settings);
    if !own.settings.is_empty() && bytes.windows(stated.len()).any(|window| window == stated.as_bytes()) {
        return Ok(());
    }
    Err(Error::invalid("a file lies here that another command made, and would be replaced")
        .coded(Code::OutputExists)
        .at(path)
        .hint("give another name, or ⟨overwrite⟩ to replace it"))
}

/// Where a search begins.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InitialGuess<'s> {
    /// File to begin with, whatever made it.
    pub init: Option<&'s Path>,
    /// True to go on from the output of an earlier run.
    pub resume: bool,
    pub output: &'s Path,
    /// True to begin anew where other settings made the output; none where outputs are replaced without it.
    pub overwrite: Option<bool>,
}

impl<'s> InitialGuess<'s> {
    /// Returns what the search `own` begins with; none to begin from nothing.
    ///
    /// # Errors
    /// If the search is to go on from an output that its settings did not make, or from two files.
    pub(crate) fn beginning(self, own: &Provenance) -> Result<Option<Beginning>> {
        let Self { init, resume, output, overwrite } = self;
        if resume && init.is_some() {
            return Err(Error::invalid("⟨init⟩ and ⟨resume⟩ each say where to begin").hint("give one of them"));
        }
        if !resume || !output.exists() {
            return Ok(init.map(|file| Beginning { file: file.into(), inputs: BTreeMap::new(), or_anew: false }));
        }
        let what = match stated(output) {
            Some((resumable, inputs)) if own.goes_on_from(&resumable) => {
                return Ok(Some(Beginning { file: output.into(), inputs, or_anew: overwrite == Some(true) }));
            }
            _ if overwrite == Some(true) => return Ok(None),
            Some(_) => "⟨resume⟩: other settings made the output that lies here",
            None => "⟨resume⟩: the file that lies here does not state the settings that made it",
        };
        let replace =
            if overwrite.is_some() { "⟨overwrite⟩ replaces it" } else { "without ⟨resume⟩ it is replaced" };
        Err(Error::invalid(what)
            .coded(Code::OutputExists)
            .at(output)
            .hint(format!("to start from it, give it as ⟨init⟩ and the output another name; {replace}")))
    }
}

/// File that a search begins with.
#[derive(Debug)]
pub(crate) struct Beginning {
    pub file: PathBuf,
    /// Hashes of the inputs that it was made from by their names, if it is the output of an earlier run.
    inputs: BTreeMap<String, String>,
    /// True to begin from nothing where these have changed.
    pub or_anew: bool,
}

impl Beginning {
    /// Makes sure that the inputs of the search `own`, as far as they are known, are those that the file was made from.
    ///
    /// # Errors
    /// If one has changed; the error names it.
    pub(crate) fn check(&self, own: &Provenance) -> Result<()> {
        let changed = |(name, hash): &(&String, &String)| self.inputs.get(*name).is_some_and(|then| then != *hash);
        match own.inputs.iter().find(changed) {
            Some((name, _)) => Err(Error::invalid("⟨resume⟩: the output that lies here was made from other content")
                .coded(Code::OutputExists)
                .at(&self.file)
                .hint(format!(
                    "'{name}' has changed since; to start from this output all the same, give it as ⟨init⟩"
                ))),
            None => Ok(()),
        }
    }
}

/// Returns the hash by which `resume` knows a search's output, a VDB or a JSON, and those of its inputs by their names;
/// none if it states none.
fn stated(output: &Path) -> Option<(String, BTreeMap<String, String>)> {
    let of_volume = || {
        let mut metadata = File::open(output, Limits::default()).ok()?.metadata().ok()?;
        Some((metadata.remove(RESUMABLE)?, metadata.remove(VDB_INPUTS)?))
    };
    let (resumable, inputs) = match protected::unprotected(output, of_volume) {
        Some((MetaValue::Text(resumable), MetaValue::Text(inputs))) => {
            let pairs =
                provenance::inputs_of(&inputs).map(|(name, hash)| (name.display().to_string(), hash.to_owned()));
            (resumable, pairs.collect())
        }
        _ => provenance(output).map(|earlier| (earlier.resumable, earlier.inputs))?,
    };
    (!resumable.is_empty()).then_some((resumable, inputs))
}

/// Returns where a JSON comes from, if it tells.
pub(crate) fn provenance(json: &Path) -> Option<Provenance> {
    let mut root = protected::unprotected(json, || transforms::read_object(json, Limits::default())).ok()?;
    serde_json::from_value(root.remove("provenance")?).ok()
}

/// Returns true if a picture holds all that its header names; of a PNG, if it is not empty.
fn is_whole(path: &Path) -> bool {
    protected::unprotected(path, || match Content::Png.has_name(path) {
        true => !exr::is_damaged(path),
        false => exr::is_whole(path),
    })
}

/// Returns the attributes of a PNG or EXR that are texts; none if it cannot be read.
pub(crate) fn attributes(path: &Path) -> exr::Attributes {
    protected::unprotected(path, || match Content::Png.has_name(path) {
        true => png::texts(path).unwrap_or_default(),
        false => exr::header(path).map(|header| header.attributes()).unwrap_or_default(),
    })
}
