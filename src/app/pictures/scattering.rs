//! Scattering media and their lights, and the scene that settings of them describe.

use super::colors::Colors;
use crate::app::ranges;
use crate::error::{Error, Result};
use crate::formats::limits::Limits as FileLimits;
use crate::formats::scene_file::environment_map;
use crate::formats::usd::ScatteringOverride;
use crate::render::film::Sampling;
use crate::render::integrator::Counts;
use crate::render::path::Limits;
use crate::scene::albedo::{AlbedoFunction, TransferColor};
use crate::scene::environment::Environment;
use crate::scene::light::Light;
use crate::scene::medium::{Scattering, Specular};
use crate::scene::phase::Phase;
use crate::scene::scene::Scene;
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Light from all around.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Sky {
    /// Radiance that is the same from all directions.
    Color([f32; 3]),
    /// Equirectangular picture.
    File(#[serde(with = "crate::app::paths")] PathBuf),
}

impl Sky {
    /// Returns the path of the picture, if it is one.
    pub fn file(&self) -> Option<&Path> {
        match self {
            Self::File(path) => Some(path),
            Self::Color(_) => None,
        }
    }
}

/// Settings of a scattering medium and its lights. A medium that scatters light is rendered by path tracing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ScatteringSettings {
    /// Fraction of the extinction that is scattered in R, G and B, from 0 to 1; none for no scattering.
    pub albedo: Option<[f32; 3]>,
    /// Meaning of the colors of a transfer function; none for the albedo where all of them lie within 0 to 1, else
    /// emission, and for what the function states where it has an albedo of its own.
    pub tf_color: Option<TransferColor>,
    /// Mean cosine of the scattering angle (Henyey-Greenstein), -0.999 to 0.999; none for that of a stage, else 0.
    pub anisotropy: Option<f64>,
    /// Change of density per world length at which half of the light is scattered as by a surface; none for a medium
    /// alone.
    pub gradient_shading: Option<f64>,
    /// Standard deviation in voxels, from 0 to 16, of the filter that the gradients of surfaces are taken through.
    pub gradient_scale: f64,
    /// Share of the light that these surfaces reflect at normal incidence, 0 to 1; none for that of a stage, else 0.
    pub specular: Option<f64>,
    /// Roughness of this reflection, the α of GGX, 0.05 to 1; none for that of a stage, else 0.3.
    pub roughness: Option<f64>,
    /// Factors of the extinction in R, G and B; none for those of a stage, else 1.
    pub extinction_color: Option<[f32; 3]>,
    /// Vector from the volume towards a sun.
    pub sun: Option<[f64; 3]>,
    /// Irradiance of the sun in R, G and B on a surface that faces it.
    pub sun_color: [f32; 3],
    /// Angle across the sun in degrees.
    pub sun_angle: f64,
    /// Radiance from all around; none for black with a sun, else white.
    pub sky: Option<Sky>,
    /// Paths per pixel; none for 64.
    pub samples: Option<u32>,
    /// Seed of the random numbers; none for 0.
    pub seed: Option<u64>,
    /// Most scatterings along a path; none for no limit.
    pub max_bounces: Option<u32>,
    /// Most radiance that is scattered to a path; none for no clamping.
    pub clamp: Option<f64>,
}

impl Default for ScatteringSettings {
    fn default() -> Self {
        Self {
            albedo: None,
            tf_color: None,
            anisotropy: None,
            gradient_shading: None,
            gradient_scale: 0.0,
            specular: None,
            roughness: None,
            extinction_color: None,
            sun: None,
            sun_color: [1.0; 3],
            sun_angle: 0.53,
            sky: None,
            samples: None,
            seed: None,
            max_bounces: None,
            clamp: None,
        }
    }
}

/// Paths per pixel unless stated.
const SAMPLES: u32 = 64;

impl ScatteringSettings {
    /// Returns true if path tracing is asked for.
    pub fn on(&self) -> bool {
        self.albedo.is_some()
    }

    /// True if the settings state lights.
    pub fn lights(&self) -> bool {
        self.sun.is_some() || self.sky.is_some()
    }

