//! Sequences: a picture for each frame, of one volume or of one for each frame. Every picture is in place as soon as it
//! is done; one that fails does not stop the others.

use super::accuracy::{AccuracyReport, Deadline, PictureError};
use super::begun::{Pictured, is_stopped};
use super::blur::grain;
use super::deep::{DeepReport, Tally};
use super::holdout::{LastMesh, coarse, hides_all};
use super::sequence::{Done, Sequence, Shot};
use super::target::Target;
use super::visibility::Visibility;
use super::{RenderSettings, fits};
use crate::app::Context;
use crate::app::context::Picture;
use crate::app::earlier::Earlier;
use crate::app::failed::{Failed, List};
use crate::app::frame_loop::{FrameLoop, parted};
use crate::app::pictures::DensityScale;
use crate::app::pictures::remarks;
use crate::app::pictures::renderer::Chosen;
use crate::app::pictures::scales::DensityScales;
use crate::app::pictures::scattering::Paths;
use crate::app::pictures::settle::Settled;
use crate::app::pictures::subject::Subject;
use crate::app::pictures::{Cameras, between};
use crate::app::renewed::{self, Renewed};
use crate::app::sequence::{numbers, pattern};
use crate::app::up::ChosenUp;
use crate::app::volume;
use crate::error::{Error, Result};
use crate::formats::atomic::Batch;
use crate::formats::format::{FileKind, Format};
use crate::formats::png::ToneMapping;
use crate::formats::sequence::{Frames, Pattern, number_of};
use crate::formats::vdb::velocity;
use crate::render::film::{Rendered, View};
use crate::render::integrator::Counts;
use crate::render::renderer::Renderer;
use crate::scene::blur;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, Frame};
use crate::scene::holdout::Holdout;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Report of the frames of a sequence.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct FramesReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    rendered: usize,
    skipped: usize,
    /// Frames that were there and were rendered again, by the input that has changed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    renewed: Vec<Renewed>,
    failed: Vec<Failed>,
    #[serde(flatten)]
    scales: DensityScales,
    /// How radiance became the samples of PNGs; none if none were written.
    #[serde(skip_serializing_if = "Option::is_none")]
    tone_mapping: Option<ToneMapping>,
    paths: Option<Paths>,
    /// Samples of deep pictures.
    #[serde(skip_serializing_if = "Option::is_none")]
    deep: Option<DeepReport>,
    /// Errors of the pictures that were rendered, if a target or a time was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    accuracy: Option<AccuracyReport>,
    /// Up axis about which the camera was placed; none where it was given.
    up: Option<ChosenUp>,
    seconds: f64,
}

impl FramesReport {
    /// True if no frame failed.
    pub(crate) fn complete(&self) -> bool {
        self.failed.is_empty()
    }
}

impl fmt::Display for FramesReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            output,
            rendered,
            skipped,
            renewed,
            failed,
            scales,
            tone_mapping,
            paths,
            deep,
            accuracy,
            seconds,
            ..
        } = self;
        write!(f, "{}: {rendered} frames in {seconds:.2} s, ", output.display())?;
        write!(f, "{skipped} that were there, {} that failed; {scales}", failed.len())?;
        write!(f, "{}", renewed::List(renewed))?;
        tone_mapping.iter().try_for_each(|tone| write!(f, "\n  PNG: {tone}"))?;
        paths.map_or(Ok(()), |paths| write!(f, "\n{paths}"))?;
        deep.iter().try_for_each(|deep| write!(f, "\n{deep}"))?;
        accuracy.iter().try_for_each(|accuracy| write!(f, "\n{accuracy}"))?;
        write!(f, "{}", List(failed))
    }
}

impl RenderSettings {
    /// True if frames are to be rendered, not views.
    pub(super) fn is_sequence(&self) -> bool {
        self.frames.is_some() || pattern(&self.pictures.input).is_some()
    }

