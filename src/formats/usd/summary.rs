//! Summary of a stage, for `info`.

use super::fault::Fault;
use super::light;
use super::metadata::UpAxis;
use super::prim::Prim;
use super::scene;
use super::stage::Stage;
use super::volume::{Field, Role};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::problem::Problem;
use serde::Serialize;
use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;

/// Most missing files that are listed by name.
const MOST_LISTED: usize = 10;

/// Volumes, cameras and lights of a stage, and its metadata.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub(crate) struct StageSummary {
    /// Path of the default prim.
    pub default_prim: Option<String>,
    /// Axis that points upwards.
    pub up_axis: UpAxis,
    /// True if the stage states the axis.
    pub up_axis_stated: bool,
    /// Length of a unit in meters.
    pub meters_per_unit: f64,
    /// True if the stage states the unit.
    pub meters_per_unit_stated: bool,
    /// Time codes per second.
    pub time_codes_per_second: f64,
    /// First time code that the stage states.
    pub start: Option<f64>,
    /// Last time code that the stage states.
    pub end: Option<f64>,
    /// Number of layers, packages among them.
    pub layers: usize,
    /// Number of prims.
    pub prims: usize,
    /// Volumes.
    pub volumes: Vec<VolumeSummary>,
    /// Cameras.
    pub cameras: Vec<CameraSummary>,
    /// Lights.
    pub lights: Vec<LightSummary>,
    /// Layers and prims that the stage names and that are missing or cannot be read. What they hold is missing here.
    pub faults: Vec<Problem>,
    /// Other faults of the composition, and what has no effect here.
    pub remarks: Vec<String>,
}

impl StageSummary {
    /// Returns the error that the first of the faults is, for the stage at `path`; `None` if nothing is missing.
    pub(crate) fn error(&self, path: &Path) -> Option<Error> {
        let Problem { part, what, remedy } = self.faults.first()?;
        let error = Error::invalid(what).hint(remedy).at(path);
        Some(match part {
            Some(part) => error.part(part),
            None => error,
        })
    }
}

/// A volume of a stage.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub(crate) struct VolumeSummary {
    /// Path of the prim.
    pub path: String,
    /// True if pictures show it at the first time code.
    pub rendered: bool,
    /// Map from the volume's space to the stage's at the first time code, rows of a map of column vectors; `None` if it
    /// cannot be used.
    pub local_to_world: Option<[[f64; 4]; 4]>,
    /// True if its place changes over time.
    pub moving: bool,
    /// Fields.
    pub fields: Vec<FieldSummary>,
}

/// A field of a volume.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub(crate) struct FieldSummary {
    /// Name of the relationship, without `field:`.
    pub name: String,
    /// Part that it plays.
    pub role: Role,
    /// Name of the grid.
    pub grid: String,
    /// File at the first time code, as the stage states it.
    pub file: Option<String>,
    /// Number of time samples; 0 for a field at rest.
    pub samples: usize,
    /// First and last time code of the samples.
    pub frames: Option<[f64; 2]>,
    /// Number of files that do not exist.
    pub missing: usize,
    /// The first files that do not exist, as the stage states them.
    pub missing_files: Vec<String>,
}

/// A camera of a stage, at the first time code.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub(crate) struct CameraSummary {
    /// Path of the prim.
    pub path: String,
    /// `perspective` or `orthographic`.
    pub projection: String,
    /// Focal length in tenths of a unit.
    pub focal_length: f64,
    /// Horizontal and vertical aperture in tenths of a unit.
    pub aperture: [f64; 2],
    /// Position; `None` if the transform cannot be used.
    pub position: Option<[f64; 3]>,
    /// True if its place or optics change over time.
    pub moving: bool,
}

/// A light of a stage.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub(crate) struct LightSummary {
    /// Path of the prim.
    pub path: String,
    /// Type of the prim.
    #[serde(rename = "type")]
    pub type_name: String,
}

/// Opens a stage and summarises it.
///
/// # Errors
/// If [`Stage::open`] fails.
pub(crate) fn summary(path: &Path, limits: Limits) -> Result<StageSummary> {
    let stage = Stage::open(path, limits)?;
    let time = stage.first_time();
    let (missing, others): (Vec<&Fault>, Vec<&Fault>) = stage.faults.iter().partition(|fault| fault.incomplete);
    let mut remarks: Vec<String> = others.into_iter().map(Fault::to_string).collect();
    match light::lights(&stage, time, limits) {
        Ok(lights) => remarks.extend(lights.remarks),
        Err(error) => remarks.push(error.to_string().replace("\n  ", "; ")),
    }
    remarks.extend(stage.cameras().flat_map(|camera| stage.camera_remarks(camera, time)));
    remarks.extend(scene::other_surfaces(&stage, time));
    let lights = stage.prims().filter(|prim| light::is_light(prim));
    Ok(StageSummary {
        default_prim: stage.metadata.default_prim.clone(),
        up_axis: stage.up_axis(),
        up_axis_stated: stage.metadata.up_axis.is_some(),
        meters_per_unit: stage.meters_per_unit(),
        meters_per_unit_stated: stage.metadata.meters_per_unit.is_some(),
        time_codes_per_second: stage.time_codes_per_second(),
        start: stage.metadata.start,
        end: stage.metadata.end,
        layers: stage.layers.len(),
        prims: stage.prims().count(),
        volumes: stage.volumes().map(|volume| of_volume(&stage, volume, time)).collect(),
        cameras: stage.cameras().map(|camera| of_camera(&stage, camera, time)).collect(),
        lights: lights.map(|l| LightSummary { path: l.path.clone(), type_name: l.type_name.clone() }).collect(),
        faults: missing.into_iter().map(Fault::problem).collect(),
        remarks,
    })
}

