//! Images as grids of OpenVDB, slice by slice, and the steps of their values on grids that exist.

use super::image::{Header, Image, Values};
use super::values::{Mapping, Tally};
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::vdb::{DenseBox, NativeGrid, ValueKind};
use crate::scene::grid::{GridClass, LEAF_DIM, LEAF_VOXELS};

/// Bytes for the program itself: libraries, the heap, and the stacks of the threads that OpenVDB starts when a grid is
/// freed.
const PROGRAM: u64 = 48 << 20;

/// Type of the grid that an image becomes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GridType {
    /// 32-bit integers for images of integers that stay so, else 32-bit floats.
    #[default]
    Auto,
    /// 32-bit floats.
    Float,
    /// 64-bit floats.
    Double,
    /// 32-bit integers.
    Int,
}

/// Settings by which an image becomes a grid.
#[derive(Debug, Clone, Copy)]
pub struct Settings<'s> {
    /// Name of the grid.
    pub name: &'s str,
    /// Type of the grid.
    pub grid_type: GridType,
    /// Steps of the values.
    pub mapping: Mapping,
    /// Limits of the memory of the grid and one slice.
    pub limits: Limits,
}

impl Settings<'_> {
    /// Type of the values of the grid that an image becomes.
    ///
    /// # Errors
    /// If vectors are to become numbers of another type than they have.
    pub(crate) fn kind(&self, header: &Header) -> Result<ValueKind> {
        let vectors = header.components == 3;
        match self.grid_type {
            GridType::Double | GridType::Int if vectors => {
                Err(Error::unsupported("the voxels are vectors, which become 32-bit floats")
                    .hint("leave ⟨as⟩ out, or give ⟨as=float⟩"))
            }
            _ if vectors => Ok(ValueKind::Vec3),
            GridType::Auto if header.values == Values::Integer && self.mapping.keeps_integers() => Ok(ValueKind::Int32),
            GridType::Auto | GridType::Float => Ok(ValueKind::Float),
            GridType::Double => Ok(ValueKind::Double),
            GridType::Int => Ok(ValueKind::Int32),
        }
    }

    /// Largest number of leaves beside a slice of `slice` values and `held` bytes of the reader. A quarter of the
    /// memory is left for packing when the grid is written.
    fn most_leaves(&self, kind: ValueKind, slice: usize, held: u64) -> u64 {
        let grid = self.limits.max_memory.saturating_sub(PROGRAM).saturating_sub(held) / 4 * 3;
        grid.saturating_sub(8 * slice as u64) / kind.leaf_bytes()
    }
}

/// Builds a grid from an image. Its background is 0; voxels of other values are active. Slices are held one at a time,
/// so that the memory is that of what is active. Floats of which none is negative are a fog volume. `progress` is told
/// the number of slices that are done and of all. What the slices have shown joins the notes of the image.
///
/// # Errors
/// If the image cannot be read to its end, vectors are to be mapped, a value does not fit the grid's type, or the grid
/// does not fit into the limits.
pub fn build(
    image: &mut Image,
    settings: &Settings<'_>,
    mut progress: impl FnMut(usize, usize),
) -> Result<(NativeGrid, Tally)> {
    let (header, Settings { mapping, limits, .. }) = (&image.header, settings);
    let [x, y, z] = header.size;
    let components = header.components;
    let kind = settings.kind(header)?;
    if components == 3 && !mapping.is_identity() {
        return Err(Error::invalid(
            "the voxels are vectors, and ⟨scale⟩, ⟨offset⟩, ⟨map⟩ and ⟨threshold⟩ are of scalars",
        )
        .hint("leave these options out"));
    }
    let mut native = NativeGrid::empty(kind, settings.name, GridClass::Unknown, &header.index_to_world)?;
    let mut values = vec![0.0; header.slice_len().unwrap_or(0)];
    let most = settings.most_leaves(kind, values.len(), image.slices.working_bytes());
    let strides = [components, components * x, components * x * y].map(|s| s as i64);
    let (mut leaves, mut tally) = (0, Tally::default());
    for slice in 0..z {
        image.slices.next_slice(&mut values)?;
        mapping.apply(&mut values, &mut tally);
        check(kind, &values, &mut tally)?;
        let low = [0, 0, slice as i32];
        let high = [x as i32 - 1, y as i32 - 1, slice as i32];
        leaves += native.write_box(&DenseBox { low, high, strides }, &values, most - leaves)?;
        if leaves > most {
            return Err(limits
                .exceeded(leaves.saturating_mul(kind.leaf_bytes()), most)
                .coded(Code::MemoryLimit)
                .instead("raise ⟨max_memory⟩, or make more of it background with ⟨threshold⟩ or ⟨map⟩"));
        }
        progress(slice + 1, z);
    }
    image.header.notes.extend(image.slices.notes());
    let density = kind != ValueKind::Int32 && components == 1 && tally.least.is_some_and(|least| least >= 0.0);
    if density {
        native.set_class(GridClass::FogVolume)?;
    }
    Ok((native, tally))
}