    /// Renders the frames and writes them. A frame that fails is part of the report.
    ///
    /// # Errors
    /// If no frame can be begun, or pictures of other settings would be replaced.
    pub(super) fn run_frames(&self, target: Target<'_>, begun: Instant, context: &Context) -> Result<FramesReport> {
        let (mut sequence, frames) = self.sequence(target, begun, context)?;
        let mut provenance = sequence.provenance.clone();
        sequence.refuse_overwrite(&frames)?;
        sequence.settle(&frames, context)?;
        // A folder that stays empty is removed again.
        let mut batch = Batch::new();
        if let Target::Folder(folder) = target {
            batch.make_folder(folder)?;
        }

        let Outcome { done, failed, skipped, renewed, counts, errors } = sequence.all(&frames, context)?;
        provenance.inputs.extend(std::mem::take(&mut sequence.inputs));
        let seconds = provenance.lap();
        if skipped < done.len() {
            sequence.note_nothing(context);
        }
        let scales = sequence.write(&done, &mut provenance, context)?;
        if !done.is_empty() {
            batch.commit()?;
        }
        let paths = (counts.paths > 0).then(|| self.paths(counts, &errors));
        let rendered = done.len() - skipped;
        Ok(FramesReport {
            output: self.output.clone(),
            rendered,
            skipped,
            renewed: renewed::by_input(renewed),
            failed,
            scales,
            tone_mapping: self.tone_mapping_used(),
            paths,
            deep: sequence.tally.report(),
            accuracy: AccuracyReport::of(&self.accuracy, errors),
            up: sequence.up,
            seconds,
        })
    }

    /// Begins a sequence: its frames by number, with the picture of each.
    fn sequence<'s>(
        &'s self,
        target: Target<'s>,
        begun: Instant,
        context: &Context,
    ) -> Result<(Sequence<'s>, Vec<(u32, PathBuf)>)> {
        let mut provenance = self.provenance(context);
        let pattern = pattern(&self.pictures.input);
        let numbers = match (self.frames, &pattern) {
            (frames, Some(pattern)) => numbers(frames, pattern)?,
            (frames, None) => frames.into_iter().flat_map(Frames::numbers).collect(),
        };
        if let (Some(pattern), Some(_)) = (&pattern, self.frames) {
            refuse_missing(pattern, &numbers)?;
        }
        target.holds(numbers.len(), "frames", "⟨frames=N⟩")?;
        let cameras_of: Vec<u32> =
            numbers.iter().filter_map(|number| number.checked_add_signed(self.camera_offset)).collect();
        let mut pictures = self.turning();
        let mut template = pictures.template(Some(&cameras_of), &mut provenance)?;
        pictures.check_cameras(template.as_ref())?;
        if let Some(template) = &mut template {
            let chosen = pictures.chosen(template.frames.len())?;
            template.frames = chosen.into_iter().map(|i| template.frames[i].clone()).collect();
            pictures.view.clear();
        }
        let cameras = template.as_ref().map(|template| self.cameras(template, &numbers)).transpose()?;
        if self.orbit.is_none() && self.pictures.placed().is_some_and(|views| views > 1) {
            return Err(Error::invalid("several views: a sequence has one picture for each frame").hint(
                "give ⟨views=1⟩ or one side with ⟨from⟩ for a camera at rest, ⟨orbit⟩ for one that turns, or ⟨cameras⟩ \
                 with one for each frame",
            ));
        }
        let paths = numbers.iter().map(|number| target.picture(&format!("frame.{number:04}.exr")));
        let frames: Vec<(u32, PathBuf)> = numbers.iter().copied().zip(paths).collect();
        if let Some(remark) = template.as_ref().and_then(|template| self.gaps(template, &numbers)) {
            context.note(format!("remark: {remark}"));
        }
        let sequence = Sequence {
            render: self,
            target,
            numbers,
            pictures,
            pattern,
            template,
            cameras: cameras.unwrap_or_default(),
            up: None,
            provenance,
            inputs: BTreeMap::new(),
            shot: None,
            visibility: Visibility::default(),
            mesh: LastMesh::default(),
            tally: Tally::default(),
            remarks: BTreeSet::new(),
            cancel: context.cancel(),
            refused: None,
            deadline: Deadline::new(begun, &self.accuracy, frames.len()),
        };
        Ok((sequence, frames))
    }

    /// Returns the cameras of the frames, cropped, as [`between`] does.
    fn cameras(&self, template: &Capture, numbers: &[u32]) -> Result<Vec<[Camera; 3]>> {
        let path = self.pictures.cameras.as_deref().unwrap_or(Path::new(""));
        let cropped = |cameras: [Camera; 3]| {
            let [before, camera, after] = cameras.map(|camera| self.pictures.cropped(camera));
            Ok([before?, camera?, after?])
        };
        let cameras = between(template, path, numbers, self.camera_offset)?.into_iter().map(cropped);
        self.blur.of_frames(cameras.collect::<Result<_>>()?, (blur::between, self.may_move()))
    }
}

impl RenderSettings {
    /// True if more than the camera may move: what states velocities, or may.
    pub(super) fn may_move(&self) -> bool {
        let states = |format: &Format| matches!(format.kind, FileKind::Capture | FileKind::Usd);
        self.velocity.is_some() || volume::format_of(&self.pictures.input).is_ok_and(states)
    }

