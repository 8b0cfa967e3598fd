//! `cumulo render`: pictures of a volume from many sides, as a capture.

use super::memory::Memory;
use super::output::Output;
use super::outputs;
use super::parse::{self, DensityScale};
use super::provenance::Provenance;
use super::scene::Scene;
use super::transfer::TransferOption;
use super::{cancel, volume};
use crate::error::{Error, Result};
use crate::formats::atomic::Batch;
use crate::formats::exr;
use crate::formats::limits::Limits;
use crate::formats::transforms::{self, FILE_NAME};
use crate::render::aov::{self, Aov};
use crate::render::quadrature::Quadrature;
use crate::render::scale;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, EmissionModel, Frame, Model, PixelFilter};
use crate::scene::medium::Source;
use crate::scene::orbit::{self, Layout};
use crate::scene::transfer::Transfer;
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
    /// What is seen (default: that of --cameras, emission-absorption with a transfer function, else absorption)
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
    /// Integration along rays: exact, preintegrated, preintegrated:TOLERANCE (of the density, in units of the range of
    /// the transfer function's points; 0.002 unless given), midpoint:STEP or riemann:STEP, steps in voxels (default:
    /// preintegrated with a transfer function, else exact)
    #[arg(long, value_name = "Q")]
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

/// Where rays end, and what that costs.
#[derive(Debug, Clone, Copy, Serialize)]
struct EarlyStop {
    transmittance: f64,
    /// Bound of the error in any channel of a pixel, in its units.
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
        let asked = self.cameras.as_deref().map(transforms::load).transpose()?;
        let asked_pictures: Option<Vec<PathBuf>> =
            asked.as_ref().map(|c| c.frames.iter().map(|f| f.picture.clone()).collect());
        let (mut scene, transfer) = self.scene(asked.as_ref(), limits)?;
        provenance.input(&self.input, [self.input.as_path()])?;
        if let Some(tf) = &self.transfer.tf {
            provenance.input(tf, [tf.as_path()])?;
        }
        let capture = self.capture(&scene, transfer, asked)?;
        // Pixels with their planes as they are rendered, as they are kept and as they are written.
        let planes = if self.aov.is_empty() { 0 } else { aov::PIXEL_BYTES + 2 * 4 * 5 };
        fits(&capture, planes, limits.max_memory)?;
        if self.aov.contains(&Aov::Variance) && self.supersample < 2 {
            return Err(Error::invalid("--aov variance: one ray a pixel has no variance")
                .hint("give each pixel more of them: --supersample 4"));
        }

