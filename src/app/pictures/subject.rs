//! What `cumulo render` renders: the grids of one volume, or a scene file.

use super::colors::Colors;
use super::settings::PictureSettings;
use crate::app::provenance::Provenance;
use crate::app::volume;
use crate::error::{Error, Result};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::scene_file::{self, LoadedScene, SceneVolume};
use crate::formats::transfer::Function;
use crate::scene::bricks::Bricks;
use crate::scene::capture::{Capture, EmissionModel, Model};
use crate::scene::emission::{self, Emission, Emitted};
use crate::scene::grid::Grid;
use crate::scene::medium::{Medium, Source};
use crate::scene::meshes::Meshes;
use crate::scene::scene::Scene;
use crate::scene::transfer::Transfer;
use crate::scene::volume::{Grids, Volume, outline_through};
use glam::{DMat4, DVec3};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Subject of the pictures.
#[allow(clippy::large_enum_variant, reason = "there is one at a time")]
pub(in crate::app) enum Subject {
    /// The grids of one volume, whose medium and light the settings and `cameras` tell.
    Grids {
        /// Grids.
        grids: Grids,
        /// Meaning of the colors of the transfer function, where light is scattered.
        colors: Option<Colors>,
        /// Remarks on the transfer function.
        remarks: Vec<String>,
    },
    /// A scene file, or a USD stage.
    Scene {
        /// Scene.
        scene: Scene,
        /// True if another frame shows other volumes.
        moving: bool,
        /// Remarks on statements that have no effect, and on what is assumed.
        remarks: Vec<String>,
    },
}

impl Subject {
    /// Returns world points around all that may be seen; `transfer` is the function by which the grids are.
    pub(crate) fn outline(&self, transfer: Option<&Transfer>) -> Vec<DVec3> {
        match self {
            Self::Grids { grids, .. } => {
                let field = grids.density_or_extinction();
                match transfer.and_then(|transfer| transfer.table().ok()) {
                    Some(table) => outline_through(&field, &table),
                    None => field.outline(),
                }
            }
            Self::Scene { scene, .. } => scene.volumes.iter().flat_map(Volume::outline).collect(),
        }
    }

    /// True if it is rendered by path tracing whatever the settings say.
    pub(crate) fn is_scene(&self) -> bool {
        matches!(self, Self::Scene { .. })
    }

    /// Returns what is stated and has no effect, or is assumed, in words.
    pub(crate) fn remarks(&self) -> &[String] {
        match self {
            Self::Grids { remarks, .. } | Self::Scene { remarks, .. } => remarks,
        }
    }

    /// Returns what the colors of the transfer function are, where there is one and light is scattered.
    pub(crate) fn colors(&self) -> Option<&Colors> {
        match self {
            Self::Grids { colors, .. } => colors.as_ref(),
            Self::Scene { .. } => None,
        }
    }

    /// Returns the index-to-world map of the volume, if there is but one.
    pub(crate) fn lattice(&self) -> Option<DMat4> {
        match self {
            Self::Grids { grids, .. } => Some(grids.density_or_extinction().transform.matrix()),
            Self::Scene { .. } => None,
        }
    }
}

/// Returns a volume beside which grids emit.
fn emissive(
    grid: &Grid,
    density: Bricks<f32>,
    medium: Medium,
    emissions: Vec<(Grid, Emission)>,
    limits: Limits,
) -> Result<Volume> {
    if !matches!(medium.source, Source::Grey(color) if color == [0.0; 3]) {
        return Err(Error::unsupported("a medium emits by its density and by grids of its own")
            .hint("leave 'emission', or 'emission_grid' and 'blackbody', out"));
    }
    // Beside one number for each voxel and grid there are four for the emission with the extinction, and one for its
    // strength; grids may lie apart.
    let each = limits.max_memory / (6 * (emissions.len() as u64 + 1) + 1);
    let expanded = Bricks::from_grid(grid, each)?;
    let field = |(grid, emission): (Grid, Emission)| Ok((Bricks::from_grid(&grid, each)?, emission));
    let grids = emissions.into_iter().map(field).collect::<Result<Vec<_>>>()?;
    let emission = emission::volume(&expanded, medium.extinction, &grids)?;
    Ok(Volume::Emissive { density, medium, emission: Box::new(Emitted::new(emission)) })
}

