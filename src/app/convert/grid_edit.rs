//! A grid of a VDB in the course of its edits.

use super::Repair;
use super::converted::ConvertedGrid;
use super::half;
use super::images::losses;
use crate::error::{Code, Error, Result};
use crate::formats::imaging::values::Mapping;
use crate::formats::imaging::volume::{self, GridType};
use crate::formats::limits::Limits;
use crate::formats::transfer::{Function, METADATA_KEY, to_metadata};
use crate::formats::vdb::{GridInfo, NativeGrid, ResampleFilter};
use crate::math::Aabb;
use crate::scene::grid::GridClass;
use crate::text::bytes as human;

/// A grid in the course of its edits, with the entry that the report will have for it.
pub(super) struct GridEdit<'e> {
    pub native: &'e mut NativeGrid,
    /// Facts about the grid as the last edit of its voxels left it.
    pub info: GridInfo,
    pub converted: ConvertedGrid,
    pub budget: &'e mut Budget,
    pub warnings: &'e mut Vec<String>,
}

impl<'e> GridEdit<'e> {
    /// Leaves damaged metadata out, before anything else of the grid is looked at.
    pub(crate) fn begin(
        native: &'e mut NativeGrid,
        budget: &'e mut Budget,
        warnings: &'e mut Vec<String>,
    ) -> Result<Self> {
        let converted = ConvertedGrid { from: native.name().to_owned(), ..ConvertedGrid::default() };
        let (dropped, entry) = native.mend_metadata()?;
        if dropped > 0 {
            let others = if dropped > 1 { format!(" and {} more", dropped - 1) } else { String::new() };
            warnings.push(format!(
                "grid '{}': damaged metadata was left out ('{entry}'{others}); OpenVDB writes it anew",
                converted.from
            ));
        }
        Ok(Self { info: native.info()?, native, converted, budget, warnings })
    }

    /// Keeps only what lies in a world-space box.
    pub(crate) fn crop(&mut self, world: Aabb) -> Result<()> {
        let had_voxels = self.info.active_voxels > 0;
        let more = self.native.cropped_bytes(world)?;
        let needed = self.info.memory.saturating_add(more);
        self.budget.room(needed, "the cropped grid", "raise ⟨max_memory⟩, or choose another ⟨crop⟩")?;
        self.native.crop(world)?;
        self.info = self.native.info()?;
        if had_voxels && self.info.active_voxels == 0 {
            self.warnings.push(format!(
                "grid '{}': no active voxel lies in the box of ⟨crop⟩; cumulo info says where they lie",
                self.converted.from
            ));
        }
        Ok(())
    }

    /// Resamples to cubic voxels of that edge length in world units: by the filter that is asked for, else by a box
    /// where no voxel gets finer, and trilinearly elsewhere. Distances to a surface are interpolated, never averaged:
    /// outside their narrow band there are none.
    pub(crate) fn resample(&mut self, voxel_size: f64, filter: Option<ResampleFilter>) -> Result<()> {
        let had_voxels = self.info.active_voxels > 0;
        let distances = self.info.class == GridClass::LevelSet;
        let filter = match filter {
            Some(ResampleFilter::Box) if distances => {
                return Err(Error::unsupported(
                    "⟨filter=box⟩: a level set holds distances, whose means are no distances",
                )
                .hint("leave ⟨filter⟩ out, or make it a fog volume first: ⟨to=fog⟩"));
            }
            Some(filter) => filter,
            None if !distances && self.native.coarsens(voxel_size)? => ResampleFilter::Box,
            None => ResampleFilter::Trilinear,
        };
        self.converted.filter = Some(filter);
        let more = match filter {
            ResampleFilter::Box => self.native.resampled_box_bytes(voxel_size, self.budget.limit)?,
            ResampleFilter::Trilinear => self.native.resampled_bytes(voxel_size, self.budget.limit)?,
        };
        let hint = "choose a larger voxel for ⟨resample⟩, take a part with ⟨crop⟩, or raise ⟨max_memory⟩";
        self.budget.room(self.info.memory.saturating_add(more), "the resampled grid", hint)?;
        match filter {
            ResampleFilter::Box => self.native.resample_box(voxel_size)?,
            ResampleFilter::Trilinear => self.native.resample(voxel_size)?,
        }
        self.info = self.native.info()?;
        if had_voxels && self.info.active_voxels == 0 {
            self.warnings.push(format!(
                "grid '{}': voxels of {voxel_size} are too large for what it holds: none is active",
                self.converted.from
            ));
        }
        Ok(())
    }

