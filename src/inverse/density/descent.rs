//! Gradient descent on densities for any medium: Adam on batches of views, with a prior on neighbouring voxels.

use crate::cancel::Cancel;
use crate::differentiate::gradient::pictures::{self, Gradients, PixelLoss, Target, Workspace};
use crate::differentiate::loss::prior::{VolumePrior, Weighted};
use crate::error::{Code, Error, Result};
use crate::inverse::density::Request;
use crate::inverse::observation::Observation;
use crate::inverse::observation::photo::Photo;
use crate::inverse::region::hull::Hull;
use crate::inverse::solver::adam::Adam;
use crate::math::Affine;
use crate::metrics::error::unit_psnr_db;
use crate::render::composited::Composited;
use crate::render::differentiable::Adjoint;
use crate::render::dvr::{Dvr, Tape};
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::{BRICK, Bricks, Topology};
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::medium::{Medium, Source};
use crate::scene::neighbours::Neighbours;
use std::sync::Arc;

/// Returns the bricks of a lattice in which densities are unknown, at most `limit`, and a flag for each of their
/// voxels: the visual hull, or the whole box for a transfer function that absorbs where the density is 0.
///
/// # Errors
/// If there are too many bricks.
pub(crate) fn unknowns(
    observation: &Observation,
    request: &Request,
    lattice: &Affine,
    limit: usize,
) -> Result<(Topology, Vec<bool>)> {
    let (topology, unknown) =
        Hull::new(observation).cancel(request.cancel.clone()).unknowns(lattice, &request.bounds, limit)?;
    let Source::Transfer(table) = &request.medium.source else { return Ok((topology, unknown)) };
    if table.at(0.0)[3] == 0.0 {
        return Ok((topology, unknown));
    }
    let blocks = (topology.bounds().size() / 8.0).element_product();
    if blocks > limit as f64 {
        return Err(Error::unsupported(format!(
            "the transfer function absorbs where the density is 0, and the {blocks:.0} blocks of 8³ voxels of the \
             whole box do not fit in memory"
        ))
        .coded(Code::MemoryLimit)
        .hint("give a smaller region with ⟨bounds⟩ or a larger ⟨voxel_size⟩, or raise ⟨max_memory⟩"));
    }
    let all = topology.filled()?;
    let mut wider = vec![false; all.len() * LEAF_VOXELS];
    for (brick, own) in topology.bricks().iter().zip(unknown.chunks(LEAF_VOXELS)) {
        let at = all.find(*brick) as usize * LEAF_VOXELS;
        wider[at..at + LEAF_VOXELS].copy_from_slice(own);
    }
    Ok((all, wider))
}

/// Medium, background and quadrature with which densities are rendered.
#[derive(Debug)]
pub struct ForwardModel<'a> {
    /// Medium: extinction and source by density.
    pub medium: &'a Medium,
    /// Radiance behind the volume.
    pub background: [f32; 3],
    /// Quadrature along rays.
    pub quadrature: Quadrature,
}

impl ForwardModel<'_> {
    /// Creates a renderer of densities.
    ///
    /// # Errors
    /// If the medium cannot be used.
    pub fn renderer<'f>(&self, field: &'f Bricks<f32>) -> Result<Composited<Dvr<'f, f32>>> {
        Ok(Dvr::new(field, self.medium.clone())?.quadrature(self.quadrature).over(self.background))
    }
}

/// Pictures that densities are fitted to, and those held out.
#[derive(Debug)]
pub(crate) struct Views {
    /// Pictures that are fitted.
    pub train: Vec<Target>,
    /// Pictures that are not fitted but measure the result.
    pub held_out: Vec<Target>,
}

impl Views {
    /// Divides the photos as a request has it.
    pub(crate) fn new(photos: &[Photo], request: &Request) -> Self {
        let rays_per_edge = request.rays_per_edge;
        let target = |p: &Photo| Target { camera: p.camera, rgba: p.film.rgba.clone(), rays_per_edge };
        let held = |i: &usize| request.held_out.contains(i);
        Self {
            train: (0..photos.len()).filter(|i| !held(i)).map(|i| target(&photos[i])).collect(),
            held_out: (0..photos.len()).filter(held).map(|i| target(&photos[i])).collect(),
        }
    }

