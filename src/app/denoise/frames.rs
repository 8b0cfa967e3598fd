//! Frames at work: one thread reads ahead, one denoises, one writes behind.

use super::held::ReadAhead;
use super::motion::Motions;
use super::plan::{Plan, Step};
use super::reading::Reader;
use super::shot::{Shot, Target, View};
use super::view_denoiser::ViewDenoiser;
use super::{COMMAND, Cuts, DenoiseSettings, KEYS};
use crate::app::Context;
use crate::app::context::Stage;
use crate::app::provenance::Provenance;
use crate::cancel::Cancel;
use crate::denoise::{Denoised, Estimate, Halves, HalvesEstimate, Settings, take_back};
use crate::error::{Error, Kind, Result};
use crate::formats::exr::Document;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::time::Instant;

/// A sequence to denoise.
pub(super) struct Sequence<'s> {
    pub numbers: &'s [u32],
    pub inputs: &'s [PathBuf],
    pub outputs: &'s [PathBuf],
    /// Pixels of a frame, of all layers together.
    pub pixels: usize,
    pub settings: &'s DenoiseSettings,
}

/// Outcome of a sequence.
#[derive(Debug, Default)]
pub(super) struct Done {
    pub denoised: usize,
    /// Frames that failed, and why.
    pub failed: Vec<(u32, Error)>,
    pub cuts: Vec<u32>,
    pub filled: usize,
    /// Frames of the pixels that were filled in.
    pub filled_frames: Vec<u32>,
    pub at_rest: bool,
    /// First frame whose alpha contradicts that of its motion, and by how much.
    pub contradiction: Option<(u32, f32)>,
    /// Estimate of noise and error of the first layer of all views, and the number of frames that it is taken from.
    pub estimate: (Estimate, usize),
    /// Estimate by halves, and the number of frames that it is taken from.
    pub by_halves: (HalvesEstimate, usize),
    pub seconds: f64,
}

/// A picture to be written.
struct Picture {
    frame: usize,
    document: Document,
    views: Vec<(Vec<Target>, Vec<Denoised>)>,
    whole: Vec<Target>,
}

/// Where pictures go, and the memory of written ones comes back.
struct Pictures {
    write: SyncSender<Picture>,
    spares: Receiver<Vec<Vec<Denoised>>>,
}

