//! `cumulo render`: pictures of a volume from many sides, as a capture.

use super::memory::Memory;
use super::output::Output;
use super::outputs;
use super::parse::{self, DensityScale};
use super::provenance::Provenance;
use super::transfer::TransferOption;
use super::{cancel, volume};
use crate::error::{Error, Result};
use crate::formats::atomic::Batch;
use crate::formats::exr;
use crate::formats::limits::Limits;
use crate::formats::transforms::{self, FILE_NAME};
use crate::render::any_renderer::AnyRenderer;
use crate::render::aov::{self, Aov};
use crate::render::quadrature::{Quadrature, rules};
use crate::render::scale;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, EmissionModel, Frame, Model, PixelFilter};
use crate::scene::medium::Source;
use crate::scene::orbit::{self, Layout};
use crate::scene::scene::Scene;
use crate::scene::transfer::Transfer;
use crate::scene::volume::Grids;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

/// Render a volume from many sides: a capture of EXR pictures and transforms.json
///
/// Pictures are 32-bit float, scene-linear, alpha = 1 - transmittance. Absorption shows the background through the
/// volume; emission-absorption adds the light of a source that is part of it.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("from").required(true).args(["views", "cameras"]))]
pub struct Render {
    /// VDB to render
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
    pub(in crate::cli) memory: Memory,
}

#[derive(Debug, Serialize)]
struct Report {
    #[serde(serialize_with = "crate::cli::paths::text")]
    output: PathBuf,
    views: usize,
    model: Model,
    density_scale: f64,
    quadrature: String,
    early_stop: EarlyStop,
    seconds: f64,
}

