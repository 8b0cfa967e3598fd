//! Sequences of files, and which of their frames are worked on.

use crate::app::scan::ScanSettings;
use crate::app::volume;
use crate::error::{Error, Result};
use crate::formats::format::FileKind;
use crate::formats::sequence::{Frames, Pattern};
use crate::formats::{captures, registry};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Frames of sequences to work on; by default those that a name tells, else all that are there.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct FrameSelection(pub Option<Frames>);

/// Files of a sequence.
#[derive(Debug, Clone)]
pub struct Sequence {
    /// Names of the files.
    pub pattern: Pattern,
    /// Numbers of the frames to work on, in ascending order. Those that are missing between the first and the last are
    /// among them, and fail by name as those do that cannot be read.
    pub numbers: Vec<u32>,
}

impl Sequence {
    /// Returns the path of a frame's file.
    pub(crate) fn path(&self, number: u32) -> PathBuf {
        self.pattern.path(number)
    }

    /// Returns the numbers of the frames whose files are there, and those that are missing.
    ///
    /// # Errors
    /// If no frame is there; `work`, such as "read", says what all frames would be used for.
    pub(crate) fn present(&self, work: &str) -> Result<Present> {
        let is_there = |number: &u32| self.path(*number).exists();
        let (numbers, missing): (Vec<u32>, Vec<u32>) = self.numbers.iter().partition(|number| is_there(number));
        match numbers[..] {
            [first, ..] => Ok(Present { first, last: numbers[numbers.len() - 1], numbers, missing }),
            [] => Err(Error::invalid("none of the frames is there")
                .at(self.pattern.name())
                .hint(format!("check the numbers, or leave ⟨frames⟩ out to {work} all that are there"))),
        }
    }
}

/// Frames of a sequence that are there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Present {
    /// Numbers of the frames, in ascending order.
    pub numbers: Vec<u32>,
    /// Number of the first frame.
    pub first: u32,
    /// Number of the last frame.
    pub last: u32,
    /// Numbers of the frames whose files are not there.
    pub missing: Vec<u32>,
}

impl FrameSelection {
    /// Returns the sequences that a path names where captures are meant, too: the one of a pattern, or those of a
    /// folder that is no capture, of volumes, pictures and stages. None for the path of a file or a capture.
    ///
    /// # Errors
    /// If a pattern matches no file, or a folder holds neither a capture nor a sequence.
    pub(crate) fn sequences(self, path: &Path) -> Result<Vec<Sequence>> {
        if path.is_dir() && captures::file(path).exists() {
            return Ok(Vec::new());
        }
        // Scans are frames where they are converted or named by a pattern, and may lie beside the sequences of a
        // folder.
        let endings = registry::frame_endings(|kind| !matches!(kind, FileKind::Image(_)));
        let all = self.all(path, &endings)?;
        if all.is_empty() && path.is_dir() && !volume::is_scan(path) {
            let endings = endings.iter().map(|ending| format!(".{ending}")).collect::<Vec<_>>().join(", ");
            return Err(Error::invalid("the folder holds neither a capture nor a sequence").at(path).hint(format!(
                "a capture is a transforms.json, a model of COLMAP (cameras and images, .txt or .bin) or the folder \
                 that holds one, a sequence two numbered files or more ({endings}); of other files give the names"
            )));
        }
        Ok(all)
    }

    fn all(self, path: &Path, endings: &[&str]) -> Result<Vec<Sequence>> {
        let patterns = match pattern(path) {
            Some(pattern) => vec![pattern],
            None if path.is_dir() => Pattern::in_folder(path, endings)?,
            None => Vec::new(),
        };
        let sequence = |pattern: Pattern| {
            let numbers = numbers(self.0, &pattern)?;
            Ok(Sequence { pattern, numbers })
        };
        patterns.into_iter().map(sequence).collect()
    }