fn of_volume(stage: &Stage, volume: &Prim, time: f64) -> VolumeSummary {
    let map = stage.local_to_world(volume, time).ok();
    VolumeSummary {
        path: volume.path.clone(),
        rendered: stage.is_rendered(volume, time),
        local_to_world: map.map(|map| [0, 1, 2, 3].map(|row| map.row(row).to_array())),
        moving: stage.is_moving(volume),
        fields: stage.fields(volume, time).into_iter().map(|field| of_field(stage, field)).collect(),
    }
}

fn of_field(stage: &Stage, field: Field) -> FieldSummary {
    let attribute = stage.prim(&field.prim).and_then(|prim| prim.attribute("filePath"));
    let samples: Vec<f64> = attribute.iter().flat_map(|a| a.times()).collect();
    let files = attribute.iter().flat_map(|a| a.values()).filter_map(|value| value.asset());
    let mut seen = BTreeSet::new();
    let missing: Vec<String> = files
        .filter(|asset| seen.insert(asset.path.clone()) && !stage.exists(asset))
        .map(|asset| asset.authored.clone())
        .collect();
    FieldSummary {
        name: field.name,
        role: field.role,
        grid: field.grid,
        file: field.file.map(|file| file.authored),
        samples: samples.len(),
        frames: samples.first().zip(samples.last()).map(|(first, last)| [*first, *last]),
        missing: missing.len(),
        missing_files: missing.into_iter().take(MOST_LISTED).collect(),
    }
}

fn of_camera(stage: &Stage, camera: &Prim, time: f64) -> CameraSummary {
    let number = |name: &str, fallback: f64| camera.number(name, time).unwrap_or(fallback);
    let map = stage.local_to_world(camera, time).ok();
    CameraSummary {
        path: camera.path.clone(),
        projection: camera.text("projection", time).unwrap_or_else(|| "perspective".into()),
        focal_length: number("focalLength", 50.0),
        aperture: [number("horizontalAperture", 20.955), number("verticalAperture", 15.2908)],
        position: map.map(|map| map.w_axis.truncate().to_array()),
        moving: stage.is_moving(camera) || camera.attributes.values().any(|a| a.is_animated()),
    }
}

impl fmt::Display for StageSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "USD stage of {} prim(s) in {} layer(s)", self.prims, self.layers)?;
        let stated = |stated: bool| if stated { "" } else { " (not stated)" };
        write!(f, "up: {:?}{}, ", self.up_axis, stated(self.up_axis_stated))?;
        writeln!(f, "meters per unit: {}{}", self.meters_per_unit, stated(self.meters_per_unit_stated))?;
        write!(f, "time codes: ")?;
        match (self.start, self.end) {
            (Some(start), Some(end)) => write!(f, "{start} to {end}")?,
            _ => write!(f, "no range")?,
        }
        writeln!(f, ", {} per second", self.time_codes_per_second)?;
        for volume in &self.volumes {
            let hidden = if volume.rendered { "" } else { ", not rendered" };
            let moving = if volume.moving { ", moving" } else { "" };
            writeln!(f, "volume {}{moving}{hidden}", volume.path)?;
            volume.fields.iter().try_for_each(|field| write!(f, "{field}"))?;
        }
        for camera in &self.cameras {
            let moving = if camera.moving { ", moving" } else { "" };
            let [w, h] = camera.aperture;
            write!(f, "camera {}: {}, focal length {}, ", camera.path, camera.projection, camera.focal_length)?;
            writeln!(f, "apertures {w} and {h}{moving}")?;
        }
        self.lights.iter().try_for_each(|light| writeln!(f, "light {}: {}", light.path, light.type_name))?;
        for Problem { part, what, .. } in &self.faults {
            let part = part.as_ref().map(|part| format!("{part}: ")).unwrap_or_default();
            writeln!(f, "fault: {part}{what}")?;
        }
        self.remarks.iter().try_for_each(|remark| writeln!(f, "remark: {remark}"))
    }
}

impl fmt::Display for FieldSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let role = format!("{:?}", self.role).to_lowercase();
        write!(f, "  field {} ({role}): grid '{}', ", self.name, self.grid)?;
        match &self.file {
            Some(file) => write!(f, "{file}")?,
            None => write!(f, "no file")?,
        }
        if let Some([first, last]) = self.frames {
            write!(f, ", {} sample(s) from {first} to {last}", self.samples)?;
        }
        writeln!(f)?;
        if self.missing > 0 {
            let more = if self.missing > self.missing_files.len() { ", …" } else { "" };
            writeln!(f, "    missing: {} file(s): {}{more}", self.missing, self.missing_files.join(", "))?;
        }
        Ok(())
    }
}