/// Refuses values that a grid of integers cannot hold, and counts those that a grid of 32-bit floats cannot.
fn check(kind: ValueKind, values: &[f64], tally: &mut Tally) -> Result<()> {
    match kind {
        ValueKind::Int32 => fits(values),
        ValueKind::Float | ValueKind::Vec3 => {
            tally.count_singles(values);
            Ok(())
        }
        ValueKind::Double => Ok(()),
    }
}

/// Refuses values that are no 32-bit integers.
fn fits(values: &[f64]) -> Result<()> {
    let (low, high) = (f64::from(i32::MIN), f64::from(i32::MAX));
    match values.iter().find(|v| v.fract() != 0.0 || !(low..=high).contains(*v)) {
        None => Ok(()),
        Some(value) => Err(Error::unsupported(format!("the value {value} is no 32-bit integer"))
            .hint("give ⟨as=float⟩ or ⟨as=double⟩")),
    }
}

/// Takes a grid of scalars through a mapping. Voxels that become 0 are inactive; what is inactive becomes 0. Integers
/// become floats unless they stay integers.
///
/// # Errors
/// If the grid holds vectors or points, or does not fit into the limits together with its copy.
pub fn mapped(grid: &NativeGrid, to: GridType, mapping: &Mapping, limits: Limits) -> Result<(NativeGrid, Tally)> {
    let info = grid.info()?;
    if info.components != 1 {
        return Err(Error::unsupported(format!(
            "the grid holds {} values, and the mapping is of scalars",
            info.value_type
        ))
        .hint("name grids of scalars with ⟨grid⟩; cumulo info lists them"));
    }
    let integers = matches!(info.value_type.as_str(), "int32" | "bool") && mapping.keeps_integers();
    let kind = match to {
        GridType::Int => ValueKind::Int32,
        GridType::Auto if integers => ValueKind::Int32,
        GridType::Auto if info.value_type == "double" => ValueKind::Double,
        GridType::Double => ValueKind::Double,
        GridType::Auto | GridType::Float => ValueKind::Float,
    };
    let needed = info.memory.saturating_add(info.leaf_count.saturating_mul(kind.leaf_bytes()));
    if needed > limits.max_memory {
        return Err(limits.exceeded(needed, info.leaf_count));
    }
    let mut native = NativeGrid::empty(kind, grid.name(), GridClass::Unknown, &info.affine()?)?;
    let mut tally = Tally::default();
    for tile in grid.tiles()?.into_iter().filter(|t| t.active) {
        let low = tile.origin;
        let mut value = [0.0];
        grid.read_box(&DenseBox { low, high: low, strides: [1; 3] }, &mut value)?;
        mapping.apply(&mut value, &mut tally);
        check(kind, &value, &mut tally)?;
        if value != [0.0] {
            native.add_tile(low, tile.dim, value[0])?;
        }
    }
    leaves(grid, &mut native, kind, mapping, &mut tally)?;
    for (name, value) in grid.metadata()?.iter().filter(|(name, _)| !OWN.contains(&name.as_str())) {
        native.set_metadata(name, value)?;
    }
    native.set_half(info.half && kind == ValueKind::Float)?;
    native.set_class(match info.class {
        GridClass::FogVolume if tally.least.is_some_and(|l| l < 0.0) => GridClass::Unknown,
        _ if kind == ValueKind::Int32 => GridClass::Unknown,
        _ if tally.least.is_some_and(|l| l >= 0.0) => GridClass::FogVolume,
        _ => GridClass::Unknown,
    })?;
    Ok((native, tally))
}

/// Metadata that OpenVDB keeps itself, and that speak of the grid as it was.
pub(crate) const OWN: [&str; 9] = [
    "class",
    "name",
    "file_bbox_min",
    "file_bbox_max",
    "file_compression",
    "file_mem_bytes",
    "file_voxel_count",
    "is_saved_as_half_float",
    "file_delayed_load",
];

/// Maps a grid's leaves.
fn leaves(from: &NativeGrid, to: &mut NativeGrid, kind: ValueKind, mapping: &Mapping, tally: &mut Tally) -> Result<()> {
    let mut values = vec![0.0; LEAF_VOXELS];
    let mut step = |origin: [i32; 3], active: &[u64; 8]| -> Result<()> {
        let place = DenseBox { low: origin, high: origin.map(|c| c + (LEAF_DIM - 1)), strides: [64, 8, 1] };
        from.read_box(&place, &mut values)?;
        for (i, value) in values.iter_mut().enumerate() {
            if active[i >> 6] >> (i & 63) & 1 == 1 {
                mapping.apply(std::slice::from_mut(value), tally);
            } else {
                *value = 0.0;
            }
        }
        check(kind, &values, tally)?;
        to.write_box(&place, &values, u64::MAX).map(drop)
    };
    let mut result = Ok(());
    from.for_each_leaf(|leaf| {
        result = step(leaf.origin, &leaf.active);
        result.is_ok()
    })?;
    result
}
