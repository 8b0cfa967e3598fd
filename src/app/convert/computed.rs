//! Grids that are computed voxel by voxel of others.

use super::expression::Expression;
use crate::error::{Error, Result};
use crate::formats::imaging::volume::OWN;
use crate::formats::vdb::{DenseBox, File, GridInfo, NativeGrid};
use crate::math::Affine;
use crate::scene::grid::{Grid, GridClass, LEAF_DIM, LEAF_VOXELS, Leaf};
use crate::text::serde_as_text;
use glam::{DVec3, IVec3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

/// A grid that an expression makes of the values of others.
#[derive(Debug, Clone, PartialEq)]
pub struct Computed {
    /// Name of the grid.
    pub name: String,
    /// Value of a voxel by those that other grids have there, and by its position in world space: `x`, `y` and `z`,
    /// unless grids have these names.
    pub expression: Expression,
}

impl fmt::Display for Computed {
    /// Writes the text that [`FromStr`] reads.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.name, self.expression)
    }
}

serde_as_text!(Computed);

impl FromStr for Computed {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let fault = || format!("'{text}' is not NAME=EXPRESSION, such as density=max(density-0.1,0)");
        let (name, expression) = text.split_once('=').ok_or_else(fault)?;
        let name = name.trim().to_owned();
        if name.is_empty() {
            return Err(fault());
        }
        Ok(Self { name, expression: expression.trim().parse()? })
    }
}

/// Where a value of an expression comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Value {
    /// A component of a grid, by the grid's place among those that are read.
    Grid(usize, usize),
    /// A coordinate of the position in world space.
    Position(usize),
}

/// Names of the coordinates of a position, and of the components of vectors.
const AXES: [&str; 3] = ["x", "y", "z"];

impl Computed {
    /// Returns the unique names of the file's grids of which the grid is made.
    ///
    /// # Errors
    /// If a name is that of no grid, or none of a grid is in the expression.
    pub(super) fn parts(&self, file: &File) -> Result<Vec<String>> {
        self.values(file).map(|(parts, _)| parts)
    }

    /// Returns an error that names the option.
    fn named(&self, error: Error) -> Error {
        let what = format!("⟨eval={self}⟩: {}", error.what());
        error.saying(what)
    }

    fn values(&self, file: &File) -> Result<(Vec<String>, Vec<Value>)> {
        let (mut parts, mut values) = (Vec::new(), Vec::new());
        for name in self.expression.names() {
            let axis = |text: &str| AXES.iter().position(|axis| *axis == text);
            let found = file.find(name);
            let component = name.rsplit_once('.').and_then(|(grid, c)| Some((file.find(grid).ok()?, axis(c)?)));
            let (entry, component) = match (found, component, axis(name)) {
                (Ok(entry), ..) => (entry, 0),
                (_, Some(component), _) => component,
                (_, _, Some(axis)) => {
                    values.push(Value::Position(axis));
                    continue;
                }
                (Err(error), ..) => return Err(self.named(error)),
            };
            let place = parts.iter().position(|part| *part == entry.name).unwrap_or(parts.len());
            if place == parts.len() {
                parts.push(entry.name.clone());
            }
            values.push(Value::Grid(place, component));
        }
        if parts.is_empty() {
            return Err(Error::invalid(format!("⟨eval={self}⟩ names no grid, which says where there are voxels"))
                .at(file.path())
                .hint("name one, as in density=density*0+1"));
        }
        Ok((parts, values))
    }

