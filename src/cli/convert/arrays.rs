//! Grids and layers of pictures as NumPy arrays, and arrays as grids and pictures.

use super::Convert;
use crate::cli::memory::human;
use crate::cli::output::Output;
use crate::cli::outputs::{self, Content};
use crate::cli::parse::{number, positive};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::vdb::{Codec, File, NativeGrid, write_native};
use crate::formats::{dense, exr, npy};
use crate::math::Affine;
use crate::scene::film::Film;
use glam::{DMat4, DVec3, DVec4};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Options of the routes from and to arrays.
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// EXR to .npy: layer (default: the beauty)
    #[arg(long, value_name = "NAME")]
    pub layer: Option<String>,
    /// .npy to VDB: edge of a voxel in world units
    #[arg(long, value_name = "VOXEL", value_parser = positive, conflicts_with = "transform")]
    pub voxel_size: Option<f64>,
    /// .npy to VDB: world position of the centre of voxel [0, 0, 0] (default: 0,0,0)
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, conflicts_with = "transform")]
    pub origin: Option<DVec3>,
    /// .npy to VDB: the first three rows of the matrix from indices to the world, twelve numbers, acting on columns
    #[arg(long, value_name = "A00,A01,..,A23", value_parser = rows, allow_hyphen_values = true)]
    pub transform: Option<DMat4>,
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

fn rows(text: &str) -> Result<DMat4, String> {
    let numbers = numbers(text)?;
    if numbers.len() != 12 {
        return Err(format!("{} numbers, twelve are needed: three rows of four", numbers.len()));
    }
    let row = |r: usize| DVec4::from_slice(&numbers[4 * r..4 * r + 4]);
    Ok(DMat4::from_cols(row(0), row(1), row(2), DVec4::W).transpose())
}

/// Report of a conversion from or to an array.
#[derive(Debug, Serialize)]
struct Report {
    #[serde(serialize_with = "crate::cli::paths::text")]
    input: PathBuf,
    #[serde(serialize_with = "crate::cli::paths::text")]
    output: PathBuf,
    bytes: u64,
    /// Lengths of the array's axes.
    shape: Vec<usize>,
    /// Names of the array's axes.
    axes: Vec<&'static str>,
    /// Grid that was read or written.
    #[serde(skip_serializing_if = "Option::is_none")]
    grid: Option<GridPlace>,
    /// Layer that was read, with its channels in the array's order.
    #[serde(skip_serializing_if = "Option::is_none")]
    layer: Option<LayerPlace>,
}

/// Where a grid's voxels lie.
#[derive(Debug, Serialize)]
struct GridPlace {
    name: String,
    class: &'static str,
    /// Index coordinates of the array's voxel [0, 0, 0].
    index_origin: [i32; 3],
    /// Matrix from the array's indices to the world, row by row, acting on columns; indices are those of centres.
    transform: [[f64; 4]; 4],
    /// Value outside.
    background: Vec<f64>,
    active_voxels: u64,
}

#[derive(Debug, Serialize)]
struct LayerPlace {
    name: String,
    channels: Vec<String>,
}

/// Matrix from the indices of an array, whose first voxel has index coordinates `origin`, to the world.
fn array_to_world(grid: &Affine, origin: [i32; 3]) -> [[f64; 4]; 4] {
    let matrix = grid.matrix() * DMat4::from_translation(DVec3::from_array(origin.map(f64::from)));
    std::array::from_fn(|r| matrix.row(r).to_array())
}

impl Convert {
    fn begin_array(&self, content: Content) -> Result<Limits> {
        outputs::file(&self.output, content)?;
        outputs::spare([self.output.as_path()], [self.input.as_path()])?;
        Ok(self.memory.limits())
    }

