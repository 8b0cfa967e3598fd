//! Where an output comes from: version, origin, settings, hashes of the inputs, wall time.

use super::context::Context;
use crate::error::{Error, Result};
use crate::formats::exr::Attributes;
use crate::formats::input;
use crate::scene::grid::MetaValue;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Instant, SystemTime};

/// Attribute of a picture that holds the hash of the settings it was made by.
pub(crate) const SETTINGS: &str = "cumulo:settings";

/// Attribute of a picture that holds the hashes of what it was made from.
pub(crate) const INPUTS: &str = "cumulo:input";
/// Metadata of a VDB that holds the hashes of its inputs.
pub(crate) const VDB_INPUTS: &str = "cumulo_input";
/// Metadata of a VDB that holds the hash of the settings that `resume` compares.
pub(crate) const RESUMABLE: &str = "cumulo_resumable";

/// Settings of a search that say how it is carried out.
const MANNER: [&str; 4] = ["overwrite", "resume", "max_memory", "checkpoint"];

/// Settings of a search that say where it begins, how far it goes and where it writes, whatever is searched for.
const EXTENT: [&str; 7] = ["output", "pictures", "cameras", "report", "init", "iterations", "samples"];

/// Provenance of an output: program, origin, settings, inputs and wall time.
#[derive(Debug, Clone, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Provenance {
    /// Name and version of the program.
    pub software: String,
    /// Command line, its words quoted for a shell; of work for another face, what that calls itself.
    pub command: String,
    /// Name of the use case, such as `render`; empty where none is stated.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub use_case: String,
    /// SHA-256 of the settings that results depend on, in hexadecimal digits; empty where none are stated.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub settings: String,
    /// SHA-256 of the settings that `resume` compares, in hexadecimal digits: all but those of where the work begins,
    /// how far it goes and where it writes; empty for work that does not go on from its output.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub resumable: String,
    /// SHA-256 of the bytes of each input in hexadecimal digits, by the input's path.
    pub inputs: BTreeMap<String, String>,
    /// Seconds from the start of the work to the writing of the output.
    pub seconds: f64,
    #[serde(skip, default = "Instant::now")]
    start: Instant,
}

impl Provenance {
    /// Begins with the origin that the context states, and starts the clock.
    pub(crate) fn begin(context: &Context) -> Self {
        Self {
            software: concat!("cumulo ", env!("CARGO_PKG_VERSION")).to_owned(),
            command: context.origin().to_owned(),
            use_case: String::new(),
            settings: String::new(),
            resumable: String::new(),
            inputs: BTreeMap::new(),
            seconds: 0.0,
            start: Instant::now(),
        }
    }

    /// States the settings of a use case. Those whose names are in `manner` say how it is done, or which part of it,
    /// and do not count: work of the same settings may replace what it has written before, and go on from it.
    #[must_use]
    pub(crate) fn of(self, use_case: &str, settings: &impl Serialize, manner: &[&str]) -> Self {
        Self { use_case: use_case.to_owned(), settings: hash_of_settings(use_case, settings, &[manner]), ..self }
    }

    /// States the settings of a search, as [`Self::of`] does: work that can go on from its own output.
    #[must_use]
    pub(crate) fn of_search(self, use_case: &str, settings: &impl Serialize) -> Self {
        let resumable = hash_of_settings(use_case, settings, &[&MANNER, &EXTENT]);
        Self { resumable, ..self.of(use_case, settings, &MANNER) }
    }

    /// True if `settings`, the hash that an earlier output states, is that of this work.
    pub(crate) fn same_settings(&self, settings: &str) -> bool {
        !self.settings.is_empty() && self.settings == settings
    }

    /// True if this work goes on from an output that states `resumable`.
    pub(crate) fn goes_on_from(&self, resumable: &str) -> bool {
        !self.resumable.is_empty() && self.resumable == resumable
    }

