//! Reading of frames: the layers of color that are denoised, view by view, and their motion. Gaps in alphas that are
//! not denoised are filled in here.

use super::held::ReadAhead;
use super::motion::{MotionRequest, Motions};
use super::plan::Read;
use super::shot::{Layer, Shot, Target, View};
use super::{DenoiseSettings, Guide};
use crate::cancel::Cancel;
use crate::denoise::contradiction;
use crate::error::{Error, Result};
use crate::formats::exr::{Document, LayerInfo};
use glam::Vec3;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;

/// Reader of the frames of a sequence.
pub(super) struct Reader<'r> {
    pub settings: &'r DenoiseSettings,
    pub numbers: &'r [u32],
    pub inputs: &'r [PathBuf],
    pub motions: Motions<'r>,
    /// Files that were read for the backward direction.
    pub held: ReadAhead,
}

/// Alphas by part and channel, of which several layers may have the same.
type Alphas = BTreeMap<[usize; 2], Arc<Vec<f32>>>;

impl Reader<'_> {
    /// Reads a frame.
    ///
    /// # Errors
    /// If the file cannot be read, has not the layers that are asked for, or no finite pixel.
    pub(crate) fn shot(&mut self, read: Read, cancel: &Cancel) -> Result<Shot> {
        let Read { frame, forward, write, again } = read;
        let path = &self.inputs[frame];
        let mut document = match self.held.take(frame) {
            Some(document) => document,
            None => Document::read(path, self.settings.limits)?,
        };
        let targets = self.targets(&document).map_err(|e| e.at(path))?;
        let mut filled = 0;
        let mut alphas = Alphas::new();
        let mut views = Vec::new();
        let mut contradiction = 0.0_f32;
        for (number, targets) in targets.into_iter().enumerate() {
            let size = document.size(targets[0].part);
            let (layers, missing) = layers(&document, &targets, &mut alphas).map_err(|e| e.at(path))?;
            filled += missing;
            let asked = MotionRequest { document: &document, view: number, size, number: self.numbers[frame], forward };
            let moved = self.motions.of(&asked, cancel).map_err(|e| e.at(path))?;
            let mut view = View { size, targets, layers, moved };
            contradiction = contradiction.max(self.guide(&mut view));
            views.push(view);
        }
        let whole = self.whole(&document, &views).map_err(|e| e.at(path))?;
        let mut shot = Shot { views, whole, filled, contradiction, document: None };
        if write {
            // Only what is written: a frame that is held for a second reading must show its gaps again to be counted.
            let targets = shot.views.iter().flat_map(|view| &view.targets);
            let kept: BTreeSet<[usize; 2]> = targets.filter_map(|t| Some([t.part, t.kept?])).collect();
            kept.into_iter().for_each(|[part, channel]| fill_in(&mut document, part, channel));
            shot.document = Some(document);
        } else if again {
            self.held.insert(frame, document);
        }
        Ok(shot)
    }

    /// Puts the alpha that came with the motion in the place of the layers' own, unless they contradict each other.
    /// Returns by how much they do; 0 if they agree.
    fn guide(&self, View { size, targets, layers, moved }: &mut View) -> f32 {
        let Some(alpha) = moved.alpha.as_ref().filter(|_| self.settings.guide == Guide::Alpha) else { return 0.0 };
        let own = layers.iter().filter_map(|layer| layer.alpha.as_ref());
        let apart = own.filter_map(|own| contradiction(own, alpha, size[0])).fold(0.0, f32::max);
        if apart == 0.0 {
            let guided = layers.iter_mut().zip(targets).filter(|(_, target)| target.channels.len() > 1);
            guided.for_each(|(layer, _)| layer.alpha = Some(Arc::clone(alpha)));
        }
        apart
    }

    /// Returns the channels to denoise, view by view: each layer in all views that there are.
    fn targets(&self, document: &Document) -> Result<Vec<Vec<Target>>> {
        let header = document.header();
        let names: Vec<Option<&str>> = match &self.settings.layers[..] {
            [] if self.settings.halves => HALVES.map(Some).to_vec(),
            [] => vec![None],
            names => names.iter().map(|name| Some(name.as_str())).collect(),
        };
        let views = header.views();
        let mut targets = vec![Vec::new(); views.len().max(1)];
        for name in names {
            let named = document.layer(name).map_err(|e| self.without_halves(e))?;
            for (number, targets) in targets.iter_mut().enumerate() {
                let layer = header.counterpart(&named, number).ok_or_else(|| no_counterpart(&named, &views[number]))?;
                for target in self.of_layer(document, &layer)? {
                    if !targets.contains(&target) {
                        targets.push(target);
                    }
                }
            }
        }
        Ok(targets)
    }

    /// Says how a picture comes to have halves, if they are to be denoised.
    fn without_halves(&self, error: Error) -> Error {
        match self.settings.halves {
            true => error.instead("⟨halves⟩ needs the layers half_a and half_b: render with ⟨render.aov=halves⟩"),
            false => error,
        }
    }

    /// Returns the channels of the beauty of each view, which the mean of the denoised halves replaces; none unless
    /// halves are denoised.
    ///
    /// # Errors
    /// If the beauty is not the mean of the halves, since another program has changed the picture.
    fn whole(&self, document: &Document, views: &[View]) -> Result<Vec<Target>> {
        if !self.settings.halves {
            return Ok(Vec::new());
        }
        let header = document.header();
        let beauty = document.layer(None)?;
        let views_by_name = header.views();
        let missing = |view: usize| no_counterpart(&beauty, views_by_name.get(view).map_or("", String::as_str));
        let whole = |(number, view): (usize, &View)| {
            let layer = header.counterpart(&beauty, number).ok_or_else(|| missing(number))?;
            let target = self.of_layer(document, &layer)?.swap_remove(0);
            let planes = [0, 1, 2].map(|c| document.samples(target.part, target.channels[c]));
            let [r, g, b] = &planes;
            let colors: Vec<Vec3> =
                r.iter().zip(g.iter()).zip(b.iter()).map(|((r, g), b)| Vec3::new(*r, *g, *b)).collect();
            let [a, b] = [0, 1].map(|half| &view.layers[half].color[..]);
            match are_halves(a, b, &colors) {
                true => Ok(target),
                false => Err(Error::invalid("the colors are not the mean of the layers half_a and half_b")
                    .hint("another program has changed the picture: render it again, or leave out ⟨halves⟩")),
            }
        };
        views.iter().enumerate().map(whole).collect()
    }

    /// Returns the channels of a layer: its colors, and its alpha where that is to be denoised, too.
    fn of_layer(&self, document: &Document, layer: &LayerInfo) -> Result<Vec<Target>> {
        let channels = document.colors(layer).ok_or_else(|| {
            Error::invalid("the layer has no three channels of color")
                .part(format!("layer '{}'", layer.name))
                .hint("name layers with R, G and B with ⟨layers⟩; `cumulo info` lists them")
        })?;
        let own = document.component(layer, "A");
        let guide = match self.settings.guide {
            Guide::Alpha => own.or_else(|| beauty_alpha(document, layer)),
            Guide::None => None,
        };
        let (denoised, kept) = if self.settings.alpha { (own, None) } else { (None, own) };
        let colors = Target { part: layer.part, channels: channels.to_vec(), alpha: guide, kept };
        let alpha = denoised.map(|alpha| Target { part: layer.part, channels: vec![alpha], alpha: None, kept: None });
        Ok(std::iter::once(colors).chain(alpha).collect())
    }
}

