//! The film: the one loop from the rays of pixels to the planes of a picture, for every integrator.

mod aov;
mod blocks;
mod bytes;
mod halves;
mod pixel;
mod replicates;
mod sampling;
mod stored;
mod sum;
mod view;

pub use aov::Aov;
pub use blocks::{Blocks, EDGE};
pub use bytes::bytes_per_pixel;
pub use replicates::{FEWEST, PixelSums, Replicates};
pub use sampling::{Sampling, Subpixels};
pub use sum::Sum;
pub use view::View;

use crate::cancel::Cancel;
use crate::render::integrator::{Counts, Integrator};
use crate::render::sampler::Sampler;
use crate::render::tiles::{self, Watch};
use crate::scene::film::{Film, Plane};
use aov::Layer;
use glam::DVec4;
use pixel::Pixel;
use sampling::Shot;

/// A picture with the number of events that it took.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    /// Picture.
    pub film: Film,
    /// Events.
    pub counts: Counts,
}

/// Rays after which a pixel looks whether it is to stop.
const RAYS_BETWEEN_LOOKS: u32 = 128;

/// Planes of a picture that are asked for, and what they take.
struct Planes<'a> {
    aovs: &'a [Aov],
    /// Layers that pixels have one by one.
    layers: Vec<Layer>,
    /// Number of their channels.
    stride: usize,
    depth: bool,
    /// True if slopes are looked up.
    normals: bool,
    /// True if places in other frames are looked up.
    motion: bool,
    variance: bool,
    /// True if a pixel's rays are drawn in two independent halves.
    in_halves: bool,
}

impl<'a> Planes<'a> {
    fn new(aovs: &'a [Aov], sampling: &Sampling) -> Self {
        let layers: Vec<Layer> = aovs.iter().flat_map(|aov| aov.layers()).collect();
        let asks = |aov| aovs.contains(&aov);
        Self {
            aovs,
            stride: layers.iter().map(|layer| layer.channels.len()).sum(),
            layers,
            depth: asks(Aov::OpticalDepth),
            normals: asks(Aov::Normal),
            motion: aovs.iter().any(|aov| aov.of_frames()),
            variance: asks(Aov::Variance),
            in_halves: sampling.is_random() && (asks(Aov::Variance) || asks(Aov::Halves)),
        }
    }

    /// Begins the values of a band of pixels.
    fn band(&self, pixels: usize) -> Band {
        Band {
            values: vec![0.0; pixels * self.stride],
            variances: vec![<[DVec4; 2]>::default(); if self.variance { pixels } else { 0 }],
            counts: Counts::default(),
        }
    }

    /// Returns a whole picture's values: of pixels whose sums over replicates are given.
    fn filled(&self, pixels: &[Pixel], sums: &[PixelSums]) -> Band {
        let mut band = self.band(sums.len());
        let values = band.values.chunks_mut(self.stride.max(1));
        for ((pixel, sums), values) in pixels.iter().zip(sums).zip(values) {
            self.put(values, pixel, u32::try_from(sums.paths).unwrap_or(u32::MAX));
        }
        for (variances, sums) in band.variances.iter_mut().zip(sums) {
            *variances = [DVec4::from_array(sums.variance()); 2];
        }
        band
    }

    /// Puts the values of a pixel, the mean of a number of estimates, into a band.
    fn put(&self, values: &mut [f32], pixel: &Pixel, samples: u32) {
        let mut values = values.iter_mut();
        for Layer { channels, value, .. } in &self.layers {
            values.by_ref().zip(value(pixel, samples)).take(channels.len()).for_each(|(to, v)| *to = v);
        }
    }

    /// Returns the planes of a picture of this width, in the order in which they were asked for.
    fn collect(&self, width: usize, bands: &[Band]) -> Vec<Plane> {
        let (mut planes, mut at) = (Vec::new(), 0);
        for aov in self.aovs {
            for Layer { name, channels, .. } in aov.layers() {
                for channel in channels {
                    let of =
                        |band: &Band| band.values.iter().skip(at).step_by(self.stride).copied().collect::<Vec<_>>();
                    planes.push(plane(name, channel, bands.iter().flat_map(of).collect()));
                    at += 1;
                }
            }
            if *aov == Aov::Variance {
                let variances = halves::variances(width, bands.iter().flat_map(|band| &band.variances));
                for (c, channel) in ["R", "G", "B", "A"].into_iter().enumerate() {
                    planes.push(plane("variance", channel, variances.iter().map(|v| v[c]).collect()));
                }
            }
        }
        planes
    }
}