    /// Returns what is to be said of frames beside which a moving camera is not known.
    fn gaps(&self, template: &Capture, numbers: &[u32]) -> Option<String> {
        self.blur.shutter.filter(|time| *time > 0.0 && template.frames.len() > 1)?;
        let known: BTreeSet<u32> = template.frames.iter().filter_map(|f| number_of(&f.picture)).collect();
        let lacks = |number: &&u32| {
            let own = number.checked_add_signed(self.camera_offset);
            own.is_some_and(|n| {
                !known.contains(&n.saturating_add(1)) || n.checked_sub(1).is_none_or(|n| !known.contains(&n))
            })
        };
        let lacking: Vec<&u32> = numbers.iter().filter(lacks).collect();
        let first = lacking.first()?;
        Some(format!(
            "⟨shutter⟩: beside {} of the frames, frame {first} the first of them, a camera is missing in ⟨cameras⟩, \
             and the motion to that side is not blurred",
            lacking.len()
        ))
    }
}

/// Refuses frames of which none is there.
fn refuse_missing(pattern: &Pattern, numbers: &[u32]) -> Result<()> {
    let known = pattern.numbers()?;
    match (known.first(), known.last()) {
        (Some(first), Some(last)) if !numbers.iter().any(|number| known.binary_search(number).is_ok()) => {
            Err(Error::invalid("none of the selected frames is there")
                .at(pattern.name())
                .hint(format!("the frames that are there lie from {first} to {last}; choose among them")))
        }
        _ => Ok(()),
    }
}

/// Frames of a sequence by what became of them.
#[derive(Default)]
struct Outcome {
    /// Frames that are there.
    done: Vec<Done>,
    failed: Vec<Failed>,
    skipped: usize,
    /// Frames that were there and were rendered again, with the input that has changed.
    renewed: Vec<(u32, PathBuf)>,
    counts: Counts,
    /// Errors of the frames that were rendered, where they are stated.
    errors: Vec<PictureError>,
}

