//! Objects that hide what is behind them, told by the depth of each pixel or by their surfaces.

use crate::error::{Error, Result};
use crate::math::Ray;
use crate::scene::camera::{Camera, Projection, Window};
use crate::scene::surfaces::Surfaces;
use glam::DVec2;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Distance that depths are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DepthMeasure {
    /// Distance along the viewing axis, as in the passes of Blender and most renderers.
    #[default]
    Axis,
    /// Distance from the camera along the ray.
    Ray,
}

/// Objects that hide all that is behind them, the background included.
#[derive(Debug, Clone)]
pub enum Holdout {
    /// Depths of pixels.
    Depths(DepthMap),
    /// Surfaces.
    Surfaces(Arc<Surfaces>),
}

impl Holdout {
    /// Returns the length along a ray of unit direction, drawn at a place of the picture in pixels, beyond which
    /// nothing is seen.
    pub(crate) fn far(&self, camera: &Camera, place: DVec2, ray: &Ray) -> f64 {
        let far = match self {
            Self::Depths(depths) => depths.far(camera, place, ray),
            Self::Surfaces(surfaces) => surfaces.nearest(ray).unwrap_or(f64::MAX),
        };
        // Where nothing stands, rays end as well: what is before an object, and never the background.
        far.clamp(0.0, f64::MAX)
    }
}

/// Depths in world units beyond which a camera sees nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthMap {
    size: [usize; 2],
    /// Row by row from the top; infinite where nothing is.
    depths: Vec<f32>,
    measure: DepthMeasure,
    /// Column and row of the picture's first pixel in the picture that the depths are of, and that picture's size.
    origin: DVec2,
    whole: DVec2,
}

impl DepthMap {
    /// Creates a holdout from depths row by row from the top, [height, width], of a whole picture or of more pixels
    /// than it has, in the same proportions. A part of the picture that is rendered is given by its window.
    ///
    /// # Errors
    /// If a depth is negative or not a number, or the proportions are others than those of the picture.
    pub fn new(
        size: [usize; 2],
        depths: Vec<f32>,
        measure: DepthMeasure,
        (whole, part): ([u32; 2], Option<Window>),
    ) -> Result<Self> {
        if let Some(place) = depths.iter().position(|depth| depth.is_nan() || *depth < 0.0) {
            let [column, row] = [place % size[0], place / size[0]];
            return Err(Error::invalid(format!("the depth at column {column}, row {row} is {}", depths[place]))
                .hint("depths are from 0 on, and infinite or large where nothing stands"));
        }
        let [across, down] = [0, 1].map(|axis| size[axis] as f64 / f64::from(whole[axis]));
        if depths.len() != size[0] * size[1] || depths.is_empty() || (across - down).abs() > 1e-3 * across {
            return Err(Error::invalid(format!(
                "depths of {}x{} pixels for a picture of {}x{}",
                size[0], size[1], whole[0], whole[1]
            ))
            .hint("render the depths with the same camera, in the size of the picture or a multiple of it"));
        }
        let origin = part.map_or([0; 2], |part| part.origin).map(f64::from).into();
        Ok(Self { size, depths, measure, origin, whole: whole.map(f64::from).into() })
    }

    /// Returns the share of the pixels at which something stands at the camera itself, and hides all.
    pub fn at_camera(&self) -> f64 {
        self.depths.iter().filter(|depth| **depth == 0.0).count() as f64 / self.depths.len() as f64
    }

    /// Returns the number of depths along an edge of a pixel.
    pub fn per_edge(&self) -> f64 {
        self.size[0] as f64 / self.whole.x
    }

