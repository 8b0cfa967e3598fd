//! Checks of the files that a use case writes, before its work: names that fit their content, in folders that can be
//! written to.

use crate::error::{Code, Error, Result};
use crate::formats::ending::ends_in;
use crate::formats::{atomic, registry};
use crate::report::FILE_NAME as PAGE;
use std::ffi::OsStr;
use std::path::Path;

/// Kind of an output file's content.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// OpenVDB file.
    Vdb,
    /// JSON of a capture.
    Capture,
    /// JSON of a transfer function.
    TransferFunction,
    /// PNG picture.
    Png,
    /// OpenEXR picture.
    Exr,
    /// USD stage as text.
    UsdText,
    /// SVG drawing.
    Svg,
    /// PDF document.
    Pdf,
}

impl Content {
    /// Extension of such files' names, and a phrase for their content.
    fn ending(self) -> (&'static str, &'static str) {
        match self {
            Self::Vdb => ("vdb", "an OpenVDB file"),
            Self::Capture => ("json", "a capture's JSON"),
            Self::TransferFunction => ("json", "a transfer function's JSON"),
            Self::Png => ("png", "a PNG"),
            Self::Exr => ("exr", "an OpenEXR picture"),
            Self::UsdText => ("usda", "a USD stage as text"),
            Self::Svg => ("svg", "an SVG"),
            Self::Pdf => ("pdf", "a PDF"),
        }
    }

    /// True if a path has the ending of such files.
    pub(crate) fn has_name(self, path: &Path) -> bool {
        ends_in(path, self.ending().0)
    }
}

/// Extensions of files of other formats than those of the [registry], which no folder's name is meant to have.
const OTHERS: [&str; 7] = ["xml", "html", "htm", "mp4", "txt", "csv", "gz"];

/// Checks a file that is to be written: its name, and that its folder can be written to.
///
/// # Errors
/// If the name has the extension of another kind of file, or the folder cannot be written to ([`atomic::probe`]).
pub(crate) fn file(path: &Path, content: Content) -> Result<()> {
    refuse_dash(path)?;
    let (ending, what) = content.ending();
    // "smoke.0001" has no ending: that is the number of a frame.
    let named = path.extension().and_then(OsStr::to_str).filter(|e| e.chars().any(|c| c.is_ascii_alphabetic()));
    if let Some(other) = named.filter(|e| !e.eq_ignore_ascii_case(ending)) {
        return Err(Error::invalid(format!("{what} would be written, which a name that ends in .{other} hides"))
            .coded(Code::OutputName)
            .at(path)
            .hint(format!("let the name end in .{ending}")));
    }
    atomic::probe(path)
}

/// Checks the name of a folder that files are to be written into. It need not exist.
///
/// # Errors
/// If the name has the extension of a file, or belongs to something that is no folder.
pub(crate) fn folder(path: &Path) -> Result<()> {
    refuse_dash(path)?;
    if path.is_dir() {
        return Ok(());
    }
    let hint = "give the name of a folder; it is made if it does not exist";
    if path.exists() {
        return Err(Error::invalid("this is no folder, and files are to be written into it").at(path).hint(hint));
    }
    let ending = path.extension().and_then(OsStr::to_str);
    let is_file = registry::by_name(path).is_some() || OTHERS.iter().any(|other| ends_in(path, other));
    match ending.filter(|_| is_file) {
        Some(ending) => {
            Err(Error::invalid(format!("a folder would be made, which a name that ends in .{ending} hides"))
                .coded(Code::OutputName)
                .at(path)
                .hint(hint))
        }
        None => Ok(()),
    }
}

/// Name of a run's record in the folder of its report.
pub(crate) const RECORD: &str = "run.json";

/// Makes the folder of a report, before the work.
///
/// # Errors
/// If the name is that of a file, or the folder cannot be made or written to.
pub(crate) fn report_folder(dir: &Path) -> Result<()> {
    folder(dir)?;
    std::fs::create_dir_all(dir)
        .map_err(|e| Error::io(dir, e).hint("the report needs a folder that can be written to"))?;
    [RECORD, PAGE].into_iter().try_for_each(|name| atomic::probe(&dir.join(name)))
}

/// Checks a path for pictures, and returns the kind of file that it names: OpenEXR or PNG, by its ending; `None` for a
/// folder.
///
/// # Errors
/// If the name has the extension of another kind of file, or the place cannot be written to.
pub(crate) fn pictures(path: &Path) -> Result<Option<Content>> {
    match [Content::Exr, Content::Png].into_iter().find(|content| content.has_name(path) && !path.is_dir()) {
        Some(content) => file(path, content).map(|()| Some(content)),
        None => folder(path).map(|()| None),
    }
}

fn refuse_dash(path: &Path) -> Result<()> {
    if path.as_os_str() != "-" {
        return Ok(());
    }
    Err(Error::unsupported("standard output is no place for files")
        .at(path)
        .hint("give the name of a file or folder; ⟨json⟩ prints the report on standard output"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_what_is_in_files() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        for name in ["a.vdb", "a.VDB", "a", "a.0001", "a.b.vdb"] {
            file(&at(name), Content::Vdb).unwrap();
        }
        for name in ["a.exr", "a.nvdb", "a.usd", "a.npy", "a.vdb.tmp"] {
            assert!(file(&at(name), Content::Vdb).unwrap_err().to_string().contains(".vdb"), "{name}");
        }
        file(&at("bone.tf.json"), Content::TransferFunction).unwrap();
        assert!(file(Path::new("-"), Content::Png).is_err() && folder(Path::new("-")).is_err());
        for name in ["shots", "shots.v2", "a/b"] {
            folder(&at(name)).unwrap();
        }
        assert!(folder(&at("cloud.png")).is_err() && folder(&at("cloud.EXR")).is_err());
        let kinds = ["a.exr", "A.PNG", "shots", "shots.v2"].map(|name| pictures(&at(name)).unwrap());
        assert_eq!(kinds, [Some(Content::Exr), Some(Content::Png), None, None]);
        assert!(pictures(&at("a.jpg")).is_err() && pictures(Path::new("-")).is_err());
        std::fs::create_dir(at("old.png")).unwrap();
        folder(&at("old.png")).unwrap();
        assert_eq!(pictures(&at("old.png")).unwrap(), None);
        std::fs::write(at("file"), "").unwrap();
        assert!(folder(&at("file")).is_err());
    }
}
