//! `cumulo render`: pictures of a volume from many sides, as a capture.

mod capture;
mod scattering;
mod subject;

use crate::cli::cancel;
use crate::cli::memory::Memory;
use crate::cli::output::Output;
use crate::cli::outputs;
use crate::cli::parse::{self, DensityScale};
use crate::cli::provenance::Provenance;
use crate::cli::transfer::TransferOption;
use crate::error::{Error, Result};
use crate::formats::atomic::Batch;
use crate::formats::exr;
use crate::formats::transforms::{self, FILE_NAME};
use crate::render::any_renderer::AnyRenderer;
use crate::render::aov::{self, Aov};
use crate::render::path::{self, Counts, PathTracer};
use crate::render::quadrature::{Quadrature, rules};
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, EmissionModel, Frame, Model};
use crate::scene::film::Film;
use crate::scene::orbit::Layout;
use clap::ValueEnum;
use rayon::prelude::*;
use scattering::{Paths, ScatteringOptions};
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;

/// Render a volume from many sides: a capture of EXR pictures and transforms.json
///
/// Pictures are 32-bit float, scene-linear, alpha = 1 - transmittance. Absorption shows the background through the
/// volume; emission-absorption adds the light of a source that is part of it; with --albedo light is scattered, and
/// pictures are made by path tracing.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("from").required(true).args(["views", "cameras"]))]
pub struct Render {
    /// VDB, or scene file in JSON (`cumulo schema scene`), to render
    input: PathBuf,
    /// Folder for transforms.json and the pictures
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
    /// Replace a capture in the folder, whoever made it (one of the very same command is replaced without)
    #[arg(long)]
    overwrite: bool,
    /// Place this many cameras around the volume
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    views: Option<u32>,
    /// How --views are placed: over the whole sphere, or on the horizontal circle
    #[arg(long, value_enum, default_value_t = Layout::Sphere, conflicts_with = "cameras")]
    layout: Layout,
    /// Size of the pictures of --views in pixels
    #[arg(long, value_name = "WxH", default_value = "256x256", value_parser = parse::size, conflicts_with = "cameras")]
    size: [u32; 2],
    /// Angle in degrees that the volume takes in the pictures of --views
    #[arg(long, value_name = "DEGREES", default_value_t = 40.0, value_parser = parse::angle, conflicts_with = "cameras")]
    fov: f64,
    /// Take cameras, and what else is not given, from a transforms.json
    #[arg(long, value_name = "CAPTURE")]
    cameras: Option<PathBuf>,
    /// Model of the pictures (default: that of --cameras, emission-absorption with a transfer function, else absorption)
    #[arg(long, value_enum, conflicts_with = "tf")]
    model: Option<Model>,
    /// Extinction per unit of density and length; auto makes the 99th percentile of the optical depth 3
    /// (default: that of --cameras, else 1)
    #[arg(long, value_name = "S|auto")]
    density_scale: Option<DensityScale>,
    /// Radiance behind the volume, r,g,b (default: that of --cameras, else white for absorption, black for
    /// emission-absorption)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color)]
    background: Option<[f32; 3]>,
    /// Radiance of the source, r,g,b (default: that of --cameras, else white)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color, conflicts_with = "tf")]
    emission: Option<[f32; 3]>,
    /// How that radiance follows the density (default: that of --cameras, else grey: not at all)
    #[arg(long, value_enum, conflicts_with = "tf")]
    emission_model: Option<EmissionModel>,
    #[command(flatten)]
    transfer: TransferOption,
    #[arg(
        long,
        value_name = "Q",
        help = concat!(
            "Integration along rays: ",
            rules!(),
            "; by default preintegrated with a transfer function, else exact",
        )
    )]
    quadrature: Option<Quadrature>,
    /// Transmittance at which rays end (0: never); the report says how far that may be off
    #[arg(long, value_name = "T", default_value_t = 1e-6, value_parser = parse::share)]
    early_stop: f64,
    /// Rays along each edge of a pixel; more than one make it the mean over its square
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    supersample: u32,
    /// Planes to write beside RGBA, one or more
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    aov: Vec<Aov>,
    /// Grid to render (default: density, else the only scalar one)
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    #[command(flatten)]
    scattering: ScatteringOptions,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

#[derive(Debug, Serialize)]
struct Report {
    #[serde(serialize_with = "crate::cli::paths::text")]
    output: PathBuf,
    views: usize,
    model: Model,
    density_scale: f64,
    #[serde(flatten)]
    way: Way,
    seconds: f64,
}

/// How light was integrated.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Way {
    /// Along straight rays.
    Dvr { quadrature: String, early_stop: EarlyStop },
    /// Along paths.
    Paths { paths: Paths },
}

/// Transmittance at which rays end, and the error that this makes.
#[derive(Debug, Clone, Copy, Serialize)]
struct EarlyStop {
    /// Transmittance below which rays end; 0 for never.
    transmittance: f64,
    /// Bound of the error in any channel of a pixel, in the channel's units.
    error_bound: f64,
}

