//! Places of the values that an array has.

use crate::app::scan::ScanSettings;
use crate::app::volume;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::math::Affine;
use crate::scene::active::Active;
use crate::scene::bricks::{Bricks, Voxel, too_large};
use crate::scene::dense::{Dense, End};
use crate::scene::grid::Grid;
use crate::scene::transfer::Transfer;
use glam::{DVec4, Vec4};
use rayon::prelude::*;
use std::any::Any;
use std::path::Path;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Places of the values of an array: all voxels of a box, or the active voxels of a grid.
#[derive(Debug)]
pub struct Lattice {
    places: Places,
    limits: Limits,
    /// Memory of earlier fields and gradients: fresh memory costs as much as the rays through it.
    spare: Mutex<Vec<Buffer>>,
}

/// Memory that is kept for the next use of its kind.
#[derive(Debug)]
struct Buffer {
    bytes: u64,
    memory: Box<dyn Any + Send>,
}

/// Most bytes of memory that a lattice keeps.
const MOST_KEPT: u64 = 256 << 20;

#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "a lattice has one")]
enum Places {
    /// Box of voxels: its shape, and its bricks without and with a transfer function.
    Box { shape: [usize; 3], transform: Affine, bricks: [OnceLock<Arc<Dense>>; 2] },
    /// Grid, and its active voxels without a transfer function, with one, and with one that shows the background.
    Active { grid: Box<Grid>, voxels: [OnceLock<Arc<Active>>; 3] },
}

/// Arranged places of an array's values.
#[derive(Debug)]
pub(super) enum Arranged {
    Box(Arc<Dense>),
    Active(Arc<Active>),
}

/// A value of an array, with the voxel that kernels have of it.
pub trait Value: Copy + Send + Sync + 'static {
    /// The voxel.
    type Voxel: Voxel + PartialEq + 'static;
    /// Converts to a voxel.
    fn voxel(self) -> Self::Voxel;
    /// Converts from a voxel.
    fn of(voxel: Self::Voxel) -> Self;
    /// Converts from voxels.
    fn all_of(voxels: Vec<Self::Voxel>) -> Vec<Self>;
    /// Says what is wrong with a value that cannot be used, with a transfer function or without.
    fn fault(self, through_function: bool) -> Option<&'static str>;
    /// Returns the field of active voxels; none for values that only boxes have.
    fn sparse(active: &Active, values: &[Self]) -> Option<Bricks<Self::Voxel>>;
    /// Adds derivatives onto active voxels.
    fn gather(active: &Active, stored: &[Self::Voxel]) -> Vec<Self>;
}

/// Fault of a number that is infinite or none.
const NOT_FINITE: &str = "is not finite";
/// Fault of an extinction.
const NEGATIVE: &str = "is negative, and extinction cannot be";

macro_rules! values {
    ($($real:ty, $four:ty);*) => {
        $(impl Value for $real {
            type Voxel = $real;
            #[inline(always)]
            fn voxel(self) -> $real {
                self
            }
            fn of(voxel: $real) -> Self {
                voxel
            }
            fn all_of(voxels: Vec<$real>) -> Vec<Self> {
                voxels
            }
            #[inline(always)]
            fn fault(self, through_function: bool) -> Option<&'static str> {
                match self {
                    v if !v.is_finite() => Some(NOT_FINITE),
                    v if v < 0.0 && !through_function => Some(NEGATIVE),
                    _ => None,
                }
            }
            fn sparse(active: &Active, values: &[Self]) -> Option<Bricks<$real>> {
                Some(active.field(values))
            }
            fn gather(active: &Active, stored: &[$real]) -> Vec<Self> {
                active.gather(stored)
            }
        }

        impl Value for [$real; 4] {
            type Voxel = $four;
            #[inline(always)]
            fn voxel(self) -> $four {
                <$four>::from_array(self)
            }
            fn of(voxel: $four) -> Self {
                voxel.to_array()
            }
            fn all_of(voxels: Vec<$four>) -> Vec<Self> {
                voxels.into_iter().map(Self::of).collect()
            }
            #[inline(always)]
            fn fault(self, _: bool) -> Option<&'static str> {
                match self {
                    v if v.iter().any(|v| !v.is_finite()) => Some(NOT_FINITE),
                    v if v[3] < 0.0 => Some(NEGATIVE),
                    _ => None,
                }
            }
            fn sparse(_: &Active, _: &[Self]) -> Option<Bricks<$four>> {
                None
            }
            fn gather(_: &Active, _: &[$four]) -> Vec<Self> {
                Vec::new()
            }
        })*
    };
}
values!(f32, Vec4; f64, DVec4);

