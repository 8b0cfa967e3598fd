//! The crate's error type.
//! An error says where the fault lies (file, grid or layer), what was found, what was expected and what to do about it;
//! the command line turns it into exit code 2. It names settings in brackets of their own; what is displayed has the
//! words of the process's face ([`crate::wording`]).

use crate::text::printable;
use crate::wording::worded;
use std::borrow::Cow;
use std::fmt;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Result of every fallible function of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Class of an error: whose fault it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The input is well formed, but this program does not handle it.
    Unsupported,
    /// The input contradicts its format or the request.
    Invalid,
    /// The native OpenVDB library reported an error.
    Native,
    /// The operating system reported an error.
    Io,
    /// The user asked to stop (Ctrl-C).
    Cancelled,
}

/// Code of an error for programs: its name stays, whatever the words of the message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Code {
    /// The input contradicts its format or the request, in a way that has no code of its own.
    Invalid,
    /// The input is well formed, but this program does not handle it.
    Unsupported,
    /// The words of the command line, or the settings, could not be read.
    Usage,
    /// The OpenVDB library refused the file.
    OpenVdb,
    /// A file or a folder does not exist.
    NotFound,
    /// The permissions of a file or folder forbid what was tried.
    PermissionDenied,
    /// The disk, the quota or the limit on file sizes is exhausted.
    StorageFull,
    /// A file ends before its content does.
    Incomplete,
    /// The operating system reported another error.
    System,
    /// The work was stopped.
    Cancelled,
    /// The work would take more memory than it may (`max_memory`).
    MemoryLimit,
    /// The file is of no kind that is read here.
    UnknownFormat,
    /// No grid, or several, have the name or the use that is asked for.
    NoSuchGrid,
    /// No layer of the picture, or several, have the name that is asked for.
    NoSuchLayer,
    /// The grid holds nothing.
    EmptyGrid,
    /// An output would replace a file that other settings wrote.
    OutputExists,
    /// An output would replace an input.
    OutputIsInput,
    /// The name of an output does not fit its content.
    OutputName,
    /// Pictures, cameras and the model contradict each other.
    Contradiction,
    /// Some frames failed, and the others are there.
    FramesFailed,
}

impl fmt::Display for Code {
    /// Writes the name, such as `memory-limit`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        serde::Serialize::serialize(self, f)
    }
}

/// An error as documents for programs state it.
#[derive(Debug, Clone, serde::Serialize, schemars::JsonSchema)]
pub struct Facts<'e> {
    /// Code for programs, which stays whatever the words of the description.
    pub code: Code,
    /// Description of the error.
    pub what: Cow<'e, str>,
    /// File in which it happened.
    pub file: Option<Cow<'e, str>>,
    /// Grid, layer, frame or argument that it concerns.
    pub part: Option<&'e str>,
    /// Advice to the user.
    #[serde(rename = "do")]
    pub remedy: Option<Cow<'e, str>>,
}

/// An error with the file and the part of it in which it happened.
#[derive(Debug)]
pub struct Error(Box<Inner>);

#[derive(Debug)]
struct Inner {
    kind: Kind,
    /// None for the code of the kind.
    code: Option<Code>,
    path: Option<PathBuf>,
    part: Option<String>,
    what: String,
    hint: Option<String>,
    source: Option<std::io::Error>,
}