    /// Returns the length along a ray of unit direction, drawn at a place of the picture in pixels, beyond which
    /// nothing is seen.
    fn far(&self, camera: &Camera, place: DVec2, ray: &Ray) -> f64 {
        let share = (place + self.origin) / self.whole;
        let at = |axis: usize| ((share[axis] * self.size[axis] as f64) as usize).min(self.size[axis] - 1);
        let depth = f64::from(self.depths[at(1) * self.size[0] + at(0)]);
        let from = ray.origin - camera.position();
        match (self.measure, camera.projection) {
            (DepthMeasure::Ray, Projection::Perspective) => depth - from.dot(ray.direction),
            _ => (depth - from.dot(camera.forward())) / ray.direction.dot(camera.forward()),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::scene::blur::{Aperture, Blur};
    use glam::DVec3;

    fn camera(projection: Projection) -> Camera {
        Camera {
            camera_to_world: Camera::look_at(DVec3::new(3.0, -2.0, 1.5), DVec3::new(0.1, 0.2, 0.3), DVec3::Z),
            projection,
            focal: DVec2::new(9.0, 11.0),
            centre: DVec2::new(3.0, 2.5),
            width: 6,
            height: 4,
            near: 0.25,
            blur: Blur::default(),
        }
    }

    #[test]
    fn rays_end_at_the_stated_depth() {
        let depths: Vec<f32> = (0..96).map(|i| 1.0 + 0.1 * i as f32).collect();
        for projection in [Projection::Perspective, Projection::Orthographic] {
            for blur in [Blur::default(), Blur { aperture: Some(Aperture::disc(0.2, 2.0)), shutter: None }] {
                let camera = Camera { blur, ..camera(projection) };
                let of = |measure| DepthMap::new([12, 8], depths.clone(), measure, ([6, 4], None)).unwrap();
                // Twice as many pixels as the picture: column 3, row 5.
                let (place, depth) = (DVec2::new(1.7, 2.6), f64::from(depths[5 * 12 + 3]));
                let ray = camera.blurred_ray(place.into(), [0.3, 0.8], 0.5);
                let end = ray.at(of(DepthMeasure::Axis).far(&camera, place, &ray)) - camera.position();
                assert!((end.dot(camera.forward()) - depth).abs() < 1e-9, "{projection:?} {end}");
                let end = ray.at(of(DepthMeasure::Ray).far(&camera, place, &ray)) - camera.position();
                let measured = match projection {
                    Projection::Perspective if blur.is_none() => end.length(),
                    Projection::Perspective => continue,
                    Projection::Orthographic => end.dot(camera.forward()),
                };
                assert!((measured - depth).abs() < 1e-9, "{projection:?} {end}");
            }
        }
        // A part of the picture takes the depths of its pixels; what is nearer than the near plane hides all.
        let whole = camera(Projection::Perspective);
        let part = Window { origin: [2, 1], size: [3, 2] };
        let held = DepthMap::new([6, 4], depths[..24].to_vec(), DepthMeasure::Axis, ([6, 4], Some(part))).unwrap();
        let ray = whole.cropped(part).unwrap().ray(0.5, 0.5);
        let end = ray.at(held.far(&whole.cropped(part).unwrap(), DVec2::splat(0.5), &ray)) - whole.position();
        assert!((end.dot(whole.forward()) - f64::from(depths[6 + 2])).abs() < 1e-9);
        let close = DepthMap::new([6, 4], vec![0.1; 24], DepthMeasure::Axis, ([6, 4], None)).unwrap();
        assert_eq!(Holdout::Depths(close).far(&whole, DVec2::ONE, &whole.ray(1.0, 1.0)), 0.0);
    }

    #[test]
    fn depths_that_cannot_be_used_are_refused() {
        let made = |size, depths| DepthMap::new(size, depths, DepthMeasure::Axis, ([4, 2], None));
        assert_eq!(made([4, 2], vec![0.0, 0.0, 1.0, 2.0, f32::INFINITY, 1.0, 1.0, 1.0]).unwrap().at_camera(), 0.25);
        for bad in [f32::NAN, -1.0] {
            let mut depths = vec![1.0; 8];
            depths[6] = bad;
            assert!(made([4, 2], depths).unwrap_err().to_string().contains("column 2, row 1"));
        }
        assert!(made([2, 2], vec![1.0; 4]).unwrap_err().to_string().contains("2x2"));
    }
}
