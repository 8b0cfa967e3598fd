//! `cumulo usd author`: a stage of volumes, with their media, lights and cameras.

mod cameras;
mod content;
mod report;
mod volumes;

use crate::app::outputs::{self, Content as Kind};
use crate::app::pictures::scattering::Sky;
use crate::app::provenance::Provenance;
use crate::app::up::UpChoice;
use crate::cli::memory::Memory;
use crate::cli::output::Output;
use crate::cli::parse;
use crate::error::{Error, Result};
use crate::formats::sequence::Frames;
use crate::formats::usd::write::camera::CameraPrim;
use crate::formats::usd::write::material;
use crate::formats::usd::write::names::Names;
use crate::formats::usd::write::places::relative;
use crate::formats::usd::write::stage::StageText;
use crate::formats::usd::write::text::quoted;
use crate::formats::usd::write::volume::VolumePrim;
use crate::formats::{atomic, captures, input, protected};
use crate::scene::up::Up;
use clap::ValueEnum;
use glam::DVec3;
pub(in crate::cli) use report::Report;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Largest stage in bytes that is looked at for the command that wrote it.
const MAX_BYTES: u64 = 1 << 28;

/// Write a stage of volumes, with their media, lights and cameras
///
/// The stage is text (.usda). Its paths are relative to it; a sequence has the numbers of its frames as time codes. The
/// medium stands at the volume as attributes `cumulo:…`, and as materials for other renderers in the variant set
/// `renderer`.
#[derive(Debug, clap::Args)]
pub struct Author {
    /// VDB, sequence such as smoke.####.vdb, or scene file (`cumulo schema scene`)
    input: PathBuf,
    /// Stage to write, a .usda
    #[arg(long, short, value_name = "STAGE")]
    output: PathBuf,
    /// Frames of a sequence, such as 1-24 (default: those that exist)
    #[arg(long, value_name = "FRAMES")]
    frames: Option<Frames>,
    /// Frames per second
    #[arg(long, value_name = "F", default_value_t = 24.0, value_parser = parse::positive)]
    fps: f64,
    /// Grids that become fields (default: all)
    #[arg(long, value_name = "NAME")]
    grid: Vec<String>,
    /// Grid of densities, related as field:density (default: density, else the only scalar one)
    #[arg(long, value_name = "NAME")]
    density: Option<String>,
    /// Axis that points upwards; coordinates stay as they are
    #[arg(long, alias = "up-axis", value_enum, ignore_case = true, default_value_t)]
    up: UpChoice,
    /// Meters to a unit; coordinates stay as they are
    #[arg(long, value_name = "M", default_value_t = 1.0, value_parser = parse::positive)]
    meters_per_unit: f64,
    /// Cameras of a capture, one prim for each view
    #[arg(long, value_name = "CAPTURE")]
    camera: Option<PathBuf>,
    /// Make them one camera that is at view N at the time code N
    #[arg(long, requires = "camera")]
    camera_path: bool,
    /// Extinction per unit of density and length (default: 1)
    #[arg(long, value_name = "S", value_parser = parse::positive)]
    density_scale: Option<f64>,
    /// Share of the extinction that is scattered, one number or r,g,b from 0 to 1 (default: 0)
    #[arg(long, value_name = "A", value_parser = parse::albedo)]
    albedo: Option<[f32; 3]>,
    /// Mean cosine of the angle by which scattered light turns: -0.999 backward to 0.999 forward (default: 0)
    #[arg(long, value_name = "G", value_parser = parse::number, requires = "albedo", allow_negative_numbers = true)]
    anisotropy: Option<f64>,
    /// Factors of the extinction in red, green and blue (default: 1)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color)]
    extinction_color: Option<[f32; 3]>,
    /// Radiance of the source; of it the share of the extinction that is not scattered is emitted
    #[arg(long, value_name = "R,G,B", value_parser = parse::color, conflicts_with = "tf")]
    emission: Option<[f32; 3]>,
    /// Transfer function from density to color and extinction
    #[arg(long, value_name = "FILE")]
    tf: Option<PathBuf>,
    /// Vector from the volume towards a sun
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::vector, allow_hyphen_values = true)]
    sun: Option<DVec3>,
    /// Irradiance of the sun on a surface that faces it
    #[arg(long, value_name = "R,G,B", default_value = "1", value_parser = parse::color, requires = "sun")]
    sun_color: [f32; 3],
    /// Angle across the sun in degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 0.53, value_parser = parse::not_negative, requires = "sun")]
    sun_angle: f64,
    /// Radiance from all around, one color or an equirectangular EXR
    #[arg(long, value_name = "R,G,B|EXR")]
    sky: Option<Sky>,
    /// Renderer whose material is bound; the others stay in the variant set `renderer`
    #[arg(long, value_enum, default_value_t = Renderer::None)]
    renderer: Renderer,
    /// Replace a stage that another command wrote
    #[arg(long)]
    overwrite: bool,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Renderer {
    /// None: each shows densities as it does by default
    None,
    /// Arnold
    Arnold,
    /// Cycles as a Hydra delegate
    Cycles,
    /// Renderers of MaterialX volumes, such as Karma
    #[value(name = "materialx")]
    MaterialX,
}

