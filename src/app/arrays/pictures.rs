//! Pictures of arrays along straight rays, and their derivatives in reverse and in forward mode.

use super::lattice::{Arranged, Lattice, Value, checked};
use crate::cancel::Cancel;
use crate::differentiate::gradient::objective::{ActiveParameters, Direction, Gradient};
use crate::differentiate::gradient::pictures::{self, Gradients, Target, Workspace};
use crate::differentiate::gradient::views::Views;
use crate::differentiate::study::setting::Setting;
use crate::differentiate::study::subject::Subject;
use crate::error::{Error, Result};
use crate::real::Real;
use crate::render::composited::Composited;
use crate::render::differentiable::{Adjoint, Differentiable, ParameterGradient};
use crate::render::film::{self, Sampling};
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::Bricks;
use crate::scene::camera::CameraGradient;
use crate::scene::medium::Source;
use crate::scene::table::TableGradient;
use std::sync::Arc;

/// Values that pictures can be rendered of and differentiated by: `f32`, `f64`, or four of them (the emission per world
/// length in red, green and blue, and the extinction).
pub trait Differentiate: Value<Voxel: Subject> {
    /// Precision of the pictures.
    type Real: Real;

    /// Renders the pictures of a setting: per camera the rows of pixels, red, green, blue and alpha.
    ///
    /// # Errors
    /// If values, setting or their combination cannot be used, or the work was cancelled.
    fn render(
        lattice: &Lattice,
        values: &[Self],
        setting: &Setting,
        rays_per_edge: usize,
        cancel: &Cancel,
    ) -> Result<Vec<[Self::Real; 4]>>;

    /// Returns the derivatives of a loss with respect to what is wanted, from those with respect to the pictures, which
    /// are given as [`Differentiate::render`] returns them.
    ///
    /// # Errors
    /// As [`Differentiate::render`].
    fn vjp(
        lattice: &Lattice,
        values: &[Self],
        setting: &Setting,
        cotangents: &[[Self::Real; 4]],
        sampling: (Wanted, usize),
        cancel: &Cancel,
    ) -> Result<Derivatives<Self>>;
}

/// Derivatives that are wanted; those with respect to extinction, emission and background cost nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Wanted {
    /// True for the array's values.
    pub values: bool,
    /// True for the transfer function's parameters.
    pub function: bool,
    /// True for cameras and the quadrature's step.
    pub rays: bool,
}

/// Derivatives of a loss.
#[derive(Debug, Clone, PartialEq)]
pub struct Derivatives<T> {
    /// With respect to the array's values; empty if not wanted.
    pub values: Vec<T>,
    /// With respect to the transfer function's parameters, in the order of its
    /// [`parameters`](crate::scene::transfer::Transfer::parameters); empty if not wanted.
    pub function: Vec<f64>,
    /// With respect to each camera.
    pub cameras: Vec<CameraGradient>,
    /// With respect to the quadrature's step, in voxels.
    pub step: f64,
    /// With respect to extinction, emission and background.
    pub shared: ParameterGradient,
}

/// Changes of what pictures depend on; an empty list is no change.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tangents<T> {
    /// Change of the array's values.
    pub values: Vec<T>,
    /// Change of the transfer function's parameters.
    pub function: Vec<f64>,
    /// Change of each camera.
    pub cameras: Vec<CameraGradient>,
    /// Change of the quadrature's step, in voxels.
    pub step: f64,
    /// Change of extinction, emission and background.
    pub shared: ParameterGradient,
}

impl<T: Value> Tangents<T>
where
    T::Voxel: Subject,
{
    /// Returns the change of the pictures of a setting, per camera.
    ///
    /// # Errors
    /// As [`Differentiate::render`].
    pub fn push(
        &self,
        lattice: &Lattice,
        values: &[T],
        setting: &Setting,
        rays_per_edge: usize,
        cancel: &Cancel,
    ) -> Result<Vec<[f64; 4]>> {
        let (arranged, field) = arranged(lattice, values, setting, 2)?;
        let renderer = T::Voxel::renderer(&field, setting)?;
        let mut directions = Vec::new();
        if !self.values.is_empty() {
            // Beside the active voxels of a grid nothing changes.
            let unchanged = match &arranged {
                Arranged::Box(_) => None,
                Arranged::Active(active) => T::sparse(active, &vec![T::of(T::Voxel::default()); active.len()]),
            };
            let mut change = arranged.field(&self.values)?.values;
            if let Some(unchanged) = unchanged {
                change.iter_mut().zip(unchanged.values).for_each(|(change, rest)| *change = difference(*change, rest));
            }
            directions.push(Direction::Voxels(change));
        }
        if let (Some(transfer), false) = (&setting.transfer, self.function.is_empty()) {
            directions.push(Direction::Table(transfer.push(&self.function)?));
        }
        let moved = self.cameras.iter().enumerate().filter(|(_, by)| **by != CameraGradient::default());
        directions.extend(moved.map(|(view, by)| Direction::Camera(view, *by)));
        if self.step != 0.0 {
            directions.push(Direction::Step(self.step));
        }
        if self.shared != ParameterGradient::default() {
            directions.push(Direction::Shared(self.shared));
        }
        let views = Views { cameras: &setting.cameras, rays_per_edge, cancel };
        let pictures = views.jvp(&renderer, &directions).ok_or_else(Error::cancelled)?;
        Ok(pictures.into_iter().flatten().collect())
    }
}

