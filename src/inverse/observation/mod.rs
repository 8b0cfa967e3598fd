//! Pictures as measurements: optical depths with weights.
//!
//! A grey medium shows `L = c (1 - T) + T b` in each channel, so the transmittance, and with it the
//! optical depth, follows from the picture alone: `T = Σ (L - c)(b - c) / Σ (b - c)²`. Absorption is
//! `c = 0`. Reconstruction is then linear in the unknown densities.

pub mod depth_map;
pub mod photo;
pub(crate) mod plane;
pub(crate) mod silhouette;
pub mod transmittances;

use crate::error::{Error, Result};
use depth_map::{DepthMap, Limit};
use photo::Photo;
use rayon::prelude::*;
use transmittances::{Channels, EMPTY, NOISY, Transmittances};

/// Optical depths of all pictures, and what is common to them.
#[derive(Debug, Clone)]
pub struct Observation {
    /// One map a view.
    pub maps: Vec<DepthMap>,
    /// Pictures with hardly any noise: what is empty has the background's very color, and what is not
    /// is about as smooth as volumes are.
    pub clean: bool,
}

impl Observation {
    /// Reads transmittances off the pictures; `background` is the radiance behind the medium and
    /// `source` that of the medium itself. Channels count by their contrast and their noise, alpha among them where it
    /// is the more exact.
    ///
    /// # Errors
    /// Those of `Observation::gather`.
    pub fn new(photos: &[Photo], background: [f32; 3], source: [f32; 3]) -> Result<Self> {
        let channels = Channels::Colors { background, source };
        Self::gather(photos.par_iter().map(|photo| Transmittances::new(photo, channels)).collect(), channels)
    }

    /// Puts together what pictures tell by themselves; `channels` are those that all were read by.
    ///
    /// # Errors
    /// If only alpha tells the medium from the background and is 1 everywhere, or a picture is mostly not finite.
    pub fn gather(pictures: Vec<Transmittances>, channels: Channels) -> Result<Self> {
        if channels.need_alpha() && pictures.iter().all(|picture| picture.opaque) {
            return Err(without_alpha(channels));
        }
        for picture in &pictures {
            let all = picture.values.len();
            if picture.bad * 10 > all {
                return Err(Error::invalid(format!("{} of {all} pixels are NaN or infinite", picture.bad))
                    .at(&picture.name)
                    .hint("render the view again, or take it out of the capture"));
            }
        }
        let pixels: usize = pictures.iter().map(|picture| picture.values.len()).sum();
        let rendered = pictures.iter().all(|picture| !picture.photograph);
        let exact = rendered && pictures.iter().map(|picture| picture.untouched).sum::<usize>() * 100 >= pixels;
        let vague = pictures.iter().any(|picture| picture.empty.is_none());
        let least_depth = if exact || !vague { EMPTY } else { haze(&pictures) };
        let noise = median(pictures.iter().filter_map(|picture| picture.noise).collect()).unwrap_or(0.0);
        let clean =
            exact && noise < NOISY && pictures.iter().all(|picture| picture.empty.is_none_or(|n| n.deviation <= EMPTY));
        let maps = pictures.into_par_iter().map(|picture| picture.depth_map(least_depth, noise, clean)).collect();
        Ok(Self { maps, clean })
    }

    /// Widens all silhouettes by a thirty-second of the pictures' shorter side, and returns them as they were: cameras
    /// that are a little off would cut one another's.
    pub fn widen_silhouettes(&mut self) -> Vec<Vec<bool>> {
        let widen = |map: &mut DepthMap| {
            let before = map.shown.clone();
            map.widen_silhouette((map.width.min(map.height) / 32).max(1));
            before
        };
        self.maps.par_iter_mut().map(widen).collect()
    }

    /// Returns the share of the pixels that show something.
    pub fn shown_share(&self) -> f64 {
        let shown: usize = self.maps.iter().map(|map| map.shown.iter().filter(|shown| **shown).count()).sum();
        let all: usize = self.maps.iter().map(|map| map.shown.len()).sum();
        shown as f64 / all.max(1) as f64
    }

    /// True if the noise of some picture has a say in what its pixels tell.
    pub fn noisy(&self) -> bool {
        self.maps.iter().any(|map| map.limit != Limit::Voxels)
    }

    /// True if some picture is a photograph.
    pub fn photographs(&self) -> bool {
        self.maps.iter().any(|map| map.limit == Limit::Light)
    }

    /// Standard deviations of the noise in the transmittances of the picture that has least and of that which has most;
    /// none where noise has no say.
    pub fn noise(&self) -> Option<[f64; 2]> {
        let noises = self.maps.iter().map(|map| map.noise);
        let range = noises.fold([f64::INFINITY, 0.0], |[least, most], n| [n.min(least), n.max(most)]);
        self.noisy().then_some(range)
    }
}

fn without_alpha(channels: Channels) -> Error {
    match channels {
        Channels::Colors { .. } => Error::invalid(
            "medium and background have the same color, and alpha is 1 in all pixels: the pictures do not show the \
             medium",
        )
        .hint(
            "render on a background of another color than the medium's, stated as 'background' in transforms.json, \
             or with alpha",
        ),
        Channels::Alpha => {
            Error::invalid("alpha is 1 in all pixels, and only alpha tells how much light this medium lets through")
                .hint("render with alpha = 1 - transmittance (in Cycles with a transparent film)")
        }
    }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Returns the distance from 1 up to which a transmittance counts as that of an empty pixel, where no pixel is exactly
/// the background: three times the distance that a tenth of all pixels stay within, at least [`EMPTY`].
fn haze(pictures: &[Transmittances]) -> f64 {
    let values = pictures.iter().flat_map(|picture| &picture.values);
    let mut distances: Vec<f32> = values.map(|t| (1.0 - t).abs()).filter(|d| d.is_finite()).collect();
    if distances.is_empty() {
        return EMPTY;
    }
    let tenth = distances.len() / 10;
    let (_, value, _) = distances.select_nth_unstable_by(tenth, f32::total_cmp);
    EMPTY.max(3.0 * f64::from(*value))
}
