//! Options of images and of values.

use crate::app::convert::{ImageSettings, ValueSettings};
use crate::app::scan::ScanSettings;
use crate::cli::args::read_as;
use crate::cli::parse::{ascending, number};
use crate::formats::sample::{Endian, Sample};

/// Options of images.
#[derive(Debug, clap::Args)]
// Other commands have a --time of their own.
#[command(
    mut_arg("time_point", |arg| arg.alias("time")),
    mut_arg("voxel_edge", |arg| arg.help("Edge of a voxel in world units, for arrays, stacks, raw files and meshes"))
)]
struct ImageArgs {
    #[command(flatten)]
    scan: ScanSettings,
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
        Self { scan: args.scan, dims: args.dims, sample: args.sample, endian: args.endian, skip: args.skip }
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
