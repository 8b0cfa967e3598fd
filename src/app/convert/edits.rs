//! Edits that make other grids of those of a VDB: names, forms, lattices, axes.

use super::computed::Computed;
use super::form::Form;
use super::names::Convention;
use super::sources::Merge;
use crate::app::up::UpChoice;
use crate::formats::vdb::ResampleFilter;
use crate::scene::up::Up;
use serde::{Deserialize, Serialize};

/// Edits from VDB to VDB.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Edits {
    /// Filter of a resampling; none for the box filter where no voxel gets finer, which keeps the sum of density times
    /// volume, and for trilinear interpolation elsewhere and for level sets.
    pub filter: Option<ResampleFilter>,
    /// Form that level sets or fog volumes are given; grids that hold neither stay as they are.
    pub to: Option<Form>,
    /// Density of the surface that becomes a level set, none for half of the largest density; value of the surface that
    /// becomes a mesh, none for 0 in a level set.
    pub iso: Option<f64>,
    /// Names of grids of vectors of which each becomes three: NAME.x, NAME.y and NAME.z.
    pub split: Vec<String>,
    /// Grids of vectors to be made of three grids of scalars, which are left out.
    pub merge: Vec<Merge>,
    /// Grids to be computed voxel by voxel of those of the file, one of whose name is replaced.
    pub eval: Vec<Computed>,
    /// Program whose names density, temperature, flame, color and velocity are given.
    pub names: Option<Convention>,
    /// Axis that points upwards after a turn by 90 degrees about x, behind all other edits.
    pub up: UpTarget,
    /// Up axis of the input; that of its metadata by default, else the one that `up` does not name.
    pub up_from: UpChoice,
}

/// Up axis of a conversion's output.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UpTarget {
    /// The world lies as it did: nothing is turned.
    #[default]
    Auto,
    /// +Y, as in Houdini and Maya.
    Y,
    /// +Z, as in Blender.
    Z,
}

impl UpTarget {
    /// Returns the axis; `None` where nothing is to be turned.
    pub(crate) fn axis(self) -> Option<Up> {
        match self {
            Self::Auto => None,
            Self::Y => Some(Up::Y),
            Self::Z => Some(Up::Z),
        }
    }
}

impl Edits {
    /// Returns the settings by name, each with whether it is given.
    pub(crate) fn stated(&self) -> [(&'static str, bool); 9] {
        [
            ("⟨filter⟩", self.filter.is_some()),
            ("⟨to⟩", self.to.is_some()),
            ("⟨iso⟩", self.iso.is_some()),
            ("⟨split⟩", !self.split.is_empty()),
            ("⟨merge⟩", !self.merge.is_empty()),
            ("⟨eval⟩", !self.eval.is_empty()),
            ("⟨names⟩", self.names.is_some()),
            ("⟨up⟩", self.up != UpTarget::Auto),
            ("⟨up_from⟩", self.up_from != UpChoice::Auto),
        ]
    }
}
