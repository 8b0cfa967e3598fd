//! The linear operator of absorption: voxels to optical depths of all measured rays, and its
//! transpose.
//!
//! Rays are dealt to a fixed number of partitions, each with its own accumulator, and the partitions are added
//! in order: the result has the same bits for any number of threads.

use crate::arch::Arch;
use crate::cancel::Cancel;
use crate::differentiate::gradient::partition::partitions;
use crate::inverse::observation::depth_map::DepthMap;
use crate::math::Affine;
use crate::ranks;
use crate::render::dvr::{Dvr, Tape};
use crate::render::order::morton;
use crate::render::tiles;
use crate::scene::bricks::{BRICK, Bricks, Topology};
use crate::scene::camera::Camera;
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::medium::Medium;
use crate::scene::topology::Voxel;
use std::sync::Arc;

/// One measured pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Number of the pixel, row by row.
    pub pixel: u32,
    /// Measured transmittance.
    pub transmittance: f32,
    /// Measured optical depth.
    pub depth: f32,
    /// Weight of its squared residual.
    pub weight: f32,
}

/// The measured pixels of one picture, in an order in which neighbours are close in the image.
#[derive(Debug, Clone)]
pub struct View {
    /// Camera of the view.
    pub camera: Camera,
    /// Pixels whose rays cross unknowns.
    pub samples: Vec<Sample>,
    /// Pixels that show nothing whatever the unknowns are, but have measured something.
    pub idle: Vec<Sample>,
    /// Standard deviation of the noise in a pixel's transmittance.
    pub noise: f64,
}

impl View {
    /// Number of pixels that have measured something.
    pub fn measured(&self) -> usize {
        self.samples.len() + self.idle.len()
    }
}

/// Pixels handled in one go.
pub(crate) const RUN: usize = 1024;

/// The operator on a fixed topology.
#[derive(Debug)]
pub struct Projector {
    topology: Arc<Topology>,
    medium: Medium,
    /// Offsets in pixels of the rays whose mean a pixel is.
    offsets: Vec<[f64; 2]>,
    /// Accumulator of each partition, 729 values a brick.
    partitions: Vec<Vec<f32>>,
    /// The field at hand, with its aprons.
    field: Bricks<f32>,
    /// Polled between pixels; the results of a pass that it stopped are incomplete.
    pub cancel: Cancel,
}

impl Projector {
    /// Prepares accumulators. `extinction` is per unit of density and world length; a pixel is the
    /// mean over `rays_per_edge`² rays.
    pub fn new(topology: Arc<Topology>, transform: Affine, extinction: f64, rays_per_edge: usize) -> Self {
        let field = Bricks::zeros(topology.clone(), transform);
        let partitions = partitions(&field, f64::INFINITY, false);
        let n = rays_per_edge.max(1);
        let offset = |i: usize| (i as f64 + 0.5) / n as f64 - 0.5;
        Self {
            medium: Medium::absorbing(extinction),
            offsets: (0..n * n).map(|i| [offset(i % n), offset(i / n)]).collect(),
            partitions: vec![vec![0.0; field.values.len()]; partitions],
            topology,
            field,
            cancel: Cancel::NEVER,
        }
    }

    /// Number of partitions that rays are dealt to.
    pub fn partitions(&self) -> usize {
        self.partitions.len()
    }

    /// Unknowns: 512 a brick.
    pub fn unknowns(&self) -> usize {
        self.topology.len() * LEAF_VOXELS
    }

