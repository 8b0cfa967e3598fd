//! The pixels of a picture that its render is compared with once the volume is known.

use super::{displacement, residuals};
use crate::optimise::projection::photo::Photo;
use crate::scene::camera::Camera;
use std::collections::BTreeSet;

/// Some pixels of a picture, kept when the picture itself is not.
#[derive(Debug, Clone)]
pub struct Excerpt {
    /// Camera of the picture.
    pub camera: Camera,
    /// Named in messages: the file.
    pub name: String,
    /// Numbers of pixels, row by row, ascending.
    numbers: Vec<u32>,
    /// Colors and alpha of those pixels.
    colors: Vec<[f32; 4]>,
    /// Numbers of all pixels that are not finite, ascending.
    missing: Vec<u32>,
}

impl Excerpt {
    /// Takes the pixels that [`Residuals`](residuals::Residuals) and [`displacements`](displacement::displacements)
    /// look at, of one of so many pictures.
    pub fn new(photo: &Photo, pictures: usize) -> Self {
        let Photo { camera, film, name, .. } = photo;
        let pairs = residuals::pairs(film.width, film.height).flat_map(|first| [first, first + 1]);
        let strided = (0..film.rgba.len()).step_by(displacement::stride(film.rgba.len(), pictures));
        let numbers: BTreeSet<usize> = pairs.chain(strided).collect();
        let missing = (0..film.rgba.len()).filter(|i| film.rgba[*i].iter().any(|v| !v.is_finite()));
        Self {
            camera: *camera,
            name: name.clone(),
            colors: numbers.iter().map(|i| film.rgba[*i]).collect(),
            numbers: numbers.into_iter().map(|i| i as u32).collect(),
            missing: missing.map(|i| i as u32).collect(),
        }
    }

    /// Takes the pixels of every picture.
    pub fn all(photos: &[Photo]) -> Vec<Self> {
        photos.iter().map(|photo| Self::new(photo, photos.len())).collect()
    }

    /// Returns colors and alpha of a pixel; those of one that was not kept are NaN.
    pub fn pixel(&self, number: usize) -> [f32; 4] {
        self.numbers.binary_search(&(number as u32)).map_or([f32::NAN; 4], |at| self.colors[at])
    }

    /// True if the pixel of the picture is finite, whether it was kept or not.
    pub fn is_finite(&self, number: usize) -> bool {
        self.missing.binary_search(&(number as u32)).is_err()
    }
}