impl Sequence<'_> {
    /// Renders one frame after the other.
    ///
    /// # Errors
    /// If the work is interrupted.
    fn all(&mut self, frames: &[(u32, PathBuf)], context: &Context) -> Result<Outcome> {
        let numbers: Vec<u32> = frames.iter().map(|(number, _)| *number).collect();
        let work = |place: usize, number, picture: &Picture<'_>| {
            let path = &frames[place].1;
            let earlier = self.state(number, path);
            let made = match earlier {
                Earlier::Whole if !is_stopped(path) => {
                    self.deadline.skip();
                    None
                }
                _ => Some(self.frame((place, number), path, picture, context)?),
            };
            Ok((place, earlier, made))
        };
        let results = FrameLoop::pictures(&numbers, "render", context).telling().in_order(work);
        let results = results.map_err(|error| self.refused.take().unwrap_or(error))?;
        let (done, failed) = parted(results);
        let mut outcome = Outcome { failed, ..Outcome::default() };
        for (number, (place, earlier, made)) in done {
            outcome.skipped += usize::from(made.is_none());
            let (counts, error) = made.unwrap_or_default();
            outcome.counts = outcome.counts.plus(counts);
            outcome.errors.extend(error);
            outcome.done.push((place, number, frames[place].1.clone()));
            if let Earlier::Outdated(input) = earlier {
                outcome.renewed.push((number, input));
            }
        }
        Ok(outcome)
    }

    /// Takes what must not change from frame to frame once: that of earlier runs whose frames stay, or of some frames.
    fn settle(&mut self, frames: &[(u32, PathBuf)], context: &Context) -> Result<()> {
        let numbers: Vec<u32> = frames.iter().map(|(number, _)| *number).collect();
        let placed = self.cameras.is_empty();
        if placed {
            // The first file that can be asked: others fail by themselves.
            self.up = numbers.iter().find_map(|number| self.up_of(*number));
            self.up.iter().for_each(|up| context.note(up));
        }
        let up = placed.then(|| self.up.as_ref().map(|up| up.axis).unwrap_or_default());
        let own: Vec<&Path> = frames.iter().map(|(_, path)| path.as_path()).collect();
        let stay = |capture: &Capture| self.render.resume || !self.others(capture.clone(), &own).is_empty();
        let earlier = self.earlier().filter(stay);
        let settled = match &earlier {
            // Nothing is left to be settled.
            Some(_) if self.pictures.planning.max_omitted == 0.0 && self.render.orbit.is_none() => Settled::default(),
            _ => {
                let _stage = context.stage("settling");
                self.pictures.settle(self.pattern.as_ref(), &numbers, self.template.as_ref(), up, &context.cancel())?
            }
        };
        let settled = match earlier {
            Some(earlier) if self.render.orbit.is_some() => {
                let cameras = settled.cameras.clone();
                Settled { cameras, ..settled.after(&earlier) }
            }
            Some(earlier) => settled.after(&earlier),
            None => settled,
        };
        if placed {
            self.cameras = self.at_frames(&settled.cameras, &numbers)?;
        }
        if self.pictures.density_scale == Some(DensityScale::Auto) {
            self.pictures.density_scale =
                settled.density_scale.map(DensityScale::Given).or(self.pictures.density_scale);
        }
        self.pictures.planning.force.extend(settled.kept);
        if !settled.frames.is_empty() {
            let list = settled.frames.iter().map(u32::to_string).collect::<Vec<_>>().join(", ");
            context.detail(format!("camera, scale and effects of all frames are settled by frames {list}"));
        }
        Ok(())
    }

    /// Returns the up axis about which the camera of a frame is to be placed; none where cameras are given, or the
    /// frame's file cannot be read.
    fn up_of(&self, number: u32) -> Option<ChosenUp> {
        let mut pictures = self.pictures.clone();
        if let Some(pattern) = &self.pattern {
            pictures.input = pattern.path(number);
        }
        pictures.chosen_up(self.template.as_ref()).ok().flatten()
    }

    /// Says why nothing is to be seen, if that is so.
    fn note_nothing(&self, context: &Context) {
        let transfer = self.shot.as_ref().and_then(|shot| shot.capture.transfer.as_ref());
        let function = transfer.is_some_and(|transfer| !transfer.is_of_labels());
        let plan = self.shot.as_ref().and_then(|shot| shot.plan.as_ref());
        for remark in self.visibility.remarks(function, plan) {
            context.note(format!("remark: {remark}"));
        }
    }

    /// Reads and plans a frame. What the first one settles, camera and density scale, holds for all.
    pub(super) fn shot(&mut self, place: usize, number: u32, context: &Context) -> Result<Shot> {
        let mut pictures = self.pictures.clone();
        pictures.frame = Some(number);
        if let Some(pattern) = &self.pattern {
            pictures.input = pattern.path(number);
        }
        let limits = pictures.limits;
        let mut provenance = self.provenance.clone();
        let (subject, transfer) = pictures.subject(self.template.as_ref(), limits, &mut provenance)?;
        // Frames of one sequence are alike: the first speaks for their values.
        let first = transfer.as_ref().filter(|_| place == 0);
        let paths = pictures.scattering.on() || subject.is_scene();
        let blurred = self.cameras.first().and_then(|[_, camera, _]| grain(camera, paths, pictures.supersample));
        for remark in remarks(&pictures, (&subject, first), self.template.as_ref()).into_iter().chain(blurred) {
            if self.remarks.insert(remark.clone()) {
                context.note(format!("remark: {remark}"));
            }
        }
        let moving = self.pattern.is_some() || matches!(subject, Subject::Scene { moving: true, .. });
        if self.render.velocity.is_some() && subject.is_scene() {
            return Err(Error::invalid("⟨velocity⟩: the scene file states the velocities of its volumes")
                .at(&pictures.input)
                .hint("add \"velocity\": {\"grid\": \"vel\"} to a volume of it"));
        }
        let to = |name: &str| self.target.picture(name);
        let cameras = match self.cameras.first() {
            Some([_, camera, _]) => Cameras::Settled(camera),
            None => Cameras::around(self.up.as_ref()),
        };
        let mut capture = pictures.capture(to, &subject, transfer, self.template.as_ref(), cameras)?;
        self.pictures.density_scale = Some(DensityScale::Given(capture.density_scale)).filter(|_| !subject.is_scene());
        if self.cameras.is_empty() {
            let placed: Vec<Camera> = capture.frames.iter().map(|frame| frame.camera).collect();
            self.cameras = self.at_frames(&placed, &self.numbers)?;
        }
        let picture = self.target.picture(&format!("frame.{number:04}.exr"));
        capture.frames = vec![Frame { camera: self.camera(place), picture }];
        fits(&capture, self.render.plane_bytes(), limits.max_memory)?;
        self.render.check_aovs(paths)?;
        pictures.scattering.check(paths)?;
        let scales = DensityScales::of(&subject, capture.density_scale);
        let colors = subject.colors().cloned();
        let mut scene = pictures.scene(&capture, subject).map_err(|e| e.at(&pictures.input))?;
        if let Some(name) = &self.render.velocity {
            let (file, fps) = (volume::open(&pictures.input, &pictures.scan, limits)?, self.render.fps);
            scene.velocities = vec![(0, velocity::read(&file, name, fps, limits.max_memory)?)];
        }
        let open = self.open(place);
        if let Some(open) = open {
            scene.opened(open, limits.max_memory).map_err(|e| e.at(&pictures.input))?;
        }
        let (scene, plan) = self.render.planned(&pictures, scene, paths, context)?;
        plan.iter().for_each(|plan| context.detail(Chosen(plan)));
        let focus = self.pictures.focus(&scene);
        Ok(Shot { capture, scales, scene, open, focus, colors, plan, provenance, paths, moving })
    }

    /// Remarks on depths that may have been meant otherwise, on what stands for all frames once.
    fn note_held_out(&mut self, holdout: Option<&Holdout>, paths: bool, context: &Context) {
        let Some(holdout) = holdout else { return };
        let coarse = coarse(holdout, paths, self.pictures.supersample);
        for remark in hides_all(holdout).into_iter().chain(coarse) {
            if self.remarks.insert(remark.clone()) {
                context.note(format!("remark: {remark}"));
            }
        }
    }

    /// Returns the times at which the shutter of a frame opens and closes, if they are known.
    fn open(&self, place: usize) -> Option<[f64; 2]> {
        self.camera(place).blur.shutter.and_then(|shutter| shutter.open)
    }

    pub(super) fn camera(&self, place: usize) -> Camera {
        self.cameras[place.min(self.cameras.len() - 1)][1]
    }

    /// Renders and writes a frame.
    fn frame(
        &mut self,
        (place, number): (usize, u32),
        path: &Path,
        progress: &Picture<'_>,
        context: &Context,
    ) -> Result<(Counts, Option<PictureError>)> {
        let turn = self.deadline.next();
        let shot = match self.shot.take() {
            Some(shot) if !shot.moving && shot.open == self.open(place) => shot,
            _ => Arc::new(self.shot(place, number, context)?),
        };
        let shot = Arc::clone(self.shot.insert(shot));
        let [before, camera, after] = self.cameras[place.min(self.cameras.len() - 1)];
        let (plan, scene) = (shot.plan.as_ref(), (&shot.scene, shot.paths));
        let renderer = self.render.renderer(&self.pictures, plan, scene, &[camera], &self.cancel)?;
        let stated = self.template.as_ref().and_then(|c| c.frames.first());
        let holdout = self.render.held_out(number, self.pictures.whole_size(stated), &self.mesh)?;
        let whole = self.pictures.whole(self.target, stated);
        self.note_held_out(holdout.as_ref(), shot.paths, context);
        let mut provenance = shot.provenance.clone();
        provenance.files(self.render.holdout.file(number).as_deref())?;
        let (before, after, holdout) = (Some(&before), Some(&after), holdout.as_ref());
        let view = View { camera: &camera, before, after, holdout, velocities: &shot.scene.velocities };
        self.render.accuracy.check_paths(matches!(renderer.renderer, Renderer::Paths(_)))?;
        let pictured = Pictured {
            provenance: &provenance,
            pictures: &self.pictures,
            number: number as usize,
            camera: &camera,
            scene: &shot.scene,
            focus: shot.focus,
        };
        if self.render.deep.is_some() {
            let (render, work) = (self.render, (&self.cancel, progress));
            let (mut counts, visibility) = (Counts::default(), &self.visibility);
            let refused = self.place(path, |files| {
                let to = (files[0].clone(), &self.tally);
                let made = render.deep_picture(&pictured, (&renderer, view), to, whole, work)?;
                visibility.add_deep(&made.film);
                counts = made.counts;
                Ok(())
            })?;
            self.inputs.extend(provenance.inputs.clone());
            self.refused = refused;
            return if self.refused.is_some() { Err(Error::cancelled()) } else { Ok((counts, None)) };
        }
        let earlier = pictured.begun(self.render, path);
        let view = (number as usize, view, turn);
        let (rendered, error) = self.render.picture(&renderer, view, earlier, (&self.cancel, progress), context)?;
        let Rendered { film, counts } = rendered;
        self.visibility.add(&film);
        self.inputs.extend(provenance.inputs.clone());
        let mut attributes = pictured.attributes(self.render, &renderer, (&film, error.as_ref()));
        attributes.insert("cumulo:frame".into(), number.to_string());
        self.refused = self.place(path, |files| pictured.write(self.render, files, (&film, attributes), whole))?;
        // A frame that was stopped is there to go on from, and the last.
        match self.refused.is_some() || error.as_ref().is_some_and(PictureError::is_stopped) {
            true => Err(Error::cancelled()),
            false => Ok((counts, error)),
        }
    }
}
