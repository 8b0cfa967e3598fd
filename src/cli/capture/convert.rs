//! `cumulo capture convert`: any capture to one that every command takes.

use super::photographs::Setting;
use super::pictures::{self, Choices, Masked, VideoFrames, View};
use super::placement::{Placement, moved};
use crate::app::checks::Warning;
use crate::app::outputs;
use crate::app::photos;
use crate::app::provenance::Provenance;
use crate::cli::memory::Memory;
use crate::cli::output::Output;
use crate::cli::words;
use crate::error::{Error, Result};
use crate::formats::atomic::{self, Batch};
use crate::formats::protected;
use crate::formats::transforms::{self, FILE_NAME};
use crate::formats::usd::{Stage, Views};
use crate::formats::views::{Optics, StatedCapture};
use crate::formats::{self, Format, captures, colmap, exr, picture};
use crate::scene::capture::{Capture, Frame, Pictures};
use crate::scene::color_space::ColorSpace;
use serde::Serialize;
use serde_json::{Map, json};
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Write a capture that every command takes: cameras without lens distortion and scene-linear EXRs
///
/// Pictures that a lens distorts are resampled, by bilinear interpolation of linear light, to a pinhole camera with the
/// same focal lengths, and cropped to the largest rectangle in which every pixel was seen. PNG and JPEG become EXRs by
/// their color space; straight alpha is composited over the background of the capture. EXRs in which nothing changes
/// stay where they are.
#[derive(Debug, clap::Args)]
pub struct Convert {
    /// transforms.json of instant-ngp, nerfstudio or Blender, a model of COLMAP, the folder of either, or a USD stage
    input: PathBuf,
    /// Camera of a USD stage, by its path (default: the only one)
    #[arg(long, value_name = "PRIM")]
    camera: Option<String>,
    /// Folder to write into
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
    /// Take the pictures from this folder, by their names, or from a pattern such as renders/view_####.exr or from
    /// these files, in the order of the views; files may be videos, which ffmpeg decodes
    #[arg(long, value_name = "FOLDER|PATTERN|FILE", num_args = 1..)]
    pictures: Vec<PathBuf>,
    /// Frame of videos, counted from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    frame: u32,
    /// The pictures are photographs, or frames of videos, of a medium in a dark room or before an evenly lit
    /// background: model and background are measured and stated, and the color space of integer samples is sRGB unless
    /// stated
    #[arg(long)]
    photographs: bool,
    /// Description of the cameras
    #[arg(long, value_enum, default_value_t = Target::Transforms)]
    to: Target,
    /// Color space of PNG and JPEG pictures: sRGB, linear or 'gamma 2.2' (default: what capture or picture states)
    #[arg(long, value_name = "NAME")]
    color_space: Option<ColorSpace>,
    /// Radiance behind the volume, over which straight alpha is composited (default: that of the capture, else white)
    #[arg(long, value_name = "R,G,B", value_parser = crate::cli::parse::color)]
    background: Option<[f32; 3]>,
    /// Use of the pixels under a mask
    #[arg(long, value_enum)]
    masked: Option<Masked>,
    /// Layer of EXR pictures, written alone (default: pictures stay as they are)
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    #[command(flatten)]
    placement: Placement,
    /// Replace files that another command wrote
    #[arg(long)]
    overwrite: bool,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

/// Description of cameras that is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Target {
    /// A transforms.json
    Transforms,
    /// A text model of COLMAP in sparse/0, with the pictures in images
    Colmap,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(in crate::cli) struct Report {
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    views: usize,
    /// Number of pictures that were written.
    written: usize,
    /// Number of pictures that were resampled to a pinhole camera.
    undistorted: usize,
    /// Number of pictures with integer samples.
    integer: usize,
    /// Smallest and largest width and height of the pictures in pixels.
    sizes: [[u32; 2]; 2],
    color_space: Option<ColorSpace>,
    /// Medium and background of photographs, in words.
    setting: Option<String>,
    warnings: Vec<Warning>,
    provenance: Provenance,
}

impl Convert {
    /// Paths that the command reads.
    pub(super) fn inputs(&self) -> Vec<&Path> {
        [&self.input].into_iter().chain(&self.pictures).map(PathBuf::as_path).collect()
    }

