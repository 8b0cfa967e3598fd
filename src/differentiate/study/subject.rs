//! What gradients are studied of: the densities of a medium, or the emissions and extinctions of a pre-shaded volume.

use crate::differentiate::gradient::views::ForwardInAll;
use crate::differentiate::study::setting::Setting;
use crate::error::Result;
use crate::real::Real;
use crate::render::composited::Composited;
use crate::render::differentiable::Differentiable;
use crate::render::dvr::{Directions, Dvr};
use crate::render::preshaded::Preshaded;
use crate::scene::bricks::{Bricks, Voxel};
use crate::scene::medium::Source;
use glam::{DVec4, Vec4};
use rayon::prelude::*;
use std::fmt::Debug;

/// A voxel, single or double, of something whose pictures can be differentiated.
pub trait Subject: Voxel + Debug + PartialEq + 'static {
    /// Voxel type in double precision.
    type Double: Subject<Double = Self::Double>;
    /// Renderer of fields of such voxels.
    type Renderer<'f>: ForwardInAll + Differentiable<Voxel = Self>;
    /// Names of the numbers of a voxel; the last is the one that the optical depth depends on.
    const CHANNELS: &'static [&'static str];
    /// Returns the renderer of a field. In double precision rays do not end early, so that differences show
    /// derivatives, not where rays end.
    ///
    /// # Errors
    /// As [`Dvr::new`] and [`Transfer::table`](crate::scene::transfer::Transfer::table).
    fn renderer<'f>(field: &'f Bricks<Self>, setting: &Setting) -> Result<Composited<Self::Renderer<'f>>>;
    /// Returns true if the pictures depend on the optical depth alone.
    fn depth_alone(setting: &Setting) -> bool;
    /// Returns the name of the quadrature.
    fn quadrature(setting: &Setting) -> String;
    /// Converts the voxel to double precision, exactly.
    fn double(self) -> Self::Double;
    /// Returns one of the numbers of the voxel.
    fn channel(self, channel: usize) -> f64;
    /// Returns the voxel with one number replaced.
    #[must_use]
    fn with(self, channel: usize, value: f64) -> Self;
}

/// Number of the channel that the optical depth is made of.
pub const fn depth_channel<V: Subject>() -> usize {
    V::CHANNELS.len() - 1
}

/// The largest magnitude that a channel of a field stores, or 1 if all are zero.
pub fn largest<V: Subject>(field: &Bricks<V>, channel: usize) -> f64 {
    let largest = field.values.par_iter().map(|v| v.channel(channel).abs()).reduce(|| 0.0, f64::max);
    if largest > 0.0 { largest } else { 1.0 }
}

fn is_double<R: Real>() -> bool {
    R::EPSILON.f64() < 1e-10
}

fn medium<'f, R: Directions<1>>(field: &'f Bricks<R>, setting: &Setting) -> Result<Composited<Dvr<'f, R>>> {
    let dvr = Dvr::new(field, setting.medium()?)?.by_voxels().quadrature(setting.quadrature);
    let dvr = if is_double::<R>() { dvr.early_stop(0.0).tolerance(1e-11) } else { dvr };
    Ok(dvr.over(setting.background))
}

fn shaded<'f, R: Real>(field: &'f Bricks<R::Lanes>, setting: &Setting) -> Composited<Preshaded<'f, R>> {
    let renderer = Preshaded::new(field);
    let renderer = if is_double::<R>() { renderer.early_stop(0.0) } else { renderer };
    renderer.over(setting.background)
}

macro_rules! subjects {
    ($($real:ty, $four:ty, $widen:expr);*) => {
        $(impl Subject for $real {
            type Double = f64;
            type Renderer<'f> = Dvr<'f, $real>;
            const CHANNELS: &'static [&'static str] = &["density"];
            fn renderer<'f>(field: &'f Bricks<Self>, setting: &Setting) -> Result<Composited<Self::Renderer<'f>>> {
                medium(field, setting)
            }
            fn depth_alone(setting: &Setting) -> bool {
                setting.transfer.is_none() && matches!(setting.source, Source::Grey(_))
            }
            fn quadrature(setting: &Setting) -> String {
                setting.quadrature.to_string()
            }
            fn double(self) -> f64 {
                self.into()
            }
            fn channel(self, _: usize) -> f64 {
                self.into()
            }
            fn with(self, _: usize, value: f64) -> Self {
                value as $real
            }
        }

        impl Subject for $four {
            type Double = DVec4;
            type Renderer<'f> = Preshaded<'f, $real>;
            const CHANNELS: &'static [&'static str] = &["emission.red", "emission.green", "emission.blue", "density"];
            fn renderer<'f>(field: &'f Bricks<Self>, setting: &Setting) -> Result<Composited<Self::Renderer<'f>>> {
                Ok(shaded(field, setting))
            }
            fn depth_alone(_: &Setting) -> bool {
                false
            }
            fn quadrature(_: &Setting) -> String {
                "gauss".into()
            }
            fn double(self) -> DVec4 {
                $widen(self)
            }
            fn channel(self, channel: usize) -> f64 {
                self[channel].into()
            }
            fn with(mut self, channel: usize, value: f64) -> Self {
                self[channel] = value as $real;
                self
            }
        })*
    };
}
subjects!(f32, Vec4, |v: Vec4| v.as_dvec4(); f64, DVec4, std::convert::identity);