    /// Returns the pixels that have weight of maps reduced by `stride`, with those put aside whose rays cross no cell
    /// of an unknown (`true`, 512 a brick): their rows of the operator are zero.
    pub fn views(&mut self, maps: &[&DepthMap], stride: usize, unknown: &[bool]) -> Vec<View> {
        let ones: Vec<f32> = unknown.iter().map(|u| f32::from(u8::from(*u))).collect();
        self.topology.fill_apron(&ones, &mut self.field.values);
        let Ok(dvr) = Dvr::new(&self.field, self.medium.clone()) else { return Vec::new() };
        let dvr = dvr.early_stop(0.0);
        let (arch, cancel) = (Arch::default(), self.cancel.clone());
        // Vectors that grow leave holes in memory, in all views together as much as what is kept: these grow once.
        type Scratch = (Tape<f32>, Vec<f64>, [Vec<Sample>; 2]);
        let view = |(tape, depths, [samples, idle]): &mut Scratch, map: &&DepthMap| {
            let map = map.reduced(map.stride_within(stride));
            let measured = map.depths();
            let sample = |i: usize| {
                let (transmittance, depth, weight) = (map.transmittance[i], measured.depth[i], measured.weight[i]);
                Sample { pixel: i as u32, transmittance, depth, weight }
            };
            samples.clear();
            idle.clear();
            for sample in morton(map.width, map.height).map(sample).filter(|sample| sample.weight > 0.0) {
                if cancel.requested() {
                    break;
                }
                let [crossed, _] = arch.dispatch(Run {
                    dvr: &dvr,
                    camera: &map.camera,
                    samples: std::slice::from_ref(&sample),
                    offsets: &self.offsets,
                    cotangent: &|_: &Sample, z: &[f64]| (0.0, [z.iter().sum(), 0.0]),
                    tape,
                    depths,
                    gradient: None,
                });
                if crossed > 0.0 {
                    samples.push(sample);
                } else if sample.depth != 0.0 {
                    idle.push(sample);
                }
            }
            View { camera: map.camera, samples: samples.clone(), idle: idle.clone(), noise: map.noise }
        };
        let scratch = || (Tape::default(), vec![0.0; self.offsets.len()], Default::default());
        tiles::map(maps, &Cancel::NEVER, scratch, view).unwrap_or_default()
    }

    /// Walks the rays of every pixel of the given views once, but for the idle ones. `cotangent(sample, depths)` maps
    /// the optical depths along a pixel's rays to the derivative with respect to their mean that is propagated back,
    /// and to two terms to be summed; `Aᵀ cotangent` goes to `out`.
    pub fn normal(
        &mut self,
        voxels: &[f32],
        views: &[View],
        out: &mut [f32],
        cotangent: impl Fn(&Sample, &[f64]) -> (f64, [f64; 2]) + Sync,
    ) -> [f64; 2] {
        let sums = self.walk(voxels, views, cotangent, true);
        if self.cancel.requested() {
            return sums;
        }
        add_partitions(&mut self.partitions);
        self.topology.gather_apron(&self.partitions[0], out);
        sums
    }

    /// The sum alone, idle pixels included: no gradient.
    pub fn measure(&mut self, voxels: &[f32], views: &[View], value: impl Fn(&Sample, &[f64]) -> f64 + Sync) -> f64 {
        let nothing = vec![0.0; self.offsets.len()];
        let idle: f64 = views.iter().flat_map(|v| &v.idle).map(|s| value(s, &nothing)).sum();
        idle + self.walk(voxels, views, |s, z| (0.0, [value(s, z), 0.0]), false)[0]
    }

    /// Transmittances of the pixels of a view, in the order of its samples; none once the work is cancelled.
    pub fn transmittances(&mut self, voxels: &[f32], view: &View) -> Vec<f32> {
        self.topology.fill_apron(voxels, &mut self.field.values);
        let Ok(dvr) = Dvr::new(&self.field, self.medium.clone()) else { return Vec::new() };
        let dvr = dvr.early_stop(0.0);
        let (arch, offsets) = (Arch::default(), &self.offsets);
        let of_run = |(tape, depths): &mut (Tape<f32>, Vec<f64>), samples: &&[Sample]| -> Vec<f32> {
            let of_pixel = |sample: &Sample| {
                let [transmittance, _] = arch.dispatch(Run {
                    dvr: &dvr,
                    camera: &view.camera,
                    samples: std::slice::from_ref(sample),
                    offsets,
                    cotangent: &|_: &Sample, z: &[f64]| (0.0, [transmittance(z), 0.0]),
                    tape,
                    depths,
                    gradient: None,
                });
                transmittance as f32
            };
            samples.iter().map(of_pixel).collect()
        };
        let runs: Vec<&[Sample]> = view.samples.chunks(RUN).collect();
        let scratch = || (Tape::default(), vec![0.0; offsets.len()]);
        tiles::map(&runs, &self.cancel, scratch, of_run).unwrap_or_default().concat()
    }

