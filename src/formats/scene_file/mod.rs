//! Scenes as JSON: volumes with their media, meshes and lights, for `cumulo render`. Cameras are given beside them.
//!
//! ```json
//! {
//!   "volumes": [{"file": "smoke.vdb", "medium": {"density_scale": 2, "albedo": [0.9, 0.9, 0.9], "anisotropy": 0.3}}],
//!   "lights": [
//!     {"type": "DistantLight", "direction": [1, 1, 2], "irradiance": [3, 3, 3], "angle": 0.53},
//!     {"type": "DomeLight", "radiance": [0.2, 0.3, 0.5]}
//!   ]
//! }
//! ```
//! Meshes stand among the volumes: `"meshes": [{"file": "floor.ply", "albedo": [0.8, 0.8, 0.8]}]`. Types of lights are
//! named as in UsdLux. Files are found from the folder of the scene.

mod load;

pub use load::{LoadedScene, medium, read};
pub(crate) use load::{SceneVolume, environment_map, load_within};

use crate::error::{Error, Result};
use crate::math::Affine;
use crate::scene::albedo::TransferColor;
use crate::scene::cone::Cone;
use crate::scene::emission::Emission;
use crate::scene::light::Light;
use crate::scene::medium::{Scattering, Specular};
use crate::scene::meshes::Material;
use crate::scene::motion::{Motion, Object};
use crate::scene::phase::Phase;
use glam::{DMat4, DVec3, Vec3};
use schemars::JsonSchema;
use serde::Deserialize;
use std::path::PathBuf;

/// A scene file.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Cumulo scene")]
pub struct SceneFile {
    /// Volumes, at least one; where several overlap, their extinctions add.
    #[schemars(length(min = 1))]
    pub volumes: Vec<VolumeEntry>,
    /// Lights.
    #[serde(default)]
    pub lights: Vec<LightEntry>,
    /// Meshes that reflect and emit light, and stop it.
    #[serde(default)]
    pub meshes: Vec<MeshEntry>,
    /// Parts that the program which wrote the scene left out of it, in words.
    #[serde(default)]
    pub left_out: Vec<String>,
}

/// A volume of a scene file.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VolumeEntry {
    /// VDB file, found from the folder of the scene, or a sequence such as `smoke.####.vdb`.
    pub file: PathBuf,
    /// Grid of densities; `density`, else the only scalar one, unless stated.
    pub grid: Option<String>,
    /// Matrix from the space of the VDB file to the world, row by row, for column vectors; without one that space is
    /// the world. It moves velocities, too. The medium stays in terms of world lengths.
    pub transform: Option<[[f64; 4]; 4]>,
    /// This matrix as the shutter of the camera opens, and as it closes; without them the volume does not move.
    pub transform_start: Option<[[f64; 4]; 4]>,
    /// As `transform_start`.
    pub transform_end: Option<[[f64; 4]; 4]>,
    /// Medium of the volume.
    #[serde(default)]
    pub medium: MediumEntry,
    /// Velocities, from which the plane `motion` is computed.
    pub velocity: Option<VelocityEntry>,
}

/// A mesh of a scene file; both sides of its polygons are alike.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeshEntry {
    /// PLY, OBJ or glTF file of polygons, found from the folder of the scene, or a sequence such as `prop.####.ply`.
    pub file: PathBuf,
    /// Matrix from the space of the file to the world, row by row, for column vectors; without one that space is the
    /// world.
    pub transform: Option<[[f64; 4]; 4]>,
    /// This matrix as the shutter of the camera opens, and as it closes; without them the mesh does not move.
    pub transform_start: Option<[[f64; 4]; 4]>,
    /// As `transform_start`.
    pub transform_end: Option<[[f64; 4]; 4]>,
    /// Share of the light that is reflected, evenly to all sides, in red, green and blue: 0 to 1.
    #[serde(default = "light_grey")]
    pub albedo: [f32; 3],
    /// Radiance that leaves the surface by itself.
    #[serde(default)]
    pub emission: [f32; 3],
    /// True of a mesh that the camera does not see: it hides what is behind it, and leaves a hole. It casts shadows and
    /// reflects light as others do.
    #[serde(default)]
    pub holdout: bool,
}

/// A grid of velocities.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VelocityEntry {
    /// Vector grid of the same file, in world units per second.
    pub grid: String,
    /// Frames per second; 1 for a grid in world units per frame.
    #[serde(default = "film_rate")]
    pub fps: f64,
}

impl SceneFile {
    /// Returns the paths that the scene names, from its folder: volumes and meshes or their sequences, transfer
    /// functions and textures.
    pub fn files(&self) -> impl Iterator<Item = &PathBuf> {
        let volumes = self.volumes.iter().flat_map(|volume| [Some(&volume.file), volume.medium.transfer.as_ref()]);
        let textures = self.lights.iter().map(|light| match light {
            LightEntry::DomeLight { texture, .. } => texture.as_ref(),
            _ => None,
        });
        let meshes = self.meshes.iter().map(|mesh| Some(&mesh.file));
        volumes.chain(meshes).chain(textures).flatten()
    }
}

