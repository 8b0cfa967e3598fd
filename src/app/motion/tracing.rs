//! Motions traced from volumes and cameras, frame by frame.

use crate::app::pictures::between;
use crate::app::scan::ScanSettings;
use crate::app::{sequence, volume};
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::formats::captures;
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::scene_file::{self, SceneVolume};
use crate::formats::sequence::Pattern;
use crate::formats::usd::{self, Overrides, Stage};
use crate::formats::vdb::{File, velocity};
use crate::render::film::{self, Aov, Sampling, View};
use crate::render::path::PathTracer;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, Model};
use crate::scene::film::Film;
use crate::scene::medium::{Medium, Scattering, Source};
use crate::scene::meshes::{Material, Meshes};
use crate::scene::phase::Phase;
use crate::scene::scene::Scene;
use crate::scene::transfer::Transfer;
use crate::scene::volume::Volume;
use glam::Vec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Choices of a tracing beside its volumes and cameras.
pub struct Choices {
    /// Grid that pictures show.
    pub grid: Option<String>,
    /// Part of a scan that is read, and where its voxels lie.
    pub scan: ScanSettings,
    /// Extinction per unit of density and length; `None` for that of the capture.
    pub density_scale: Option<f64>,
    /// Transfer function; `None` for that of the capture, if it has one.
    pub transfer: Option<Transfer>,
    /// Grid of velocities, and frames per second.
    pub velocity: Option<(String, f64)>,
    /// Rays per pixel; `None` for `SAMPLES`.
    pub samples: Option<u32>,
    /// Plane that holds the motion.
    pub plane: Aov,
}

impl Default for Choices {
    fn default() -> Self {
        Self {
            grid: None,
            scan: ScanSettings::default(),
            density_scale: None,
            transfer: None,
            velocity: None,
            samples: None,
            plane: Aov::Motion,
        }
    }
}

/// Rays per pixel unless another number is asked for.
pub(crate) const SAMPLES: u32 = 16;

/// Motions of frames that show a volume, a scene file or a USD stage.
pub struct Tracing {
    input: PathBuf,
    /// Volumes of the frames, where each has one of its own.
    volumes: Option<Pattern>,
    numbers: Vec<u32>,
    /// Cameras of the frames, or of all of them, each between those before and after.
    cameras: Vec<[Camera; 3]>,
    capture: Capture,
    choices: Choices,
    limits: Limits,
    /// Scene that was read last.
    last: Option<Loaded>,
}

/// Scene of a frame.
struct Loaded {
    path: PathBuf,
    /// Number of the only frame that shows it.
    only: Option<u32>,
    scene: Scene,
}

impl Tracing {
    /// Prepares the motion of frames with these numbers, which show a volume, or one for each, a scene file or a stage,
    /// to the cameras of a capture.
    ///
    /// # Errors
    /// If the capture cannot be read or does not fit the frames, or a scene file or a stage is to have another medium.
    pub fn new(input: &Path, cameras: &Path, numbers: &[u32], choices: Choices, limits: Limits) -> Result<Self> {
        let capture = captures::load_within(cameras, limits)?;
        let volumes = sequence::pattern(input);
        if volumes.is_none() && is_scene(input)? {
            let given = [
                ("⟨grid⟩", choices.grid.is_some()),
                ("⟨density_scale⟩", choices.density_scale.is_some()),
                ("⟨tf⟩", choices.transfer.is_some()),
                ("⟨velocity⟩", choices.velocity.is_some()),
            ];
            if let Some((option, _)) = given.iter().find(|(_, given)| *given) {
                return Err(Error::invalid(format!("{option}: scene files and stages state their own media"))
                    .at(input)
                    .hint(format!("leave {option} out, or give the VDB itself")));
            }
        }
        Ok(Self {
            input: input.to_owned(),
            volumes,
            numbers: numbers.to_vec(),
            cameras: between(&capture, cameras, numbers, 0)?,
            capture,
            choices,
            limits,
            last: None,
        })
    }

    /// Returns the extinction per unit of density and length of the frames' volume; `None` for scene files and stages.
    pub(crate) fn density_scale(&self) -> Option<f64> {
        let is_scene = self.volumes.is_none() && is_scene(&self.input).unwrap_or_default();
        (!is_scene).then(|| self.choices.density_scale.unwrap_or(self.capture.density_scale))
    }