    /// Returns the sequence that a path names; none for the path of a file.
    ///
    /// # Errors
    /// If a pattern or a folder matches no file, or a folder holds several sequences.
    pub(crate) fn sequence(self, path: &Path, endings: &[&str]) -> Result<Option<Sequence>> {
        let mut all = self.all(path, endings)?;
        if all.len() > 1 {
            let names: Vec<String> = all.iter().map(|s| s.pattern.name().display().to_string()).collect();
            return Err(Error::invalid(format!("the folder holds several sequences: {}", names.join(", ")))
                .at(path)
                .hint("name one of them, in quotes"));
        }
        Ok(all.pop())
    }

    /// Returns the sequence that a path names, as [`Self::sequence`] does: in a folder one of `kinds`, else one of
    /// scans, unless the folder is a scan itself.
    ///
    /// # Errors
    /// Those of [`Self::sequence`].
    pub(crate) fn of_volumes(self, path: &Path, kinds: impl Fn(FileKind) -> bool) -> Result<Option<Sequence>> {
        let found = self.sequence(path, &registry::frame_endings(kinds))?;
        if found.is_some() || !path.is_dir() || volume::is_scan(path) {
            return Ok(found);
        }
        self.sequence(path, &registry::frame_endings(|kind| matches!(kind, FileKind::Image(_))))
    }

    /// Returns the sequences that two paths name by `find`; none for the paths of two files.
    ///
    /// # Errors
    /// If only one of them is a sequence, or frames are selected of files.
    pub(crate) fn pair(
        self,
        [a, b]: [&Path; 2],
        find: impl Fn(&Path) -> Result<Option<Sequence>>,
    ) -> Result<Option<[Sequence; 2]>> {
        match (find(a)?, find(b)?) {
            (Some(first), Some(second)) => Ok(Some([first, second])),
            (None, None) => self.refuse(a).map(|()| None),
            (first, _) => Err(Error::invalid("this is a file, and the other one is a sequence")
                .at(if first.is_some() { b } else { a })
                .hint("give two files, or two sequences such as 'a.####.vdb' and 'b.####.vdb'")),
        }
    }

    /// Refuses a selection of frames where no sequence is named.
    ///
    /// # Errors
    /// If frames are selected.
    pub(crate) fn refuse(self, path: &Path) -> Result<()> {
        match self.0 {
            Some(_) => Err(Error::invalid("⟨frames⟩: this names no sequence").at(path).hint(
                "give a name with the number's place, in quotes, such as 'smoke.####.vdb', or leave ⟨frames⟩ out",
            )),
            None => Ok(()),
        }
    }
}

/// Returns the names of the sequence that a path stands for; none for the path of a file, or for a pattern whose files
/// are the slices of one scan.
pub(crate) fn pattern(path: &Path) -> Option<Pattern> {
    Pattern::parse(path).filter(|_| !volume::is_stack(path))
}

/// Returns the numbers of the frames to work on, in ascending order: those that are asked for, else all from the first
/// to the last that is there.
///
/// # Errors
/// If none is there and none is asked for.
pub(crate) fn numbers(frames: Option<Frames>, pattern: &Pattern) -> Result<Vec<u32>> {
    frames.map_or_else(|| pattern.all_numbers(), |frames| Ok(frames.numbers().collect()))
}

/// Returns the numbers that all sequences have, and those that only some have. A frame that is missing in a sequence,
/// between its first and its last or among those that were asked for, counts among its numbers: its work fails, and
/// names it.
pub(crate) fn common(sequences: &[&Sequence]) -> (Vec<u32>, Vec<u32>) {
    let mut union: Vec<u32> = sequences.iter().flat_map(|s| s.numbers.iter().copied()).collect();
    union.sort_unstable();
    union.dedup();
    union.into_iter().partition(|number| sequences.iter().all(|s| s.numbers.binary_search(number).is_ok()))
}

