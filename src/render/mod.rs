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

use crate::scene::camera::Camera;
use crate::scene::film::Film;
use rayon::prelude::*;
pub use renderer::{Renderer, Tangent};
use std::sync::atomic::{AtomicBool, Ordering};

/// Width and height of the tiles that threads work on. Rays of a tile meet the same bricks; a band of
/// tiles is a task, and small pictures need many.
const TILE: (usize, usize) = (16, 4);

/// Renders a picture, the mean over `rays_per_edge`² rays a pixel. `None` if `cancel` was set.
pub fn picture<R: Renderer<Real = f32>>(
    renderer: &R,
    camera: &Camera,
    rays_per_edge: usize,
    cancel: &AtomicBool,
) -> Option<Film> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut film = Film::new(width, height);
    let n = rays_per_edge.max(1);
    let share = 1.0 / (n * n) as f32;
    let offset = |i: usize| (i as f64 + 0.5) / n as f64;
    // A band at a time: the first ones may be empty and the last ones not.
    let bands = film.rgba.par_chunks_mut(width * TILE.1).enumerate().with_max_len(1);
    bands.for_each_init(R::Tape::default, |tape, (band, rows)| {
        for left in (0..width).step_by(TILE.0) {
            if cancel.load(Ordering::Relaxed) {
                return;
            }
            for (row, pixels) in rows.chunks_mut(width).enumerate() {
                let y = (band * TILE.1 + row) as f64;
                for (x, pixel) in pixels.iter_mut().enumerate().skip(left).take(TILE.0) {
                    for i in 0..n * n {
                        let ray = camera.ray(x as f64 + offset(i % n), y + offset(i / n));
                        let seen = renderer.seen(&ray, tape).rgba();
                        for c in 0..4 {
                            pixel[c] += share * seen[c];
                        }
                    }
                }
            }
        }
    });
    (!cancel.load(Ordering::Relaxed)).then_some(film)
}
