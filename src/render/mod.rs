//! Light on its way through the scene.

pub mod arch;
pub mod cell;
pub mod cubic;
pub mod curve;
pub mod dvr;
pub mod film;
pub mod gauss;
pub mod march;
pub mod order;
pub mod quadrature;
pub mod rule;
pub mod scale;
pub mod segment;

use crate::scene::camera::Camera;
use arch::Arch;
use dvr::{Dvr, Tape};
use film::Film;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// Width and height of the tiles that threads work on. Rays of a tile meet the same bricks; a band of
/// tiles is a task, and small pictures need many.
const TILE: (usize, usize) = (16, 4);

/// Renders a picture, the mean over `rays_per_edge`² rays a pixel. `None` if `cancel` was set.
pub fn picture(dvr: &Dvr<'_, f32>, camera: &Camera, rays_per_edge: usize, cancel: &AtomicBool) -> Option<Film> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut film = Film::new(width, height);
    let arch = Arch::default();
    film.rgba.par_chunks_mut(width * TILE.1).enumerate().for_each(|(band, rows)| {
        for left in (0..width).step_by(TILE.0) {
            if cancel.load(Ordering::Relaxed) {
                return;
            }
            arch.dispatch(Tile { dvr, camera, rays_per_edge: rays_per_edge.max(1), rows, top: band * TILE.1, left });
        }
    });
    (!cancel.load(Ordering::Relaxed)).then_some(film)
}

/// A tile of the film: the unit that is compiled once for each instruction set. (A closure would not
/// do: its call is compiled for the oldest one.)
struct Tile<'a, 'd> {
    dvr: &'a Dvr<'d, f32>,
    camera: &'a Camera,
    rays_per_edge: usize,
    /// Whole rows of the film.
    rows: &'a mut [[f32; 4]],
    top: usize,
    left: usize,
}

impl pulp::NullaryFnOnce for Tile<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let n = self.rays_per_edge;
        let share = 1.0 / (n * n) as f32;
        let mut tape = Tape::default();
        for (row, pixels) in self.rows.chunks_mut(self.camera.width as usize).enumerate() {
            let y = (self.top + row) as f64;
            for (x, pixel) in pixels.iter_mut().enumerate().skip(self.left).take(TILE.0) {
                for i in 0..n * n {
                    let offset = |i: usize| (i as f64 + 0.5) / n as f64;
                    let ray = self.camera.ray(x as f64 + offset(i % n), y + offset(i / n));
                    let seen = self.dvr.radiance_with(&ray, &mut tape).rgba();
                    for c in 0..4 {
                        pixel[c] += share * seen[c];
                    }
                }
            }
        }
    }
}