    fn report_array(
        &self,
        output: &Output,
        shape: Vec<usize>,
        axes: Vec<&'static str>,
        (grid, layer): (Option<GridPlace>, Option<LayerPlace>),
    ) -> Result<ExitCode> {
        let bytes = std::fs::metadata(&self.output).map_err(|e| Error::io(&self.output, e))?.len();
        let (input, to) = (self.input.clone(), self.output.clone());
        output.report(&Report { input, output: to, bytes, shape, axes, grid, layer })?;
        Ok(ExitCode::SUCCESS)
    }

    /// Writes a grid over the box of its active voxels.
    pub(super) fn grid_to_array(&self, output: &Output) -> Result<ExitCode> {
        let limits = self.begin_array(Content::Npy)?;
        let stage = output.stage("converting");
        let file = File::open(&self.input, limits)?;
        let name = self.one_grid(&file)?;
        let place = |e: Error| e.part(format!("grid '{name}'")).at(&self.input);
        let native = file.read(&name)?;
        let info = native.info().map_err(place)?;
        let transform = info.affine().map_err(|e| e.at(&self.input))?;
        let dense = dense::from_native(&native, limits).map_err(place)?;
        let mut shape = dense.size.to_vec();
        let mut axes = vec!["x", "y", "z"];
        if dense.components > 1 {
            shape.push(dense.components);
            axes.push("component");
        }
        npy::write(&self.output, &shape, &dense.values)?;
        let grid = GridPlace {
            name: info.name,
            class: info.class.name(),
            index_origin: dense.origin,
            transform: array_to_world(&transform, dense.origin),
            background: info.background,
            active_voxels: info.active_voxels,
        };
        drop(stage);
        self.report_array(output, shape, axes, (Some(grid), None))
    }

    /// Name of the grid that becomes an array: that of --grid, the only one, or the density.
    fn one_grid(&self, file: &File) -> Result<String> {
        let names: Vec<&str> = file.entries().iter().map(|e| e.name.as_str()).collect();
        match (&self.grid[..], &names[..]) {
            ([name], _) => file.find(name).map(|e| e.name.clone()),
            ([], [only]) => Ok((*only).to_owned()),
            ([], _) if names.contains(&"density") => Ok("density".into()),
            _ => Err(Error::invalid(format!("one grid makes an array; the file has {}", names.join(", ")))
                .at(&self.input)
                .hint("name one of them with --grid")),
        }
    }

    /// Writes an array of one or three components a voxel as a grid with background 0, whose zeros are inactive.
    pub(super) fn array_to_grid(&self, output: &Output) -> Result<ExitCode> {
        let limits = self.begin_array(Content::Vdb)?;
        let transform = self.transform_of_array()?;
        let name = match &self.grid[..] {
            [] => "density",
            [name] => name.as_str(),
            _ => {
                return Err(Error::invalid("an array makes one grid, and several are named")
                    .hint("give the name of the grid with one --grid"));
            }
        };
        let stage = output.stage("converting");
        let array = npy::read(&self.input, limits)?;
        let (size, components) = match array.shape[..] {
            [x, y, z] => ([x, y, z], 1),
            [x, y, z, 3] => ([x, y, z], 3),
            _ => {
                return Err(Error::invalid(format!("an array of shape {:?} is no volume", array.shape))
                    .at(&self.input)
                    .hint("[x, y, z] makes a grid of scalars, [x, y, z, 3] one of vectors"));
            }
        };
        let dense = dense::Dense { origin: [0; 3], size, components, values: array.values };
        let mut native = dense::to_native(&dense, name, &transform, limits).map_err(|e| e.at(&self.input))?;
        drop(dense);
        native.set_half(self.half)?;
        self.write_grid(&native)?;
        let info = native.info()?;
        let grid = GridPlace {
            name: info.name,
            class: info.class.name(),
            index_origin: [0; 3],
            transform: array_to_world(&transform, [0; 3]),
            background: info.background,
            active_voxels: info.active_voxels,
        };
        let axes = ["x", "y", "z", "component"][..array.shape.len()].to_vec();
        drop(stage);
        self.report_array(output, array.shape, axes, (Some(grid), None))
    }

