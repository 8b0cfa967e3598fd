//! Plans: which effects of a scene are simulated, which are not, and how much radiance is missing for that at most.
//!
//! A plan simplifies a scene: what a scene does not call for is gone from it before renderers compile their kernels for
//! it, so that nothing asks for it while pixels are computed. A plan may also leave out what is there, as long as the
//! sum of upper bounds of the missing radiance stays below a limit. Where bounds that are proved do not tell enough,
//! those of measured contributions do, with a confidence.

mod bounds;
mod contribution;
mod depth;
mod effect;
mod measured;
pub mod pilot;
mod planner;

pub use contribution::{CONFIDENCE, Contribution};
pub use effect::Effect;
pub(crate) use measured::Measured;

use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::render::path::Limits;
use crate::scene::camera::Camera;
use crate::scene::environment::Environment;
use crate::scene::medium::{Medium, Source};
use crate::scene::scene::Scene;
use crate::scene::volume::Volume;
use glam::Vec3;
use planner::Planner;
use serde::Serialize;
use std::sync::Arc;

/// Freedom of a plan.
#[derive(Debug, Clone, Default)]
pub struct Request {
    /// Radiance that may be missing in any channel of any pixel; by measurement, of the mean of any block of 8 x 8
    /// pixels.
    pub max_omitted: f64,
    /// Effects that are kept whatever they add.
    pub force: Vec<Effect>,
    /// How far paths may go at most.
    pub limits: Limits,
    /// Radiance that the camera sees behind the media in place of the environment.
    pub background: Option<[f32; 3]>,
}

/// How light is integrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Integrator {
    /// Along straight rays: nothing scatters.
    DirectVolumeRendering,
    /// Along random paths.
    PathTracing,
}

/// Whether an effect is simulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum State {
    /// It is.
    On,
    /// It is not.
    Off,
    /// In part; what is left out is proved to be below a bound.
    Bounded,
    /// It is left out, or, if it is multiple scattering, the part of it that is beyond a number of scatterings. What is
    /// left out was measured, and is below a limit with a confidence.
    Measured,
}

/// Plan of an effect.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct Planned {
    /// Effect.
    pub name: Effect,
    /// State of the effect.
    pub state: State,
    /// Why.
    pub reason: String,
    /// Seconds a picture that it takes, as far as a `pilot` has told.
    pub cost: Option<f64>,
    /// Upper bound of the radiance that is left out in any channel of a pixel; for an effect that is on, of what would
    /// be missing without it. None where nothing finite is known.
    pub bound: Option<f64>,
    /// Radiance that the part which is left out adds to the pictures; for an effect that is on, all of it, and of
    /// multiple scattering what is scattered more than once. None where it was not measured.
    pub contribution: Option<Contribution>,
}

/// Plan of a scene.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct Plan {
    /// How light is integrated.
    pub integrator: Integrator,
    /// Effects.
    pub effects: Vec<Planned>,
    /// Upper bound of the radiance that is left out in any channel of a pixel; none where nothing finite is known. With
    /// a confidence below 1 it bounds the means of the pictures' blocks of 8 x 8 pixels.
    pub omitted: Option<f64>,
    /// Confidence of that bound: 1 if it is proved, less if some of it was measured.
    pub confidence: f64,
    /// Measurements.
    pub measured: Measured,
    /// How far paths go.
    #[serde(skip)]
    pub limits: Limits,
    /// Radiance that the camera sees behind the media in place of the environment.
    #[serde(skip)]
    pub background: Option<[f32; 3]>,
}

impl Plan {
    /// Plans the rendering of a scene.
    ///
    /// # Errors
    /// If a medium or a light cannot be used, or an effect is kept by force that the scene does not have.
    pub fn new(scene: &Scene, cameras: &[Camera], request: &Request) -> Result<Self> {
        Planner::new(scene, Measured::new(scene, cameras)?, request, None)?.plan()
    }

