//! Denoisers of a frame's layers, in one direction of time.

use super::shot::{Layer, Shot};
use crate::denoise::{Denoised, Denoiser, Frame, Method, Settings, fused};
use crate::error::Result;
use glam::{Vec2, Vec3};
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Number of blocks of a thumbnail along its sides.
const THUMBNAIL: usize = 16;

/// Mean colors of parts of a picture, by which cuts are found.
pub type Thumbnail = Vec<Vec3>;

/// Rows and columns of which one is looked at for a thumbnail.
const LOOK: usize = 2;

/// Returns the mean colors of the finite pixels of parts of a picture.
pub fn thumbnail(color: &[Vec3], [width, height]: [usize; 2]) -> Thumbnail {
    let mut sums = vec![(Vec3::ZERO, 0.0_f32); THUMBNAIL * THUMBNAIL];
    let bins: Vec<usize> = (0..width).map(|x| x * THUMBNAIL / width).collect();
    for (y, row) in color.chunks(width).enumerate().step_by(LOOK) {
        let sums = &mut sums[y * THUMBNAIL / height * THUMBNAIL..][..THUMBNAIL];
        for (color, bin) in row.iter().zip(&bins).step_by(LOOK).filter(|(color, _)| color.is_finite()) {
            let (sum, count) = &mut sums[*bin];
            *sum += color.abs();
            *count += 1.0;
        }
    }
    sums.into_iter().map(|(sum, count)| sum / count.max(1.0)).collect()
}

/// Share of the light of two pictures that lies elsewhere in the other, above which a cut lies between them.
const CUT: f32 = 0.5;

/// True if two pictures show different shots.
pub fn is_cut(a: &Thumbnail, b: &Thumbnail) -> bool {
    let pairs = || a.iter().zip(b);
    let apart: f32 = pairs().map(|(a, b)| (*a - *b).abs().element_sum()).sum();
    let all: f32 = pairs().map(|(a, b)| (*a + *b).element_sum()).sum();
    apart > CUT * all
}

/// Denoisers of the layers, in one direction of time.
#[derive(Debug)]
pub struct Pass {
    denoisers: Vec<Denoiser>,
    /// The frame before in this direction: number, thumbnail, and its motion to the frame before in the other direction.
    last: Option<(u32, Thumbnail, Option<Vec<Vec2>>)>,
}

impl Pass {
    /// Creates a pass over so many layers.
    ///
    /// # Errors
    /// If the settings cannot be used.
    pub fn new(layers: usize, method: Method, settings: Settings) -> Result<Self> {
        let denoisers = (0..layers).map(|_| Denoiser::new(method, settings)).collect::<Result<_>>()?;
        Ok(Self { denoisers, last: None })
    }

    /// Forgets all.
    pub fn reset(&mut self) {
        self.denoisers.iter_mut().for_each(Denoiser::reset);
        self.last = None;
    }

    /// Denoises the layers of the next frame. Returns true if it begins a shot.
    ///
    /// # Errors
    /// If its layers contradict its size.
    pub fn denoise(&mut self, number: u32, shot: &Shot, cuts: bool) -> Result<(Vec<Denoised>, bool)> {
        let small = thumbnail(&shot.layers[0].color, shot.size);
        let cut = cuts && self.last.as_ref().is_some_and(|(_, last, _)| is_cut(last, &small));
        if cut {
            self.reset();
        }
        // A motion spans as many frames as lie between.
        let gap = self.last.as_ref().map_or(1, |(last, ..)| last.abs_diff(number).max(1)) as f32;
        let turned = || {
            // What the last frame knows of its way here, turned round, where this one knows nothing.
            let (.., away) = self.last.as_ref()?;
            away.as_ref().map(|away| away.iter().map(|motion| -*motion).collect::<Vec<_>>())
        };
        let motion: Option<Cow<'_, [Vec2]>> = match &shot.moved.toward {
            Some(motion) if gap == 1.0 => Some(motion.into()),
            Some(motion) => Some(motion.iter().map(|motion| *motion * gap).collect()),
            None => turned().map(Cow::Owned),
        };
        let layers = shot.layers.iter().zip(&mut self.denoisers);
        let of = |(Layer { color, alpha }, denoiser): (&Layer, &mut Denoiser)| {
            let alpha = alpha.as_ref().map(|alpha| &alpha[..]);
            denoiser.denoise(&Frame { size: shot.size, color, motion: motion.as_deref(), alpha })
        };
        let denoised = layers.map(of).collect::<Result<_>>()?;
        self.last = Some((number, small, shot.moved.away.clone()));
        Ok((denoised, cut))
    }
}

