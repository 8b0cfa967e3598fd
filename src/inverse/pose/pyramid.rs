//! Pictures of an image pyramid: each has half the size of the one before.

use crate::differentiate::gradient::pictures::Target;
use crate::scene::camera::Camera;

/// Pixels along the shorter side of the smallest pictures, at least.
const COARSEST: u32 = 8;
/// Rays along the edge of a pixel of a smaller picture, at most: pixels that are means of many see shells thinner than
/// themselves, which a few rays would miss.
const MOST_RAYS: usize = 4;

/// Returns how often a picture is halved before the search begins.
pub fn levels(camera: &Camera) -> usize {
    let shorter = camera.width.min(camera.height);
    (1..32).take_while(|level| shorter >> level >= COARSEST).count()
}

/// A picture and its halves, the smallest last.
pub(crate) fn pyramid(target: &Target) -> Vec<Target> {
    let mut all = vec![target.clone()];
    for _ in 0..levels(&target.camera) {
        let next = halved(&all[all.len() - 1]);
        all.push(next);
    }
    all
}

/// Returns a picture of half the size: means over two by two pixels (an odd row or column is left out), with its
/// camera.
pub fn halved(target: &Target) -> Target {
    let camera = shrunk(&target.camera, 1);
    let (w, from) = (camera.width as usize, target.camera.width as usize);
    let mean = |i: usize| {
        let corner = 2 * (i / w) * from + 2 * (i % w);
        let four = [0, 1, from, from + 1].map(|k| target.rgba[corner + k]);
        // One that asks for nothing leaves nothing that could be asked for.
        std::array::from_fn(|c| 0.25 * four.iter().map(|p| p[c]).sum::<f32>())
    };
    let rgba = (0..w * camera.height as usize).map(mean).collect();
    Target { camera, rgba, rays_per_edge: (2 * target.rays_per_edge).min(target.rays_per_edge.max(MOST_RAYS)) }
}

/// The camera of a picture that was halved so many times.
pub(crate) fn shrunk(camera: &Camera, level: usize) -> Camera {
    let share = 0.5_f64.powi(level as i32);
    Camera {
        focal: share * camera.focal,
        centre: share * camera.centre,
        width: camera.width >> level,
        height: camera.height >> level,
        ..*camera
    }
}
