//! Options of the routes from and to images: which part of a file, where its voxels lie, and what becomes of its values.

use super::report::GridPlace;
use crate::cli::parse::{ascending, number};
use crate::error::{Error, Result};
use crate::formats::imaging::options::{Axes, Options as ReadOptions, RawLayout};
use crate::formats::imaging::values::{Mapping, Tally};
use crate::formats::imaging::volume::GridType;
use crate::formats::sample::{Endian, Sample};
use crate::math::Affine;
use crate::text::printable;
use clap::ValueEnum;
use glam::{DMat4, DVec3, DVec4};

/// Options of images.
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Number of the point in time to read, from 0 (default: the first one)
    #[arg(long, value_name = "N")]
    pub time: Option<usize>,
    /// OME-Zarr: number of the channel to read, from 0 (default: the first one)
    #[arg(long, value_name = "N")]
    pub channel: Option<usize>,
    /// OME-Zarr: number of the resolution to read, 0 for the finest (default: the finest that fits into memory)
    #[arg(long, value_name = "N")]
    pub level: Option<usize>,
    /// DICOM: UID of the series to read, of a folder with several
    #[arg(long, value_name = "UID")]
    pub series: Option<String>,
    /// Read only this array of a file with several
    #[arg(long, value_name = "NAME")]
    pub array: Option<String>,
    /// Type of the grid's values (default: int for images of integers, except NumPy's, else float)
    #[arg(long = "as", value_enum, value_name = "TYPE")]
    pub grid_type: Option<As>,
    /// Order of the axes of NumPy's arrays, the slowest first (default: xyz)
    #[arg(long, value_enum, value_name = "ORDER")]
    pub axes: Option<Order>,
    /// Edge of a voxel in world units, for arrays, stacks and raw files
    #[arg(long, value_name = "VOXEL", value_parser = crate::cli::parse::positive, conflicts_with_all = ["transform", "spacing"])]
    pub voxel_size: Option<f64>,
    /// Edges of a voxel along x, y and z, for arrays, stacks and raw files
    #[arg(long, value_name = "X,Y,Z", value_parser = spacing, conflicts_with = "transform")]
    pub spacing: Option<DVec3>,
    /// World position of the centre of the first voxel, for arrays, stacks and raw files (default: 0,0,0)
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, conflicts_with = "transform")]
    pub origin: Option<DVec3>,
    /// The first three rows of the matrix from indices to the world, twelve numbers, acting on columns
    #[arg(long, value_name = "A00,A01,..,A23", value_parser = rows, allow_hyphen_values = true)]
    pub transform: Option<DMat4>,
    /// Read numbers without a header: voxels along x (the fastest), y and z; needs --type and --spacing
    #[arg(long, value_name = "X,Y,Z", value_parser = dims, requires = "sample")]
    pub dims: Option<[usize; 3]>,
    /// Type of the numbers of a raw file: u8, i8, u16, i16, u32, i32, u64, i64, f16, f32 or f64
    #[arg(long = "type", id = "sample", value_name = "TYPE", value_parser = sample, requires = "dims")]
    pub sample: Option<Sample>,
    /// Order of the bytes of a raw file's numbers
    #[arg(long, value_enum, value_name = "ORDER", requires = "dims")]
    pub endian: Option<ByteOrder>,
    /// Bytes before the first number of a raw file
    #[arg(long, value_name = "BYTES", requires = "dims")]
    pub skip: Option<u64>,
}

/// Type of a grid's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum As {
    /// 32-bit floats
    Float,
    /// 64-bit floats
    Double,
    /// 32-bit integers
    Int,
}

/// Order of the axes of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Order {
    /// array[x, y, z]
    Xyz,
    /// array[z, y, x]
    Zyx,
}

/// Order of the bytes of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ByteOrder {
    /// Least significant first
    Little,
    /// Most significant first
    Big,
}

/// Options of the values, applied in the order in which they stand here.
#[derive(Debug, Clone, clap::Args)]
pub struct ValueOptions {
    /// Multiply every value
    #[arg(long, value_name = "FACTOR", value_parser = factor, allow_hyphen_values = true)]
    pub scale: Option<f64>,
    /// Add to every value, after --scale
    #[arg(long, value_name = "OFFSET", value_parser = number, allow_hyphen_values = true)]
    pub offset: Option<f64>,
    /// Map values from LOW to HIGH to 0 to 1, clamped: densities from Hounsfield units, for instance
    #[arg(long, value_name = "LOW,HIGH", value_parser = ascending, allow_hyphen_values = true)]
    pub map: Option<[f64; 2]>,
    /// Make values at or below T background, after the other steps, and report what that removes
    #[arg(long, value_name = "T", value_parser = number, allow_hyphen_values = true)]
    pub threshold: Option<f64>,
}

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    text.split(',').map(number).collect()
}