/// Layers of the two halves of a picture's paths, as `render` writes them.
const HALVES: [&str; 2] = ["half_a", "half_b"];
/// Rounding to half precision, as a share of the numbers.
const ROUNDING: f64 = 1e-3;

/// True if the mean of two pictures is a third but for rounding, also to half precision; where they are not finite they
/// may be anything.
fn are_halves(a: &[Vec3], b: &[Vec3], whole: &[Vec3]) -> bool {
    if [a.len(), b.len()] != [whole.len(); 2] {
        return false;
    }
    let of = |i: usize| {
        let [a, b, whole] = [a[i], b[i], whole[i]].map(|color| color.as_dvec3());
        [(0.5 * (a + b) - whole).length_squared(), (a - b).length_squared(), whole.length_squared()]
    };
    let squares = (0..whole.len()).map(of).filter(|squares| squares.iter().all(|square| square.is_finite()));
    let [apart, noise, all] = squares.fold([0.0_f64; 3], |sum, add| [0, 1, 2].map(|i| sum[i] + add[i]));
    apart.sqrt() <= ROUNDING * (all.sqrt() + noise.sqrt())
}

fn no_counterpart(layer: &LayerInfo, view: &str) -> Error {
    Error::invalid(format!("the view '{view}' has no layer that corresponds to '{}'", layer.name))
        .hint("all views of a picture are denoised: name layers with ⟨layers⟩ that each view has")
}

/// Returns the channel of the alpha of the beauty in a layer's view, if it lies in the layer's part.
fn beauty_alpha(document: &Document, layer: &LayerInfo) -> Option<usize> {
    let header = document.header();
    let beauty = header.counterpart(&document.layer(None).ok()?, header.view_of(layer))?;
    document.component(&beauty, "A").filter(|_| beauty.part == layer.part)
}

