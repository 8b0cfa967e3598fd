//! A whole stage: metadata, and one root prim with all else beneath it.

use super::camera::{self, CameraPrim, Scale};
use super::light;
use super::material::Renderer;
use super::mesh::MeshPrim;
use super::names::Names;
use super::text::{PrimText, quoted};
use super::volume::VolumePrim;
use crate::error::Result;
use crate::formats::scene_file::LightEntry;
use crate::formats::usd::UpAxis;
use crate::math::Aabb;
use std::collections::BTreeMap;

/// Name of the root prim, which is the stage's default.
pub(crate) const ROOT: &str = "World";

/// A stage to be written.
#[derive(Debug, Clone)]
pub(crate) struct StageText {
    /// Axis that points upwards.
    pub up_axis: UpAxis,
    /// Meters to a unit.
    pub meters_per_unit: f64,
    /// Frames per second; time codes are numbers of frames.
    pub fps: f64,
    /// Numbers of the first and last frame; `None` for a stage at rest.
    pub frames: Option<[u32; 2]>,
    /// Renderer whose materials are bound.
    pub renderer: Renderer,
    /// Volumes.
    pub volumes: Vec<VolumePrim>,
    /// Meshes.
    pub meshes: Vec<MeshPrim>,
    /// Lights, each with the path of its picture from the stage's folder.
    pub lights: Vec<(LightEntry, Option<String>)>,
    /// Cameras.
    pub cameras: Vec<CameraPrim>,
    /// Program, command line and hashes of the inputs.
    pub provenance: BTreeMap<String, String>,
}

impl StageText {
    /// Returns the stage as the text of a `.usda` file.
    ///
    /// # Errors
    /// If a volume or a light has no form in USD.
    pub(crate) fn text(&self) -> Result<String> {
        let mut root = PrimText::new("Xform", ROOT);
        let path = format!("/{ROOT}");
        for volume in &self.volumes {
            root.children.push(volume.prim(&path, self.renderer)?);
        }
        let bounds = self.volumes.iter().fold(Aabb::EMPTY, |all, volume| all.union(volume.bounds()));
        let mut names = Names::default();
        let lights: Vec<PrimText> = self
            .lights
            .iter()
            .map(|(entry, texture)| light::prim(entry, names.take(kind(entry)), texture.clone()))
            .collect::<Result<_>>()?;
        let cameras = self.cameras.iter().map(|camera| camera::prim(camera, self.scale(camera, bounds))).collect();
        let meshes = self.meshes.iter().map(MeshPrim::prim).collect();
        for (name, children) in [("Meshes", meshes), ("Lights", lights), ("Cameras", cameras)] {
            if !children.is_empty() {
                root.children.push(PrimText { children, ..PrimText::new("Xform", name) });
            }
        }
        let mut text = self.header();
        root.write(&mut text, 0);
        Ok(text)
    }

    fn header(&self) -> String {
        let mut lines = vec![format!("defaultPrim = \"{ROOT}\""), format!("metersPerUnit = {}", self.meters_per_unit)];
        lines.push(format!("upAxis = \"{:?}\"", self.up_axis));
        if let Some([first, last]) = self.frames {
            lines.extend([format!("startTimeCode = {first}"), format!("endTimeCode = {last}")]);
        }
        // Velocities of a stage at rest are per second as well.
        lines.extend([format!("timeCodesPerSecond = {}", self.fps), format!("framesPerSecond = {}", self.fps)]);
        lines.extend(["customLayerData = {".into(), "    dictionary cumulo = {".into()]);
        let entry = |(key, value): (&String, &String)| format!("        string {} = {}", quoted(key), quoted(value));
        lines.extend(self.provenance.iter().map(entry));
        lines.extend(["    }".into(), "}".into()]);
        format!("#usda 1.0\n(\n{})\n\n", lines.iter().map(|line| format!("    {line}\n")).collect::<String>())
    }

    /// Returns the units for a camera; it sees ten times as far as the far side of the volumes.
    fn scale(&self, camera: &CameraPrim, bounds: Aabb) -> Scale {
        let reach = |corner: glam::DVec3| {
            let place = |(_, camera): &(Option<u32>, crate::scene::camera::Camera)| camera.camera_to_world.w_axis;
            camera.samples.iter().map(|sample| (place(sample).truncate() - corner).length()).fold(0.0, f64::max)
        };
        let far = if bounds.is_empty() { 1.0 } else { bounds.corners().map(reach).into_iter().fold(0.0, f64::max) };
        Scale { meters_per_unit: self.meters_per_unit, far: 10.0 * far }
    }
}

/// Returns the name of a light's prim.
fn kind(light: &LightEntry) -> &'static str {
    match light {
        LightEntry::DistantLight { .. } => "sun",
        LightEntry::PointLight { .. } => "point",
        LightEntry::SphereLight { .. } => "sphere",
        LightEntry::SpotLight { .. } => "spot",
        LightEntry::RectLight { .. } => "rectangle",
        LightEntry::DomeLight { .. } => "sky",
    }
}
