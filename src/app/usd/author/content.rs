//! What a stage is to hold: volumes with their media, and lights, from settings or from a scene file.

use super::AuthorSettings;
use crate::app::pictures::scattering::Sky;
use crate::error::{Error, Result};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::registry;
use crate::formats::scene_file::{self, LightEntry, MediumEntry, MeshEntry, SceneFile, VelocityEntry, VolumeEntry};
use crate::formats::transfer::{self, Function, Loaded};
use crate::math::Affine;
use crate::scene::meshes::Material;
use crate::wording::worded;
use glam::DMat4;
use std::path::{Path, PathBuf};

/// Name of the part of densities, by which shaders look them up.
pub(super) const DENSITY: &str = "density";

/// A volume by its file or sequence, and its medium.
pub(super) struct Source {
    /// VDB file, or pattern of a sequence.
    pub file: PathBuf,
    /// Grids that play a part, as far as they are named, by the part's name.
    pub parts: Vec<(&'static str, String)>,
    /// Map from the file's space to the stage's.
    pub placement: Option<Affine>,
    pub medium: MediumEntry,
    /// Transfer function of the medium.
    pub transfer: Option<PathBuf>,
}

/// A mesh by its file or sequence.
pub(super) struct MeshSource {
    /// PLY, OBJ or glTF file, or pattern of a sequence.
    pub file: PathBuf,
    /// Map from the file's space to the stage's.
    pub placement: Option<DMat4>,
    pub material: Material,
}

/// Content of a stage but its cameras.
pub(super) struct Content {
    pub volumes: Vec<Source>,
    /// Meshes.
    pub meshes: Vec<MeshSource>,
    /// Lights, each with its picture.
    pub lights: Vec<(LightEntry, Option<PathBuf>)>,
    /// Parts that were left out of the scene when its file was written, in words.
    pub left_out: Vec<String>,
}

impl AuthorSettings {
    /// Returns the content that a scene file or the settings describe.
    ///
    /// # Errors
    /// If the scene file or a transfer function cannot be read, or a medium or light cannot be used.
    pub(super) fn content(&self) -> Result<Content> {
        let is_scene = self.input.is_file() && matches!(registry::sniff(&self.input)?.kind, FileKind::Capture);
        let content = if is_scene { self.of_scene_file()? } else { self.of_settings()? };
        for source in &content.volumes {
            check_medium(source, self.limits)?;
        }
        content.lights.iter().try_for_each(|(light, _)| check_light(light))?;
        Ok(content)
    }

    fn of_settings(&self) -> Result<Content> {
        if let Some(name) = self.tf.as_ref().filter(|tf| transfer::file(tf).is_none()) {
            let name = name.display();
            return Err(Error::unsupported("a stage refers to the file of a transfer function, and this is a name")
                .part(worded(&format!("⟨tf={name}⟩")))
                .hint(format!("make a file of it: cumulo transfer {name} -o {name}.tf.json")));
        }
        let medium = MediumEntry {
            density_scale: self.density_scale.unwrap_or(1.0),
            albedo: self.albedo.unwrap_or_default(),
            anisotropy: self.anisotropy.unwrap_or_default(),
            extinction_color: self.extinction_color.unwrap_or([1.0; 3]),
            emission: self.emission,
            transfer: self.tf.clone(),
            ..MediumEntry::default()
        };
        let sun = self.sun.map(|direction| LightEntry::DistantLight {
            direction,
            irradiance: self.sun_color,
            angle: self.sun_angle,
        });
        let (radiance, texture) = match &self.sky {
            None => (None, None),
            Some(Sky::Color(radiance)) => (Some(*radiance), None),
            Some(Sky::File(file)) => (Some([1.0; 3]), Some(file.clone())),
        };
        let sky = radiance.map(|radiance| (LightEntry::DomeLight { radiance, texture: texture.clone() }, texture));
        let lights = sun.map(|sun| (sun, None)).into_iter().chain(sky).collect();
        let transfer = medium.transfer.clone();
        let parts = self.density.iter().map(|grid| (DENSITY, grid.clone())).collect();
        let volume = Source { file: self.input.clone(), parts, placement: None, medium, transfer };
        Ok(Content { volumes: vec![volume], meshes: Vec::new(), lights, left_out: Vec::new() })
    }