    /// Returns the PSNR of the pictures that are fitted.
    ///
    /// # Errors
    /// If the medium cannot be used.
    pub(crate) fn train_psnr(&self, fit: &Fit, model: &ForwardModel<'_>) -> Result<f64> {
        fit.psnr(&self.train.iter().collect::<Vec<_>>(), model)
    }

    /// Returns the PSNR of the held-out pictures, if there are any.
    ///
    /// # Errors
    /// If the medium cannot be used.
    pub(crate) fn held_out_psnr(&self, fit: &Fit, model: &ForwardModel<'_>) -> Result<Option<f64>> {
        if self.held_out.is_empty() {
            return Ok(None);
        }
        fit.psnr(&self.held_out.iter().collect::<Vec<_>>(), model).map(Some)
    }
}

/// Returns `Σ |c - c'|` over colors and alpha, and its derivatives.
pub(crate) fn absolute(rendered: &[f32; 4], target: &[f32; 4]) -> (f64, [f32; 4]) {
    let difference: [f32; 4] = std::array::from_fn(|c| rendered[c] - target[c]);
    let value = difference.iter().map(|d| f64::from(d.abs())).sum();
    (value, difference.map(|d| if d == 0.0 { 0.0 } else { d.signum() }))
}

/// Returns `Σ (c - c')² / 2` over colors and alpha, and its derivatives.
pub(crate) fn squared(rendered: &[f32; 4], target: &[f32; 4]) -> (f64, [f32; 4]) {
    let difference: [f32; 4] = std::array::from_fn(|c| rendered[c] - target[c]);
    (difference.iter().map(|d| 0.5 * f64::from(*d).powi(2)).sum(), difference)
}

/// Splits views into batches, in an order that changes from epoch to epoch (a stride coprime to their number).
pub(crate) fn batches(train: &[Target], size: usize, epoch: u32) -> Vec<Vec<&Target>> {
    let n = train.len();
    let gcd = |mut a: usize, mut b: usize| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let stride = (7 + 4 * epoch as usize..).find(|s| gcd(*s, n) == 1).unwrap_or(1);
    let order: Vec<&Target> = (0..n).map(|i| &train[(i * stride + epoch as usize) % n]).collect();
    order.chunks(size).map(<[_]>::to_vec).collect()
}

/// Densities that are fitted to pictures, and the state of their optimiser.
#[derive(Debug)]
pub(crate) struct Fit {
    /// Current densities.
    pub field: Bricks<f32>,
    /// 1 where a voxel is unknown, else 0.
    mask: Vec<f32>,
    /// Voxels in the unit of the learning rate, 512 a brick.
    x: Vec<f32>,
    unit: f32,
    adam: Adam,
    neighbours: Neighbours,
    stored: Vec<f32>,
    accumulators: Workspace<f32, Tape<f32>>,
    owned: Vec<f32>,
    /// Polled inside every step; a step that it stops changes nothing.
    pub cancel: Cancel,
}

impl Fit {
    /// Starts from densities `start` (512 a brick); `unit` is the density that counts as 1 in the learning rate and the
    /// prior.
    pub(crate) fn new(
        topology: Arc<Topology>,
        lattice: Affine,
        unknown: &[bool],
        start: &[f32],
        unit: f32,
        rate: f32,
    ) -> Self {
        let mask: Vec<f32> = unknown.iter().map(|u| f32::from(u8::from(*u))).collect();
        let mut fit = Self {
            x: start.iter().zip(&mask).map(|(v, m)| m * v / unit).collect(),
            unit,
            adam: Adam::new(mask.len(), rate),
            neighbours: Neighbours::new(&topology),
            stored: vec![0.0; topology.len() * BRICK],
            accumulators: Workspace::default(),
            owned: vec![0.0; mask.len()],
            cancel: Cancel::NEVER,
            field: Bricks::zeros(topology, lattice),
            mask,
        };
        fit.update_field();
        fit
    }

    /// Hands out the densities so far, if the request asks for them.
    pub(crate) fn offer(&self, request: &Request) {
        if let Some(checkpoint) = &request.checkpoint {
            checkpoint.offer(|| self.field.clone());
        }
    }

