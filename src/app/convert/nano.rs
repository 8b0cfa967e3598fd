//! NanoVDB in and out: grids of one form become those of the other, with all voxels, tiles and states.

use super::report::{GridPlace, Image, array_to_world};
use super::{ConvertSettings, FileReport, half};
use crate::app::Context;
use crate::app::outputs::{self, Content};
use crate::error::{Code, Error, Result};
use crate::formats::atomic;
use crate::formats::imaging::values::Tally;
use crate::formats::limits::Limits;
use crate::formats::nanovdb::{self, Volume};
use crate::formats::vdb::up::UP_KEY;
use crate::formats::vdb::{File, NativeGrid, write_native};
use crate::scene::grid::MetaValue;
use crate::wording::all_worded;
use std::collections::BTreeMap;

impl ConvertSettings {
    /// Writes the grids of a NanoVDB as those of a VDB.
    pub(super) fn nano_to_grids(&self, context: &Context) -> Result<FileReport> {
        outputs::file(&self.output, Content::Vdb)?;
        let limits = self.limits;
        let stage = context.stage("converting");
        let mut file = nanovdb::File::open(&self.input, limits)?;
        let (mut natives, mut places, mut notes) = (Vec::new(), Vec::new(), Vec::new());
        let mut metadata = BTreeMap::new();
        let mut held = 0;
        for index in self.chosen_of_nano(&file)? {
            let mut volume = file.read_beside(index, held)?;
            // What the grids of a VDB share is stated beside each of them.
            for (name, text) in std::mem::take(&mut volume.texts) {
                metadata.entry(name).or_insert(MetaValue::Text(text));
            }
            let place = format!("grid '{}'", volume.name);
            let made = volume.into_native().map_err(|e| e.part(place.clone()).at(&self.input));
            let (mut native, found) = made?;
            notes.extend(found.into_iter().map(|note| format!("{place}: {note}")));
            if self.half {
                notes.extend(half::store(&mut native)?);
            }
            held += native.info()?.memory;
            places.push(placed(&native)?);
            natives.push(native);
        }
        write_native(&self.output, &natives.iter().collect::<Vec<_>>(), None, &metadata, self.codec)?;
        drop(stage);
        self.report_nano(context, places, notes)
    }

    /// Places of the grids that are read: those that `grid` names, else all.
    fn chosen_of_nano(&self, file: &nanovdb::File) -> Result<Vec<usize>> {
        let entries = file.entries();
        if self.grid.is_empty() {
            return Ok((0..entries.len()).collect());
        }
        let find = |name: &String| {
            entries.iter().position(|e| e.name == *name).ok_or_else(|| {
                let all: Vec<_> = entries.iter().map(|e| format!("'{}'", e.name)).collect();
                Error::invalid(format!("no grid '{name}'; the file has {}", all.join(", ")))
                    .coded(Code::NoSuchGrid)
                    .at(&self.input)
                    .hint("name one of these")
            })
        };
        let mut chosen = Vec::new();
        for name in &self.grid {
            let index = find(name)?;
            // A grid that is named twice counts once.
            if !chosen.contains(&index) {
                chosen.push(index);
            }
        }
        Ok(chosen)
    }

    /// Writes the grids of a VDB as those of a NanoVDB.
    pub(super) fn grids_to_nano(&self, context: &Context) -> Result<FileReport> {
        atomic::probe(&self.output)?;
        let limits = self.limits;
        let stage = context.stage("converting");
        let file = File::open(&self.input, limits)?;
        let texts = carried_metadata(&file)?;
        let (mut volumes, mut places, mut notes) = (Vec::new(), Vec::new(), Vec::new());
        let mut held = 0;
        for name in self.selected_grids(&file)? {
            let native = file.read(&name)?;
            let left = Limits { max_memory: limits.max_memory.saturating_sub(held) };
            let mut volume = Volume::of_native(&native, left).map_err(|e| e.at(&self.input))?;
            held += native.info()?.memory;
            volume.texts.clone_from(&texts);
            notes.append(&mut volume.notes);
            places.push(placed(&native)?);
            volumes.push(volume);
        }
        let left = Limits { max_memory: limits.max_memory.saturating_sub(held) };
        notes.extend(nanovdb::write(&self.output, &volumes, left)?);
        drop(stage);
        self.report_nano(context, places, notes)
    }

    fn report_nano(&self, context: &Context, grids: Vec<GridPlace>, notes: Vec<String>) -> Result<FileReport> {
        notes.iter().for_each(|note| context.note(format!("note: {note}")));
        let mut report = Image::of(&self.input, &self.output)?;
        report.format = Some("NanoVDB");
        report.grids = grids;
        report.notes = all_worded(notes);
        Ok(FileReport::Image(Box::new(report)))
    }
}

/// Metadata of a VDB that its grids keep in a NanoVDB: its creator, and its up axis if anything in it states one.
fn carried_metadata(file: &File) -> Result<BTreeMap<String, String>> {
    let mut texts = BTreeMap::new();
    for (name, value) in file.metadata()? {
        if let (true, MetaValue::Text(text)) = (nanovdb::KEPT.contains(&name.as_str()), value) {
            texts.insert(name, text);
        }
    }
    if let Some(stated) = file.up() {
        texts.insert(UP_KEY.to_owned(), stated.up.name().to_owned());
    }
    Ok(texts)
}

/// Where a grid's active voxels lie.
pub(super) fn placed(native: &NativeGrid) -> Result<GridPlace> {
    let info = native.info()?;
    let transform = info.affine()?;
    let (low, high) = info.index_box.unwrap_or(([0; 3], [-1; 3]));
    let shape = std::array::from_fn(|a| (i64::from(high[a]) - i64::from(low[a]) + 1).unsigned_abs() as usize);
    Ok(GridPlace::new(info, shape, low, array_to_world(&transform, low), Tally::default()))
}
