//! Views: the pictures of a volume from many sides, which appear together as a capture, or one of them.

use super::accuracy::{AccuracyReport, Deadline, PictureError, Turn};
use super::begun::{Pictured, is_stopped};
use super::target::Target;
use super::visibility::Visibility;
use super::{RenderSettings, fits, remarks, straight};
use crate::app::Context;
use crate::app::earlier::{self, Earlier, Keys, Policy};
use crate::app::pictures::Cameras;
use crate::app::pictures::colors::Colors;
use crate::app::pictures::renderer::{Chosen, LeftOut, SceneRenderer};
use crate::app::pictures::scales::DensityScales;
use crate::app::pictures::scattering::Paths;
use crate::app::pictures::subject::Subject;
use crate::app::provenance::Provenance;
use crate::app::up::ChosenUp;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::formats::atomic::{self, Batch};
use crate::formats::png::ToneMapping;
use crate::formats::protected;
use crate::formats::transforms::{self, FILE_NAME};
use crate::ordered;
use crate::plan::Plan;
use crate::render::film::Rendered;
use crate::render::integrator::Counts;
use crate::render::renderer::Renderer;
use crate::scene::capture::{Capture, Model};
use crate::scene::scene::Scene;
use crate::wording::all_worded;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Report of views.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct ViewsReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    views: usize,
    model: Model,
    #[serde(flatten)]
    scales: DensityScales,
    /// How light was integrated; none if nothing was rendered.
    #[serde(flatten)]
    way: Option<Integration>,
    /// Errors of the pictures, if a target or a time was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    accuracy: Option<AccuracyReport>,
    /// Plan of a scene that may scatter, or out of which something may be left.
    plan: Option<Plan>,
    /// Up axis about which cameras were placed; none where they were given.
    up: Option<ChosenUp>,
    /// How radiance became the samples of PNGs; none if none were written.
    #[serde(skip_serializing_if = "Option::is_none")]
    tone_mapping: Option<ToneMapping>,
    /// Remarks on statements of a USD stage that have no effect, and on what is assumed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    remarks: Vec<String>,
    seconds: f64,
}

/// How light was integrated.
#[derive(Debug, Serialize, schemars::JsonSchema)]
#[serde(untagged)]
enum Integration {
    /// Along straight rays.
    Dvr {
        quadrature: String,
        /// Bound of the error that the quadrature makes in any channel of a pixel, in the channel's units; null where
        /// no bound is known.
        quadrature_error_bound: Option<f64>,
        early_stop: EarlyStop,
        /// Bound of both errors by the scale of the picture, the largest of all pictures, if an error was asked for.
        #[serde(skip_serializing_if = "Option::is_none")]
        relative_error_bound: Option<f64>,
    },
    /// Along paths.
    Paths { paths: Paths },
}

/// Transmittance at which rays end, and the error that this makes.
#[derive(Debug, Clone, Copy, Serialize, schemars::JsonSchema)]
struct EarlyStop {
    /// Transmittance below which rays end; 0 for never.
    transmittance: f64,
    /// Bound of the error in any channel of a pixel, in the channel's units.
    error_bound: f64,
}

impl Integration {
    /// Returns integration along straight rays, with the bounds of the errors of early stop and quadrature, and that of
    /// both by the scale.
    fn straight(renderer: &SceneRenderer<'_>, left_out: f64, [quadrature, relative]: [Option<f64>; 2]) -> Self {
        Self::Dvr {
            quadrature: renderer.quadrature.to_string(),
            quadrature_error_bound: quadrature,
            early_stop: EarlyStop { transmittance: renderer.early_stop, error_bound: left_out },
            relative_error_bound: relative,
        }
    }

    /// Adds what a capture records of how its pictures were made.
    fn record(&self, scattering: Option<Value>, extra: &mut Map<String, Value>) {
        if let Self::Dvr { quadrature, early_stop, .. } = self {
            extra.insert("quadrature".into(), json!(quadrature));
            extra.insert("early_stop".into(), json!(early_stop));
        }
        extra.extend(scattering.map(|scattering| ("scattering".to_owned(), scattering)));
    }
}