/// Returns the difference of two voxels, channel by channel.
fn difference<V: Subject>(a: V, b: V) -> V {
    (0..V::CHANNELS.len()).fold(V::default(), |v, c| v.with(c, a.channel(c) - b.channel(c)))
}

/// Arranges an array for a setting, after a check of its values; `copies` fields are needed in all.
fn arranged<T: Value>(
    lattice: &Lattice,
    values: &[T],
    setting: &Setting,
    copies: u64,
) -> Result<(Arranged, Bricks<T::Voxel>)> {
    let transfer = setting.transfer.as_ref();
    checked(values, transfer.is_some())?;
    let arranged = lattice.arranged(transfer)?;
    lattice.within::<T>(&arranged, copies)?;
    let field = arranged.field(values)?;
    Ok((arranged, field))
}

/// Number of knots of the transfer function, if derivatives with respect to it are wanted.
fn knots(setting: &Setting, wanted: Wanted) -> Result<Option<usize>> {
    let transfer = setting.transfer.as_ref().filter(|_| wanted.function);
    transfer.map(|transfer| Ok(transfer.table()?.knots().len())).transpose()
}

fn derivatives<T: Value>(
    arranged: &Arranged,
    setting: &Setting,
    gradient: &Gradient<T::Voxel>,
) -> Result<Derivatives<T>> {
    let function = match &setting.transfer {
        Some(transfer) if !gradient.table.pieces.is_empty() => transfer.chain(&gradient.table)?,
        _ => Vec::new(),
    };
    Ok(Derivatives {
        values: if gradient.voxels.is_empty() { Vec::new() } else { arranged.gather(&gradient.voxels) },
        function,
        cameras: gradient.cameras.clone(),
        step: gradient.step,
        shared: gradient.shared,
    })
}

/// Returns the quadrature of a setting unless one is chosen: the default of pictures.
pub fn usual_quadrature(setting: &Setting) -> Result<Quadrature> {
    Ok(match &setting.transfer {
        Some(transfer) => Quadrature::usual(&Source::Transfer(Arc::new(transfer.table()?))),
        None => Quadrature::usual(&setting.source),
    })
}

/// Renders in single precision, bit for bit as pictures of files are rendered.
fn single<I: Differentiable<Real = f32>>(
    renderer: &Composited<I>,
    setting: &Setting,
    rays_per_edge: usize,
    cancel: &Cancel,
) -> Result<Vec<[f32; 4]>> {
    let mut pixels = Vec::new();
    for camera in &setting.cameras {
        let rendered = film::render(renderer, camera, Sampling::grid(rays_per_edge), &[], cancel);
        pixels.extend(rendered.ok_or_else(Error::cancelled)?.film.rgba);
    }
    Ok(pixels)
}

fn single_vjp<I: Differentiable<Real = f32>>(
    renderer: &Composited<I>,
    setting: &Setting,
    cotangents: &[[f32; 4]],
    (wanted, rays_per_edge): (Wanted, usize),
    cancel: &Cancel,
) -> Result<Gradient<I::Voxel>> {
    let mut targets = Vec::new();
    let mut left = cotangents;
    for camera in &setting.cameras {
        let (own, others) = left.split_at(left.len().min(camera.width as usize * camera.height as usize));
        targets.push(Target { camera: *camera, rgba: own.to_vec(), rays_per_edge });
        left = others;
    }
    let knots = knots(setting, wanted)?;
    let mut gradient = Gradient {
        voxels: if wanted.values {
            vec![I::Voxel::default(); renderer.medium.field().values.len()]
        } else {
            Vec::new()
        },
        table: knots.map_or_else(TableGradient::default, TableGradient::of_knots),
        cameras: vec![CameraGradient::default(); setting.cameras.len()],
        ..Gradient::default()
    };
    let mut to = Gradients {
        voxels: wanted.values.then_some(&mut gradient.voxels),
        table: knots.is_some().then_some(&mut gradient.table),
        cameras: wanted.rays.then_some(&mut gradient.cameras),
        step: wanted.rays.then_some(&mut gradient.step),
        cancel: cancel.clone(),
    };
    // The target of a pixel is the loss's derivative with respect to it.
    let loss = |_: &[f32; 4], cotangent: &[f32; 4]| (0.0, *cotangent);
    let targets: Vec<&Target> = targets.iter().collect();
    let (_, shared) = pictures::gradient(renderer, &targets, &loss, Adjoint::Tape, &mut Workspace::default(), &mut to);
    gradient.shared = shared;
    if cancel.requested() { Err(Error::cancelled()) } else { Ok(gradient) }
}