    /// Returns what the settings state of how a stage's media scatter; `None` without an albedo.
    pub fn overrides(&self) -> Option<ScatteringOverride> {
        let Self { tf_color, anisotropy, gradient_shading, specular, roughness, extinction_color, .. } = *self;
        self.albedo.map(|albedo| ScatteringOverride {
            albedo,
            tf_color,
            anisotropy,
            gradient_shading,
            specular,
            roughness,
            extinction_color,
        })
    }

    /// Returns the factors of the extinction in red, green and blue.
    pub fn extinction_color(&self) -> [f32; 3] {
        self.extinction_color.unwrap_or([1.0; 3])
    }

    /// Returns the radiance that is the same from all around.
    pub fn sky(&self) -> [f32; 3] {
        match &self.sky {
            Some(Sky::Color(color)) => *color,
            Some(Sky::File(_)) => [0.0; 3],
            None if self.sun.is_some() => [0.0; 3],
            None => [1.0; 3],
        }
    }

    /// Returns the picture of the sky, if one is given.
    pub(crate) fn sky_file(&self) -> Option<&Path> {
        self.sky.as_ref().and_then(Sky::file)
    }

    /// Returns how the medium scatters; `None` without path tracing.
    pub fn scattering(&self) -> Option<Scattering> {
        let phase = Phase::of_anisotropy(self.anisotropy.unwrap_or_default());
        let Self { gradient_shading, gradient_scale, .. } = *self;
        let specular = Specular::of(self.specular.unwrap_or_default(), self.roughness);
        let new = |albedo| Scattering { gradient_shading, gradient_scale, specular, ..Scattering::new(albedo, phase) };
        self.albedo.map(new)
    }

    /// Puts the environment and the lights of the settings into a scene.
    ///
    /// # Errors
    /// If the picture of the sky cannot be read or used.
    pub fn light(&self, scene: Scene, limits: FileLimits) -> Result<Scene> {
        let map = self.sky_file().map(|path| environment_map(path, [1.0; 3], limits).map(Arc::new)).transpose()?;
        let sun = self.sun.map(|direction| Light::Sun {
            direction: DVec3::from_array(direction),
            irradiance: Vec3::from_array(self.sun_color),
            angle: self.sun_angle.to_radians(),
        });
        let environment = Environment { radiance: self.sky(), map };
        Ok(Scene { environment, lights: sun.into_iter().collect(), ..scene })
    }

    /// Returns how far paths go at most.
    pub fn limits(&self) -> Limits {
        Limits { max_bounces: self.max_bounces.unwrap_or(u32::MAX) }
    }

    /// Refuses settings of path tracing without it.
    ///
    /// # Errors
    /// If such a setting is given, and `paths` is false.
    pub fn check(&self, paths: bool) -> Result<()> {
        let given = [
            ("⟨samples⟩", self.samples.is_some()),
            ("⟨seed⟩", self.seed.is_some()),
            ("⟨max_bounces⟩", self.max_bounces.is_some()),
            ("⟨clamp⟩", self.clamp.is_some()),
        ];
        match given.iter().find(|(_, given)| *given && !paths) {
            Some((option, _)) => {
                Err(Error::invalid(format!("{option}: nothing is scattered, and no paths are traced"))
                    .hint(format!("give ⟨albedo⟩ or a scene file, or leave {option} out")))
            }
            None => Ok(()),
        }
    }