impl Sequence<'_> {
    /// Denoises all frames.
    ///
    /// # Errors
    /// If the settings cannot be used, or the work is interrupted.
    pub(super) fn run(
        &self,
        plan: &Plan,
        settings: Settings,
        provenance: &Provenance,
        cancel: &Cancel,
        context: &Context,
    ) -> Result<Done> {
        let writes = plan.reads().filter(|read| read.write).count();
        let motions = Motions::new(&self.settings.motion, self.numbers, self.settings.limits)?;
        let bar = context.steps(writes as u64, "denoise");
        let done = std::thread::scope(|scope| {
            let (shots, read) = sync_channel(1);
            let (pictures, write) = sync_channel::<Picture>(1);
            let (written, spares) = channel();
            scope.spawn(move || self.read(plan, motions, &shots, cancel));
            let bar = &bar;
            let writer = scope.spawn(move || self.write(&write, &written, provenance, bar));
            let pictures = Pictures { write: pictures, spares };
            let denoised = self.denoise(plan, settings, &read, &pictures, cancel, context);
            drop((read, pictures));
            let written = writer.join().unwrap_or_default();
            denoised.map(|mut done| {
                // Frames that could not be written were counted.
                bar.inc(done.failed.len() as u64);
                done.denoised = writes - done.failed.len() - written.len();
                done.failed.extend(written);
                done
            })
        });
        drop(bar);
        let mut done = done?;
        done.failed.sort_by_key(|(frame, _)| *frame);
        Ok(done)
    }

    /// Reads the frames in the order of the plan.
    fn read(&self, plan: &Plan, motions: Motions<'_>, to: &SyncSender<Result<Shot>>, cancel: &Cancel) {
        let Self { settings, numbers, inputs, .. } = *self;
        let held = ReadAhead::new(self.pixels, settings.limits);
        let mut reader = Reader { settings, numbers, inputs, motions, held };
        for read in plan.reads() {
            // The denoiser hangs up when it is interrupted.
            if cancel.requested() || to.send(reader.shot(read, cancel)).is_err() {
                return;
            }
        }
    }

    /// Denoises what is read, and hands it on to be written.
    fn denoise(
        &self,
        plan: &Plan,
        settings: Settings,
        read: &Receiver<Result<Shot>>,
        pictures: &Pictures,
        cancel: &Cancel,
        context: &Context,
    ) -> Result<Done> {
        let done = Done { at_rest: true, ..Done::default() };
        let mut work =
            Work { sequence: self, settings, views: Vec::new(), expected: None, cuts: BTreeSet::new(), done };
        for step in &plan.steps {
            if cancel.requested() {
                return Err(Error::cancelled());
            }
            let task = match *step {
                Step::Begin => {
                    work.views.iter_mut().for_each(ViewDenoiser::begin);
                    continue;
                }
                Step::Backward => {
                    work.views.iter_mut().for_each(ViewDenoiser::turn);
                    continue;
                }
                Step::Rewind => {
                    work.views.iter_mut().for_each(ViewDenoiser::rewind);
                    continue;
                }
                Step::Look { frame, keep } => FrameTask { frame, forward: false, keep, again: true },
                Step::Denoise { frame, write, again } => FrameTask { frame, forward: true, keep: write, again },
            };
            let Ok(shot) = read.recv() else { return Err(Error::cancelled()) };
            if let Some(shot) = work.receive(&task, shot, context)? {
                work.denoise(&task, shot, pictures)?;
            }
        }
        let Work { cuts, mut done, .. } = work;
        done.cuts = cuts.into_iter().collect();
        done.filled_frames.sort_unstable();
        Ok(done)
    }

    /// Returns the frame if it has the views, pixels and layers of the first one, which `expected` remembers.
    fn fits(&self, frame: usize, shot: Shot, expected: &mut Option<Vec<([usize; 2], usize)>>) -> Result<Shot> {
        let shape = shot.shape();
        let first = expected.get_or_insert_with(|| shape.clone());
        if shape == *first {
            return Ok(shot);
        }
        let differs = match (shape[0].0, first[0].0) {
            (now, before) if shape.len() == first.len() && now != before => {
                let ([width, height], [w, h]) = (now, before);
                format!("{width}x{height} pixels, and the frames before have {w}x{h}")
            }
            _ => "the frame has other views or layers than the frames before".into(),
        };
        Err(Error::invalid(differs)
            .at(&self.inputs[frame])
            .hint("render it again as the others are, or denoise it on its own"))
    }

    /// Writes the pictures that come, and gives their memory back to `written`. Returns those that cannot be written.
    fn write(
        &self,
        pictures: &Receiver<Picture>,
        written: &Sender<Vec<Vec<Denoised>>>,
        provenance: &Provenance,
        bar: &Stage,
    ) -> Vec<(u32, Error)> {
        let mut failed = Vec::new();
        for Picture { frame, mut document, views, whole } in pictures {
            for (target, denoised) in views.iter().flat_map(|(targets, denoised)| targets.iter().zip(denoised)) {
                for (component, channel) in target.channels.iter().enumerate() {
                    document.replace(target.part, *channel, denoised.color.iter().map(|color| color[component]));
                }
            }
            for (target, (_, denoised)) in whole.iter().zip(&views) {
                let [a, b] = [&denoised[0].color, &denoised[1].color];
                for (component, channel) in target.channels.iter().enumerate() {
                    let mean = a.iter().zip(b).map(|(a, b)| 0.5 * (a[component] + b[component]));
                    document.replace(target.part, *channel, mean);
                }
            }
            if self.settings.confidence {
                add_layer(&mut document, &views, "confidence.N", |denoised| denoised.confidence.clone());
            }
            if self.settings.error {
                for (at, name) in ["noise.V", "error.V"].into_iter().enumerate() {
                    add_layer(&mut document, &views, name, |denoised| denoised.map.iter().map(|map| map[at]).collect());
                }
            }
            let mut origin = provenance.clone();
            let files = self.settings.files_of(self.numbers[frame], &self.inputs[frame]);
            let result = origin.files(files.iter().map(PathBuf::as_path)).and_then(|()| {
                document.set_attribute(COMMAND, &provenance.command);
                document.set_attribute(KEYS.settings, &provenance.settings);
                document.set_attribute(KEYS.inputs, &origin.hashes());
                document.write(&self.outputs[frame])
            });
            if let Err(error) = result {
                failed.push((self.numbers[frame], error));
            }
            // Nobody takes it behind the last frame.
            written.send(views.into_iter().map(|(_, denoised)| denoised).collect()).ok();
            bar.inc(1);
        }
        failed
    }
}

/// A frame that is looked at.
struct FrameTask {
    frame: usize,
    /// True if it is denoised, and false if it is observed backwards.
    forward: bool,
    /// True if what is found of it is wanted: the picture, or what the frames that follow show of it.
    keep: bool,
    /// True if it will be looked at again.
    again: bool,
}

