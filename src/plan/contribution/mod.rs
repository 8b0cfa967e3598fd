//! What parts of the light contribute to pictures, measured on paths of their own.
//!
//! Light is linear: a source contributes what the scene shows with this source alone, and light that is scattered more
//! than n times what paths show beyond those that end after n scatterings, path by path with the same random numbers.
//! The paths of a block of 8 x 8 pixels are independent draws. From them follows, block by block, an upper limit of the
//! mean that the part adds to the block's pixels ([`limit`]). Statements are shared out (Bonferroni 1936): one for each
//! part, block, channel, way to a limit and number of paths at which limits are looked at. The largest limits of all
//! parts then hold together with the confidence, whatever decides when to stop.

mod blocks;
mod limit;

use crate::cancel::Cancel;
use crate::error::Result;
use crate::math::{Aabb, Ray};
use crate::render::integrator::{Integrator, Sample};
use crate::render::path::{Limits, PathTracer, Primary, Scratch};
use crate::render::sampler::Sampler;
use crate::scene::camera::Camera;
use crate::scene::environment::Environment;
use crate::scene::scene::Scene;
use blocks::Block;
use glam::{DVec3, Vec3};
pub(super) use limit::Caps;
use limit::{Shares, Tally};
use rayon::prelude::*;
use serde::Serialize;

/// Confidence with which what is left out by measurement is below what a plan states.
pub const CONFIDENCE: f64 = 0.95;

/// Paths of a block at which limits are looked at.
const LOOKS: [u32; 4] = [64, 256, 1024, 4096];

/// Looks of a part that is to be known, where nothing may be left out.
const LOOKS_TO_KNOW: usize = 2;

/// Most scatterings that are tried.
pub(super) const RUNGS: [u32; 10] = [1, 2, 4, 8, 16, 32, 64, 128, 256, 512];

/// Blocks that are looked at before all others, and the look whose paths they have then.
const PROBE: usize = 16;
const PROBE_LOOK: usize = 2;

/// First number of the random numbers, which no picture has.
const STREAM: u64 = 0x5EED << 48;

/// Contribution of an effect, or of the part of it that is left out, to pictures: radiance, the largest of the
/// channels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Contribution {
    /// Mean over all pictures.
    pub mean: f64,
    /// Largest mean of a block of 8 x 8 pixels, as it was found.
    pub worst: f64,
    /// Upper limit of the mean of each such block, with the plan's confidence; none where nothing finite is known.
    pub limit: Option<f64>,
}

/// Part of the light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// All that is scattered.
    Scattered,
    /// Emission of the media, scattered or not.
    Emitted,
    /// A light, by its number.
    Light(usize),
    /// Light from all around that is scattered.
    Environment,
    /// Light that is scattered more often than this.
    Beyond(u32),
}

/// Sources of light that shine.
#[derive(Debug, Clone)]
pub(super) struct Shining {
    /// Lights, by their numbers.
    pub lights: Vec<usize>,
    pub environment: bool,
    pub emission: bool,
}

/// Measurement of a part.
pub(super) struct Verdict {
    pub contribution: Contribution,
    /// Upper limit of the mean of a block, by channel.
    pub limit: DVec3,
    /// True if the limit is as low as was asked for.
    pub within: bool,
}

/// Measures parts of a scene's light in the pictures of cameras.
pub(super) struct Pilot<'s> {
    scene: &'s Scene,
    cameras: &'s [Camera],
    tracer: PathTracer<'s>,
    /// Blocks that media may be seen in.
    blocks: Vec<Block>,
    /// Pixels of all pictures.
    pixels: f64,
    shares: Shares,
    /// Radiance of a path above which there are few that matter.
    cut: f64,
    /// Limits of light beyond fewer scatterings, block by block.
    carried: Vec<DVec3>,
    /// Blocks that showed most of that light.
    brightest: Vec<usize>,
    cancel: &'s Cancel,
}

