//! VDB in, VDB out, with edits in between. Grids stay native, so that nothing is lost that no edit touches.

use super::converted::ConvertedGrid;
use super::grid_edit::{Budget, GridEdit, ONE_BY_ONE};
use super::parts::{self, Part};
use super::turn::Turn;
use super::{ConvertSettings, FileReport};
use crate::app::Context;
use crate::app::outputs::{self, Content};
use crate::error::{Error, Result};
use crate::formats::transfer::{Function, TransferSummary};
use crate::formats::vdb::{File, NativeGrid, ResampleFilter, Transform as Placement, writable, write_native};
use crate::math::Aabb;
use crate::text::bytes as human;
use crate::text::printable;
use crate::wording::all_worded;
use glam::DVec3;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// Report of a VDB with edits.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct Grids {
    #[serde(serialize_with = "crate::app::paths::text")]
    input: PathBuf,
    /// Other files whose grids were joined with those of the first one.
    #[serde(skip_serializing_if = "Vec::is_empty", serialize_with = "crate::app::paths::texts")]
    more: Vec<PathBuf>,
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    bytes: u64,
    grids: Vec<ConvertedGrid>,
    /// Turn of the world that `up` asked for.
    up: Option<Turn>,
    /// Transfer function that `tf` attached to the grids.
    transfer: Option<TransferSummary>,
    /// Edits whose effect may not have been meant.
    warnings: Vec<String>,
}

impl ConvertSettings {
    /// Reads, edits, writes and reports.
    ///
    /// # Errors
    /// If the input cannot be read, a grid is not there or cannot be edited so, or the output cannot
    /// be written; the output is untouched then.
    pub(super) fn grids(&self, context: &Context) -> Result<FileReport> {
        let stage = context.stage("converting");
        let limits = self.limits;
        outputs::file(&self.output, Content::Vdb)?;
        let volumes = || std::iter::once(&self.input).chain(&self.more);
        let transfer = self.transfer.function(limits)?;
        let files = volumes().map(|path| File::open(path, limits)).collect::<Result<Vec<_>>>()?;
        let parts = self.parts(&files)?;
        let turn = Turn::of(&self.edits, &files[0]);
        turn.iter().for_each(|turn| context.note(turn));
        let mut warnings = Vec::new();
        parts::check_up(&files, &mut warnings)?;
        let (natives, grids) = self.made(&parts, (transfer.as_ref(), turn.as_ref()), &mut warnings)?;
        let mut metadata = parts::further_metadata(&files, &mut warnings)?;
        metadata.extend(turn.as_ref().map(|turn| turn.metadata(&files[0])).transpose()?.unwrap_or_default());
        warnings.iter().for_each(|warning| context.note(format!("warning: {warning}")));
        if transfer.is_some() && !grids.iter().any(|g| g.transfer) {
            return Err(Error::invalid("no grid holds scalars, which a transfer function needs")
                .at(&self.input)
                .hint("leave ⟨tf⟩ out, or choose other grids"));
        }
        write_native(&self.output, &natives.iter().collect::<Vec<_>>(), Some(&files[0]), &metadata, self.codec)?;
        let transfer = transfer.as_ref().map(TransferSummary::of).transpose()?;
        let bytes = std::fs::metadata(&self.output).map_err(|e| Error::io(&self.output, e))?.len();
        drop(stage);
        Ok(FileReport::Grids(Box::new(Grids {
            input: self.input.clone(),
            more: self.more.clone(),
            output: self.output.clone(),
            bytes,
            grids,
            up: turn,
            transfer,
            warnings: all_worded(warnings),
        })))
    }