/// The denoising of a sequence, frame by frame.
struct Work<'w> {
    sequence: &'w Sequence<'w>,
    settings: Settings,
    /// One a view, from the first frame on.
    views: Vec<ViewDenoiser>,
    /// Pixels and layers of the views of the first frame.
    expected: Option<Vec<([usize; 2], usize)>>,
    cuts: BTreeSet<u32>,
    done: Done,
}

impl Work<'_> {
    /// Returns the frame that was read; none if it fails, which is noted.
    ///
    /// # Errors
    /// If the work is interrupted.
    fn receive(&mut self, task: &FrameTask, shot: Result<Shot>, context: &Context) -> Result<Option<Shot>> {
        let number = self.sequence.numbers[task.frame];
        match shot.and_then(|shot| self.sequence.fits(task.frame, shot, &mut self.expected)) {
            Ok(shot) => return Ok(Some(shot)),
            Err(e) if e.kind() == Kind::Cancelled => return Err(e),
            Err(e) if task.forward && task.keep => self.done.failed.push((number, e)),
            Err(e) if task.forward && !task.again => {
                context.note(format!("frame {number}, of which others learn: {e}"));
            }
            Err(_) => {}
        }
        Ok(None)
    }

    /// Observes a frame, or denoises it and hands it on if it is to be written.
    fn denoise(&mut self, task: &FrameTask, shot: Shot, pictures: &Pictures) -> Result<()> {
        let number = self.sequence.numbers[task.frame];
        let started = Instant::now();
        if shot.contradiction > 0.0 && self.done.contradiction.is_none_or(|(first, _)| number < first) {
            self.done.contradiction = Some((number, shot.contradiction));
        }
        self.done.at_rest &= shot.views.iter().all(|view| view.moved.is_zero());
        let DenoiseSettings { method, cuts: find, error, .. } = *self.sequence.settings;
        let new = || ViewDenoiser::new(method.method(), self.settings, find == Cuts::Auto, error);
        self.views.resize_with(shot.views.len(), new);
        let mut spares = if task.forward { pictures.spares.try_recv().unwrap_or_default() } else { Vec::new() };
        let mut views = Vec::new();
        for (at, view) in shot.views.into_iter().enumerate() {
            if task.forward {
                let mut denoised = spares.pop().unwrap_or_default();
                let cut = self.views[at].denoise(number, &view, task.again, &mut denoised)?;
                self.cuts.extend(cut.then_some(number));
                if task.keep {
                    self.estimate(&view, &mut denoised, at == 0)?;
                }
                views.push((view.targets, denoised));
            } else {
                self.views[at].observe(number, &view, task.keep)?;
            }
        }
        self.done.seconds += started.elapsed().as_secs_f64();
        if let Some(document) = shot.document {
            self.done.filled += shot.filled;
            self.done.filled_frames.extend((shot.filled > 0).then_some(number));
            let picture = Picture { frame: task.frame, document, views, whole: shot.whole };
            pictures.write.send(picture).map_err(|_| Error::cancelled())?;
        }
        Ok(())
    }

    /// Adds what is told of the error of a view, and gives back to halves what they have lost. Views are the same
    /// frame, which counts once.
    fn estimate(&mut self, view: &View, denoised: &mut [Denoised], is_first: bool) -> Result<()> {
        if let Some(found) = denoised[0].estimate {
            let (estimate, frames) = self.done.estimate;
            self.done.estimate = (estimate.plus(found), frames + usize::from(is_first));
        }
        if self.sequence.settings.halves
            && let ([a, b], [da, db]) = (&view.layers[..], denoised)
        {
            let noisy = [&a.color[..], &b.color[..]];
            take_back(view.size, noisy, [&mut da.color, &mut db.color]);
            let halves = Halves { size: view.size, noisy, denoised: [&da.color, &db.color] };
            self.done.by_halves.0.add(HalvesEstimate::of(halves)?);
            self.done.by_halves.1 += usize::from(is_first);
        }
        Ok(())
    }
}

/// Adds a layer of one channel, `LAYER.CHANNEL`, of what `of` returns of the first layer of each view: in a part of its
/// own, or with the view's name between both.
fn add_layer(
    document: &mut Document,
    views: &[(Vec<Target>, Vec<Denoised>)],
    name: &str,
    of: impl Fn(&Denoised) -> Vec<f32>,
) {
    let names = document.header().views();
    let first = views[0].0[0].part;
    for (number, (targets, denoised)) in views.iter().enumerate() {
        let part = targets[0].part;
        let name = match name.split_once('.') {
            Some((layer, channel)) if number > 0 && part == first => format!("{layer}.{}.{channel}", names[number]),
            _ => name.to_owned(),
        };
        document.add(part, &name, of(&denoised[0]));
    }
}
