//! Light through a pre-shaded volume: emission and extinction are fields of their own.
//!
//! `L = ∫ T e dt + T(end) · background` with e the radiance emitted per world length and `T = exp(-∫ σ)`; both
//! are trilinear. (Interpolating e, not the colour `e / σ`, is what associated colours are to pictures:
//! Wittenbrink, Malzbender & Goss 1998.) e is linear in the voxels, and so is the picture, as long as σ stays.
//!
//! Each cell has two Gauss points, which are exact for its optical depth x. At them the transmittance follows
//! from an extinction that is linear in between (the Gauss collocation of order 4; Hairer, Nørsett & Wanner
//! 1993, sect. II.7): a constant source errs by x⁴/4320 of itself, one that is as rough as voxels can be by up
//! to 2e-4, less than half a step of half-precision pictures. Cells that are thicker are cut.

use crate::lanes::{LANES, Lanes};
use crate::math::Ray;
use crate::real::Real;
use crate::render::arch::Arch;
use crate::render::cell::{CORNERS, REACH, weights};
use crate::render::dvr::Radiance;
use crate::render::march::{IndexRay, batches};
use crate::render::rule::{Cell, cells};
use crate::scene::bricks::Bricks;

/// Optical depth above which a cell is cut.
const THICK: f64 = 0.5;
/// The most parts of a cell. Behind the first 25 of them no light arrives.
const MOST_PARTS: f64 = 64.0;
/// Points on 0..1.
const POINTS: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
/// Row k: weights of the extinctions at the points in the optical depth up to point k.
const UP_TO: [[f64; 2]; 2] = [[0.25, -0.038_675_134_594_812_88], [0.538_675_134_594_812_9, 0.25]];

/// A stretch of a ray in one cell, with its two points.
#[derive(Debug, Clone, Copy)]
struct Stretch<R: Real> {
    /// Offset of the cell's lowest corner.
    offset: usize,
    /// Interpolation weights of the corners at the points.
    weights: [[R::Lanes; 2]; 2],
    /// Emission in R, G and B, and extinction, at the points.
    values: [R::Lanes; 2],
    /// Half its world length.
    half: R,
    /// What the emissions contribute: transmittance from the eye times half the world length.
    shares: [R; 2],
}

/// What a linear picture is made of: weights of the emissions at a cell's corners.
#[derive(Debug, Clone, Copy)]
struct Footprint<R: Real> {
    offset: usize,
    weights: [R::Lanes; 2],
}

/// Scratch memory of one thread: what the emissions contributed to the rays traced.
#[derive(Debug, Clone, Default)]
pub struct Tape<R: Real>(Vec<Footprint<R>>);

impl<R: Real> Tape<R> {
    /// Adds the derivative of `Σ g_c L_c` of the rays on the tape with respect to the stored emissions to
    /// `gradient`, and forgets the rays. The last lane, that of extinctions, gets nothing.
    #[inline(always)]
    pub fn spread(&mut self, by: [R; 3], gradient: &mut [R::Lanes]) {
        let by = R::Lanes::load([by[0], by[1], by[2], R::ZERO]);
        for footprint in &self.0 {
            scatter::<R>(gradient, footprint.offset, &footprint.weights, by);
        }
        self.0.clear();
    }

    /// Forgets the rays.
    pub fn forget(&mut self) {
        self.0.clear();
    }
}

/// `gradient += weights · by`.
#[inline(always)]
fn scatter<R: Real>(gradient: &mut [R::Lanes], offset: usize, weights: &[R::Lanes; 2], by: R::Lanes) {
    let v = &mut gradient[offset..offset + REACH];
    for (corners, w) in CORNERS.iter().zip(weights) {
        for (corner, w) in corners.iter().zip(w.store()) {
            v[*corner] += R::Lanes::splat(w) * by;
        }
    }
}

