//! Texels of a transfer function that are fitted to rays.

use super::Request;
use super::normal::Prior;
use super::rays::{Draw, Rays};
use super::rows;
use crate::error::{Error, Result};
use crate::inverse::observation::photo::Photo;
use crate::render::composited::Composited;
use crate::render::dvr::Dvr;
use crate::scene::bricks::Bricks;
use crate::scene::medium::{Medium, Source};
use crate::scene::table::Rgbs;
use crate::scene::transfer::Transfer;
use std::sync::Arc;

/// Least damping of the steps: far more than the rounding of the sums of derivatives.
const LEAST_DAMPING: f64 = 1e-6;

/// A function at the centres of so many texels.
fn sampled(transfer: &Transfer, domain: [f64; 2], texels: usize) -> Result<Vec<Rgbs>> {
    let table = transfer.table()?;
    Ok(Transfer::centres(domain, texels).into_iter().map(|d| table.at(d)).collect())
}

/// Unknowns that a refinement changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unknowns {
    Colors,
    All,
}

/// The texels, and the rays that they are to explain.
pub(super) struct Fit<'a> {
    pub field: &'a Bricks<f32>,
    pub request: &'a Request,
    pub texels: Vec<Rgbs>,
    pub used: Rays,
    pub held_out: Rays,
    /// Damping of the steps (Levenberg & Marquardt).
    damping: f64,
}

impl<'a> Fit<'a> {
    pub(crate) fn new(field: &'a Bricks<f32>, photos: &[Photo], request: &'a Request) -> Result<Self> {
        let is_held_out = |i: usize| request.held_out.contains(&i);
        let mut used =
            Rays::draw(photos, |i| !is_held_out(i), Draw { count: request.rays, per_edge: request.rays_per_edge });
        let some = Draw { count: request.rays / 8, per_edge: request.rays_per_edge };
        let mut held_out = Rays::draw(photos, is_held_out, some);
        (used.cancel, held_out.cancel) = (request.cancel.clone(), request.cancel.clone());
        if used.is_empty() {
            return Err(Error::invalid("no pixel of the used views has finite values")
                .hint("check the pictures with `cumulo validate`"));
        }
        let texels = match &request.init {
            Some(init) => sampled(init, request.domain, request.texels)?,
            None => vec![[0.5, 0.5, 0.5, 0.0]; request.texels],
        };
        let fit = Self { field, request, texels, used, held_out, damping: 1e-4 };
        fit.transfer().checked()?;
        Ok(fit)
    }

    /// Samples the current function at another number of texels.
    pub(crate) fn resample(&mut self, texels: usize) -> Result<()> {
        self.texels = sampled(&self.transfer(), self.request.domain, texels)?;
        Ok(())
    }

    pub(crate) fn transfer(&self) -> Transfer {
        Transfer::Texture { domain: self.request.domain, texels: self.texels.clone() }
    }

    pub(crate) fn renderer(&self, texels: &[Rgbs]) -> Result<Composited<Dvr<'a, f32>>> {
        let transfer = Transfer::Texture { domain: self.request.domain, texels: texels.to_vec() };
        let source = Source::Transfer(Arc::new(transfer.table()?));
        let medium = Medium::new(self.request.extinction, source);
        Ok(Dvr::new(self.field, medium)?.quadrature(self.request.quadrature).over(self.request.background))
    }

    /// Extinctions by Gauss and Newton on `T = e^{-H s}`: with nothing that absorbs, the derivative of alpha
    /// is H, and one walk finds it.
    pub(crate) fn extinctions_from_alpha(&mut self, smooth: f64) -> Result<()> {
        let non_absorbing: Vec<Rgbs> = self.texels.iter().map(|[r, g, b, _]| [*r, *g, *b, 0.0]).collect();
        let lengths = rows::lengths(&self.renderer(&non_absorbing)?, &self.used, self.texels.len());
        let extinctions = rows::extinctions(&lengths, &self.used, self.texels.len(), smooth);
        if self.request.cancel.requested() {
            return Ok(());
        }
        for (texel, extinction) in self.texels.iter_mut().zip(extinctions) {
            texel[3] = extinction;
        }
        Ok(())
    }

    /// Takes one step and returns the root mean square difference before it. A step that makes things
    /// worse is taken back, and the next one is shorter.
    pub(crate) fn refine(&mut self, smooth: f64, unknowns: Unknowns) -> Result<f64> {
        let scale = self.scale();
        let normal = rows::normal(&self.renderer(&self.texels)?, &self.used, scale, self.texels.len());
        if self.request.cancel.requested() {
            return Ok(f64::NAN);
        }
        let before = normal.cost;
        let rms = (before / (4 * self.used.len()) as f64).sqrt();
        let prior = Prior { weight: smooth * normal.level(), scale };
        let penalty = |texels: &[Rgbs]| prior.cost(texels);
        let from = before + penalty(&self.texels);
        for _ in 0..6 {
            let Some(step) = normal.solve(&self.texels, &prior, self.damping, unknowns == Unknowns::All) else {
                self.damping *= 10.0;
                continue;
            };
            let cost = rows::cost(&self.renderer(&step)?, &self.used) + penalty(&step);
            if self.request.cancel.requested() {
                break;
            }
            if cost <= from {
                self.texels = step;
                self.damping = (0.2 * self.damping).max(LEAST_DAMPING);
                break;
            }
            self.damping = (10.0 * self.damping).max(1e-6);
        }
        Ok(rms)
    }

    /// Extinction that counts as much as a color of one.
    fn scale(&self) -> f64 {
        let largest = self.texels.iter().fold(0.0_f64, |m, t| m.max(t[3]));
        if largest > 0.0 { largest } else { 1.0 / self.field.world_bounds().size().max_element() }
    }

    /// Mean squared difference of the colors; `None` without rays.
    pub(crate) fn error(&self, rays: &Rays) -> Result<Option<f64>> {
        if rays.is_empty() {
            return Ok(None);
        }
        let square = rows::color_cost(&self.renderer(&self.texels)?, rays);
        Ok(Some(square / (3 * rays.len()) as f64))
    }

    pub(crate) fn confidence(&self, smooth: f64) -> Result<Vec<[f64; 2]>> {
        let scale = self.scale();
        let normal = rows::normal(&self.renderer(&self.texels)?, &self.used, scale, self.texels.len());
        let prior = Prior { weight: smooth * normal.level(), scale };
        Ok(normal.confidence(&prior))
    }
}