fn point(text: &str) -> Result<DVec3, String> {
    match numbers(text)?[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        ref other => Err(format!("{} numbers, three are needed: x,y,z", other.len())),
    }
}

fn spacing(text: &str) -> Result<DVec3, String> {
    let spacing = point(text)?;
    if spacing.min_element() > 0.0 { Ok(spacing) } else { Err(format!("'{text}' must be above zero")) }
}

fn rows(text: &str) -> Result<DMat4, String> {
    let numbers = numbers(text)?;
    if numbers.len() != 12 {
        return Err(format!("{} numbers, twelve are needed: three rows of four", numbers.len()));
    }
    let row = |r: usize| DVec4::from_slice(&numbers[4 * r..4 * r + 4]);
    Ok(DMat4::from_cols(row(0), row(1), row(2), DVec4::W).transpose())
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

impl Options {
    /// Options of the readers.
    ///
    /// # Errors
    /// If the transform is singular.
    pub fn reading(&self) -> Result<ReadOptions> {
        let raw = self.dims.zip(self.sample).map(|(size, sample)| RawLayout {
            size,
            sample,
            endian: if self.endian == Some(ByteOrder::Big) { Endian::Big } else { Endian::Little },
            skip: self.skip.unwrap_or(0),
        });
        Ok(ReadOptions {
            time: self.time,
            channel: self.channel,
            level: self.level,
            series: self.series.clone(),
            array: self.array.clone(),
            spacing: self.spacing.or(self.voxel_size.map(DVec3::splat)),
            origin: self.origin,
            transform: self.transform.map(Affine::new).transpose()?,
            axes: self.axes(),
            raw,
        })
    }

    /// Order of the axes of an array.
    pub fn axes(&self) -> Axes {
        if self.axes == Some(Order::Zyx) { Axes::Zyx } else { Axes::Xyz }
    }

    /// Type of the grid; arrays of NumPy make floats unless told otherwise.
    pub fn grid_type(&self, numpy: bool) -> GridType {
        match self.grid_type {
            Some(As::Float) => GridType::Float,
            Some(As::Double) => GridType::Double,
            Some(As::Int) => GridType::Int,
            None if numpy => GridType::Float,
            None => GridType::Auto,
        }
    }
}

impl ValueOptions {
    /// Steps that the options name.
    pub fn mapping(&self) -> Mapping {
        Mapping {
            scale: self.scale.unwrap_or(1.0),
            offset: self.offset.unwrap_or(0.0),
            range: self.map,
            threshold: self.threshold,
        }
    }

    /// True if an option is given.
    pub fn any(&self) -> bool {
        self.scale.is_some() || self.offset.is_some() || self.map.is_some() || self.threshold.is_some()
    }
}

/// Sentences about a grid that was made of an image and may not be what the user expects.
pub fn remarks(grid: &GridPlace) -> Vec<String> {
    let (name, values) = (printable(&grid.name), &grid.values);
    let mut remarks = Vec::new();
    if grid.active_voxels == 0 && values.vanished == 0 {
        remarks.push(format!("grid '{name}': every value is 0, so that no voxel is active"));
    }
    if values.non_finite > 0 {
        let count = values.non_finite;
        remarks
            .push(format!("grid '{name}': {count} values are NaN or infinite; cumulo convert --repair sets them to 0"));
    }
    remarks.extend(losses(&name, values, grid.background.len()));
    if grid.value_type == "int32" {
        remarks.push(format!("grid '{name}' holds integers; --as float makes floats, and --map LOW,HIGH densities"));
    } else if values.least.is_some_and(|l| l < 0.0) {
        remarks
            .push(format!("grid '{name}' has negative values; --map LOW,HIGH makes densities, which can be rendered"));
    }
    remarks
}

/// Sentences about values that a grid of 32-bit floats does not hold.
pub fn losses(name: &str, values: &Tally, components: usize) -> Vec<String> {
    // Vectors have no other type.
    let remedy = if components == 1 { "; --as double keeps them" } else { "" };
    let sentences = [
        (values.rounded, "whole numbers beyond 16777216 are rounded to 32-bit floats"),
        (values.overflowed, "values are too large for 32-bit floats and became infinite"),
        (values.vanished, "values are too small for 32-bit floats and became 0"),
    ];
    let told = sentences.into_iter().filter(|(count, _)| *count > 0);
    told.map(|(count, what)| format!("grid '{name}': {count} {what}{remedy}")).collect()
}

/// Error that nothing is left of a grid.
pub fn empty(name: &str) -> Error {
    Error::invalid("no value differs from the background, 0, so that no voxel is active")
        .part(format!("grid '{name}'"))
        .hint("choose another --threshold or --map, or another array")
}
