//! Light transport: integrators and their derivatives.
//!
//! To read from above: [`any_renderer`] makes the renderer of a scene, [`picture`] asks it for every ray, and
//! [`composited`] puts what an `integrator` returns over the background. The integrators are [`dvr`] (a density in a
//! medium) and [`preshaded`] (emission and extinction by voxel). Both walk a ray's bricks (`march`), cut it into
//! segments ([`quadrature`], `segment`) and composite these by one driver (`compositing`). [`differentiable`] is
//! what they offer beyond a value.

pub mod any_renderer;
pub mod aov;
pub(crate) mod cell;
pub mod composited;
mod compositing;
pub(crate) mod cubic;
pub(crate) mod curve;
pub mod differentiable;
pub mod dvr;
pub(crate) mod gauss;
pub(crate) mod index_ray_gradient;
pub(crate) mod integrator;
pub(crate) mod majorant;
pub(crate) mod march;
pub mod order;
pub mod path;
pub mod preshaded;
pub mod quadrature;
pub mod sampler;
pub(crate) mod scale;
pub(crate) mod segment;
pub(crate) mod tiles;

use crate::scene::camera::Camera;
use crate::scene::film::Film;
use composited::Composited;
use integrator::Integrator;
use tiles::{Subpixels, Watch};

/// Returns RGBA of one pixel, the mean over its rays.
pub fn pixel<I: Integrator<Real = f32>>(
    renderer: &Composited<I>,
    camera: &Camera,
    rays: Subpixels,
    at: [usize; 2],
    scratch: &mut I::Scratch,
) -> [f32; 4] {
    let (mut mean, share) = ([0.0; 4], 1.0 / rays.count() as f32);
    for [x, y] in rays.positions(at) {
        let rgba = renderer.pixel_on(&camera.ray(x, y), scratch).rgba();
        mean.iter_mut().zip(rgba).for_each(|(mean, v)| *mean += share * v);
    }
    mean
}

/// Renders a picture, the mean over `rays_per_edge`² rays a pixel. Returns `None` if the watch stopped it.
pub fn picture<'w, I: Integrator<Real = f32>>(
    renderer: &Composited<I>,
    camera: &Camera,
    rays_per_edge: usize,
    watch: impl Into<Watch<'w>>,
) -> Option<Film> {
    let (size, rays) = ([camera.width as usize, camera.height as usize], Subpixels::new(rays_per_edge));
    let pixel = |scratch: &mut I::Scratch, at| pixel(renderer, camera, rays, at, scratch);
    let rgba = tiles::pixels(size, Some(watch.into()), I::Scratch::default, pixel)?;
    Some(Film { samples: rays.count() as u32, ..Film::of(size[0], size[1], rgba) })
}