    /// Reads the grids, makes others of them and edits all.
    fn made(
        &self,
        parts: &[Part<'_>],
        (transfer, turn): (Option<&Function>, Option<&Turn>),
        warnings: &mut Vec<String>,
    ) -> Result<(Vec<NativeGrid>, Vec<ConvertedGrid>)> {
        let mut new_names = self.new_names(parts, warnings)?.into_iter();
        let (mut natives, mut grids): (Vec<_>, Vec<ConvertedGrid>) = (Vec::new(), Vec::new());
        let mut budget = Budget { held: 0, limit: self.limits.max_memory };
        let names = parts.iter().flat_map(|part| part.names.iter().map(|name| part.file.find(name)));
        let in_files = names.map(|entry| Ok(entry?.topology.map_or(0, |t| t.memory))).sum::<Result<u64>>()?;
        budget.room(in_files, "holding the grids", ONE_BY_ONE).map_err(|e| e.at(&self.input))?;
        let all = parts.iter().flat_map(|part| part.sources.iter().map(|source| (part.file, source)));
        for (file, source) in all {
            let origin = source.origin();
            let place = |e: Error| e.part(format!("grid '{origin}'")).at(file.path());
            let room = |bytes| budget.room(bytes, "making the grids", ONE_BY_ONE);
            for mut native in source.read(file, &room).map_err(place)? {
                let settings = Settings { name: new_names.next(), transfer, turn };
                let converted = self.edit(&mut native, settings, &mut budget, warnings).map_err(place)?;
                grids.push(ConvertedGrid { from: origin.clone(), ..converted });
                natives.push(native);
            }
        }
        if let (Some(form), false) = (self.edits.to, grids.iter().any(|grid| grid.formed.is_some())) {
            let kind = form.name();
            warnings.push(format!("⟨to⟩: no grid could become a {kind}; cumulo info says what the grids are"));
        }
        Ok((natives, grids))
    }

    pub(super) fn selected_grids(&self, file: &File) -> Result<Vec<String>> {
        if self.grid.is_empty() {
            return Ok(file.entries().iter().map(|e| e.name.clone()).collect());
        }
        let mut chosen = Vec::new();
        for name in &self.grid {
            let name = &file.find(name)?.name;
            // A grid that is named twice counts once.
            if !chosen.contains(name) {
                chosen.push(name.clone());
            }
        }
        Ok(chosen)
    }

    fn edit(
        &self,
        native: &mut NativeGrid,
        settings: Settings<'_>,
        budget: &mut Budget,
        warnings: &mut Vec<String>,
    ) -> Result<ConvertedGrid> {
        let mut edit = GridEdit::begin(native, budget, warnings)?;
        if let (Placement::Affine(map), None) = (&edit.info.transform, self.resample) {
            writable(map)?;
        }
        if let Some([min, max]) = self.crop {
            edit.crop(Aabb { min: DVec3::from_array(min), max: DVec3::from_array(max) })?;
        }
        if let Some(voxel_size) = self.resample {
            edit.resample(voxel_size, self.edits.filter)?;
        }
        if let Some(form) = self.edits.to {
            let budget = &*edit.budget;
            let hint =
                "raise ⟨max_memory⟩, resample the grid to larger voxels with ⟨resample⟩, or take a part with ⟨crop⟩";
            let held = edit.info.memory;
            let room = |bytes| budget.room(held.saturating_add(bytes), "the level set", hint);
            edit.converted.formed = form.give(edit.native, &edit.info, self.edits.iso, &room)?;
            edit.info = edit.native.info()?;
        }
        if self.values.any() || self.images.scan.grid_type.is_some() {
            edit.map(self.images.scan.grid_type(false), &self.values.mapping())?;
        }
        edit.hold()?;
        if let Some(repair) = self.repair {
            edit.repair(repair)?;
        }
        if let Some(tolerance) = self.prune {
            edit.native.prune(tolerance)?;
        }
        if self.half {
            edit.store_as_half()?;
        }
        if let Some(transfer) = settings.transfer.filter(|_| edit.info.components == 1) {
            edit.attach(transfer)?;
        }
        if let Some(turn) = settings.turn {
            edit.converted.vectors_turned = turn.apply(edit.native, &edit.info, edit.warnings)?;
        }
        if let Some(new) = settings.name.filter(|new| *new != base_name(edit.native.name())) {
            edit.native.set_name(&new)?;
        }
        edit.finish()
    }
}

/// Settings of one grid beyond the options that hold for all.
struct Settings<'s> {
    /// Name of the grid in the output.
    name: Option<String>,
    transfer: Option<&'s Function>,
    turn: Option<&'s Turn>,
}

/// Name without the number that tells grids of one name apart.
fn base_name(name: &str) -> &str {
    match name.rsplit_once('[') {
        Some((base, number)) if number.ends_with(']') => base,
        _ => name,
    }
}

impl fmt::Display for Grids {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {} grid(s), {}", self.output.display(), self.grids.len(), human(self.bytes))?;
        for grid in &self.grids {
            write!(f, "  '{}': {} active voxels", printable(&grid.name), grid.active_voxels)?;
            if grid.name != grid.from {
                write!(f, ", was '{}'", printable(&grid.from))?;
            }
            if let Some(filter) = grid.filter {
                let name = if filter == ResampleFilter::Box { "a box filter" } else { "trilinear interpolation" };
                write!(f, ", resampled by {name}")?;
            }
            if let Some(formed) = grid.formed {
                write!(f, ", made a {}", formed.form.name())?;
                formed.iso.map_or(Ok(()), |iso| write!(f, " of density {iso}"))?;
            }
            if grid.vectors_turned == Some(true) {
                write!(f, ", vectors turned")?;
            }
            if let Some(n) = grid.repaired {
                write!(f, ", {n} values set to zero")?;
            }
            if let (Some(over), Some(under)) = (grid.half_overflow, grid.half_underflow) {
                f.write_str(", stored as 16-bit floats")?;
                for (count, what) in [(over, "become infinite"), (under, "become 0")] {
                    if count > 0 {
                        write!(f, ", in which {count} values {what}")?;
                    }
                }
            }
            if let Some(greatest) = grid.values.and_then(|v| v.removed_greatest) {
                let share = 100.0 * grid.values.map_or(0.0, |v| v.removed_share);
                write!(f, ", values up to {greatest} removed, {share:.4} % of the sum")?;
            }
            if grid.transfer {
                write!(f, ", with the transfer function")?;
            }
            writeln!(f)?;
        }
        if let Some(transfer) = &self.transfer {
            writeln!(f, "  transfer function: {transfer}")?;
        }
        Ok(())
    }
}