/// Transmittance at which rays end, and the error that this makes.
#[derive(Debug, Clone, Copy, Serialize)]
struct EarlyStop {
    /// Transmittance below which rays end; 0 for never.
    transmittance: f64,
    /// Bound of the error in any channel of a pixel, in the channel's units.
    error_bound: f64,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let json = self.output.join(FILE_NAME);
        let Self { views, seconds, density_scale, quadrature, early_stop, .. } = self;
        writeln!(f, "{}: {views} views in {seconds:.2} s, density scale {density_scale}", json.display())?;
        let EarlyStop { transmittance, error_bound } = early_stop;
        write!(f, "  {quadrature}; rays end at transmittance {transmittance:e}, off by {error_bound:.1e} at most")
    }
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
        let (grids, transfer) = self.grids(template.as_ref(), limits)?;
        provenance.input(&self.input, [self.input.as_path()])?;
        if let Some(tf) = &self.transfer.tf {
            provenance.input(tf, [tf.as_path()])?;
        }
        let capture = self.capture(&grids, transfer, template)?;
        // Bytes a pixel of further planes as they are rendered, as they are kept and as they are written.
        let planes = if self.aov.is_empty() { 0 } else { aov::PIXEL_BYTES + 2 * 4 * 5 };
        fits(&capture, planes, limits.max_memory)?;
        if self.aov.contains(&Aov::Variance) && self.supersample < 2 {
            return Err(Error::invalid("--aov variance: one ray a pixel has no variance")
                .hint("give each pixel more of them: --supersample 4"));
        }

        let json = self.output.join(FILE_NAME);
        self.spare(&json, &capture, template_pictures.as_deref().unwrap_or_default(), &provenance)?;
        // Pictures wait until all are there: an interrupted run must not mix its pictures with those of an earlier one.
        let mut batch = Batch::new();
        batch.make_folder(&self.output)?;
        let waiting = capture.frames.iter().map(|f| batch.add(&f.picture)).collect::<Result<Vec<_>>>()?;
        let waiting_json = batch.add(&json)?;
        let quadrature = self.quadrature.unwrap_or(Quadrature::usual(capture.transfer.is_some()));
        let scene = Scene::shown_by(&capture, grids).map_err(|e| e.at(&self.input))?;
        let renderer = AnyRenderer::new(&scene, quadrature).map_err(|e| e.at(&self.input))?.early_stop(self.early_stop);
        let early_stop = EarlyStop { transmittance: self.early_stop, error_bound: renderer.left_out() };
        let bar = output.progress(capture.frames.len() as u64, "render");
        let attributes = provenance.attributes();
        scene.cameras.par_iter().zip(&waiting).try_for_each(|(camera, waiting)| {
            let rays = self.supersample as usize;
            let film = match &self.aov[..] {
                [] => renderer.picture(camera, rays, cancel),
                aovs => renderer.picture_with(camera, rays, aovs, cancel),
            };
            let film = film.ok_or_else(Error::cancelled)?;
            exr::write_picture(waiting, &film, &attributes, false)?;
            bar.inc(1);
            Ok::<_, Error>(())
        })?;
        bar.finish_and_clear();
        let seconds = provenance.lap();
        let mut extra = Map::new();
        extra.insert("provenance".into(), json!(provenance));
        extra.insert("quadrature".into(), Value::String(quadrature.to_string()));
        extra.insert("early_stop".into(), json!(early_stop));
        transforms::save_for(&json, &waiting_json, &capture, &extra)?;
        batch.commit()?;
        output.report(&Report {
            output: self.output.clone(),
            views: capture.frames.len(),
            model: capture.model,
            density_scale: capture.density_scale,
            quadrature: quadrature.to_string(),
            early_stop,
            seconds,
        })?;
        Ok(ExitCode::SUCCESS)
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

    /// Chooses the transfer function that the pictures will show: `loaded` if it is that of `--tf`, else that of `--cameras`, else
    /// the one that the grid carries, which is `loaded` then; none for other models.
    fn transfer(&self, loaded: Option<Transfer>, template: Option<&Capture>) -> Option<Transfer> {
        if self.transfer.tf.is_some() {
            return loaded;
        }
        let emits = |m: Model| m == Model::EmissionAbsorption;
        let other = self.model.is_some_and(|m| !emits(m)) || self.emission.is_some() || self.emission_model.is_some();
        match template {
            _ if other => None,
            Some(capture) if self.model.is_none() || emits(capture.model) => {
                capture.transfer.clone().filter(|_| emits(capture.model))
            }
            _ => loaded,
        }
    }

    /// Reads the volume's grids, and returns them with the transfer function that the pictures will show.
    fn grids(&self, template: Option<&Capture>, limits: Limits) -> Result<(Grids, Option<Transfer>)> {
        if self.model.or(template.map(|c| c.model)) == Some(Model::PreShaded) && self.transfer.tf.is_none() {
            return Ok((volume::read_pre_shaded(&self.input, self.grid.as_deref(), limits)?, None));
        }
        let (grid, loaded) = volume::read(&self.input, self.grid.as_deref(), &self.transfer, limits)?;
        let transfer = self.transfer(loaded, template);
        let field = volume::arrange(&grid, transfer.as_ref(), limits).map_err(|e| e.at(&self.input))?;
        Ok((Grids::Density(field), transfer))
    }

    /// Plans the capture to render: cameras, model and medium from the options and, where they are silent, from `--cameras`.
    fn capture(&self, grids: &Grids, transfer: Option<Transfer>, template: Option<Capture>) -> Result<Capture> {
        let field = &*grids.density_or_extinction();
        let cameras: Vec<Camera> = match (&template, self.views) {
            (Some(capture), _) => capture.frames.iter().map(|f| f.camera).collect(),
            (None, count) => {
                let outline = field.outline();
                if outline.is_empty() {
                    return Err(Error::invalid("the grid is empty: there is nothing to place cameras around")
                        .at(&self.input)
                        .hint("choose another grid with --grid, or give the cameras with --cameras"));
                }
                let [w, h] = self.size;
                orbit::cameras(&outline, count.unwrap_or(1) as usize, self.layout, w, h, self.fov)
            }
        };
        let source = match &transfer {
            Some(transfer) => Source::Transfer(Arc::new(transfer.table()?)),
            None => Source::Grey([0.0; 3]),
        };
        let density_scale = match (self.density_scale, &template) {
            (Some(DensityScale::Given(s)), _) => s,
            (Some(DensityScale::Auto), _) => scale::density_scale(field, &source, &cameras).ok_or_else(|| {
                Error::invalid("no pixel meets any density, so that no scale can be found")
                    .at(&self.input)
                    .hint("check the grid and the cameras, or give the scale as a number")
            })?,
            // A pre-shaded volume's extinctions are those of the pictures that it explains.
            (None, Some(capture)) if matches!(grids, Grids::Density(_)) || capture.model == Model::PreShaded => {
                capture.density_scale
            }
            (None, _) => 1.0,
        };
        let template = template.as_ref();
        let of_volume = match grids {
            Grids::EmissionExtinction(_) => Some(Model::PreShaded),
            Grids::Density(_) => transfer.as_ref().map(|_| Model::EmissionAbsorption),
        };
        let model = self.model.or(of_volume).or(template.map(|c| c.model)).unwrap_or(Model::Absorption);
        // The other model's background would be a surprise: white light behind a bright source.
        let same_model = template.filter(|c| (c.model == Model::Absorption) == (model == Model::Absorption));
        let default_background = if model == Model::Absorption { [1.0; 3] } else { [0.0; 3] };
        let frames = cameras
            .into_iter()
            .enumerate()
            .map(|(i, camera)| Frame { camera, picture: self.output.join(format!("view_{i:03}.exr")) });
        Ok(Capture {
            frames: frames.collect(),
            model,
            background: self.background.or(same_model.map(|c| c.background)).unwrap_or(default_background),
            pixel_filter: if self.supersample > 1 { PixelFilter::Box } else { PixelFilter::Point },
            density_scale,
            emission: self.emission.or(template.map(|c| c.emission)).unwrap_or([1.0; 3]),
            emission_model: self.emission_model.or(template.map(|c| c.emission_model)).unwrap_or(EmissionModel::Grey),
            transfer,
            lattice: Some(field.transform.matrix()),
        })
    }
}

/// Refuses pictures that do not fit in memory, one for each thread: pixels, samples and bytes of the file, and
/// `plane_bytes` a pixel for further planes.
pub(super) fn fits(capture: &Capture, plane_bytes: u64, max_memory: u64) -> Result<()> {
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
