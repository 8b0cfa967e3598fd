//! Light on its way through the scene.

pub mod dvr;
pub mod film;
pub mod march;
pub mod quadrature;
pub mod scale;

use crate::scene::camera::Camera;
use dvr::Dvr;
use film::Film;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// Edge of the tiles that threads work on: rays of a tile meet the same bricks.
const TILE: usize = 16;

/// Renders a picture, the mean over `rays_per_edge`² rays a pixel. `None` if `cancel` was set.
pub fn picture(dvr: &Dvr<'_, f32>, camera: &Camera, rays_per_edge: usize, cancel: &AtomicBool) -> Option<Film> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut film = Film::new(width, height);
    let n = rays_per_edge.max(1);
    let share = 1.0 / (n * n) as f32;
    let arch = pulp::Arch::new();
    film.rgba.par_chunks_mut(width * TILE).enumerate().for_each(|(band, rows)| {
        for x0 in (0..width).step_by(TILE) {
            if cancel.load(Ordering::Relaxed) {
                return;
            }
            arch.dispatch(
                #[inline(always)]
                || {
                    for (row, pixels) in rows.chunks_mut(width).enumerate() {
                        let y = (band * TILE + row) as f64;
                        for (x, pixel) in pixels.iter_mut().enumerate().skip(x0).take(TILE) {
                            for i in 0..n * n {
                                let offset = |i: usize| (i as f64 + 0.5) / n as f64;
                                let ray = camera.ray(x as f64 + offset(i % n), y + offset(i / n));
                                let seen = dvr.radiance(&ray).rgba();
                                for c in 0..4 {
                                    pixel[c] += share * seen[c];
                                }
                            }
                        }
                    }
                },
            );
        }
    });
    (!cancel.load(Ordering::Relaxed)).then_some(film)
}
