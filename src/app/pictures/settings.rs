//! Settings of what pictures show, and from where.

use super::aim::AimSettings;
use super::scattering::ScatteringSettings;
use crate::app::ranges;
use crate::app::scan::ScanSettings;
use crate::app::transfer::TransferSettings;
use crate::app::up::UpChoice;
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::sequence::Frames;
use crate::plan::Effect;
use crate::render::quadrature::Quadrature;
use crate::scene::camera::Window;
use crate::scene::capture::{EmissionModel, Model};
use crate::scene::orbit::Layout;
use crate::scene::shading::Shading;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Settings that pictures are made by: subject, cameras, media and light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PictureSettings {
    /// VDB, NanoVDB, scan, USD stage, or scene file in JSON, to render; a pattern such as smoke.####.vdb or a folder of
    /// numbered VDBs is a sequence.
    #[serde(with = "crate::app::paths")]
    pub input: PathBuf,
    /// Number of the frame, where a sequence is rendered.
    #[serde(skip)]
    pub frame: Option<u32>,
    /// Number of cameras to place around the volume; none where `cameras` or the stage states them.
    pub views: Option<u32>,
    /// Cameras by sides, angles or positions, in place of `views`.
    #[serde(flatten)]
    pub aim: AimSettings,
    /// Axis that points upwards, about which cameras are placed.
    pub up: UpChoice,
    /// Numbers of the views to render, from 0; none for all.
    pub view: Vec<Frames>,
    /// How cameras are placed.
    pub layout: Layout,
    /// Width and height of the pictures in pixels; none for 256 x 256, that of the capture's pictures, or 256 pixels in
    /// the proportions of a stage's aperture.
    pub size: Option<[u32; 2]>,
    /// Angle of view in degrees that holds the volume's bounding sphere, from 0.001 to 170: the distance of cameras
    /// that are placed; where a distance or an eye is stated, the angle across the shorter side of the picture.
    pub fov: f64,
    /// Part of each picture that is rendered; none for all of it.
    pub crop: Option<Window>,
    /// A transforms.json, a model of COLMAP or a USD stage that states the cameras, and of a transforms.json also the
    /// medium that the settings leave open.
    #[serde(with = "crate::app::paths")]
    pub cameras: Option<PathBuf>,
    /// Path of the USD stage's camera; none for the only one.
    pub camera: Option<String>,
    /// Model of the pictures; none for that of `cameras`, emission and absorption with a transfer function, else
    /// absorption.
    pub model: Option<Model>,
    /// Extinction per world unit at a density of 1; none for that of `cameras`, else 1.
    pub density_scale: Option<DensityScale>,
    /// Radiance behind the volume in R, G and B; none for that of `cameras`, else white for absorption and black for
    /// emission and absorption.
    pub background: Option<[f32; 3]>,
    /// Radiance of the source in R, G and B; none for that of `cameras`, else white.
    pub emission: Option<[f32; 3]>,
    /// How that radiance follows the density; none for that of `cameras`, else not at all.
    pub emission_model: Option<EmissionModel>,
    /// Transfer function that makes extinctions and colors of densities.
    #[serde(flatten)]
    pub transfer: TransferSettings,
    /// Integration along rays; none for the one that suits the scene.
    pub quadrature: Option<Quadrature>,
    /// Transmittance at which rays end; 0 for never.
    pub early_stop: f64,
    /// Shading of the surfaces that a transfer function shows, along straight rays; none for none.
    pub shade: Option<Shading>,
    /// Rays along each edge of a pixel, from 1 to 64; more than one make it the mean over its square.
    pub supersample: u32,
    /// Name of the grid; none for density, else the only scalar one.
    pub grid: Option<String>,
    /// Part of a scan that is shown, and where its voxels lie.
    #[serde(flatten)]
    pub scan: ScanSettings,
    /// Light that is scattered.
    #[serde(flatten)]
    pub scattering: ScatteringSettings,
    /// Effects that may be left out.
    #[serde(flatten)]
    pub planning: PlanningSettings,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

/// Transmittance at which rays end unless stated.
pub(crate) const EARLY_STOP: f64 = 1e-6;

impl Default for PictureSettings {
    fn default() -> Self {
        Self {
            input: PathBuf::new(),
            frame: None,
            views: None,
            aim: AimSettings::default(),
            up: UpChoice::Auto,
            view: Vec::new(),
            layout: Layout::Sphere,
            size: None,
            fov: 40.0,
            crop: None,
            cameras: None,
            camera: None,
            model: None,
            density_scale: None,
            background: None,
            emission: None,
            emission_model: None,
            transfer: TransferSettings::default(),
            quadrature: None,
            early_stop: EARLY_STOP,
            shade: None,
            supersample: 1,
            grid: None,
            scan: ScanSettings::default(),
            scattering: ScatteringSettings::default(),
            planning: PlanningSettings::default(),
            limits: Limits::default(),
        }
    }
}

impl PictureSettings {
    /// Refuses values out of their ranges.
    ///
    /// # Errors
    /// If a value is none that its setting may have; the error names it.
    pub(in crate::app) fn check(&self) -> Result<()> {
        ranges::within("views", self.views, [1, 100_000])?;
        self.aim.check()?;
        let given = self.views.map(|_| "⟨views⟩").or(self.cameras.as_ref().map(|_| "⟨cameras⟩"));
        if let (Some(given), Some(_)) = (given, self.aim.count()) {
            return Err(Error::invalid(format!("{given} beside a camera that is stated"))
                .coded(Code::Usage)
                .hint(format!("leave {given} out, or ⟨from⟩, ⟨azimuth⟩, ⟨elevation⟩ and ⟨eye⟩")));
        }
        ranges::size("size", self.size)?;
        ranges::fov("fov", self.fov)?;
        if let Some(DensityScale::Given(scale)) = self.density_scale {
            ranges::positive("density_scale", scale)?;
        }
        ranges::radiance("background", self.background)?;
        ranges::radiance("emission", self.emission)?;
        let early_stop = self.early_stop;
        ranges::require("early_stop", early_stop, (0.0..1.0).contains(&early_stop), "a number from 0 to below 1")?;
        ranges::within("supersample", self.supersample, [1, 64])?;
        let omitted = self.planning.max_omitted;
        ranges::require("max_omitted", omitted, omitted.is_finite() && omitted >= 0.0, "a number from 0 up")?;
        self.check_shading()?;
        self.scattering.check_ranges()
    }

    /// Refuses shading that does not go with the other settings.
    fn check_shading(&self) -> Result<()> {
        let Some(shading) = self.shade else {
            return match self.scattering.gradient_scale > 0.0 && self.scattering.gradient_shading.is_none() {
                true => Err(Error::invalid("⟨gradient_scale⟩: no surface is shaded")
                    .hint("add ⟨shade⟩ or ⟨gradient_shading⟩, or leave ⟨gradient_scale⟩ out")),
                false => Ok(()),
            };
        };
        shading.checked()?;
        if self.scattering.on() {
            return Err(Error::invalid("⟨shade⟩ is for straight rays, and ⟨albedo⟩ traces paths")
                .hint("leave one of them out: ⟨gradient_shading⟩ makes paths scatter at surfaces"));
        }
        match self.quadrature {
            None | Some(Quadrature::Midpoint(_)) => Ok(()),
            Some(other) => Err(Error::invalid(format!("⟨shade⟩ goes with samples at steps, and not with {other}"))
                .hint("leave ⟨quadrature⟩ out, or give ⟨quadrature=midpoint:STEP⟩ with the step in voxels")),
        }
    }

    /// Paths that the pictures are made from.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        let others = [self.transfer.file(), self.scattering.sky_file(), self.cameras.as_deref()];
        std::iter::once(self.input.as_path()).chain(others.into_iter().flatten()).collect()
    }
}

