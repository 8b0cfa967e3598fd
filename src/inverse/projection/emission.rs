//! Colors as equations of the emissions of a pre-shaded volume whose extinctions are known: one row a
//! pixel and channel, `L - T · background = ∫ T e dt`.
//!
//! The three channels see the same transmittance, and one walk along a ray serves them all. Rays are dealt
//! to a fixed number of partitions, as those of [`projector`](crate::inverse::projection::projector).

use crate::arch::Arch;
use crate::cancel::Cancel;
use crate::differentiate::gradient::partition::{bricks_crossed, partitions};
use crate::inverse::observation::depth_map::stride_within;
use crate::inverse::observation::photo::Photo;
use crate::inverse::projection::projector::{add_partitions, in_all};
use crate::inverse::solver::conjugate::Equations;
use crate::render::composited::Composited;
use crate::render::order::morton;
use crate::render::preshaded::{Preshaded, Tape};
use crate::render::tiles;
use crate::scene::bricks::{Bricks, CELLS};
use crate::scene::camera::Camera;
use glam::Vec4;
use rayon::prelude::*;

/// Color channels.
const CHANNELS: usize = 3;
/// Pixels handled in one go.
const RUN: usize = 1024;

/// A pixel that shows something.
#[derive(Debug, Clone, Copy)]
struct Pixel {
    /// Image position of its centre, in pixels.
    position: [f32; 2],
    color: [f32; 3],
}

/// Pixels of a picture that are finite and show something, neighbours together.
#[derive(Debug, Clone)]
pub(crate) struct ColorView {
    camera: Camera,
    pixels: Vec<Pixel>,
    /// Number of all pixels of the picture.
    count: usize,
}

impl ColorView {
    /// Reduces a picture to means over blocks of `stride`² pixels; `shown` tells which pixels show something.
    pub(crate) fn new(photo: &Photo, stride: usize, shown: &[bool]) -> Self {
        let (w, h) = (photo.film.width, photo.film.height);
        let stride = stride_within(stride, w, h);
        let (width, height) = (w.div_ceil(stride), h.div_ceil(stride));
        let mut camera = photo.camera;
        camera.focal /= stride as f64;
        camera.centre /= stride as f64;
        (camera.width, camera.height) = (width as u32, height as u32);
        let block = |i: usize| {
            let (x, y) = (i % width * stride, i / width * stride);
            let all = (y..(y + stride).min(h)).flat_map(|v| (x..(x + stride).min(w)).map(move |u| v * w + u));
            let (mut sum, mut count, mut any) = (Vec4::ZERO, 0.0, false);
            for i in all {
                let pixel = Vec4::from_array(photo.film.rgba[i]);
                if pixel.is_finite() {
                    sum += pixel;
                    count += 1.0;
                    any |= shown[i];
                }
            }
            let [r, g, b, _] = (sum / count).to_array();
            let position = [i % width, i / width].map(|v| v as f32 + 0.5);
            any.then_some(Pixel { position, color: [r, g, b] })
        };
        let pixels = morton(width, height).filter_map(block).collect();
        Self { camera, pixels, count: width * height }
    }
}

/// The pixels of some views, and what is behind the extinctions that are known.
#[derive(Debug)]
pub(crate) struct Emission<'a> {
    views: &'a [ColorView],
    background: [f32; 3],
    /// Offsets in pixels of the rays whose mean a pixel is.
    offsets: Vec<[f64; 2]>,
    /// The volume at hand; its last partition stays.
    field: Bricks<Vec4>,
    extinctions: Vec<f32>,
    /// The volume's own voxels, 512 a brick.
    owned: Vec<Vec4>,
    /// Accumulator of each partition, 729 values a brick.
    partitions: Vec<Vec<Vec4>>,
    /// Polled between runs of pixels; the results of a pass that it stopped are incomplete.
    pub cancel: Cancel,
}

impl<'a> Emission<'a> {
    /// The equations of `views` for a volume on the bricks of `extinctions`. A pixel is the mean over
    /// `rays_per_edge`² rays.
    pub(crate) fn new(
        views: &'a [ColorView],
        extinctions: &Bricks<f32>,
        background: [f32; 3],
        rays_per_edge: usize,
    ) -> Self {
        let topology = extinctions.topology.clone();
        let field = Bricks::<Vec4>::zeros(topology.clone(), extinctions.transform);
        let count = partitions(
            &field,
            CELLS as f64 * bricks_crossed(&field, views.iter().map(|v| v.pixels.len()).sum()),
            false,
        );
        let n = rays_per_edge.max(1);
        let offset = |i: usize| (i as f64 + 0.5) / n as f64 - 0.5;
        let extinctions = extinctions.owned();
        Self {
            views,
            background,
            offsets: (0..n * n).map(|i| [offset(i % n), offset(i / n)]).collect(),
            owned: vec![Vec4::ZERO; extinctions.len()],
            extinctions,
            partitions: vec![vec![Vec4::ZERO; field.values.len()]; count],
            field,
            cancel: Cancel::NEVER,
        }
    }

    /// Mean squared error of the colors over all pixels of the given views.
    pub(crate) fn error(&mut self, x: &[f32], views: &[ColorView]) -> f64 {
        let square = |p: &Pixel, rendered: [f64; 3]| {
            let square = (0..3).map(|c| (f64::from(p.color[c]) - rendered[c]).powi(2)).sum();
            ([0.0; 3], [square, 0.0])
        };
        let [sum, _] = self.walk(x, views, self.background, false, square);
        sum / (CHANNELS * views.iter().map(|v| v.count).sum::<usize>()).max(1) as f64
    }

