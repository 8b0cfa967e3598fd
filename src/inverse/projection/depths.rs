//! Optical depths as equations of the densities: one row a pixel.

use crate::inverse::projection::projector::{Projector, View};
use crate::inverse::solver::conjugate::Equations;

/// The pixels of some views.
#[derive(Debug)]
pub struct Depths<'a> {
    views: &'a [View],
    /// The operator A.
    pub projector: &'a mut Projector,
}

impl<'a> Depths<'a> {
    /// The pixels of `views`, each with its weight.
    pub fn new(views: &'a [View], projector: &'a mut Projector) -> Self {
        Self { views, projector }
    }
}

impl Equations for Depths<'_> {
    fn cancelled(&self) -> bool {
        self.projector.cancel.requested()
    }

    fn rows(&self) -> usize {
        self.views.iter().map(|v| v.samples.len()).sum()
    }

    fn normal(&mut self, x: &[f32], out: &mut [f32]) -> f64 {
        let [curvature, _] = self.projector.normal(x, self.views, out, |s, z| {
            let z = mean(z);
            (f64::from(s.weight) * z, [f64::from(s.weight) * z * z, 0.0])
        });
        curvature
    }

    fn residual(&mut self, x: &[f32], bound: f64, out: &mut [f32]) -> [f64; 2] {
        self.projector.normal(x, self.views, out, |s, z| {
            // A pixel is the mean of transmittances, not of depths: the difference is known from the
            // present estimate and taken off the measurement.
            let z_mean = mean(z);
            let jensen_gap = if z.len() > 1 { mean_of(z, |z| (z_mean - z).exp()).ln() } else { 0.0 };
            let residual = f64::from(s.depth) - (z_mean - jensen_gap);
            let size = f64::from(s.weight).sqrt() * residual.abs();
            let trust = if size > bound { bound / size } else { 1.0 };
            let weighted = f64::from(s.weight) * trust * residual;
            (weighted, [size.min(bound), weighted * residual])
        })
    }
}

/// Mean optical depth of a pixel's rays.
pub fn mean(depths: &[f64]) -> f64 {
    mean_of(depths, |z| z)
}

fn mean_of(depths: &[f64], f: impl Fn(f64) -> f64) -> f64 {
    depths.iter().map(|z| f(*z)).sum::<f64>() / depths.len() as f64
}