        let json = self.output.join(FILE_NAME);
        self.spare(&json, &capture, asked_pictures.as_deref().unwrap_or_default(), &provenance)?;
        // Pictures wait until all are there: an interrupted run must not mix its pictures with those of an earlier one.
        let mut batch = Batch::new();
        batch.make_folder(&self.output)?;
        let waiting = capture.frames.iter().map(|f| batch.add(&f.picture)).collect::<Result<Vec<_>>>()?;
        let waiting_json = batch.add(&json)?;
        let quadrature = self.quadrature.unwrap_or(Quadrature::usual(capture.transfer.is_some()));
        let renderer = scene.renderer(&capture, quadrature).map_err(|e| e.at(&self.input))?.early_stop(self.early_stop);
        let early_stop = EarlyStop { transmittance: self.early_stop, error_bound: renderer.left_out() };
        let bar = output.progress(capture.frames.len() as u64, "render");
        let attributes = provenance.attributes();
        capture.frames.par_iter().zip(&waiting).try_for_each(|(frame, waiting)| {
            let rays = self.supersample as usize;
            let film = match &self.aov[..] {
                [] => renderer.picture(&frame.camera, rays, cancel),
                aovs => renderer.picture_with(&frame.camera, rays, aovs, cancel),
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

    /// Makes sure that nothing is replaced that is read, or that another command made.
    fn spare(&self, json: &Path, capture: &Capture, asked: &[PathBuf], provenance: &Provenance) -> Result<()> {
        self.spare_the_given(asked)?;
        let pictures: Vec<PathBuf> = capture.frames.iter().map(|f| f.picture.clone()).collect();
        let inputs = [Some(&self.input), self.transfer.tf.as_ref()].into_iter().flatten().chain(asked);
        let outputs = pictures.iter().map(PathBuf::as_path).chain([json]);
        outputs::spare(outputs, inputs.map(PathBuf::as_path))?;
        if self.overwrite { Ok(()) } else { outputs::spare_captures(json, &pictures, &provenance.command) }
    }

    /// The pictures of `--cameras` must not be replaced by ours.
    fn spare_the_given(&self, pictures: &[PathBuf]) -> Result<()> {
        let Some(given) = &self.cameras else { return Ok(()) };
        let json = transforms::json_path(given);
        let folder = |path: &Path| {
            let parent = path.parent().map(|p| if p.as_os_str().is_empty() { Path::new(".") } else { p });
            parent.and_then(|p| std::fs::canonicalize(p).ok())
        };
        let ours = std::fs::canonicalize(&self.output).ok();
        let theirs = pictures.iter().map(PathBuf::as_path).chain([json.as_path()]);
        if ours.is_some() && theirs.map(folder).any(|theirs| theirs == ours) {
            return Err(Error::invalid("the pictures of --cameras lie in this folder and would be replaced")
                .at(&self.output)
                .hint("give another folder with --output"));
        }
        Ok(())
    }

    /// The transfer function that the pictures will show: the one asked for, else that of `--cameras`, else
    /// the one that the grid carries; none for other models.
    fn transfer(&self, found: Option<Transfer>, asked: Option<&Capture>) -> Option<Transfer> {
        if self.transfer.tf.is_some() {
            return found;
        }
        let emits = |m: Model| m == Model::EmissionAbsorption;
        let other = self.model.is_some_and(|m| !emits(m)) || self.emission.is_some() || self.emission_model.is_some();
        match asked {
            _ if other => None,
            Some(capture) if self.model.is_none() || emits(capture.model) => {
                capture.transfer.clone().filter(|_| emits(capture.model))
            }
            _ => found,
        }
    }

    /// The volume, with the transfer function that is seen through.
    fn scene(&self, asked: Option<&Capture>, limits: Limits) -> Result<(Scene, Option<Transfer>)> {
        if self.model.or(asked.map(|c| c.model)) == Some(Model::PreShaded) && self.transfer.tf.is_none() {
            return Ok((Scene::pre_shaded(&self.input, self.grid.as_deref(), limits)?, None));
        }
        let (grid, transfer) = volume::read(&self.input, self.grid.as_deref(), &self.transfer, limits)?;
        let transfer = self.transfer(transfer, asked);
        let field = volume::arrange(&grid, transfer.as_ref(), limits).map_err(|e| e.at(&self.input))?;
        Ok((Scene::Density(field), transfer))
    }

    /// What the pictures will show, from the options and, where they are silent, from `--cameras`.
    fn capture(&self, scene: &Scene, transfer: Option<Transfer>, asked: Option<Capture>) -> Result<Capture> {
        let field = &*scene.extinctions();
        let cameras: Vec<Camera> = match (&asked, self.views) {
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
        let density_scale = match (self.density_scale, &asked) {
            (Some(DensityScale::Given(s)), _) => s,
            (Some(DensityScale::Auto), _) => scale::density_scale(field, &source, &cameras).ok_or_else(|| {
                Error::invalid("no pixel meets any density, so that no scale can be found")
                    .at(&self.input)
                    .hint("check the grid and the cameras, or give the scale as a number")
            })?,
            // A pre-shaded volume's extinctions are those of the pictures that it explains.
            (None, Some(capture)) if matches!(scene, Scene::Density(_)) || capture.model == Model::PreShaded => {
                capture.density_scale
            }
            (None, _) => 1.0,
        };
        let asked = asked.as_ref();
        let given = self.model.or(transfer.as_ref().map(|_| Model::EmissionAbsorption));
        let given = given.or(matches!(scene, Scene::PreShaded(_)).then_some(Model::PreShaded));
        let model = given.or(asked.map(|c| c.model)).unwrap_or(Model::Absorption);
        // The other model's background would be a surprise: white light behind a bright source.
        let same = asked.filter(|c| (c.model == Model::Absorption) == (model == Model::Absorption));
        let behind = if model == Model::Absorption { [1.0; 3] } else { [0.0; 3] };
        let frames = cameras
            .into_iter()
            .enumerate()
            .map(|(i, camera)| Frame { camera, picture: self.output.join(format!("view_{i:03}.exr")) });
        Ok(Capture {
            frames: frames.collect(),
            model,
            background: self.background.or(same.map(|c| c.background)).unwrap_or(behind),
            pixel_filter: if self.supersample > 1 { PixelFilter::Box } else { PixelFilter::Point },
            density_scale,
            emission: self.emission.or(asked.map(|c| c.emission)).unwrap_or([1.0; 3]),
            emission_model: self.emission_model.or(asked.map(|c| c.emission_model)).unwrap_or(EmissionModel::Grey),
            transfer,
            lattice: Some(field.transform.matrix()),
        })
    }
}

/// Refuses pictures that could not be held in memory: their pixels, the file's samples and its bytes, and
/// so many bytes a pixel for further planes, for each thread.
pub(super) fn fits(capture: &Capture, planes: u64, max_memory: u64) -> Result<()> {
    let at_once = rayon::current_num_threads().min(capture.frames.len()) as u64;
    let pixels = |f: &Frame| u64::from(f.camera.width) * u64::from(f.camera.height);
    match capture.frames.iter().max_by_key(|f| pixels(f)) {
        Some(f) if pixels(f) * (48 + planes) * at_once > max_memory => {
            let Camera { width, height, .. } = f.camera;
            Err(Error::unsupported(format!("{at_once} pictures of {width}x{height} pixels do not fit in memory"))
                .at(&f.picture)
                .hint("choose a smaller --size, fewer --threads, or raise --max-memory"))
        }
        _ => Ok(()),
    }
}
