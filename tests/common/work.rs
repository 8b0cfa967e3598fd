//! The program, a folder of its own for it to work in, and what it reads and writes there.

use super::{grids, refusal};
use ::exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, ImageAttributes, Layer, LayerAttributes, WritableImage,
};
use cumulo::error::Code;
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::File;
use cumulo::scene::film::Film;
use cumulo::scene::grid::Grid;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

pub fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

/// The same as text.
pub fn fixture_text(name: &str) -> String {
    fixture(name).to_str().unwrap().to_owned()
}

/// The program.
pub fn cumulo() -> assert_cmd::Command {
    assert_cmd::Command::new(env!("CARGO_BIN_EXE_cumulo"))
}

/// A number of a report.
pub fn number(report: &Value, key: &str) -> f64 {
    report[key].as_f64().unwrap_or_else(|| panic!("no {key} in {report}"))
}

/// The density of a VDB.
pub fn density(path: &Path) -> Grid {
    File::open(path, Limits::default()).unwrap().read_fog(None).unwrap()
}

/// Writes an EXR of 32-bit channels in one part; `edit` sets its attributes.
pub fn write_exr(
    path: &Path,
    size: [usize; 2],
    channels: &[(&str, Vec<f32>)],
    edit: impl FnOnce(&mut ImageAttributes, &mut LayerAttributes),
) {
    let size = (size[0], size[1]);
    let channel = |(name, samples): &(&str, Vec<f32>)| AnyChannel::new(*name, FlatSamples::F32(samples.clone()));
    let (mut shared, mut own) = (ImageAttributes::with_size(size), LayerAttributes::default());
    edit(&mut shared, &mut own);
    let channels = AnyChannels::sort(channels.iter().map(channel).collect());
    let layer = Layer::new(size, own, Encoding::FAST_LOSSLESS, channels);
    Image::new(shared, layer).write().to_file(path).unwrap();
}

pub struct Work(TempDir);

impl Work {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The program in this folder; words are split at blanks, `@name` is a fixture.
    pub fn command(&self, words: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cumulo"));
        command.current_dir(self.0.path());
        for word in words.split_whitespace() {
            match word.strip_prefix('@') {
                Some(name) => command.arg(fixture(name)),
                None => command.arg(word),
            };
        }
        command
    }

    /// Runs it, expects success and gives its JSON.
    pub fn json(&self, words: &str) -> Value {
        let out = self.command(words).arg("--json").output().unwrap();
        assert!(out.status.success(), "{words}: {}", errors(&out));
        serde_json::from_slice(&out.stdout).unwrap()
    }

    /// Runs it, expects success and gives its text.
    pub fn text(&self, words: &str) -> String {
        let out = self.command(words).output().unwrap();
        assert!(out.status.success(), "{words}: {}", errors(&out));
        String::from_utf8(out.stdout).unwrap()
    }

    /// Runs it, and expects an error of this code that names these facts ([`refusal::refused`]).
    pub fn refused(&self, words: &str, code: Code, facts: &[&str]) {
        refusal::refused(&mut self.command(words), code, facts);
    }

    /// `cumulo diff`'s entry of the only grid.
    pub fn difference(&self, a: &str, b: &str) -> Value {
        let out = self.command(&format!("diff {a} {b} --json")).output().unwrap();
        assert!(!out.stdout.is_empty(), "{}", errors(&out));
        serde_json::from_slice::<Value>(&out.stdout).unwrap()["grids"][0].clone()
    }

    pub fn volume_psnr(&self, b: &str) -> f64 {
        self.difference("@plume.vdb", b)["psnr_db"].as_f64().unwrap()
    }

    /// Starts it without waiting.
    pub fn start(&self, words: &str) -> Child {
        self.command(words).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    }

    /// Starts a command, and returns once it tells of its first event: its work has begun, and it handles signals.
    pub fn begun(&self, words: &str) -> Child {
        self.reached(words, |_| true)
    }

    /// Starts a command, and returns once it tells of an event of which `holds` is true.
    pub fn reached(&self, words: &str, holds: impl Fn(&Value) -> bool) -> Child {
        let mut child = self.start(&format!("{words} --progress json"));
        while !holds(&event(&mut child)) {}
        child
    }

    /// Every file beneath a folder and its bytes, but for those that a running program moves meanwhile.
    pub fn files(&self, folder: &str) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut found = BTreeMap::new();
        let mut left = vec![self.path(folder)];
        while let Some(dir) = left.pop() {
            let entries = match std::fs::read_dir(&dir) {
                Ok(entries) => entries,
                Err(error) => {
                    assert_ne!(dir, self.path(folder), "{error}");
                    continue;
                }
            };
            for entry in entries {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    found.insert(path.clone(), Vec::new());
                    left.push(path);
                } else {
                    match std::fs::read(&path) {
                        Ok(bytes) => drop(found.insert(path, bytes)),
                        Err(error) => assert_eq!(error.kind(), std::io::ErrorKind::NotFound, "{error}"),
                    }
                }
            }
        }
        found
    }

    /// Writes a VDB of these grids.
    pub fn write(&self, name: &str, volumes: &[&Grid]) {
        grids::write(&self.path(name), volumes);
    }

    pub fn picture(&self, name: &str) -> Film {
        cumulo::formats::exr::read_picture(&self.path(name), None).unwrap()
    }

    /// Changes every picture of a capture.
    pub fn edit(&self, folder: &str, mut change: impl FnMut(usize, &mut Film)) {
        let capture = cumulo::formats::transforms::load(&self.path(folder)).unwrap();
        for (i, frame) in capture.frames.iter().enumerate() {
            let mut film = cumulo::formats::exr::read_picture(&frame.picture, None).unwrap();
            change(i, &mut film);
            cumulo::formats::exr::write_picture(
                &frame.picture,
                &film,
                &BTreeMap::new(),
                cumulo::formats::exr::Half::None,
            )
            .unwrap();
        }
    }
}

/// The next event that a process tells of.
#[allow(clippy::unbuffered_bytes, reason = "all that comes later is left to the caller")]
fn event(child: &mut Child) -> Value {
    let bytes = child.stderr.as_mut().unwrap().bytes().map(Result::unwrap);
    let line: Vec<u8> = bytes.take_while(|byte| *byte != b'\n').collect();
    serde_json::from_slice(&line).unwrap_or_else(|e| panic!("{e}: '{}'", String::from_utf8_lossy(&line)))
}

pub fn errors(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

/// Sends Ctrl-C and waits.
pub fn interrupt(child: Child) -> Output {
    let status = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(status.success());
    child.wait_with_output().unwrap()
}

/// Waits until something holds.
///
/// # Panics
/// After twenty seconds.
pub fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < Duration::from_secs(20), "{what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Runs a script in Debian's Python, which has pyopenvdb.
///
/// # Panics
/// If the script fails, with what it printed.
pub fn python(script: &str) {
    let out = Command::new("/usr/bin/python3").args(["-c", script]).output().unwrap();
    assert!(out.status.success(), "{}\n{script}", String::from_utf8_lossy(&out.stderr));
}
