//! Opening of layers: regular files of bounded size, and text that the parser understands.

use super::{binary, text};
use crate::error::{Code, Error, Result};
use crate::formats::ending::ends_in;
use crate::formats::input;
use openusd::ar::{self, Asset, DefaultResolver, ResolvedPath, Resolver};
use openusd::usda::parser::Parser;
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, Cursor, Read};
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Files and faults that were met while a stage was opened.
#[derive(Debug, Default)]
pub(super) struct OpenedLayers {
    /// Files of layers, packages among them.
    pub files: BTreeSet<PathBuf>,
    /// First fault of each layer that cannot be read.
    pub faults: Vec<Error>,
    /// Number of bytes of all layers so far.
    bytes: u64,
}

/// Finds layers as the crate does, and opens them.
pub(super) struct Bounded {
    inner: DefaultResolver,
    /// Largest number of bytes of all layers together.
    most: u64,
    met: Rc<RefCell<OpenedLayers>>,
}

impl Bounded {
    pub(super) fn new(most: u64, met: Rc<RefCell<OpenedLayers>>) -> Self {
        Self { inner: DefaultResolver::new(), most, met }
    }

    fn read(&self, place: &Path) -> Result<Vec<u8>> {
        let text = place.to_string_lossy();
        let split =
            if ar::is_package_relative_path(&text) { ar::split_package_relative_path_outer(&text) } else { None };
        let file = split.as_ref().map_or_else(|| place.to_path_buf(), |(package, _)| PathBuf::from(package));
        if is_package(split.as_ref().map_or(place, |(_, inner)| Path::new(inner))) {
            // Packages that can be read have led to their root layers.
            return Err(match (&split, root_layer(place)) {
                (Some(_), _) => Error::unsupported("packages within packages are not opened")
                    .hint("unpack the package, and name its root layer"),
                (None, Err(error)) => error,
                (None, Ok(_)) => Error::invalid("the package has changed while it was read").hint("try again"),
            });
        }
        let left = self.most.saturating_sub(self.met.borrow().bytes);
        let bytes = match &split {
            Some((package, inner)) => entry(Path::new(package), inner, left)?,
            None if input::open(place)?.metadata().is_ok_and(|data| data.len() > left) => {
                return Err(Error::unsupported(format!(
                    "the stage's layers have more than {} bytes together",
                    self.most
                ))
                .coded(Code::MemoryLimit)
                .hint("raise ⟨max_memory⟩, of which layers may take a quarter, if the stage is to be trusted"));
            }
            None => input::bytes(place, left, "a layer of a stage")?,
        };
        let mut met = self.met.borrow_mut();
        met.bytes = met.bytes.saturating_add(bytes.len() as u64);
        met.files.insert(file);
        drop(met);
        if bytes.starts_with(b"PXR-USDC") {
            return binary::checked(bytes, self.most);
        }
        let text = String::from_utf8(bytes).map_err(|e| {
            let at = e.utf8_error().valid_up_to();
            Error::invalid(format!("byte {at} is no text in UTF-8, and the file is no binary layer"))
                .hint("write the stage again where it was made")
        })?;
        // Three times the text is taken while it is parsed, and its values afterwards.
        let prepared = text::prepare(&text)?;
        let mut parser = Parser::new(&prepared.text);
        if let Err(e) = parser.parse() {
            let line = parser.last_error_highlight().map(|at| format!("line {}: ", prepared.line(at.line)));
            return Err(Error::invalid(format!("{}no valid USD: {e:#}", line.unwrap_or_default()))
                .hint("correct the text there, or write the stage again where it was made"));
        }
        Ok(prepared.text.into_bytes())
    }
}

