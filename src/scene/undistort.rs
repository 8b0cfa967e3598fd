//! Resampling of pictures that a lens distorts to those of a pinhole camera.

use crate::error::{Error, Result};
use crate::scene::camera::{Camera, Projection, Window};
use crate::scene::film::Film;
use crate::scene::lens::Lens;
use glam::DVec2;
use rayon::prelude::*;

/// A picture as a lens shows it.
#[derive(Debug, Clone, Copy)]
pub struct Distorted<'f> {
    /// Camera without the lens: pose, focal lengths, principal point and size of the picture.
    pub camera: Camera,
    /// Lens.
    pub lens: Lens,
    /// Radius in pixels around the principal point beyond which the picture holds nothing; none for the whole raster.
    pub crop_radius: Option<f64>,
    /// Pixels; planes beside RGBA are left out.
    pub film: &'f Film,
}

impl Distorted<'_> {
    /// Resamples the picture to a pinhole camera with the same pose and focal lengths, by bilinear interpolation of
    /// scene-linear premultiplied values. The new picture is the largest rectangle of pixels that all lie between
    /// centres of the old one's pixels, so that no pixel is invented; it reaches at most half a picture beyond the old
    /// raster on each side.
    ///
    /// # Errors
    /// If the camera is orthographic, the film has another size than the camera, or no pixel of the picture is seen.
    pub fn undistort(&self) -> Result<(Camera, Film)> {
        let Self { camera, film, .. } = self;
        if camera.projection == Projection::Orthographic {
            return Err(Error::unsupported("an orthographic camera with lens distortion")
                .hint("undistort the pictures where they were made"));
        }
        if (film.width, film.height) != (camera.width as usize, camera.height as usize) {
            return Err(Error::invalid(format!(
                "the picture has {}x{} pixels, its camera {}x{}",
                film.width, film.height, camera.width, camera.height
            ))
            .hint("correct 'w' and 'h' together with 'fl_x', 'fl_y', 'cx' and 'cy'"));
        }
        let raster = self.raster();
        let window = largest_rectangle(&self.visible(&raster), raster.size[0]).ok_or_else(|| {
            Error::invalid("no pixel of the undistorted picture lies within the distorted one")
                .hint("check the coefficients of the lens, the focal lengths and the principal point")
        })?;
        let origin = [0, 1].map(|a| raster.origin[a] + i64::from(window.origin[a]));
        let [width, height] = window.size.map(|side| side as usize);
        let mut rgba = vec![[0.0; 4]; width * height];
        rgba.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let centre = DVec2::new((origin[0] + x as i64) as f64, (origin[1] + y as i64) as f64) + 0.5;
                *pixel = bilinear(film, self.source(centre));
            }
        });
        let undistorted = Camera {
            centre: camera.centre - DVec2::new(origin[0] as f64, origin[1] as f64),
            width: window.size[0],
            height: window.size[1],
            ..*camera
        };
        Ok((undistorted, Film::of(width, height, rgba)))
    }

    /// Pixels that the new picture may have: the old raster, and half of it on each side.
    fn raster(&self) -> Raster {
        let sides = [self.camera.width, self.camera.height];
        Raster { origin: sides.map(|side| -i64::from(side / 2)), size: sides.map(|side| side + 2 * (side / 2)) }
    }

    /// Position in the distorted picture of what a pinhole camera shows at an image position.
    fn source(&self, position: DVec2) -> DVec2 {
        let Camera { focal, centre, .. } = self.camera;
        centre + focal * self.lens.distort((position - centre) / focal)
    }

    /// Tells for each pixel of the raster, row by row, whether the distorted picture shows its centre.
    fn visible(&self, raster: &Raster) -> Vec<bool> {
        let Camera { focal, centre, width, height, .. } = self.camera;
        let first = DVec2::new(raster.origin[0] as f64, raster.origin[1] as f64);
        let last = first + DVec2::new(f64::from(raster.size[0]), f64::from(raster.size[1]));
        let corner = (first - centre).abs().max((last - centre).abs()) / focal;
        let valid = self.lens.valid_radius(corner.length());
        // Half a thousandth of a pixel, for the rounding of positions that fall on the outermost centres.
        let (low, high) = (0.4995, DVec2::new(f64::from(width), f64::from(height)) - 0.4995);
        let crop = self.crop_radius.unwrap_or(f64::INFINITY);
        let columns = raster.size[0] as usize;
        let mut seen = vec![false; columns * raster.size[1] as usize];
        seen.par_chunks_mut(columns).enumerate().for_each(|(y, row)| {
            for (x, seen) in row.iter_mut().enumerate() {
                let position = first + DVec2::new(x as f64, y as f64) + 0.5;
                let source = self.source(position);
                *seen = ((position - centre) / focal).length() <= valid
                    && source.min_element() >= low
                    && source.cmple(high).all()
                    && (source - centre).length() <= crop;
            }
        });
        seen
    }
}

