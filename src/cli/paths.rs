//! Paths in reports. JSON is Unicode, and paths need not be.

use serde::{Serialize, Serializer};
use std::borrow::Cow;
use std::path::PathBuf;

/// A path, or none, that a report may hold.
pub trait Reported {
    /// Returns the path as text, with U+FFFD in the place of what is not Unicode; none for no path.
    fn text(&self) -> Option<Cow<'_, str>>;
}

impl Reported for PathBuf {
    fn text(&self) -> Option<Cow<'_, str>> {
        Some(self.to_string_lossy())
    }
}

impl Reported for Option<PathBuf> {
    fn text(&self) -> Option<Cow<'_, str>> {
        self.as_deref().map(std::path::Path::to_string_lossy)
    }
}

/// Serialises a path as text, for `#[serde(serialize_with)]`. Serde's own serialisation fails for paths that are not
/// Unicode, which would be after the work that the report is about.
///
/// # Errors
/// Those of the serialiser.
pub fn text<P: Reported, S: Serializer>(path: &P, serializer: S) -> Result<S::Ok, S::Error> {
    path.text().serialize(serializer)
}

/// Serialises paths as texts, as [`text`] does.
///
/// # Errors
/// Those of the serialiser.
pub fn texts<S: Serializer>(paths: &[PathBuf], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(paths.iter().map(Reported::text))
}

#[cfg(all(test, unix))]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use std::os::unix::ffi::OsStringExt;

    #[derive(Serialize)]
    struct Report {
        #[serde(serialize_with = "text")]
        output: PathBuf,
        #[serde(serialize_with = "text")]
        page: Option<PathBuf>,
    }

    #[test]
    fn any_path_can_be_reported() {
        let output = PathBuf::from(std::ffi::OsString::from_vec(b"b\xffad/o.vdb".to_vec()));
        assert!(serde_json::to_string(&output).is_err(), "serde's own serialisation");
        let text = serde_json::to_string(&Report { output, page: None }).unwrap();
        assert_eq!(text, "{\"output\":\"b\u{fffd}ad/o.vdb\",\"page\":null}");
    }
}
