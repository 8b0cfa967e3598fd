//! The pixels of a picture that its render is compared with once the volume is known.

use crate::inverse::observation::photo::Photo;
use crate::scene::camera::Camera;
use std::collections::BTreeSet;

/// Pairs of neighbouring pixels of a picture.
const PAIRS: usize = 2048;
/// Pixels at strides in all pictures together, about, and in each at least.
const PIXELS: usize = 1 << 15;
const FEWEST: usize = 128;

/// Returns the first pixels of pairs of horizontal neighbours, row by row, some thousand all over the picture.
pub(crate) fn pairs(width: usize, height: usize) -> impl Iterator<Item = usize> {
    let half = width / 2;
    let step = (half * height).div_ceil(PAIRS).max(1);
    (0..half * height).step_by(step).map(move |pair| pair / half * width + 2 * (pair % half))
}

/// Returns a stride at which the pixels of one of so many pictures are compared. An odd one does not fall into columns.
pub(crate) fn stride(pixels: usize, pictures: usize) -> usize {
    let enough = (PIXELS / pictures.max(1)).max(FEWEST);
    (pixels / enough).max(1) | 1
}

/// Some pixels of a picture, kept when the picture itself is not.
#[derive(Debug, Clone)]
pub(crate) struct Excerpt {
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
    /// Takes the `pairs` of neighbours of one of so many pictures, and its pixels at the `stride`.
    pub(crate) fn new(photo: &Photo, pictures: usize) -> Self {
        let Photo { camera, film, name, .. } = photo;
        let pairs = pairs(film.width, film.height).flat_map(|first| [first, first + 1]);
        let strided = (0..film.rgba.len()).step_by(stride(film.rgba.len(), pictures));
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
    pub(crate) fn all(photos: &[Photo]) -> Vec<Self> {
        photos.iter().map(|photo| Self::new(photo, photos.len())).collect()
    }

    /// Returns colors and alpha of a pixel; those of one that was not kept are NaN.
    pub(crate) fn pixel(&self, number: usize) -> [f32; 4] {
        self.numbers.binary_search(&(number as u32)).map_or([f32::NAN; 4], |at| self.colors[at])
    }

    /// True if the pixel of the picture is finite, whether it was kept or not.
    pub(crate) fn is_finite(&self, number: usize) -> bool {
        self.missing.binary_search(&(number as u32)).is_err()
    }
}
