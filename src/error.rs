//! One error type. It says where the fault lies (file, grid or layer), what was found, what was
//! expected and what to do about it; the command line turns it into exit code 2.

use std::fmt;
use std::path::{Path, PathBuf};

/// Result of everything in this crate that can fail.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Whose fault it is.
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

/// An error with the place it happened in.
#[derive(Debug)]
pub struct Error(Box<Inner>);

#[derive(Debug)]
struct Inner {
    kind: Kind,
    path: Option<PathBuf>,
    part: Option<String>,
    what: String,
    hint: Option<String>,
    source: Option<std::io::Error>,
}

impl Error {
    fn new(kind: Kind, what: impl Into<String>) -> Self {
        Self(Box::new(Inner { kind, path: None, part: None, what: what.into(), hint: None, source: None }))
    }
    /// The input is well formed, but this program does not handle it.
    pub fn unsupported(what: impl Into<String>) -> Self {
        Self::new(Kind::Unsupported, what)
    }
    /// The input contradicts its format or the request.
    pub fn invalid(what: impl Into<String>) -> Self {
        Self::new(Kind::Invalid, what)
    }
    /// The native library reported an error.
    pub fn native(what: impl Into<String>) -> Self {
        Self::new(Kind::Native, what)
    }
    /// The work was stopped by the user.
    pub fn cancelled() -> Self {
        Self::new(Kind::Cancelled, "stopped by the user")
    }
    /// An operating-system error on `path`.
    pub fn io(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Self::system(source).at(path)
    }
    /// An operating-system error on a file that the caller names.
    pub fn system(source: std::io::Error) -> Self {
        let mut e = Self::new(Kind::Io, source.to_string());
        e.0.source = Some(source);
        e
    }
    /// Says what happened in other words: those of the operating system with more beside them.
    #[must_use]
    pub fn saying(mut self, what: impl Into<String>) -> Self {
        self.0.what = what.into();
        self
    }
    /// Names the file, unless an inner layer already named one.
    #[must_use]
    pub fn at(mut self, path: impl AsRef<Path>) -> Self {
        self.0.path.get_or_insert_with(|| path.as_ref().to_path_buf());
        self
    }
    /// Names the grid, layer, frame or argument, unless already named: `grid 'density'`.
    #[must_use]
    pub fn part(mut self, part: impl Into<String>) -> Self {
        self.0.part.get_or_insert_with(|| part.into());
        self
    }
    /// Says what to do, unless already said.
    #[must_use]
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.0.hint.get_or_insert_with(|| hint.into());
        self
    }
    /// Whose fault it is.
    pub fn kind(&self) -> Kind {
        self.0.kind
    }
    /// The operating-system error beneath, if there is one.
    pub fn io_kind(&self) -> Option<std::io::ErrorKind> {
        self.0.source.as_ref().map(std::io::Error::kind)
    }
    /// The operating system's error beneath, as it numbers them.
    pub fn os_error(&self) -> Option<i32> {
        self.0.source.as_ref().and_then(std::io::Error::raw_os_error)
    }
    /// What happened, without the place and the hint.
    pub fn what(&self) -> &str {
        &self.0.what
    }
    /// Grid, layer, frame or argument it happened in, where one was named.
    pub fn place(&self) -> Option<&str> {
        self.0.part.as_deref()
    }
    /// What to do, where it is known.
    pub fn remedy(&self) -> Option<&str> {
        self.0.hint.as_deref()
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let e = &*self.0;
        if let Some(path) = &e.path {
            write!(f, "{}: ", path.display())?;
        }
        if let Some(part) = &e.part {
            write!(f, "{part}: ")?;
        }
        f.write_str(&e.what)?;
        if let Some(hint) = &e.hint {
            write!(f, "\n  {hint}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.0.source.as_ref().map(|s| s as _)
    }
}
