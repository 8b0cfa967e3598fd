//! Which effects of a scene are simulated, at what cost, and what is left out.

use super::pictures::renderer::LeftOut;
use super::pictures::{Cameras, PictureSettings, remarks};
use super::provenance::Provenance;
use super::sequence;
use super::up::ChosenUp;
use crate::app::Context;
use crate::app::reconstruct::{CapturePlan, CapturePlanSettings, DensitySettings};
use crate::app::use_case::{Report, use_case};
use crate::error::{Error, Result};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::{captures, colmap, registry, transforms};
use crate::plan::pilot::{self, Cost};
use crate::plan::{CONFIDENCE, Integrator, Plan, State};
use crate::scene::camera::Camera;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};

/// Settings of a plan: of pictures, as they would be rendered, or of the reconstruction of densities from a capture.
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
    /// Reconstruction that is planned where the input is a capture.
    #[serde(flatten)]
    pub reconstruction: CapturePlanSettings,
    /// Subject, cameras, media and light of the pictures.
    #[serde(flatten)]
    pub pictures: PictureSettings,
}

/// Report of a plan.
#[derive(Debug, Serialize, schemars::JsonSchema)]
#[serde(untagged)]
pub enum PlanReport {
    /// Report of pictures that are to be rendered.
    Scene(Box<ScenePlan>),
    /// Report of a reconstruction from a capture.
    Capture(Box<CapturePlan>),
}

impl fmt::Display for PlanReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scene(plan) => plan.fmt(f),
            Self::Capture(plan) => plan.fmt(f),
        }
    }
}

/// Report of the plan of pictures.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct ScenePlan {
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

impl fmt::Display for ScenePlan {
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

impl ScenePlan {
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

/// True if a path is a capture: a folder that holds one, a model of COLMAP, or a JSON file with frames.
fn is_capture(path: &Path, limits: Limits) -> bool {
    let file = captures::file(path);
    if path.is_dir() || colmap::is_model_file(&file) {
        return file.is_file();
    }
    let json = || registry::sniff(path).is_ok_and(|format| matches!(format.kind, FileKind::Capture));
    json() && transforms::read_object(path, limits).is_ok_and(|root| root.contains_key("frames"))
}

impl PlanSettings {
    /// Reads and plans.
    ///
    /// # Errors
    /// If the volume, the cameras or the capture cannot be used, or settings are given that the input has no use for.
    pub fn run(&self, context: &Context) -> Result<PlanReport> {
        if is_capture(&self.pictures.input, self.pictures.limits) {
            return Ok(PlanReport::Capture(Box::new(self.of_capture(context)?)));
        }
        if self.reconstruction != CapturePlanSettings::default() {
            return Err(Error::invalid(
                "⟨voxel_size⟩, ⟨resolution⟩, ⟨bounds⟩, ⟨solver⟩, ⟨held_out⟩, ⟨iterations⟩, ⟨smoothing⟩, ⟨layer⟩, \
                 ⟨machines⟩, ⟨bandwidth⟩, ⟨latency⟩ and ⟨delay⟩ are of reconstructions from captures",
            )
            .at(&self.pictures.input)
            .hint("leave them out, or give a capture: a transforms.json, a model of COLMAP, or the folder of either"));
        }
        Ok(PlanReport::Scene(Box::new(self.of_scene(context)?)))
    }

    /// Plans the reconstruction of densities from a capture.
    fn of_capture(&self, context: &Context) -> Result<CapturePlan> {
        let PictureSettings { input, transfer, limits, .. } = &self.pictures;
        let (capture, transfer, limits) = (input.clone(), transfer.clone(), *limits);
        let plain = PictureSettings { input: capture.clone(), transfer: transfer.clone(), limits, ..<_>::default() };
        if self.frame.is_some() || self.pictures != plain {
            return Err(Error::invalid("the input is a capture, and an option is given that is of rendering alone")
                .at(input)
                .hint(
                    "give the options of `cumulo reconstruct density` alone; to plan renders with the cameras of a \
                     capture, give a volume and ⟨cameras⟩",
                ));
        }
        let CapturePlanSettings { region, solver, held_out, iterations, smoothing, layer, scaling } =
            self.reconstruction.clone();
        let settings = DensitySettings {
            capture,
            transfer,
            limits,
            region,
            solver,
            held_out,
            iterations,
            smoothing,
            layer,
            ..DensitySettings::default()
        };
        settings.plan(&scaling, context)
    }

    /// Plans pictures.
    ///
    /// # Errors
    /// If the volume or the cameras cannot be used.
    pub(crate) fn of_scene(&self, context: &Context) -> Result<ScenePlan> {
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
        Ok(ScenePlan { input: pictures.input, views, size, up, plan, cost })
    }
}