impl Way {
    /// Adds what a capture records of how its pictures were made.
    fn record(&self, scattering: &ScatteringOptions, extra: &mut Map<String, Value>) {
        match self {
            Self::Dvr { quadrature, early_stop } => {
                extra.insert("quadrature".into(), json!(quadrature));
                extra.insert("early_stop".into(), json!(early_stop));
            }
            Self::Paths { .. } => {
                extra.insert("scattering".into(), scattering.record());
            }
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let json = self.output.join(FILE_NAME);
        let Self { views, seconds, density_scale, way, .. } = self;
        writeln!(f, "{}: {views} views in {seconds:.2} s, density scale {density_scale}", json.display())?;
        match way {
            Way::Dvr { quadrature, early_stop: EarlyStop { transmittance, error_bound } } => {
                write!(
                    f,
                    "  {quadrature}; rays end at transmittance {transmittance:e}, off by {error_bound:.1e} at most"
                )
            }
            Way::Paths { paths } => write!(f, "{paths}"),
        }
    }
}

/// The renderer of a scene.
enum Renderer<'a> {
    Dvr(AnyRenderer<'a>),
    Paths(PathTracer<'a>),
}

impl Render {
    /// Reads, renders, writes and reports.
    ///
    /// # Errors
    /// If the volume or the cameras cannot be used, or the folder cannot be written to; an earlier
    /// capture in the folder is untouched then.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        outputs::folder(&self.output)?;
        let cancel = cancel::listen();
        let mut provenance = Provenance::begin();
        let limits = self.memory.limits();
        let template = self.cameras.as_deref().map(transforms::load).transpose()?;
        let template_pictures: Option<Vec<PathBuf>> =
            template.as_ref().map(|c| c.frames.iter().map(|f| f.picture.clone()).collect());
        let (subject, transfer) = self.subject(template.as_ref(), limits, &mut provenance)?;
        let paths = self.scattering.on() || subject.is_scene();
        let capture = self.capture(&subject, transfer, template.as_ref())?;
        // Bytes a pixel of further planes as they are rendered, as they are kept and as they are written.
        let planes = match paths {
            true => path::PIXEL_BYTES + 2 * 4 * 25,
            false if self.aov.is_empty() => 0,
            false => aov::PIXEL_BYTES + 2 * 4 * 5,
        };
        fits(&capture, planes, limits.max_memory)?;
        self.check_aovs(paths)?;
        self.scattering.check(paths)?;

        let json = self.output.join(FILE_NAME);
        self.spare(&json, &capture, template_pictures.as_deref().unwrap_or_default(), &provenance)?;
        // Pictures wait until all are there: an interrupted run must not mix its pictures with those of an earlier one.
        let mut batch = Batch::new();
        batch.make_folder(&self.output)?;
        let waiting = capture.frames.iter().map(|f| batch.add(&f.picture)).collect::<Result<Vec<_>>>()?;
        let waiting_json = batch.add(&json)?;
        let quadrature = self.quadrature.unwrap_or(Quadrature::usual(capture.transfer.is_some()));
        let scene = self.scene(&capture, subject).map_err(|e| e.at(&self.input))?;
        let renderer = match paths {
            true => self.scattering.tracer(&scene, self.background).map(Renderer::Paths),
            false => AnyRenderer::new(&scene, quadrature).map(|dvr| Renderer::Dvr(dvr.early_stop(self.early_stop))),
        };
        let renderer = renderer.map_err(|e| e.at(&self.input))?;
        let bar = output.progress(capture.frames.len() as u64, "render");
        let attributes = provenance.attributes();
        let views: Vec<_> = scene.cameras.iter().zip(&waiting).enumerate().collect();
        let counts = views.into_par_iter().map(|(view, (camera, waiting))| {
            let (film, counts) = self.film(&renderer, view, camera, cancel).ok_or_else(Error::cancelled)?;
            exr::write_picture(waiting, &film, &attributes, false)?;
            bar.inc(1);
            Ok::<_, Error>(counts)
        });
        let counts = counts.try_reduce(Counts::default, |a, b| Ok(a.plus(b)))?;
        bar.finish_and_clear();
        let seconds = provenance.lap();
        let mut extra = Map::new();
        extra.insert("provenance".into(), json!(provenance));
        let way = self.way(&renderer, quadrature, counts);
        way.record(&self.scattering, &mut extra);
        transforms::save_for(&json, &waiting_json, &capture, &extra)?;
        batch.commit()?;
        output.report(&Report {
            output: self.output.clone(),
            views: capture.frames.len(),
            model: capture.model,
            density_scale: capture.density_scale,
            way,
            seconds,
        })?;
        Ok(ExitCode::SUCCESS)
    }

    /// Returns how light was integrated, with the events that were counted.
    fn way(&self, renderer: &Renderer<'_>, quadrature: Quadrature, counts: Counts) -> Way {
        match renderer {
            Renderer::Dvr(dvr) => Way::Dvr {
                quadrature: quadrature.to_string(),
                early_stop: EarlyStop { transmittance: self.early_stop, error_bound: dvr.left_out() },
            },
            Renderer::Paths(_) => Way::Paths { paths: self.scattering.paths(counts) },
        }
    }

    /// Refuses planes that the renderer does not have.
    fn check_aovs(&self, paths: bool) -> Result<()> {
        let name = |aov: &Aov| aov.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned());
        if let Some(aov) = self.aov.iter().find(|aov| aov.of_paths() && !paths) {
            return Err(Error::invalid(format!("--aov {}: nothing is scattered", name(aov)))
                .hint("planes of scattered light need path tracing: give --albedo"));
        }
        let (rays, option) = match paths {
            true => (self.scattering.sampling(0).samples, "--samples 16"),
            false => (self.supersample, "--supersample 4"),
        };
        if rays < 2
            && let Some(aov) = self.aov.iter().find(|aov| matches!(aov, Aov::Variance | Aov::Halves))
        {
            return Err(Error::invalid(format!("--aov {}: one ray a pixel has no variance", name(aov)))
                .hint(format!("give each pixel more of them: {option}")));
        }
        Ok(())
    }

