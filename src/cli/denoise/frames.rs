//! Frames at work: one thread reads ahead, one denoises, one writes behind.

use super::held::Held;
use super::motion::{Asked, Motions};
use super::passes::Directions;
use super::plan::{Plan, Read, Step};
use super::shot::{Layer, Shot, Target};
use super::{COMMAND, Cuts, Denoise, Guide, INPUTS};
use crate::cli::failed::{self, Failed};
use crate::cli::output::Output;
use crate::cli::provenance::Provenance;
use crate::denoise::{Denoised, Settings};
use crate::error::{Error, Kind, Result};
use crate::formats::exr::Document;
use glam::Vec3;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::time::Instant;

/// A sequence to denoise.
pub struct Sequence<'s> {
    pub numbers: &'s [u32],
    pub inputs: &'s [PathBuf],
    pub outputs: &'s [PathBuf],
    /// Pixels of a frame, of all layers together.
    pub pixels: usize,
    pub command: &'s Denoise,
}

/// Outcome of a sequence.
#[derive(Debug, Default)]
pub struct Done {
    pub denoised: usize,
    pub failed: Vec<Failed>,
    pub cuts: Vec<u32>,
    pub filled: usize,
    pub at_rest: bool,
    pub seconds: f64,
}

/// Returns the channel of the beauty's alpha, if it lies in the part.
fn beauty_alpha(document: &Document, part: usize) -> Option<usize> {
    let beauty = document.layer(None).ok().filter(|beauty| beauty.part == part)?;
    document.component(&beauty, "A")
}

/// A picture to be written.
struct Picture {
    frame: usize,
    document: Document,
    targets: Vec<Target>,
    denoised: Vec<Denoised>,
}

/// Where pictures go, and the memory of written ones comes back.
struct Pictures {
    write: SyncSender<Picture>,
    spares: Receiver<Vec<Denoised>>,
}

