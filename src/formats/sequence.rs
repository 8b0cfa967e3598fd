//! Sequences of numbered files: `smoke.####.vdb`, `smoke.%04d.vdb`, `smoke.$F4.vdb` and `smoke.0001-0100.vdb` all mean
//! `smoke.0001.vdb` and so on.

use crate::error::{Error, Result};
use crate::text::serde_as_text;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Most frames of a sequence.
pub(crate) const MOST_FRAMES: usize = 100_000;

/// Frames to work on: every `step`-th number from the first to the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frames {
    /// First number.
    pub first: u32,
    /// Last number.
    pub last: u32,
    /// Step from one to the next.
    pub step: u32,
}

impl Frames {
    /// Returns the numbers in ascending order.
    pub fn numbers(self) -> impl Iterator<Item = u32> {
        (self.first..=self.last).step_by(self.step as usize)
    }
}

impl fmt::Display for Frames {
    /// Writes the text that [`FromStr`] reads.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { first, last, step } = self;
        match (first == last, step) {
            (true, _) => write!(f, "{first}"),
            (false, 1) => write!(f, "{first}-{last}"),
            (false, _) => write!(f, "{first}-{last}x{step}"),
        }
    }
}

serde_as_text!(Frames);

impl FromStr for Frames {
    type Err = String;

    /// Reads `7`, `1-24` or `1-24x2`.
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let number = |text: &str| text.parse::<u32>().ok();
        let read = || {
            let (range, step) = text.split_once('x').unwrap_or((text, "1"));
            let (first, last) = range.split_once('-').unwrap_or((range, range));
            Some(Self { first: number(first)?, last: number(last)?, step: number(step)? })
        };
        match read() {
            Some(frames) if frames.first > frames.last || frames.step == 0 => Err("the range is empty".into()),
            Some(frames) if (frames.last - frames.first) as usize / frames.step as usize >= MOST_FRAMES => {
                Err(format!("more than {MOST_FRAMES} frames"))
            }
            Some(frames) => Ok(frames),
            None => Err("a frame such as 7, or frames such as 1-24 or 1-100x2, are expected".into()),
        }
    }
}

/// Path of numbered files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    folder: PathBuf,
    /// Name before and after the number.
    head: String,
    tail: String,
    /// Least number of digits.
    digits: usize,
    /// Frames that the pattern itself names.
    frames: Option<Frames>,
}

impl Pattern {
    /// Reads a path; `None` if its name has no number to be filled in. A file that exists under the very name is no
    /// pattern.
    pub fn parse(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?;
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        let (start, end, digits, frames) =
            hashes(name).or_else(|| percent(name)).or_else(|| houdini(name)).or_else(|| range(name))?;
        if path.exists() {
            return None;
        }
        Some(Self { folder, head: name[..start].into(), tail: name[end..].into(), digits, frames })
    }

    /// Returns the sequences of a folder's files: those with two numbers at least, whose names end in one of `endings`.
    /// The number is the last one before the extension.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub(crate) fn in_folder(folder: &Path, endings: &[&str]) -> Result<Vec<Self>> {
        let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
        let mut groups: BTreeMap<(String, String), BTreeSet<String>> = BTreeMap::new();
        for name in entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok()) {
            let Some((stem, ending)) = name.rsplit_once('.') else { continue };
            let Some((start, end)) = last_number(stem).filter(|(start, end)| end - start <= 9) else { continue };
            if endings.iter().any(|known| known.eq_ignore_ascii_case(ending)) {
                let key = (name[..start].to_owned(), name[end..].to_owned());
                groups.entry(key).or_default().insert(name[start..end].to_owned());
            }
        }
        let pattern = |((head, tail), numbers): ((String, String), BTreeSet<String>)| {
            let digits = numbers.iter().map(String::len).min().unwrap_or(1);
            let pattern = Self { folder: folder.to_owned(), head, tail, digits, frames: None };
            (numbers.len() > 1).then_some(pattern)
        };
        Ok(groups.into_iter().filter_map(pattern).collect())
    }

    /// Returns the path with the number's digits written as `#`.
    pub fn name(&self) -> PathBuf {
        self.folder.join(format!("{}{}{}", self.head, "#".repeat(self.digits), self.tail))
    }

    /// Returns the same names in another folder.
    #[must_use]
    pub fn moved(&self, folder: &Path) -> Self {
        Self { folder: folder.to_owned(), ..self.clone() }
    }

    /// Returns the frames that the pattern itself names, as `smoke.0001-0100.vdb` does.
    pub fn named(&self) -> Option<Frames> {
        self.frames
    }

    /// Returns the path of a frame's file.
    pub fn path(&self, number: u32) -> PathBuf {
        let Self { folder, head, tail, digits, .. } = self;
        folder.join(format!("{head}{number:0digits$}{tail}"))
    }

    /// Returns the numbers of the frames: those that the pattern names, else those of the files that exist.
    ///
    /// # Errors
    /// If the folder cannot be read, or holds no such file.
    pub fn numbers(&self) -> Result<Vec<u32>> {
        if let Some(frames) = self.frames {
            return Ok(frames.numbers().collect());
        }
        let folder = if self.folder.as_os_str().is_empty() { Path::new(".") } else { &self.folder };
        let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
        let number = |name: &str| {
            let digits = name.strip_prefix(&self.head)?.strip_suffix(&self.tail)?;
            let number = digits.parse().ok()?;
            (self.path(number).file_name()?.to_str()? == name).then_some(number)
        };
        let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        let numbers: BTreeSet<u32> = names.filter_map(|name| number(&name)).collect();
        if numbers.is_empty() {
            return Err(Error::invalid("no file has such a name").at(self.path(1)).hint(
                "the pattern stands for numbers of so many digits, such as smoke.0001.vdb for smoke.####.vdb; correct \
                 it",
            ));
        }
        Ok(numbers.into_iter().take(MOST_FRAMES).collect())
    }
}