    /// Computes the grid: its voxels are those of all grids that the expression names, and its metadata those of the
    /// grid of its name, if that is among them. `room` refuses bytes that are not to be had beside those grids.
    ///
    /// # Errors
    /// If the grids lie on different lattices, hold points, or vectors whose component is not named; if a value is not
    /// finite; or if the value outside depends on the place.
    pub(super) fn read(&self, file: &File, room: &dyn Fn(u64) -> Result<()>) -> Result<NativeGrid> {
        let (names, values) = self.values(file)?;
        let mut grids = names.iter().map(|name| file.read(name)).collect::<Result<Vec<_>>>()?;
        grids.iter_mut().try_for_each(|grid| grid.mend_metadata().map(drop))?;
        let infos = grids.iter().map(NativeGrid::info).collect::<Result<Vec<_>>>()?;
        let lattice = self.check(&infos, &values)?;
        let leaves = voxels(&grids, room)?;
        room(leaves.len() as u64 * LEAF_BYTES)?;
        let source = Source { infos: &infos, values: &values, expression: &self.expression, lattice };
        let outside = source.outside().map_err(|e| self.named(e))?;
        let leaves = source.leaves(&grids, leaves, outside).map_err(|e| self.named(e))?;
        let active = || leaves.iter().flat_map(|leaf| leaf.values.iter().enumerate().filter(|(i, _)| is_on(leaf, *i)));
        let is_fog = outside == 0.0 && active().all(|(_, v)| *v >= 0.0);
        let class = if is_fog { GridClass::FogVolume } else { GridClass::Unknown };
        let own = file.find(&self.name).ok().and_then(|entry| names.iter().position(|name| *name == entry.name));
        let mut metadata = own.map_or_else(|| Ok(BTreeMap::new()), |place| grids[place].metadata())?;
        metadata.retain(|name, _| !OWN.contains(&name.as_str()));
        let (name, tiles) = (self.name.clone(), Vec::new());
        let grid = Grid { name, class, transform: lattice, background: outside as f32, leaves, tiles, metadata };
        let mut native = NativeGrid::from_grid(&grid)?;
        native.prune(0.0)?;
        Ok(native)
    }

    /// Returns the lattice that all grids share.
    fn check(&self, infos: &[GridInfo], values: &[Value]) -> Result<Affine> {
        let lattice = infos[0].affine()?;
        for info in infos {
            if !lattice.is_close(&info.affine()?) {
                return Err(Error::unsupported(format!(
                    "⟨eval={self}⟩: grids '{}' and '{}' lie on different lattices",
                    infos[0].name, info.name
                ))
                .hint("resample both to one lattice first: ⟨convert.resample⟩"));
            }
        }
        for (value, name) in values.iter().zip(self.expression.names()) {
            let Value::Grid(place, _) = value else { continue };
            let info = &infos[*place];
            let of_vectors = info.components == 3;
            let component = name.rsplit_once('.').filter(|(_, c)| *name != info.name && AXES.contains(c));
            if info.components == 0 || of_vectors && component.is_none() {
                return Err(Error::unsupported(format!("grid '{}' holds {} values", info.name, info.value_type))
                    .hint("name scalars, or a component of vectors such as velocity.x"));
            }
            if let (false, Some((_, axis))) = (of_vectors, component) {
                return Err(Error::invalid(format!(
                    "grid '{}' holds scalars, which have no component '{axis}'",
                    info.name
                ))
                .hint("name the grid alone"));
            }
        }
        Ok(lattice)
    }
}

fn is_on(leaf: &Leaf, voxel: usize) -> bool {
    leaf.active[voxel >> 6] >> (voxel & 63) & 1 == 1
}

/// Returns the blocks of 8³ voxels in which one of the grids has leaves or tiles, with what is active in any.
fn voxels(grids: &[NativeGrid], room: &dyn Fn(u64) -> Result<()>) -> Result<Vec<([i32; 3], [u64; 8])>> {
    let mut blocks = BTreeMap::<[i32; 3], [u64; 8]>::new();
    let mut join = |origin: [i32; 3], active: &[u64; 8]| {
        blocks.entry(origin).or_default().iter_mut().zip(active).for_each(|(all, own)| *all |= own);
    };
    let mut of_tiles = 0_u64;
    for grid in grids {
        grid.for_each_leaf(|leaf| {
            join(leaf.origin, &leaf.active);
            true
        })?;
        for tile in grid.tiles()? {
            let along = (tile.dim / LEAF_DIM).max(1);
            of_tiles += (along as u64).pow(3);
            room(of_tiles * LEAF_BYTES)?;
            for i in 0..along.pow(3) {
                let at = [i / along / along, i / along % along, i % along];
                let origin = std::array::from_fn(|a| tile.origin[a] + LEAF_DIM * at[a]);
                join(origin, &if tile.active { [u64::MAX; 8] } else { [0; 8] });
            }
        }
    }
    Ok(blocks.into_iter().collect())
}

/// Bytes of a leaf of the grid, once as it is computed and once as OpenVDB has it.
const LEAF_BYTES: u64 = 2 * size_of::<Leaf>() as u64;

/// Leaves that are read before their voxels are computed by all threads.
const BATCH: usize = 512;

/// Values of which a grid is computed.
struct Source<'s> {
    infos: &'s [GridInfo],
    values: &'s [Value],
    expression: &'s Expression,
    lattice: Affine,
}