    /// Takes the values through the steps of `scale`, `offset`, `map` and `threshold`, and to the type of `as`.
    pub(crate) fn map(&mut self, to: GridType, mapping: &Mapping) -> Result<()> {
        let left = Limits { max_memory: self.budget.limit.saturating_sub(self.budget.held) };
        let (mapped, tally) = volume::mapped(self.native, to, mapping, left)?;
        *self.native = mapped;
        self.info = self.native.info()?;
        if mapping.threshold.is_some() && self.info.active_voxels == 0 {
            self.warnings.push(format!("grid '{}': no value lies above the threshold", self.converted.from));
        }
        let background = mapping.mapped(0.0);
        if background != 0.0 {
            self.warnings.push(format!(
                "grid '{}': inactive voxels are background and stay 0, where an active 0 becomes {background}; to keep \
                 zeros that mean something, give the options where the image is read",
                self.converted.from
            ));
        }
        self.warnings.extend(losses(&self.converted.from, &tally, self.info.components));
        self.converted.values = Some(tally);
        Ok(())
    }

    /// Counts the grid among those that stay in memory until all are written.
    pub(crate) fn hold(&mut self) -> Result<()> {
        self.budget.held += self.info.memory;
        self.budget.room(0, "holding the grids", ONE_BY_ONE)
    }

    pub(crate) fn repair(&mut self, repair: Repair) -> Result<()> {
        let densities = repair == Repair::Density || self.info.class == GridClass::FogVolume;
        self.converted.repaired = Some(self.native.repair(densities)?);
        Ok(())
    }

    /// Has the values stored as 16-bit floats where they are real, and counts those that these cannot hold.
    pub(crate) fn store_as_half(&mut self) -> Result<()> {
        if !half::can_store(&self.info.value_type) {
            return Ok(());
        }
        let (overflow, underflow) = half::losses(self.native)?;
        (self.converted.half_overflow, self.converted.half_underflow) = (Some(overflow), Some(underflow));
        self.native.set_half(true)
    }

    /// Attaches a transfer function as metadata.
    pub(crate) fn attach(&mut self, function: &Function) -> Result<()> {
        self.native.set_metadata(METADATA_KEY, &to_metadata(function))?;
        self.converted.transfer = true;
        Ok(())
    }

    pub(crate) fn finish(self) -> Result<ConvertedGrid> {
        let (name, active_voxels) = (self.native.name().to_owned(), self.native.info()?.active_voxels);
        Ok(ConvertedGrid { name, active_voxels, ..self.converted })
    }
}

/// Remedy where the grids of a conversion do not fit in memory together.
pub(crate) const ONE_BY_ONE: &str = "raise ⟨max_memory⟩, or convert the grids one by one with ⟨grid⟩";

/// Memory of all grids of a conversion together, in bytes.
pub(super) struct Budget {
    pub held: u64,
    pub limit: u64,
}

impl Budget {
    /// Refuses a step that needs `bytes` beside the grids that are held already.
    pub(crate) fn room(&self, bytes: u64, what: &str, hint: &str) -> Result<()> {
        let needed = self.held.saturating_add(bytes);
        if needed <= self.limit {
            return Ok(());
        }
        let (needed, allowed) = (human(needed), human(self.limit));
        Err(Error::unsupported(format!("{what} needs about {needed}, {allowed} are allowed"))
            .coded(Code::MemoryLimit)
            .hint(hint))
    }
}