impl Pattern {
    /// Returns the numbers of all frames, those between the first and the last that are [missing](holes) among them.
    ///
    /// # Errors
    /// The conditions are those of [`Self::numbers`].
    pub(crate) fn all_numbers(&self) -> Result<Vec<u32>> {
        let mut all = self.numbers()?;
        all.extend(holes(&all));
        all.sort_unstable();
        Ok(all)
    }
}

/// Returns the numbers that are missing between the first and the last frame of a sequence, at most `MOST_FRAMES`.
/// Three frames or more whose numbers are all multiples of a step apart, as those of `frames = 1-9x2`, are whole at
/// that step.
pub fn holes(numbers: &[u32]) -> Vec<u32> {
    let steps = numbers.windows(2).map(|pair| pair[1] - pair[0]);
    let step = if numbers.len() < 3 { 1 } else { steps.fold(0, divisor).max(1) };
    let between = |pair: &[u32]| (pair[0]..pair[1]).step_by(step as usize).skip(1);
    numbers.windows(2).flat_map(between).take(MOST_FRAMES).collect()
}

/// Greatest common divisor.
fn divisor(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { divisor(b, a % b) }
}

/// Start and end of the number in a name, its digits, and the frames that it names.
type Place = (usize, usize, usize, Option<Frames>);

fn hashes(name: &str) -> Option<Place> {
    let start = name.find('#')?;
    let digits = name[start..].bytes().take_while(|b| *b == b'#').count();
    Some((start, start + digits, digits, None))
}

fn percent(name: &str) -> Option<Place> {
    let start = name.find('%')?;
    let inner = &name[start + 1..];
    let end = inner.find('d')?;
    let width = inner[..end].strip_prefix('0').unwrap_or(&inner[..end]);
    let digits = if width.is_empty() { 1 } else { width.parse().ok().filter(|digits| *digits <= 9)? };
    Some((start, start + end + 2, digits, None))
}

/// Houdini's `$F`, `$F4` and `${F4}`.
fn houdini(name: &str) -> Option<Place> {
    let start = name.find("$F").or_else(|| name.find("${F"))?;
    let braced = name[start + 1..].starts_with('{');
    let from = start + 2 + usize::from(braced);
    let digit = name[from..].chars().next().and_then(|c| c.to_digit(10)).filter(|digits| *digits > 0);
    let end = from + usize::from(digit.is_some());
    match (braced, name[end..].starts_with('}')) {
        (true, true) => Some((start, end + 1, digit.unwrap_or(1) as usize, None)),
        (false, _) => Some((start, end, digit.unwrap_or(1) as usize, None)),
        (true, false) => None,
    }
}

/// Two groups of as many digits around a dash, behind a dot: other names have dashes of their own.
fn range(name: &str) -> Option<Place> {
    for (start, _) in name.match_indices('.') {
        let rest = &name[start + 1..];
        let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
        let first = digits(rest);
        let Some(last) = rest[first..].strip_prefix('-').map(digits) else { continue };
        if first > 0 && last >= first && last <= 9 {
            let end = start + 1 + first + 1 + last;
            let frames = name[start + 1..end].parse().ok()?;
            return Some((start + 1, end, first, Some(frames)));
        }
    }
    None
}

/// Returns the last number in the name of a file before its extension, as of `frame.0012.exr` or `view_012.exr`.
pub fn number_of(path: &Path) -> Option<u32> {
    let stem = path.file_stem()?.to_str()?;
    let (start, end) = last_number(stem)?;
    stem[start..end].parse().ok()
}