impl Lattice {
    /// Creates the places of an array of shape [nx, ny, nz], whose entry [i, j, k] is the value at the centre of the
    /// voxel with index coordinates (i, j, k); `transform` maps these to the world.
    ///
    /// # Errors
    /// If an axis is empty, or there are more voxels than can be addressed.
    pub fn of_box(shape: [usize; 3], transform: Affine, limits: Limits) -> Result<Self> {
        let places = Places::Box { shape, transform, bricks: [const { OnceLock::new() }; 2] };
        let lattice = Self { places, limits, spare: Mutex::default() };
        lattice.arranged(None)?;
        Ok(lattice)
    }

    /// Reads a grid: an array has a value for each of its active voxels, sorted by blocks of 8³ voxels, x slowest, and
    /// within them so.
    ///
    /// # Errors
    /// If the file cannot be read as a density.
    pub fn of_grid(path: &Path, name: Option<&str>, limits: Limits) -> Result<Self> {
        let grid = Box::new(volume::open(path, &ScanSettings::default(), limits)?.read_fog(name)?);
        let places = Places::Active { grid, voxels: [const { OnceLock::new() }; 3] };
        Ok(Self { places, limits, spare: Mutex::default() })
    }

    /// Returns the shape of its arrays, without the channels of a voxel.
    ///
    /// # Errors
    /// If the grid cannot be arranged.
    pub fn shape(&self) -> Result<Vec<usize>> {
        Ok(match &self.places {
            Places::Box { shape, .. } => shape.to_vec(),
            Places::Active { .. } => vec![self.active()?.len()],
        })
    }

    /// Returns the map from index coordinates to the world.
    pub fn transform(&self) -> Affine {
        match &self.places {
            Places::Box { transform, .. } => *transform,
            Places::Active { grid, .. } => grid.transform,
        }
    }

    /// Returns the active voxels of a grid.
    ///
    /// # Errors
    /// If these are the places of a box, or the grid cannot be arranged.
    pub fn active(&self) -> Result<Arc<Active>> {
        let Places::Active { voxels, .. } = &self.places else {
            return Err(Error::invalid("all voxels of a box have values").hint("its array has the shape of the box"));
        };
        // However they are arranged, the voxels and their order are the same.
        if let Some(active) = voxels.iter().find_map(OnceLock::get) {
            return Ok(Arc::clone(active));
        }
        // Any values may become densities later, so that the grid's own need not be some.
        let any = Transfer::Identity { domain: [0.0, 1.0], color: [0.0; 3] };
        match self.arranged(None).or_else(|_| self.arranged(Some(&any)))? {
            Arranged::Active(active) => Ok(active),
            Arranged::Box(_) => Err(Error::invalid("a grid is no box")),
        }
    }

    /// Arranges the places in bricks for a transfer function, if there is one.
    pub(super) fn arranged(&self, transfer: Option<&Transfer>) -> Result<Arranged> {
        let end = if transfer.is_some() { End::Cut } else { End::Fading };
        Ok(match &self.places {
            Places::Box { shape, transform, bricks } => {
                let kept = &bricks[usize::from(transfer.is_some())];
                let dense = match kept.get() {
                    Some(dense) => Arc::clone(dense),
                    None => {
                        let dense = Arc::new(Dense::new(*shape, *transform, end)?);
                        Arc::clone(kept.get_or_init(|| dense))
                    }
                };
                Arranged::Box(dense)
            }
            Places::Active { grid, voxels } => {
                let shown = |transfer: &Transfer| Ok(transfer.table()?.at(f64::from(grid.background))[3] > 0.0);
                let number = transfer.map(shown).transpose()?.map_or(0, |shown: bool| 1 + usize::from(shown));
                let kept = &voxels[number];
                let active = match kept.get() {
                    Some(active) => Arc::clone(active),
                    None => {
                        let base = volume::arrange_by_voxel(grid, transfer, self.limits)?;
                        let active = Arc::new(Active::new(grid, &base, end)?);
                        Arc::clone(kept.get_or_init(|| active))
                    }
                };
                Arranged::Active(active)
            }
        })
    }