    /// Adds an input: one hash over the bytes of all `files`, in their order.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub(crate) fn input<'a>(&mut self, name: &Path, files: impl IntoIterator<Item = &'a Path>) -> Result<()> {
        let mut hash = Sha256::new();
        files.into_iter().try_for_each(|path| add(&mut hash, path))?;
        self.inputs.insert(name.display().to_string(), digits(hash));
        Ok(())
    }

    /// Returns a hash of the hashes of all inputs so far.
    pub(crate) fn hash_of_inputs(&self) -> [u8; 32] {
        let mut hash = Sha256::new();
        self.inputs.values().for_each(|input| hash.update(input));
        hash.finalize().into()
    }

    /// Adds inputs that are one file each, or folders of which every file counts. A file that several frames depend on
    /// is read once.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub(crate) fn files<'a>(&mut self, files: impl IntoIterator<Item = &'a Path>) -> Result<()> {
        for path in files {
            self.inputs.insert(path.display().to_string(), hash_of(path)?);
        }
        Ok(())
    }

    /// Returns the seconds since the start, and keeps them as the time of the output.
    pub(crate) fn lap(&mut self) -> f64 {
        self.seconds = self.start.elapsed().as_secs_f64();
        self.seconds
    }

    /// Returns the provenance as attributes of an EXR, without the time.
    pub(crate) fn attributes(&self) -> Attributes {
        let mut all = Attributes::new();
        all.insert("software".into(), self.software.clone());
        all.insert("cumulo:command".into(), self.command.clone());
        if !self.settings.is_empty() {
            all.insert(SETTINGS.into(), self.settings.clone());
        }
        all.insert(INPUTS.into(), self.hashes());
        all
    }

    /// Returns the provenance as metadata of a VDB.
    pub(crate) fn metadata(&self) -> BTreeMap<String, MetaValue> {
        let mut all = BTreeMap::new();
        all.insert("creator".into(), MetaValue::Text(self.software.clone()));
        all.insert("cumulo_command".into(), MetaValue::Text(self.command.clone()));
        all.insert("cumulo_seconds".into(), MetaValue::Float(self.seconds));
        all.insert(VDB_INPUTS.into(), MetaValue::Text(self.hashes()));
        if !self.resumable.is_empty() {
            all.insert(RESUMABLE.into(), MetaValue::Text(self.resumable.clone()));
        }
        all
    }

    /// Returns the first input of a picture that is no longer what it was made from: one that the picture's
    /// `attribute`, which [`Self::hashes`] wrote, names with another hash, or one of the files that it `needs` and that
    /// the attribute does not name.
    pub(crate) fn changed<'p>(attribute: &str, needs: impl IntoIterator<Item = &'p Path>) -> Option<PathBuf> {
        let named: BTreeMap<&Path, &str> = inputs_of(attribute).collect();
        let changed = named.iter().find(|(path, hash)| !hash_of(path).is_ok_and(|now| now == **hash));
        let changed = changed.map(|(path, _)| *path);
        changed.or_else(|| needs.into_iter().find(|path| !named.contains_key(path))).map(Path::to_path_buf)
    }

    /// Returns the inputs with their hashes, as the attribute of a picture states them.
    pub(crate) fn hashes(&self) -> String {
        self.inputs.iter().map(|(name, hash)| format!("{name} sha256:{hash}")).collect::<Vec<_>>().join(", ")
    }

    /// Returns the provenance as rows of a report, label and value, without the time.
    pub(crate) fn rows(&self) -> Vec<(String, String)> {
        let mut all = vec![("Program".to_owned(), self.software.clone()), ("Command".to_owned(), self.command.clone())];
        all.extend(self.inputs.iter().map(|(name, hash)| (format!("Input {name}"), format!("sha256 {hash}"))));
        all
    }
}

/// Returns the paths and hashes of the inputs that an attribute names.
pub(crate) fn inputs_of(attribute: &str) -> impl Iterator<Item = (&Path, &str)> {
    const HASH: usize = 64;
    let mut rest = attribute;
    std::iter::from_fn(move || {
        let (name, after) = rest.split_once(" sha256:")?;
        let (hash, behind) = after.split_at_checked(HASH).unwrap_or((after, ""));
        rest = behind.strip_prefix(", ").unwrap_or(behind);
        Some((Path::new(name), hash))
    })
}

/// Adds the bytes of a file to a hash.
fn add(hash: &mut Sha256, path: &Path) -> Result<()> {
    let mut file = input::open(path)?;
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer).map_err(|e| Error::io(path, e))? {
            0 => return Ok(()),
            n => hash.update(&buffer[..n]),
        }
    }
}

/// Returns the hash of a use case's settings but for those that `left_out` names; empty for settings that no JSON
/// holds, of which nothing is known to be the same.
pub(crate) fn hash_of_settings(use_case: &str, settings: &impl Serialize, left_out: &[&[&str]]) -> String {
    let Ok(mut value) = serde_json::to_value(settings) else { return String::new() };
    if let Some(settings) = value.as_object_mut() {
        settings.retain(|name, _| !left_out.iter().any(|names| names.contains(&name.as_str())));
    }
    let mut hash = Sha256::new();
    hash.update(format!("{use_case} {value}"));
    digits(hash)
}