impl Error {
    fn new(kind: Kind, what: impl Into<String>) -> Self {
        Self(Box::new(Inner { kind, code: None, path: None, part: None, what: what.into(), hint: None, source: None }))
    }
    /// An error of [`Kind::Unsupported`]: the input is well formed, but this program does not handle it.
    pub fn unsupported(what: impl Into<String>) -> Self {
        Self::new(Kind::Unsupported, what)
    }
    /// An error of [`Kind::Invalid`]: the input contradicts its format or the request.
    pub fn invalid(what: impl Into<String>) -> Self {
        Self::new(Kind::Invalid, what)
    }
    /// An error of [`Kind::Native`]: the native OpenVDB library reported an error.
    pub fn native(what: impl Into<String>) -> Self {
        Self::new(Kind::Native, what)
    }
    /// An error of [`Kind::Cancelled`]: the user stopped the work.
    pub fn cancelled() -> Self {
        Self::new(Kind::Cancelled, "stopped by the user")
    }
    /// An error of [`Kind::Io`]: the operating system reported an error on `path`.
    pub fn io(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Self::system(source).at(path)
    }
    /// An error of [`Kind::Io`] without a path, for callers that name the file themselves.
    pub fn system(source: std::io::Error) -> Self {
        let mut e = Self::new(Kind::Io, source.to_string());
        e.0.source = Some(source);
        e
    }
    /// Gives the error a code of its own, unless an inner call already did so.
    #[must_use]
    pub fn coded(mut self, code: Code) -> Self {
        self.0.code.get_or_insert(code);
        self
    }
    /// Replaces the message, for instance to add to that of the operating system.
    #[must_use]
    pub fn saying(mut self, what: impl Into<String>) -> Self {
        self.0.what = what.into();
        self
    }
    /// Names the file, unless an inner call already named one.
    #[must_use]
    pub fn at(mut self, path: impl AsRef<Path>) -> Self {
        self.0.path.get_or_insert_with(|| path.as_ref().to_path_buf());
        self
    }
    /// Names `shown` in place of the file `place`, for files that are read from another place than the user knows.
    #[must_use]
    pub fn known_as(mut self, place: &Path, shown: &Path) -> Self {
        if self.0.path.as_deref() == Some(place) {
            self.0.path = Some(shown.to_path_buf());
        }
        self.0.what = self.0.what.replace(&*place.to_string_lossy(), &shown.to_string_lossy());
        self
    }
    /// Names the grid, layer, frame or argument, such as `grid 'density'`, unless an inner call already named one.
    #[must_use]
    pub fn part(mut self, part: impl Into<String>) -> Self {
        self.0.part.get_or_insert_with(|| part.into());
        self
    }
    /// Prefixes the place with the outer one that contains it: `grid 'density': metadata 'creator'`.
    #[must_use]
    pub fn inside(mut self, outer: impl Into<String>) -> Self {
        let outer = outer.into();
        self.0.part = Some(self.0.part.map_or_else(|| outer.clone(), |inner| format!("{outer}: {inner}")));
        self
    }
    /// Says what the user can do about the error, unless an inner call already said so.
    #[must_use]
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.0.hint.get_or_insert_with(|| hint.into());
        self
    }
    /// Replaces the hint, for callers whose context allows a better one.
    #[must_use]
    pub fn instead(mut self, hint: impl Into<String>) -> Self {
        self.0.hint = Some(hint.into());
        self
    }
    /// Class of the error: whose fault it is.
    pub fn kind(&self) -> Kind {
        self.0.kind
    }
    /// Code for programs: the one that the error was given, else that of its kind.
    pub fn code(&self) -> Code {
        self.0.code.unwrap_or_else(|| match self.0.kind {
            Kind::Unsupported => Code::Unsupported,
            Kind::Invalid => Code::Invalid,
            Kind::Native => Code::OpenVdb,
            Kind::Cancelled => Code::Cancelled,
            Kind::Io => self.io_kind().map_or(Code::System, io_code),
        })
    }
    /// All that is known of the error, for documents.
    pub fn facts(&self) -> Facts<'_> {
        let file = self.path().map(Path::to_string_lossy);
        Facts { code: self.code(), what: self.what(), file, part: self.place(), remedy: self.remedy() }
    }
    /// Kind of the underlying operating-system error, if there is one.
    pub fn io_kind(&self) -> Option<ErrorKind> {
        self.0.source.as_ref().map(std::io::Error::kind)
    }
    /// Number of the underlying operating-system error (`errno`), if there is one.
    pub fn os_error(&self) -> Option<i32> {
        self.0.source.as_ref().and_then(std::io::Error::raw_os_error)
    }
    /// Message without file, place and hint.
    pub fn what(&self) -> Cow<'_, str> {
        worded(&self.0.what)
    }
    /// File in which the error happened, if one was named.
    pub fn path(&self) -> Option<&Path> {
        self.0.path.as_deref()
    }
    /// Grid, layer, frame or argument in which the error happened, if one was named.
    pub fn place(&self) -> Option<&str> {
        self.0.part.as_deref()
    }
    /// Advice to the user.
    /// Without a hint, errors of the operating system and of the native library get one by their kind; other kinds have
    /// none.
    pub fn remedy(&self) -> Option<Cow<'_, str>> {
        let hint = self.0.hint.as_deref().or_else(|| match self.0.kind {
            Kind::Io => Some(self.0.source.as_ref().map_or(TRY_AGAIN, io_remedy)),
            Kind::Native => Some("the file may be damaged or of a newer kind: write it again where it was made"),
            Kind::Unsupported | Kind::Invalid | Kind::Cancelled => None,
        });
        hint.map(worded)
    }
}

