//! The report on a stage that was written.

use super::volumes;
use crate::app::checks::Warning;
use crate::app::provenance::Provenance;
use crate::app::up::ChosenUp;
use crate::formats::usd::write::stage::{ROOT, StageText};
use crate::formats::usd::write::volume::VolumePrim;
use crate::text::printable;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// Report on a stage that was written.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct AuthorReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    /// Up axis of the stage.
    up: ChosenUp,
    frames: Option<[u32; 2]>,
    volumes: Vec<Written>,
    meshes: usize,
    cameras: usize,
    lights: usize,
    pub(super) warnings: Vec<Warning>,
    provenance: Provenance,
}

/// A volume of the stage.
#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Written {
    /// Path of the prim.
    prim: String,
    files: usize,
    /// Names of the grids.
    fields: Vec<String>,
    /// World-space box around all frames; none if there is nothing to be seen.
    bounds: Option<[[f64; 3]; 2]>,
}

impl AuthorReport {
    /// Describes a stage that was written to `output`.
    pub(super) fn of(stage: &StageText, output: PathBuf, up: ChosenUp, provenance: Provenance) -> Self {
        let mut warnings: Vec<Warning> = stage.volumes.iter().flat_map(volumes::remarks).collect();
        for volume in &stage.volumes {
            let omitted = stage.renderer.omits(&volume.medium);
            if !omitted.is_empty() {
                let what = format!(
                    "{}: the material for {} lacks {}",
                    volume.name,
                    stage.renderer.name(),
                    omitted.join(" and ")
                );
                warnings
                    .push(Warning::new(what, "Cumulo reads it from the attributes; set it by hand for this renderer"));
            }
        }
        let written = |volume: &VolumePrim| {
            let bounds = volume.bounds();
            let mut fields: Vec<String> = Vec::new();
            for field in volume.frames.iter().flat_map(|frame| &frame.fields) {
                if !fields.contains(&field.name) {
                    fields.push(field.name.clone());
                }
            }
            Written {
                prim: format!("/{}/{}", ROOT, volume.name),
                files: volume.frames.len(),
                fields,
                bounds: (!bounds.is_empty()).then(|| [bounds.min.to_array(), bounds.max.to_array()]),
            }
        };
        Self {
            output,
            up,
            frames: stage.frames,
            volumes: stage.volumes.iter().map(written).collect(),
            meshes: stage.meshes.len(),
            cameras: stage.cameras.len(),
            lights: stage.lights.len(),
            warnings,
            provenance,
        }
    }
}

impl fmt::Display for AuthorReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: {} volume(s), {} mesh(es), {} camera(s), {} light(s)",
            self.output.display(),
            self.volumes.len(),
            self.meshes,
            self.cameras,
            self.lights
        )?;
        match self.frames {
            Some([first, last]) => writeln!(f, ", frames {first} to {last}")?,
            None => writeln!(f)?,
        }
        for volume in &self.volumes {
            let fields = volume.fields.iter().map(|name| printable(name)).collect::<Vec<_>>().join(", ");
            writeln!(f, "  {}: {} file(s), fields {fields}", volume.prim, volume.files)?;
            if let Some([low, high]) = volume.bounds {
                writeln!(f, "    from {low:?} to {high:?}")?;
            }
        }
        crate::app::run::write_warnings(f, &self.warnings)
    }
}