impl PictureSettings {
    /// Reads what is to be rendered, with the transfer function that the pictures will show.
    pub(in crate::app) fn subject(
        &self,
        template: Option<&Capture>,
        limits: Limits,
        provenance: &mut Provenance,
    ) -> Result<(Subject, Option<Transfer>)> {
        let format = volume::format_of(&self.input)?;
        let kind = format.kind;
        if matches!(kind, FileKind::Capture | FileKind::Usd) {
            self.scan.check(format, &self.input)?;
            let loaded = match kind {
                FileKind::Usd => self.staged(limits)?,
                _ => {
                    self.check_scene_file()?;
                    scene_file::load_within(&self.input, self.frame, limits)?
                }
            };
            let LoadedScene { volumes, lights, environment, meshes, motions, files, moving, remarks } = loaded;
            provenance.files([&self.input].into_iter().chain(&files).map(PathBuf::as_path))?;
            let mut velocities = Vec::new();
            let volume = |(number, read): (usize, SceneVolume)| {
                velocities.extend(read.velocity.map(|velocity| (number, velocity)));
                let field =
                    volume::arrange(&read.grid, read.transfer.as_ref(), limits).map_err(|e| e.at(&read.path))?;
                let medium = read.medium;
                if read.emissions.is_empty() {
                    return Ok(Volume::Density(field, medium));
                }
                emissive(&read.grid, field, medium, read.emissions, limits).map_err(|e| e.at(&read.path))
            };
            let volumes = volumes.into_iter().enumerate().map(volume).collect::<Result<_>>()?;
            let meshes = (!meshes.is_empty()).then(|| Meshes::new(&meshes).map(Arc::new)).transpose();
            let meshes = meshes.map_err(|e| e.at(&self.input))?;
            let scene = Scene { volumes, lights, environment, meshes, velocities, motions, ..Scene::default() };
            return Ok((Subject::Scene { scene, moving, remarks }, None));
        }
        let (grids, function) = self.grids(template, limits)?;
        provenance.files(self.files().iter().map(PathBuf::as_path))?;
        let scattered = function.as_ref().filter(|_| self.scattering.on());
        let colors = scattered.map(|function| Colors::of(function, self.scattering.tf_color)).transpose()?;
        if colors.is_none() && self.scattering.tf_color.is_some() {
            return Err(Error::invalid("⟨tf_color⟩: the pictures show no transfer function")
                .at(&self.input)
                .hint("give ⟨tf⟩, or leave ⟨tf_color⟩ out"));
        }
        let unused = function.as_ref().is_some_and(|function| function.albedo.is_some()) && !self.scattering.on();
        let unused = unused.then(|| "the albedo of the transfer function has no effect without ⟨albedo⟩".to_owned());
        let remarks = colors.as_ref().and_then(Colors::remark).or(unused).into_iter().collect();
        Ok((Subject::Grids { grids, colors, remarks }, function.map(|function| function.transfer)))
    }

    /// Returns the files that pictures of one volume are made from, beside those of the cameras.
    pub(in crate::app) fn files(&self) -> Vec<PathBuf> {
        let others = self.transfer.file().into_iter().chain(self.scattering.sky_file()).map(Path::to_path_buf);
        volume::files(&self.input, &self.scan, self.limits).into_iter().chain(others).collect()
    }