    /// Plans the rendering of a scene. What bounds do not leave out is measured in the pictures of `cameras`, and left
    /// out if it is known to be little enough there with [`CONFIDENCE`]. If nothing may be left out, contributions are
    /// measured and nothing follows from them.
    ///
    /// # Errors
    /// As [`Plan::new`], or if `cancel` was set.
    pub fn measured(scene: &Scene, cameras: &[Camera], request: &Request, cancel: &Cancel) -> Result<Self> {
        let measured = Measured::new(scene, &scene.cameras)?;
        let planner = Planner::new(scene, measured, request, Some((cameras, cancel)))?;
        let plan = planner.plan()?;
        if cancel.requested() { Err(Error::cancelled()) } else { Ok(plan) }
    }

    /// Returns the state of an effect.
    pub fn state(&self, effect: Effect) -> State {
        self.effects.iter().find(|planned| planned.name == effect).map_or(State::Off, |planned| planned.state)
    }

    /// True if an effect is simulated, at least in part.
    pub fn simulates(&self, effect: Effect) -> bool {
        match self.state(effect) {
            State::On | State::Bounded => true,
            State::Off => false,
            State::Measured => effect == Effect::MultipleScattering && self.limits.max_bounces > 1,
        }
    }

    /// Takes out of a scene what the plan leaves out.
    ///
    /// # Errors
    /// If a transfer function cannot be changed.
    pub fn simplify(&self, mut scene: Scene) -> Result<Scene> {
        let on = |effect| self.simulates(effect);
        if !on(Effect::Emission) {
            scene.volumes = scene.volumes.into_iter().map(Volume::without_emission).collect();
        }
        for volume in &mut scene.volumes {
            let (Volume::Density(_, medium) | Volume::Emissive { medium, .. }) = volume else { continue };
            if !on(Effect::Emission) {
                medium.source = darkened(&medium.source, Vec3::ZERO)?;
            }
            // Paths that end at their first collision emit the share that each density leaves.
            if !on(Effect::Scattering) && !emits_by_density(medium) && medium.scattering.is_some() {
                let [albedo, _] = medium.albedo_bounds();
                medium.source = darkened(&medium.source, Vec3::ONE - Vec3::from_array(albedo))?;
                (medium.scattering, medium.albedo_function) = (None, None);
            }
        }
        let moments = std::mem::take(&mut scene.moments);
        scene.moments = moments.into_iter().map(|moment| self.simplify(moment)).collect::<Result<_>>()?;
        let mut number = 0..;
        scene.lights.retain(|_| number.next().is_some_and(|number| on(Effect::Light(number))));
        match (self.integrator, self.background) {
            // Rays end in what is behind; they know no other light.
            (Integrator::DirectVolumeRendering, Some(background)) => {
                scene.environment = Environment::constant(background);
            }
            _ if !on(Effect::Environment) => scene.environment = Environment::default(),
            _ => {}
        }
        Ok(scene)
    }
}

/// True if a medium emits a share of its source's radiance that depends on the density, which no source of the same
/// kind tells without its albedo.
fn emits_by_density(medium: &Medium) -> bool {
    let [least, most] = medium.albedo_bounds();
    let bright = |color: &[f32; 3]| *color != [0.0; 3];
    let emits = match &medium.source {
        Source::Grey(color) | Source::Linear(color) => bright(color),
        Source::Transfer(table) => table.peak()[..3] != [0.0; 3],
    };
    emits && least != most
}

/// Returns a source whose radiance is multiplied by a share. Black ones keep the extinction alone where it has no
/// function of its own.
fn darkened(source: &Source, share: Vec3) -> Result<Source> {
    let times = |color: &[f32; 3]| (Vec3::from_array(*color) * share).to_array();
    Ok(match source {
        Source::Grey(color) => Source::Grey(times(color)),
        Source::Linear(color) => Source::Linear(times(color)),
        Source::Transfer(table) => {
            let share = share.as_dvec3();
            let value = |[r, g, b, s]: &[f64; 4]| [r * share.x, g * share.y, b * share.z, *s];
            let values = table.values().iter().map(value).collect();
            Source::Transfer(Arc::new(table.with_values(values)?))
        }
    })
}