    fn of_scene_file(&self) -> Result<Content> {
        self.check_alone()?;
        let SceneFile { volumes, lights, meshes, mut left_out } = scene_file::read(&self.input, self.limits)?;
        let mut moved = Vec::new();
        let folder = self.input.parent().unwrap_or(Path::new(""));
        let mut volume = |(i, entry): (usize, VolumeEntry)| {
            let named = |e: Error| e.part(format!("volume {i}")).at(&self.input);
            let placement = entry.placement().map_err(named)?;
            let parts = parts(&entry);
            // All keys are named, so that a new one is not left out unnoticed.
            let VolumeEntry { file, grid: _, transform: _, transform_start, transform_end: _, medium, velocity } =
                entry;
            moved.extend(transform_start.map(|_| format!("the motion of volume {i} while the shutter is open")));
            if let Some(VelocityEntry { grid: _, fps }) = velocity
                && fps != self.fps
            {
                return Err(named(
                    Error::unsupported(format!("velocities at {fps} frames a second, in a stage of {}", self.fps))
                        .hint(format!("a stage has one rate for both: give ⟨fps={fps}⟩")),
                ));
            }
            let transfer = medium.transfer.as_ref().map(|tf| folder.join(tf));
            Ok(Source { file: folder.join(file), parts, placement, medium, transfer })
        };
        let mesh = |(i, entry): (usize, MeshEntry)| {
            let placement = entry.transform.map(|rows| DMat4::from_cols_array_2d(&rows).transpose());
            let material = entry.material().map_err(|e| e.part(format!("mesh {i}")).at(&self.input))?;
            Ok(MeshSource { file: folder.join(entry.file), placement, material })
        };
        let light = |entry: LightEntry| match &entry {
            LightEntry::DomeLight { texture: Some(texture), .. } => {
                let texture = folder.join(texture);
                (entry, Some(texture))
            }
            _ => (entry, None),
        };
        let volumes = volumes.into_iter().enumerate().map(&mut volume).collect::<Result<_>>()?;
        let moving = meshes.iter().enumerate().filter(|(_, mesh)| mesh.transform_start.is_some());
        moved.extend(moving.map(|(i, _)| format!("the motion of mesh {i} while the shutter is open")));
        left_out.extend(moved);
        Ok(Content {
            volumes,
            meshes: meshes.into_iter().enumerate().map(mesh).collect::<Result<_>>()?,
            lights: lights.into_iter().map(light).collect(),
            left_out,
        })
    }

    /// Refuses settings that a scene file states itself.
    fn check_alone(&self) -> Result<()> {
        let given = [
            ("⟨density⟩", self.density.is_some()),
            ("⟨density_scale⟩", self.density_scale.is_some()),
            ("⟨albedo⟩", self.albedo.is_some()),
            ("⟨anisotropy⟩", self.anisotropy.is_some()),
            ("⟨extinction_color⟩", self.extinction_color.is_some()),
            ("⟨emission⟩", self.emission.is_some()),
            ("⟨tf⟩", self.tf.is_some()),
            ("⟨sun⟩", self.sun.is_some()),
            ("⟨sky⟩", self.sky.is_some()),
        ];
        match given.iter().find(|(_, given)| *given) {
            Some((setting, _)) => {
                Err(Error::invalid(format!("{setting}: the scene file states its own media and lights"))
                    .at(&self.input)
                    .hint(format!("leave {setting} out, or give the VDB itself")))
            }
            None => Ok(()),
        }
    }
}

/// Returns the grids of a volume that play a part and are named.
fn parts(entry: &VolumeEntry) -> Vec<(&'static str, String)> {
    let medium = &entry.medium;
    let named = [
        (DENSITY, entry.grid.clone()),
        ("flame", medium.emission_grid.as_ref().map(|e| e.grid.clone())),
        ("temperature", medium.blackbody.as_ref().map(|e| e.grid.clone())),
        ("velocity", entry.velocity.as_ref().map(|e| e.grid.clone())),
    ];
    named.into_iter().filter_map(|(part, grid)| Some((part, grid?))).collect()
}

fn check_medium(source: &Source, limits: Limits) -> Result<()> {
    let load = |path: &PathBuf| {
        let options = transfer::Options { limits, ..transfer::Options::default() };
        transfer::load(path, &options).map(Loaded::function)
    };
    let function: Option<Function> = source.transfer.as_ref().map(load).transpose()?;
    let at = |e: Error| e.at(source.transfer.as_ref().unwrap_or(&source.file));
    scene_file::medium(&source.medium, function.as_ref()).map(drop).map_err(at)
}

fn check_light(light: &LightEntry) -> Result<()> {
    if let LightEntry::DomeLight { radiance, .. } = light
        && !radiance.iter().all(|v| v.is_finite() && *v >= 0.0)
    {
        return Err(Error::invalid(format!("a DomeLight's radiance {radiance:?} must be finite and not negative"))
            .hint("correct 'radiance'"));
    }
    light.light().map(drop)
}