/// Returns the start and the end of the last number in a text.
fn last_number(text: &str) -> Option<(usize, usize)> {
    let end = text.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = text[..end].char_indices().rev().take_while(|(_, c)| c.is_ascii_digit()).last()?.0;
    Some((start, end))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn patterns_name_files() {
        let named = |pattern: &str, number| {
            Pattern::parse(Path::new(pattern)).map(|pattern| pattern.path(number).to_str().unwrap().to_owned())
        };
        assert_eq!(named("a/smoke.####.vdb", 7).unwrap(), "a/smoke.0007.vdb");
        assert_eq!(named("smoke_##.vdb", 123).unwrap(), "smoke_123.vdb");
        assert_eq!(named("smoke.%04d.vdb", 7).unwrap(), "smoke.0007.vdb");
        assert_eq!(named("smoke%d.vdb", 7).unwrap(), "smoke7.vdb");
        assert_eq!(named("smoke.$F4.vdb", 7).unwrap(), "smoke.0007.vdb");
        assert_eq!(named("smoke.$F.vdb", 7).unwrap(), "smoke.7.vdb");
        assert_eq!(named("smoke.${F3}.vdb", 7).unwrap(), "smoke.007.vdb");
        assert_eq!(named("smoke.0001-0100.vdb", 7).unwrap(), "smoke.0007.vdb");
        for plain in
            ["smoke.vdb", "smoke.0001.vdb", "2024-01-02.vdb", "100%.vdb", "", "a-1-2.vdb", "${F4.vdb", "$E.vdb"]
        {
            assert_eq!(named(plain, 7), None, "{plain}");
        }
        let pattern = Pattern::parse(Path::new("smoke.0098-0100.vdb")).unwrap();
        assert_eq!(pattern.numbers().unwrap(), [98, 99, 100]);
    }

    #[test]
    fn files_are_found() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["s.0003.vdb", "s.0001.vdb", "s.12.vdb", "s.10001.vdb", "t.0002.vdb", "s.0x01.vdb"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let numbers = |name: &str| Pattern::parse(&folder.path().join(name)).unwrap().numbers();
        assert_eq!(numbers("s.####.vdb").unwrap(), [1, 3, 10001]);
        assert!(numbers("u.####.vdb").unwrap_err().to_string().contains("u.0001.vdb"));
        assert_eq!(Pattern::parse(&folder.path().join("s.0001.vdb")), None);
    }

    #[test]
    fn holes_lie_between_the_first_and_the_last() {
        for (there, missing) in [
            (&[][..], &[][..]),
            (&[7], &[]),
            (&[1, 2, 3], &[]),
            (&[1, 2, 4], &[3]),
            (&[1, 3], &[2]),
            (&[1, 3, 5], &[]),
            (&[0, 10, 30, 40], &[20]),
            (&[1, 3, 4], &[2]),
        ] {
            assert_eq!(holes(there), missing, "{there:?}");
        }
        assert_eq!(holes(&[1, 2, u32::MAX]).len(), MOST_FRAMES);
    }

    #[test]
    fn folders_hold_sequences() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["s.0003.vdb", "s.0001.vdb", "v_009.exr", "v_010.exr", "s.0001.exr", "plain.vdb", "b2.vdb", "1.txt"]
        {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let found = Pattern::in_folder(folder.path(), &["vdb", "exr"]).unwrap();
        let names: Vec<_> = found.iter().map(|p| p.name().file_name().unwrap().to_str().unwrap().to_owned()).collect();
        assert_eq!(names, ["s.####.vdb", "v_###.exr"]);
        assert_eq!(found[0].numbers().unwrap(), [1, 3]);
        assert_eq!(found[0].moved(Path::new("out")).path(7), Path::new("out/s.0007.vdb"));
        assert!(Pattern::in_folder(&folder.path().join("none"), &["vdb"]).is_err());
    }

    #[test]
    fn frames_are_read() {
        let read = |text: &str| text.parse::<Frames>().map(|frames| frames.numbers().collect::<Vec<_>>());
        assert_eq!(
            (read("7").unwrap(), read("1-3").unwrap(), read("1-8x3").unwrap()),
            (vec![7], vec![1, 2, 3], vec![1, 4, 7])
        );
        for bad in ["", "3-1", "1-", "a", "1-2x0", "-3", "0-4294967295"] {
            assert!(read(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn names_have_numbers() {
        let number = |name: &str| number_of(Path::new(name));
        assert_eq!(
            [number("a1/frame.0012.exr"), number("view_007.exr"), number("x3y.exr")],
            [Some(12), Some(7), Some(3)]
        );
        assert_eq!(number("view.exr"), None);
    }
}