impl<'s> Pilot<'s> {
    /// Begins to measure a scene whose media lie in a box, where `max_omitted` may be left out in all.
    ///
    /// # Errors
    /// If a medium or a light cannot be used.
    pub(super) fn new(
        scene: &'s Scene,
        (cameras, within): (&'s [Camera], Aabb),
        max_omitted: f64,
        cancel: &'s Cancel,
    ) -> Result<Self> {
        let glows = scene.volumes.iter().any(|volume| volume.emission().is_some());
        let blocks = blocks::of(cameras, (!glows).then_some(within));
        let parts = 3 + scene.lights.len() + RUNGS.len();
        let pixels = cameras.iter().map(|camera| f64::from(camera.width) * f64::from(camera.height)).sum();
        Ok(Self {
            tracer: PathTracer::new(scene)?,
            shares: Shares::new(CONFIDENCE, parts * blocks.len() * LOOKS.len()),
            carried: vec![DVec3::INFINITY; blocks.len()],
            brightest: Vec::new(),
            cut: 0.5 * max_omitted,
            scene,
            cameras,
            blocks,
            pixels,
            cancel,
        })
    }

    /// Measures a part, of the light of the sources that shine, until its limit is known to be `most` or less, or not
    /// expected to become so. Incomplete if the work was cancelled.
    ///
    /// # Errors
    /// If a light cannot be used.
    pub(super) fn measure(&mut self, part: Part, shining: &Shining, caps: &Caps, most: f64) -> Result<Verdict> {
        self.light(part, shining)?;
        let all = 0..self.blocks.len();
        let beyond = matches!(part, Part::Beyond(_));
        let mut limits = if beyond { self.carried.clone() } else { vec![DVec3::INFINITY; self.blocks.len()] };
        let mut found = vec![Tally::default(); self.blocks.len()];
        let looks = if most > 0.0 { LOOKS.len() } else { LOOKS_TO_KNOW };
        // Blocks that were bright show soonest that too much is missing.
        let probe = std::mem::take(&mut self.brightest);
        let rest = all.clone().collect();
        let mut turns = vec![(0, rest), (if most > 0.0 { PROBE_LOOK } else { 0 }, probe)];
        let (mut first, mut given_up) = (None, false);
        while let Some((look, open)) = turns.pop() {
            self.trace(part, &open, look, &mut found);
            let lit = limit::brightness(&found, &self.shares);
            let stated: Vec<DVec3> =
                open.par_iter().map(|number| found[*number].limit(caps, (lit, self.cut), &self.shares)).collect();
            for (number, limit) in open.iter().zip(&stated) {
                limits[*number] = limits[*number].min(*limit);
            }
            let last = LOOKS[looks - 1];
            given_up |= most > 0.0 && open.iter().any(|number| found[*number].exceeds(most, last, &self.shares));
            if turns.is_empty() {
                first = first.or_else(|| Some(self.mean(&found)));
            }
            // All but the light that is scattered most often is told of, if only by a first look.
            if self.cancel.requested() || given_up && (first.is_some() || matches!(part, Part::Beyond(2..))) {
                break;
            }
            if turns.is_empty() {
                // Limits well below the one that is asked for leave some of it to other effects.
                let open: Vec<usize> = all.clone().filter(|n| limits[*n].max_element() > 0.5 * most).collect();
                if look + 1 < looks && !open.is_empty() {
                    turns.push((look + 1, open));
                }
            }
        }
        self.brightest = brightest(&found);
        if beyond {
            self.carried.clone_from(&limits);
        }
        let limit = limits.iter().fold(DVec3::ZERO, |most, limit| most.max(*limit));
        let largest = limit.max_element();
        let contribution = Contribution {
            mean: first.unwrap_or_else(|| self.mean(&found)).max_element(),
            worst: found.iter().map(|found| found.mean().max_element()).fold(0.0, f64::max),
            limit: largest.is_finite().then_some(largest),
        };
        let within = most > 0.0 && !given_up && largest <= most && !self.cancel.requested();
        Ok(Verdict { contribution, limit, within })
    }

    /// Returns the mean over all pictures: of the first look, whose paths nothing has decided about.
    fn mean(&self, found: &[Tally]) -> DVec3 {
        let sum: DVec3 = self.blocks.iter().zip(found).map(|(block, found)| block.pixels() * found.mean()).sum();
        sum / f64::max(self.pixels, 1.0)
    }

    /// Lights the scene as a part asks for.
    fn light(&mut self, part: Part, shining: &Shining) -> Result<()> {
        let of = |numbers: &[usize]| numbers.iter().map(|number| self.scene.lights[*number]).collect::<Vec<_>>();
        let around = |on: bool| if on { self.scene.environment.clone() } else { Environment::default() };
        let (lights, environment, emits) = match part {
            Part::Emitted => (Vec::new(), around(false), true),
            Part::Light(number) => (of(&[number]), around(false), false),
            Part::Environment => (Vec::new(), around(true), false),
            Part::Scattered | Part::Beyond(_) => (of(&shining.lights), around(shining.environment), shining.emission),
        };
        self.tracer.relight(&lights, environment, emits)
    }

    /// Traces the paths of a look in some blocks, beyond those that were traced before.
    fn trace(&self, part: Part, open: &[usize], look: usize, found: &mut [Tally]) {
        let block = |scratch: &mut Scratch, number: &usize| {
            let mut of_block = Tally::default();
            for path in found[*number].paths()..LOOKS[look] {
                if self.cancel.requested() {
                    break;
                }
                let (value, sample) = self.path(part, &self.blocks[*number], path, scratch);
                of_block.add(value, &sample, self.cut);
            }
            of_block
        };
        let traced: Vec<Tally> = open.par_iter().with_max_len(1).map_init(Scratch::default, block).collect();
        for (number, more) in open.iter().zip(&traced) {
            found[*number].merge(more);
        }
    }

    /// Returns what a part adds to a path through a random point of a block, and the whole path.
    fn path(&self, part: Part, block: &Block, number: u32, scratch: &mut Scratch) -> (Vec3, Sample) {
        let camera = &self.cameras[block.camera];
        let seed = STREAM + (block.camera as u64) * (1 << 32) + u64::from(number);
        // Each path has a sequence of its own: those of one sequence are not independent.
        let begin = || {
            let mut sampler = Sampler::new(seed, block.place, 0);
            let [dx, dy, ..] = sampler.stratified();
            (sampler, block.at([dx, dy]))
        };
        let (mut sampler, [x, y]) = begin();
        let ray = camera.ray(x, y);
        let primary = self.tracer.primary(&ray, scratch);
        let before = scratch.counts.collisions;
        let sample = self.tracer.li(&ray, &primary, &mut sampler, scratch);
        let scattered = |sample: &Sample| sample.direct + sample.indirect;
        let value = match part {
            Part::Emitted => sample.radiance(),
            Part::Beyond(bounces) if scratch.counts.collisions - before > u64::from(bounces) => {
                let within = self.within(bounces, (&ray, &primary), begin().0, scratch);
                (scattered(&sample) - scattered(&within)).max(Vec3::ZERO)
            }
            // A path scatters no more often than it collides.
            Part::Beyond(_) => Vec3::ZERO,
            Part::Scattered | Part::Light(_) | Part::Environment => scattered(&sample),
        };
        (value, sample)
    }

    /// Returns the beginning of a path.
    fn within(&self, bounces: u32, from: (&Ray, &Primary), mut sampler: Sampler, scratch: &mut Scratch) -> Sample {
        self.tracer.li_within(Limits { max_bounces: bounces }, from, &mut sampler, scratch)
    }
}

/// Returns the numbers of the blocks of the largest means.
fn brightest(found: &[Tally]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..found.len()).collect();
    let mean = |number: &usize| found[*number].mean().max_element();
    order.sort_by(|a, b| mean(b).total_cmp(&mean(a)));
    order.truncate(PROBE);
    order
}