impl fmt::Display for ViewsReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { output, views, seconds, scales, way, accuracy, plan, tone_mapping, .. } = self;
        let json = output.join(FILE_NAME);
        let file = if json.exists() { &json } else { output };
        let s = if *views == 1 { "" } else { "s" };
        writeln!(f, "{}: {views} view{s} in {seconds:.2} s, {scales}", file.display())?;
        tone_mapping.iter().try_for_each(|tone| writeln!(f, "  PNG: {tone}"))?;
        match way {
            Some(Integration::Dvr {
                quadrature,
                quadrature_error_bound,
                early_stop: EarlyStop { transmittance, error_bound },
                relative_error_bound,
            }) => {
                let quadrature_error = match quadrature_error_bound {
                    Some(bound) => format!("integrates within {bound:.1e}"),
                    None if quadrature == "exact" => "integrates each piece of a cell within 4e-7".to_owned(),
                    None => "states no error".to_owned(),
                };
                write!(
                    f,
                    "  quadrature {quadrature} {quadrature_error}; the early stop at transmittance {transmittance:e} \
                     leaves out at most {error_bound:.1e}"
                )?;
                if let Some(bound) = relative_error_bound {
                    write!(f, "\n  error {:.2} % of the scale at most, of every pixel", 100.0 * bound)?;
                }
            }
            Some(Integration::Paths { paths }) => write!(f, "{paths}")?,
            None => write!(f, "  it was there, made by the same settings")?,
        }
        accuracy.iter().try_for_each(|accuracy| write!(f, "\n{accuracy}"))?;
        match plan {
            Some(plan) if plan.omitted != Some(0.0) => write!(f, "\n  {}", LeftOut(plan)),
            _ => Ok(()),
        }
    }
}

impl ViewsReport {
    /// True if a picture was stopped before it was done.
    pub(super) fn stopped(&self) -> bool {
        self.accuracy.as_ref().is_some_and(AccuracyReport::stopped)
    }
}

/// Views that are to be rendered.
struct Views<'v> {
    settings: &'v RenderSettings,
    target: Target<'v>,
    numbers: Vec<usize>,
    /// Size of the whole picture that a part goes to a file of.
    whole: Option<[usize; 2]>,
    capture: Capture,
    scales: DensityScales,
    up: Option<ChosenUp>,
    remarks: Vec<String>,
    /// Meaning of the colors of the transfer function.
    colors: Option<Colors>,
    provenance: Provenance,
    /// True if paths were asked for.
    paths: bool,
    cancel: Cancel,
}

/// Results of the rendering of views.
#[derive(Default)]
struct Outcome {
    views: usize,
    way: Option<Integration>,
    errors: Vec<PictureError>,
    plan: Option<Plan>,
}

impl RenderSettings {
    /// Renders views and writes them.
    pub(super) fn run_views(&self, target: Target<'_>, begun: Instant, context: &Context) -> Result<ViewsReport> {
        let (views, subject) = self.read_views(target, context)?;
        views.refuse_overwrite()?;
        match views.are_there() {
            true => {
                context.note(format!("{}: it is there, made by the same settings", self.output.display()));
                Ok(views.report(Outcome::default()))
            }
            false => views.run(subject, begun, context),
        }
    }

    /// Reads what views show and where they are seen from.
    fn read_views<'v>(&'v self, target: Target<'v>, context: &Context) -> Result<(Views<'v>, Subject)> {
        // From here on the work ends in order if it is stopped.
        let cancel = context.cancel();
        let mut provenance = self.provenance(context);
        let pictures = &self.pictures;
        let template = pictures.template(None, &mut provenance)?;
        pictures.check_cameras(template.as_ref())?;
        let stated = template.as_ref().map_or(pictures.placed().unwrap_or(1) as usize, |capture| capture.frames.len());
        let numbers = pictures.chosen(stated)?;
        target.holds(numbers.len(), "views", "⟨view=N⟩")?;
        if self.resume && (numbers.len() > 1 || !self.accuracy.on()) {
            return Err(Error::invalid("⟨resume⟩: views appear together, when all are there")
                .hint("give ⟨frames⟩ to render a sequence, picture by picture"));
        }
        let (subject, transfer) = pictures.subject(template.as_ref(), pictures.limits, &mut provenance)?;
        let remarks = remarks(pictures, (&subject, transfer.as_ref()), template.as_ref());
        remarks.iter().for_each(|remark| context.note(format!("remark: {remark}")));
        let paths = pictures.scattering.on() || subject.is_scene();
        let up = pictures.chosen_up(template.as_ref())?;
        up.iter().for_each(|up| context.note(up));
        let place = |name: &str| target.picture(name);
        let capture = pictures.capture(place, &subject, transfer, template.as_ref(), Cameras::around(up.as_ref()))?;
        fits(&capture, self.plane_bytes(), pictures.limits.max_memory)?;
        self.check_aovs(paths)?;
        pictures.scattering.check(paths)?;
        let whole = pictures.whole(target, template.as_ref().and_then(|c| c.frames.get(numbers[0])));
        let scales = DensityScales::of(&subject, capture.density_scale);
        let colors = subject.colors().cloned();
        let views = Views {
            settings: self,
            target,
            numbers,
            whole,
            capture,
            scales,
            up,
            remarks,
            colors,
            provenance,
            paths,
            cancel,
        };
        Ok((views, subject))
    }

    /// Returns how light was integrated, with the events that were counted.
    fn integration(
        &self,
        renderer: &SceneRenderer<'_>,
        (counts, errors, bound): (Counts, &[PictureError], Option<f64>),
    ) -> Integration {
        match &renderer.renderer {
            Renderer::Direct(dvr) => Integration::straight(renderer, dvr.left_out(), [dvr.quadrature_error(), bound]),
            Renderer::Shaded(shaded) => Integration::straight(renderer, shaded.left_out(), [None; 2]),
            Renderer::Paths(_) => Integration::Paths { paths: self.paths(counts, errors) },
        }
    }
}

