//! Denoisers of the layers of a view, in both directions of time.

use super::shot::{Layer, View};
use crate::denoise::{Ahead, CutDetector, Denoised, Denoiser, Frame, Lookahead, Method, Settings};
use crate::error::Result;
use glam::Vec2;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Frames in one direction of time.
#[derive(Debug, Default)]
struct Course {
    /// The frame before in this direction: number, and its motion to the frame before in the other direction.
    last: Option<(u32, Option<Vec<Vec2>>)>,
    cuts: CutDetector,
}

impl Course {
    /// Returns the motion of the next frame to the one before, and whether a cut lies between them.
    fn next<'s>(&mut self, number: u32, view: &'s View, find_cuts: bool) -> (Option<Cow<'s, [Vec2]>>, bool) {
        let cut = find_cuts && self.cuts.begins_shot(&view.layers[0].color, view.size, || view.moved.is_zero());
        let last = self.last.replace((number, view.moved.away.clone())).filter(|_| !cut);
        // A motion spans as many frames as lie between.
        let gap = last.as_ref().map_or(1, |(last, _)| last.abs_diff(number).max(1)) as f32;
        let motion = match &view.moved.toward {
            Some(motion) if gap == 1.0 => Some(motion.into()),
            Some(motion) => Some(motion.iter().map(|motion| *motion * gap).collect()),
            // What the last frame knows of its way here, turned round, where this one knows nothing.
            None => last.and_then(|(_, away)| Some(away?.iter().map(|motion| -*motion).collect())),
        };
        (motion, cut)
    }
}

/// Denoisers of the layers of a view, and what they see of the frames that follow.
#[derive(Debug)]
pub(super) struct ViewDenoiser {
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

impl ViewDenoiser {
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
