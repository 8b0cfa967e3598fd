//! Turns of the world from one up axis to the other.

use super::edits::Edits;
use crate::app::up::UpChoice;
use crate::error::{Error, Result};
use crate::formats::vdb::up::UP_KEY;
use crate::formats::vdb::vector_kind::{self, VectorKind};
use crate::formats::vdb::{File, GridInfo, NativeGrid};
use crate::math::Affine;
use crate::scene::grid::{GridClass, MetaValue};
use crate::scene::up::Up;
use crate::wording::worded;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

/// Words of a creator between this program and the creator of the file that it turned.
const TURNED: &str = ", turned from a file of ";

/// A turn of the world by a quarter about x, or none where the axes are equal.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub(super) struct Turn {
    /// Up axis of the input.
    pub from: Up,
    /// Up axis of the output.
    pub to: Up,
    /// Reason for the axis of the input, in words.
    pub reason: String,
}

impl Turn {
    /// Returns the turn that the settings ask for; `None` without `up`.
    pub(crate) fn of(edits: &Edits, file: &File) -> Option<Self> {
        let to = edits.up.axis()?;
        let (from, reason) = match (edits.up_from, file.up()) {
            (UpChoice::Y, _) => (Up::Y, worded("⟨up_from⟩ says so").into()),
            (UpChoice::Z, _) => (Up::Z, worded("⟨up_from⟩ says so").into()),
            (UpChoice::Auto, Some(stated)) => (stated.up, stated.reason.clone()),
            (UpChoice::Auto, None) => {
                (to.other(), worded("nothing in the input states it, and ⟨up⟩ asks for the other").into())
            }
        };
        Some(Self { from, to, reason })
    }

    /// Returns the metadata of the file that is written: its up axis and, of a file that was turned, a creator by which
    /// no program takes it for one that still has the axis of before. Blender's importer turns what Houdini has
    /// created.
    ///
    /// # Errors
    /// If the metadata of the input cannot be read.
    pub(crate) fn metadata(&self, file: &File) -> Result<BTreeMap<String, MetaValue>> {
        let mut metadata = BTreeMap::from([(UP_KEY.to_owned(), MetaValue::Text(self.to.name().into()))]);
        if let (true, Some(MetaValue::Text(creator))) = (self.from != self.to, file.metadata()?.get("creator")) {
            // A file that is turned back has its creator again.
            let creator = match creator.split_once(TURNED) {
                Some((_, earlier)) => earlier.to_owned(),
                None => format!("cumulo {}{TURNED}{creator}", env!("CARGO_PKG_VERSION")),
            };
            metadata.insert("creator".into(), MetaValue::Text(creator));
        }
        Ok(metadata)
    }

    /// Turns a grid: its transform, and its vectors if they are those of world space. Returns whether the vectors were
    /// turned; `None` for grids without vectors.
    ///
    /// # Errors
    /// If the grid is staggered, or its transform is not affine or cannot be written when turned.
    pub(crate) fn apply(
        &self,
        native: &mut NativeGrid,
        info: &GridInfo,
        warnings: &mut Vec<String>,
    ) -> Result<Option<bool>> {
        if self.from == self.to {
            return Ok(None);
        }
        if info.class == GridClass::Staggered {
            return Err(Error::unsupported(
                "a staggered grid cannot be turned: its components lie on faces across its axes",
            )
            .hint(
                "leave it out by naming the other grids with ⟨grid⟩, or make it a grid of vectors at voxels' centres",
            ));
        }
        let vectors = self.turn_vectors(native, info, warnings)?;
        let turn = Affine::new(self.from.turn_map(self.to))?;
        native.set_transform(&info.affine()?.then(&turn)?)?;
        Ok(vectors)
    }

    fn turn_vectors(
        &self,
        native: &mut NativeGrid,
        info: &GridInfo,
        warnings: &mut Vec<String>,
    ) -> Result<Option<bool>> {
        if info.value_type.starts_with("ptdataidx") {
            warnings.push(format!("grid '{}': points were turned, vectors among their attributes were not", info.name));
        }
        if info.components != 3 {
            return Ok(None);
        }
        let metadata = native.metadata()?;
        let local = matches!(metadata.get("is_local_space"), Some(MetaValue::Bool(true)));
        let vector_type = match metadata.get("vector_type") {
            Some(MetaValue::Text(text)) => Some(text.as_str()),
            _ => None,
        };
        let kind = vector_kind::of(&info.name, local, vector_type);
        let advice = "if they are vectors of world space, state so where they are made (vector_type)";
        match kind {
            VectorKind::World => native.turn_vectors(self.from.turn(self.to))?,
            VectorKind::Fixed if !local && vector_kind::is_world_name(&info.name) => warnings.push(format!(
                "grid '{}': its values were not turned, since its vector_type is 'invariant'; {advice}",
                info.name
            )),
            VectorKind::Fixed => {}
            VectorKind::Unstated => warnings.push(format!(
                "grid '{}': its values were not turned, since nothing states what kind of vectors they are; {advice}",
                info.name
            )),
        }
        Ok(Some(kind == VectorKind::World))
    }
}

impl fmt::Display for Turn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (from, to) = (self.from.name(), self.to.name());
        write!(f, "up axis of the input {from}: {}; ", self.reason)?;
        if self.from == self.to { write!(f, "nothing is turned") } else { write!(f, "turned to {to}-up") }
    }
}
