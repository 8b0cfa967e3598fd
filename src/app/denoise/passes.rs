//! Denoisers of the layers of a view, in both directions of time.

use super::shot::{Layer, View};
use crate::denoise::{Ahead, Denoised, Denoiser, Frame, Lookahead, Method, Settings};
use crate::error::Result;
use glam::{Vec2, Vec3};
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Number of blocks of a thumbnail along its sides.
const THUMBNAIL: usize = 16;

/// Mean colors of parts of a picture, by which cuts are found.
pub(super) type Thumbnail = Vec<Vec3>;

/// Rows and columns of which one is looked at for a thumbnail.
const LOOK: usize = 2;

/// Returns the mean colors of the finite pixels of parts of a picture.
pub(crate) fn thumbnail(color: &[Vec3], [width, height]: [usize; 2]) -> Thumbnail {
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

/// Change above which a cut lies between two pictures, if it is so many times the change before: very few paths change
/// as much from frame to frame.
const CUT: [f32; 2] = [0.5, 1.5];
/// Change above which a cut lies between two pictures at rest, if it is so many times the change before, which must be
/// known.
const JUMP: [f32; 2] = [0.12, 4.0];

/// Returns the share of the light of two pictures that lies elsewhere in the other.
fn change(a: &Thumbnail, b: &Thumbnail) -> f32 {
    let pairs = || a.iter().zip(b);
    let apart: f32 = pairs().map(|(a, b)| (*a - *b).abs().element_sum()).sum();
    let all: f32 = pairs().map(|(a, b)| (*a + *b).element_sum()).sum();
    apart / all.max(f32::MIN_POSITIVE)
}

/// True if two pictures of this change show different shots. `before` is the change between the two before, and
/// `at_rest` tells whether both would be the same picture but for the noise.
fn is_cut(change: f32, before: Option<f32>, at_rest: impl Fn() -> bool) -> bool {
    let is_beyond = |[least, times]: [f32; 2]| change > least && change > times * before.unwrap_or(0.0);
    is_beyond(CUT) || before.is_some() && is_beyond(JUMP) && at_rest()
}

/// Frames in one direction of time.
#[derive(Debug, Default)]
struct Course {
    /// The frame before in this direction: number, thumbnail, and its motion to the frame before in the other
    /// direction.
    last: Option<(u32, Thumbnail, Option<Vec<Vec2>>)>,
    /// Change between the two frames before.
    change: Option<f32>,
}

impl Course {
    /// Returns the motion of the next frame to the one before, and whether a cut lies between them.
    fn next<'s>(&mut self, number: u32, view: &'s View, find_cuts: bool) -> (Option<Cow<'s, [Vec2]>>, bool) {
        let small = thumbnail(&view.layers[0].color, view.size);
        let change = self.last.as_ref().map(|(_, last, _)| change(last, &small));
        let differs = |change| is_cut(change, self.change, || view.moved.is_zero());
        let cut = find_cuts && change.is_some_and(differs);
        self.change = change;
        let last = self.last.replace((number, small, view.moved.away.clone())).filter(|_| !cut);
        // A motion spans as many frames as lie between.
        let gap = last.as_ref().map_or(1, |(last, ..)| last.abs_diff(number).max(1)) as f32;
        let motion = match &view.moved.toward {
            Some(motion) if gap == 1.0 => Some(motion.into()),
            Some(motion) => Some(motion.iter().map(|motion| *motion * gap).collect()),
            // What the last frame knows of its way here, turned round, where this one knows nothing.
            None => last.and_then(|(.., away)| Some(away?.iter().map(|motion| -*motion).collect())),
        };
        (motion, cut)
    }
}

/// Denoisers of the layers of a view, and what they see of the frames that follow.
#[derive(Debug)]
pub(super) struct Directions {
    method: Method,
    settings: Settings,
    find_cuts: bool,
    /// True if maps of noise and error are wanted.
    mapped: bool,
    forward: Course,
    backward: Course,
    /// One denoiser a layer, from the first frame on.
    denoisers: Vec<Denoiser>,
    /// True after a cut.
    is_cut: bool,
    lookaheads: Vec<Lookahead>,
    /// Histories over the frames that follow, one a layer, by the frame's number.
    kept: BTreeMap<u32, Vec<Ahead>>,
    /// Memory to be used again.
    spare: Vec<Ahead>,
}

impl Directions {
    /// Creates denoisers that have seen nothing.
    pub(super) fn new(method: Method, settings: Settings, find_cuts: bool, mapped: bool) -> Self {
        Self {
            method,
            settings,
            find_cuts,
            mapped,
            forward: Course::default(),
            backward: Course::default(),
            denoisers: Vec::new(),
            is_cut: false,
            lookaheads: Vec::new(),
            kept: BTreeMap::new(),
            spare: Vec::new(),
        }
    }

    /// Begins a piece of work that depends on nothing before.
    pub(crate) fn begin(&mut self) {
        self.denoisers.iter_mut().for_each(Denoiser::reset);
        (self.forward, self.is_cut) = (Course::default(), false);
        self.spare.extend(std::mem::take(&mut self.kept).into_values().flatten());
        self.turn();
    }

