//! Images as grids of a VDB.

use super::images::{empty, remarks};
use super::report::{GridPlace, Image, array_to_world};
use super::{ConvertSettings, FileReport, half};
use crate::app::Context;
use crate::app::context::Stage;
use crate::app::outputs::{self, Content};
use crate::app::scan::grids::name_of;
use crate::error::{Error, Result};
use crate::formats::format::Format;
use crate::formats::imaging::options::{Axes, ReadOption};
use crate::formats::imaging::volume::{self, Settings};
use crate::formats::imaging::{ImageFormat, image};
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use crate::formats::vdb::{NativeGrid, write_native};
use crate::wording::all_worded;
use std::collections::BTreeMap;

impl ConvertSettings {
    /// Writes each array of an image as a grid with background 0, whose zeros are inactive.
    pub(super) fn image_to_grids(
        &self,
        format: &Format,
        reader: &ImageFormat,
        context: &Context,
    ) -> Result<FileReport> {
        let limits = self.limits;
        outputs::file(&self.output, Content::Vdb)?;
        let stage = context.stage("converting");
        let _reading = Reading::begin(&self.input);
        let images = reader.open(&self.input, &self.images.reading()?, limits)?;
        let names = self.grid_names(&images)?;
        let (mut natives, mut places, mut notes) = (Vec::new(), Vec::new(), Vec::new());
        let mut held = 0;
        for (mut image, name) in images.into_iter().zip(names) {
            let left = Limits { max_memory: limits.max_memory.saturating_sub(held) };
            let settings = Settings {
                name: &name,
                grid_type: self.images.scan.grid_type(format.kind.heeds(ReadOption::Axes)),
                mapping: self.values.mapping(),
                limits: left,
            };
            let (mut native, place) = self.image_to_grid(&mut image, &settings, &stage)?;
            // Reading the values has added to the notes.
            notes.append(&mut image.header.notes);
            if self.half {
                notes.extend(half::store(&mut native)?);
            }
            held += native.info()?.memory;
            notes.extend(remarks(&place));
            natives.push(native);
            places.push(place);
        }
        write_native(&self.output, &natives.iter().collect::<Vec<_>>(), None, &BTreeMap::new(), self.codec)?;
        drop(stage);
        self.report_images(context, format, places, notes)
    }

    fn image_to_grid(
        &self,
        image: &mut image::Image,
        settings: &Settings<'_>,
        stage: &Stage,
    ) -> Result<(NativeGrid, GridPlace)> {
        let name = settings.name;
        let built = volume::build(image, settings, |done, of| stage.at(done, of));
        let (native, tally) = built.map_err(|e| e.part(format!("grid '{name}'")).at(&self.input))?;
        let info = native.info()?;
        if info.active_voxels == 0 && self.values.any() {
            return Err(empty(name).at(&self.input));
        }
        let shape = image.header.size;
        let transform = array_to_world(&image.header.index_to_world, [0; 3]);
        Ok((native, GridPlace::new(info, shape, [0; 3], transform, tally)))
    }

    /// Names of the grids: that of `grid`, those of the arrays, or `density`.
    fn grid_names(&self, images: &[image::Image]) -> Result<Vec<String>> {
        match (&self.grid[..], images) {
            ([], _) => Ok(images.iter().map(|image| name_of(&image.header)).collect()),
            ([name], [_]) => Ok(vec![name.clone()]),
            (names, images) if names.len() == images.len() => Ok(names.to_vec()),
            (names, images) => Err(Error::invalid(format!("{} names for {} grid(s)", names.len(), images.len()))
                .at(&self.input)
                .hint("give one ⟨grid=NAME⟩ for each array, in the file's order, or choose one with ⟨array⟩")),
        }
    }

    fn report_images(
        &self,
        context: &Context,
        format: &Format,
        grids: Vec<GridPlace>,
        notes: Vec<String>,
    ) -> Result<FileReport> {
        notes.iter().for_each(|note| context.note(format!("note: {note}")));
        let mut report = Image::of(&self.input, &self.output)?;
        if let [only] = &grids[..] {
            report.shape = only.shape.to_vec();
            report.axes = vec!["x", "y", "z"];
            if format.kind.heeds(ReadOption::Axes) && self.images.scan.axes() == Axes::Zyx {
                report.shape.reverse();
                report.axes.reverse();
            }
            if only.background.len() > 1 {
                report.shape.push(only.background.len());
                report.axes.push("component");
            }
            report.grid = Some(only.clone());
        }
        report.format = Some(format.name);
        report.grids = grids;
        report.notes = all_worded(notes);
        Ok(FileReport::Image(Box::new(report)))
    }
}
