//! Light on its way through the scene.

pub mod arch;
pub mod cell;
pub mod cubic;
pub mod curve;
pub mod dvr;
pub mod gauss;
pub mod march;
pub mod moved;
pub mod order;
pub mod preshaded;
pub mod quadrature;
pub mod renderer;
pub mod rule;
pub mod scale;
pub mod segment;
pub mod tiles;

use crate::scene::camera::Camera;
use crate::scene::film::Film;
pub use renderer::{Renderer, Tangent};
use std::sync::atomic::AtomicBool;
use tiles::Subpixels;

/// RGBA of one pixel, the mean over its rays.
pub fn pixel<R: Renderer<Real = f32>>(
    renderer: &R,
    camera: &Camera,
    rays: Subpixels,
    at: [usize; 2],
    tape: &mut R::Tape,
) -> [f32; 4] {
    let (mut mean, share) = ([0.0; 4], 1.0 / rays.count() as f32);
    for [x, y] in rays.positions(at) {
        let seen = renderer.seen(&camera.ray(x, y), tape).rgba();
        mean.iter_mut().zip(seen).for_each(|(mean, v)| *mean += share * v);
    }
    mean
}

/// Renders a picture, the mean over `rays_per_edge`² rays a pixel. `None` if `cancel` was set.
pub fn picture<R: Renderer<Real = f32>>(
    renderer: &R,
    camera: &Camera,
    rays_per_edge: usize,
    cancel: &AtomicBool,
) -> Option<Film> {
    let (size, rays) = ([camera.width as usize, camera.height as usize], Subpixels::new(rays_per_edge));
    let pixel = |tape: &mut R::Tape, at| pixel(renderer, camera, rays, at, tape);
    let rgba = tiles::pixels(size, Some(cancel), R::Tape::default, pixel)?;
    Some(Film { samples: rays.count() as u32, ..Film::of(size[0], size[1], rgba) })
}
