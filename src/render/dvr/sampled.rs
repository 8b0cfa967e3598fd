//! Radiance by samples at steps of constant length, many samples at a time.
//!
//! The sum is that of [`Blend`](super::blend::Blend): a sample of extinction σ and color c adds `T c (1 - e^{-x})`,
//! where T is the transmittance before it, and `x = σ h` the optical depth of its step. Values alone need nothing else
//! of a sample, so that loops run over plain arrays, which compilers vectorise for each instruction set.

use super::preintegrated::shares;
use crate::real::{LANES, Lanes, Real};
use crate::render::cell::{interpolated, placed};
use crate::render::curve::Curve;
use crate::render::emission_absorption::Radiance;
use crate::render::march::{IndexRay, Span, spans};
use crate::render::quadrature::Uniform;
use crate::scene::bricks::Topology;

/// Samples that are blended together.
const ROOM: usize = 64;
/// Lanes of the widest vectors: arrays are written that many numbers at a time.
const WIDE: usize = 8;
/// The largest optical depth of a step; it is opaque, and products with it are finite.
const OPAQUE: f64 = 1e30;

/// One number a sample, with room for what is written past the last.
type Numbers<R> = [R; ROOM + WIDE];

/// Samples of a ray that are not yet blended.
#[derive(Debug, Clone)]
pub(super) struct SampleBatch<R: Real> {
    count: usize,
    /// Offsets of the samples' cells among the field's values.
    offset: [u32; ROOM + WIDE],
    /// Coordinates of the samples in their cells, each from 0 to 1.
    at: [Numbers<R>; 3],
    /// World lengths of the steps.
    length: Numbers<R>,
    /// Red, green, blue and extinction.
    optics: [Numbers<R>; 4],
    /// Shares of the light that steps absorb, `1 - e^{-x}`, and let through.
    absorbed: Numbers<R>,
    through: Numbers<R>,
}

impl<R: Real> Default for SampleBatch<R> {
    fn default() -> Self {
        let zero = [R::ZERO; ROOM + WIDE];
        Self {
            count: 0,
            offset: [0; ROOM + WIDE],
            at: [zero; 3],
            length: zero,
            optics: [zero; 4],
            absorbed: zero,
            through: zero,
        }
    }
}

/// A medium that rays sample: the bricks that they visit, the values of all bricks, and the function of these.
pub(super) struct Sampled<'a, R: Real> {
    pub topology: &'a Topology,
    pub values: &'a [R],
    pub curve: &'a Curve<R, 3>,
    /// Optical depth at which a ray ends.
    pub depth_limit: f64,
}

impl<R: Real> Sampled<'_, R> {
    /// Returns the radiance along a ray.
    #[inline(always)]
    pub(crate) fn radiance(&self, ray: &IndexRay, rule: Uniform, batch: &mut SampleBatch<R>) -> Radiance {
        let mut radiance = Radiance::default();
        batch.count = 0;
        spans(
            self.topology,
            ray,
            false,
            #[inline(always)]
            |span| {
                let mut steps = rule.on(&span);
                while steps.start < steps.end {
                    let some = (steps.end - steps.start).min((ROOM - batch.count) as u64);
                    batch.push(&span, rule, steps.start, some as usize);
                    steps.start += some;
                    if batch.count == ROOM {
                        batch.blend(self, &mut radiance);
                        if radiance.depth >= self.depth_limit {
                            return false;
                        }
                    }
                }
                true
            },
        );
        batch.blend(self, &mut radiance);
        radiance
    }
}

