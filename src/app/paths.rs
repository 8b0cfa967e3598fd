//! Paths in reports and settings. JSON is Unicode, and paths need not be.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::ffi::OsString;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};

/// A path, or none, that a report may hold.
pub(crate) trait Reported {
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
        self.as_deref().map(Path::to_string_lossy)
    }
}

/// Serialises a path as text, for `#[serde(serialize_with)]`. Serde's own serialisation fails for paths that are not
/// Unicode, which would be after the work that the report is about.
///
/// # Errors
/// Those of the serialiser.
pub(crate) fn text<P: Reported, S: Serializer>(path: &P, serializer: S) -> Result<S::Ok, S::Error> {
    path.text().serialize(serializer)
}

/// Serialises paths as texts, as [`text`] does.
///
/// # Errors
/// Those of the serialiser.
pub(crate) fn texts<S: Serializer>(paths: &[PathBuf], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(paths.iter().map(Reported::text))
}

/// A path as a setting: its text, or its bytes where it is not Unicode, so that no two paths are alike.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Stated {
    /// Path that is Unicode.
    Text(String),
    /// Bytes of any other path.
    Bytes(Vec<u8>),
}

/// A path, or several or none, that settings may hold.
pub(crate) trait Setting: Sized {
    /// Form that is written.
    type Form: Serialize + DeserializeOwned;
    /// Returns the form that is written.
    fn form(&self) -> Self::Form;
    /// Returns the value that was written.
    fn from_form(form: Self::Form) -> Self;
}

impl Setting for PathBuf {
    type Form = Stated;

    fn form(&self) -> Stated {
        stated(self)
    }

    fn from_form(form: Stated) -> Self {
        match form {
            Stated::Text(text) => text.into(),
            Stated::Bytes(bytes) => OsString::from_vec(bytes).into(),
        }
    }
}

impl Setting for Option<PathBuf> {
    type Form = Option<Stated>;

    fn form(&self) -> Self::Form {
        self.as_deref().map(stated)
    }

    fn from_form(form: Self::Form) -> Self {
        form.map(PathBuf::from_form)
    }
}

impl Setting for Vec<PathBuf> {
    type Form = Vec<Stated>;

    fn form(&self) -> Self::Form {
        self.iter().map(|path| stated(path)).collect()
    }

    fn from_form(form: Self::Form) -> Self {
        form.into_iter().map(PathBuf::from_form).collect()
    }
}

fn stated(path: &Path) -> Stated {
    let text = path.to_str().map(|text| Stated::Text(text.to_owned()));
    text.unwrap_or_else(|| Stated::Bytes(path.as_os_str().as_bytes().to_vec()))
}

/// Serialises paths of settings, for `#[serde(with = "paths")]`.
///
/// # Errors
/// Those of the serialiser.
pub(crate) fn serialize<P: Setting, S: Serializer>(path: &P, serializer: S) -> Result<S::Ok, S::Error> {
    path.form().serialize(serializer)
}

/// Deserialises paths of settings, for `#[serde(with = "paths")]`.
///
/// # Errors
/// Those of the deserialiser.
pub(crate) fn deserialize<'de, P: Setting, D: Deserializer<'de>>(deserializer: D) -> Result<P, D::Error> {
    P::Form::deserialize(deserializer).map(P::from_form)
}

#[cfg(all(test, unix))]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[derive(Serialize)]
    struct Report {
        #[serde(serialize_with = "text")]
        output: PathBuf,
        #[serde(serialize_with = "text")]
        page: Option<PathBuf>,
    }

    #[test]
    fn any_path_can_be_reported() {
        let output = PathBuf::from(OsString::from_vec(b"b\xffad/o.vdb".to_vec()));
        assert!(serde_json::to_string(&output).is_err(), "serde's own serialisation");
        let text = serde_json::to_string(&Report { output, page: None }).unwrap();
        assert_eq!(text, "{\"output\":\"b\u{fffd}ad/o.vdb\",\"page\":null}");
    }

    #[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
    #[serde(default)]
    struct Settings {
        #[serde(with = "super")]
        input: PathBuf,
        #[serde(with = "super")]
        cameras: Option<PathBuf>,
        #[serde(with = "super")]
        more: Vec<PathBuf>,
    }

    #[test]
    fn any_path_can_be_a_setting() {
        let odd = || PathBuf::from(OsString::from_vec(b"b\xffad".to_vec()));
        let settings = Settings { input: odd(), cameras: Some(odd()), more: vec![odd(), "a".into()] };
        let text = serde_json::to_string(&settings).unwrap();
        assert_eq!(serde_json::from_str::<Settings>(&text).unwrap(), settings, "{text}");
        let plain: Settings = serde_json::from_str("{\"input\": \"a/b.vdb\"}").unwrap();
        assert_eq!(plain, Settings { input: "a/b.vdb".into(), ..Settings::default() });
    }
}
