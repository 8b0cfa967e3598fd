//! A stage of volumes, with their media, lights and cameras.

mod cameras;
mod content;
mod meshes;
mod report;
mod volumes;

pub use report::AuthorReport;

use crate::app::Context;
use crate::app::earlier::Standing;
use crate::app::inputs;
use crate::app::outputs::{self, Content as Kind};
use crate::app::pictures::scattering::Sky;
use crate::app::provenance::Provenance;
use crate::app::ranges;
use crate::app::up::UpChoice;
use crate::app::use_case::{Report, use_case};
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::scene_file::LightEntry;
use crate::formats::sequence::Frames;
use crate::formats::usd::write::camera::CameraPrim;
use crate::formats::usd::write::material::Renderer;
use crate::formats::usd::write::mesh::MeshPrim;
use crate::formats::usd::write::names::Names;
use crate::formats::usd::write::places::relative;
use crate::formats::usd::write::stage::StageText;
use crate::formats::usd::write::volume::VolumePrim;
use crate::formats::{atomic, captures};
use crate::scene::up::Up;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Settings of a stage of volumes, with their media, lights and cameras.
///
/// The stage is text (.usda). Its paths are relative to it; a sequence has the numbers of its frames as time codes. The
/// medium stands at the volume as attributes `cumulo:…`, and as materials for other renderers in the variant set
/// `renderer`.
///
/// A stage is rendered as a VDB is:
///
/// ```
/// use cumulo::prelude::*;
/// # let folder = tempfile::tempdir()?;
/// # let (stage, picture) = (folder.path().join("smoke.usda"), folder.path().join("smoke.exr"));
/// let input = std::fs::canonicalize("fixtures/plume.vdb")?;
/// let author = AuthorSettings { input, output: stage.clone(), density_scale: Some(4.0), ..AuthorSettings::default() };
/// author.run(&Context::default())?;
///
/// let pictures = PictureSettings { input: stage, views: Some(1), size: Some([32, 32]), ..PictureSettings::default() };
/// let render = RenderSettings { output: picture.clone(), pictures, ..RenderSettings::default() };
/// println!("{}", render.run(&Context::default())?);
/// assert!(picture.exists());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AuthorSettings {
    /// VDB, pattern of a sequence, or scene file.
    #[serde(with = "crate::app::paths")]
    pub input: PathBuf,
    /// Stage to write, a .usda.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// Frames of a sequence; none for those that exist.
    pub frames: Option<Frames>,
    /// Frames per second.
    pub fps: f64,
    /// Names of the grids that become fields; none for all.
    pub grid: Vec<String>,
    /// Name of the grid of densities, related as field:density; none for density, else the only scalar one.
    pub density: Option<String>,
    /// Axis that points upwards; coordinates stay as they are.
    pub up: UpChoice,
    /// Meters to a unit; coordinates stay as they are.
    pub meters_per_unit: f64,
    /// Capture whose cameras become prims, one for each view.
    #[serde(with = "crate::app::paths")]
    pub camera: Option<PathBuf>,
    /// True to make them one camera that is at view N at the time code N.
    pub camera_path: bool,
    /// Extinction per unit of density and length; none for 1.
    pub density_scale: Option<f64>,
    /// Share of the extinction that is scattered in R, G and B, from 0 to 1; none for 0.
    pub albedo: Option<[f32; 3]>,
    /// Mean cosine of the scattering angle, -0.999 to 0.999; none for 0.
    pub anisotropy: Option<f64>,
    /// Factors of the extinction in R, G and B; none for 1.
    pub extinction_color: Option<[f32; 3]>,
    /// Radiance of the source; of it the share of the extinction that is not scattered is emitted.
    pub emission: Option<[f32; 3]>,
    /// File of a transfer function from density to color and extinction.
    #[serde(with = "crate::app::paths")]
    pub tf: Option<PathBuf>,
    /// Vector from the volume towards a sun.
    pub sun: Option<[f64; 3]>,
    /// Irradiance of the sun in R, G and B on a surface that faces it.
    pub sun_color: [f32; 3],
    /// Angle across the sun in degrees.
    pub sun_angle: f64,
    /// Radiance from all around.
    pub sky: Option<Sky>,
    /// Renderer whose material is bound; the others stay in the variant set `renderer`.
    pub renderer: Renderer,
    /// True to replace a stage that other settings wrote.
    pub overwrite: bool,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

impl Default for AuthorSettings {
    fn default() -> Self {
        Self {
            input: PathBuf::new(),
            output: PathBuf::new(),
            frames: None,
            fps: 24.0,
            grid: Vec::new(),
            density: None,
            up: UpChoice::Auto,
            meters_per_unit: 1.0,
            camera: None,
            camera_path: false,
            density_scale: None,
            albedo: None,
            anisotropy: None,
            extinction_color: None,
            emission: None,
            tf: None,
            sun: None,
            sun_color: [1.0; 3],
            sun_angle: 0.53,
            sky: None,
            renderer: Renderer::None,
            overwrite: false,
            limits: Limits::default(),
        }
    }
}

/// Settings on which the stage does not depend.
const MANNER: [&str; 2] = ["overwrite", "max_memory"];