/// Settings of what may be left out of pictures.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PlanningSettings {
    /// Radiance that a channel of a pixel may miss for effects that are left out by their bounds, or of the mean of a
    /// block of 8 x 8 pixels, by measurement.
    pub max_omitted: f64,
    /// Effects that are kept whatever they add.
    pub force: Vec<Effect>,
}

/// Extinction per unit of density and length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "Stated", into = "Stated")]
pub enum DensityScale {
    /// A number, above 0.
    Given(f64),
    /// The scale that makes the 99th percentile of the pixels' optical depths 3: pictures are neither blank nor black.
    Auto,
}

/// A density scale as JSON: a number, or "auto".
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Stated {
    Number(f64),
    Word(Word),
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Word {
    Auto,
}

impl From<Stated> for DensityScale {
    fn from(stated: Stated) -> Self {
        match stated {
            Stated::Number(scale) => Self::Given(scale),
            Stated::Word(Word::Auto) => Self::Auto,
        }
    }
}

impl From<DensityScale> for Stated {
    fn from(scale: DensityScale) -> Self {
        match scale {
            DensityScale::Given(scale) => Self::Number(scale),
            DensityScale::Auto => Self::Word(Word::Auto),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Settings travel as JSON: between processes, and as the hash by which outputs know their makers.
    #[test]
    fn settings_survive_json() {
        let settings = PictureSettings {
            input: "smoke.vdb".into(),
            views: Some(8),
            view: vec![Frames { first: 0, last: 6, step: 2 }],
            crop: Some(Window { origin: [1, 2], size: [3, 4] }),
            density_scale: Some(DensityScale::Auto),
            planning: PlanningSettings {
                force: vec![Effect::Light(3), Effect::Emission],
                ..PlanningSettings::default()
            },
            ..PictureSettings::default()
        };
        let json = serde_json::to_string(&settings).unwrap_or_default();
        assert!(json.contains(r#""density_scale":"auto""#) && json.contains("\"light-3\""), "{json}");
        assert_eq!(serde_json::from_str::<PictureSettings>(&json).ok(), Some(settings));
        let short: PictureSettings =
            serde_json::from_str(r#"{"input": "a.vdb", "density_scale": 2}"#).unwrap_or_default();
        let expected = PictureSettings { density_scale: Some(DensityScale::Given(2.0)), ..PictureSettings::default() };
        assert_eq!(short, PictureSettings { input: "a.vdb".into(), ..expected });
    }

    /// Who calls the library, or writes settings as JSON, has no command line that checks them.
    #[test]
    fn values_out_of_range_are_refused_by_name() {
        type Change = fn(&mut PictureSettings);
        let refused = |change: Change| {
            let mut settings = PictureSettings::default();
            change(&mut settings);
            settings.check().err().map(|error| error.to_string()).unwrap_or_default()
        };
        assert_eq!(refused(|_| {}), "");
        let cases: [(&str, Change); 9] = [
            ("size", |s| s.size = Some([0, 64])),
            ("views", |s| s.views = Some(0)),
            ("fov", |s| s.fov = f64::NAN),
            ("density_scale", |s| s.density_scale = Some(DensityScale::Given(-1.0))),
            ("background", |s| s.background = Some([0.0, f32::NAN, 0.0])),
            ("supersample", |s| s.supersample = 0),
            ("early_stop", |s| s.early_stop = 1.0),
            ("samples", |s| s.scattering.samples = Some(0)),
            ("sun", |s| s.scattering.sun = Some([0.0; 3])),
        ];
        for (name, change) in cases {
            let error = refused(change);
            assert!(error.starts_with(&format!("`{name}` is ")) && error.ends_with("is expected"), "{name}: {error}");
        }
    }
}
