//! Decisions, effect by effect: those first whose absence saves most.

use super::bounds::{Bound, Media};
use super::contribution::{CONFIDENCE, Caps, Contribution, Part, Pilot, RUNGS, Shining, Verdict};
use super::{Effect, Integrator, Measured, Plan, Planned, Request, State, emits_by_density};
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::math::Aabb;
use crate::render::path::Limits;
use crate::render::preshaded::Preshaded;
use crate::scene::bricks::Bricks;
use crate::scene::camera::Camera;
use crate::scene::emission::Emitted;
use crate::scene::environment::Environment;
use crate::scene::medium::Medium;
use crate::scene::phase::Phase;
use crate::scene::scene::Scene;
use crate::scene::volume::Volume;
use glam::DVec3;

/// Largest mean cosine of phase functions with which the spread of paths tells of what they do not find: at 0.99 few
/// paths that turn next to a small sun carry much of its light.
const WIDEST_PEAK: f64 = 0.95;

/// Most scatterings that a limit is set to: beyond, roulette has ended nearly all paths anyway.
const MOST_BOUNCES: u32 = 1000;

/// A plan in the making.
pub(super) struct Planner<'p> {
    scene: &'p Scene,
    request: &'p Request,
    measured: Measured,
    /// Box of all media.
    within: Aabb,
    media: Media,
    emission: Bound,
    environment: Bound,
    lights: Vec<Bound>,
    /// Bound of the radiance that is left out so far, proved or measured.
    omitted: DVec3,
    /// True if some of it was measured.
    by_measurement: bool,
    /// Measurement of contributions, if there may be one; made when it is called for.
    pilot: Option<Pilot<'p>>,
    pilot_of: Option<(&'p [Camera], &'p Cancel)>,
    effects: Vec<Planned>,
    limits: Limits,
    background: Option<[f32; 3]>,
}

/// A source that is left out.
const DARK: Bound = Bound { first: DVec3::ZERO, all: DVec3::ZERO };

/// Whether an effect is left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Left {
    /// It is not.
    In,
    /// It is, by its bound.
    Proved,
    /// It is, by its measured contribution.
    Measured,
}

impl Left {
    /// Returns the state of an effect that is left out as a whole, or not.
    fn state(self) -> State {
        match self {
            Self::In => State::On,
            Self::Proved => State::Off,
            Self::Measured => State::Measured,
        }
    }
}

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

/// True if a medium scatters nearly all light straight on or back.
fn is_peaked(medium: &Medium) -> bool {
    medium.scattering.is_some_and(|s| matches!(s.phase, Phase::HenyeyGreenstein(g) if g.abs() > WIDEST_PEAK))
}