impl Source<'_> {
    /// Returns the value where no grid has voxels.
    fn outside(&self) -> Result<f64> {
        let boxes = self.infos.iter().filter_map(|info| info.index_box);
        let whole = boxes.map(|(low, high)| [low, high].map(|corner| IVec3::from_array(corner).as_dvec3()));
        let [low, high] = whole.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]).unwrap_or([DVec3::ZERO, DVec3::ONE]);
        // Places in and about the box, of which none lies in a plane with another.
        let at = |i: i32| {
            let share = DVec3::new(0.618_034, 0.754_878, 0.819_173) * f64::from(i);
            self.lattice.to_world(low + (high - low) * (2.0 * (share - share.floor()) - 0.5))
        };
        let value = |position: DVec3| {
            let of = |value: &Value| match value {
                Value::Grid(place, component) => {
                    self.infos[*place].background.get(*component).copied().unwrap_or_default()
                }
                Value::Position(axis) => position[*axis],
            };
            self.expression.value(&self.values.iter().map(of).collect::<Vec<_>>())
        };
        let first = value(at(0));
        if !first.is_finite() {
            return Err(Error::invalid(format!("the value outside of all voxels is {first}"))
                .hint("give one that is finite where grids have their background, as in ln(max(density, 1e-6))"));
        }
        if let Some(other) = (1..64).map(|i| value(at(i))).find(|v| *v != first) {
            return Err(Error::invalid(format!(
                "the value outside of all voxels depends on the place: {first} and {other} are two of them"
            ))
            .hint("multiply by a grid that is 0 outside, as in density * z"));
        }
        // Of -0 as well.
        Ok(first + 0.0)
    }

    /// Computes the leaves of blocks of voxels.
    fn leaves(&self, grids: &[NativeGrid], blocks: Vec<([i32; 3], [u64; 8])>, outside: f64) -> Result<Vec<Leaf>> {
        let mut leaves = Vec::with_capacity(blocks.len());
        for batch in blocks.chunks(BATCH) {
            let read = batch.iter().map(|(origin, _)| self.read(grids, *origin)).collect::<Result<Vec<_>>>()?;
            let computed = batch.par_iter().zip(read).map(|((origin, active), values)| {
                let mut leaf = Leaf { origin: *origin, values: [0.0; LEAF_VOXELS], active: *active };
                let mut of = vec![0.0; self.values.len()];
                for voxel in 0..LEAF_VOXELS {
                    let index = IVec3::new((voxel >> 6) as i32, (voxel >> 3 & 7) as i32, (voxel & 7) as i32);
                    let index = IVec3::from_array(*origin) + index;
                    let position = self.lattice.to_world(index.as_dvec3());
                    for (to, value) in of.iter_mut().zip(self.values) {
                        *to = match value {
                            Value::Grid(place, component) => {
                                values[*place][voxel * self.infos[*place].components + component]
                            }
                            Value::Position(axis) => position[*axis],
                        };
                    }
                    // Grids that are computed hold 32-bit floats.
                    let value = self.expression.value(&of) as f32;
                    if !value.is_finite() && is_on(&leaf, voxel) {
                        return Err((index, value, of));
                    }
                    leaf.values[voxel] = if value.is_finite() { value } else { outside as f32 };
                }
                Ok(leaf)
            });
            for leaf in computed.collect::<Vec<_>>() {
                leaves.push(leaf.map_err(|(index, value, of)| self.not_finite(index, value, &of))?);
            }
        }
        Ok(leaves)
    }

    /// Reads the values of a block of all grids.
    fn read(&self, grids: &[NativeGrid], origin: [i32; 3]) -> Result<Vec<Vec<f64>>> {
        let of = |(grid, info): (&NativeGrid, &GridInfo)| {
            let each = info.components as i64;
            let high = origin.map(|c| c + LEAF_DIM - 1);
            let place = DenseBox { low: origin, high, strides: [64 * each, 8 * each, each] };
            let mut values = vec![0.0; LEAF_VOXELS * info.components];
            grid.read_box(&place, &mut values).map(|()| values)
        };
        grids.iter().zip(self.infos).map(of).collect()
    }

    fn not_finite(&self, index: IVec3, value: f32, of: &[f64]) -> Error {
        let stated: Vec<String> =
            self.expression.names().iter().zip(of).map(|(name, v)| format!("{name} = {v}")).collect();
        Error::invalid(format!("voxel {index} becomes {value} as a 32-bit float, where {}", stated.join(", ")))
            .hint("give an expression that is finite there, as in ln(max(density, 1e-6))")
    }
}