use_case!(AuthorSettings => AuthorReport, limits);

impl Report for AuthorReport {}

impl AuthorSettings {
    /// Paths that the stage is made from.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        let paths = [&self.input].into_iter().chain(&self.tf).chain(&self.camera).map(PathBuf::as_path);
        paths.chain(self.sky.as_ref().and_then(Sky::file)).collect()
    }

    /// Reads and writes.
    ///
    /// # Errors
    /// If inputs cannot be read or used, another command wrote the stage that lies there, or it cannot be written.
    pub fn run(&self, context: &Context) -> Result<AuthorReport> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        ranges::positive("fps", self.fps)?;
        ranges::positive("meters_per_unit", self.meters_per_unit)?;
        ranges::positive("density_scale", self.density_scale)?;
        ranges::shares("albedo", self.albedo)?;
        ranges::radiance("emission", self.emission)?;
        let mut provenance = Provenance::begin(context).of("usd author", self, &MANNER);
        let limits = self.limits;
        outputs::file(&self.output, Kind::UsdText)?;
        self.refuse_overwrite(&provenance)?;
        let mut content = self.content()?;
        let up = self.up.of(&self.input, limits)?;
        context.note(&up);
        let capture = self.camera.as_ref().map(|path| captures::load_within(path, limits)).transpose()?;
        let cameras = capture.iter().flat_map(|capture| cameras::prims(capture, self.camera_path)).collect();
        if capture.iter().flat_map(|capture| &capture.frames).any(|frame| frame.camera.blur.shutter.is_some()) {
            let left = "the motion of cameras while their shutter is open, of which the stage has one place a frame";
            context.note(format!("left out: {left}"));
            content.left_out.push(left.into());
        }
        let (mut volumes, mut names) = (Vec::new(), Names::default());
        ["Meshes", "Lights", "Cameras"].into_iter().for_each(|name| drop(names.take(name)));
        for source in &content.volumes {
            let files = volumes::files(source, self.frames)?;
            let bar = context.steps(files.len() as u64, "reading");
            let mut volume = volumes::volume(source, &files, &self.grid, &self.output, limits, &mut || bar.inc(1))?;
            drop(bar);
            volume.name = names.take(&volume.name);
            volumes.push(volume);
            provenance.input(&source.file, files.iter().map(|(_, path)| path.as_path()))?;
        }
        let mut meshes = Vec::new();
        let mut mesh_names = Names::default();
        for source in &content.meshes {
            let (mesh, files) = meshes::mesh(source, self.frames, &mut mesh_names, limits)?;
            provenance.input(&source.file, files.iter().map(PathBuf::as_path))?;
            meshes.push(mesh);
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
        let lights = lights.collect::<Result<_>>()?;
        let mut stage = self.stage((volumes, meshes), lights, cameras, up.axis, &provenance);
        if !content.left_out.is_empty() {
            stage.provenance.insert("left_out".into(), content.left_out.join("\n"));
        }
        atomic::write_bytes(&self.output, stage.text()?.as_bytes())?;
        provenance.lap();
        let report = AuthorReport::of(&stage, self.output.clone(), up, provenance);
        context.warn(&report.warnings);
        Ok(report)
    }

    /// Refuses to replace a stage that other settings wrote.
    fn refuse_overwrite(&self, provenance: &Provenance) -> Result<()> {
        if self.overwrite {
            return Ok(());
        }
        match Standing::of_stage(&self.output, provenance)? {
            Standing::Nothing | Standing::Own => Ok(()),
            _ => Err(Error::invalid("a file lies here that another command wrote, and would be replaced")
                .coded(Code::OutputExists)
                .at(&self.output)
                .hint("give another name, or ⟨overwrite⟩ to replace it")),
        }
    }

    fn stage(
        &self,
        (volumes, meshes): (Vec<VolumePrim>, Vec<MeshPrim>),
        lights: Vec<(LightEntry, Option<String>)>,
        cameras: Vec<CameraPrim>,
        up: Up,
        provenance: &Provenance,
    ) -> StageText {
        let times = volumes.iter().flat_map(|v| v.frames.iter().filter_map(|frame| frame.time));
        let shapes = meshes.iter().flat_map(|mesh| mesh.frames.iter().filter_map(|(time, _)| *time));
        let views = cameras.iter().flat_map(|camera| camera.samples.iter().filter_map(|(time, _)| *time));
        let span = |times: &mut dyn Iterator<Item = u32>| {
            times.fold(None, |span: Option<[u32; 2]>, t| Some(span.map_or([t, t], |[a, b]| [a.min(t), b.max(t)])))
        };
        let frames = span(&mut times.chain(shapes)).or_else(|| span(&mut views.clone()));
        let Provenance { command, settings, software, .. } = provenance;
        let stated =
            [("command", command), ("inputs", &provenance.hashes()), ("settings", settings), ("software", software)];
        StageText {
            up_axis: up.into(),
            meters_per_unit: self.meters_per_unit,
            fps: self.fps,
            frames,
            renderer: self.renderer,
            provenance: stated.map(|(name, value)| (name.to_owned(), value.clone())).into(),
            volumes,
            meshes,
            lights,
            cameras,
        }
    }
}