impl Views<'_> {
    /// Returns the files of each view.
    fn files(&self) -> impl Iterator<Item = Vec<PathBuf>> {
        self.capture.frames.iter().map(|frame| self.settings.files_of(&frame.picture))
    }

    /// Returns how pictures are treated that lie where the views go.
    fn policy(&self) -> Policy<'_> {
        let RenderSettings { overwrite, resume, .. } = *self.settings;
        Policy { own: &self.provenance, keys: Keys::RENDERED, overwrite, resume }
    }

    /// Makes sure that the outputs replace neither inputs nor files that other settings wrote.
    fn refuse_overwrite(&self) -> Result<()> {
        let json = self.target.json();
        let pictures: Vec<PathBuf> = self.files().flatten().collect();
        pictures.iter().chain(&json).try_for_each(|path| protected::check(path))?;
        match json {
            _ if self.settings.overwrite => Ok(()),
            Some(json) => earlier::spare_captures(&json, &pictures, &self.provenance),
            None => pictures.iter().try_for_each(|picture| self.policy().check(picture)),
        }
    }

    /// True if an earlier run of the same settings has left the views as they would be, and they are to stay.
    fn are_there(&self) -> bool {
        let needs: Vec<PathBuf> = self.provenance.inputs.keys().map(PathBuf::from).collect();
        let whole =
            |files: Vec<PathBuf>| self.policy().left(&files, &needs) == Earlier::Whole && !is_stopped(&files[0]);
        self.files().all(whole) && self.target.json().is_none_or(|json| json.exists())
    }

    /// Renders the views and writes them.
    fn run(mut self, subject: Subject, begun: Instant, context: &Context) -> Result<ViewsReport> {
        let Self { settings, target, paths, .. } = self;
        let pictures = &settings.pictures;
        // Pictures wait until all are there: an interrupted run must not mix its pictures with those of an earlier one.
        let mut batch = Batch::new();
        if let Target::Folder(folder) = target {
            batch.make_folder(folder)?;
        }
        let waiting = self.files().map(|files| files.iter().map(|path| batch.add(path)).collect());
        let waiting = waiting.collect::<Result<Vec<Vec<PathBuf>>>>()?;
        let waiting_json = target.json().map(|json| Ok((batch.add(&json)?, json))).transpose()?;
        let scene = pictures.scene(&self.capture, subject).map_err(|e| e.at(&pictures.input))?;
        let (scene, plan) = settings.planned(pictures, scene, paths, context)?;
        plan.iter().for_each(|plan| context.detail(Chosen(plan)));
        let renderer = settings
            .renderer(pictures, plan.as_ref(), (&scene, paths), &scene.cameras, &self.cancel)
            .map_err(|e| e.at(&pictures.input))?;
        let visibility = Visibility::default();
        settings.accuracy.check_paths(matches!(renderer.renderer, Renderer::Paths(_)))?;
        let deadline = Deadline::new(begun, &settings.accuracy, self.numbers.len());
        let (counts, errors, bound) = self.all(&renderer, &scene, &waiting, (deadline, &visibility), context)?;
        for remark in visibility.remarks(self.capture.transfer.is_some(), plan.as_ref()) {
            context.note(format!("remark: {remark}"));
            self.remarks.push(remark);
        }
        self.provenance.lap();
        let way = settings.integration(&renderer, (counts, &errors, bound));
        if let Some((waiting, json)) = &waiting_json {
            let mut extra = record(&self.provenance, plan.as_ref());
            way.record(paths.then(|| pictures.scattering.record(self.colors.as_ref())), &mut extra);
            transforms::save_for(json, waiting, &pictures.recorded_as(&self.capture, &mut extra), &extra)?;
        }
        // Another run may have ended in the folder meanwhile.
        let _lock = target.json().as_deref().and_then(Path::parent).map(atomic::lock_folder);
        self.refuse_overwrite()?;
        batch.commit()?;
        let views = self.numbers.len();
        Ok(self.report(Outcome { views, way: Some(way), errors, plan }))
    }

    /// Renders all views to the files that wait for them. Those whose error is stated come one after the other, since
    /// each has its time.
    fn all(
        &self,
        renderer: &SceneRenderer<'_>,
        scene: &Scene,
        waiting: &[Vec<PathBuf>],
        (mut deadline, visibility): (Deadline, &Visibility),
        context: &Context,
    ) -> Result<(Counts, Vec<PictureError>, Option<f64>)> {
        let Self { settings, numbers, whole, provenance, capture, cancel, .. } = self;
        let bar = context.pictures(numbers.len() as u64, "render");
        let focus = settings.pictures.focus(scene);
        let view = |place: usize, turn: Turn| {
            let (progress, camera, number) = (bar.picture(), &scene.cameras[place], numbers[place]);
            let pictured = Pictured { provenance, pictures: &settings.pictures, number, camera, scene, focus };
            let earlier = pictured.begun(settings, &capture.frames[place].picture);
            let view = (number, camera.into(), turn);
            let (rendered, error) = settings.picture(renderer, view, earlier, (cancel, &progress), context)?;
            // One picture that was stopped is shown as it is. Of several, which appear together, some are missing.
            if numbers.len() > 1 && error.as_ref().is_some_and(PictureError::is_stopped) {
                return Err(Error::cancelled());
            }
            let Rendered { film, counts } = rendered;
            visibility.add(&film);
            let attributes = pictured.attributes(settings, renderer, (&film, error.as_ref()));
            pictured.write(settings, &waiting[place], (&film, attributes), *whole)?;
            let bound = match &renderer.renderer {
                Renderer::Direct(direct) if settings.accuracy.on() => Some(straight::relative_bound(direct, &film)),
                _ => None,
            };
            Ok((counts, error, bound))
        };
        let results: Vec<(Counts, Option<PictureError>, Option<f64>)> = match settings.accuracy.on() {
            true => (0..numbers.len()).map(|place| view(place, deadline.next())).collect::<Result<_>>()?,
            false => ordered::try_map((0..numbers.len()).into_par_iter(), |place| view(place, Turn::default()))?,
        };
        drop(bar);
        let counts = results.iter().fold(Counts::default(), |sum, (counts, ..)| sum.plus(*counts));
        let bound = results.iter().filter_map(|(.., bound)| *bound).reduce(f64::max);
        Ok((counts, results.into_iter().filter_map(|(_, error, _)| error).collect(), bound))
    }

    fn report(self, outcome: Outcome) -> ViewsReport {
        let Self { settings, capture, scales, up, remarks, provenance, .. } = self;
        let Outcome { views, way, errors, plan } = outcome;
        ViewsReport {
            output: settings.output.clone(),
            views,
            model: capture.model,
            scales,
            way,
            accuracy: AccuracyReport::of(&settings.accuracy, errors),
            plan,
            up,
            tone_mapping: settings.tone_mapping_used(),
            remarks: all_worded(remarks),
            seconds: provenance.seconds,
        }
    }
}

/// Begins the keys that a capture has beside those of cameras and medium: where it comes from, and how it was planned.
fn record(provenance: &Provenance, plan: Option<&Plan>) -> Map<String, Value> {
    let mut extra = Map::new();
    extra.insert("provenance".into(), json!(provenance));
    extra.extend(plan.map(|plan| ("plan".to_owned(), json!(plan))));
    extra
}