    /// Takes memory of a kind that was kept, or makes some.
    pub(super) fn take<M: Any + Send + Default>(&self) -> M {
        let mut spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(at) = spare.iter().position(|spare| spare.memory.is::<M>()) else { return M::default() };
        spare.swap_remove(at).memory.downcast().map_or_else(|_| M::default(), |memory| *memory)
    }

    /// Keeps memory of so many bytes for the next use, unless that would be too much.
    pub(super) fn keep<M: Any + Send>(&self, memory: M, bytes: u64) {
        let mut spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner);
        if spare.iter().map(|spare| spare.bytes).sum::<u64>() + bytes <= MOST_KEPT {
            spare.push(Buffer { bytes, memory: Box::new(memory) });
        }
    }

    /// Refuses more memory than is allowed for fields, `copies` of them.
    pub(super) fn within<T: Value>(&self, arranged: &Arranged, copies: u64) -> Result<()> {
        let each = match arranged {
            Arranged::Box(dense) => dense.bytes::<T::Voxel>(),
            Arranged::Active(active) => active.bytes::<T::Voxel>(),
        };
        let bytes = each.saturating_mul(copies);
        if bytes > self.limits.max_memory { Err(too_large(bytes, self.limits.max_memory)) } else { Ok(()) }
    }
}

impl Arranged {
    /// Returns the field of these values; that of a box may take the memory of another one of them.
    ///
    /// # Errors
    /// If there are not as many values as places, or only boxes have such values.
    pub(super) fn field<T: Value>(&self, values: &[T], memory: Vec<T::Voxel>) -> Result<Bricks<T::Voxel>> {
        let wrong = |count: usize| {
            Error::invalid(format!("{} values for {count} voxels", values.len())).hint("give the array of this lattice")
        };
        match self {
            Self::Box(dense) => {
                let count: usize = dense.shape().iter().product();
                if values.len() == count { Ok(dense.field(values, T::voxel, memory)) } else { Err(wrong(count)) }
            }
            Self::Active(active) if values.len() != active.len() => Err(wrong(active.len())),
            Self::Active(active) => T::sparse(active, values).ok_or_else(|| {
                Error::unsupported("the active voxels of a grid hold one value each, these are four")
                    .hint("give a pre-shaded volume as a box, of shape [nx, ny, nz, 4]")
            }),
        }
    }

    /// Adds derivatives with respect to stored values onto the array's.
    pub(super) fn gather<T: Value>(&self, stored: &[T::Voxel]) -> Vec<T> {
        match self {
            Self::Box(dense) => T::all_of(dense.gather(stored)),
            Self::Active(active) => T::gather(active, stored),
        }
    }
}

/// Values that are looked at in one go.
const RUN: usize = 1 << 14;

/// Refuses values that cannot be used.
pub(super) fn checked<T: Value>(values: &[T], through_function: bool) -> Result<()> {
    // Without branches, so that the whole run is looked at in a few instructions a value.
    let faulty = |run: &[T]| run.iter().fold(false, |any, v| any | v.fault(through_function).is_some());
    let Some(run) = values.par_chunks(RUN).position_first(faulty) else { return Ok(()) };
    let from = run * RUN;
    let fault = |at: usize| values[at].fault(through_function).map(|fault| (at, fault));
    let Some((at, fault)) = (from..values.len().min(from + RUN)).find_map(fault) else { return Ok(()) };
    let error = Error::invalid(format!("the value at place {at} of {} {fault}", values.len()));
    Err(error
        .hint("give finite values, and densities that are not negative (a softplus, or a clamp at 0, keeps them so)"))
}
