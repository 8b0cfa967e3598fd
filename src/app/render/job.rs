//! Parts of the work of rendering that a job does apart from each other.

use super::RenderSettings;
use super::target::Target;
use crate::app::Context;
use crate::app::job::{Divisible, Work};
use crate::app::pictures::{DensityScale, PictureSettings};
use crate::app::plan::PlanSettings;
use crate::app::provenance::Provenance;
use crate::app::sequence::{numbers, pattern};
use crate::app::volume;
use crate::error::{Error, Result};
use crate::formats::format::FileKind;
use crate::formats::sequence::Frames;
use crate::render::film::Aov;
use std::path::Path;

impl Divisible for RenderSettings {
    fn work(&self, context: &Context) -> Result<Work> {
        self.pictures.check()?;
        self.accuracy.check(&self.pictures)?;
        if let Some(input) = self.pictures.sequence_of_folder()? {
            let pictures = PictureSettings { input, ..self.pictures.clone() };
            return Self { pictures, ..self.clone() }.work(context);
        }
        let numbers = if self.is_sequence() { self.sequence_numbers()? } else { self.view_numbers(context)? };
        let (what, option) = if self.is_sequence() { ("frames", "⟨frames=N⟩") } else { ("views", "⟨view=N⟩") };
        let target = Target::of(&self.output)?;
        target.holds(numbers.len(), what, option)?;
        if self.accuracy.time.is_some() && numbers.len() > 1 {
            return Err(Error::invalid(
                "⟨time⟩ is that of all pictures together, and a job renders them on several hosts",
            )
            .hint("give ⟨target_error⟩, or a number of ⟨samples⟩"));
        }
        Ok(match (target, self.accuracy.replicates) {
            // The number of paths is chosen for all pictures together.
            _ if self.denoise && self.accuracy.target_error.is_some() => Work::Whole,
            _ if self.is_sequence() && self.settles_by_part() => Work::Whole,
            (Target::File(path), Some(numbers)) if !self.denoise => Work::Replicates { numbers, picture: path.into() },
            (Target::File(_), _) => Work::Whole,
            _ if self.denoise => {
                let planes = [Aov::Halves, Aov::Motion].map(Aov::name);
                let planes = planes.into_iter().filter(|name| !self.aov.iter().any(|aov| aov.name() == *name));
                Work::Denoised { numbers, planes: planes.collect::<Vec<_>>().join(",") }
            }
            _ if self.is_sequence() => Work::Frames(numbers),
            _ => Work::Views(numbers),
        })
    }

    fn inputs(&self) -> Vec<&Path> {
        self.pictures.inputs().into_iter().chain(self.holdout.holdout.as_deref()).collect()
    }

    fn seconds(&self, context: &Context) -> Option<f64> {
        if self.accuracy.on() {
            return None;
        }
        let frame = self.frames.map(|Frames { first, .. }| first);
        let plan = PlanSettings { frame, pictures: self.pictures.clone(), ..PlanSettings::default() };
        let plan = plan.of_scene(&context.silent()).ok()?;
        Some(plan.seconds_a_picture())
    }
}

impl RenderSettings {
    /// True if what holds for all frames is found from those that are rendered: a scene file does not tell how many
    /// there are.
    fn settles_by_part(&self) -> bool {
        let pictures = &self.pictures;
        let is_scene =
            || volume::format_of(&pictures.input).is_ok_and(|format| matches!(format.kind, FileKind::Capture));
        let settles = pictures.cameras.is_none()
            || pictures.density_scale == Some(DensityScale::Auto)
            || pictures.planning.max_omitted > 0.0;
        settles && pattern(&pictures.input).is_none() && is_scene()
    }

    /// Returns the numbers of the frames of a sequence.
    fn sequence_numbers(&self) -> Result<Vec<u32>> {
        match (self.frames, pattern(&self.pictures.input)) {
            (frames, Some(pattern)) => numbers(frames, &pattern),
            (frames, None) => Ok(frames.into_iter().flat_map(Frames::numbers).collect()),
        }
    }

    /// Returns the numbers of the views.
    fn view_numbers(&self, context: &Context) -> Result<Vec<u32>> {
        let template = self.pictures.template(None, &mut Provenance::begin(context))?;
        self.pictures.check_cameras(template.as_ref())?;
        let stated =
            template.as_ref().map_or(self.pictures.placed().unwrap_or(1) as usize, |capture| capture.frames.len());
        Ok(self.pictures.chosen(stated)?.into_iter().map(|number| number as u32).collect())
    }
}
