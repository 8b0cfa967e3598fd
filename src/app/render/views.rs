//! Views: the pictures of a volume from many sides, which appear together as a capture, or one of them.

use super::accuracy::{AccuracyReport, Deadline, PictureError, Turn};
use super::begun::Pictured;
use super::blur::grain;
use super::deep::{DeepReport, Tally};
use super::holdout::{LastMesh, coarse, hides_all};
use super::target::Target;
use super::visibility::Visibility;
use super::{RenderSettings, fits, straight};
use crate::app::Context;
use crate::app::context::Stage;
use crate::app::pictures::Cameras;
use crate::app::pictures::colors::Colors;
use crate::app::pictures::remarks;
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
use crate::formats::transforms::FILE_NAME;
use crate::ordered;
use crate::plan::Plan;
use crate::render::film::{Rendered, View};
use crate::render::integrator::Counts;
use crate::render::renderer::Renderer;
use crate::scene::aim;
use crate::scene::capture::{Capture, Frame, Model};
use crate::scene::scene::Scene;
use crate::wording::all_worded;
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::fmt;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Report of views.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct ViewsReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    /// Number of views that were rendered.
    views: usize,
    /// Number of views that were there, made by the same settings.
    skipped: usize,
    model: Model,
    #[serde(flatten)]
    scales: DensityScales,
    /// How light was integrated; none if nothing was rendered.
    #[serde(flatten)]
    way: Option<Integration>,
    /// Samples of deep pictures.
    #[serde(skip_serializing_if = "Option::is_none")]
    deep: Option<DeepReport>,
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
pub(super) enum Integration {
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
pub(super) struct EarlyStop {
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
    pub(super) fn record(&self, scattering: Option<Value>, extra: &mut Map<String, Value>) {
        if let Self::Dvr { quadrature, early_stop, .. } = self {
            extra.insert("quadrature".into(), json!(quadrature));
            extra.insert("early_stop".into(), json!(early_stop));
        }
        extra.extend(scattering.map(|scattering| ("scattering".to_owned(), scattering)));
    }
}

impl fmt::Display for ViewsReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { output, views, skipped, seconds, scales, way, deep, accuracy, plan, tone_mapping, .. } = self;
        let json = output.join(FILE_NAME);
        let file = if json.exists() { &json } else { output };
        let s = if *views == 1 { "" } else { "s" };
        let there = if *skipped > 0 { format!(", {skipped} that were there") } else { String::new() };
        writeln!(f, "{}: {views} view{s} in {seconds:.2} s{there}, {scales}", file.display())?;
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
            None if *skipped > 1 => write!(f, "  they were there, made by the same settings")?,
            None => write!(f, "  it was there, made by the same settings")?,
        }
        deep.iter().try_for_each(|deep| write!(f, "\n{deep}"))?;
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
pub(super) struct Views<'v> {
    pub settings: &'v RenderSettings,
    pub target: Target<'v>,
    pub numbers: Vec<usize>,
    /// Size of the whole picture that a part goes to a file of.
    whole: Option<[usize; 2]>,
    /// Size of the whole picture of each view.
    sizes: Vec<[u32; 2]>,
    pub capture: Capture,
    scales: DensityScales,
    up: Option<ChosenUp>,
    remarks: Vec<String>,
    /// Meaning of the colors of the transfer function.
    pub colors: Option<Colors>,
    pub provenance: Provenance,
    /// True if paths were asked for.
    pub paths: bool,
    /// Mesh that hides what is behind it.
    mesh: LastMesh,
    /// Samples of deep pictures.
    tally: Tally,
    cancel: Cancel,
}