/// Creates a channel of a layer.
fn plane(layer: &str, channel: &str, samples: Vec<f32>) -> Plane {
    Plane { name: format!("{layer}.{channel}"), samples }
}

/// Values that a band of pixels has beside their colors.
struct Band {
    /// Channels of the layers, pixel by pixel.
    values: Vec<f32>,
    /// Variances of pixels, as [`Pixel::variances`] gives them, where they are asked for.
    variances: Vec<[DVec4; 2]>,
    counts: Counts,
}

/// Renders a picture, the mean over the rays of each pixel, with the requested planes beside RGBA. Returns `None` if
/// the watch stopped it.
///
/// With the planes [`Aov::Variance`] or [`Aov::Halves`] random paths are drawn in two independent halves, which cover a
/// pixel a little less evenly: the picture has other noise, and somewhat more of it.
pub fn render<'c, 'w, I: Integrator>(
    integrator: &I,
    view: impl Into<View<'c>>,
    sampling: Sampling,
    aovs: &[Aov],
    watch: impl Into<Watch<'w>>,
) -> Option<Rendered> {
    let (view, watch) = (view.into(), watch.into());
    let size = [view.camera.width as usize, view.camera.height as usize];
    let planes = Planes::new(aovs, &sampling);
    let shoot = Shoot { integrator, view: &view, sampling: &sampling, planes: &planes, cancel: watch.cancel };
    let pixel = |scratch: &mut I::Scratch, at, (band, index): (&mut Band, usize)| {
        let pixel = shoot.pixel(scratch, at, &mut band.counts);
        planes.put(&mut band.values[index * planes.stride..][..planes.stride], &pixel, sampling.samples());
        if planes.variance {
            band.variances[index] = pixel.variances(planes.in_halves);
        }
        pixel.rgba()
    };
    let (rgba, bands) = tiles::pixels(size, watch, I::Scratch::default, |pixels| planes.band(pixels), pixel)?;
    let film = Film {
        samples: sampling.samples(),
        planes: planes.collect(size[0], &bands),
        ..Film::of(size[0], size[1], rgba)
    };
    Some(Rendered { film, counts: bands.iter().fold(Counts::default(), |sum, band| sum.plus(band.counts)) })
}

/// A picture as its pixels need it.
struct Shoot<'s, 'c, I> {
    integrator: &'s I,
    view: &'s View<'c>,
    sampling: &'s Sampling,
    planes: &'s Planes<'s>,
    cancel: &'s Cancel,
}

impl<I: Integrator> Shoot<'_, '_, I> {
    /// Returns the sums over the rays of a pixel, and adds the events to `counts`. A pixel whose work is cancelled has
    /// fewer rays.
    #[inline(always)]
    fn pixel(&self, scratch: &mut I::Scratch, at: [usize; 2], counts: &mut Counts) -> Pixel {
        let Self { integrator, view, sampling, planes, cancel } = self;
        let (per_ray, mut pixel) = (sampling.per_ray(), Pixel::default());
        for number in 0..sampling.samples() / per_ray {
            // A pixel of many paths must not keep an interrupted program waiting.
            if number % RAYS_BETWEEN_LOOKS == 0 && cancel.requested() {
                break;
            }
            let shot = sampling.shot(at, number, planes.in_halves);
            let ray = view.held_out(shot.ray(view.camera), shot.place);
            let Shot { place, half, seed, pixel: in_whole, paths, .. } = shot;
            let primary = integrator.primary(&ray, scratch);
            let mut of_ray = [0.0; 4];
            if planes.depth {
                pixel.optical_depth += f64::from(per_ray) * integrator.optical_depth(&ray, &primary, scratch);
            }
            for path in paths {
                let mut sampler = Sampler::new(seed, in_whole, path);
                // The first set of numbers is that of the ray's place.
                sampler.skip_stratified();
                let mut sample = integrator.li(&ray, &primary, &mut sampler, scratch);
                if let Some(most) = sampling.clamp {
                    sample.clamp(most, counts);
                }
                of_ray.iter_mut().zip(sample.rgba()).for_each(|(sum, v)| *sum += f64::from(v) / f64::from(per_ray));
                if planes.stride > 0 {
                    pixel.add(view.camera, &sample);
                }
                for first in [&sample.first, &sample.surface].into_iter().flatten() {
                    if planes.normals {
                        pixel.normal += f64::from(first.share) * integrator.normal(&primary, first);
                    }
                    if planes.motion {
                        pixel.add_motion(first, view.motion(first, place));
                    }
                }
            }
            pixel.add_ray(half, of_ray);
        }
        *counts = counts.plus(I::take_counts(scratch));
        pixel
    }
}
