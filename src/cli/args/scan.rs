//! Options of scans, images and arrays.

use super::read_as;
use crate::app::scan::ScanSettings;
use crate::cli::parse::{number, point, positive};
use crate::formats::imaging::options::Axes;
use crate::formats::imaging::volume::GridType;

/// Which part of a scan, an image or an array is read, and where its voxels lie.
#[derive(Debug, clap::Args)]
struct ScanArgs {
    /// Number of the point in time to read, of a file with several, from 0
    #[arg(long, value_name = "N")]
    time_point: Option<usize>,
    /// OME-Zarr: number of the channel to read, of an image with several, from 0
    #[arg(long, value_name = "N")]
    channel: Option<usize>,
    /// OME-Zarr: number of the resolution to read, 0 for the finest (default: the finest that fits into memory)
    #[arg(long, value_name = "N")]
    level: Option<usize>,
    /// DICOM: UID of the series to read, of a folder with several
    #[arg(long, value_name = "UID")]
    series: Option<String>,
    /// Read only this array of a file with several
    #[arg(long, value_name = "NAME")]
    array: Option<String>,
    /// Type of the grid's values (default: int for images of integers, except NumPy's, else float)
    #[arg(long = "as", value_enum, value_name = "TYPE")]
    grid_type: Option<GridType>,
    /// Order of the axes of NumPy's arrays, the slowest first (default: xyz)
    #[arg(long, value_enum, value_name = "ORDER")]
    axes: Option<Axes>,
    /// Edge of a voxel in world units, for arrays, stacks and raw files
    #[arg(
        id = "voxel_edge",
        long = "voxel-size",
        value_name = "VOXEL",
        value_parser = positive,
        conflicts_with_all = ["transform", "spacing"],
    )]
    voxel_size: Option<f64>,
    /// Edges of a voxel along x, y and z, for arrays, stacks and raw files
    #[arg(long, value_name = "X,Y,Z", value_parser = spacing, conflicts_with = "transform")]
    spacing: Option<[f64; 3]>,
    /// World position of the centre of the first voxel, for arrays, stacks and raw files (default: 0,0,0)
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, conflicts_with = "transform")]
    origin: Option<[f64; 3]>,
    /// The first three rows of the matrix from indices to the world, twelve numbers, acting on columns
    #[arg(long, value_name = "A00,A01,..,A23", value_parser = rows, allow_hyphen_values = true)]
    transform: Option<[[f64; 4]; 3]>,
}

impl From<ScanArgs> for ScanSettings {
    fn from(args: ScanArgs) -> Self {
        Self {
            time_point: args.time_point,
            channel: args.channel,
            level: args.level,
            series: args.series,
            array: args.array,
            grid_type: args.grid_type,
            axes: args.axes,
            voxel_size: args.voxel_size,
            spacing: args.spacing,
            origin: args.origin,
            transform: args.transform,
        }
    }
}

read_as!(ScanSettings, ScanArgs);

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    text.split(',').map(number).collect()
}

fn spacing(text: &str) -> Result<[f64; 3], String> {
    let spacing = point(text)?;
    if spacing.iter().all(|edge| *edge > 0.0) { Ok(spacing) } else { Err(format!("'{text}' must be above zero")) }
}

fn rows(text: &str) -> Result<[[f64; 4]; 3], String> {
    let numbers = numbers(text)?;
    if numbers.len() != 12 {
        return Err(format!("{} numbers, twelve are needed: three rows of four", numbers.len()));
    }
    Ok(std::array::from_fn(|row| std::array::from_fn(|column| numbers[4 * row + column])))
}