macro_rules! single {
    ($value:ty, $renderer:expr) => {
        impl Differentiate for $value {
            type Real = f32;

            fn render(
                lattice: &Lattice,
                values: &[Self],
                setting: &Setting,
                rays_per_edge: usize,
                cancel: &Cancel,
            ) -> Result<Vec<[f32; 4]>> {
                let (_, field) = arranged(lattice, values, setting, 1)?;
                let field = if setting.transfer.is_none() { field.hiding_empty() } else { field };
                #[allow(clippy::redundant_closure_call, reason = "each kind of value has a renderer of its own")]
                single(&$renderer(&field, setting)?, setting, rays_per_edge, cancel)
            }

            fn vjp(
                lattice: &Lattice,
                values: &[Self],
                setting: &Setting,
                cotangents: &[[f32; 4]],
                (wanted, rays_per_edge): (Wanted, usize),
                cancel: &Cancel,
            ) -> Result<Derivatives<Self>> {
                let (arranged, field) = arranged(lattice, values, setting, 2 + u64::from(wanted.values))?;
                let renderer = <Self as Value>::Voxel::renderer(&field, setting)?;
                let gradient = single_vjp(&renderer, setting, cotangents, (wanted, rays_per_edge), cancel)?;
                derivatives(&arranged, setting, &gradient)
            }
        }
    };
}
single!(f32, simplified);
single!([f32; 4], Subject::renderer);

/// Renderer without the knots of the transfer function that lie on a line between others: that of pictures of files.
fn simplified<'f>(field: &'f Bricks<f32>, setting: &Setting) -> Result<Composited<crate::render::dvr::Dvr<'f, f32>>> {
    let medium = setting.medium()?.simplified(f32::EPSILON.into());
    Ok(crate::render::dvr::Dvr::new(field, medium)?.quadrature(setting.quadrature).over(setting.background))
}

macro_rules! double {
    ($value:ty) => {
        impl Differentiate for $value {
            type Real = f64;

            fn render(
                lattice: &Lattice,
                values: &[Self],
                setting: &Setting,
                rays_per_edge: usize,
                cancel: &Cancel,
            ) -> Result<Vec<[f64; 4]>> {
                let (_, field) = arranged(lattice, values, setting, 1)?;
                let views = Views { cameras: &setting.cameras, rays_per_edge, cancel };
                let renderer = <Self as Value>::Voxel::renderer(&field, setting)?;
                Ok(views.render(&renderer).ok_or_else(Error::cancelled)?.into_iter().flatten().collect())
            }

            fn vjp(
                lattice: &Lattice,
                values: &[Self],
                setting: &Setting,
                cotangents: &[[f64; 4]],
                (wanted, rays_per_edge): (Wanted, usize),
                cancel: &Cancel,
            ) -> Result<Derivatives<Self>> {
                let (arranged, field) = arranged(lattice, values, setting, 5)?;
                let renderer = <Self as Value>::Voxel::renderer(&field, setting)?;
                let views = Views { cameras: &setting.cameras, rays_per_edge, cancel };
                let mut left = cotangents;
                let mut of = |camera: &crate::scene::camera::Camera| {
                    let (own, others) = left.split_at(left.len().min(camera.width as usize * camera.height as usize));
                    left = others;
                    own.to_vec()
                };
                let cotangents: Vec<_> = setting.cameras.iter().map(&mut of).collect();
                let active =
                    ActiveParameters { voxels: wanted.values, knots: knots(setting, wanted)?, rays: wanted.rays };
                let gradient = views.vjp(&renderer, &cotangents, Adjoint::Tape, active).ok_or_else(Error::cancelled)?;
                derivatives(&arranged, setting, &gradient)
            }
        }
    };
}
double!(f64);
double!([f64; 4]);
