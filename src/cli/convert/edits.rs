//! Options of the edits that make other grids of those of a VDB: names, forms, lattices, axes.

use super::form::Form;
use super::names::Convention;
use super::sources::Merge;
use crate::cli::parse::number;
use crate::cli::up::UpChoice;
use crate::formats::vdb::ResampleFilter;
use crate::scene::up::Up;

/// Options of edits from VDB to VDB.
#[derive(Debug, Clone, clap::Args)]
pub struct Edits {
    /// Filter of --resample (default: box where no voxel gets finer, which keeps the sum of density times volume;
    /// trilinear elsewhere and for level sets)
    #[arg(long, value_enum, value_name = "FILTER", requires = "resample")]
    pub filter: Option<ResampleFilter>,
    /// Turn level sets into fog volumes, or fog volumes into level sets; grids that hold neither stay as they are
    #[arg(long, value_enum, value_name = "FORM")]
    pub to: Option<Form>,
    /// Density of the surface that becomes a level set (default: half of the largest density)
    #[arg(long, value_name = "DENSITY", value_parser = number, allow_hyphen_values = true, requires = "to")]
    pub iso: Option<f64>,
    /// Make three grids NAME.x, NAME.y and NAME.z of a grid of vectors (repeatable)
    #[arg(long, value_name = "NAME")]
    pub split: Vec<String>,
    /// Make a grid of vectors of three grids of scalars, which are left out (repeatable)
    #[arg(long, value_name = "NAME=X,Y,Z")]
    pub merge: Vec<Merge>,
    /// Give density, temperature, flame, color and velocity the names that a program expects; others keep theirs
    #[arg(long, value_enum, value_name = "PROGRAM")]
    pub names: Option<Convention>,
    /// Turn the world by 90 degrees about x until this axis points upwards, after all other edits: y, z, or auto to leave
    /// it as it lies
    #[arg(long, value_enum, value_name = "AXIS", default_value_t)]
    pub up: UpTarget,
    /// Up axis of the input: y, z, or auto for what its metadata say, else the axis that --up does not name
    #[arg(long, value_enum, value_name = "AXIS", default_value_t, requires = "up")]
    pub up_from: UpChoice,
}

/// Up axis of a conversion's output.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum UpTarget {
    /// The world lies as it did: nothing is turned
    #[default]
    Auto,
    /// +Y, as in Houdini and Maya
    Y,
    /// +Z, as in Blender
    Z,
}

impl UpTarget {
    /// Returns the axis; `None` where nothing is to be turned.
    pub fn axis(self) -> Option<Up> {
        match self {
            Self::Auto => None,
            Self::Y => Some(Up::Y),
            Self::Z => Some(Up::Z),
        }
    }
}

impl Edits {
    /// Returns the options by name, each with whether it is given.
    pub fn given(&self) -> [(&'static str, bool); 8] {
        [
            ("--filter", self.filter.is_some()),
            ("--to", self.to.is_some()),
            ("--iso", self.iso.is_some()),
            ("--split", !self.split.is_empty()),
            ("--merge", !self.merge.is_empty()),
            ("--names", self.names.is_some()),
            ("--up", self.up != UpTarget::Auto),
            ("--up-from", self.up_from != UpChoice::Auto),
        ]
    }
}
