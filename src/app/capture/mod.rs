//! Captures: any one, converted to one that every use case takes, and cameras for pictures that are to be rendered.

mod new;
mod photographs;
mod pictures;
mod placement;
mod report;

pub use new::{NewCaptureReport, NewCaptureSettings};
pub use pictures::Masked;
pub use placement::Placement;
pub use report::CaptureReport;

use crate::app::Context;
use crate::app::checks::Warning;
use crate::app::earlier;
use crate::app::inputs;
use crate::app::outputs;
use crate::app::photos;
use crate::app::provenance::Provenance;
use crate::app::use_case::{Report, use_case};
use crate::error::{Error, Result};
use crate::formats::atomic::{self, Batch};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::protected;
use crate::formats::transforms::{self, FILE_NAME};
use crate::formats::usd::{Stage, Views};
use crate::formats::views::{LensAndMask, StatedCapture};
use crate::formats::{captures, colmap, exr, picture, registry};
use crate::scene::capture::{Capture, Frame, Pictures};
use crate::scene::color_space::ColorSpace;
use photographs::Setting;
use pictures::{Choices, VideoFrames, View};
use placement::moved;
use serde::{Deserialize, Serialize};
use serde_json::{Map, json};
use std::path::{Path, PathBuf};

/// Settings of a capture that becomes one that every use case takes: cameras without lens distortion and scene-linear
/// EXRs.
///
/// Pictures that a lens distorts are resampled, by bilinear interpolation of linear light, to a pinhole camera with the
/// same focal lengths, and cropped to the largest rectangle in which every pixel was seen. PNG and JPEG become EXRs by
/// their color space; straight alpha is composited over the background of the capture. EXRs in which nothing changes
/// stay where they are.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CaptureSettings {
    /// A transforms.json of instant-ngp, nerfstudio or Blender, a model of COLMAP, the folder of either, or a USD
    /// stage.
    #[serde(with = "crate::app::paths")]
    pub input: PathBuf,
    /// Path of the camera of a USD stage; none for the only one.
    pub camera: Option<String>,
    /// Folder to write into.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// Folder to take the pictures from, by their names, or a pattern, or files in the order of the views, which may be
    /// videos; none for those of the capture.
    #[serde(with = "crate::app::paths")]
    pub pictures: Vec<PathBuf>,
    /// Frame of videos, counted from 0.
    pub frame: u32,
    /// True if the pictures are photographs, or frames of videos, of a medium in a dark room or before an evenly lit
    /// background: model and background are measured and stated, and the color space of integer samples is sRGB unless
    /// stated.
    pub photographs: bool,
    /// Description of the cameras.
    pub to: Target,
    /// Color space of PNG and JPEG pictures; none for what capture or picture states.
    pub color_space: Option<ColorSpace>,
    /// Radiance behind the volume, over which straight alpha is composited; none for that of the capture, else white.
    pub background: Option<[f32; 3]>,
    /// Use of the pixels under a mask; none if no picture has one.
    pub masked: Option<Masked>,
    /// Layer of EXR pictures, written alone; none to leave pictures as they are.
    pub layer: Option<String>,
    /// Place of the capture's world.
    #[serde(flatten)]
    pub placement: Placement,
    /// True to replace files that other settings wrote.
    pub overwrite: bool,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

/// Settings on which the capture does not depend.
const MANNER: [&str; 2] = ["overwrite", "max_memory"];

/// Description of cameras that is written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Target {
    /// A transforms.json.
    #[default]
    Transforms,
    /// A text model of COLMAP in sparse/0, with the pictures in images.
    Colmap,
}

use_case!(CaptureSettings => CaptureReport, limits);

impl Report for CaptureReport {}