/// Reads a file of a package. Errors name neither.
///
/// # Errors
/// If the package is none, has no such file, or the file has more than `most` bytes.
pub(super) fn entry(package: &Path, inner: &str, most: u64) -> Result<Vec<u8>> {
    const AGAIN: &str = "pack the file again where it was made";
    let mut archive = open_package(package)?;
    let entry = match archive.by_name(inner) {
        Ok(entry) => entry,
        Err(zip::result::ZipError::FileNotFound) => {
            return Err(
                Error::invalid("the package has no such file").hint("correct the path, or pack the file with it")
            );
        }
        Err(e) => return Err(Error::invalid(format!("it cannot be read: {e}")).hint(AGAIN)),
    };
    let mut bytes = Vec::new();
    let read = entry.take(most.saturating_add(1)).read_to_end(&mut bytes);
    read.map_err(|e| Error::invalid(format!("it cannot be read: {e}")).hint(AGAIN))?;
    if bytes.len() as u64 > most {
        return Err(Error::unsupported(format!("the file has more than {most} bytes"))
            .coded(Code::MemoryLimit)
            .hint("raise ⟨max_memory⟩ if the file is to be trusted"));
    }
    Ok(bytes)
}

/// Opens a package of type `.usdz`.
///
/// # Errors
/// If the file cannot be opened, or is no such package.
pub(super) fn open_package(path: &Path) -> Result<zip::ZipArchive<File>> {
    zip::ZipArchive::new(input::open(path)?)
        .map_err(|e| Error::invalid(format!("no valid package: {e}")).at(path).hint("copy or pack the file again"))
}

/// Returns the name of a package's root layer, its first file.
///
/// # Errors
/// If the package cannot be read, or its first file is no layer.
pub(super) fn root_layer(path: &Path) -> Result<String> {
    let archive = open_package(path)?;
    let name = archive.name_for_index(0).unwrap_or_default().to_owned();
    if is_layer(Path::new(&name)) {
        return Ok(name);
    }
    Err(Error::invalid(format!("its first file, '{name}', is no layer"))
        .at(path)
        .hint("a .usdz package begins with its root layer: pack it again with a tool for USD"))
}

/// True if a name is that of a layer, but of none in a package.
pub(super) fn is_layer(name: &Path) -> bool {
    ["usd", "usda", "usdc"].iter().any(|ending| ends_in(name, ending))
}

/// True if the name of a file ends as those of packages do.
pub(super) fn is_package(path: &Path) -> bool {
    ends_in(path, "usdz")
}

/// True if the name of a file ends as those of stages do.
pub(super) fn is_stage_name(path: &Path) -> bool {
    is_layer(path) || is_package(path)
}

impl Resolver for Bounded {
    fn create_identifier(&self, path: &str, anchor: Option<&ResolvedPath>) -> String {
        self.inner.create_identifier(path, anchor)
    }

    fn resolve(&self, path: &str) -> Option<ResolvedPath> {
        // The crate opens packages to see what they hold, which a FIFO would block and which takes all of their bytes.
        if let Some((package, _)) = ar::split_package_relative_path_outer(path)
            && Path::new(&package).exists()
            && input::open(Path::new(&package)).is_err()
        {
            return Some(ResolvedPath::new(path));
        }
        let found = self.inner.resolve(path)?;
        let root = Some(&found).filter(|found| is_package(found)).and_then(|found| root_layer(found).ok());
        Some(match root {
            Some(name) => ResolvedPath::new(ar::join_package_relative_path(&found.to_string_lossy(), &name)),
            None => found,
        })
    }

    fn resolve_for_new_asset(&self, path: &str) -> Option<ResolvedPath> {
        self.inner.resolve_for_new_asset(path)
    }

    fn open_asset(&self, path: &ResolvedPath) -> io::Result<Box<dyn Asset>> {
        match self.read(path) {
            Ok(bytes) => Ok(Box::new(Cursor::new(bytes))),
            Err(error) => {
                let mut met = self.met.borrow_mut();
                // A fault of a package is one of the layer in it.
                let error = match error.path().map(Path::to_path_buf) {
                    Some(place) => error.known_as(&place, path),
                    None => error.at(path),
                };
                let text = error.to_string().replace("\n  ", "; ");
                if !met.faults.iter().any(|fault| fault.path() == error.path()) {
                    met.faults.push(error);
                }
                Err(io::Error::other(text))
            }
        }
    }
}