fn io_code(kind: ErrorKind) -> Code {
    match kind {
        ErrorKind::NotFound | ErrorKind::NotADirectory => Code::NotFound,
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => Code::PermissionDenied,
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => Code::StorageFull,
        ErrorKind::UnexpectedEof => Code::Incomplete,
        _ => Code::System,
    }
}

const TRY_AGAIN: &str = "try again; if it fails again, check the disk and the system's log";

/// Advice on an error of the operating system, by its kind.
fn io_remedy(error: &std::io::Error) -> &'static str {
    match error.kind() {
        ErrorKind::NotFound => "check the spelling of the path, and that the file and its folder exist",
        ErrorKind::PermissionDenied => "check the permissions of the file and its folder, or choose another one",
        ErrorKind::IsADirectory => "this is a folder: name a file",
        ErrorKind::NotADirectory => "a part of this path is a file, not a folder: correct the path",
        ErrorKind::DirectoryNotEmpty | ErrorKind::AlreadyExists => "choose another name, or remove what is there",
        ErrorKind::StorageFull => "free space on this disk, or write to another one",
        ErrorKind::QuotaExceeded => "free space within the quota, or write to another disk",
        ErrorKind::FileTooLarge => "raise the limit on file sizes (ulimit -f), or write to another file system",
        ErrorKind::ReadOnlyFilesystem => "the file system is read-only: write to another folder",
        ErrorKind::InvalidFilename | ErrorKind::InvalidInput => "choose a shorter name without special characters",
        ErrorKind::UnexpectedEof => "the file is incomplete: copy or write it again",
        ErrorKind::OutOfMemory => "close other programs, or work on a smaller input",
        // EMFILE and ENFILE have no `ErrorKind`.
        _ if matches!(error.raw_os_error(), Some(23 | 24)) => "raise the limit on open files (ulimit -n)",
        _ => TRY_AGAIN,
    }
}

impl fmt::Display for Error {
    /// Writes path, place and message on one line and the remedy on the next; characters that act on a terminal are
    /// escaped.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let e = &*self.0;
        if let Some(path) = &e.path {
            write!(f, "{}: ", printable(&path.to_string_lossy()))?;
        }
        if let Some(part) = &e.part {
            write!(f, "{}: ", printable(part))?;
        }
        f.write_str(&printable(&self.what()))?;
        if let Some(hint) = self.remedy() {
            write!(f, "\n  {}", printable(&hint))?;
        }
        Ok(())
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.0.source.as_ref().map(|s| s as _)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_the_system_have_a_remedy_by_kind() {
        for (kind, word) in [
            (ErrorKind::NotFound, "spelling"),
            (ErrorKind::PermissionDenied, "permissions"),
            (ErrorKind::IsADirectory, "name a file"),
            (ErrorKind::StorageFull, "free space"),
            (ErrorKind::ReadOnlyFilesystem, "another folder"),
            (ErrorKind::Other, "try again"),
        ] {
            let error = Error::io("a.vdb", kind.into());
            assert!(error.to_string().contains(word), "{error}");
            assert!(error.hint("own words").to_string().ends_with("\n  own words"));
        }
        assert!(Error::io("a", std::io::Error::from_raw_os_error(24)).to_string().contains("ulimit -n"));
        assert!(Error::native("odd").remedy().is_some());
        assert_eq!(Error::cancelled().remedy(), None);
    }

    #[test]
    fn what_comes_from_files_cannot_act_on_the_terminal_or_forge_lines() {
        let hostile = "x\u{1b}[2J\u{9b}31m\u{202e}\ncumulo: done";
        let error = Error::invalid(hostile).at(hostile).part(hostile).hint(hostile).to_string();
        assert!(!error.contains(|c| crate::text::acts(c) && c != '\n'), "{error}");
        assert_eq!(error.lines().count(), 2, "{error}");
        assert!(error.contains(r"\u{1b}[2J"), "{error}");
    }

    #[test]
    fn codes_have_names_and_the_inner_one_counts() {
        assert_eq!(Error::invalid("no").code(), Code::Invalid);
        assert_eq!(Error::io("a", ErrorKind::StorageFull.into()).code().to_string(), "storage-full");
        let error = Error::unsupported("large").coded(Code::MemoryLimit).coded(Code::Usage);
        assert_eq!(error.code().to_string(), "memory-limit");
    }

    #[test]
    fn an_outer_place_comes_first() {
        let error = Error::invalid("no text").part("metadata 'm'").inside("grid 'g'").at("a.vdb");
        assert_eq!(error.to_string(), "a.vdb: grid 'g': metadata 'm': no text");
        assert_eq!(Error::invalid("no").inside("grid 'g'").place(), Some("grid 'g'"));
    }
}
