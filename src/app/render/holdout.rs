//! Objects that hide what is behind them, from depth pictures of other renderers and from meshes.

use super::RenderSettings;
use crate::app::depths;
use crate::app::sequence::pattern;
use crate::error::{Code, Error, Result};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::mesh::MeshFormat;
use crate::formats::registry;
use crate::scene::holdout::{DepthMap, DepthMeasure, Holdout};
use crate::scene::surfaces::Surfaces;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Advice where no layer is that of depths.
const NAME_ONE: &str = "name the layer that has the depths with ⟨holdout_layer⟩";

/// Settings of holdouts.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct HoldoutSettings {
    /// EXR with the depths of the objects that hide what is behind them, or a mesh of them in world space, PLY, OBJ or
    /// glTF; or those of frames, such as depth.####.exr; none if nothing stands in the way.
    #[serde(skip_serializing_if = "Option::is_none", with = "crate::app::paths")]
    pub holdout: Option<PathBuf>,
    /// Layer that has the depths; none for the only one that is plainly that.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub holdout_layer: Option<String>,
    /// Distance that the depths are.
    pub holdout_depth: DepthMeasure,
}

impl HoldoutSettings {
    /// Refuses settings that contradict each other.
    pub(super) fn check(&self) -> Result<()> {
        let others = self.holdout_layer.is_some() || self.holdout_depth != DepthMeasure::default();
        if self.holdout.is_none() && others {
            return Err(Error::invalid("⟨holdout_layer⟩ and ⟨holdout_depth⟩ tell of depths, and none are given")
                .coded(Code::Usage)
                .hint("give the picture of depths: ⟨holdout⟩"));
        }
        match self.holdout.as_deref().filter(|path| others && mesh_format(path).is_some()) {
            Some(path) => Err(Error::invalid("⟨holdout_layer⟩ and ⟨holdout_depth⟩ tell of depths, and this is a mesh")
                .coded(Code::Usage)
                .at(path)
                .hint("leave them out")),
            None => Ok(()),
        }
    }

    /// Refuses one picture of depths for several views.
    pub(super) fn check_views(&self, views: usize) -> Result<()> {
        match &self.holdout {
            Some(path) if views > 1 && pattern(path).is_none() && mesh_format(path).is_none() => {
                Err(Error::invalid(format!("⟨holdout⟩: one picture of depths for {views} views"))
                    .hint("give one for each view, depth.####.exr, or choose a view with ⟨view⟩"))
            }
            _ => Ok(()),
        }
    }

    /// Returns the file with the depths or the mesh for the view or frame of a number.
    pub(super) fn file(&self, number: u32) -> Option<PathBuf> {
        let path = self.holdout.as_ref()?;
        Some(pattern(path).map_or_else(|| path.clone(), |pattern| pattern.path(number)))
    }
}

impl RenderSettings {
    /// Reads what stands in the way of the camera of a view or frame; none if nothing does. `whole` is the size of the
    /// whole picture.
    ///
    /// # Errors
    /// If the depths or the mesh cannot be read or do not fit the picture.
    pub(super) fn held_out(&self, number: u32, whole: [u32; 2], last: &LastMesh) -> Result<Option<Holdout>> {
        let HoldoutSettings { holdout_layer, holdout_depth, .. } = &self.holdout;
        let Some(path) = self.holdout.file(number) else { return Ok(None) };
        let limits = self.pictures.limits;
        if let Some(format) = mesh_format(&path) {
            return last.read(&path, format, limits).map(Holdout::Surfaces).map(Some);
        }
        let (size, depths) = depths::read(&path, holdout_layer.as_deref(), NAME_ONE, limits)?;
        let view = (whole, self.pictures.crop);
        DepthMap::new(size, depths, *holdout_depth, view)
            .map(|depths| Some(Holdout::Depths(depths)))
            .map_err(|e| e.at(&path))
    }
}

/// The mesh that was read last, for several pictures.
#[derive(Debug, Default)]
pub(super) struct LastMesh(Mutex<Option<(PathBuf, Arc<Surfaces>)>>);

impl LastMesh {
    fn read(&self, path: &Path, format: &MeshFormat, limits: Limits) -> Result<Arc<Surfaces>> {
        let mut last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, surfaces)) = last.as_ref().filter(|(known, _)| known == path) {
            return Ok(Arc::clone(surfaces));
        }
        let triangles = format.triangles(path, limits)?;
        let surfaces = Arc::new(Surfaces::new(&triangles).map_err(|e| e.at(path))?);
        *last = Some((path.to_path_buf(), Arc::clone(&surfaces)));
        Ok(surfaces)
    }
}

/// Returns the format of a mesh by the name of its file; `None` of pictures.
fn mesh_format(path: &Path) -> Option<&'static MeshFormat> {
    match registry::by_name(path)?.kind {
        FileKind::Mesh(format) => Some(format),
        _ => None,
    }
}

/// Returns what is to be said of depths that straight rays, this many along an edge of a pixel, do not all meet.
pub(super) fn coarse(holdout: &Holdout, paths: bool, supersample: u32) -> Option<String> {
    let Holdout::Depths(holdout) = holdout else { return None };
    let per_edge = holdout.per_edge().round();
    (!paths && per_edge > f64::from(supersample)).then(|| {
        format!(
            "⟨holdout⟩ has {per_edge} depths along an edge of a pixel: give ⟨supersample={per_edge}⟩ to see all of them"
        )
    })
}

/// Returns what is to be said of depths of 0, at which all is hidden.
pub(super) fn hides_all(holdout: &Holdout) -> Option<String> {
    let Holdout::Depths(holdout) = holdout else { return None };
    let share = holdout.at_camera();
    (share > 0.0).then(|| {
        format!(
            "at {:.1} % of the pixels of ⟨holdout⟩ the depth is 0, and all is hidden; where nothing stands, depths are \
             infinite or large",
            100.0 * share
        )
    })
}
