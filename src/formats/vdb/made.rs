//! Files of other formats whose grids are made as OpenVDB has them, so that all that reads a VDB reads these, too.

use super::dense::ValueKind;
use super::meta::Meta;
use super::native::NativeGrid;
use super::preflight::{Entry, Preflight, Span};
use super::up::UpMarks;
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::scene::grid::MetaValue;
use std::collections::BTreeMap;
use std::fmt::Debug;

/// The grids of a file of another format than OpenVDB's.
pub(crate) trait Grids: Debug {
    /// Returns the names of the grids, of which several may be equal, and the types of their values.
    fn list(&self) -> Vec<(String, ValueKind)>;

    /// Returns what the file states beside its grids, such as the program that wrote it.
    fn texts(&self) -> &BTreeMap<String, String>;

    /// Makes a grid by its place in [`Grids::list`].
    ///
    /// # Errors
    /// If the file cannot be read, or the grid does not fit into the limits.
    fn read(&self, index: usize, limits: Limits) -> Result<NativeGrid>;
}

/// Returns the directory of a file of such grids.
pub(super) fn preflight(grids: &dyn Grids) -> Preflight {
    let list = grids.list();
    let mut up = UpMarks::default();
    grids.texts().iter().for_each(|(name, text)| up.note(name, "string", text.as_bytes()));
    let entry = |(at, (name, kind)): (usize, &(String, ValueKind))| {
        let several = list.iter().filter(|(other, _)| other == name).count() > 1;
        let before = list[..at].iter().filter(|(other, _)| other == name).count();
        Entry {
            name: if several { format!("{name}[{before}]") } else { name.clone() },
            base_name: name.clone(),
            grid_type: kind.tree_type().to_owned(),
            half: false,
            instance_of: None,
            file_bytes: 0,
            topology: None,
            fully_checked: true,
            span: Span { from: 0, block: 0, end: 0 },
            layout: None,
        }
    };
    let entries = list.iter().enumerate().map(entry).collect();
    Preflight { version: 0, library: (0, 0), entries, head: 0, up }
}

/// Returns what the file states as metadata.
pub(super) fn metadata(grids: &dyn Grids) -> Result<Meta> {
    let mut meta = Meta::new()?;
    grids.texts().iter().try_for_each(|(name, text)| meta.set(name, &MetaValue::Text(text.clone())))?;
    Ok(meta)
}