/// Reads layers of one size, and counts the pixels that are not finite in one of them or its alpha.
fn layers(document: &Document, targets: &[Target], alphas: &mut Alphas) -> Result<(Vec<Layer>, usize)> {
    let size = document.size(targets[0].part);
    let mut gaps = vec![false; size[0] * size[1]];
    let layer = |target: &Target| {
        if document.size(target.part) != size {
            return Err(Error::invalid("the layers have different sizes")
                .hint("denoise them one after the other, with ⟨layers⟩"));
        }
        let planes: Vec<Cow<'_, [f32]>> = target.channels.iter().map(|c| document.samples(target.part, *c)).collect();
        let plane = |c: usize| &planes[c.min(planes.len() - 1)];
        let colors = plane(0).iter().zip(plane(1).iter()).zip(plane(2).iter());
        let color: Vec<Vec3> = colors.map(|((r, g), b)| Vec3::new(*r, *g, *b)).collect();
        let missing = color.iter().filter(|color| !color.is_finite()).count();
        if missing == color.len() {
            let channel = &document.header().parts[target.part].channels[target.channels[0]];
            return Err(Error::invalid(format!("none of the {missing} pixels is finite: all are NaN or infinite"))
                .part(format!("layer '{}'", channel.layer))
                .hint("render the picture again"));
        }
        gaps.iter_mut().zip(&color).for_each(|(gap, color)| *gap |= !color.is_finite());
        if let Some(kept) = target.kept {
            let alpha = document.samples(target.part, kept);
            gaps.iter_mut().zip(alpha.iter()).for_each(|(gap, alpha)| *gap |= !alpha.is_finite());
        }
        let alpha = target.alpha.map(|channel| {
            // A gap in the guide would look like an outline.
            let samples = || {
                let alpha = document.samples(target.part, channel);
                let whole = filled_in(&alpha, size);
                Arc::new(whole.unwrap_or_else(|| alpha.into_owned()))
            };
            Arc::clone(alphas.entry([target.part, channel]).or_insert_with(samples))
        });
        Ok(Layer { color, alpha })
    };
    let layers = targets.iter().map(layer).collect::<Result<Vec<_>>>()?;
    Ok((layers, gaps.into_iter().filter(|gap| *gap).count()))
}

/// Fills in the samples of an alpha that are not finite.
fn fill_in(document: &mut Document, part: usize, channel: usize) {
    let whole = filled_in(&document.samples(part, channel), document.size(part));
    if let Some(whole) = whole {
        document.replace(part, channel, whole.into_iter());
    }
}

/// Returns an alpha with the mean of the finite samples among the up to 8 around in the place of each that is not
/// finite, or with 0 where none around is; `None` if there is nothing to fill in.
fn filled_in(alpha: &[f32], [width, height]: [usize; 2]) -> Option<Vec<f32>> {
    if alpha.iter().all(|v| v.is_finite()) {
        return None;
    }
    let around = |at: usize| {
        let (x, y) = (at % width, at / width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let all = rows.flat_map(|row| &alpha[row * width + x.saturating_sub(1)..row * width + (x + 2).min(width)]);
        let finite = all.filter(|v| v.is_finite());
        let (sum, count) = finite.fold((0.0_f64, 0_u32), |(sum, count), v| (sum + f64::from(*v), count + 1));
        (sum / f64::from(count.max(1))) as f32
    };
    let whole = alpha.iter().enumerate().map(|(at, v)| if v.is_finite() { *v } else { around(at) });
    Some(whole.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_take_the_mean_of_what_is_around() {
        let (nan, inf) = (f32::NAN, f32::INFINITY);
        assert_eq!(filled_in(&[0.0, 0.5, 1.0, 0.5], [2, 2]), None);
        let alpha = [nan, 0.5, 0.25, 1.0, inf, 0.25, 0.0, 0.0, nan];
        let corner = (0.5 + 1.0) / 2.0;
        let middle = (0.5 + 0.25 + 1.0 + 0.25) / 6.0;
        let last = 0.25 / 2.0;
        assert_eq!(filled_in(&alpha, [3, 3]).unwrap(), [corner, 0.5, 0.25, 1.0, middle, 0.25, 0.0, 0.0, last]);
        // Nothing around is finite, and what is filled in does not count.
        assert_eq!(filled_in(&[nan, inf, nan, 1.0], [4, 1]).unwrap(), [0.0, 0.0, 1.0, 1.0]);
    }
}