impl VolumeEntry {
    /// Returns the map from the space of the file to the world, if it is stated.
    ///
    /// # Errors
    /// If it cannot be inverted.
    pub fn placement(&self) -> Result<Option<Affine>> {
        self.transform.map(|rows| Affine::new(DMat4::from_cols_array_2d(&rows).transpose())).transpose()
    }
}

/// Returns the motion of an object by its matrices, row by row, as the shutter opens, halfway and as it closes; `None`
/// for an object at rest.
///
/// # Errors
/// If one of both ends alone is stated, or a matrix cannot be inverted.
fn motion(object: Object, [start, middle, end]: [Option<[[f64; 4]; 4]>; 3]) -> Result<Option<Motion>> {
    let map = |rows: [[f64; 4]; 4]| DMat4::from_cols_array_2d(&rows).transpose();
    match (start, end) {
        (None, None) => Ok(None),
        (Some(start), Some(end)) => {
            let middle = middle.map_or(DMat4::IDENTITY, map);
            Motion { object, maps: [map(start), middle, map(end)] }.checked().map(Some)
        }
        _ => Err(Error::invalid("one of 'transform_start' and 'transform_end' is missing")
            .hint("state the matrices at both ends of the time in which the shutter is open")),
    }
}

impl MeshEntry {
    /// Returns what the surface does with light.
    ///
    /// # Errors
    /// If its numbers cannot be used.
    pub fn material(&self) -> Result<Material> {
        let Self { albedo, emission, holdout, .. } = *self;
        Material { albedo: Vec3::from_array(albedo), emission: Vec3::from_array(emission), holdout }.checked()
    }
}

fn light_grey() -> [f32; 3] {
    Material::default().albedo.to_array()
}

fn film_rate() -> f64 {
    24.0
}

fn white() -> [f32; 3] {
    [1.0; 3]
}

fn one() -> f64 {
    1.0
}

/// A medium of a scene file.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MediumEntry {
    /// Extinction per unit of density and world length, or factor of the transfer function's extinction.
    #[serde(default = "one")]
    pub density_scale: f64,
    /// Share of the extinction that is scattered, in red, green and blue: 0 to 1.
    #[serde(default)]
    pub albedo: [f32; 3],
    /// Mean cosine of the angle by which scattered light turns (Henyey-Greenstein), -0.999 to 0.999.
    #[serde(default)]
    pub anisotropy: f64,
    /// Gradient shading: change of the density per world length at which half of the scattering is that of a surface.
    pub gradient_shading: Option<f64>,
    /// Share of the light that these surfaces reflect at normal incidence, 0 to 1; 0 unless stated.
    pub specular: Option<f64>,
    /// Roughness of this reflection, the α of GGX, 0.05 to 1; 0.3 unless stated.
    pub roughness: Option<f64>,
    /// Factors of the extinction in red, green and blue; 1 unless stated.
    #[serde(default = "white")]
    pub extinction_color: [f32; 3],
    /// Radiance of the source; of it the share of the extinction that is not scattered is emitted.
    pub emission: Option<[f32; 3]>,
    /// Transfer function from density to extinction and source radiance, found from the folder of the scene.
    pub transfer: Option<PathBuf>,
    /// Meaning of the colors of the transfer function: emission unless stated, and both where the function states an
    /// albedo of its own.
    pub tf_color: Option<TransferColor>,
    /// Emission by a grid of its own, whatever the density.
    pub emission_grid: Option<EmissionGridEntry>,
    /// Emission by a grid of temperatures, whatever the density.
    pub blackbody: Option<BlackbodyEntry>,
}

/// A grid that emits.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EmissionGridEntry {
    /// Scalar grid of the same file, on the lattice of the densities.
    pub grid: String,
    /// Radiance emitted per world length and unit of the grid.
    #[serde(default = "white")]
    pub radiance: [f32; 3],
}

/// A grid of temperatures that emits as black bodies do.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BlackbodyEntry {
    /// Scalar grid of the same file, on the lattice of the densities; `temperature` unless stated.
    #[serde(default = "temperature")]
    pub grid: String,
    /// Kelvin per unit of the grid.
    #[serde(default = "one")]
    pub kelvin: f64,
    /// Factor of the emission: 1 emits per world length 1e-6 of a black body's radiance in W m⁻² sr⁻¹, as in Blender.
    #[serde(default = "one")]
    pub intensity: f64,
    /// Factor of the emission in red, green and blue.
    #[serde(default = "white")]
    pub tint: [f32; 3],
}

fn temperature() -> String {
    "temperature".into()
}

impl Default for MediumEntry {
    fn default() -> Self {
        Self {
            density_scale: 1.0,
            albedo: [0.0; 3],
            anisotropy: 0.0,
            gradient_shading: None,
            specular: None,
            roughness: None,
            extinction_color: white(),
            emission: None,
            transfer: None,
            tf_color: None,
            emission_grid: None,
            blackbody: None,
        }
    }
}