    /// Refuses values out of their ranges.
    ///
    /// # Errors
    /// If a value is none that its setting may have; the error names it.
    pub(super) fn check_ranges(&self) -> Result<()> {
        ranges::shares("albedo", self.albedo)?;
        if self.tf_color.is_some() && !self.on() {
            return Err(Error::invalid("⟨tf_color⟩: nothing is scattered, and the colors are emission")
                .hint("give ⟨albedo⟩, or leave ⟨tf_color⟩ out"));
        }
        if let Some(g) = self.anisotropy {
            ranges::require("anisotropy", g, (-0.999..=0.999).contains(&g), "a number from -0.999 to 0.999")?;
        }
        ranges::positive("gradient_shading", self.gradient_shading)?;
        let scale = self.gradient_scale;
        ranges::require("gradient_scale", scale, (0.0..=16.0).contains(&scale), "a number of voxels from 0 to 16")?;
        if let Some(r) = self.specular {
            ranges::require("specular", r, (0.0..=1.0).contains(&r), "a number from 0 to 1")?;
        }
        if let Some(a) = self.roughness {
            let [least, most] = Specular::ROUGHNESS;
            ranges::require("roughness", a, (least..=most).contains(&a), "a number from 0.05 to 1")?;
        }
        ranges::radiance("extinction_color", self.extinction_color)?;
        if let Some(sun) = self.sun {
            let holds = DVec3::from_array(sun).normalize().is_normalized();
            ranges::require("sun", sun, holds, "a vector that has a direction")?;
        }
        ranges::radiance("sun_color", self.sun_color)?;
        let angle = self.sun_angle;
        ranges::require("sun_angle", angle, angle.is_finite() && angle >= 0.0, "an angle from 0 degrees up")?;
        if let Some(Sky::Color(color)) = &self.sky {
            ranges::radiance("sky", *color)?;
        }
        ranges::within("samples", self.samples, [1, 1 << 24])?;
        ranges::positive("clamp", self.clamp)
    }

    /// Returns the paths per pixel.
    pub fn samples(&self) -> u32 {
        self.samples.unwrap_or(SAMPLES)
    }

    /// Returns the paths of a view.
    pub fn sampling(&self, view: usize) -> Sampling {
        self.paths_of(self.samples(), self.seed_of(view))
    }

    /// Returns that many paths of a view, whose random numbers are those of a stream of their own; stream 0 has those
    /// of [`Self::sampling`].
    pub(super) fn replicate(&self, view: usize, samples: u32, stream: u64) -> Sampling {
        // Fibonacci hashing: streams of a view, and seeds that differ little, have nothing in common.
        self.paths_of(samples, self.seed_of(view) ^ stream.wrapping_mul(0x9E37_79B9_7F4A_7C15))
    }

    fn seed_of(&self, view: usize) -> u64 {
        self.seed.unwrap_or(0) ^ (view as u64) << 32
    }

    fn paths_of(&self, samples: u32, seed: u64) -> Sampling {
        Sampling::random(samples, seed).clamped(self.clamp.map(|most| most as f32))
    }

    /// Returns the settings as the capture's record of how its pictures were made, with what the colors of the transfer
    /// function were taken for, if there was one.
    pub(in crate::app) fn record(&self, colors: Option<&Colors>) -> Value {
        let mut record = json!({
            "albedo": self.albedo,
            "anisotropy": self.anisotropy.unwrap_or_default(),
            "gradient_shading": self.gradient_shading,
            "gradient_scale": self.gradient_scale,
            "extinction_color": self.extinction_color(),
            "sky": match &self.sky {
                Some(Sky::File(path)) => json!(path.to_string_lossy()),
                _ => json!(self.sky()),
            },
            "sun": self.sun.map(|sun| json!({
                "direction": sun,
                "irradiance": self.sun_color,
                "angle_degrees": self.sun_angle,
            })),
            "samples": self.samples(),
            "seed": self.seed.unwrap_or(0),
            "max_bounces": self.max_bounces,
            "clamp": self.clamp,
        });
        let Some(entries) = record.as_object_mut() else { return record };
        if let Some(Colors { color, own, .. }) = colors {
            entries.insert("tf_color".into(), json!(color));
            entries.extend(own.as_ref().map(|own| ("tf_albedo".to_owned(), json!({"points": own.points()}))));
        }
        let specular = Specular::of(self.specular.unwrap_or_default(), self.roughness);
        if let Some(Specular { reflectance, roughness }) = specular {
            entries.insert("specular".into(), json!(reflectance));
            entries.insert("roughness".into(), json!(roughness));
        }
        record
    }

