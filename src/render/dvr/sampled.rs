//! Radiance by samples at steps of constant length, many samples at a time.
//!
//! The sum is that of [`Blend`](super::blend::Blend): a sample of extinction σ and color c adds `T c (1 - e^{-x})`,
//! where T is the transmittance before it, and `x = σ h` the optical depth of its step. Values alone need nothing else
//! of a sample, so that loops run over plain arrays, which compilers vectorise for each instruction set.
//!
//! Rays go from sample to sample and look up the brick of each, eight together; the bricks that they cross are not
//! walked. Where all density is the background the steps of many bricks are one: samples of one value are those of one
//! step as long as theirs together.

use crate::math::Ray;
use crate::real::{LANES, Lanes, Real};
use crate::render::cell::interpolated;
use crate::render::curve::Curve;
use crate::render::emission_absorption::Radiance;
use crate::render::march::IndexRay;
use crate::render::quadrature::Uniform;
use crate::scene::bricks::{BRICK, Bricks, CELLS, NONE, Topology, slot};
use glam::DVec3;

/// Samples that are placed together.
const GROUP: usize = 8;
/// Samples from which on they are blended together.
const ENOUGH: usize = 32;
/// The largest number of samples that are blended together.
const ROOM: usize = ENOUGH + GROUP;
/// The largest optical depth of a step; it is opaque, and products with it are finite.
const OPAQUE: f64 = 1e30;
/// Longest way in steps that is passed at once, so that their number is a whole one.
const FARTHEST: f64 = 1e15;

/// One number a sample.
type Numbers<R> = [R; ROOM];

/// Samples of a ray that are not yet blended.
#[derive(Debug, Clone)]
pub(super) struct SampleBatch<R: Real> {
    count: usize,
    /// Lowest corners of the samples' cells along each axis, as [`Places::counted`] has them.
    cell: [[u32; ROOM]; 3],
    /// Coordinates of the samples in their cells, each from 0 to 1.
    at: [Numbers<R>; 3],
    /// World lengths of the steps.
    length: Numbers<R>,
    /// Table entries of the samples' bricks, then the bricks' numbers.
    brick: [u32; ROOM],
    /// Offsets of the samples' cells among the field's values.
    offset: [u32; ROOM],
    /// Red, green, blue and extinction.
    optics: [Numbers<R>; 4],
    /// Shares of the light that steps absorb, `1 - e^{-x}`, and let through.
    absorbed: Numbers<R>,
    through: Numbers<R>,
}

impl<R: Real> Default for SampleBatch<R> {
    fn default() -> Self {
        let (zero, none) = ([R::ZERO; ROOM], [0; ROOM]);
        Self {
            count: 0,
            cell: [none; 3],
            at: [zero; 3],
            length: zero,
            brick: none,
            offset: none,
            optics: [zero; 4],
            absorbed: zero,
            through: zero,
        }
    }
}

/// A medium that rays sample.
pub(super) struct Sampled<'a, R: Real> {
    pub field: &'a Bricks<R>,
    /// Bricks between which the density is the field's background, where nothing is absorbed unless gaps count.
    pub occupied: &'a Topology,
    pub gaps: bool,
    pub curve: &'a Curve<R, 3>,
    /// Optical depth at which a ray ends.
    pub depth_limit: f64,
}

/// Places of a ray's samples, in index coordinates.
struct Places {
    /// Place of the first sample, and what is gained from one to the next but the last, whose step is cut.
    first: [f64; 3],
    gain: [f64; 3],
    /// Number of the last sample, and the number that another at its place would have.
    last: u64,
    last_at: f64,
    /// Steps per coordinate gained; 0 along axes across the ray.
    per: [f64; 3],
    /// Lowest corners of the first and the last cell along each axis, of those that lie in the field's domain and in
    /// the table of bricks: on the domain's faces the next brick may be missing.
    cells: [[f64; 2]; 3],
    /// The bricks that hold these.
    bricks: [[f64; 2]; 3],
    /// Coordinates of the lowest corner of the table's lowest cell.
    origin: [f64; 3],
}

