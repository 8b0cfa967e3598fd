//! An open VDB file: its directory comes from the preflight, its grids from OpenVDB.

use super::ffi;
use super::helper;
use super::load;
use super::meta::Meta;
use super::native::NativeGrid;
use super::preflight::{self, Entry, Preflight};
use super::up::StatedUp;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use crate::scene::grid::{Grid, MetaValue};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::ptr::{NonNull, null_mut};

/// Suffix of the name of a confidence grid, which says how well each voxel of the grid without the suffix is known.
pub const CONFIDENCE: &str = "_confidence";

/// A VDB file open for reading. Grids are loaded one by one, never lazily.
pub struct File {
    raw: NonNull<ffi::RawFile>,
    /// Handle of the file that was checked; a file put in its place meanwhile is another one.
    source: std::fs::File,
    path: PathBuf,
    preflight: Preflight,
    limits: Limits,
}

impl std::fmt::Debug for File {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("File").field("path", &self.path).field("preflight", &self.preflight).finish_non_exhaustive()
    }
}

// SAFETY: `io::File` is tied to no thread; it is not `Sync`, so it is used by one at a time.
unsafe impl Send for File {}

impl File {
    /// Checks the file's skeleton in Rust, then opens it with OpenVDB.
    ///
    /// # Errors
    /// If [`preflight::check`] finds a fault, or OpenVDB reports an error.
    pub fn open(path: impl AsRef<Path>, limits: Limits) -> Result<Self> {
        let path = path.as_ref();
        let _reading = Reading::begin(path);
        let (preflight, source) = preflight::open(path, &limits)?;
        let name = ffi::c_path(path)?;
        let mut raw = null_mut();
        // SAFETY: the path is NUL-terminated and `raw` a valid place for the handle.
        ffi::call(|s| unsafe { ffi::open(name.as_ptr(), &mut raw, s) }).map_err(|e| e.at(path))?;
        let raw = NonNull::new(raw).ok_or_else(|| Error::native("no file handle").at(path))?;
        Ok(Self { raw, source, path: path.to_path_buf(), preflight, limits })
    }

    /// Path by which the file was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }
    /// File version, writing library and grid directory.
    pub fn preflight(&self) -> &Preflight {
        &self.preflight
    }
    /// Grids in file order.
    pub fn entries(&self) -> &[Entry] {
        &self.preflight.entries
    }

    /// Up axis that the metadata of the file and its grids say; `None` if they say none. A conversion's own statement
    /// comes before what is known of the program that wrote the file.
    pub fn up(&self) -> Option<&StatedUp> {
        self.preflight.up.conclusion()
    }

    pub(super) fn native_metadata(&self) -> Result<Meta> {
        let mut raw = null_mut();
        // SAFETY: the file is open and `raw` a valid place for the handle.
        ffi::call(|s| unsafe { ffi::file_meta(self.raw.as_ptr(), &mut raw, s) }).map_err(|e| e.at(&self.path))?;
        // SAFETY: fresh from the shim.
        unsafe { Meta::own(raw) }.ok_or_else(|| Error::native("no metadata handle").at(&self.path))
    }

    /// Metadata of the file as a whole.
    ///
    /// # Errors
    /// If OpenVDB reports an error.
    pub fn metadata(&self) -> Result<BTreeMap<String, MetaValue>> {
        self.native_metadata()?.entries()
    }

    /// Entry of a grid by its exact name (`density[1]`), or by a name without suffix that only one grid has.
    ///
    /// # Errors
    /// If no grid or several grids have the name; the error lists all grids.
    pub fn find(&self, name: &str) -> Result<&Entry> {
        let entries = self.entries();
        let listed = || entries.iter().map(|e| format!("'{}'", e.name)).collect::<Vec<_>>().join(", ");
        if let Some(exact) = entries.iter().find(|e| e.name == name) {
            return Ok(exact);
        }
        let mut same = entries.iter().filter(|e| e.base_name == name);
        match (same.next(), same.next()) {
            (Some(only), None) => Ok(only),
            (Some(_), Some(_)) => {
                Err(Error::invalid(format!("several grids are named '{name}'; the file has {}", listed()))
                    .at(&self.path)
                    .hint("name one of them with its number"))
            }
            _ if entries.is_empty() => Err(Error::invalid("the file has no grids")
                .at(&self.path)
                .hint("check the export settings of the program that made it")),
            _ => Err(Error::invalid(format!("no grid '{name}'; the file has {}", listed()))
                .at(&self.path)
                .hint("name one of these")),
        }
    }