fn digits(hash: Sha256) -> String {
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Adds the bytes of all files in a folder and below it, in the order of their names.
fn add_folder(hash: &mut Sha256, folder: &Path) -> Result<()> {
    let mut entries = std::fs::read_dir(folder)
        .and_then(|entries| entries.map(|entry| entry.map(|entry| entry.path())).collect::<std::io::Result<Vec<_>>>())
        .map_err(|e| Error::io(folder, e))?;
    entries.sort();
    for path in entries {
        match std::fs::metadata(&path).map_err(|e| Error::io(&path, e))? {
            metadata if metadata.is_file() => add(hash, &path)?,
            // Links to folders may lead in circles.
            metadata if metadata.is_dir() && !path.is_symlink() => add_folder(hash, &path)?,
            _ => {}
        }
    }
    Ok(())
}

/// Length of a file and when it was changed: as long as they stay, its hash does.
type Stamp = (u64, Option<SystemTime>);

/// Hashes of the files that were read before.
static KNOWN: Mutex<BTreeMap<PathBuf, (Stamp, String)>> = Mutex::new(BTreeMap::new());

/// Returns the hash of a file's bytes, or of those of all files in a folder.
fn hash_of(path: &Path) -> Result<String> {
    let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
    if metadata.is_dir() {
        let mut hash = Sha256::new();
        add_folder(&mut hash, path)?;
        return Ok(digits(hash));
    }
    let stamp = (metadata.len(), metadata.modified().ok());
    let known = || KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, text)) = known().get(path).filter(|(before, _)| *before == stamp) {
        return Ok(text.clone());
    }
    let mut hash = Sha256::new();
    add(&mut hash, path)?;
    let text = digits(hash);
    known().insert(path.to_path_buf(), (stamp, text.clone()));
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_that_of_all_files_in_order() {
        let dir = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "bc"].map(|text| {
            let path = dir.path().join(text);
            std::fs::write(&path, text).unwrap();
            path
        });
        let mut p = Provenance::begin(&Context::default());
        p.input(Path::new("x"), [a.as_path(), b.as_path()]).unwrap();
        // echo -n abc | sha256sum
        assert_eq!(p.inputs["x"], "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        assert!(p.input(Path::new("y"), [dir.path().join("none").as_path()]).is_err());
        p.input(Path::new("a, b"), [a.as_path()]).unwrap();
        let attributes = p.attributes();
        let names: Vec<_> = inputs_of(&attributes["cumulo:input"]).map(|(name, _)| name).collect();
        assert_eq!(names, [Path::new("a, b"), Path::new("x")]);
        assert_eq!(inputs_of("").count() + inputs_of("damaged").count(), 0);
        assert_eq!(inputs_of("a sha256:12").collect::<Vec<_>>(), [(Path::new("a"), "12")]);
    }

    #[test]
    fn settings_are_the_same_whatever_their_manner() {
        let of = |text: &str| {
            let settings: serde_json::Value = serde_json::from_str(text).unwrap();
            Provenance::begin(&Context::default()).of("render", &settings, &["resume", "frames"]).settings
        };
        let a = of(r#"{"input": "a", "samples": 4, "resume": false}"#);
        assert_eq!(a.len(), 64);
        assert_eq!(a, of(r#"{"resume": true, "samples": 4, "frames": "1-3", "input": "a"}"#));
        assert_ne!(a, of(r#"{"input": "a", "samples": 5, "resume": false}"#));
    }

    #[test]
    fn a_search_goes_on_however_far_it_went() {
        let of = |text: &str| {
            let settings: serde_json::Value = serde_json::from_str(text).unwrap();
            Provenance::begin(&Context::default()).of_search("pose", &settings)
        };
        let a = of(r#"{"capture": "a", "iterations": 4, "init": null, "resume": false, "output": "o"}"#);
        let b = of(r#"{"capture": "a", "iterations": 9, "init": "i", "resume": true, "output": "p", "report": "r"}"#);
        assert!(a.goes_on_from(&b.resumable) && !a.same_settings(&b.settings) && !a.goes_on_from(""));
        assert!(!a.goes_on_from(&of(r#"{"capture": "b", "iterations": 4}"#).resumable));
        assert!(!Provenance::begin(&Context::default()).goes_on_from(""));
    }

    #[test]
    fn an_input_that_has_changed_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let [a, b, c] = ["a", "b, c", "c"].map(|name| dir.path().join(name));
        [&a, &b, &c].into_iter().for_each(|path| std::fs::write(path, "old").unwrap());
        let mut p = Provenance::begin(&Context::default());
        p.files([a.as_path(), &b]).unwrap();
        let changed = |needs: &[&Path]| Provenance::changed(&p.hashes(), needs.iter().copied());
        assert_eq!((changed(&[]), changed(&[&a, &b])), (None, None));
        assert_eq!(changed(&[&a, &c]), Some(c.clone()));
        assert_eq!(Provenance::changed("", [a.as_path()]), Some(a.clone()));
        // The time alone does not count, and the length need not differ.
        let file = std::fs::File::options().append(true).open(&a).unwrap();
        file.set_modified(SystemTime::now() + std::time::Duration::from_secs(5)).unwrap();
        assert_eq!(changed(&[&a]), None);
        std::fs::write(&b, "new").unwrap();
        std::fs::File::options().append(true).open(&b).unwrap().set_modified(SystemTime::UNIX_EPOCH).unwrap();
        assert_eq!(changed(&[&a]), Some(b.clone()));
        std::fs::remove_file(&a).unwrap();
        assert_eq!(changed(&[]), Some(a.clone()));
    }
}
