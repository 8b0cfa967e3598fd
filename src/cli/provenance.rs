//! Where an output comes from: version, command line, hashes of the inputs, wall time.

use crate::error::{Error, Result};
use crate::formats::exr::Attributes;
use crate::formats::input;
use crate::scene::grid::MetaValue;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::time::Instant;

/// Origin of an output: program, command line, inputs and wall time.
#[derive(Debug, Clone, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Provenance {
    /// Name and version of the program.
    pub software: String,
    /// Command line, its words quoted for a shell.
    pub command: String,
    /// SHA-256 of the bytes of each input in hexadecimal digits, by the input's path.
    pub inputs: BTreeMap<String, String>,
    /// Seconds from the start of the command to the writing of the output.
    pub seconds: f64,
    #[serde(skip, default = "Instant::now")]
    start: Instant,
}

impl Provenance {
    /// Begins with this process's command line, and starts the clock.
    pub fn begin() -> Self {
        let words = std::env::args_os().map(|word| quoted(&word.to_string_lossy()));
        Self {
            software: concat!("cumulo ", env!("CARGO_PKG_VERSION")).to_owned(),
            command: words.collect::<Vec<_>>().join(" "),
            inputs: BTreeMap::new(),
            seconds: 0.0,
            start: Instant::now(),
        }
    }

    /// Adds an input: one hash over the bytes of all `files`, in their order.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn input<'a>(&mut self, name: &Path, files: impl IntoIterator<Item = &'a Path>) -> Result<()> {
        let mut hash = Sha256::new();
        let mut buffer = vec![0; 1 << 16];
        for path in files {
            let mut file = input::open(path)?;
            loop {
                match file.read(&mut buffer).map_err(|e| Error::io(path, e))? {
                    0 => break,
                    n => hash.update(&buffer[..n]),
                }
            }
        }
        let text = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
        self.inputs.insert(name.display().to_string(), text);
        Ok(())
    }

    /// Returns the seconds since the start, and keeps them as the time of the output.
    pub fn lap(&mut self) -> f64 {
        self.seconds = self.start.elapsed().as_secs_f64();
        self.seconds
    }

    /// Returns the provenance as attributes of an EXR, without the time.
    pub fn attributes(&self) -> Attributes {
        let mut all = Attributes::new();
        all.insert("software".into(), self.software.clone());
        all.insert("cumulo:command".into(), self.command.clone());
        all.insert("cumulo:input".into(), self.hashes());
        all
    }

    /// Returns the provenance as metadata of a VDB.
    pub fn metadata(&self) -> BTreeMap<String, MetaValue> {
        let mut all = BTreeMap::new();
        all.insert("creator".into(), MetaValue::Text(self.software.clone()));
        all.insert("cumulo_command".into(), MetaValue::Text(self.command.clone()));
        all.insert("cumulo_seconds".into(), MetaValue::Float(self.seconds));
        all.insert("cumulo_input".into(), MetaValue::Text(self.hashes()));
        all
    }

    /// Returns the paths of the inputs that a picture's attribute `cumulo:input` names.
    pub fn inputs_of(attribute: &str) -> impl Iterator<Item = &Path> {
        const HASH: usize = 64;
        let mut rest = attribute;
        std::iter::from_fn(move || {
            let (name, after) = rest.split_once(" sha256:")?;
            rest = after.get(HASH..).unwrap_or_default();
            rest = rest.strip_prefix(", ").unwrap_or(rest);
            Some(Path::new(name))
        })
    }

    fn hashes(&self) -> String {
        self.inputs.iter().map(|(name, hash)| format!("{name} sha256:{hash}")).collect::<Vec<_>>().join(", ")
    }

    /// Returns the provenance as rows of a report, label and value, without the time.
    pub fn rows(&self) -> Vec<(String, String)> {
        let mut all = vec![("Program".to_owned(), self.software.clone()), ("Command".to_owned(), self.command.clone())];
        all.extend(self.inputs.iter().map(|(name, hash)| (format!("Input {name}"), format!("sha256 {hash}"))));
        all
    }
}

/// Quotes a word of a command line for a shell, if it needs quotes.
pub fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+%@".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_survive_a_shell() {
        assert_eq!(quoted("a/b.vdb"), "a/b.vdb");
        assert_eq!(quoted("a b"), "'a b'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
    }

    #[test]
    fn the_hash_is_that_of_all_files_in_order() {
        let dir = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "bc"].map(|text| {
            let path = dir.path().join(text);
            std::fs::write(&path, text).unwrap();
            path
        });
        let mut p = Provenance::begin();
        p.input(Path::new("x"), [a.as_path(), b.as_path()]).unwrap();
        // echo -n abc | sha256sum
        assert_eq!(p.inputs["x"], "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        assert!(p.input(Path::new("y"), [dir.path().join("none").as_path()]).is_err());
        p.input(Path::new("a, b"), [a.as_path()]).unwrap();
        let attributes = p.attributes();
        let names: Vec<_> = Provenance::inputs_of(&attributes["cumulo:input"]).collect();
        assert_eq!(names, [Path::new("a, b"), Path::new("x")]);
        assert_eq!(Provenance::inputs_of("").count() + Provenance::inputs_of("damaged").count(), 0);
    }
}