/// Events of a picture, its error where it is stated, and the bound of its error by its scale where one is known.
type Made = (Counts, Option<PictureError>, Option<f64>);

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
        let left = views.left();
        if !left.is_empty() {
            return views.run(subject, &left, begun, context);
        }
        let are = if views.numbers.len() > 1 { "they are" } else { "it is" };
        context.note(format!("{}: {are} there, made by the same settings", self.output.display()));
        Ok(views.report(Outcome::default()))
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
        let (subject, transfer) = pictures.subject(template.as_ref(), pictures.limits, &mut provenance)?;
        let mut remarks = remarks(pictures, (&subject, transfer.as_ref()), template.as_ref());
        let paths = pictures.scattering.on() || subject.is_scene();
        let up = pictures.chosen_up(template.as_ref())?;
        up.iter().for_each(|up| context.note(up));
        let place = |name: &str| target.picture(name);
        let mut capture =
            pictures.capture(place, &subject, transfer, template.as_ref(), Cameras::around(up.as_ref()))?;
        let middle = || {
            let points = || aim::middle(&subject.outline(capture.transfer.as_ref()));
            Some(pictures.aim.target.map_or_else(points, DVec3::from)).filter(|middle| middle.is_finite())
        };
        let blurred = |frame: &Frame| self.blur.of_view(frame.camera, middle);
        let cameras = capture.frames.iter().map(blurred).collect::<Result<Vec<_>>>()?;
        capture.frames.iter_mut().zip(cameras).for_each(|(frame, camera)| frame.camera = camera);
        fits(&capture, self.plane_bytes(), pictures.limits.max_memory)?;
        self.check_aovs(paths)?;
        pictures.scattering.check(paths)?;
        let whole = pictures.whole(target, template.as_ref().and_then(|c| c.frames.get(numbers[0])));
        remarks.extend(capture.frames.iter().find_map(|frame| grain(&frame.camera, paths, pictures.supersample)));
        self.holdout.check_views(numbers.len())?;
        let of_view = |number: &usize| template.as_ref().and_then(|c| c.frames.get(*number));
        let sizes: Vec<[u32; 2]> = numbers.iter().map(|number| pictures.whole_size(of_view(number))).collect();
        let files: Vec<PathBuf> = numbers.iter().filter_map(|number| self.holdout.file(*number as u32)).collect();
        provenance.files(files.iter().map(PathBuf::as_path))?;
        // Depths of one render are alike: the first speak for all.
        let mesh = LastMesh::default();
        if let Some(first) = self.held_out(numbers[0] as u32, sizes[0], &mesh)? {
            remarks.extend(hides_all(&first).into_iter().chain(coarse(&first, paths, pictures.supersample)));
        }
        remarks.iter().for_each(|remark| context.note(format!("remark: {remark}")));
        let scales = DensityScales::of(&subject, capture.density_scale);
        let colors = subject.colors().cloned();
        let views = Views {
            settings: self,
            target,
            numbers,
            whole,
            sizes,
            capture,
            scales,
            up,
            remarks,
            colors,
            provenance,
            paths,
            mesh,
            tally: Tally::default(),
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
    /// Renders views, by their places, and writes them.
    fn run(mut self, subject: Subject, left: &[usize], begun: Instant, context: &Context) -> Result<ViewsReport> {
        let Self { settings, target, paths, .. } = self;
        let pictures = &settings.pictures;
        // A folder that stays empty is removed again.
        let mut folder = Batch::new();
        if let Target::Folder(path) = target {
            folder.make_folder(path)?;
        }
        left.iter().take(1).try_for_each(|place| atomic::probe(&self.capture.frames[*place].picture))?;
        let mut scene = pictures.scene(&self.capture, subject).map_err(|e| e.at(&pictures.input))?;
        let mut open = scene.cameras.iter().map(|camera| camera.blur.shutter.and_then(|shutter| shutter.open));
        // Views whose shutters differ have no moments in common.
        let common = open.next().flatten().filter(|first| open.all(|other| other == Some(*first)));
        if let Some(common) = common {
            scene.opened(common, pictures.limits.max_memory).map_err(|e| e.at(&pictures.input))?;
        }
        let (scene, plan) = settings.planned(pictures, scene, paths, context)?;
        plan.iter().for_each(|plan| context.detail(Chosen(plan)));
        let renderer = settings
            .renderer(pictures, plan.as_ref(), (&scene, paths), &scene.cameras, &self.cancel)
            .map_err(|e| e.at(&pictures.input))?;
        let visibility = Visibility::default();
        settings.accuracy.check_paths(matches!(renderer.renderer, Renderer::Paths(_)))?;
        let deadline = Deadline::new(begun, &settings.accuracy, left.len());
        let subject = (&renderer, &scene, plan.as_ref());
        let (counts, errors, bound) = self.all(left, subject, (deadline, &visibility), context)?;
        folder.commit()?;
        let function = self.capture.transfer.as_ref().is_some_and(|transfer| !transfer.is_of_labels());
        for remark in visibility.remarks(function, plan.as_ref()) {
            context.note(format!("remark: {remark}"));
            self.remarks.push(remark);
        }
        self.provenance.lap();
        let way = settings.integration(&renderer, (counts, &errors, bound));
        Ok(self.report(Outcome { views: left.len(), way: Some(way), errors, plan }))
    }

    /// Renders views, by their places, and puts them into place: all when all are there, so that a run which is
    /// stopped leaves what an earlier one has made; to resume, each when it is there. Those whose error is stated come
    /// one after the other, since each has its time.
    fn all(
        &self,
        left: &[usize],
        subject: (&SceneRenderer<'_>, &Scene, Option<&Plan>),
        (mut deadline, visibility): (Deadline, &Visibility),
        context: &Context,
    ) -> Result<(Counts, Vec<PictureError>, Option<f64>)> {
        let Self { settings, .. } = self;
        let (renderer, _, plan) = subject;
        let bar = context.pictures(left.len() as u64, "render");
        let way = || settings.integration(renderer, (Counts::default(), &[], None));
        let together = Mutex::new(Batch::new());
        let view = |place: usize, turn: Turn| {
            let made = match settings.resume {
                false => self.view((place, turn), subject, &together, (&bar, visibility), context)?,
                true => {
                    let alone = Mutex::new(Batch::new());
                    let made = self.view((place, turn), subject, &alone, (&bar, visibility), context)?;
                    self.put(&[place], unlocked(alone), (&way(), plan))?;
                    made
                }
            };
            // One picture that was stopped is shown as it is. Of several, some are missing.
            match made.1.as_ref().is_some_and(PictureError::is_stopped) && self.numbers.len() > 1 {
                true => Err(Error::cancelled()),
                false => Ok(made),
            }
        };
        let results: Vec<Made> = match settings.accuracy.on() {
            true => left.iter().map(|place| view(*place, deadline.next())).collect::<Result<_>>()?,
            false => ordered::try_map(left.par_iter(), |place| view(*place, Turn::default()))?,
        };
        drop(bar);
        if !settings.resume {
            self.put(left, unlocked(together), (&way(), plan))?;
        }
        let counts = results.iter().fold(Counts::default(), |sum, (counts, ..)| sum.plus(*counts));
        let bound = results.iter().filter_map(|(.., bound)| *bound).reduce(f64::max);
        Ok((counts, results.into_iter().filter_map(|(_, error, _)| error).collect(), bound))
    }

    /// Renders a view to files that wait in a batch.
    fn view(
        &self,
        (place, turn): (usize, Turn),
        (renderer, scene, _): (&SceneRenderer<'_>, &Scene, Option<&Plan>),
        batch: &Mutex<Batch>,
        (bar, visibility): (&Stage, &Visibility),
        context: &Context,
    ) -> Result<Made> {
        let Self { settings, numbers, whole, sizes, provenance, capture, cancel, .. } = self;
        let (progress, camera, number) = (bar.picture(), &scene.cameras[place], numbers[place]);
        let focus = settings.pictures.focus(scene);
        let pictured = Pictured { provenance, pictures: &settings.pictures, number, camera, scene, focus };
        let earlier = pictured.begun(settings, &capture.frames[place].picture);
        let holdout = settings.held_out(number as u32, sizes[place], &self.mesh)?;
        let view = View { holdout: holdout.as_ref(), ..camera.into() };
        let add = |path: &PathBuf| batch.lock().unwrap_or_else(PoisonError::into_inner).add(path);
        let files = || self.files(place).iter().map(add).collect::<Result<Vec<PathBuf>>>();
        if settings.deep.is_some() {
            let to = (files()?.remove(0), &self.tally);
            let made = settings.deep_picture(&pictured, (renderer, view), to, *whole, (cancel, &progress))?;
            visibility.add_deep(&made.film);
            return Ok((made.counts, None, None));
        }
        let view = (number, view, turn);
        let (rendered, error) = settings.picture(renderer, view, earlier, (cancel, &progress), context)?;
        let Rendered { film, counts } = rendered;
        visibility.add(&film);
        let attributes = pictured.attributes(settings, renderer, (&film, error.as_ref()));
        pictured.write(settings, &files()?, (&film, attributes), *whole)?;
        let bound = match &renderer.renderer {
            Renderer::Direct(direct) if settings.accuracy.on() => Some(straight::relative_bound(direct, &film)),
            _ => None,
        };
        Ok((counts, error, bound))
    }

    fn report(self, outcome: Outcome) -> ViewsReport {
        let Self { settings, numbers, capture, scales, up, remarks, provenance, tally, .. } = self;
        let Outcome { views, way, errors, plan } = outcome;
        ViewsReport {
            output: settings.output.clone(),
            views,
            skipped: numbers.len() - views,
            model: capture.model,
            scales,
            way,
            deep: tally.report(),
            accuracy: AccuracyReport::of(&settings.accuracy, errors),
            plan,
            up,
            tone_mapping: settings.tone_mapping_used(),
            remarks: all_worded(remarks),
            seconds: provenance.seconds,
        }
    }
}

/// Returns what nobody else holds any more.
fn unlocked(batch: Mutex<Batch>) -> Batch {
    batch.into_inner().unwrap_or_else(PoisonError::into_inner)
}