/// Pixels of a larger raster, whose first has a place on the old one.
struct Raster {
    origin: [i64; 2],
    size: [u32; 2],
}

/// Value of a film at an image position between the centres of its pixels.
fn bilinear(film: &Film, position: DVec2) -> [f32; 4] {
    let axis = |at: f64, size: usize| {
        let at = (at - 0.5).clamp(0.0, (size - 1) as f64);
        let first = (at as usize).min(size.saturating_sub(2));
        (first, (first + 1).min(size - 1), at - first as f64)
    };
    let ((x0, x1, u), (y0, y1, v)) = (axis(position.x, film.width), axis(position.y, film.height));
    let pixel = |x: usize, y: usize, c: usize| f64::from(film.rgba[y * film.width + x][c]);
    std::array::from_fn(|c| {
        let row = |y: usize| (1.0 - u) * pixel(x0, y, c) + u * pixel(x1, y, c);
        ((1.0 - v) * row(y0) + v * row(y1)) as f32
    })
}

/// Largest rectangle of `true` in rows of `width`; `None` if there is none. One pass over the rows keeps the height of
/// the column above each pixel, and a stack finds the largest rectangle that ends in the row.
fn largest_rectangle(mask: &[bool], width: u32) -> Option<Window> {
    let columns = width as usize;
    let mut heights = vec![0_u32; columns];
    let mut best: Option<(u64, Window)> = None;
    for (y, row) in mask.chunks_exact(columns).enumerate() {
        heights.iter_mut().zip(row).for_each(|(height, set)| *height = if *set { *height + 1 } else { 0 });
        // Starts of columns of rising height.
        let mut rising: Vec<(usize, u32)> = Vec::new();
        for x in 0..=columns {
            let height = heights.get(x).copied().unwrap_or(0);
            let mut start = x;
            while let Some((from, tall)) = rising.pop_if(|(_, tall)| *tall > height) {
                let area = (x - from) as u64 * u64::from(tall);
                if best.is_none_or(|(most, _)| area > most) {
                    let origin = [from as u32, y as u32 + 1 - tall];
                    best = Some((area, Window { origin, size: [(x - from) as u32, tall] }));
                }
                start = from;
            }
            if height > 0 && rising.last().is_none_or(|(_, tall)| *tall < height) {
                rising.push((start, height));
            }
        }
    }
    best.map(|(_, window)| window)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::scene::blur::Blur;
    use glam::DMat4;

    #[test]
    fn the_largest_rectangle_is_found() {
        let mask = |rows: &[&str]| rows.concat().chars().map(|c| c == '#').collect::<Vec<_>>();
        let rows = ["..#..", ".###.", ".####", "#####", ".#.#."];
        let window = largest_rectangle(&mask(&rows), 5).unwrap();
        assert_eq!(window, Window { origin: [1, 1], size: [3, 3] });
        assert_eq!(largest_rectangle(&mask(&["....", "...."]), 4), None);
        assert_eq!(largest_rectangle(&mask(&["##", "##"]), 2).unwrap().size, [2, 2]);
        // Brute force on masks of a hash.
        let mut state = 7_u64;
        for _ in 0..200 {
            let mask: Vec<bool> = (0..42)
                .map(|_| {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    (state >> 60) > 4
                })
                .collect();
            let whole =
                |x0: usize, y0: usize, w: usize, h: usize| (y0..y0 + h).all(|y| (x0..x0 + w).all(|x| mask[y * 7 + x]));
            let mut most = 0;
            for (x, y) in (0..7).flat_map(|x| (0..6).map(move |y| (x, y))) {
                for (w, h) in (1..=7 - x).flat_map(|w| (1..=6 - y).map(move |h| (w, h))) {
                    most = most.max(if whole(x, y, w, h) { w * h } else { 0 });
                }
            }
            let Window { origin: [x, y], size: [w, h] } = largest_rectangle(&mask, 7).unwrap();
            assert!(whole(x as usize, y as usize, w as usize, h as usize));
            assert_eq!((w * h) as usize, most);
        }
    }

    fn camera(width: u32, height: u32) -> Camera {
        Camera {
            camera_to_world: DMat4::IDENTITY,
            projection: Projection::Perspective,
            focal: DVec2::new(60.0, 62.0),
            centre: DVec2::new(33.0, 23.5),
            width,
            height,
            near: 0.0,
            blur: Blur::default(),
        }
    }

    /// A smooth function of the pinhole camera's plane, which no raster has touched.
    fn radiance(plane: DVec2) -> f32 {
        (0.5 + 0.3 * (3.0 * plane.x).sin() * (2.5 * plane.y + 0.4).cos()) as f32
    }

    /// Solves `lens.distort(p) = q` by Newton's method with differences, independently of the resampling.
    fn undistorted(lens: &Lens, q: DVec2) -> DVec2 {
        let mut p = q;
        for _ in 0..50 {
            let (h, f) = (1e-6, lens.distort(p) - q);
            let dx = (lens.distort(p + DVec2::X * h) - lens.distort(p - DVec2::X * h)) / (2.0 * h);
            let dy = (lens.distort(p + DVec2::Y * h) - lens.distort(p - DVec2::Y * h)) / (2.0 * h);
            p -= glam::DMat2::from_cols(dx, dy).inverse() * f;
        }
        assert!((lens.distort(p) - q).length() < 1e-12);
        p
    }

    #[test]
    fn a_distorted_picture_of_a_known_function_becomes_that_function() {
        let lenses = [
            Lens::brown([-0.2, 0.05, 0.0, 0.0, 0.0, 0.0], [0.003, -0.002]),
            Lens::brown([0.15, 0.01, 0.002, 0.0, 0.0, 0.0], [0.0, 0.001]),
            Lens::Fisheye { radial: [-0.03, 0.004, 0.0, 0.0] },
        ];
        for lens in lenses {
            let camera = camera(64, 48);
            // The picture behind the lens: each pixel shows the function where Newton's method finds its ray.
            let mut film = Film::new(64, 48);
            for (y, x) in (0..48).flat_map(|y| (0..64).map(move |x| (y, x))) {
                let q = (DVec2::new(x as f64, y as f64) + 0.5 - camera.centre) / camera.focal;
                film.rgba[y * 64 + x] = [radiance(undistorted(&lens, q)), 1.0, 0.0, 1.0];
            }
            let distorted = Distorted { camera, lens, crop_radius: None, film: &film };
            let (flat, picture) = distorted.undistort().unwrap();
            assert_eq!((flat.width as usize, flat.height as usize), (picture.width, picture.height));
            assert!(
                picture.width * picture.height > 64 * 48 * 7 / 10,
                "{lens:?}: {}x{}",
                picture.width,
                picture.height
            );
            let mut worst = 0.0_f32;
            for (y, x) in (0..picture.height).flat_map(|y| (0..picture.width).map(move |x| (y, x))) {
                let plane = (DVec2::new(x as f64, y as f64) + 0.5 - flat.centre) / flat.focal;
                let [red, green, _, alpha] = picture.rgba[y * picture.width + x];
                worst = worst.max((red - radiance(plane)).abs());
                assert!((green - 1.0).abs() < 1e-6 && (alpha - 1.0).abs() < 1e-6, "no border shines through");
            }
            // Bilinear interpolation errs by at most the sum of |∂²| / 8 over both axes: 0.3 (3² + 2.5²) / 8 in units
            // of a pixel's plane size squared, 1/60², and the lens stretches by less than 1.5.
            let bound = (0.3 * (9.0 + 6.25) / 8.0 * (1.5_f32 / 60.0).powi(2)).max(1e-6);
            assert!(worst < bound, "{lens:?}: {worst} of {bound}");
        }
    }

    #[test]
    fn a_pinhole_keeps_its_picture_and_a_circle_is_cropped() {
        let camera = camera(20, 16);
        let mut film = Film::new(20, 16);
        film.rgba.iter_mut().enumerate().for_each(|(i, p)| *p = [i as f32, 0.0, 0.0, 1.0]);
        let whole = Distorted { camera, lens: Lens::Pinhole, crop_radius: None, film: &film };
        let (same, picture) = whole.undistort().unwrap();
        assert_eq!((same, &picture.rgba), (camera, &film.rgba));
        let centred = Camera { centre: DVec2::new(10.0, 8.0), ..camera };
        let circle = Distorted { camera: centred, crop_radius: Some(6.0), ..whole };
        let (small, _) = circle.undistort().unwrap();
        let half = DVec2::new(f64::from(small.width), f64::from(small.height)) / 2.0 - 0.5;
        assert!(half.length() <= 6.0 && small.width >= 8, "{small:?}");
        let nothing = Distorted { crop_radius: Some(0.1), ..circle };
        assert!(nothing.undistort().unwrap_err().remedy().is_some());
    }
}
