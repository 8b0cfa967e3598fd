//! Which effects of a scene are simulated, at what cost, and what is left out.

use super::pictures::renderer::LeftOut;
use super::pictures::{Cameras, PictureSettings, remarks};
use super::provenance::Provenance;
use super::sequence;
use super::up::ChosenUp;
use crate::app::Context;
use crate::app::use_case::{Report, use_case};
use crate::error::{Error, Result};
use crate::plan::pilot::{self, Cost};
use crate::plan::{CONFIDENCE, Integrator, Plan, State};
use crate::scene::camera::Camera;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;

/// Settings of a plan: pictures, as they would be rendered.
///
/// Effects that a scene does not call for are off and cost nothing; more of them are left out as long as the sum of
/// their bounds, and of the limits of what they contribute as measured, stays below
/// [`PlanningSettings::max_omitted`](super::pictures::PlanningSettings::max_omitted). Costs are those of small
/// pictures, rendered now.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PlanSettings {
    /// Frame of a sequence; none for the first.
    pub frame: Option<u32>,
    /// Subject, cameras, media and light of the pictures.
    #[serde(flatten)]
    pub pictures: PictureSettings,
}

/// Report of a plan.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct PlanReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    input: PathBuf,
    views: usize,
    size: [u32; 2],
    /// Up axis about which cameras were placed; none where they were given.
    up: Option<ChosenUp>,
    #[serde(flatten)]
    plan: Plan,
    cost: Cost,
}

impl fmt::Display for PlanReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { input, views, size: [width, height], plan, cost, .. } = self;
        let by = match plan.integrator {
            Integrator::DirectVolumeRendering => "direct volume rendering",
            Integrator::PathTracing => "path tracing",
        };
        writeln!(
            f,
            "{}: {by}, {views} view{} of {width}x{height}",
            input.display(),
            if *views == 1 { "" } else { "s" }
        )?;
        writeln!(
            f,
            "  {:<22}{:<9}{:>10}{:>10}{:>10}{:>10}  reason",
            "effect", "state", "seconds", "mean", "limit", "bound"
        )?;
        for planned in &plan.effects {
            let state = match planned.state {
                State::On => "on",
                State::Off => "off",
                State::Bounded => "bounded",
                State::Measured => "measured",
            };
            let seconds = planned.cost.map_or("-".into(), |seconds| format!("{seconds:.3}"));
            let radiance = |value: Option<f64>| match value {
                Some(0.0) => "0".into(),
                Some(value) => format!("{value:.2e}"),
                None => "-".into(),
            };
            let (found, bound) = (planned.contribution, radiance(planned.bound));
            let (mean, limit) =
                (radiance(found.map(|found| found.mean)), radiance(found.and_then(|found| found.limit)));
            writeln!(
                f,
                "  {:<22}{state:<9}{seconds:>10}{mean:>10}{limit:>10}{bound:>10}  {}",
                planned.name.to_string(),
                planned.reason
            )?;
        }
        if plan.effects.iter().any(|planned| planned.contribution.is_some()) {
            writeln!(
                f,
                "  mean, limit: radiance that the effect, or the part that is left out, adds to the pictures, and to a \
                 block of 8 x 8 pixels at most, as measured with a confidence of {} % for all effects together",
                100.0 * CONFIDENCE
            )?;
        }
        writeln!(
            f,
            "  bound: most radiance that the effect, or the part that is left out, adds to a channel of any pixel, as \
             proved; pictures are often far darker"
        )?;
        let depth = &plan.measured.optical_depth;
        writeln!(
            f,
            "  optical depth: median {:.3}, 99 % below {:.3} on {} rays that meet the media; {:.3} at most on any ray",
            depth.median, depth.percentile_99, depth.rays, depth.bound
        )?;
        writeln!(f, "  {}", LeftOut(plan))?;
        write!(f, "  {} rays and about {:.2} s a picture", cost.paths, cost.seconds)
    }
}

use_case!(PlanSettings => PlanReport, pictures.limits);

impl Report for PlanReport {}

impl PlanReport {
    /// Returns the seconds that a picture is expected to take on this machine.
    pub(crate) fn seconds_a_picture(&self) -> f64 {
        self.cost.seconds
    }
}

/// Most cameras in whose pictures contributions are measured that nothing depends on.
const TOLD: usize = 4;

/// Returns cameras that contributions are told of if nothing may be left out: evenly spaced ones.
fn told_of(cameras: &[Camera]) -> Vec<Camera> {
    cameras.iter().step_by(cameras.len().div_ceil(TOLD).max(1)).copied().collect()
}

impl PlanSettings {
    /// Reads and plans.
    ///
    /// # Errors
    /// If the volume or the cameras cannot be used.
    pub fn run(&self, context: &Context) -> Result<PlanReport> {
        self.pictures.check()?;
        let cancel = context.cancel();
        let mut pictures = self.pictures.clone();
        pictures.frame = self.frame;
        if pictures.shade.is_some() {
            return Err(Error::unsupported("⟨shade⟩: there is nothing to plan, since shaded surfaces need all of it")
                .hint("leave ⟨shade⟩ out"));
        }
        if let Some(input) = pictures.sequence_of_folder()? {
            pictures.input = input;
        }
        if let Some(pattern) = sequence::pattern(&pictures.input) {
            let numbers = pattern.numbers()?;
            pictures.frame = self.frame.or(numbers.first().copied());
            pictures.input = pattern.path(pictures.frame.unwrap_or_default());
        }
        let mut provenance = Provenance::begin(context);
        let template = pictures.template(None, &mut provenance)?;
        let limits = pictures.limits;
        let (subject, transfer) = pictures.subject(template.as_ref(), limits, &mut provenance)?;
        remarks(&pictures, (&subject, transfer.as_ref()), template.as_ref())
            .iter()
            .for_each(|remark| context.note(format!("remark: {remark}")));
        let paths = pictures.scattering.on() || subject.is_scene();
        pictures.scattering.check(paths)?;
        let up = pictures.chosen_up(template.as_ref())?;
        up.iter().for_each(|up| context.note(up));
        let cameras = Cameras::around(up.as_ref());
        let name = |name: &str| PathBuf::from(name);
        let capture = pictures.capture(name, &subject, transfer, template.as_ref(), cameras)?;
        let scene = pictures.scene(&capture, subject).map_err(|e| e.at(&pictures.input))?;
        let measured = {
            let _stage = context.stage("measuring");
            let told = told_of(&scene.cameras);
            let cameras = if pictures.planning.max_omitted > 0.0 { &scene.cameras } else { &told };
            Plan::measured(&scene, cameras, &pictures.request(false), &cancel)
        };
        let mut plan = measured.map_err(|e| e.at(&pictures.input))?;
        let scene = plan.simplify(scene)?;
        let Some(camera) = scene.cameras.first() else {
            return Err(Error::invalid("no cameras").hint("give ⟨views⟩ or ⟨cameras⟩"));
        };
        let samples = match plan.integrator {
            Integrator::PathTracing => pictures.scattering.samples(),
            Integrator::DirectVolumeRendering => (pictures.rays_per_edge(paths) as u32).pow(2),
        };
        let quadrature = pictures.quadrature(&scene);
        let cost = pilot::run(&mut plan, &scene, camera, samples, quadrature, &cancel)?.ok_or_else(Error::cancelled)?;
        let size = [camera.width, camera.height];
        let views = scene.cameras.len();
        Ok(PlanReport { input: pictures.input, views, size, up, plan, cost })
    }
}