    /// The volume with emissions `x`.
    pub(crate) fn volume(mut self, x: &[f32]) -> Bricks<Vec4> {
        self.fill(x);
        self.field
    }

    fn fill(&mut self, x: &[f32]) {
        let n = self.extinctions.len();
        let (x, extinctions) = (&x, &self.extinctions);
        self.owned
            .par_iter_mut()
            .enumerate()
            .for_each(|(i, v)| *v = Vec4::new(x[i], x[n + i], x[2 * n + i], extinctions[i]));
        self.field.topology.fill_apron(&self.owned, &mut self.field.values);
    }

    /// Walks the rays of every pixel of the given views once. `cotangent(pixel, rendered color)` gives the derivatives
    /// that are propagated back, and two terms to be summed.
    fn walk(
        &mut self,
        x: &[f32],
        views: &[ColorView],
        background: [f32; 3],
        with_gradient: bool,
        cotangent: impl Fn(&Pixel, [f64; 3]) -> ([f32; 3], [f64; 2]) + Sync,
    ) -> [f64; 2] {
        self.fill(x);
        let renderer = Preshaded::new(&self.field).over(background);
        let runs: Vec<(&Camera, &[Pixel])> =
            views.iter().flat_map(|v| v.pixels.chunks(RUN).map(|p| (&v.camera, p))).collect();
        let (count, offsets, arch, cancel) =
            (self.partitions.len(), &self.offsets, Arch::default(), self.cancel.clone());
        let sums = tiles::own_partitions(
            &mut self.partitions,
            &cancel,
            |number| tiles::dealt(&runs, number, count),
            |gradient| {
                if with_gradient {
                    gradient.fill(Vec4::ZERO);
                }
                ([0.0; 2], Tape::default())
            },
            |gradient, (sums, tape), (camera, pixels)| {
                let (renderer, cotangent) = (&renderer, &cotangent);
                let gradient = with_gradient.then_some(&mut gradient[..]);
                let add = arch.dispatch(Run { renderer, camera, pixels, offsets, cotangent, tape, gradient });
                *sums = [sums[0] + add[0], sums[1] + add[1]];
            },
        );
        in_all(sums.into_iter().map(|(sums, _)| sums).collect(), count)
    }

    /// The sum of all partitions by unknown.
    fn collect(&mut self, out: &mut [f32]) {
        add_partitions(&mut self.partitions);
        self.field.topology.gather_apron(&self.partitions[0], &mut self.owned);
        let n = self.owned.len();
        for (c, out) in out.chunks_mut(n).enumerate() {
            out.par_iter_mut().zip(&self.owned).for_each(|(o, v)| *o = v[c]);
        }
    }
}

impl Equations for &mut Emission<'_> {
    fn cancelled(&self) -> bool {
        self.cancel.requested()
    }

    fn rows(&self) -> usize {
        CHANNELS * self.views.iter().map(|v| v.pixels.len()).sum::<usize>()
    }

    fn normal(&mut self, x: &[f32], out: &mut [f32]) -> f64 {
        let square =
            |_: &Pixel, rendered: [f64; 3]| (rendered.map(|v| v as f32), [rendered.iter().map(|v| v * v).sum(), 0.0]);
        let [curvature, _] = self.walk(x, self.views, [0.0; 3], true, square);
        self.collect(out);
        curvature
    }

    fn residual(&mut self, x: &[f32], bound: f64, out: &mut [f32]) -> [f64; 2] {
        let residual = |p: &Pixel, rendered: [f64; 3]| {
            let residual: [f64; 3] = std::array::from_fn(|c| f64::from(p.color[c]) - rendered[c]);
            let bounded = residual.map(|m| m.clamp(-bound, bound));
            let square = (0..3).map(|c| bounded[c] * residual[c]).sum();
            (bounded.map(|v| v as f32), [bounded.iter().map(|v| v.abs()).sum(), square])
        };
        let sums = self.walk(x, self.views, self.background, true, residual);
        self.collect(out);
        sums
    }
}

/// Neighbouring pixels of one view: the unit that is compiled once for each instruction set.
struct Run<'a, 'd, F> {
    renderer: &'a Composited<Preshaded<'d, f32>>,
    camera: &'a Camera,
    pixels: &'a [Pixel],
    offsets: &'a [[f64; 2]],
    cotangent: &'a F,
    tape: &'a mut Tape<f32>,
    /// Accumulator of the derivatives, if they are requested.
    gradient: Option<&'a mut [Vec4]>,
}

impl<F: Fn(&Pixel, [f64; 3]) -> ([f32; 3], [f64; 2])> pulp::NullaryFnOnce for Run<'_, '_, F> {
    type Output = [f64; 2];

    #[inline(always)]
    fn call(mut self) -> [f64; 2] {
        let share = 1.0 / self.offsets.len() as f64;
        let mut sums = [0.0; 2];
        for pixel in self.pixels {
            let [x, y] = pixel.position.map(f64::from);
            let mut rendered = [0.0; 3];
            self.tape.forget();
            for [u, v] in self.offsets {
                let radiance = self.renderer.medium.trace(&self.camera.ray(x + u, y + v), self.tape);
                let composited = self.renderer.composite(&radiance);
                rendered.iter_mut().zip(composited.rgb).for_each(|(s, l)| *s += share * f64::from(l));
            }
            let (color_cotangent, add) = (self.cotangent)(pixel, rendered);
            sums = [sums[0] + add[0], sums[1] + add[1]];
            if let Some(gradient) = &mut self.gradient {
                self.tape.accumulate(color_cotangent.map(|g| share as f32 * g), gradient);
            }
        }
        sums
    }
}