impl Places {
    #[inline(always)]
    fn new<R: Real>(ray: &IndexRay, rule: Uniform, field: &Bricks<R>) -> Self {
        let (bounds, domain) = (field.topology.bounds(), field.domain);
        let within = |cell: DVec3| cell.min(bounds.max - 1.0).max(bounds.min);
        let (first, last) = (within(domain.min.floor()), within(domain.max.ceil() - 1.0));
        let gain = ray.direction().to_array().map(|d| rule.step * d);
        Self {
            first: ray.at(rule.step(0).0).to_array(),
            gain,
            last: rule.last,
            last_at: (rule.step(rule.last).0 - rule.step(0).0) / rule.step,
            per: gain.map(|g| if g == 0.0 { 0.0 } else { 1.0 / g }),
            cells: [0, 1, 2].map(|a| [first[a], last[a]]),
            bricks: [0, 1, 2].map(|a| [first[a], last[a]].map(|cell| (cell / CELLS as f64).floor())),
            origin: bounds.min.to_array(),
        }
    }

    /// Returns the lowest corner of a cell, counted from the table's lowest cell on.
    #[inline(always)]
    fn counted(&self, axis: usize, low: f64) -> u32 {
        // A whole number then stands in the low bits.
        (low - self.origin[axis] + f64::ONES).to_bits() as u32
    }

    /// Returns the coordinates of the brick that a sample lies in.
    #[inline(always)]
    fn brick(&self, sample: u64) -> [f64; 3] {
        let number = if sample == self.last { self.last_at } else { sample as f64 };
        let along = |a: usize| below((self.first[a] + number * self.gain[a]) / CELLS as f64, self.bricks[a]);
        // No `map`: it is not always inlined.
        [along(0), along(1), along(2)]
    }

    /// Returns the lowest corner of a brick's lowest cell, counted as [`Places::counted`] does.
    #[inline(always)]
    fn corner(&self, brick: [f64; 3]) -> [u32; 3] {
        let along = |a: usize| self.counted(a, CELLS as f64 * brick[a]);
        [along(0), along(1), along(2)]
    }

    /// Returns the number of the first sample that lies outside of the bricks within a distance, in bricks, of the one
    /// that the ray is in; at most [`FARTHEST`].
    #[inline(always)]
    fn first_outside(&self, brick: [f64; 3], distance: i32) -> u64 {
        let leave = |a: usize| {
            let (ahead, way) = if self.gain[a] > 0.0 { (1.0, 1.0) } else { (0.0, -1.0) };
            let plane = CELLS as f64 * (brick[a] + ahead + way * f64::from(distance));
            if self.per[a] == 0.0 { FARTHEST } else { (plane - self.first[a]) * self.per[a] }
        };
        leave(0).lesser(leave(1)).lesser(leave(2)).greater(0.0).lesser(FARTHEST) as u64 + 1
    }
}

/// Returns the greatest whole number up to a coordinate, within a range; of a whole number it may be the one before.
#[inline(always)]
fn below(coordinate: f64, [first, last]: [f64; 2]) -> f64 {
    // Adding rounds to the nearest whole number: down, half of one lower.
    ((coordinate - 0.5 + f64::ONES) - f64::ONES).greater(first).lesser(last)
}

impl<R: Real> Sampled<'_, R> {
    /// Returns the radiance along a ray.
    #[inline(always)]
    pub(crate) fn radiance(&self, ray: &IndexRay, rule: Uniform, batch: &mut SampleBatch<R>) -> Radiance {
        let mut radiance = Radiance::default();
        let topology = &*self.field.topology;
        let reach = if self.gaps { topology.reach() } else { self.occupied.reach() };
        let Some((enter, leave)) = reach.clip(&Ray::new(ray.at(0.0), ray.direction())) else {
            return radiance;
        };
        let places = Places::new(ray, rule, self.field);
        let end = rule.before(leave);
        let mut k = rule.before(enter);
        batch.count = 0;
        while k < end {
            while k < end && batch.count < ENOUGH {
                let brick = places.brick(k);
                let corner = places.corner(brick);
                let entry = topology.entry_of([corner[0] >> 3, corner[1] >> 3, corner[2] >> 3]);
                let Some(distance) = self.occupied.clearance_at(entry) else {
                    let next = (k + GROUP as u64).min(end);
                    batch.push(&places, rule, k, (next - k) as usize);
                    k = next;
                    continue;
                };
                let next = places.first_outside(brick, distance).min(end).max(k + 1);
                if self.gaps {
                    // Every value of the brick is the background.
                    batch.push_one(corner, R::of(rule.length(k..next)));
                }
                k = next;
            }
            batch.blend(self, &mut radiance);
            if radiance.depth >= self.depth_limit {
                break;
            }
        }
        radiance
    }
}