    /// Refuses settings that a scene file states itself.
    fn check_scene_file(&self) -> Result<()> {
        let given = [
            ("⟨model⟩", self.model.is_some()),
            ("⟨density_scale⟩", self.density_scale.is_some()),
            ("⟨emission⟩", self.emission.is_some()),
            ("⟨emission_model⟩", self.emission_model.is_some()),
            ("⟨tf⟩", self.transfer.tf.is_some()),
            ("⟨grid⟩", self.grid.is_some()),
            ("⟨quadrature⟩", self.quadrature.is_some()),
            ("⟨supersample⟩", self.supersample > 1),
            ("⟨albedo⟩", self.scattering.on()),
        ];
        match given.iter().find(|(_, given)| *given) {
            Some((option, _)) => {
                Err(Error::invalid(format!("{option}: the scene file states its own media and lights"))
                    .at(&self.input)
                    .hint(format!("leave {option} out, or render the VDB itself")))
            }
            None => Ok(()),
        }
    }

    /// Reads the volume's grids, and returns them with the transfer function that the pictures will show.
    fn grids(&self, template: Option<&Capture>, limits: Limits) -> Result<(Grids, Option<Function>)> {
        if self.model.or(template.map(|c| c.model)) == Some(Model::PreShaded) && self.transfer.tf.is_none() {
            return Ok((volume::read_pre_shaded(&self.input, self.grid.as_deref(), &self.scan, limits)?, None));
        }
        let (grid, loaded) =
            volume::read_with_function(&self.input, self.grid.as_deref(), (&self.scan, &self.transfer), limits)?;
        let function = self.function(loaded, template);
        let transfer = function.as_ref().map(|function| &function.transfer);
        let field = volume::arrange(&grid, transfer, limits).map_err(|e| e.at(&self.input))?;
        Ok((Grids::Density(field), function))
    }

    /// Chooses the transfer function that the pictures will show: `loaded` if it is that of `tf`, else that of
    /// `cameras`, else the one that the grid carries, which is `loaded` then; none for other models.
    fn function(&self, loaded: Option<Function>, template: Option<&Capture>) -> Option<Function> {
        if self.transfer.tf.is_some() {
            return loaded;
        }
        let emits = |m: Model| m == Model::EmissionAbsorption;
        let other = self.model.is_some_and(|m| !emits(m)) || self.emission.is_some() || self.emission_model.is_some();
        match template {
            _ if other => None,
            Some(capture) if self.model.is_none() || emits(capture.model) => {
                capture.transfer.clone().filter(|_| emits(capture.model)).map(Function::from)
            }
            _ => loaded,
        }
    }

    /// Returns the scene that the pictures will show.
    pub(in crate::app) fn scene(&self, capture: &Capture, subject: Subject) -> Result<Scene> {
        let cameras = capture.frames.iter().map(|frame| frame.camera).collect();
        let (field, colors) = match subject {
            Subject::Scene { scene, .. } => return Ok(Scene { cameras, ..scene }),
            Subject::Grids { grids, .. } if !self.scattering.on() => return Scene::shown_by(capture, grids),
            Subject::Grids { grids: Grids::Density(field), colors, .. } => (field, colors),
            Subject::Grids { grids: Grids::EmissionExtinction(_), .. } => {
                return Err(Error::unsupported("a pre-shaded volume has no albedo").hint("render it without ⟨albedo⟩"));
            }
        };
        let source = match (self.emission, capture.emission_model) {
            (Some(color), EmissionModel::Linear) => Source::Linear(color),
            (color, _) => Source::Grey(color.unwrap_or_default()),
        };
        let medium = Medium::new(capture.density_scale, source).chromatic(self.scattering.extinction_color())?;
        let medium = match (&capture.transfer, colors) {
            (Some(transfer), Some(Colors { color, own, .. })) => medium.with_function(transfer.table()?, own, color)?,
            _ => medium,
        };
        let medium = Medium { scattering: self.scattering.scattering(), ..medium };
        let scene = Scene { volumes: vec![Volume::Density(field, medium)], cameras, ..Scene::default() };
        self.scattering.light(scene, self.limits)
    }
}
