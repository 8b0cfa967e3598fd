//! The linear operator of absorption: voxels to optical depths of all measured rays, and its
//! transpose.
//!
//! Rays are dealt to a fixed number of lanes, each with its own accumulator, and the lanes are added
//! in order: the result has the same bits for any number of threads.

use crate::math::Affine;
use crate::render::dvr::{Dvr, Tape};
use crate::scene::bricks::{BRICK, Bricks, Topology};
use crate::scene::camera::Camera;
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::medium::Medium;
use rayon::prelude::*;
use std::sync::Arc;

/// One measured ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Image position in pixels.
    pub position: [f32; 2],
    /// Measured optical depth.
    pub depth: f32,
    /// Weight of its squared residual.
    pub weight: f32,
}

/// The rays of one picture.
#[derive(Debug, Clone)]
pub struct View {
    /// Where it was taken from.
    pub camera: Camera,
    /// Rays, in an order in which neighbours are close in the image.
    pub samples: Vec<Sample>,
}

/// Rays handled in one go.
const RUN: usize = 64;

/// The operator on a fixed topology.
#[derive(Debug)]
pub struct Projector {
    topology: Arc<Topology>,
    transform: Affine,
    medium: Medium,
    /// One accumulator a lane, 729 values a brick.
    lanes: Vec<Vec<f32>>,
    /// The field at hand, with its aprons.
    field: Bricks<f32>,
}

impl Projector {
    /// Prepares accumulators; `extinction` is per unit of density and world length.
    pub fn new(topology: Arc<Topology>, transform: Affine, extinction: f64) -> Self {
        // More lanes than that serve no machine; a lane is as large as the field.
        let bytes = (topology.len() * BRICK * size_of::<f32>()).max(1);
        let lanes = ((256 << 20) / bytes).clamp(2, 16);
        let field = Bricks::zeros(topology.clone(), transform);
        Self {
            medium: Medium::absorbing(extinction),
            lanes: vec![vec![0.0; field.values.len()]; lanes],
            topology,
            transform,
            field,
        }
    }

    /// Unknowns: 512 a brick.
    pub fn unknowns(&self) -> usize {
        self.topology.len() * LEAF_VOXELS
    }

    /// Walks every ray of the given views once. `slope(sample, depth)` says what to send back for an
    /// optical depth of `voxels` along it, and what to add to the sum; `Aᵀ slope` goes to `out`.
    pub fn normal(
        &mut self,
        voxels: &[f32],
        views: &[&View],
        out: &mut [f32],
        slope: impl Fn(&Sample, f64) -> (f64, f64) + Sync,
    ) -> f64 {
        self.topology.spread(voxels, &mut self.field.values);
        let Ok(dvr) = Dvr::new(&self.field, self.medium) else { return 0.0 };
        let dvr = dvr.early_stop(0.0);
        let runs: Vec<(&Camera, &[Sample])> =
            views.iter().flat_map(|v| v.samples.chunks(RUN).map(|s| (&v.camera, s))).collect();
        let count = self.lanes.len();
        let arch = pulp::Arch::new();
        let sums: Vec<f64> = self
            .lanes
            .par_iter_mut()
            .enumerate()
            .map_init(Tape::default, |tape, (lane, gradient)| {
                gradient.fill(0.0);
                let mut sum = 0.0;
                for (camera, run) in runs.iter().skip(lane).step_by(count) {
                    arch.dispatch(
                        #[inline(always)]
                        || {
                            for s in *run {
                                let ray = camera.ray(s.position[0].into(), s.position[1].into());
                                dvr.back_project(
                                    &ray,
                                    |depth| {
                                        let (back, add) = slope(s, depth);
                                        sum += add;
                                        back
                                    },
                                    gradient,
                                    tape,
                                );
                            }
                        },
                    );
                }
                sum
            })
            .collect();
        let (first, rest) = self.lanes.split_at_mut(1);
        first[0].par_chunks_mut(BRICK).enumerate().for_each(|(i, total)| {
            for lane in rest.iter() {
                for (t, v) in total.iter_mut().zip(&lane[i * BRICK..]) {
                    *t += v;
                }
            }
        });
        self.topology.fold(&self.lanes[0], out);
        sums.into_iter().sum()
    }
}
