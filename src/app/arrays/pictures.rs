//! Pictures of arrays along straight rays, and their derivatives in reverse and in forward mode.

use super::lattice::{Arranged, Lattice, Value, checked};
use crate::cancel::Cancel;
use crate::differentiate::gradient::pictures::{self, Gradients, Target, Workspace};
use crate::differentiate::gradient::views::{ActiveParameters, Direction, Gradient, Views};
use crate::differentiate::study::setting::Setting;
use crate::differentiate::study::subject::Subject;
use crate::error::{Error, Result};
use crate::real::Real;
use crate::render::composited::Composited;
use crate::render::differentiable::{Adjoint, Differentiable, ParameterGradient};
use crate::render::dvr::Dvr;
use crate::render::emission_absorption::EmissionAbsorption;
use crate::render::film::{self, Sampling};
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::Bricks;
use crate::scene::camera::CameraGradient;
use crate::scene::medium::Source;
use crate::scene::table::TableGradient;
use rayon::prelude::*;
use std::sync::Arc;

/// An array, arranged for rays, and how it is seen.
#[derive(Debug)]
pub struct ArrayScene<T: Differentiate> {
    lattice: Arc<Lattice>,
    arranged: Arranged,
    field: Bricks<T::Voxel>,
    setting: Setting,
    /// Rays along each edge of a pixel, whose value is the mean over the square of that number.
    rays_per_edge: usize,
}

/// Value of an array whose pictures are rendered and differentiated: `f32`, `f64`, or four of them (the emission per
/// world length in red, green and blue, and the extinction).
pub trait Differentiate: Value<Voxel: Subject> {
    /// Precision of the pictures.
    type Real: Real;
    /// Pixels, red, green, blue and alpha.
    #[doc(hidden)]
    fn render(scene: &ArrayScene<Self>, cancel: &Cancel) -> Result<Vec<[Self::Real; 4]>>;
    /// Derivatives from those with respect to the pixels.
    #[doc(hidden)]
    fn pull(
        scene: &ArrayScene<Self>,
        cotangents: &[[Self::Real; 4]],
        wanted: Wanted,
        cancel: &Cancel,
    ) -> Result<Gradient<Self::Voxel>>;
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

/// Derivatives of a loss, or changes of what pictures depend on; of a change an empty list is none.
#[derive(Debug, Clone, PartialEq)]
pub struct Derivatives<T> {
    /// Derivatives with respect to the array's values.
    pub values: Vec<T>,
    /// Derivatives with respect to the transfer function's parameters, in the order of its
    /// [`parameters`](crate::scene::transfer::Transfer::parameters).
    pub function: Vec<f64>,
    /// Derivatives with respect to each camera.
    pub cameras: Vec<CameraGradient>,
    /// Derivative with respect to the quadrature's step, in voxels.
    pub step: f64,
    /// Derivatives with respect to extinction, emission and background.
    pub shared: ParameterGradient,
}

impl<T: Differentiate> ArrayScene<T> {
    /// Arranges an array, in the order of its lattice, after a check of its values.
    ///
    /// # Errors
    /// If values, setting or their combination cannot be used, or fields would take more memory than is allowed.
    pub fn new(lattice: Arc<Lattice>, values: &[T], setting: Setting, rays_per_edge: usize) -> Result<Self> {
        let transfer = setting.transfer.as_ref();
        checked(values, transfer.is_some())?;
        let arranged = lattice.arranged(transfer)?;
        lattice.within::<T>(&arranged, 1)?;
        let FieldMemory(memory) = lattice.take();
        let field = arranged.field(values, memory)?;
        Ok(Self { lattice, arranged, field, setting, rays_per_edge })
    }

    /// Renders: per camera the rows of pixels, red, green, blue and alpha. In single precision these are the bits of
    /// pictures of files.
    ///
    /// # Errors
    /// If the medium cannot be rendered, or the work was cancelled.
    pub fn render(&self, cancel: &Cancel) -> Result<Vec<[T::Real; 4]>> {
        T::render(self, cancel)
    }

    /// Returns the derivatives of a loss with respect to what is wanted, from those with respect to the pixels, in the
    /// order of [`ArrayScene::render`].
    ///
    /// # Errors
    /// As [`ArrayScene::render`].
    pub fn vjp(&self, cotangents: &[[T::Real; 4]], wanted: Wanted, cancel: &Cancel) -> Result<Derivatives<T>> {
        self.lattice.within::<T>(&self.arranged, if wanted.values { 5 } else { 1 })?;
        let gradient = T::pull(self, cotangents, wanted, cancel)?;
        let function = match &self.setting.transfer {
            Some(transfer) if !gradient.table.pieces.is_empty() => transfer.chain(&gradient.table)?,
            _ => Vec::new(),
        };
        let values = if wanted.values { self.arranged.gather(&gradient.voxels) } else { Vec::new() };
        let Gradient { voxels, cameras, step, shared, .. } = gradient;
        let bytes = size_of_val(voxels.as_slice()) as u64;
        self.lattice.keep(GradientMemory(voxels), bytes);
        Ok(Derivatives { values, function, cameras, step, shared })
    }