/// Passes in both directions of time.
#[derive(Debug)]
pub struct Directions {
    method: Method,
    settings: Settings,
    find_cuts: bool,
    /// Forward and backward; the number of layers is known from the first frame on.
    passes: Option<[Pass; 2]>,
    /// Results of the backward pass, by number of frame.
    kept: BTreeMap<u32, Vec<Denoised>>,
}

impl Directions {
    /// Creates passes that have seen nothing.
    pub fn new(method: Method, settings: Settings, find_cuts: bool) -> Self {
        Self { method, settings, find_cuts, passes: None, kept: BTreeMap::new() }
    }

    /// Begins a piece of work that depends on nothing before.
    pub fn begin(&mut self) {
        self.passes.iter_mut().flatten().for_each(Pass::reset);
        self.kept.clear();
    }

    /// Begins to look backwards.
    pub fn turn(&mut self) {
        self.passes.iter_mut().for_each(|[_, backward]| backward.reset());
    }

    /// Denoises the next frame backwards.
    ///
    /// # Errors
    /// If the settings cannot be used, or layers contradict their size.
    pub fn look(&mut self, number: u32, shot: &Shot, keep: bool) -> Result<()> {
        let cuts = self.find_cuts;
        let (denoised, _) = self.passes(shot)?[1].denoise(number, shot, cuts)?;
        if keep {
            self.kept.insert(number, denoised);
        }
        Ok(())
    }

    /// Denoises the next frame forwards, and fuses the result with the one backwards if there is one. Returns true if it
    /// begins a shot.
    ///
    /// # Errors
    /// If the settings cannot be used, or layers contradict their size.
    pub fn denoise(&mut self, number: u32, shot: &Shot) -> Result<(Vec<Denoised>, bool)> {
        let cuts = self.find_cuts;
        let [forward, backward] = self.passes(shot)?;
        // Its memory serves others until frames are looked at backwards again.
        backward.reset();
        let (denoised, cut) = forward.denoise(number, shot, cuts)?;
        let denoised = match self.kept.remove(&number) {
            Some(backward) => denoised.into_iter().zip(&backward).map(|(f, b)| fused(f, b)).collect(),
            None => denoised,
        };
        Ok((denoised, cut))
    }

    fn passes(&mut self, shot: &Shot) -> Result<&mut [Pass; 2]> {
        let layers = shot.layers.len();
        let pass = || Pass::new(layers, self.method, self.settings);
        match &mut self.passes {
            Some(passes) => Ok(passes),
            empty => Ok(empty.insert([pass()?, pass()?])),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cuts_are_told_from_motion_and_noise() {
        let picture = |at: f32, noise: u32| -> Vec<Vec3> {
            let color = |i: usize| {
                let (x, y) = ((i % 64) as f32, (i / 64) as f32);
                let lit = (-((x - at).powi(2) + (y - 30.0).powi(2)) / 200.0).exp();
                let random = (i as u32).wrapping_mul(0x9E37_79B9).wrapping_add(noise.wrapping_mul(0x85EB_CA6B)) >> 24;
                Vec3::splat(lit * random as f32 / 128.0)
            };
            (0..64 * 60).map(color).collect()
        };
        let small = |at, noise| thumbnail(&picture(at, noise), [64, 60]);
        assert!(!is_cut(&small(20.0, 1), &small(22.0, 2)));
        assert!(is_cut(&small(20.0, 1), &small(55.0, 2)));
        assert!(!is_cut(&vec![Vec3::ZERO; 256], &vec![Vec3::ZERO; 256]));
    }
}