    /// Returns the summary of the events while pictures of `samples` paths a pixel were traced.
    pub fn paths(&self, samples: u32, counts: Counts) -> Paths {
        let each = |events: u64| events as f64 / counts.paths.max(1) as f64;
        Paths {
            samples,
            max_bounces: self.max_bounces,
            paths: counts.paths,
            collisions_per_path: each(counts.collisions),
            lookups_per_path: each(counts.lookups),
            shadow_rays_per_path: each(counts.shadow_rays),
            majorant_violations: counts.violations,
            impossible_directions: counts.impossible,
            unfinished_paths: counts.unfinished,
            clamp: self.clamp.map(|most| Clamp {
                most,
                share_of_paths: each(counts.clamped),
                lost_radiance: counts.lost / counts.paths.max(1) as f64,
            }),
        }
    }
}

/// Record of a capture ([`ScatteringSettings::record`]), as far as pictures depend on it.
#[derive(Deserialize)]
struct Record {
    albedo: Option<[f32; 3]>,
    tf_color: Option<TransferColor>,
    tf_albedo: Option<RecordedAlbedo>,
    anisotropy: Option<f64>,
    gradient_shading: Option<f64>,
    #[serde(default)]
    gradient_scale: f64,
    specular: Option<f64>,
    roughness: Option<f64>,
    extinction_color: Option<[f32; 3]>,
    sky: Sky,
    sun: Option<RecordedSun>,
    max_bounces: Option<u32>,
    clamp: Option<f64>,
}

/// Albedo of a transfer function in a record.
#[derive(Deserialize)]
struct RecordedAlbedo {
    points: Vec<[f64; 4]>,
}

/// Sun of a record.
#[derive(Deserialize)]
struct RecordedSun {
    direction: [f64; 3],
    irradiance: [f32; 3],
    angle_degrees: f64,
}

impl ScatteringSettings {
    /// Returns the settings that [`ScatteringSettings::record`] has put into a capture, with the albedo that the
    /// transfer function had of its own; `None` without an albedo.
    ///
    /// # Errors
    /// If the record is none, or a value is none that its setting may have.
    pub(in crate::app) fn of_record(record: &Value) -> Result<Option<(Self, Option<Arc<AlbedoFunction>>)>> {
        let unusable = |why: String| {
            Error::invalid(format!("'scattering' cannot be used: {why}")).hint("render the pictures again")
        };
        let read = Record::deserialize(record).map_err(|e| unusable(e.to_string()))?;
        let Some(albedo) = read.albedo else { return Ok(None) };
        let usual = Self::default();
        let (sun_color, sun_angle) =
            read.sun.as_ref().map_or((usual.sun_color, usual.sun_angle), |sun| (sun.irradiance, sun.angle_degrees));
        let settings = Self {
            albedo: Some(albedo),
            tf_color: read.tf_color,
            anisotropy: read.anisotropy,
            gradient_shading: read.gradient_shading,
            gradient_scale: read.gradient_scale,
            specular: read.specular,
            roughness: read.roughness,
            extinction_color: read.extinction_color,
            sun: read.sun.map(|sun| sun.direction),
            sun_color,
            sun_angle,
            sky: Some(read.sky),
            max_bounces: read.max_bounces,
            clamp: read.clamp,
            ..usual
        };
        settings.check_ranges().map_err(|e| unusable(e.what().to_string()))?;
        let own = read.tf_albedo.map(|own| AlbedoFunction::new(&own.points)).transpose()?;
        Ok(Some((settings, own.map(Arc::new))))
    }
}