    /// Loads a grid of any type as a native grid.
    ///
    /// # Errors
    /// If OpenVDB reports an error, or the grid exceeds the memory allowed; the error names file and grid.
    pub fn read(&self, name: &str) -> Result<NativeGrid> {
        let _reading = Reading::begin(&self.path);
        let entry = self.find(name)?;
        let place = |e: Error| e.at(&self.path).part(format!("grid '{}'", entry.name));
        let damaged = |e| place(e).hint("the file may be damaged; export it again");
        if entry.layout.is_some() {
            return load::grid(&self.source, &self.preflight, entry)
                .and_then(|grid| named(grid, entry))
                .map_err(damaged);
        }
        // Grids that were walked node by node are bounded already; others (points) are tried in another process first.
        if !entry.fully_checked {
            helper::rehearse(&self.path, &entry.name, self.limits).map_err(place)?;
        }
        self.read_unguarded(name)
    }

    /// Reads a grid to its last byte and drops it. The helper process calls this function, see [`helper`].
    ///
    /// # Errors
    /// If OpenVDB reports an error, with file and grid; a damaged grid often ends the process instead.
    pub fn try_grid(&self, name: &str) -> Result<()> {
        let grid = self.read_unguarded(name)?;
        // SAFETY: the grid is alive.
        let touched = ffi::call(|s| unsafe { ffi::touch(grid.as_ptr(), s) });
        touched.map_err(|e| e.part(format!("grid '{name}'")).at(&self.path))
    }

    /// Loads a grid by OpenVDB's own reader, without a trial in another process.
    fn read_unguarded(&self, name: &str) -> Result<NativeGrid> {
        let entry = self.find(name)?;
        let place = |e: Error| e.at(&self.path).part(format!("grid '{}'", entry.name));
        let unique = ffi::c_name(&entry.name).map_err(place)?;
        let mut raw = null_mut();
        // SAFETY: the file is open, the name NUL-terminated, and `raw` a valid place.
        ffi::call(|s| unsafe { ffi::read(self.raw.as_ptr(), unique.as_ptr(), &mut raw, s) })
            .map_err(|e| place(e).hint("the file may be damaged; export it again"))?;
        // SAFETY: fresh from the shim.
        unsafe { NativeGrid::own(raw, entry.name.clone()) }.and_then(|grid| named(grid, entry)).map_err(place)
    }

    /// Loads a scalar grid into memory; see [`NativeGrid::to_grid`].
    ///
    /// # Errors
    /// The conditions are those of [`File::read`] and [`NativeGrid::to_grid`].
    pub fn read_grid(&self, name: &str) -> Result<Grid> {
        let _reading = Reading::begin(&self.path);
        self.read(name)?.to_grid_within(self.limits.max_memory).map_err(|e| e.at(&self.path))
    }

    /// Loads the grid of the density: the named one, else `density`, else the only float or double grid that is no
    /// confidence grid.
    ///
    /// # Errors
    /// If there is no such grid or more than one (the error lists the grids), if it is a level set (the error says how
    /// to convert it) or a staggered grid, or if [`File::read_grid`] fails.
    pub fn read_fog(&self, name: Option<&str>) -> Result<Grid> {
        let name = match name {
            Some(n) => n.to_owned(),
            None => self.density_name()?,
        };
        let grid = self.read_grid(&name)?;
        super::require_fog(&grid).map_err(|e| e.at(&self.path))?;
        Ok(grid)
    }

    /// Returns the name of the grid that is taken for the density unless one is named: `density`, else the only float or
    /// double grid that is no confidence grid.
    ///
    /// # Errors
    /// If there is no such grid or more than one; the error lists the grids.
    pub fn density_name(&self) -> Result<String> {
        let entries = self.entries();
        if entries.iter().any(|e| e.base_name == "density") {
            return self.find("density").map(|e| e.name.clone());
        }
        let scalar: Vec<_> = entries
            .iter()
            .filter(|e| matches!(e.grid_type.as_str(), "Tree_float_5_4_3" | "Tree_double_5_4_3"))
            .filter(|e| !e.base_name.ends_with(CONFIDENCE))
            .collect();
        if let [only] = scalar.as_slice() {
            return Ok(only.name.clone());
        }
        if entries.is_empty() {
            return Err(Error::invalid("the file has no grids")
                .at(&self.path)
                .hint("check the export settings of the program that made it"));
        }
        let listed = entries.iter().map(|e| format!("'{}' ({})", e.name, e.grid_type)).collect::<Vec<_>>().join(", ");
        Err(Error::invalid(format!("which grid is the density? The file has {listed}"))
            .at(&self.path)
            .hint("name it with --grid"))
    }
}

impl Drop for File {
    /// Closes the stream. Grids that were read own their data and stay valid.
    fn drop(&mut self) {
        // SAFETY: owned, and closed once.
        unsafe { ffi::close(self.raw.as_ptr()) }
    }
}

/// Gives a grid the name from the file's directory. A damaged entry `name` of its metadata would otherwise become the
/// name under which it is written.
fn named(mut grid: NativeGrid, entry: &Entry) -> Result<NativeGrid> {
    match grid.metadata()?.get("name") {
        Some(MetaValue::Text(name)) if *name != entry.base_name => grid.set_stored_name(&entry.base_name)?,
        _ => (),
    }
    Ok(grid)
}