    /// Begins again at the first frame, with what was learned of the noise if it was that of the same shot.
    pub(crate) fn rewind(&mut self) {
        let again = if self.is_cut { Denoiser::reset } else { Denoiser::rewind };
        self.denoisers.iter_mut().for_each(again);
        (self.forward, self.is_cut) = (Course::default(), false);
    }

    /// Begins to look backwards.
    pub(crate) fn turn(&mut self) {
        self.lookaheads.iter_mut().for_each(Lookahead::reset);
        self.backward = Course::default();
    }

    /// Looks at the frame that lies before those looked at last, and keeps what those show of it if it will be
    /// denoised.
    ///
    /// # Errors
    /// If layers contradict their size.
    pub(crate) fn observe(&mut self, number: u32, view: &View, keep: bool) -> Result<()> {
        let (motion, cut) = self.backward.next(number, view, self.find_cuts);
        if cut {
            self.lookaheads.iter_mut().for_each(Lookahead::reset);
        }
        self.lookaheads.resize_with(view.layers.len(), Lookahead::default);
        let mut found = Vec::new();
        for (layer, lookahead) in view.layers.iter().zip(&mut self.lookaheads) {
            let mut ahead = self.spare.pop().unwrap_or_default();
            lookahead.observe(&frame(view, layer, motion.as_deref(), None), &mut ahead)?;
            found.push(ahead);
        }
        if keep {
            self.kept.insert(number, found);
        } else {
            self.spare.extend(found);
        }
        Ok(())
    }

    /// Denoises the layers of the next frame into `to`, whose memory is used again. With `again`, what those after it
    /// show of it stays for another time. Returns true if it begins a shot.
    ///
    /// # Errors
    /// If the settings cannot be used, or layers contradict their size.
    pub(crate) fn denoise(&mut self, number: u32, view: &View, again: bool, to: &mut Vec<Denoised>) -> Result<bool> {
        // Its memory serves others until frames are looked at again.
        self.lookaheads.clear();
        let (motion, cut) = self.forward.next(number, view, self.find_cuts);
        if cut {
            self.denoisers.iter_mut().for_each(Denoiser::reset);
            self.is_cut = true;
        }
        while self.denoisers.len() < view.layers.len() {
            let denoiser = Denoiser::new(self.method, self.settings)?;
            self.denoisers.push(if self.mapped { denoiser.with_map() } else { denoiser });
        }
        to.resize_with(view.layers.len(), Denoised::default);
        let aheads = self.kept.remove(&number).unwrap_or_default();
        for (i, (layer, denoiser)) in view.layers.iter().zip(&mut self.denoisers).enumerate() {
            denoiser.denoise_into(&frame(view, layer, motion.as_deref(), aheads.get(i)), &mut to[i])?;
        }
        if again {
            self.kept.insert(number, aheads);
        } else {
            self.spare.extend(aheads);
        }
        Ok(cut)
    }
}

/// Returns a layer of a frame as it is denoised.
fn frame<'f>(view: &View, layer: &'f Layer, motion: Option<&'f [Vec2]>, ahead: Option<&'f Ahead>) -> Frame<'f> {
    Frame { motion, ahead, ..view.frame(layer) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cuts_are_told_from_motion_and_noise() {
        let picture = |at: f32, bright: f32, noise: u32| -> Thumbnail {
            let color = |i: usize| {
                let (x, y) = ((i % 64) as f32, (i / 64) as f32);
                let lit = bright * (-((x - at).powi(2) + (y - 30.0).powi(2)) / 200.0).exp();
                let random = (i as u32).wrapping_mul(0x9E37_79B9).wrapping_add(noise.wrapping_mul(0x85EB_CA6B));
                let random = (random ^ (random >> 15)).wrapping_mul(0x2C1B_3C6D) >> 24;
                Vec3::splat(lit * (0.75 + random as f32 / 512.0))
            };
            thumbnail(&(0..64 * 60).map(color).collect::<Vec<_>>(), [64, 60])
        };
        let first = picture(20.0, 1.0, 1);
        let noise = change(&first, &picture(20.0, 1.0, 2));
        let cut = |to: &Thumbnail, before, at_rest| is_cut(change(&first, to), Some(before), || at_rest);
        assert!(!cut(&picture(20.0, 1.0, 3), noise, true));
        assert!(!cut(&picture(22.0, 1.0, 3), noise, true));
        assert!(cut(&picture(55.0, 1.0, 3), noise, false));
        // Sparse paths differ as much in each frame.
        assert!(!is_cut(0.7, Some(0.65), || true) && is_cut(0.7, None, || false));
        assert_eq!(change(&vec![Vec3::ZERO; 256], &vec![Vec3::ZERO; 256]), 0.0);
        // A light that is halved, and a mirrored shot, jump out of what changes by noise; not so where that is as much,
        // and where a motion may explain it.
        for other in [picture(20.0, 0.5, 3), picture(40.0, 1.0, 3)] {
            let found = change(&first, &other);
            assert!(cut(&other, noise, true) && found > JUMP[1] * noise, "{found} {noise}");
            assert!(found > CUT[0] || !cut(&other, found, true) && !cut(&other, noise, false));
        }
    }
}
