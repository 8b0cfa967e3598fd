//! Pictures of a volume through the functions that are suggested for it.

use crate::app::checks::Warning;
use crate::app::view::camera;
use crate::cancel::Cancel;
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::metrics::boundaries::Candidate;
use crate::render::direct::DirectRenderer;
use crate::render::film::Sampling;
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::Bricks;
use crate::scene::camera::Camera;
use crate::scene::film::Film;
use crate::scene::medium::{Medium, Source};
use crate::scene::scene::Scene;
use crate::scene::table::Table;
use crate::scene::transfer::Transfer;
use crate::scene::up::Up;
use crate::scene::volume::Volume;
use serde::Serialize;
use std::sync::Arc;

/// Rays along each edge of a pixel.
const RAYS: usize = 2;
/// Transmittance at which rays end: half a level of a display.
const EARLY_STOP: f64 = 2e-3;
/// Opacity above which a pixel shows something, and above which it shows nothing behind.
const VISIBLE: f32 = 0.02;
const OPAQUE: f32 = 0.98;
/// Share of the pixels over the volume's box below which nothing is to be seen, and above which opaque ones are a
/// block.
const LEAST: f64 = 0.001;
const BLOCK: f64 = 0.98;

/// Effect of a function on a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Effect {
    /// Something of its inside.
    Shown,
    /// Nothing.
    Nothing,
    /// The volume's box, as one solid block.
    SolidBlock,
}

impl Effect {
    /// Returns a warning of a function that is of no use.
    pub(super) fn warning(self, name: &str) -> Option<Warning> {
        let what = match self {
            Self::Shown => return None,
            Self::Nothing => "shows nothing of the volume",
            Self::SolidBlock => "shows the volume as one solid block",
        };
        Some(Warning::new(format!("the function '{name}' {what}"), "choose another one with ⟨candidate⟩"))
    }
}

/// A picture, and what is to be seen in it.
pub(super) struct Picture {
    pub film: Film,
    pub effect: Effect,
    /// Share of the pixels over the volume's box in which something is to be seen.
    pub visible: f64,
}

/// A volume, and the camera that looks at it.
pub(super) struct Subject {
    /// Scene of the volume alone.
    scene: Scene,
    camera: Camera,
    /// Pixels whose rays meet the volume's box, row by row.
    met: Vec<bool>,
}

impl Subject {
    /// Returns the volume as seen by a camera that shows what any of the functions does; the longer side of the
    /// pictures has `side` pixels.
    ///
    /// # Errors
    /// If the functions show nothing of any voxel, or the volume would need more memory than is allowed.
    pub(super) fn of(
        field: Bricks<f32>,
        candidates: &[Candidate],
        (side, up): (usize, Up),
        limits: Limits,
    ) -> Result<Self> {
        let tables = candidates.iter().map(|candidate| candidate.transfer.table()).collect::<Result<Vec<Table>>>()?;
        let absorbs = |value: f64| tables.iter().any(|table| table.at(value)[3] > 0.0);
        // Voxels that no grid holds may have another value than the border.
        let absent = absorbs(field.reference + f64::from(field.background));
        let field = if absent { field.filled(limits.max_memory)? } else { field };
        let outline = field.outline_of(|stored| absorbs(field.reference + f64::from(stored)));
        if outline.is_empty() {
            return Err(Error::invalid("no voxel differs from the background")
                .coded(Code::EmptyGrid)
                .hint("choose another grid with ⟨grid⟩"));
        }
        let camera = camera::around(&outline, side, up);
        let bounds = field.transform.box_to_world(field.domain);
        let pixels = (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| [x, y]));
        let meets = |[x, y]: [u32; 2]| bounds.clip(&camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5)).is_some();
        let met = pixels.map(meets).collect();
        let medium = Medium::new(1.0, Source::Grey([0.0; 3]));
        Ok(Self { scene: Scene { volumes: vec![Volume::Density(field, medium)], ..Scene::default() }, camera, met })
    }

    /// Renders the picture through a function, before black.
    ///
    /// # Errors
    /// If the user stopped the work.
    pub(super) fn picture(&mut self, transfer: &Transfer, cancel: &Cancel) -> Result<Picture> {
        let source = Source::Transfer(Arc::new(transfer.table()?));
        let quadrature = Quadrature::usual(&source);
        for volume in &mut self.scene.volumes {
            if let Volume::Density(_, medium) = volume {
                *medium = Medium::new(1.0, source.clone());
            }
        }
        let renderer = DirectRenderer::new(&self.scene, quadrature)?.early_stop(EARLY_STOP);
        let rendered = renderer.render(&self.camera, Sampling::grid(RAYS), &[], cancel);
        let film = rendered.ok_or_else(Error::cancelled)?.film;
        let share = |shows: &dyn Fn(f32) -> bool| {
            let shown = film.rgba.iter().zip(&self.met).filter(|(pixel, met)| **met && shows(pixel[3])).count();
            shown as f64 / self.met.iter().filter(|met| **met).count().max(1) as f64
        };
        let visible = share(&|alpha| alpha > VISIBLE);
        let effect = match () {
            () if visible < LEAST => Effect::Nothing,
            () if share(&|alpha| alpha > OPAQUE) > BLOCK => Effect::SolidBlock,
            () => Effect::Shown,
        };
        Ok(Picture { film, effect, visible })
    }
}