impl<R: Real> SampleBatch<R> {
    /// Appends the samples of `count` steps from the one of this number on.
    #[inline(always)]
    fn push(&mut self, span: &Span<R>, rule: Uniform, first: u64, count: usize) {
        let (begin, n) = (self.count, count.next_multiple_of(WIDE));
        let near = R::of(rule.step(first).0 - span.start);
        let step = R::of(rule.step);
        let [x, y, z] = &mut self.at;
        let places = x[begin..begin + n].iter_mut().zip(&mut y[begin..begin + n]).zip(&mut z[begin..begin + n]);
        let offsets = self.offset[begin..begin + n].iter_mut();
        for (i, (((x, y), z), offset)) in places.zip(offsets).enumerate() {
            let t = near + R::int(i as i32) * step;
            let [u, v, w] = [0, 1, 2].map(|a| span.entry[a] + t * span.direction[a]);
            let (cell, at) = placed([u, v, w]);
            *offset = span.base as u32 + cell;
            [*x, *y, *z] = at;
        }
        self.length[begin..begin + n].fill(step);
        self.count += count;
        let last = first + count as u64 - 1;
        if last == rule.last {
            // The last step is cut.
            let (position, length) = rule.step(last);
            let t = R::of(position - span.start);
            let (cell, at) = placed([0, 1, 2].map(|a| span.entry[a] + t * span.direction[a]));
            let i = self.count - 1;
            self.offset[i] = span.base as u32 + cell;
            self.at.iter_mut().zip(at).for_each(|(own, at)| own[i] = at);
            self.length[i] = R::of(length);
        }
    }

    /// Blends all samples behind what was blended before, and forgets them.
    #[inline(always)]
    fn blend(&mut self, ray: &Sampled<'_, R>, radiance: &mut Radiance) {
        let count = self.count.min(ROOM);
        if count == 0 {
            return;
        }
        // What is written past the last sample absorbs nothing.
        let all = count.next_multiple_of(WIDE);
        let offset = self.offset[count - 1];
        self.offset[count..all].fill(offset);
        self.length[count..all].fill(R::ZERO);
        self.look_up(ray, all);
        for i in 0..all {
            let depth = (self.optics[3][i] * self.length[i]).greater(R::ZERO).lesser(R::of(OPAQUE));
            let [through, mixed, _] = shares(depth);
            // From `1 - e^{-x}` itself nothing would be left of small x.
            (self.through[i], self.absorbed[i], self.optics[3][i]) = (through, depth * mixed, depth);
        }
        let mut transmittance = R::of((-radiance.depth).exp());
        let (mut light, mut depths) = ([R::Lanes::ZERO; 3], R::Lanes::ZERO);
        for n in (0..all).step_by(LANES) {
            let at = |v: &Numbers<R>| R::Lanes::load([v[n], v[n + 1], v[n + 2], v[n + 3]]);
            let through = at(&self.through).running_product();
            let arriving = R::Lanes::splat(transmittance) * through.after(R::ONE) * at(&self.absorbed);
            transmittance = transmittance * through.store()[LANES - 1];
            for (light, color) in light.iter_mut().zip(&self.optics) {
                *light += arriving * at(color);
            }
            depths += at(&self.optics[3]);
        }
        for (emitted, light) in radiance.rgb.iter_mut().zip(light) {
            *emitted += light.sum().f64();
        }
        radiance.depth += depths.sum().f64();
        self.count = 0;
    }

    /// Looks up colors and extinctions of the first `count` samples.
    #[inline(always)]
    fn look_up(&mut self, ray: &Sampled<'_, R>, count: usize) {
        let Sampled { values, curve, .. } = *ray;
        for n in (0..count.min(ROOM)).step_by(LANES) {
            let at = |v: &Numbers<R>| R::Lanes::load([v[n], v[n + 1], v[n + 2], v[n + 3]]);
            let offset = [0, 1, 2, 3].map(|i| self.offset[n + i]);
            let density = interpolated(values, offset, [at(&self.at[0]), at(&self.at[1]), at(&self.at[2])]);
            for (own, four) in self.optics.iter_mut().zip(curve.source_and_extinction(density)) {
                own[n..n + LANES].copy_from_slice(&four.store());
            }
        }
    }
}