    /// Returns the change of the pixels, in the order of [`ArrayScene::render`], under changes of what they depend on.
    ///
    /// # Errors
    /// As [`ArrayScene::render`].
    pub fn jvp(&self, by: &Derivatives<T>, cancel: &Cancel) -> Result<Vec<[f64; 4]>> {
        let renderer = T::Voxel::renderer(&self.field, &self.setting)?;
        let mut directions = Vec::new();
        if !by.values.is_empty() {
            directions.push(Direction::Voxels(self.change(&by.values)?));
        }
        if let (Some(transfer), false) = (&self.setting.transfer, by.function.is_empty()) {
            directions.push(Direction::Table(transfer.push(&by.function)?));
        }
        let moved = by.cameras.iter().enumerate().filter(|(_, by)| **by != CameraGradient::default());
        directions.extend(moved.map(|(view, by)| Direction::Camera(view, *by)));
        if by.step != 0.0 {
            directions.push(Direction::Step(by.step));
        }
        if by.shared != ParameterGradient::default() {
            directions.push(Direction::Shared(by.shared));
        }
        let pictures = self.views(cancel).jvp(&renderer, &directions).ok_or_else(Error::cancelled)?;
        Ok(pictures.into_iter().flatten().collect())
    }

    /// Returns the change of the stored voxels under a change of the array's values.
    fn change(&self, by: &[T]) -> Result<Vec<T::Voxel>> {
        let mut change = self.arranged.field(by, Vec::new())?.values;
        if let Arranged::Active(active) = &self.arranged {
            // Beside the active voxels of a grid nothing changes.
            let rest = self.arranged.field(&vec![T::of(T::Voxel::default()); active.len()], Vec::new())?.values;
            let channels = 0..T::Voxel::CHANNELS.len();
            for (change, rest) in change.iter_mut().zip(rest) {
                *change = channels.clone().fold(*change, |v, c| v.with(c, v.channel(c) - rest.channel(c)));
            }
        }
        Ok(change)
    }

    fn views<'v>(&'v self, cancel: &'v Cancel) -> Views<'v> {
        Views { cameras: &self.setting.cameras, rays_per_edge: self.rays_per_edge, cancel }
    }

    /// Returns the number of the transfer function's knots, if derivatives with respect to it are wanted.
    fn knots(&self, wanted: Wanted) -> Result<Option<usize>> {
        let transfer = self.setting.transfer.as_ref().filter(|_| wanted.function);
        transfer.map(|transfer| Ok(transfer.table()?.knots().len())).transpose()
    }

    /// Cuts a list of all pixels into those of each camera.
    fn by_camera<P: Clone>(&self, all: &[P]) -> Vec<Vec<P>> {
        let mut left = all;
        let of = |camera: &crate::scene::camera::Camera| {
            let (own, others) = left.split_at(left.len().min(camera.width as usize * camera.height as usize));
            left = others;
            own.to_vec()
        };
        self.setting.cameras.iter().map(of).collect()
    }

    /// Renders in double precision.
    fn render_double(&self, cancel: &Cancel) -> Result<Vec<[f64; 4]>> {
        let renderer = T::Voxel::renderer(&self.field, &self.setting)?;
        Ok(self.views(cancel).render(&renderer).ok_or_else(Error::cancelled)?.into_iter().flatten().collect())
    }

    /// Differentiates in double precision.
    fn pull_double(&self, cotangents: &[[f64; 4]], wanted: Wanted, cancel: &Cancel) -> Result<Gradient<T::Voxel>> {
        let renderer = T::Voxel::renderer(&self.field, &self.setting)?;
        let active = ActiveParameters { voxels: wanted.values, knots: self.knots(wanted)?, rays: wanted.rays };
        let cotangents = self.by_camera(cotangents);
        self.views(cancel).vjp(&renderer, &cotangents, Adjoint::Tape, active).ok_or_else(Error::cancelled)
    }

    /// Renders in single precision.
    fn render_single<I: Differentiable<Real = f32>>(
        &self,
        renderer: &Composited<I>,
        cancel: &Cancel,
    ) -> Result<Vec<[f32; 4]>> {
        let mut pixels = Vec::new();
        for camera in &self.setting.cameras {
            let rendered = film::render(renderer, camera, Sampling::grid(self.rays_per_edge), &[], cancel);
            pixels.extend(rendered.ok_or_else(Error::cancelled)?.film.rgba);
        }
        Ok(pixels)
    }