    fn walk(
        &mut self,
        voxels: &[f32],
        views: &[View],
        cotangent: impl Fn(&Sample, &[f64]) -> (f64, [f64; 2]) + Sync,
        with_gradient: bool,
    ) -> [f64; 2] {
        self.topology.fill_apron(voxels, &mut self.field.values);
        let Ok(dvr) = Dvr::new(&self.field, self.medium.clone()) else { return [0.0; 2] };
        let dvr = dvr.early_stop(0.0);
        let runs: Vec<(&Camera, &[Sample])> =
            views.iter().flat_map(|v| v.samples.chunks(RUN).map(|s| (&v.camera, s))).collect();
        let (count, offsets) = (self.partitions.len(), &self.offsets);
        let (arch, cancel) = (Arch::default(), self.cancel.clone());
        let sums = tiles::own_partitions(
            &mut self.partitions,
            &cancel,
            |number| tiles::dealt(&runs, number, count),
            |gradient| {
                if with_gradient {
                    gradient.fill(0.0);
                }
                ([0.0; 2], Tape::default(), vec![0.0; offsets.len()])
            },
            |gradient, (sums, tape, depths), (camera, samples)| {
                let gradient = with_gradient.then_some(&mut gradient[..]);
                let add = arch.dispatch(Run {
                    dvr: &dvr,
                    camera,
                    samples,
                    offsets,
                    cotangent: &cotangent,
                    tape,
                    depths,
                    gradient,
                });
                *sums = [sums[0] + add[0], sums[1] + add[1]];
            },
        );
        in_all(sums.into_iter().map(|(sums, ..)| sums).collect(), count)
    }
}

/// Adds the partitions of all processes to the first one, in their order.
pub(super) fn add_partitions<V: Voxel>(partitions: &mut [Vec<V>]) {
    let own = ranks::own(partitions.len());
    let Some((total, rest)) = partitions.split_first_mut() else { return };
    // The first one is where the others are added.
    let others = &rest[own.start.max(1) - 1..own.end.max(1) - 1];
    ranks::added(total, BRICK, |brick, total| {
        for partition in others {
            total.iter_mut().zip(&partition[brick * BRICK..]).for_each(|(t, v)| *t += *v);
        }
    });
}

/// Adds two sums over all partitions, of which there are `count`, from those of this process's.
pub(super) fn in_all(own: Vec<[f64; 2]>, count: usize) -> [f64; 2] {
    let all = ranks::gathered(own, count, || [0.0; 2], |sums| sums.iter_mut().collect());
    all.into_iter().fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]])
}

/// Transmittance of a pixel: the mean of those along its rays, whose optical depths are given.
pub fn transmittance(depths: &[f64]) -> f64 {
    depths.iter().map(|z| (-z).exp()).sum::<f64>() / depths.len() as f64
}

/// Neighbouring pixels of one view: the unit that is compiled once for each instruction set.
struct Run<'a, 'd, F> {
    dvr: &'a Dvr<'d, f32>,
    camera: &'a Camera,
    samples: &'a [Sample],
    offsets: &'a [[f64; 2]],
    cotangent: &'a F,
    tape: &'a mut Tape<f32>,
    /// Optical depth along each ray of a pixel.
    depths: &'a mut [f64],
    /// Accumulator of the derivatives, if they are requested.
    gradient: Option<&'a mut [f32]>,
}

impl<F: Fn(&Sample, &[f64]) -> (f64, [f64; 2])> pulp::NullaryFnOnce for Run<'_, '_, F> {
    type Output = [f64; 2];

    #[inline(always)]
    fn call(mut self) -> [f64; 2] {
        let (share, width) = (1.0 / self.offsets.len() as f64, self.camera.width);
        let mut sums = [0.0; 2];
        for sample in self.samples {
            let [x, y] = [sample.pixel % width, sample.pixel / width].map(|v| f64::from(v) + 0.5);
            for (depth, [u, v]) in self.depths.iter_mut().zip(self.offsets) {
                let ray = self.camera.ray(x + u, y + v);
                *depth = self.dvr.trace_with(&ray, self.tape);
            }
            let (depth_cotangent, add) = (self.cotangent)(sample, self.depths);
            sums = [sums[0] + add[0], sums[1] + add[1]];
            match &mut self.gradient {
                Some(gradient) => self.tape.accumulate(share * depth_cotangent, self.dvr, gradient),
                None => self.tape.forget(),
            }
        }
        sums
    }
}