impl<R: Real> Stretch<R> {
    #[inline(always)]
    fn new(values: &[R::Lanes], cell: &Cell<R>, from: R, length: R) -> Self {
        let (offset, places) = cell.places(POINTS.map(|u| from + R::of(u) * length));
        let w = places.map(weights);
        let v = &values[offset..offset + REACH];
        let mut own = [R::Lanes::default(); 2];
        for (x, corners) in CORNERS.iter().enumerate() {
            let (near, far) = (w[0][x].store(), w[1][x].store());
            for (k, corner) in corners.iter().enumerate() {
                let value = v[*corner];
                own = [own[0] + R::Lanes::splat(near[k]) * value, own[1] + R::Lanes::splat(far[k]) * value];
            }
        }
        Self { offset, weights: w, values: own, half: R::of(0.5) * length, shares: [R::ZERO; 2] }
    }

    #[inline(always)]
    fn extinctions(&self) -> [R; 2] {
        self.values.map(|v| v.store()[3])
    }

    #[inline(always)]
    fn depth(&self) -> R {
        let [first, second] = self.extinctions();
        self.half * (first + second)
    }

    /// Optical depths up to the points.
    #[inline(always)]
    fn depths(&self) -> [R; 2] {
        let length = self.half + self.half;
        let s = self.extinctions();
        UP_TO.map(|w| length * (R::of(w[0]) * s[0] + R::of(w[1]) * s[1]))
    }

    #[inline(always)]
    fn footprint(&self) -> Footprint<R> {
        let shares = self.shares.map(R::Lanes::splat);
        let corner = |x: usize| shares[0] * self.weights[0][x] + shares[1] * self.weights[1][x];
        Footprint { offset: self.offset, weights: [corner(0), corner(1)] }
    }
}

/// Renderer of a pre-shaded volume in precision `R`.
#[derive(Debug, Clone)]
pub struct Preshaded<'a, R: Real> {
    field: &'a Bricks<R::Lanes>,
    background: [f32; 3],
    depth_limit: f64,
}

/// What is gathered along a ray.
struct Front<R: Real> {
    light: R::Lanes,
    open: R,
    depth: f64,
}

impl<'a, R: Real> Preshaded<'a, R> {
    /// A renderer with rays that end where no more than 1e-6 of the light behind could reach the eye.
    pub fn new(field: &'a Bricks<R::Lanes>, background: [f32; 3]) -> Self {
        Self { field, background, depth_limit: 1e6_f64.ln() }
    }

    /// Radiance along a world ray of unit direction; the ray is added to those on the tape.
    #[inline(always)]
    pub fn trace(&self, ray: &Ray, tape: &mut Tape<R>) -> Radiance<R> {
        self.walk(
            ray,
            #[inline(always)]
            |stretch| tape.0.push(stretch.footprint()),
        )
    }

    /// Visits the stretches of a ray.
    #[inline(always)]
    fn walk(&self, ray: &Ray, mut visit: impl FnMut(&Stretch<R>)) -> Radiance<R> {
        let mut emitted = [0.0; 3];
        let mut front = Front { light: R::Lanes::default(), open: R::ONE, depth: 0.0 };
        let values = &self.field.values;
        if let Some(ray) = IndexRay::new(&self.field.domain, &self.field.transform, ray) {
            batches(
                &self.field.topology,
                &ray,
                #[inline(always)]
                |spans| {
                    front.open = R::of((-front.depth).exp());
                    front.light = R::Lanes::default();
                    cells(
                        spans,
                        #[inline(always)]
                        |four: [Cell<R>; LANES], from: R::Lanes, until: R::Lanes| {
                            let (from, length) = (from.store(), (until - from).store());
                            for i in (0..LANES).filter(|i| length[*i] > R::ZERO) {
                                let mut stretch = Stretch::new(values, &four[i], from[i], length[i]);
                                let depth = stretch.depth();
                                let parts = if depth > R::of(THICK) {
                                    (depth.f64() / THICK).ceil().min(MOST_PARTS)
                                } else {
                                    1.0
                                };
                                let part = length[i] / R::of(parts);
                                for k in 0..parts as i32 {
                                    if parts > 1.0 {
                                        stretch = Stretch::new(values, &four[i], from[i] + R::int(k) * part, part);
                                    }
                                    front.pass(&mut stretch);
                                    visit(&stretch);
                                }
                            }
                        },
                    );
                    emitted.iter_mut().zip(front.light.store()).for_each(|(e, l)| *e += l.f64());
                    front.depth < self.depth_limit
                },
            );
        }
        let transmittance = (-front.depth).exp();
        let channel = |c: usize| R::of(emitted[c] + f64::from(self.background[c]) * transmittance);
        Radiance { rgb: [channel(0), channel(1), channel(2)], transmittance: R::of(transmittance), depth: front.depth }
    }

