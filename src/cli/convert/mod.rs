//! `cumulo convert`: volumes, images and pictures from one file format to another.

mod edits;
mod images;
mod meshes;

use super::args::read_as;
use super::memory::Memory;
use super::parse::{corners, exposure, not_negative, positive};
use crate::app::convert::{ConvertSettings, Edits, ImageSettings, MeshSettings, Repair, ValueSettings};
use crate::app::sequence::FrameSelection;
use crate::app::transfer::TransferSettings;
use crate::error::Result;
use crate::formats::vdb::Codec;
use crate::math::Aabb;
use std::path::PathBuf;

/// Convert a VDB with edits, scientific and medical images and meshes to VDBs and back, pictures to arrays and back
///
/// Inputs are told by their content, outputs by their ending. DICOM series (folders), NIfTI, NRRD, MetaImage, TIFF
/// stacks (also folders and patterns), OME-Zarr, MRC, .cvol, Mitsuba's .vol, .vti, .vtk, .npy, .npz and raw numbers
/// (--dims) become a VDB with a grid for each array. A NanoVDB (.nvdb) becomes a VDB, and a VDB a NanoVDB. A grid of a
/// VDB becomes a .nii, .nii.gz, .nrrd, .mha, .mhd, .vti, .vol or .npy over the box of its active voxels. VDB to VDB
/// takes edits. A layer of an EXR becomes a .npy of [row, column, channel], row 0 at the top, and back; or a .png for
/// display: radiance times two to the power of --exposure, clipped to 0..1, encoded by sRGB's curve. A deep EXR becomes
/// a flat one, or a .png, with --flatten. The report has the places of voxels.
///
/// A grid of a VDB becomes a .ply or .obj: the surface on which it has the value of --iso, quads and triangles as
/// OpenVDB makes them, which face outwards. A closed mesh, .ply, .obj, .glb or .gltf, becomes a level set with voxels
/// of --voxel-size, or with --to fog a fog volume. Meshes with open edges are refused, because they have no inside.
///
/// Several VDBs before the last one are joined: their grids become those of one file, at the places that they have.
/// Files whose metadata state different up axes, and grids of one name in two files, are refused.
///
/// Of a sequence, 'in.####.vdb' or a folder of numbered files, every frame is converted: to 'out.####.vdb', or to the
/// same names in another folder.
#[derive(Debug, clap::Args)]
struct ConvertArgs {
    /// File, folder or pattern of slices to read
    input: PathBuf,
    /// Other VDBs, whose grids are joined with those of the first one
    #[arg(value_name = "VDB")]
    more: Vec<PathBuf>,
    /// VDB, .nvdb, image, mesh, .npy, EXR or PNG to write
    output: PathBuf,
    #[command(flatten)]
    frames: FrameSelection,
    /// Keep only this grid (repeatable); from an image: name of the grid
    #[arg(long, value_name = "NAME")]
    grid: Vec<String>,
    /// Rename a grid (repeatable)
    #[arg(long, value_name = "OLD=NEW", value_parser = renaming)]
    rename: Vec<(String, String)>,
    /// Store real values as 16-bit floats
    #[arg(long)]
    half: bool,
    /// How values are packed
    #[arg(long, value_enum, default_value_t)]
    codec: Codec,
    /// Keep only what lies in this world-space box
    #[arg(long, value_name = "X0,Y0,Z0,X1,Y1,Z1", value_parser = corners, allow_hyphen_values = true)]
    crop: Option<Aabb>,
    /// Resample to cubic voxels of this edge length in world units
    #[arg(long, value_name = "VOXEL", value_parser = positive)]
    resample: Option<f64>,
    /// Make blocks whose values agree within TOL constant
    #[arg(long, value_name = "TOL", value_parser = not_negative)]
    prune: Option<f64>,
    /// Set NaN and infinite values, and negative densities, to zero; auto: fog volumes hold densities, other grids do
    /// not
    #[arg(
        long,
        value_enum,
        value_name = "WHAT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "auto",
    )]
    repair: Option<Repair>,
    /// EXR to .npy or .png: layer (default: the beauty)
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// EXR to .png: exposure in stops (default: 0)
    #[arg(long, value_name = "EV", value_parser = exposure, allow_negative_numbers = true)]
    exposure: Option<f64>,
    /// Deep EXR to a flat one or a .png: composite the samples of each pixel, sorted, and split where they overlap;
    /// channel Z is the depth of the nearest sample that is not fully transparent, 1e10 where there is none
    #[arg(long)]
    flatten: bool,
    /// With --flatten: hold the picture out by another deep EXR, or by the depths of opaque objects along the viewing
    /// axis; of frames, 'prop.####.exr'. What lies behind them is left out, and they show nothing themselves
    #[arg(long, value_name = "EXR", requires = "flatten")]
    holdout: Option<PathBuf>,
    #[command(flatten)]
    edits: Edits,
    #[command(flatten)]
    values: ValueSettings,
    #[command(flatten)]
    images: ImageSettings,
    #[command(flatten)]
    meshes: MeshSettings,
    #[command(flatten)]
    transfer: TransferSettings,
    #[command(flatten)]
    memory: Memory,
}

impl From<ConvertArgs> for ConvertSettings {
    fn from(args: ConvertArgs) -> Self {
        Self {
            input: args.input,
            more: args.more,
            output: args.output,
            frames: args.frames,
            grid: args.grid,
            rename: args.rename,
            half: args.half,
            codec: args.codec,
            crop: args.crop.map(|world| [world.min.to_array(), world.max.to_array()]),
            resample: args.resample,
            prune: args.prune,
            repair: args.repair,
            layer: args.layer,
            exposure: args.exposure,
            flatten: args.flatten,
            holdout: args.holdout,
            edits: args.edits,
            values: args.values,
            images: args.images,
            meshes: args.meshes,
            transfer: args.transfer,
            limits: args.memory.limits(),
        }
    }
}

read_as!(ConvertSettings, ConvertArgs);

fn renaming(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((old, new)) if !old.is_empty() && !new.is_empty() => Ok((old.into(), new.into())),
        _ => Err(format!("'{text}' is not OLD=NEW")),
    }
}
