//! A capture of cameras alone, whose pictures are still to be rendered.

use crate::app::Context;
use crate::app::earlier;
use crate::app::inputs;
use crate::app::pictures::{Cameras, PictureSettings};
use crate::app::provenance::Provenance;
use crate::app::up::ChosenUp;
use crate::app::use_case::{Report, use_case};
use crate::error::{Error, Result};
use crate::formats::atomic::{self, Batch};
use crate::formats::protected;
use crate::formats::transforms::{self, FILE_NAME};
use crate::scene::capture::Model;
use serde::{Deserialize, Serialize};
use serde_json::{Map, json};
use std::fmt;
use std::path::{Path, PathBuf};

/// Settings of a capture of cameras around a volume, as a render of it would have them, without pictures.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct NewCaptureSettings {
    /// File to write, name.json; or a folder for a transforms.json.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// True to replace a capture of other settings.
    pub overwrite: bool,
    /// Subject, cameras, media and light of the pictures.
    #[serde(flatten)]
    pub pictures: PictureSettings,
}

/// Report of a capture without pictures.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct NewCaptureReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    views: usize,
    /// Width and height of the pictures in pixels, of the first view.
    size: [u32; 2],
    model: Model,
    /// Up axis about which cameras were placed; none where they were given.
    up: Option<ChosenUp>,
}

impl fmt::Display for NewCaptureReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { output, views, size: [width, height], .. } = self;
        let s = if *views == 1 { "" } else { "s" };
        write!(f, "{}: {views} camera{s} of {width}x{height} pixels", output.display())
    }
}

use_case!(NewCaptureSettings => NewCaptureReport, pictures.limits);

impl Report for NewCaptureReport {}

/// Settings on which the capture does not depend.
const MANNER: [&str; 3] = ["output", "overwrite", "max_memory"];

impl NewCaptureSettings {
    /// Reads the volume, places the cameras and writes them.
    ///
    /// # Errors
    /// If the volume or the cameras cannot be used, or the file cannot be written.
    pub fn run(&self, context: &Context) -> Result<NewCaptureReport> {
        let _inputs = inputs::protect(self.pictures.inputs(), self.pictures.limits);
        let pictures = &self.pictures;
        pictures.check()?;
        let mut provenance = Provenance::begin(context).of("capture new", self, &MANNER);
        let (json, folder) = self.place();
        protected::check(&json)?;
        let template = pictures.template(None, &mut provenance)?;
        pictures.check_cameras(template.as_ref())?;
        let (subject, transfer) = pictures.subject(template.as_ref(), pictures.limits, &mut provenance)?;
        let up = pictures.chosen_up(template.as_ref())?;
        up.iter().for_each(|up| context.note(up));
        let picture = |name: &str| folder.join(name);
        let capture = pictures.capture(picture, &subject, transfer, template.as_ref(), Cameras::around(up.as_ref()))?;
        let Some(first) = capture.frames.first().map(|frame| frame.camera) else {
            return Err(Error::invalid("no cameras").hint("give ⟨views⟩ or ⟨cameras⟩"));
        };
        let mut batch = Batch::new();
        batch.make_folder(&folder)?;
        provenance.lap();
        let mut extra = Map::from_iter([("provenance".to_owned(), json!(provenance))]);
        let waiting = batch.add(&json)?;
        transforms::save_for(&json, &waiting, &pictures.recorded_as(&capture, &mut extra), &extra)?;
        let _lock = atomic::lock_folder(&folder);
        if !self.overwrite {
            earlier::spare_captures(&json, &[], &provenance)?;
        }
        batch.commit()?;
        let (views, model) = (capture.frames.len(), capture.model);
        Ok(NewCaptureReport { output: json, views, size: [first.width, first.height], model, up })
    }

    /// Returns the file of the capture, and its folder.
    fn place(&self) -> (PathBuf, PathBuf) {
        let is_json = self.output.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("json"));
        match is_json && !self.output.is_dir() {
            true => (self.output.clone(), self.output.parent().unwrap_or(Path::new("")).to_owned()),
            false => (self.output.join(FILE_NAME), self.output.clone()),
        }
    }
}