impl<R: Real> SampleBatch<R> {
    /// Appends samples, up to a group, from the one of this number on.
    #[inline(always)]
    fn push(&mut self, places: &Places, rule: Uniform, sample: u64, count: usize) {
        let n = self.count.min(ENOUGH);
        let mut numbers: [f64; GROUP] = std::array::from_fn(|i| sample as f64 + i as f64);
        self.length[n..n + GROUP].fill(R::of(rule.step));
        if sample + GROUP as u64 > rule.last {
            let last = (rule.last - sample) as usize % GROUP;
            (numbers[last], self.length[n + last]) = (places.last_at, R::of(rule.step(rule.last).1));
        }
        for (a, (cell, at)) in self.cell.iter_mut().zip(&mut self.at).enumerate() {
            let (first, gain, cells) = (places.first[a], places.gain[a], places.cells[a]);
            for ((cell, at), number) in cell[n..n + GROUP].iter_mut().zip(&mut at[n..n + GROUP]).zip(numbers) {
                let place = first + number * gain;
                let low = below(place, cells);
                *at = R::of(place - low);
                *cell = places.counted(a, low);
            }
        }
        self.count = n + count;
    }

    /// Appends one sample, at the lowest corner of a cell.
    #[inline(always)]
    fn push_one(&mut self, cell: [u32; 3], length: R) {
        let n = self.count.min(ENOUGH);
        for a in 0..3 {
            (self.cell[a][n], self.at[a][n]) = (cell[a], R::ZERO);
        }
        self.length[n] = length;
        self.count = n + 1;
    }

    /// Blends all samples behind what was blended before, and forgets them.
    #[inline(always)]
    fn blend(&mut self, medium: &Sampled<'_, R>, radiance: &mut Radiance) {
        let count = self.count.min(ROOM);
        // What stands past the last sample absorbs nothing.
        let all = count.next_multiple_of(GROUP).min(ROOM);
        for cell in &mut self.cell {
            cell[count..all].fill(0);
        }
        self.length[count..all].fill(R::ZERO);
        self.find(&medium.field.topology, all);
        self.look_up(medium, all);
        for i in 0..all {
            let depth = (self.optics[3][i] * self.length[i]).greater(R::ZERO).lesser(R::of(OPAQUE));
            [self.through[i], self.absorbed[i]] = depth.through_and_absorbed();
            self.optics[3][i] = depth;
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

    /// Finds the offsets of the first `count` samples' cells. Where there is no brick nothing is absorbed.
    #[inline(always)]
    fn find(&mut self, topology: &Topology, count: usize) {
        let [x, y, z] = &self.cell;
        for i in 0..count {
            // The brick and the cell in it, of eight along each axis.
            self.brick[i] = topology.entry_of([x[i] >> 3, y[i] >> 3, z[i] >> 3]);
            let [x, y, z] = [x[i] & 7, y[i] & 7, z[i] & 7];
            self.offset[i] = slot(1, 0, 0) as u32 * x + slot(0, 1, 0) as u32 * y + z;
        }
        let table = topology.table();
        for brick in &mut self.brick[..count] {
            *brick = table[*brick as usize];
        }
        let mut missing = 0;
        for (offset, brick) in self.offset[..count].iter_mut().zip(&self.brick) {
            *offset = brick.wrapping_mul(BRICK as u32).wrapping_add(*offset);
            missing |= u32::from(*brick == NONE);
        }
        if missing > 0 {
            for i in (0..count).filter(|i| self.brick[*i] == NONE) {
                (self.offset[i], self.length[i]) = (0, R::ZERO);
            }
        }
    }

    /// Looks up colors and extinctions of the first `count` samples.
    #[inline(always)]
    fn look_up(&mut self, medium: &Sampled<'_, R>, count: usize) {
        for n in (0..count.min(ROOM)).step_by(LANES) {
            let at = |v: &Numbers<R>| R::Lanes::load([v[n], v[n + 1], v[n + 2], v[n + 3]]);
            let offset = [0, 1, 2, 3].map(|i| self.offset[n + i]);
            let at = [at(&self.at[0]), at(&self.at[1]), at(&self.at[2])];
            let density = interpolated(&medium.field.values, offset, at);
            for (own, four) in self.optics.iter_mut().zip(medium.curve.source_and_extinction(density)) {
                own[n..n + LANES].copy_from_slice(&four.store());
            }
        }
    }
}