impl<'p> Planner<'p> {
    /// Begins a plan. With cameras and a flag that stops the work, what bounds do not leave out may be measured.
    ///
    /// # Errors
    /// If an effect is kept by force that the scene does not have.
    pub(crate) fn new(
        scene: &'p Scene,
        measured: Measured,
        request: &'p Request,
        pilot_of: Option<(&'p [Camera], &'p Cancel)>,
    ) -> Result<Self> {
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
            within,
            by_measurement: false,
            pilot: None,
            // What surfaces reflect into media is told by no bound, and by no pilot.
            pilot_of: pilot_of.filter(|(cameras, _)| !cameras.is_empty() && scene.meshes.is_none()),
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
    ///
    /// # Errors
    /// If a medium or a light cannot be used.
    pub(crate) fn plan(mut self) -> Result<Plan> {
        let scattering = self.scattering()?;
        if !scattering {
            self.pilot_of = None;
        }
        self.emission()?;
        self.lights(scattering)?;
        self.environment(scattering)?;
        self.orders(scattering)?;
        self.kinds(scattering);
        // What is emitted then depends on the albedo of each density: paths that nothing scatters tell it.
        let by_density = !scattering && self.emission.first != DVec3::ZERO && media(self.scene).any(emits_by_density);
        if by_density {
            self.limits.max_bounces = 0;
        }
        let [density] = &self.scene.volumes[..] else { return Ok(self.finished(Integrator::PathTracing)) };
        let pre_shaded = matches!(density, Volume::PreShaded(_));
        let picture = self.scene.environment.map.is_some() && self.background.is_none();
        let straight = pre_shaded
            || !(scattering || by_density || picture || self.measured.chromatic || self.forced(Effect::Scattering))
                && self.scene.moments.is_empty();
        Ok(self.finished(if straight { Integrator::DirectVolumeRendering } else { Integrator::PathTracing }))
    }

    fn finished(self, integrator: Integrator) -> Plan {
        let Self { effects, omitted, by_measurement, measured, limits, background, .. } = self;
        let confidence = if by_measurement { CONFIDENCE } else { 1.0 };
        Plan { integrator, effects, omitted: finite(omitted), confidence, measured, limits, background }
    }

    /// Returns the bound of light of all sources that was scattered `orders` times or more.
    fn orders_from(&self, orders: u32) -> DVec3 {
        let sources = self.lights.iter().chain([&self.environment, &self.emission]);
        sources.map(|source| self.scattered_from(*source, orders)).sum()
    }

    /// Returns the bound of light of a source that was scattered `orders` times or more: of what surfaces scatter,
    /// there is none.
    fn scattered_from(&self, source: Bound, orders: u32) -> DVec3 {
        if self.scene.meshes.is_some() { DVec3::INFINITY } else { self.media.orders_from(source, orders) }
    }

    fn forced(&self, effect: Effect) -> bool {
        self.request.force.contains(&effect)
    }

    /// Returns the radiance that may be left out beside what is.
    fn remaining(&self) -> f64 {
        (self.request.max_omitted - self.omitted.max_element()).max(0.0)
    }

    /// Leaves out a part of the light, of which there is so much at most, if the limit allows it by this bound or by
    /// what is measured. Returns whether it does, and what was measured.
    fn leave_out(&mut self, effect: Effect, bound: DVec3, part: Part) -> Result<(Left, Option<Contribution>)> {
        if self.forced(effect) {
            return Ok((Left::In, None));
        }
        if (self.omitted + bound).max_element() <= self.request.max_omitted {
            self.omitted += bound;
            return Ok((Left::Proved, None));
        }
        let Some(verdict) = self.measure(part)? else { return Ok((Left::In, None)) };
        Ok((self.leave_out_measured(&verdict), Some(verdict.contribution)))
    }

    /// Leaves out what was measured if there is little enough of it.
    fn leave_out_measured(&mut self, verdict: &Verdict) -> Left {
        if !verdict.within {
            return Left::In;
        }
        self.omitted += verdict.limit;
        self.by_measurement = true;
        Left::Measured
    }

    /// Measures what a part of the light that is not left out contributes, if that may be done.
    fn measure(&mut self, part: Part) -> Result<Option<Verdict>> {
        let Some((cameras, cancel)) = self.pilot_of else { return Ok(None) };
        let mut pilot = match self.pilot.take() {
            Some(pilot) => pilot,
            None => Pilot::new(self.scene, (cameras, self.within), self.request.max_omitted, cancel)?,
        };
        let dark = |bound: &Bound| bound.first == DVec3::ZERO;
        let lights = (0..self.lights.len()).filter(|number| !dark(&self.lights[*number])).collect();
        let shining = Shining { lights, environment: !dark(&self.environment), emission: !dark(&self.emission) };
        let verdict = pilot.measure(part, &shining, &self.caps(part), self.remaining())?;
        self.pilot = Some(pilot);
        Ok(Some(verdict))
    }

    /// Returns what is known beforehand of the paths by which a part is measured.
    fn caps(&self, part: Part) -> Caps {
        let lights: Vec<Bound> = match part {
            Part::Light(number) => vec![self.lights[number]],
            Part::Emitted | Part::Environment => Vec::new(),
            Part::Scattered | Part::Beyond(_) => self.lights.clone(),
        };
        let environment = if matches!(part, Part::Emitted | Part::Light(_)) { DARK } else { self.environment };
        let emission = if matches!(part, Part::Environment | Part::Light(_)) { DARK } else { self.emission };
        let orders = if let Part::Beyond(bounces) = part { bounces.saturating_add(1) } else { 1 };
        let all = || lights.iter().chain([&environment, &emission]);
        let emitted = self.media.emitted(emission);
        let sent_on: DVec3 = all().map(|source| self.media.sent_on(*source, orders)).sum();
        // By the weights of multiple importance sampling, and of the greatest density of a light's directions.
        let of_light = |light: &Bound| (1.5 * light.all).min(3.0 * light.first);
        let at_once = lights.iter().map(of_light).sum::<DVec3>() + 1.5 * environment.all;
        let chosen = lights.len() + usize::from(self.scene.environment.map.is_some());
        let later: DVec3 = all().map(|source| self.media.orders_from(*source, 1)).sum();
        // Weights of channels keep their sum where collisions are drawn by one of them.
        let weight = if self.measured.chromatic { 3.0 } else { 1.0 };
        Caps {
            collision: weight * (sent_on + if part == Part::Emitted { emitted } else { DVec3::ZERO }),
            event: weight * (chosen.max(1) as f64 * at_once + later + emitted),
            peaked: media(self.scene).any(is_peaked),
            apart: part == Part::Emitted && self.scene.volumes.iter().any(|volume| volume.emission().is_some()),
        }
    }

    fn push(
        &mut self,
        name: Effect,
        state: State,
        reason: impl Into<String>,
        (bound, contribution): (Option<f64>, Option<Contribution>),
    ) {
        self.effects.push(Planned { name, state, reason: reason.into(), cost: None, bound, contribution });
    }

    /// Decides whether anything is scattered.
    fn scattering(&mut self) -> Result<bool> {
        let effect = Effect::Scattering;
        let scattered = self.orders_from(1);
        let mut found = None;
        let (state, reason) = if self.scene.meshes.is_some() {
            (State::On, "surfaces scatter light".into())
        } else if !media(self.scene).any(Medium::scatters) {
            (State::Off, "no medium has an albedo".into())
        } else if self.measured.optical_depth.bound == 0.0 {
            (State::Off, "media are empty".into())
        } else {
            let (left, measured) = match self.forced(Effect::MultipleScattering) {
                true => (Left::In, None),
                false => self.leave_out(effect, scattered, Part::Scattered)?,
            };
            found = measured;
            let [least, most] = self.measured.albedo;
            let by_density = media(self.scene).any(|medium| medium.albedo_function.is_some());
            let reason = match left {
                Left::In if by_density => format!("albedo {least} to {most} by the density"),
                Left::In if least == most => format!("albedo {most}"),
                Left::In => format!("albedo {least} to {most}"),
                _ if scattered == DVec3::ZERO => "there is no light to scatter".into(),
                _ => "all of it is below the limit".into(),
            };
            (left.state(), reason)
        };
        self.push(effect, state, reason, (finite(scattered), found));
        Ok(state == State::On)
    }

    fn emission(&mut self) -> Result<()> {
        let effect = Effect::Emission;
        if self.scene.volumes.iter().any(|volume| matches!(volume, Volume::PreShaded(_))) {
            self.push(effect, State::On, "a pre-shaded volume", (None, None));
            return Ok(());
        }
        let emitted = self.media.orders_from(self.emission, 0);
        if emitted == DVec3::ZERO {
            self.push(effect, State::Off, "no medium has a source", (Some(0.0), None));
            return Ok(());
        }
        let bound = if self.scene.meshes.is_some() { DVec3::INFINITY } else { emitted };
        let (left, found) = self.leave_out(effect, bound, Part::Emitted)?;
        if left != Left::In {
            self.emission = DARK;
        }
        let reason = if left == Left::In { "media have a source" } else { "all of it is below the limit" };
        self.push(effect, left.state(), reason, (finite(bound), found));
        Ok(())
    }

    /// Decides on lights, the faintest first.
    fn lights(&mut self, scattering: bool) -> Result<()> {
        let sums: Vec<DVec3> = self.lights.iter().map(|light| self.scattered_from(*light, 1)).collect();
        let mut order: Vec<usize> = (0..sums.len()).collect();
        order.sort_by(|a, b| sums[*a].max_element().total_cmp(&sums[*b].max_element()));
        let mut decided = vec![(State::On, "", None); sums.len()];
        for number in order {
            decided[number] = if !scattering {
                (State::Off, ", which nothing scatters; cameras do not see it", None)
            } else {
                let (left, found) = self.leave_out(Effect::Light(number), sums[number], Part::Light(number))?;
                if left != Left::In {
                    self.lights[number] = DARK;
                }
                let why = match left {
                    Left::In => "",
                    _ if sums[number] == DVec3::ZERO => " that is black",
                    _ => ", below the limit",
                };
                (left.state(), why, found)
            };
        }
        for (number, (state, why, found)) in decided.into_iter().enumerate() {
            let reason = format!("{}{why}", self.scene.lights[number].name());
            let bound = if scattering { finite(sums[number]) } else { Some(0.0) };
            self.push(Effect::Light(number), state, reason, (bound, found));
        }
        Ok(())
    }

    /// Decides whether light from all around is scattered; cameras see it in any case.
    fn environment(&mut self, scattering: bool) -> Result<()> {
        let effect = Effect::Environment;
        let Environment { radiance, map } = &self.scene.environment;
        let is = if map.is_some() { "a picture" } else { "a constant" };
        // What cameras would see of a picture cannot be told by a background.
        let seen = self.background.or(map.is_none().then_some(*radiance));
        let around = self.scattered_from(self.environment, 1);
        let mut found = None;
        let (state, reason) = if self.scene.environment == Environment::default() {
            (State::Off, "it is black".into())
        } else if !scattering {
            (State::On, format!("{is}; seen by cameras, scattered by nothing"))
        } else if seen.is_none() {
            (State::On, is.into())
        } else {
            let (left, measured) = self.leave_out(effect, around, Part::Environment)?;
            found = measured;
            if left != Left::In {
                self.environment = DARK;
                self.background = seen;
            }
            let reason = if left == Left::In { is } else { "scattered, it is below the limit" };
            (left.state(), reason.into())
        };
        self.push(effect, state, reason, (if scattering { finite(around) } else { Some(0.0) }, found));
        Ok(())
    }

    /// Decides how often light is scattered.
    fn orders(&mut self, scattering: bool) -> Result<()> {
        let effect = Effect::MultipleScattering;
        if !scattering {
            self.push(effect, State::Off, "nothing is scattered", (Some(0.0), None));
            return Ok(());
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
        let (found, fewer) = self.fewer_orders(enough.unwrap_or(given))?;
        if let Some(bounces) = fewer {
            self.limits.max_bounces = bounces;
            let reason = format!("more than {bounces} scatterings are below the limit");
            self.push(effect, State::Measured, reason, (finite(self.orders_from(bounces + 1)), found));
            return Ok(());
        }
        if state != State::On {
            self.omitted += bound;
            self.limits.max_bounces = enough.unwrap_or(given);
        }
        self.push(effect, state, reason, (finite(bound), found));
        Ok(())
    }

    /// Measures whether fewer scatterings are enough, and leaves out the others. Returns what they contribute, or all
    /// but the first where none is left out, with the number of those that are enough.
    fn fewer_orders(&mut self, most: u32) -> Result<(Option<Contribution>, Option<u32>)> {
        if self.forced(Effect::MultipleScattering) || most <= 1 {
            return Ok((None, None));
        }
        let mut all_but_one = None;
        for bounces in RUNGS.into_iter().filter(|bounces| *bounces < most) {
            let Some(verdict) = self.measure(Part::Beyond(bounces))? else { break };
            if self.leave_out_measured(&verdict) == Left::Measured {
                return Ok((Some(verdict.contribution), Some(bounces)));
            }
            all_but_one = all_but_one.or(Some(verdict.contribution));
            if self.remaining() == 0.0 {
                break;
            }
        }
        Ok((all_but_one, None))
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
        let meshes = match &self.scene.meshes {
            Some(meshes) => format!("{} triangles", meshes.count()),
            None => "there are no meshes".into(),
        };
        let extinction = if self.measured.chromatic { "differs between channels" } else { "one for all channels" };
        let kinds = [
            (Effect::ChromaticExtinction, self.measured.chromatic, extinction.to_owned()),
            (Effect::Anisotropy, anisotropic, if anisotropic { "Henyey-Greenstein" } else { phase }.to_owned()),
            (Effect::GradientShading, shaded.is_some(), surfaces),
            (Effect::TransferFunction, self.measured.monotonic.is_some(), function.to_owned()),
            (Effect::Overlap, several, volumes),
            (Effect::Surfaces, self.scene.meshes.is_some(), meshes),
        ];
        for (effect, on, reason) in kinds {
            self.push(effect, if on { State::On } else { State::Off }, reason, ((!on).then_some(0.0), None));
        }
    }
}
