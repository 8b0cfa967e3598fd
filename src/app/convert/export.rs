//! A grid of a VDB as an image, over the box of its active voxels.

use super::images::losses;
use super::report::{GridPlace, Image, array_to_world};
use super::{ConvertSettings, FileReport};
use crate::app::Context;
use crate::app::volume::array_grid;
use crate::error::{Error, Result};
use crate::formats::atomic;
use crate::formats::format::FileKind;
use crate::formats::imaging::options::{Axes, ReadOption};
use crate::formats::imaging::source::Source;
use crate::formats::imaging::values::Tally;
use crate::formats::imaging::volume;
use crate::formats::imaging::write::Target;
use crate::formats::vdb::{File, NativeGrid};
use crate::wording::all_worded;

impl ConvertSettings {
    /// Writes a grid over the box of its active voxels.
    pub(super) fn grid_to_image(&self, kind: FileKind, target: &Target, context: &Context) -> Result<FileReport> {
        let limits = self.limits;
        let beside = target.companion(&self.output);
        let written = || std::iter::once(self.output.as_path()).chain(beside.as_deref());
        written().try_for_each(atomic::probe)?;
        let stage = context.stage("converting");
        let file = File::open(&self.input, limits)?;
        let name = self.one_grid(&file)?;
        let place = |e: Error| e.part(format!("grid '{name}'")).at(&self.input);
        let (native, tally) = self.prepared(file.read(&name)?).map_err(place)?;
        let info = native.info().map_err(place)?;
        let lost = losses(&name, &tally, info.components);
        let source = Source::new(&native, limits).map_err(place)?;
        let axes = self.images.scan.axes();
        let mut notes = target.write(&self.output, &source, &name, axes)?;
        notes.extend(lost);
        drop(stage);
        notes.iter().for_each(|note| context.note(format!("note: {note}")));
        let mut report = Image::of(&self.input, &self.output)?;
        if let Some(beside) = &beside {
            report.bytes += std::fs::metadata(beside).map_err(|e| Error::io(beside, e))?.len();
        }
        report.shape = source.size.to_vec();
        report.axes = vec!["x", "y", "z"];
        if kind.heeds(ReadOption::Axes) && axes == Axes::Zyx {
            report.shape.reverse();
            report.axes.reverse();
        }
        if source.components > 1 {
            report.shape.push(source.components);
            report.axes.push("component");
        }
        let transform = array_to_world(&info.affine()?, source.low);
        report.grid = Some(GridPlace::new(info, source.size, source.low, transform, tally));
        report.format = Some(target.ending);
        report.notes = all_worded(notes);
        Ok(FileReport::Image(Box::new(report)))
    }

    /// The grid as it is, or after the steps of its values.
    fn prepared(&self, native: NativeGrid) -> Result<(NativeGrid, Tally)> {
        if !self.values.any() && self.images.scan.grid_type.is_none() {
            return Ok((native, Tally::default()));
        }
        volume::mapped(&native, self.images.scan.grid_type(false), &self.values.mapping(), self.limits)
    }

    /// Name of the grid that becomes an image or a mesh: that of `grid`, the only one, or the density.
    pub(super) fn one_grid(&self, file: &File) -> Result<String> {
        match &self.grid[..] {
            [name, more @ ..] if more.iter().all(|other| other == name) => file.find(name).map(|e| e.name.clone()),
            [] => array_grid(file, &self.input),
            names => Err(Error::invalid(format!("one grid is converted; {} are named", names.join(", ")))
                .at(&self.input)
                .hint("name one of them with ⟨grid⟩")),
        }
    }
}