    /// Renders a view. Returns `None` if `cancel` was set.
    fn film(
        &self,
        renderer: &Renderer<'_>,
        view: usize,
        camera: &Camera,
        cancel: &AtomicBool,
    ) -> Option<(Film, Counts)> {
        match (renderer, &self.aov[..]) {
            (Renderer::Paths(paths), aovs) => {
                let picture = paths.picture(camera, self.scattering.sampling(view), aovs, cancel)?;
                Some((picture.film, picture.counts))
            }
            (Renderer::Dvr(dvr), aovs) => {
                let rays = self.supersample as usize;
                let film = match aovs {
                    [] => dvr.picture(camera, rays, cancel),
                    aovs => dvr.picture_with(camera, rays, aovs, cancel),
                };
                Some((film?, Counts::default()))
            }
        }
    }

    /// Makes sure that the outputs replace neither inputs, the pictures of `--cameras` among them, nor files that another
    /// command wrote.
    fn spare(
        &self,
        json: &Path,
        capture: &Capture,
        template_pictures: &[PathBuf],
        provenance: &Provenance,
    ) -> Result<()> {
        self.spare_template(template_pictures)?;
        let pictures: Vec<PathBuf> = capture.frames.iter().map(|f| f.picture.clone()).collect();
        let inputs = [Some(&self.input), self.transfer.tf.as_ref()].into_iter().flatten().chain(template_pictures);
        let outputs = pictures.iter().map(PathBuf::as_path).chain([json]);
        outputs::spare(outputs, inputs.map(PathBuf::as_path))?;
        if self.overwrite { Ok(()) } else { outputs::spare_captures(json, &pictures, &provenance.command) }
    }

    /// Refuses an output folder in which the capture of `--cameras` or its pictures lie.
    fn spare_template(&self, pictures: &[PathBuf]) -> Result<()> {
        let Some(cameras) = &self.cameras else { return Ok(()) };
        let json = transforms::json_path(cameras);
        let folder = |path: &Path| {
            let parent = path.parent().map(|p| if p.as_os_str().is_empty() { Path::new(".") } else { p });
            parent.and_then(|p| std::fs::canonicalize(p).ok())
        };
        let output = std::fs::canonicalize(&self.output).ok();
        let template = pictures.iter().map(PathBuf::as_path).chain([json.as_path()]);
        if output.is_some() && template.map(folder).any(|folder| folder == output) {
            return Err(Error::invalid("the pictures of --cameras lie in this folder and would be replaced")
                .at(&self.output)
                .hint("give another folder with --output"));
        }
        Ok(())
    }
}

/// Refuses pictures that do not fit in memory, one for each thread: pixels, samples and bytes of the file, and
/// `plane_bytes` a pixel for further planes.
pub(in crate::cli) fn fits(capture: &Capture, plane_bytes: u64, max_memory: u64) -> Result<()> {
    let at_once = rayon::current_num_threads().min(capture.frames.len()) as u64;
    let pixels = |f: &Frame| u64::from(f.camera.width) * u64::from(f.camera.height);
    match capture.frames.iter().max_by_key(|f| pixels(f)) {
        Some(f) if pixels(f) * (48 + plane_bytes) * at_once > max_memory => {
            let Camera { width, height, .. } = f.camera;
            Err(Error::unsupported(format!("{at_once} pictures of {width}x{height} pixels do not fit in memory"))
                .at(&f.picture)
                .hint("choose a smaller --size, fewer --threads, or raise --max-memory"))
        }
        _ => Ok(()),
    }
}