impl MediumEntry {
    /// Returns how the medium scatters.
    fn scattering(&self) -> Scattering {
        let Self { albedo, anisotropy, gradient_shading, specular, roughness, .. } = *self;
        let specular = Specular::of(specular.unwrap_or_default(), roughness);
        Scattering { gradient_shading, specular, ..Scattering::new(albedo, Phase::of_anisotropy(anisotropy)) }
    }

    /// Returns the names of the grids that emit, and how.
    fn emissions(&self) -> impl Iterator<Item = (&str, Emission)> {
        let grid = self.emission_grid.as_ref();
        let linear = grid.map(|entry| (entry.grid.as_str(), Emission::Linear(Vec3::from_array(entry.radiance))));
        let blackbody = self.blackbody.as_ref().map(|entry| {
            let color = Vec3::from_array(entry.tint) * entry.intensity as f32;
            (entry.grid.as_str(), Emission::Blackbody { kelvin: entry.kelvin, color })
        });
        linear.into_iter().chain(blackbody)
    }
}

/// A light of a scene file.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(tag = "type", deny_unknown_fields)]
pub enum LightEntry {
    /// A light infinitely far away, such as the sun.
    DistantLight {
        /// Vector from the scene towards the light, of any length.
        direction: [f64; 3],
        /// Irradiance on a surface that faces the light.
        irradiance: [f32; 3],
        /// Angle across the light in degrees.
        #[serde(default)]
        angle: f64,
    },
    /// A point that sends out light in all directions.
    PointLight {
        /// Position in world space.
        position: [f64; 3],
        /// Radiant intensity, power per solid angle.
        intensity: [f32; 3],
    },
    /// A sphere that emits outwards.
    SphereLight {
        /// Centre in world space.
        centre: [f64; 3],
        /// Radius in world units.
        radius: f64,
        /// Radiance that leaves the sphere.
        radiance: [f32; 3],
        /// True of a disc of that radius that turns to whatever it lights, as Blender's point light with Soft Falloff.
        #[serde(default)]
        soft_falloff: bool,
    },
    /// A point, or a sphere, whose light leaves in a cone.
    SpotLight {
        /// Position, or centre, in world space.
        position: [f64; 3],
        /// Vector along which it shines, of any length.
        direction: [f64; 3],
        /// Radiant intensity along this vector, as seen from far away.
        intensity: [f32; 3],
        /// Angle across the cone in degrees, at most 360.
        angle: f64,
        /// How much of the cone its falloff takes, from 0 to 1: cosines c of the angle to the vector give the share s²
        /// (3 - 2 s), where s goes from 0 at the rim's cosine r to 1 at r + blend (1 - r).
        #[serde(default)]
        blend: f64,
        /// Radius in world units; 0 of a point.
        #[serde(default)]
        radius: f64,
        /// True of a disc that turns to whatever it lights in place of a sphere.
        #[serde(default)]
        soft_falloff: bool,
    },
    /// A parallelogram that emits to one side.
    RectLight {
        /// Corner in world space.
        corner: [f64; 3],
        /// Edges from the corner; light leaves to the side of the first × the second.
        edges: [[f64; 3]; 2],
        /// Radiance that leaves the front.
        radiance: [f32; 3],
    },
    /// Light from all around. Those without a texture add.
    DomeLight {
        /// Radiance from all directions, or factor of the texture.
        #[serde(default = "white")]
        radiance: [f32; 3],
        /// Equirectangular EXR of the radiance, found from the folder of the scene: the top row is towards +Z, the
        /// middle towards +X, and to the right it turns towards -Y.
        texture: Option<PathBuf>,
    },
}

impl LightEntry {
    /// Returns the light; `None` for light from all around.
    ///
    /// # Errors
    /// If the light cannot be.
    pub fn light(&self) -> Result<Option<Light>> {
        let point = DVec3::from_array;
        let color = Vec3::from_array;
        let light = match *self {
            Self::DistantLight { direction, irradiance, angle } => Some(Light::Sun {
                direction: point(direction),
                irradiance: color(irradiance),
                angle: angle.to_radians(),
            }),
            Self::PointLight { position, intensity } => {
                Some(Light::Point { position: point(position), intensity: color(intensity) })
            }
            Self::SphereLight { centre, radius, radiance, soft_falloff } => {
                let (centre, radiance) = (point(centre), color(radiance));
                Some(match soft_falloff {
                    true => Light::Disc { centre, radius, radiance },
                    false => Light::Sphere { centre, radius, radiance },
                })
            }
            Self::SpotLight { position, direction, intensity, angle, blend, radius, soft_falloff } => {
                Some(Light::Spot {
                    position: point(position),
                    radius,
                    soft: soft_falloff,
                    intensity: color(intensity),
                    cone: Cone::new(point(direction), 0.5 * angle.to_radians(), blend)?,
                })
            }
            Self::RectLight { corner, edges, radiance } => {
                Some(Light::Rectangle { corner: point(corner), edges: edges.map(point), radiance: color(radiance) })
            }
            Self::DomeLight { .. } => None,
        };
        light.map(Light::checked).transpose()
    }
}

/// Returns the JSON schema of scene files.
pub fn schema() -> schemars::Schema {
    schemars::schema_for!(SceneFile)
}