impl ScanSettings {
    /// Refuses settings that have an effect on none of several files and sequences.
    ///
    /// # Errors
    /// If there is one; the error names it. What cannot be read counts as nothing.
    pub(crate) fn check_files<'p>(
        &self,
        paths: impl IntoIterator<Item = &'p Path>,
        frames: FrameSelection,
    ) -> Result<()> {
        if *self == Self::default() {
            return Ok(());
        }
        let mut formats = Vec::new();
        let mut first = Path::new("");
        for path in paths {
            let sequences = frames.sequences(path).unwrap_or_default();
            let frame = |s: &Sequence| Some(s.path(*s.present("read").ok()?.numbers.first()?));
            let frames: Vec<PathBuf> = sequences.iter().filter_map(frame).collect();
            let frames = if frames.is_empty() { vec![path.to_path_buf()] } else { frames };
            formats.extend(frames.iter().filter_map(|frame| volume::format_of(frame).ok()));
            if first.as_os_str().is_empty() {
                first = path;
            }
        }
        self.check_any(&formats, first)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::formats::sequence::MOST_FRAMES;

    fn files(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        names.iter().for_each(|name| std::fs::write(folder.path().join(name), "").unwrap());
        folder
    }

    #[test]
    fn a_folder_or_a_pattern_is_a_sequence_and_a_file_is_none() {
        let folder = files(&["s.0001.vdb", "s.0002.vdb", "s.0004.vdb", "t.vdb"]);
        let option = FrameSelection::default();
        let of = |path: &Path| {
            let sequence = option.sequence(path, &["vdb"]).unwrap()?;
            let Present { numbers, missing, .. } = sequence.present("read").unwrap();
            Some((numbers, missing))
        };
        assert!(option.sequences(&folder.path().join("t.vdb")).unwrap().is_empty());
        assert_eq!(of(folder.path()), Some((vec![1, 2, 4], vec![3])));
        assert_eq!(of(&folder.path().join("s.####.vdb")), Some((vec![1, 2, 4], vec![3])));
        assert_eq!(of(&folder.path().join("s.0001-0005.vdb")), Some((vec![1, 2, 4], vec![3, 5])));
        assert_eq!(of(&folder.path().join("t.vdb")), None);
        let frames = FrameSelection(Some("2-6x2".parse().unwrap()));
        let chosen = frames.sequence(folder.path(), &["vdb"]).unwrap().unwrap();
        assert_eq!((chosen.numbers.clone(), chosen.present("read").unwrap().missing), (vec![2, 4, 6], vec![6]));
        assert!(frames.refuse(folder.path()).is_err() && option.refuse(folder.path()).is_ok());
        std::fs::write(folder.path().join("u.1.vdb"), "").unwrap();
        std::fs::write(folder.path().join("u.2.vdb"), "").unwrap();
        assert!(option.sequence(folder.path(), &["vdb"]).unwrap_err().to_string().contains("u.#.vdb"));
    }

    /// Names with dates are numbers far apart, which no loop may count through.
    #[test]
    fn numbers_far_apart_take_no_time() {
        let folder = files(&["g.1.vdb", "g.3.vdb", "g.999999999.vdb"]);
        let all = FrameSelection::default().sequences(folder.path()).unwrap();
        let present = all[0].present("read").unwrap();
        assert_eq!((present.first, present.last, &present.numbers[..]), (1, 999_999_999, &[1, 3, 999_999_999][..]));
        assert_eq!((present.missing.len(), &present.missing[..2]), (MOST_FRAMES, &[5, 7][..]));
    }

    #[test]
    fn a_folder_of_neither_kind_says_what_was_looked_for() {
        let folder = files(&["one.0007.vdb", "note.txt"]);
        let error = FrameSelection::default().sequences(folder.path()).unwrap_err().to_string();
        assert!(error.contains("neither a capture nor a sequence") && error.contains(".vdb"), "{error}");
    }
}