    /// Differentiates in single precision.
    fn pull_single<I>(
        &self,
        renderer: &Composited<I>,
        cotangents: &[[f32; 4]],
        wanted: Wanted,
        cancel: &Cancel,
    ) -> Result<Gradient<T::Voxel>>
    where
        I: Differentiable<Real = f32, Voxel = T::Voxel> + EmissionAbsorption<Scratch: Send + 'static>,
    {
        let rays_per_edge = self.rays_per_edge;
        let target = |(rgba, camera): (Vec<[f32; 4]>, &_)| Target { camera: *camera, rgba, rays_per_edge };
        let targets: Vec<Target> =
            self.by_camera(cotangents).into_iter().zip(&self.setting.cameras).map(target).collect();
        let targets: Vec<&Target> = targets.iter().collect();
        let knots = self.knots(wanted)?;
        let mut gradient = Gradient {
            voxels: if wanted.values { self.zeros() } else { Vec::new() },
            table: knots.map_or_else(TableGradient::default, TableGradient::of_knots),
            cameras: vec![CameraGradient::default(); targets.len()],
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
        let mut workspace: Workspace<T::Voxel, I::Scratch> = self.lattice.take();
        let (_, shared) = pictures::gradient(renderer, &targets, &loss, Adjoint::Tape, &mut workspace, &mut to);
        let bytes = workspace.bytes();
        self.lattice.keep(workspace, bytes);
        gradient.shared = shared;
        if cancel.requested() { Err(Error::cancelled()) } else { Ok(gradient) }
    }

    /// Returns a zero for each stored voxel.
    fn zeros(&self) -> Vec<T::Voxel> {
        let (GradientMemory(mut memory), all) =
            (self.lattice.take::<GradientMemory<T::Voxel>>(), self.field.values.len());
        if memory.len() != all {
            return vec![T::Voxel::default(); all];
        }
        memory.par_chunks_mut(1 << 14).for_each(|run| run.fill(T::Voxel::default()));
        memory
    }
}

/// Memory of a field.
#[derive(Debug, Default)]
struct FieldMemory<V>(Vec<V>);

/// Memory of the derivatives with respect to a field.
#[derive(Debug, Default)]
struct GradientMemory<V>(Vec<V>);

impl<T: Differentiate> Drop for ArrayScene<T> {
    fn drop(&mut self) {
        let memory = FieldMemory(std::mem::take(&mut self.field.values));
        // Of a grid, values of voxels that are not active lie in between.
        if let Arranged::Box(_) = self.arranged {
            let bytes = size_of_val(memory.0.as_slice()) as u64;
            self.lattice.keep(memory, bytes);
        }
    }
}

/// Returns the quadrature of a setting unless one is chosen: the default of pictures.
///
/// # Errors
/// As [`Transfer::table`](crate::scene::transfer::Transfer::table).
pub fn usual_quadrature(setting: &Setting) -> Result<Quadrature> {
    Ok(match &setting.transfer {
        Some(transfer) => Quadrature::usual(&Source::Transfer(Arc::new(transfer.table()?))),
        None => Quadrature::usual(&setting.source),
    })
}

impl Differentiate for f32 {
    type Real = f32;

    fn render(scene: &ArrayScene<f32>, cancel: &Cancel) -> Result<Vec<[f32; 4]>> {
        let setting = &scene.setting;
        // Knots of the transfer function that lie on a line between others are left out, as for pictures of files.
        let medium = setting.medium()?.simplified(f32::EPSILON.into());
        let dvr = Dvr::new(&scene.field, medium)?.skipping_empty().quadrature(setting.quadrature);
        scene.render_single(&dvr.over(setting.background), cancel)
    }

    fn pull(scene: &ArrayScene<f32>, by: &[[f32; 4]], wanted: Wanted, cancel: &Cancel) -> Result<Gradient<f32>> {
        scene.pull_single(&f32::renderer(&scene.field, &scene.setting)?, by, wanted, cancel)
    }
}

impl Differentiate for [f32; 4] {
    type Real = f32;

    fn render(scene: &ArrayScene<Self>, cancel: &Cancel) -> Result<Vec<[f32; 4]>> {
        scene.render_single(&glam::Vec4::renderer(&scene.field, &scene.setting)?, cancel)
    }

    fn pull(
        scene: &ArrayScene<Self>,
        by: &[[f32; 4]],
        wanted: Wanted,
        cancel: &Cancel,
    ) -> Result<Gradient<glam::Vec4>> {
        scene.pull_single(&glam::Vec4::renderer(&scene.field, &scene.setting)?, by, wanted, cancel)
    }
}

macro_rules! double {
    ($($value:ty, $voxel:ty);*) => {
        $(impl Differentiate for $value {
            type Real = f64;

            fn render(scene: &ArrayScene<Self>, cancel: &Cancel) -> Result<Vec<[f64; 4]>> {
                scene.render_double(cancel)
            }

            fn pull(
                scene: &ArrayScene<Self>,
                by: &[[f64; 4]],
                wanted: Wanted,
                cancel: &Cancel,
            ) -> Result<Gradient<$voxel>> {
                scene.pull_double(by, wanted, cancel)
            }
        })*
    };
}
double!(f64, f64; [f64; 4], glam::DVec4);