    fn write_grid(&self, native: &NativeGrid) -> Result<()> {
        let codec: Codec = self.codec;
        write_native(&self.output, &[native], None, &BTreeMap::new(), codec)
    }

    fn transform_of_array(&self) -> Result<Affine> {
        match (self.arrays.transform, self.arrays.voxel_size) {
            (Some(matrix), _) => Affine::new(matrix),
            (None, Some(size)) => Affine::uniform(size, self.arrays.origin.unwrap_or(DVec3::ZERO)),
            (None, None) => Err(Error::invalid("an array does not say how large its voxels are")
                .at(&self.input)
                .hint("give --voxel-size, and --origin if voxel [0, 0, 0] is not at the world's origin")),
        }
    }

    /// Writes a layer of a picture.
    pub(super) fn layer_to_array(&self, output: &Output) -> Result<ExitCode> {
        let limits = self.begin_array(Content::Npy)?;
        let stage = output.stage("converting");
        let layer = exr::layer_within(&self.input, self.arrays.layer.as_deref(), limits)?;
        let shape = vec![layer.height, layer.width, layer.channels.len()];
        npy::write(&self.output, &shape, &layer.values)?;
        drop(stage);
        let place = LayerPlace { name: layer.name, channels: layer.channels };
        self.report_array(output, shape, vec!["row", "column", "channel"], (None, Some(place)))
    }

    /// Writes an array of one, three or four channels as a picture.
    pub(super) fn array_to_picture(&self, output: &Output) -> Result<ExitCode> {
        let limits = self.begin_array(Content::Exr)?;
        let stage = output.stage("converting");
        // The array, the film, and the picture as bytes before it is packed.
        let third = Limits { max_memory: limits.max_memory / 6 };
        let array = npy::read(&self.input, third)?;
        let film = film(&array, &self.input)?;
        exr::write_picture(&self.output, &film, &exr::Attributes::new(), self.half)?;
        drop(stage);
        let axes = ["row", "column", "channel"][..array.shape.len()].to_vec();
        self.report_array(output, array.shape, axes, (None, None))
    }
}

/// Film of an array: [row, column] or [row, column, channel] of grey, RGB or RGBA; alpha is 1 where there is none.
fn film(array: &npy::Array, path: &Path) -> Result<Film> {
    let (height, width, channels) = match array.shape[..] {
        [height, width] if height * width > 0 => (height, width, 1),
        [height, width, channels @ (1 | 3 | 4)] if height * width > 0 => (height, width, channels),
        _ => {
            return Err(Error::invalid(format!("an array of shape {:?} is no picture", array.shape)).at(path).hint(
                "[row, column] and [row, column, channel] with 1, 3 or 4 channels (grey, RGB, RGBA) are pictures",
            ));
        }
    };
    let pixel = |p: &[f32]| match *p {
        [r, g, b, a] => [r, g, b, a],
        [r, g, b] => [r, g, b, 1.0],
        _ => [p[0], p[0], p[0], 1.0],
    };
    Ok(Film::of(width, height, array.values.chunks_exact(channels).map(pixel).collect()))
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let axes: Vec<String> = self.axes.iter().zip(&self.shape).map(|(axis, n)| format!("{axis} {n}")).collect();
        writeln!(f, "{}: {}, {}", self.output.display(), axes.join(" x "), human(self.bytes))?;
        if let Some(grid) = &self.grid {
            writeln!(f, "  grid '{}', {}, {} active voxels", grid.name, grid.class, grid.active_voxels)?;
            let rows: Vec<String> = grid.transform[..3].iter().flatten().map(|v| format!("{v}")).collect();
            writeln!(f, "  --transform={}", rows.join(","))?;
        }
        if let Some(layer) = &self.layer {
            writeln!(f, "  layer '{}', channels {}", layer.name, layer.channels.join(", "))?;
        }
        Ok(())
    }
}
