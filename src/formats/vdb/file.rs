//! An open VDB file: its directory comes from the preflight, its grids from OpenVDB, which is given bytes that were
//! checked.

use super::excerpt::Excerpt;
use super::helper;
use super::load;
use super::made::Grids;
use super::meta::Meta;
use super::native::NativeGrid;
use super::preflight::{self, Entry, Preflight};
use super::source::Source;
use super::topology;
use super::up::StatedUp;
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use crate::scene::bricks::too_large;
use crate::scene::grid::{Grid, GridClass, Leaf, MetaValue};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Suffix of the name of a confidence grid, which says how well each voxel of the grid without the suffix is known.
pub(crate) const CONFIDENCE: &str = "_confidence";

/// Bytes that OpenVDB has of a leaf whose values are elsewhere.
const LEAF_WITHOUT_VALUES: u64 = 160;

/// A VDB file open for reading, or a file of another format whose grids are made as OpenVDB has them. Grids are loaded
/// one by one, never lazily.
#[derive(Debug)]
pub struct File {
    path: PathBuf,
    content: Content,
    preflight: Preflight,
    limits: Limits,
}

/// Where the grids of a file come from.
#[derive(Debug)]
enum Content {
    /// A VDB.
    Stored(Source),
    /// A file of another format.
    Made(Box<dyn Grids>),
}

impl File {
    /// Opens a file and checks its skeleton.
    ///
    /// # Errors
    /// If [`preflight::check`] finds a fault.
    pub fn open(path: impl AsRef<Path>, limits: Limits) -> Result<Self> {
        let path = path.as_ref();
        let _reading = Reading::begin(path);
        let (preflight, file) = preflight::open(path, &limits)?;
        let content = Content::Stored(Source::new(file, path)?);
        Ok(Self { path: path.to_path_buf(), content, preflight, limits })
    }

    /// Has the grids of a file of another format read as those of a VDB are.
    pub(crate) fn of_grids(path: &Path, grids: Box<dyn Grids>, limits: Limits) -> Self {
        let preflight = super::made::preflight(&*grids);
        Self { path: path.to_path_buf(), content: Content::Made(grids), preflight, limits }
    }