    /// Radiance along a world ray, and the gradient of a loss on it by all four stored values: `loss` maps the
    /// radiance to the derivative with respect to R, G, B and alpha.
    ///
    /// Let `G_k = -share_k g·e_k` be the derivative by the optical depth up to point k, and B the sum of those
    /// beyond a stretch, `-T (g·background - g_α)` of its end included: an extinction in the stretch has B by
    /// the stretch's whole depth, and both G_k by the depths up to its points.
    pub fn gradient(
        &self,
        ray: &Ray,
        loss: impl FnOnce(&Radiance<R>) -> [R; 4],
        gradient: &mut [R::Lanes],
    ) -> Radiance<R> {
        let mut stretches = Vec::new();
        let seen = self.walk(ray, |stretch| stretches.push(*stretch));
        let [r, g, b, alpha] = loss(&seen);
        let by = R::Lanes::load([r, g, b, R::ZERO]);
        let behind: f64 = (0..3).map(|c| by.store()[c].f64() * f64::from(self.background[c])).sum();
        let mut beyond = (alpha.f64() - behind) * (-seen.depth).exp();
        for stretch in stretches.iter().rev() {
            let own = [0, 1].map(|k| -stretch.shares[k].f64() * (by * stretch.values[k]).sum().f64());
            let (half, length) = (stretch.half.f64(), 2.0 * stretch.half.f64());
            for (k, weights) in stretch.weights.iter().enumerate() {
                let up_to = UP_TO[0][k] * own[0] + UP_TO[1][k] * own[1];
                let by_extinction = R::of(half * beyond + length * up_to);
                let lit = by * R::Lanes::splat(stretch.shares[k]);
                let by = lit + R::Lanes::load([R::ZERO, R::ZERO, R::ZERO, by_extinction]);
                scatter::<R>(gradient, stretch.offset, weights, by);
            }
            beyond += own[0] + own[1];
        }
        seen
    }
}

impl<R: Real> Front<R> {
    #[inline(always)]
    fn pass(&mut self, stretch: &mut Stretch<R>) {
        let ([first, second], depth) = (stretch.depths(), stretch.depth());
        let open = R::Lanes::splat(self.open) * R::Lanes::load([-first, -second, -depth, R::ZERO]).exp();
        let [first, second, beyond, _] = open.store();
        stretch.shares = [first * stretch.half, second * stretch.half];
        for (share, value) in stretch.shares.iter().zip(stretch.values) {
            self.light += R::Lanes::splat(*share) * value;
        }
        self.open = beyond;
        self.depth += depth.f64();
    }
}

impl Preshaded<'_, f32> {
    /// Radiance along a world ray of unit direction.
    pub fn radiance_on(&self, ray: &Ray, tape: &mut Tape<f32>) -> Radiance<f32> {
        tape.forget();
        Arch::default().dispatch(Value { renderer: self, ray, tape })
    }
}

/// The unit that is compiled for each instruction set.
struct Value<'a, 'd> {
    renderer: &'a Preshaded<'d, f32>,
    ray: &'a Ray,
    tape: &'a mut Tape<f32>,
}

impl pulp::NullaryFnOnce for Value<'_, '_> {
    type Output = Radiance<f32>;

    #[inline(always)]
    fn call(self) -> Radiance<f32> {
        self.renderer.trace(self.ray, self.tape)
    }
}