impl Sequence<'_> {
    /// Denoises all frames.
    ///
    /// # Errors
    /// If the settings cannot be used, or the work is interrupted.
    pub fn run(
        &self,
        plan: &Plan,
        settings: Settings,
        provenance: &Provenance,
        cancel: &AtomicBool,
        output: &Output,
    ) -> Result<Done> {
        let writes = plan.reads().filter(|read| read.write).count();
        let motions = Motions::new(&self.command.motion, self.numbers, self.command.memory.limits())?;
        let bar = output.progress(writes as u64, "denoise");
        let done = std::thread::scope(|scope| {
            let (shots, read) = sync_channel(1);
            let (pictures, write) = sync_channel::<Picture>(1);
            let (written, spares) = channel();
            scope.spawn(move || self.read(plan, motions, &shots, cancel));
            let bar = &bar;
            let writer = scope.spawn(move || self.write(&write, &written, provenance, bar));
            let pictures = Pictures { write: pictures, spares };
            let denoised = self.denoise(plan, settings, &read, &pictures, cancel, output);
            drop((read, pictures));
            let written = writer.join().unwrap_or_default();
            denoised.map(|mut done| {
                done.denoised = writes - done.failed.len() - written.len();
                done.failed.extend(written);
                done
            })
        });
        bar.finish_and_clear();
        let mut done = done?;
        done.failed.sort_by_key(|failed| failed.frame);
        failed::tell(&done.failed);
        Ok(done)
    }

    /// Reads the frames in the order of the plan.
    fn read(&self, plan: &Plan, mut motions: Motions<'_>, to: &SyncSender<Result<Shot>>, cancel: &AtomicBool) {
        let mut held = Held::new(self.pixels, self.command.memory.limits());
        for read in plan.reads() {
            // The denoiser hangs up when it is interrupted.
            if cancel.load(Ordering::Relaxed) || to.send(self.shot(read, &mut motions, &mut held, cancel)).is_err() {
                return;
            }
        }
    }

    /// Reads a frame.
    fn shot(&self, read: Read, motions: &mut Motions<'_>, held: &mut Held, cancel: &AtomicBool) -> Result<Shot> {
        let Read { frame, forward, write } = read;
        let limits = self.command.memory.limits();
        let (path, number) = (&self.inputs[frame], self.numbers[frame]);
        let document = match held.take(frame) {
            Some(document) => document,
            None => Document::read(path, limits)?,
        };
        let targets = self.targets(&document).map_err(|e| e.at(path))?;
        let size = document.size(targets[0].part);
        let mut filled = 0;
        let mut layers = Vec::new();
        // Layers may have one alpha.
        let mut alphas: BTreeMap<[usize; 2], Arc<Vec<f32>>> = BTreeMap::new();
        for target in &targets {
            if document.size(target.part) != size {
                return Err(Error::invalid("the layers have different sizes")
                    .at(path)
                    .hint("denoise them one after the other, with --layers"));
            }
            let planes: Vec<Cow<'_, [f32]>> =
                target.channels.iter().map(|c| document.samples(target.part, *c)).collect();
            let plane = |c: usize| &planes[c.min(planes.len() - 1)];
            let colors = plane(0).iter().zip(plane(1).iter()).zip(plane(2).iter());
            let colors: Vec<Vec3> = colors.map(|((r, g), b)| Vec3::new(*r, *g, *b)).collect();
            filled += colors.iter().filter(|color| !color.is_finite()).count();
            let alpha = target.alpha.map(|channel| {
                let samples = || Arc::new(document.samples(target.part, channel).into_owned());
                Arc::clone(alphas.entry([target.part, channel]).or_insert_with(samples))
            });
            layers.push(Layer { color: colors, alpha });
        }
        let asked = Asked { document: &document, size, number, forward };
        let moved = motions.of(&asked, cancel).map_err(|e| match e.path() {
            Some(_) => e,
            None => e.at(path),
        })?;
        if let Some(alpha) = &moved.alpha {
            let guided = layers.iter_mut().zip(&targets).filter(|(_, target)| target.channels.len() > 1);
            guided
                .filter(|_| self.command.guide == Guide::Alpha)
                .for_each(|(layer, _)| layer.alpha = Some(alpha.clone()));
        }
        let mut shot = Shot { size, layers, moved, filled, targets, document: None };
        if write {
            shot.document = Some(document);
        } else if !forward {
            held.insert(frame, document);
        }
        Ok(shot)
    }

    /// Returns the channels to denoise.
    fn targets(&self, document: &Document) -> Result<Vec<Target>> {
        let names: Vec<Option<&str>> = match &self.command.layers[..] {
            [] => vec![None],
            names => names.iter().map(|name| Some(name.as_str())).collect(),
        };
        let mut targets = Vec::new();
        for name in names {
            let layer = document.layer(name)?;
            let channels = document.colors(&layer).ok_or_else(|| {
                Error::invalid("a layer without three channels of color")
                    .part(format!("layer '{}'", layer.name))
                    .hint("name layers with R, G and B with --layers; `cumulo info` lists them")
            })?;
            let own = document.component(&layer, "A");
            let guide = match self.command.guide {
                Guide::Alpha => own.or_else(|| beauty_alpha(document, layer.part)),
                Guide::None => None,
            };
            targets.push(Target { part: layer.part, channels: channels.to_vec(), alpha: guide });
            let alpha = own.filter(|_| self.command.alpha);
            targets.extend(alpha.map(|alpha| Target { part: layer.part, channels: vec![alpha], alpha: None }));
        }
        Ok(targets)
    }

    /// Denoises what is read, and hands it on to be written.
    fn denoise(
        &self,
        plan: &Plan,
        settings: Settings,
        read: &Receiver<Result<Shot>>,
        pictures: &Pictures,
        cancel: &AtomicBool,
        output: &Output,
    ) -> Result<Done> {
        let mut done = Done { at_rest: true, ..Done::default() };
        let mut cuts = BTreeSet::new();
        let mut directions = Directions::new(self.command.method.method(), settings, self.command.cuts == Cuts::Auto);
        let mut expected = None;
        for step in &plan.steps {
            if cancel.load(Ordering::Relaxed) {
                return Err(Error::cancelled());
            }
            let (frame, forward, keep) = match *step {
                Step::Begin => {
                    directions.begin();
                    continue;
                }
                Step::Backward => {
                    directions.turn();
                    continue;
                }
                Step::Look { frame, keep } => (frame, false, keep),
                Step::Denoise { frame, write } => (frame, true, write),
            };
            let number = self.numbers[frame];
            let Ok(shot) = read.recv() else { return Err(Error::cancelled()) };
            let shot = match shot.and_then(|shot| self.fits(frame, shot, &mut expected)) {
                Ok(shot) => shot,
                Err(e) if e.kind() == Kind::Cancelled => return Err(e),
                Err(e) => {
                    if forward && keep {
                        done.failed.push(Failed { frame: number, error: e.to_string() });
                    } else if forward {
                        output.note(format!("frame {number}, of which others learn: {e}"));
                    }
                    continue;
                }
            };
            let started = Instant::now();
            done.at_rest &= shot.moved.is_zero();
            if !forward {
                directions.look(number, &shot, keep)?;
                done.seconds += started.elapsed().as_secs_f64();
                continue;
            }
            let mut denoised = pictures.spares.try_recv().unwrap_or_default();
            let cut = directions.denoise(number, &shot, &mut denoised)?;
            done.seconds += started.elapsed().as_secs_f64();
            if cut {
                cuts.insert(number);
            }
            if let Some(document) = shot.document {
                done.filled += shot.filled;
                let picture = Picture { frame, document, targets: shot.targets, denoised };
                if pictures.write.send(picture).is_err() {
                    return Err(Error::cancelled());
                }
            }
        }
        done.cuts = cuts.into_iter().collect();
        Ok(done)
    }

    /// Returns the frame if it has as many pixels and layers as the first one, which `expected` remembers.
    fn fits(&self, frame: usize, shot: Shot, expected: &mut Option<([usize; 2], usize)>) -> Result<Shot> {
        let (size, layers) = *expected.get_or_insert((shot.size, shot.layers.len()));
        if shot.size == size && shot.layers.len() == layers {
            return Ok(shot);
        }
        let ([width, height], [w, h]) = (shot.size, size);
        Err(Error::invalid(format!("{width}x{height} pixels, and the frames before have {w}x{h}"))
            .at(&self.inputs[frame])
            .hint("render it again in the size of the others, or denoise it on its own"))
    }

    /// Writes the pictures that come, and gives their memory back to `written`. Returns those that cannot be written.
    fn write(
        &self,
        pictures: &Receiver<Picture>,
        written: &Sender<Vec<Denoised>>,
        provenance: &Provenance,
        bar: &indicatif::ProgressBar,
    ) -> Vec<Failed> {
        let mut failed = Vec::new();
        for Picture { frame, mut document, targets, denoised } in pictures {
            for (target, denoised) in targets.iter().zip(&denoised) {
                for (component, channel) in target.channels.iter().enumerate() {
                    document.replace(target.part, *channel, denoised.color.iter().map(|color| color[component]));
                }
            }
            if self.command.confidence {
                let confidence = denoised[0].confidence.clone();
                document.add(targets[0].part, "confidence.N", confidence);
            }
            let mut origin = provenance.clone();
            let files = self.command.files_of(self.numbers[frame], &self.inputs[frame]);
            let result = origin.files(files.iter().map(PathBuf::as_path)).and_then(|()| {
                document.set_attribute(COMMAND, &provenance.command);
                document.set_attribute(INPUTS, &origin.hashes());
                document.write(&self.outputs[frame])
            });
            if let Err(error) = result {
                failed.push(Failed { frame: self.numbers[frame], error: error.to_string() });
            }
            // Nobody takes it behind the last frame.
            written.send(denoised).ok();
            bar.inc(1);
        }
        failed
    }
}
