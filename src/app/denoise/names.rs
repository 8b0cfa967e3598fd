//! Names of the pictures that go in and come out: a sequence, or one picture.

use crate::error::{Error, Result};
use crate::formats::sequence::{Pattern, number_of};
use std::path::{Path, PathBuf};

/// Advice on names of sequences.
const PLACE: &str = "give a name with the number's place, in quotes: 'frame.####.exr' or frame.%04d.exr";

/// Names of pictures.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::app) enum Names {
    /// Pictures whose names differ in a number.
    Sequence(Pattern),
    /// One picture, and its number: that of its name, by which cameras are found, else 1.
    Still(PathBuf, u32),
}

impl Names {
    /// Returns what a path of noisy pictures names.
    ///
    /// # Errors
    /// If it is a folder.
    pub(crate) fn of(path: &Path) -> Result<Self> {
        match Pattern::parse(path) {
            Some(pattern) => Ok(Self::Sequence(pattern)),
            None if path.is_dir() => {
                Err(Error::invalid("this is a folder, and names of pictures are expected").at(path).hint(PLACE))
            }
            None => Ok(Self::Still(path.to_owned(), number_of(path).unwrap_or(1))),
        }
    }

    /// Returns the names that another path gives to as many pictures, which `what` says in words.
    ///
    /// # Errors
    /// If one names a sequence and the other a single picture.
    pub(crate) fn alike(&self, path: &Path, what: &str) -> Result<Self> {
        match (self, Pattern::parse(path)) {
            (Self::Sequence(_), Some(pattern)) => Ok(Self::Sequence(pattern)),
            (Self::Still(_, number), None) => Ok(Self::Still(path.to_owned(), *number)),
            (Self::Sequence(_), None) => {
                Err(Error::invalid(format!("this is one name, and {what} are a sequence")).at(path).hint(PLACE))
            }
            (Self::Still(still, _), Some(_)) => {
                let what = format!("this names a sequence, and {} is one picture", still.display());
                Err(Error::invalid(what).at(path).hint("give the name of one file"))
            }
        }
    }

    /// Refuses frames that are chosen of one picture.
    ///
    /// # Errors
    /// If they are `chosen`.
    pub(crate) fn check_frames(&self, chosen: bool) -> Result<()> {
        match self {
            Self::Still(path, _) if chosen => Err(Error::invalid("⟨frames⟩: this names one picture, and no sequence")
                .at(path)
                .hint(format!("leave ⟨frames⟩ out, or {PLACE}"))),
            _ => Ok(()),
        }
    }

    /// True for one picture.
    pub(crate) fn is_still(&self) -> bool {
        matches!(self, Self::Still(..))
    }

    /// Returns the numbers of the pictures, those of holes among them.
    ///
    /// # Errors
    /// If there is none.
    pub(crate) fn all_numbers(&self) -> Result<Vec<u32>> {
        match self {
            Self::Sequence(pattern) => pattern.all_numbers(),
            Self::Still(_, number) => Ok(vec![*number]),
        }
    }

    /// Returns the path of a picture.
    pub(crate) fn path(&self, number: u32) -> PathBuf {
        match self {
            Self::Sequence(pattern) => pattern.path(number),
            Self::Still(path, _) => path.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_picture_makes_one_picture() {
        let [frames, still] = ["f.####.exr", "f.0012.exr"].map(|name| Names::of(Path::new(name)).unwrap());
        assert_eq!((frames.is_still(), still.all_numbers().unwrap()), (false, vec![12]));
        assert_eq!(Names::of(Path::new("a.exr")).unwrap().all_numbers().unwrap(), [1]);
        let alike = |names: &Names, other: &str| names.alike(Path::new(other), "the frames").map(|to| to.path(12));
        assert_eq!(alike(&frames, "g.##.exr").unwrap(), Path::new("g.12.exr"));
        assert_eq!(alike(&still, "b.exr").unwrap(), Path::new("b.exr"));
        assert!(alike(&frames, "b.exr").unwrap_err().to_string().contains("the frames are a sequence"));
        assert!(alike(&still, "g.##.exr").unwrap_err().to_string().contains("f.0012.exr is one picture"));
    }
}