    /// Path by which the file was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }
    /// File version, writing library and grid directory.
    pub(crate) fn preflight(&self) -> &Preflight {
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
        let source = match &self.content {
            Content::Stored(source) => source,
            Content::Made(grids) => return super::made::metadata(&**grids).map_err(|e| e.at(&self.path)),
        };
        let read = Excerpt::read(source, &self.preflight, &[], &self.limits).and_then(|head| head.metadata());
        read.map_err(|e| e.at(&self.path))
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
                    .coded(Code::NoSuchGrid)
                    .at(&self.path)
                    .hint("name one of them with its number"))
            }
            _ if entries.is_empty() => Err(Error::invalid("the file has no grids")
                .coded(Code::NoSuchGrid)
                .at(&self.path)
                .hint("check the export settings of the program that made it")),
            _ => Err(Error::invalid(format!("no grid '{name}'; the file has {}", listed()))
                .coded(Code::NoSuchGrid)
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
        let grid = match (&self.content, &entry.layout) {
            (Content::Made(grids), _) => {
                let index = self.entries().iter().position(|e| e.name == entry.name).unwrap_or_default();
                return grids.read(index, self.limits).map_err(place);
            }
            (Content::Stored(source), Some(layout)) => {
                load::grid(source, &self.preflight, (entry, layout), &self.limits)
            }
            (Content::Stored(source), None) => self.read_excerpt(source, entry),
        };
        grid.and_then(|grid| named(grid, entry)).map_err(damaged)
    }

    /// Loads a grid by OpenVDB's own reader, with the grid whose tree it shares, if there is one.
    fn read_excerpt(&self, source: &Source, entry: &Entry) -> Result<NativeGrid> {
        let parent = entry.instance_of.as_ref().and_then(|parent| self.entries().iter().find(|e| e.name == *parent));
        let grids: Vec<&Entry> = parent.into_iter().chain([entry]).collect();
        let excerpt = Excerpt::read(source, &self.preflight, &grids, &self.limits)?;
        // Grids that were walked node by node are bounded already; others (points) are tried in another process first.
        if !entry.fully_checked {
            helper::rehearse(&excerpt.bytes, self.limits)?;
        }
        excerpt.grid(&entry.name)
    }

    /// Loads a scalar grid into memory; see [`NativeGrid::to_grid`].
    ///
    /// # Errors
    /// The conditions are those of [`File::read`] and [`NativeGrid::to_grid`].
    pub fn read_grid(&self, name: &str) -> Result<Grid> {
        let _reading = Reading::begin(&self.path);
        let entry = self.find(name)?;
        match (&self.content, &entry.layout) {
            (Content::Stored(source), Some(layout)) if topology::is_scalar(&entry.grid_type) => {
                let placed = |e: Error| e.at(&self.path).part(format!("grid '{}'", entry.name));
                let damaged = |e| placed(e).hint("the file may be damaged; export it again");
                let bytes = entry.topology.map_or(0, |t| t.leaves) * (size_of::<Leaf>() as u64 + LEAF_WITHOUT_VALUES);
                if bytes > self.limits.max_memory {
                    return Err(placed(too_large(bytes, self.limits.max_memory)));
                }
                let loaded = load::scalars(source, &self.preflight, (entry, layout), &self.limits);
                let (grid, leaves) = loaded.map_err(damaged)?;
                named(grid, entry).map_err(damaged)?.grid_of(leaves).map_err(placed)
            }
            _ => self.read(name)?.to_grid_within(self.limits.max_memory).map_err(|e| e.at(&self.path)),
        }
    }

    /// Loads the grid of the density: the named one, else `density`, else the only float or double grid that is no
    /// confidence grid. A level set is loaded as the fog volume inside of its surface: densities are 0 outside, and
    /// rise from 0 on the surface to 1 where the narrow band ends inside (OpenVDB's `sdfToFogVolume`).
    ///
    /// # Errors
    /// If there is no such grid or more than one (the error lists the grids), if it is a staggered grid, or if
    /// [`File::read_grid`] fails.
    pub fn read_fog(&self, name: Option<&str>) -> Result<Grid> {
        let name = match name {
            Some(n) => n.to_owned(),
            None => self.density_name()?,
        };
        let grid = self.read_grid(&name)?;
        let at = |e: Error| e.at(&self.path);
        if grid.class != GridClass::LevelSet {
            super::require_fog(&grid).map_err(at)?;
            return Ok(grid);
        }
        drop(grid);
        let mut native = self.read(&name)?;
        native.make_fog().and_then(|()| native.to_grid_within(self.limits.max_memory)).map_err(at)
    }

    /// Returns the name of the grid that is taken for the density unless one is named: `density`, else the only float
    /// or double grid that is no confidence grid.
    ///
    /// # Errors
    /// If there is no such grid or more than one; the error lists the grids.
    pub(crate) fn density_name(&self) -> Result<String> {
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
        // Scans of integers have no others.
        if let [only] = entries
            && only.grid_type == "Tree_int32_5_4_3"
        {
            return Ok(only.name.clone());
        }
        if entries.is_empty() {
            return Err(Error::invalid("the file has no grids")
                .coded(Code::NoSuchGrid)
                .at(&self.path)
                .hint("check the export settings of the program that made it"));
        }
        let listed = entries.iter().map(|e| format!("'{}' ({})", e.name, e.grid_type)).collect::<Vec<_>>().join(", ");
        Err(Error::invalid(format!("which grid is the density? The file has {listed}"))
            .coded(Code::NoSuchGrid)
            .at(&self.path)
            .hint("name it with ⟨grid⟩"))
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
