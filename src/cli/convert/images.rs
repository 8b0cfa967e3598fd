//! Options of images and of values.

use crate::app::convert::{ImageSettings, ValueSettings};
use crate::cli::args::read_as;
use crate::cli::parse::{ascending, number, point, positive};
use crate::formats::imaging::options::Axes;
use crate::formats::imaging::volume::GridType;
use crate::formats::sample::{Endian, Sample};

/// Options of images.
#[derive(Debug, clap::Args)]
struct ImageArgs {
    /// Number of the point in time to read, from 0 (default: the first one)
    #[arg(long, value_name = "N")]
    time: Option<usize>,
    /// OME-Zarr: number of the channel to read, from 0 (default: the first one)
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
    #[arg(long, value_name = "VOXEL", value_parser = positive, conflicts_with_all = ["transform", "spacing"])]
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
    /// Read numbers without a header: voxels along x (the fastest), y and z; needs --type and --spacing
    #[arg(long, value_name = "X,Y,Z", value_parser = dims, requires = "sample")]
    dims: Option<[usize; 3]>,
    /// Type of the numbers of a raw file: u8, i8, u16, i16, u32, i32, u64, i64, f16, f32 or f64
    #[arg(long = "type", id = "sample", value_name = "TYPE", value_parser = sample, requires = "dims")]
    sample: Option<Sample>,
    /// Order of the bytes of a raw file's numbers
    #[arg(long, value_enum, value_name = "ORDER", requires = "dims")]
    endian: Option<Endian>,
    /// Bytes before the first number of a raw file
    #[arg(long, value_name = "BYTES", requires = "dims")]
    skip: Option<u64>,
}

impl From<ImageArgs> for ImageSettings {
    fn from(args: ImageArgs) -> Self {
        Self {
            time: args.time,
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
            dims: args.dims,
            sample: args.sample,
            endian: args.endian,
            skip: args.skip,
        }
    }
}

read_as!(ImageSettings, ImageArgs);

/// Options of the values, applied in the order in which they stand here.
#[derive(Debug, clap::Args)]
struct ValueArgs {
    /// Multiply every value
    #[arg(long, value_name = "FACTOR", value_parser = factor, allow_hyphen_values = true)]
    scale: Option<f64>,
    /// Add to every value, after --scale
    #[arg(long, value_name = "OFFSET", value_parser = number, allow_hyphen_values = true)]
    offset: Option<f64>,
    /// Map values from LOW to HIGH to 0 to 1, clamped: densities from Hounsfield units, for instance
    #[arg(long, value_name = "LOW,HIGH", value_parser = ascending, allow_hyphen_values = true)]
    map: Option<[f64; 2]>,
    /// Make values at or below T background, after the other steps, and report what that removes
    #[arg(long, value_name = "T", value_parser = number, allow_hyphen_values = true)]
    threshold: Option<f64>,
}

impl From<ValueArgs> for ValueSettings {
    fn from(args: ValueArgs) -> Self {
        Self { scale: args.scale, offset: args.offset, map: args.map, threshold: args.threshold }
    }
}

read_as!(ValueSettings, ValueArgs);

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

fn dims(text: &str) -> Result<[usize; 3], String> {
    let counts: Option<Vec<usize>> = text.split(',').map(|t| t.trim().parse().ok().filter(|n| *n > 0)).collect();
    let counts = counts.and_then(|c| <[usize; 3]>::try_from(c).ok());
    counts.ok_or_else(|| format!("'{text}' is no size; three numbers of voxels are needed: x,y,z"))
}

fn sample(text: &str) -> Result<Sample, String> {
    Sample::ALL.into_iter().find(|s| s.name() == text).ok_or_else(|| {
        let names: Vec<&str> = Sample::ALL.iter().map(|s| s.name()).collect();
        format!("'{text}' is no type; give one of {}", names.join(", "))
    })
}

fn factor(text: &str) -> Result<f64, String> {
    number(text).and_then(|v| if v == 0.0 { Err("a factor of 0 leaves nothing".into()) } else { Ok(v) })
}