    /// Returns the number of unknown voxels.
    pub(crate) fn unknowns(&self) -> usize {
        self.mask.iter().filter(|m| **m > 0.0).count()
    }

    /// Sets the learning rate.
    pub(crate) fn rate(&mut self, rate: f32) {
        self.adam.rate = rate;
    }

    fn update_field(&mut self) {
        let scaled: Vec<f32> = self.x.iter().map(|v| v * self.unit).collect();
        self.field.topology.fill_apron(&scaled, &mut self.field.values);
    }

    /// Takes one step of Adam on the mean of `loss` over the batch's pixels and channels plus `prior` on the voxels.
    /// Returns the mean loss before the step; NaN once the work is cancelled.
    ///
    /// # Errors
    /// If the medium cannot be used.
    pub(crate) fn step(
        &mut self,
        batch: &[&Target],
        model: &ForwardModel<'_>,
        loss: PixelLoss<'_>,
        prior: Weighted<VolumePrior>,
    ) -> Result<f64> {
        let finite = |t: &&Target| t.rgba.iter().filter(|p| p.iter().all(|v| v.is_finite())).count();
        let values: usize = batch.iter().map(|t| 4 * finite(t)).sum();
        let share = 1.0 / values.max(1) as f32;
        let shared = |rendered: &[f32; 4], target: &[f32; 4]| {
            let (value, derivative) = loss(rendered, target);
            (value, derivative.map(|s| share * s))
        };
        self.stored.fill(0.0);
        let dvr = model.renderer(&self.field)?;
        let mut gradients =
            Gradients { voxels: Some(&mut self.stored), cancel: self.cancel.clone(), ..Gradients::default() };
        let (sum, _) = pictures::gradient(&dvr, batch, &shared, Adjoint::Tape, &mut self.accumulators, &mut gradients);
        if self.cancel.requested() {
            return Ok(f64::NAN);
        }
        self.field.topology.gather_apron(&self.stored, &mut self.owned);
        self.owned.iter_mut().for_each(|g| *g *= self.unit);
        let Weighted { prior, weight } = prior;
        prior.add(weight, &self.x, &self.neighbours, self.unknowns(), &mut self.owned);
        self.adam.step(&mut self.x, &self.owned, &self.mask);
        self.update_field();
        Ok(sum * f64::from(share))
    }

    /// Returns the PSNR of the colors (peak 1); NaN once the work is cancelled.
    ///
    /// # Errors
    /// If the medium cannot be used.
    pub(crate) fn psnr(&self, targets: &[&Target], model: &ForwardModel<'_>) -> Result<f64> {
        let values: usize = targets.iter().map(|t| 3 * t.rgba.len()).sum();
        let square = pictures::error(&model.renderer(&self.field)?, targets, &self.cancel);
        if !square.is_finite() && self.cancel.requested() {
            return Ok(f64::NAN);
        }
        Ok(unit_psnr_db(square / values.max(1) as f64))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::scene::blur::Blur;
    use crate::scene::camera::{Camera, Projection};
    use glam::{DMat4, DVec2};
    use std::collections::BTreeSet;

    /// Whatever their number has for factors, all views have their turn in each epoch.
    #[test]
    fn batches_hold_every_view_once() {
        let camera = Camera {
            camera_to_world: DMat4::IDENTITY,
            focal: DVec2::ONE,
            centre: DVec2::ZERO,
            width: 1,
            height: 1,
            projection: Projection::Perspective,
            near: 0.0,
            blur: Blur::default(),
        };
        for n in 1..40 {
            let views: Vec<Target> =
                (0..n).map(|k| Target { camera, rgba: vec![[k as f32; 4]], rays_per_edge: 1 }).collect();
            for epoch in 0..12 {
                let batches = batches(&views, 8, epoch);
                let visited: BTreeSet<u32> = batches.iter().flatten().map(|t| t.rgba[0][0] as u32).collect();
                assert_eq!((visited.len(), batches.iter().map(Vec::len).sum::<usize>()), (n, n));
            }
        }
    }
}
