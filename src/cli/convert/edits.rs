//! Options of the edits that make other grids of those of a VDB.

use crate::app::convert::{Computed, Convention, Edits, Form, Merge, UpTarget};
use crate::app::up::UpChoice;
use crate::cli::args::read_as;
use crate::cli::parse::number;
use crate::formats::vdb::ResampleFilter;

/// Options of edits from VDB to VDB.
#[derive(Debug, clap::Args)]
struct EditArgs {
    /// Filter of --resample (default: box where no voxel gets finer, which keeps the sum of density times volume;
    /// trilinear elsewhere and for level sets)
    #[arg(long, value_enum, value_name = "FILTER", requires = "resample")]
    filter: Option<ResampleFilter>,
    /// Turn level sets into fog volumes, or fog volumes into level sets; grids that hold neither stay as they are; a
    /// mesh becomes either (default: a level set)
    #[arg(long, value_enum, value_name = "FORM")]
    to: Option<Form>,
    /// Value on the surface: of fog volumes that become level sets (default: half of the largest density), and of grids
    /// that become meshes (default: 0 for level sets; needed for others)
    #[arg(long, value_name = "VALUE", value_parser = number, allow_hyphen_values = true)]
    iso: Option<f64>,
    /// Make three grids NAME.x, NAME.y and NAME.z of a grid of vectors (repeatable)
    #[arg(long, value_name = "NAME")]
    split: Vec<String>,
    /// Make a grid of vectors of three grids of scalars, which are left out (repeatable)
    #[arg(long, value_name = "NAME=X,Y,Z")]
    merge: Vec<Merge>,
    /// Compute a grid of 32-bit floats voxel by voxel of those of the file (repeatable), as in --eval
    /// 'density=max(density-0.1,0)*2'; vectors have components such as velocity.x, other names stand in braces, and x,
    /// y and z are the position in world units. Operators: + - * / ^, comparisons, && || !; functions: min max clamp
    /// mix smoothstep if abs floor ceil round sqrt exp ln log2 log10 pow sin cos tan asin acos atan atan2, and pi
    #[arg(long, value_name = "NAME=EXPRESSION")]
    eval: Vec<Computed>,
    /// Give density, temperature, flame, color and velocity the names that a program expects; others keep theirs
    #[arg(long, value_enum, value_name = "PROGRAM")]
    names: Option<Convention>,
    /// Turn the world by 90 degrees about x until this axis points upwards, after all other edits: y, z, or auto to
    /// leave it as it lies
    #[arg(long, value_enum, value_name = "AXIS", default_value_t)]
    up: UpTarget,
    /// Up axis of the input: y, z, or auto for what its metadata say, else the axis that --up does not name
    #[arg(long, value_enum, value_name = "AXIS", default_value_t, requires = "up")]
    up_from: UpChoice,
}

impl From<EditArgs> for Edits {
    fn from(args: EditArgs) -> Self {
        Self {
            filter: args.filter,
            to: args.to,
            iso: args.iso,
            split: args.split,
            merge: args.merge,
            eval: args.eval,
            names: args.names,
            up: args.up,
            up_from: args.up_from,
        }
    }
}

read_as!(Edits, EditArgs);