impl Author {
    /// Paths that the command reads.
    pub(super) fn inputs(&self) -> Vec<&Path> {
        let paths = [&self.input].into_iter().chain(&self.tf).chain(&self.camera).map(PathBuf::as_path);
        paths.chain(self.sky.as_ref().and_then(Sky::file)).collect()
    }

    /// Reads, writes and reports.
    ///
    /// # Errors
    /// If inputs cannot be read or used, another command wrote the stage that lies there, or it cannot be written.
    pub(super) fn run(&self, output: &Output) -> Result<ExitCode> {
        let mut provenance = Provenance::begin(output);
        let limits = self.memory.limits();
        outputs::file(&self.output, Kind::UsdText)?;
        self.spare(&provenance.command)?;
        let content = self.content(limits)?;
        let up = self.up.of(&self.input, limits)?;
        output.note(&up);
        let capture = self.camera.as_ref().map(|path| captures::load_within(path, limits)).transpose()?;
        let cameras = capture.iter().flat_map(|capture| cameras::prims(capture, self.camera_path)).collect();
        let (mut volumes, mut names) = (Vec::new(), Names::default());
        ["Lights", "Cameras"].into_iter().for_each(|name| drop(names.take(name)));
        for source in &content.volumes {
            let files = volumes::files(source, self.frames)?;
            let bar = output.steps(files.len() as u64, "reading");
            let mut volume = volumes::volume(source, &files, &self.grid, &self.output, limits, &mut || bar.inc(1))?;
            drop(bar);
            volume.name = names.take(&volume.name);
            volumes.push(volume);
            provenance.input(&source.file, files.iter().map(|(_, path)| path.as_path()))?;
        }
        let scene = (content.volumes.iter().all(|v| v.file != self.input)).then(|| self.input.clone());
        let textures = content.lights.iter().filter_map(|(_, texture)| texture.clone());
        let others: Vec<PathBuf> = scene
            .into_iter()
            .chain(content.volumes.iter().filter_map(|v| v.transfer.clone()))
            .chain(textures)
            .chain(self.camera.iter().map(|path| captures::file(path)))
            .collect();
        others.iter().try_for_each(|path| provenance.input(path, [path.as_path()]))?;
        let lights = content
            .lights
            .into_iter()
            .map(|(light, texture)| Ok((light, texture.map(|path| relative(&path, &self.output)).transpose()?)));
        let stage = self.stage(volumes, lights.collect::<Result<_>>()?, cameras, up.axis, &provenance);
        atomic::write_bytes(&self.output, stage.text()?.as_bytes())?;
        provenance.lap();
        let report = Report::of(&stage, self.output.clone(), up, provenance);
        output.warn(&report.warnings);
        output.report(&report)?;
        Ok(ExitCode::SUCCESS)
    }

    /// Refuses to replace a stage that another command wrote.
    fn spare(&self, command: &str) -> Result<()> {
        if self.overwrite || !self.output.exists() {
            return Ok(());
        }
        let read = || input::bytes(&self.output, MAX_BYTES, "a stage of this command");
        let text = protected::unprotected(&self.output, read)?;
        let text = String::from_utf8_lossy(&text);
        let words = |command: &str| command.split_once(' ').map(|(_, words)| words.to_owned());
        let stated = text.lines().find_map(|line| line.trim().strip_prefix("string \"command\" = "));
        if stated.is_some_and(|stated| words(stated) == words(&quoted(command))) {
            return Ok(());
        }
        Err(Error::invalid("a file lies here that another command wrote, and would be replaced")
            .at(&self.output)
            .hint("give another name, or --overwrite to replace it"))
    }

    fn stage(
        &self,
        volumes: Vec<VolumePrim>,
        lights: Vec<(crate::formats::scene_file::LightEntry, Option<String>)>,
        cameras: Vec<CameraPrim>,
        up: Up,
        provenance: &Provenance,
    ) -> StageText {
        let times = volumes.iter().flat_map(|v| v.frames.iter().filter_map(|frame| frame.time));
        let views = cameras.iter().flat_map(|camera| camera.samples.iter().filter_map(|(time, _)| *time));
        let span = |times: &mut dyn Iterator<Item = u32>| {
            times.fold(None, |span: Option<[u32; 2]>, t| Some(span.map_or([t, t], |[a, b]| [a.min(t), b.max(t)])))
        };
        let frames = span(&mut times.clone()).or_else(|| span(&mut views.clone()));
        let keys = ["cumulo:command", "cumulo:input", "software"];
        let names = ["command", "inputs", "software"];
        let attributes = provenance.attributes();
        let stated =
            keys.into_iter().zip(names).filter_map(|(key, name)| Some((name.into(), attributes.get(key)?.clone())));
        StageText {
            up_axis: up.into(),
            meters_per_unit: self.meters_per_unit,
            fps: self.fps,
            frames,
            renderer: self.renderer(),
            provenance: stated.collect::<BTreeMap<String, String>>(),
            volumes,
            lights,
            cameras,
        }
    }

    fn renderer(&self) -> material::Renderer {
        match self.renderer {
            Renderer::None => material::Renderer::None,
            Renderer::Arnold => material::Renderer::Arnold,
            Renderer::Cycles => material::Renderer::Cycles,
            Renderer::MaterialX => material::Renderer::MaterialX,
        }
    }
}
