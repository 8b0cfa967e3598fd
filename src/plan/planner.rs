//! Decisions, effect by effect: those first whose absence saves most.

use super::bounds::{Bound, Media};
use super::{Effect, Integrator, Measured, Plan, Planned, Request, State};
use crate::error::{Error, Result};
use crate::math::Aabb;
use crate::render::path::Limits;
use crate::render::preshaded::Preshaded;
use crate::scene::bricks::Bricks;
use crate::scene::emission::Emitted;
use crate::scene::environment::Environment;
use crate::scene::medium::Medium;
use crate::scene::phase::Phase;
use crate::scene::scene::Scene;
use crate::scene::volume::Volume;
use glam::DVec3;

/// Most scatterings that a limit is set to: beyond, roulette has ended nearly all paths anyway.
const MOST_BOUNCES: u32 = 1000;

/// A plan in the making.
pub(super) struct Planner<'p> {
    scene: &'p Scene,
    request: &'p Request,
    measured: Measured,
    media: Media,
    emission: Bound,
    environment: Bound,
    lights: Vec<Bound>,
    /// Bound of the radiance that is left out so far.
    omitted: DVec3,
    effects: Vec<Planned>,
    limits: Limits,
    background: Option<[f32; 3]>,
}

/// A source that is left out.
const DARK: Bound = Bound { first: DVec3::ZERO, all: DVec3::ZERO };

fn finite(bound: DVec3) -> Option<f64> {
    let most = bound.max_element();
    most.is_finite().then_some(most)
}

/// Returns an upper bound of the radiance that a grid emits along any ray.
fn brightest(emission: &Emitted) -> f64 {
    Preshaded::<f32>::new(emission.grid()).brightest()[1]
}

fn media(scene: &Scene) -> impl Iterator<Item = &Medium> {
    scene.volumes.iter().filter_map(Volume::density).map(|(_, medium)| medium)
}

impl<'p> Planner<'p> {
    /// Begins a plan.
    ///
    /// # Errors
    /// If an effect is kept by force that the scene does not have.
    pub(crate) fn new(scene: &'p Scene, measured: Measured, request: &'p Request) -> Result<Self> {
        let lights = scene.lights.len();
        let missing = |effect: &&Effect| matches!(effect, Effect::Light(number) if *number >= lights);
        if let Some(effect) = request.force.iter().find(missing) {
            return Err(Error::invalid(format!("{effect} is to be kept, and the scene has {lights} lights"))
                .hint("lights are numbered from 0, in their order in the scene"));
        }
        let fields = || scene.volumes.iter().filter_map(Volume::density);
        let reach =
            |(field, _): (&Bricks<f32>, _)| field.transform.box_to_world(field.topology.bounds().union(field.domain));
        let within = fields().map(reach).fold(Aabb::EMPTY, Aabb::union);
        let of_media = Media::new(media(scene), measured.optical_depth.bound);
        Ok(Self {
            media: of_media,
            emission: of_media
                .emission(fields().map(|(field, medium)| (medium, f64::from(field.range().1))))
                .and(scene.volumes.iter().filter_map(Volume::emission).map(brightest).sum()),
            environment: of_media.of(scene.environment.bounds()),
            lights: scene.lights.iter().map(|light| of_media.of(light.bounds(within))).collect(),
            omitted: DVec3::ZERO,
            effects: Vec::new(),
            limits: request.limits,
            background: request.background,
            scene,
            request,
            measured,
        })
    }

    /// Decides on all effects.
    pub(crate) fn plan(mut self) -> Plan {
        let scattering = self.scattering();
        self.emission();
        self.lights(scattering);
        self.environment(scattering);
        self.orders(scattering);
        self.kinds(scattering);
        let [density] = &self.scene.volumes[..] else { return self.finished(Integrator::PathTracing) };
        let pre_shaded = matches!(density, Volume::PreShaded(_));
        let picture = self.scene.environment.map.is_some() && self.background.is_none();
        let straight =
            pre_shaded || !(scattering || picture || self.measured.chromatic || self.forced(Effect::Scattering));
        self.finished(if straight { Integrator::DirectVolumeRendering } else { Integrator::PathTracing })
    }