    /// Reads, converts, writes and reports.
    ///
    /// # Errors
    /// If capture or pictures cannot be read or used, or files cannot be written.
    pub(super) fn run(&self, output: &Output) -> Result<ExitCode> {
        let mut provenance = words::provenance("capture convert", output);
        let limits = self.memory.limits();
        outputs::folder(&self.output)?;
        let mut stated = self.stated()?;
        let sources: Vec<PathBuf> = stated.capture.frames.iter().map(|frame| frame.picture.clone()).collect();
        let videos = VideoFrames::take(&mut stated.capture, self.frame, &self.output)?;
        let named = |error| videos.named(error);
        let choices = Choices { layer: self.layer.as_deref(), masked: self.masked, limits };
        let views = View::all(&stated, &choices).map_err(named)?;
        let files = captures::files(&self.input);
        let inputs = files.iter().chain(&sources).map(PathBuf::as_path);
        provenance.input(&captures::file(&self.input), inputs.clone())?;
        let mut warnings = photos::remarks(&stated.capture);
        warnings.extend((self.to == Target::Colmap).then(|| {
            Warning::new(
                "COLMAP's model states no light model, background, near planes or scale of densities",
                "keep a transforms.json beside it, which states them",
            )
        }));

        let (folder, main) = self.places();
        let picture = |i: usize| folder.join(format!("view_{i:03}.exr"));
        // COLMAP names pictures by their place in one folder, so that all of them go there.
        let written = |view: &View| self.to == Target::Colmap || view.changes(&choices);
        let new: Vec<PathBuf> =
            views.iter().enumerate().filter(|(_, view)| written(view)).map(|(i, _)| picture(i)).collect();
        self.spare(&main, &new, &provenance)?;
        let mut batch = Batch::new();
        self.folders(&folder, &main).into_iter().try_for_each(|folder| batch.make_folder(&folder))?;

        let bar = output.steps(views.len() as u64, "converting");
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
            exr::write_picture(&batch.add(&picture(i))?, &film, &provenance.attributes(), false)?;
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
        self.spare(&main, &new, &provenance)?;
        batch.commit()?;
        output.warn(&warnings);
        let sides = |pick: fn(u32, u32) -> u32| {
            let sizes = capture.frames.iter().map(|f| [f.camera.width, f.camera.height]);
            sizes.reduce(|a, b| [pick(a[0], b[0]), pick(a[1], b[1])]).unwrap_or_default()
        };
        output.report(&Report {
            output: main,
            views: views.len(),
            written: new.len(),
            undistorted: views.iter().filter(|view| view.distorted()).count(),
            integer: integer.len(),
            sizes: [sides(u32::min), sides(u32::max)],
            color_space: integer.first().map(|(_, space)| *space),
            setting,
            warnings,
            provenance,
        })?;
        Ok(ExitCode::SUCCESS)
    }

    /// Makes sure that the outputs replace neither inputs nor files that another command wrote.
    fn spare(&self, main: &Path, pictures: &[PathBuf], provenance: &Provenance) -> Result<()> {
        pictures.iter().map(PathBuf::as_path).chain([main]).try_for_each(protected::check)?;
        if self.overwrite { Ok(()) } else { outputs::spare_captures(main, pictures, provenance) }
    }

    /// Reads the capture, with what the options say otherwise.
    fn stated(&self) -> Result<StatedCapture> {
        let limits = self.memory.limits();
        let mut stated = match formats::sniff(&self.input)? {
            Format::Usd => self.stage()?,
            _ if self.camera.is_some() => {
                return Err(Error::invalid("--camera: this is no USD stage").at(&self.input).hint("leave it out"));
            }
            _ => captures::stated_within(&self.input, limits)?,
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
        let stage = Stage::open(&self.input, self.memory.limits())?;
        let mut views = Views { camera: self.camera.as_deref(), ..Views::default() };
        let mut capture = stage.capture(&views)?;
        pictures::replace(&mut capture, &self.pictures)?;
        if let Some(frame) = capture.frames.first() {
            views.size = Some(picture::header(&frame.picture)?.size.map(|side| side as u32));
        }
        let capture = stage.capture(&views)?;
        let optics = vec![Optics::default(); capture.frames.len()];
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

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {} view(s)", self.output.display(), self.views)?;
        let [[w0, h0], [w1, h1]] = self.sizes;
        let sizes = if [w0, h0] == [w1, h1] { format!("{w0}x{h0}") } else { format!("{w0}x{h0} to {w1}x{h1}") };
        writeln!(
            f,
            "  pictures: {sizes}; {} written, {} stay where they are",
            self.written,
            self.views - self.written
        )?;
        if self.undistorted > 0 {
            writeln!(f, "  {} undistorted, cropped to what every pixel was seen in", self.undistorted)?;
        }
        if let Some(space) = self.color_space {
            writeln!(f, "  {} of integer samples, decoded from {space}", self.integer)?;
        }
        if let Some(setting) = &self.setting {
            writeln!(f, "  {setting}")?;
        }
        crate::app::run::write_warnings(f, &self.warnings)
    }
}
