//! The files of a stack: one file, a folder of slices, or those that a pattern names.

use crate::error::{Error, Result};
use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// Largest number of slices.
const MOST_FILES: usize = 100_000;

/// Says whether a path is a folder with TIFFs, or a pattern that names some.
pub(crate) fn is_stack(path: &Path) -> bool {
    if path.is_file() {
        return false;
    }
    let any = |folder: &Path, wanted: &dyn Fn(&str) -> bool| {
        std::fs::read_dir(folder).is_ok_and(|entries| {
            entries.flatten().any(|e| e.file_name().to_str().is_some_and(|n| is_tiff_name(n) && wanted(n)))
        })
    };
    if path.is_dir() {
        return any(path, &|_| true);
    }
    Pattern::parse(path).is_some_and(|(folder, pattern)| any(&folder, &|name| pattern.matches(name)))
}

fn is_tiff_name(name: &str) -> bool {
    let ending = name.rsplit_once('.').map(|(_, ending)| ending);
    ending.is_some_and(|ending| super::ENDINGS.iter().any(|known| known.eq_ignore_ascii_case(ending)))
}

/// Lists the files of a stack in natural order, in which `slice9.tif` comes before `slice10.tif`; at least one.
///
/// # Errors
/// If a folder cannot be read, no file is there, or there are more than a hundred thousand.
pub(crate) fn files(path: &Path) -> Result<Vec<PathBuf>> {
    if path.is_file() {
        return Ok(vec![path.to_path_buf()]);
    }
    let (folder, pattern) = match Pattern::parse(path) {
        Some((folder, pattern)) if !path.is_dir() => (folder, Some(pattern)),
        _ => (path.to_path_buf(), None),
    };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(&folder).map_err(|e| Error::io(&folder, e))? {
        let name = entry.map_err(|e| Error::io(&folder, e))?.file_name();
        let wanted = name.to_str().filter(|n| is_tiff_name(n) && pattern.as_ref().is_none_or(|p| p.matches(n)));
        names.extend(wanted.filter(|n| !n.starts_with('.')).map(str::to_owned));
        if names.len() > MOST_FILES {
            return Err(Error::unsupported(format!("more than {MOST_FILES} slices"))
                .at(path)
                .hint("name a part of them"));
        }
    }
    if names.is_empty() {
        return Err(Error::invalid("no TIFF is there")
            .at(path)
            .hint("name a folder of .tif files, or a pattern such as 'a/s*.tif'"));
    }
    // Names that differ in zeros before a number alone still have an order of their own.
    names.sort_by(|a, b| natural(a, b).then_with(|| a.cmp(b)));
    Ok(names.iter().map(|name| folder.join(name)).collect())
}

/// Orders names so that the numbers in them ascend.
fn natural(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a, b);
    loop {
        let number = |text: &str| text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
        let order = match (number(a), number(b)) {
            (0, 0) | (0, _) | (_, 0) => {
                let (x, y) = (a.chars().next(), b.chars().next());
                if x.is_none() || x != y {
                    return x.cmp(&y);
                }
                let length = x.map_or(0, char::len_utf8);
                (a, b) = (&a[length..], &b[length..]);
                continue;
            }
            (n, m) => {
                let (x, y) = (a[..n].trim_start_matches('0'), b[..m].trim_start_matches('0'));
                (a, b) = (&a[n..], &b[m..]);
                x.len().cmp(&y.len()).then_with(|| x.cmp(y))
            }
        };
        if order != Ordering::Equal {
            return order;
        }
    }
}

/// Name with a part that stands for any text (`*`) or for a number (`###`, `%03d`).
#[derive(Debug, PartialEq, Eq)]
struct Pattern {
    head: String,
    tail: String,
    digits: bool,
}

impl Pattern {
    fn parse(path: &Path) -> Option<(PathBuf, Self)> {
        let name = path.file_name()?.to_str()?;
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let hashes = name.find('#').map(|at| (at, at + name[at..].len() - name[at..].trim_start_matches('#').len()));
        let percent = name.find('%').and_then(|at| {
            let length = name[at + 1..].find('d')?;
            name[at + 1..at + 1 + length].chars().all(|c| c.is_ascii_digit()).then_some((at, at + length + 2))
        });
        let star = name.find('*').map(|at| (at, at + 1));
        let (from, to) = star.or(hashes).or(percent)?;
        let digits = star.is_none();
        Some((folder.to_path_buf(), Self { head: name[..from].into(), tail: name[to..].into(), digits }))
    }

    fn matches(&self, name: &str) -> bool {
        let middle = name.strip_prefix(self.head.as_str()).and_then(|rest| rest.strip_suffix(self.tail.as_str()));
        middle.is_some_and(|m| !self.digits || (!m.is_empty() && m.chars().all(|c| c.is_ascii_digit())))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn numbers_ascend_and_patterns_match() {
        let mut names = ["s10.tif", "s9.tif", "s009b.tif", "a2.tif", "s1.tif", "s"];
        names.sort_by(|a, b| natural(a, b));
        assert_eq!(names, ["a2.tif", "s", "s1.tif", "s9.tif", "s009b.tif", "s10.tif"]);
        for (pattern, yes, no) in
            [("a/s*.tif", "sx1.tif", "t1.tif"), ("s##.tif", "s007.tif", "sx.tif"), ("s%03d.tif", "s1.tif", "s.tif")]
        {
            let (_, pattern) = Pattern::parse(Path::new(pattern)).unwrap();
            assert!(pattern.matches(yes) && !pattern.matches(no), "{pattern:?}");
        }
        assert_eq!(Pattern::parse(Path::new("plain.tif")), None);
        let folder = tempfile::tempdir().unwrap();
        let names = ["s001.tif", "s01.tif", "s1.tif", "s2.tif"];
        names.iter().rev().for_each(|name| std::fs::write(folder.path().join(name), "").unwrap());
        assert_eq!(files(folder.path()).unwrap(), names.map(|name| folder.path().join(name)));
    }
}