    /// Returns the motion of a frame in the plane that was chosen, and alpha. What was read for the frame before is
    /// used again where this one shows it as well.
    ///
    /// # Errors
    /// If the volume cannot be read, or the work is interrupted.
    pub(crate) fn film(&mut self, number: u32, cancel: &Cancel) -> Result<Film> {
        let at = self.numbers.binary_search(&number).unwrap_or(0).min(self.cameras.len() - 1);
        let input = self.volumes.as_ref().map_or_else(|| self.input.clone(), |pattern| pattern.path(number));
        let same = |last: &Loaded| last.path == input && last.only.is_none_or(|only| only == number);
        let Loaded { scene, .. } = match self.last.take().filter(same) {
            Some(same) => self.last.insert(same),
            None => {
                let (scene, moving) = self.scene(&input, number)?;
                self.last.insert(Loaded { path: input, only: moving.then_some(number), scene })
            }
        };
        let [before, camera, after] = &self.cameras[at];
        let tracer = PathTracer::new(scene)?.background([0.0; 3]);
        let view =
            View { camera, before: Some(before), after: Some(after), holdout: None, velocities: &scene.velocities };
        let sampling = Sampling::random(self.choices.samples.unwrap_or(SAMPLES), number.into());
        let rendered = film::render(&tracer, view, sampling, &[self.choices.plane], cancel);
        Ok(rendered.ok_or_else(Error::cancelled)?.film)
    }

    /// Returns a scene in which nothing shines: rays end where they first meet a volume. Also returns whether other
    /// frames show other volumes of the same file.
    fn scene(&self, input: &Path, number: u32) -> Result<(Scene, bool)> {
        let format = volume::format_of(input)?;
        self.choices.scan.check(format, input)?;
        let loaded = match format.kind {
            FileKind::Capture => scene_file::load_within(input, Some(number), self.limits)?,
            FileKind::Usd => {
                let stage = Stage::open(input, self.limits)?;
                usd::scene::load(&stage, number.into(), self.limits, &Overrides::default())?
            }
            _ => return Ok((self.volume(input)?, false)),
        };
        let mut scene = Scene::default();
        for (at, SceneVolume { path, grid, transfer, medium, velocity, .. }) in loaded.volumes.into_iter().enumerate() {
            let field = volume::arrange(&grid, transfer.as_ref(), self.limits).map_err(|e| e.at(&path))?;
            scene.volumes.push(Volume::Density(field, dark(medium)));
            scene.velocities.extend(velocity.map(|velocity| (at, velocity)));
        }
        if !loaded.meshes.is_empty() {
            let black = |(triangles, Material { holdout, .. })| {
                (triangles, Material { albedo: Vec3::ZERO, emission: Vec3::ZERO, holdout })
            };
            let meshes: Vec<_> = loaded.meshes.into_iter().map(black).collect();
            scene.meshes = Some(Arc::new(Meshes::new(&meshes)?));
        }
        Ok((scene, loaded.moving))
    }

    /// Returns the scene of a VDB, as the options and the capture have it.
    fn volume(&self, input: &Path) -> Result<Scene> {
        let Choices { grid: name, density_scale, transfer, velocity, scan, .. } = &self.choices;
        let scale = density_scale.unwrap_or(self.capture.density_scale);
        let velocity = velocity
            .as_ref()
            .map(|(name, fps)| {
                velocity::read(&volume::open(input, scan, self.limits)?, name, *fps, self.limits.max_memory)
            })
            .transpose()?;
        let by_function = [Model::EmissionAbsorption, Model::Scattering].contains(&self.capture.model);
        let transfer = transfer.as_ref().or(self.capture.transfer.as_ref().filter(|_| by_function));
        let field = if self.capture.model == Model::PreShaded && transfer.is_none() {
            volume::read_pre_shaded(input, name.as_deref(), scan, self.limits)?.density_or_extinction().into_owned()
        } else {
            let file: File = volume::open(input, scan, self.limits)?;
            volume::arrange(&file.read_fog(name.as_deref())?, transfer, self.limits).map_err(|e| e.at(input))?
        };
        let source = match transfer {
            Some(transfer) => Source::Transfer(Arc::new(transfer.table()?)),
            None => Source::Grey([0.0; 3]),
        };
        Ok(Scene {
            volumes: vec![Volume::Density(field, dark(Medium::new(scale, source)))],
            velocities: velocity.map(|velocity| (0, velocity)).into_iter().collect(),
            ..Scene::default()
        })
    }
}

/// True for files that state media of their own: scene files and USD stages.
///
/// # Errors
/// If the file cannot be read.
fn is_scene(input: &Path) -> Result<bool> {
    Ok(matches!(volume::format_of(input)?.kind, FileKind::Capture | FileKind::Usd))
}

/// Returns a medium of the same extinction that neither shines nor scatters light on.
fn dark(medium: Medium) -> Medium {
    let source = match &medium.source {
        Source::Transfer(table) => Source::Transfer(Arc::new(table.without_color())),
        Source::Grey(_) | Source::Linear(_) => Source::Grey([0.0; 3]),
    };
    let scattering = Some(Scattering::new([0.0; 3], Phase::HenyeyGreenstein(0.0)));
    Medium { source, scattering, ..medium }
}