impl CaptureSettings {
    /// Paths that the capture is made from.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        [&self.input].into_iter().chain(&self.pictures).map(PathBuf::as_path).collect()
    }

    /// Reads, converts and writes.
    ///
    /// # Errors
    /// If capture or pictures cannot be read or used, or files cannot be written.
    pub fn run(&self, context: &Context) -> Result<CaptureReport> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        let mut provenance = Provenance::begin(context).of("capture convert", self, &MANNER);
        outputs::folder(&self.output)?;
        let mut stated = self.stated()?;
        let sources: Vec<PathBuf> = stated.capture.frames.iter().map(|frame| frame.picture.clone()).collect();
        let videos = VideoFrames::take(&mut stated.capture, self.frame, &self.output)?;
        let named = |error| videos.named(error);
        let choices = Choices { layer: self.layer.as_deref(), masked: self.masked, limits: self.limits };
        let views = View::all(&stated, &choices).map_err(named)?;
        let files = captures::files(&self.input);
        let inputs = files.iter().chain(&sources).map(PathBuf::as_path);
        provenance.input(&captures::file(&self.input), inputs.clone())?;
        let warnings = self.warnings(&stated.capture);

        let (folder, main) = self.places();
        let picture = |i: usize| folder.join(format!("view_{i:03}.exr"));
        // COLMAP names pictures by their place in one folder, so that all of them go there.
        let written = |view: &View| self.to == Target::Colmap || view.changes(&choices);
        let new: Vec<PathBuf> =
            views.iter().enumerate().filter(|(_, view)| written(view)).map(|(i, _)| picture(i)).collect();
        self.refuse_overwrite(&main, &new, &provenance)?;
        let mut batch = Batch::new();
        self.folders(&folder, &main).into_iter().try_for_each(|folder| batch.make_folder(&folder))?;

        let bar = context.steps(views.len() as u64, "converting");
        let mut capture = stated.capture.clone();
        let mut setting = Setting::default();
        for (i, view) in views.iter().enumerate().filter(|(_, view)| written(view) || self.photographs) {
            let (camera, film) = view.convert(&stated.capture, &choices).map_err(named)?;
            if self.photographs {
                setting.add(&film);
            }
            if !written(view) {
                continue;
            }
            exr::write_picture(&batch.add(&picture(i))?, &film, &provenance.attributes(), exr::Half::None)?;
            capture.frames[i] = Frame { camera, picture: picture(i) };
            bar.inc(1);
        }
        drop(bar);
        let integer: Vec<_> = views.iter().filter_map(|view| view.integer(&stated.capture)).collect();
        if let Some(map) = self.placement.map(&capture)? {
            capture = moved(capture, map);
        }
        let setting = match self.photographs {
            true => Some(setting.state(&mut capture, self.background).map_err(|e| e.at(captures::file(&self.input)))?),
            false => None,
        };
        capture.color_space = None;
        provenance.lap();
        self.write(&capture, &main, &folder, &provenance, &mut batch)?;
        // Another run may have ended in the folder meanwhile.
        let _lock = atomic::lock_folder(&self.output);
        self.refuse_overwrite(&main, &new, &provenance)?;
        batch.commit()?;
        context.warn(&warnings);
        Ok(CaptureReport {
            output: main,
            views: views.len(),
            written: new.len(),
            undistorted: views.iter().filter(|view| view.distorted()).count(),
            integer: integer.len(),
            sizes: sizes(&capture),
            color_space: integer.first().map(|(_, space)| *space),
            setting,
            warnings,
            provenance,
        })
    }

    /// Returns the remarks on what the capture states, and on what is not written of it.
    fn warnings(&self, capture: &Capture) -> Vec<Warning> {
        let mut warnings = photos::remarks(capture);
        warnings.extend((self.to == Target::Colmap).then(|| {
            Warning::new(
                "COLMAP's model states no light model, background, near planes or scale of densities",
                "keep a transforms.json beside it, which states them",
            )
        }));
        warnings
    }

    /// Makes sure that the outputs replace neither inputs nor files that other settings wrote.
    fn refuse_overwrite(&self, main: &Path, pictures: &[PathBuf], provenance: &Provenance) -> Result<()> {
        pictures.iter().map(PathBuf::as_path).chain([main]).try_for_each(protected::check)?;
        if self.overwrite { Ok(()) } else { earlier::spare_captures(main, pictures, provenance) }
    }

    /// Reads the capture, with what the settings say otherwise.
    fn stated(&self) -> Result<StatedCapture> {
        let mut stated = match registry::sniff(&self.input)?.kind {
            FileKind::Usd => self.stage()?,
            _ if self.camera.is_some() => {
                return Err(Error::invalid("⟨camera⟩: this is no USD stage").at(&self.input).hint("leave it out"));
            }
            _ => captures::stated_within(&self.input, self.limits)?,
        };
        pictures::replace(&mut stated.capture, &self.pictures)?;
        let usual = self.photographs.then_some(ColorSpace::Srgb);
        stated.capture.color_space = self.color_space.or(stated.capture.color_space).or(usual);
        stated.capture.pictures = self.photographs.then_some(Pictures::Photographs).or(stated.capture.pictures);
        stated.capture.background = self.background.unwrap_or(stated.capture.background);
        Ok(stated)
    }

    /// Returns the folder of the pictures, and the file of the cameras.
    fn places(&self) -> (PathBuf, PathBuf) {
        match self.to {
            Target::Transforms => (self.output.clone(), self.output.join(FILE_NAME)),
            Target::Colmap => (self.output.join("images"), self.output.join("sparse/0/images.txt")),
        }
    }

    /// Reads the cameras of a USD stage, with the size of the pictures that they are given.
    fn stage(&self) -> Result<StatedCapture> {
        let stage = Stage::open(&self.input, self.limits)?;
        let mut views = Views { camera: self.camera.as_deref(), ..Views::default() };
        let mut capture = stage.capture(&views)?;
        pictures::replace(&mut capture, &self.pictures)?;
        if let Some(frame) = capture.frames.first() {
            views.size = Some(picture::header(&frame.picture)?.size.map(|side| side as u32));
        }
        let capture = stage.capture(&views)?;
        let optics = vec![LensAndMask::default(); capture.frames.len()];
        Ok(StatedCapture { capture, optics })
    }

    /// Returns the folders to be made, outer ones first.
    fn folders(&self, pictures: &Path, main: &Path) -> Vec<PathBuf> {
        let model = main.parent().unwrap_or(&self.output).to_path_buf();
        let sparse = model.parent().unwrap_or(&self.output).to_path_buf();
        match self.to {
            Target::Transforms => vec![self.output.clone()],
            Target::Colmap => vec![self.output.clone(), pictures.to_path_buf(), sparse, model],
        }
    }

    /// Writes the cameras.
    fn write(
        &self,
        capture: &Capture,
        main: &Path,
        pictures: &Path,
        provenance: &Provenance,
        batch: &mut Batch,
    ) -> Result<()> {
        match self.to {
            Target::Transforms => {
                let mut extra = Map::new();
                extra.insert("provenance".into(), json!(provenance));
                transforms::save_for(main, &batch.add(main)?, capture, &extra)
            }
            Target::Colmap => {
                let texts = colmap::save(capture, pictures).map_err(|e| e.at(main))?;
                for (name, text) in
                    [("images.txt", texts.images), ("cameras.txt", texts.cameras), ("points3D.txt", texts.points)]
                {
                    let waiting = batch.add(&main.with_file_name(name))?;
                    atomic::write_bytes(&waiting, text.as_bytes())?;
                }
                Ok(())
            }
        }
    }
}

/// Smallest and largest width and height of the pictures of a capture.
fn sizes(capture: &Capture) -> [[u32; 2]; 2] {
    let sides = |pick: fn(u32, u32) -> u32| {
        let sizes = capture.frames.iter().map(|f| [f.camera.width, f.camera.height]);
        sizes.reduce(|a, b| [pick(a[0], b[0]), pick(a[1], b[1])]).unwrap_or_default()
    };
    [sides(u32::min), sides(u32::max)]
}