/// Returns the settings that state the albedo and the lights that [`ScatteringSettings::record`] has put into a
/// capture; `None` without an albedo.
pub(crate) fn recorded(record: &Value) -> Option<String> {
    let text = |number: &Value| match number.as_f64() {
        // Colors were numbers of 32 bits.
        Some(v) if f64::from(v as f32) == v => (v as f32).to_string(),
        _ => number.to_string(),
    };
    let join = |all: &[Value]| all.iter().map(text).collect::<Vec<_>>().join(",");
    let value = |path: &str| record.pointer(path).filter(|value| !value.is_null());
    let option = |name: &str, path: &str| {
        let words = match value(path)? {
            Value::Array(all) if all.windows(2).all(|pair| pair[0] == pair[1]) => join(&all[..1.min(all.len())]),
            Value::Array(all) => join(all),
            Value::String(path) => path.clone(),
            number => text(number),
        };
        Some(format!("⟨{name}={words}⟩"))
    };
    let sun = value("/sun/direction").and_then(Value::as_array).map(|direction| format!("⟨sun={}⟩", join(direction)));
    let options = [
        Some(option("albedo", "/albedo")?),
        option("tf_color", "/tf_color"),
        option("anisotropy", "/anisotropy").filter(|words| words != "⟨anisotropy=0⟩"),
        option("gradient_shading", "/gradient_shading"),
        option("gradient_scale", "/gradient_scale").filter(|words| words != "⟨gradient_scale=0⟩"),
        option("specular", "/specular"),
        option("roughness", "/roughness"),
        option("extinction_color", "/extinction_color").filter(|words| words != "⟨extinction_color=1⟩"),
        sun,
        option("sun_color", "/sun/irradiance"),
        option("sun_angle", "/sun/angle_degrees"),
        option("sky", "/sky"),
    ];
    Some(options.into_iter().flatten().collect::<Vec<_>>().join(" "))
}

/// Number of events while paths were traced.
#[derive(Debug, Clone, Copy, Serialize, schemars::JsonSchema)]
pub struct Paths {
    /// Paths per pixel; their mean, where pixels have as many as their error takes.
    pub samples: u32,
    /// Most scatterings along a path; none without a limit.
    pub max_bounces: Option<u32>,
    /// Paths of all pictures.
    pub paths: u64,
    /// Real collisions with the medium.
    pub collisions_per_path: f64,
    /// Densities looked up to find collisions.
    pub lookups_per_path: f64,
    /// Rays to lights.
    pub shadow_rays_per_path: f64,
    /// Extinctions above their bound; any of them biases the pictures.
    pub majorant_violations: u64,
    /// Directions of no density; any of them biases the pictures.
    pub impossible_directions: u64,
    /// Paths that were given up after 4096 scatterings, between surfaces that absorb nothing; any of them biases the
    /// pictures.
    pub unfinished_paths: u64,
    /// Clamping, if it was asked for.
    pub clamp: Option<Clamp>,
}

/// Effect of clamping on pictures.
#[derive(Debug, Clone, Copy, Serialize, schemars::JsonSchema)]
pub struct Clamp {
    /// Most radiance that was scattered to a path.
    pub most: f64,
    /// Share of paths that were clamped.
    pub share_of_paths: f64,
    /// Radiance that pixels lost, on average.
    pub lost_radiance: f64,
}

impl fmt::Display for Paths {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bounces = self.max_bounces.map_or("any number of".to_owned(), |most| format!("at most {most}"));
        write!(f, "  {} paths a pixel, {bounces} scatterings; ", self.samples)?;
        let Self { collisions_per_path, lookups_per_path, shadow_rays_per_path, .. } = self;
        write!(f, "{collisions_per_path:.2} collisions, {lookups_per_path:.1} lookups and ")?;
        write!(f, "{shadow_rays_per_path:.2} rays to lights a path")?;
        if let Some(Clamp { most, share_of_paths, lost_radiance }) = self.clamp {
            let percent = 100.0 * share_of_paths;
            write!(
                f,
                "\n  clamped at {most}: {percent:.2} % of the paths, pixels lost {lost_radiance:.2e} on average"
            )?;
        }
        if self.majorant_violations + self.impossible_directions > 0 {
            write!(
                f,
                "\nwarning: {} majorants violated, {} impossible directions: the pictures are biased",
                self.majorant_violations, self.impossible_directions
            )?;
        }
        if self.unfinished_paths > 0 {
            write!(
                f,
                "\nwarning: {} paths had not ended after 4096 scatterings, and their light is missing: give surfaces \
                 an albedo below 1, or a limit by {}",
                self.unfinished_paths,
                crate::wording::worded("⟨max_bounces⟩")
            )?;
        }
        Ok(())
    }
}