    fn finished(self, integrator: Integrator) -> Plan {
        let Self { effects, omitted, measured, limits, background, .. } = self;
        Plan { integrator, effects, omitted: finite(omitted), measured, limits, background }
    }

    /// Returns the bound of light of all sources that was scattered `orders` times or more.
    fn orders_from(&self, orders: u32) -> DVec3 {
        let sources = self.lights.iter().chain([&self.environment, &self.emission]);
        sources.map(|source| self.media.orders_from(*source, orders)).sum()
    }

    fn forced(&self, effect: Effect) -> bool {
        self.request.force.contains(&effect)
    }

    /// Leaves out light of which there is so much at most if the limit allows it, and returns whether it does.
    fn leave_out(&mut self, effect: Effect, bound: DVec3) -> bool {
        let allowed = !self.forced(effect) && (self.omitted + bound).max_element() <= self.request.max_omitted;
        if allowed {
            self.omitted += bound;
        }
        allowed
    }

    fn push(&mut self, name: Effect, state: State, reason: impl Into<String>, bound: Option<f64>) {
        self.effects.push(Planned { name, state, reason: reason.into(), cost: None, bound });
    }

    /// Decides whether anything is scattered.
    fn scattering(&mut self) -> bool {
        let effect = Effect::Scattering;
        let scattered = self.orders_from(1);
        let (state, reason) = if !media(self.scene).any(Medium::scatters) {
            (State::Off, "no medium has an albedo".into())
        } else if self.measured.optical_depth.bound == 0.0 {
            (State::Off, "media are empty".into())
        } else if !self.forced(Effect::MultipleScattering) && self.leave_out(effect, scattered) {
            let black = scattered == DVec3::ZERO;
            (State::Off, if black { "there is no light to scatter" } else { "all of it is below the limit" }.into())
        } else {
            let [least, most] = self.measured.albedo;
            (State::On, if least == most { format!("albedo {most}") } else { format!("albedo {least} to {most}") })
        };
        self.push(effect, state, reason, finite(scattered));
        state == State::On
    }

    fn emission(&mut self) {
        let effect = Effect::Emission;
        if self.scene.volumes.iter().any(|volume| matches!(volume, Volume::PreShaded(_))) {
            return self.push(effect, State::On, "a pre-shaded volume", None);
        }
        let emitted = self.media.orders_from(self.emission, 0);
        let (state, reason) = if emitted == DVec3::ZERO {
            (State::Off, "no medium has a source")
        } else if self.leave_out(effect, emitted) {
            self.emission = DARK;
            (State::Off, "all of it is below the limit")
        } else {
            (State::On, "media have a source")
        };
        self.push(effect, state, reason, finite(emitted));
    }

    /// Decides on lights, the faintest first.
    fn lights(&mut self, scattering: bool) {
        let sums: Vec<DVec3> = self.lights.iter().map(|light| self.media.orders_from(*light, 1)).collect();
        let mut order: Vec<usize> = (0..sums.len()).collect();
        order.sort_by(|a, b| sums[*a].max_element().total_cmp(&sums[*b].max_element()));
        let mut decided = vec![(State::On, ""); sums.len()];
        for number in order {
            decided[number] = if !scattering {
                (State::Off, ", which nothing scatters; cameras do not see it")
            } else if self.leave_out(Effect::Light(number), sums[number]) {
                self.lights[number] = DARK;
                (State::Off, if sums[number] == DVec3::ZERO { " that is black" } else { ", below the limit" })
            } else {
                (State::On, "")
            };
        }
        for (number, (state, why)) in decided.into_iter().enumerate() {
            let reason = format!("{}{why}", self.scene.lights[number].name());
            self.push(Effect::Light(number), state, reason, if scattering { finite(sums[number]) } else { Some(0.0) });
        }
    }

    /// Decides whether light from all around is scattered; cameras see it in any case.
    fn environment(&mut self, scattering: bool) {
        let effect = Effect::Environment;
        let Environment { radiance, map } = &self.scene.environment;
        let is = if map.is_some() { "a picture" } else { "a constant" };
        // What cameras would see of a picture cannot be told by a background.
        let seen = self.background.or(map.is_none().then_some(*radiance));
        let around = self.media.orders_from(self.environment, 1);
        let (state, reason) = if self.scene.environment == Environment::default() {
            (State::Off, "it is black".into())
        } else if !scattering {
            (State::On, format!("{is}; seen by cameras, scattered by nothing"))
        } else if seen.is_some() && self.leave_out(effect, around) {
            self.environment = DARK;
            self.background = seen;
            (State::Off, "scattered, it is below the limit".into())
        } else {
            (State::On, is.into())
        };
        self.push(effect, state, reason, if scattering { finite(around) } else { Some(0.0) });
    }

    /// Decides how often light is scattered.
    fn orders(&mut self, scattering: bool) {
        let effect = Effect::MultipleScattering;
        if !scattering {
            return self.push(effect, State::Off, "nothing is scattered", Some(0.0));
        }
        let given = self.limits.max_bounces;
        let left = |bounces: u32| self.orders_from(bounces.saturating_add(1));
        let fits = |bounces: &u32| (self.omitted + left(*bounces)).max_element() <= self.request.max_omitted;
        // The bound falls with the number.
        let enough = (1..MOST_BOUNCES.min(given)).find(fits).filter(|_| !self.forced(effect));
        let (state, reason, bound) = match enough {
            Some(1) => (State::Off, "below the limit".into(), left(1)),
            Some(bounces) => {
                (State::Bounded, format!("more than {bounces} scatterings are below the limit"), left(bounces))
            }
            None if given < u32::MAX => (State::Bounded, format!("{given} scatterings by request"), left(given)),
            None => (State::On, "any number of scatterings".into(), left(1)),
        };
        if state != State::On {
            self.omitted += bound;
            self.limits.max_bounces = enough.unwrap_or(given);
        }
        self.push(effect, state, reason, finite(bound));
    }

    /// Tells which kinds of media there are: kernels are compiled for them, and nothing is left out.
    fn kinds(&mut self, scattering: bool) {
        let turns =
            |m: &Medium| m.scattering.is_some_and(|s| matches!(s.phase, Phase::HenyeyGreenstein(g) if g != 0.0));
        let anisotropic = scattering && media(self.scene).any(turns);
        let shaded = media(self.scene).find_map(|m| m.scattering?.gradient_shading).filter(|_| scattering);
        let surfaces =
            shaded.map_or_else(|| "no medium has surfaces".into(), |half| format!("half at a gradient of {half}"));
        let function = match self.measured.monotonic {
            Some(true) => "extinction rises with the density",
            Some(false) => "extinction falls with the density in places",
            None => "extinction is proportional to the density",
        };
        let phase = if !scattering { "nothing is scattered" } else { "all directions alike" };
        let several = self.scene.volumes.len() > 1;
        let volumes = format!("{} volume{}", self.scene.volumes.len(), if several { "s" } else { "" });
        let extinction = if self.measured.chromatic { "differs between channels" } else { "one for all channels" };
        let kinds = [
            (Effect::ChromaticExtinction, self.measured.chromatic, extinction.to_owned()),
            (Effect::Anisotropy, anisotropic, if anisotropic { "Henyey-Greenstein" } else { phase }.to_owned()),
            (Effect::GradientShading, shaded.is_some(), surfaces),
            (Effect::TransferFunction, self.measured.monotonic.is_some(), function.to_owned()),
            (Effect::Overlap, several, volumes),
        ];
        for (effect, on, reason) in kinds {
            self.push(effect, if on { State::On } else { State::Off }, reason, (!on).then_some(0.0));
        }
    }
}
