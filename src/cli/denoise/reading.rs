//! Reading of frames: the layers of color that are denoised, view by view, and their motion.

use super::held::Held;
use super::motion::{Asked, Motions};
use super::plan::Read;
use super::shot::{Layer, Shot, Target, View};
use super::{Denoise, Guide};
use crate::denoise::contradiction;
use crate::error::{Error, Result};
use crate::formats::exr::{Document, LayerInfo};
use glam::Vec3;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Reader of the frames of a sequence.
pub struct Reader<'r> {
    pub command: &'r Denoise,
    pub numbers: &'r [u32],
    pub inputs: &'r [PathBuf],
    pub motions: Motions<'r>,
    /// Files that were read for the backward direction.
    pub held: Held,
}

/// Alphas by part and channel, of which several layers may have the same.
type Alphas = BTreeMap<[usize; 2], Arc<Vec<f32>>>;

impl Reader<'_> {
    /// Reads a frame.
    ///
    /// # Errors
    /// If the file cannot be read, has not the layers that are asked for, or no finite pixel.
    pub fn shot(&mut self, read: Read, cancel: &AtomicBool) -> Result<Shot> {
        let Read { frame, forward, write } = read;
        let path = &self.inputs[frame];
        let document = match self.held.take(frame) {
            Some(document) => document,
            None => Document::read(path, self.command.memory.limits())?,
        };
        let targets = self.targets(&document).map_err(|e| e.at(path))?;
        let mut filled = 0;
        let mut alphas = Alphas::new();
        let mut views = Vec::new();
        let mut contradiction = 0.0_f32;
        for (number, targets) in targets.into_iter().enumerate() {
            let size = document.size(targets[0].part);
            let layers = layers(&document, &targets, &mut alphas, &mut filled).map_err(|e| e.at(path))?;
            let asked = Asked { document: &document, view: number, size, number: self.numbers[frame], forward };
            let moved = self.motions.of(&asked, cancel).map_err(|e| e.at(path))?;
            let mut view = View { size, targets, layers, moved };
            contradiction = contradiction.max(self.guide(&mut view));
            views.push(view);
        }
        let mut shot = Shot { views, filled, contradiction, document: None };
        if write {
            shot.document = Some(document);
        } else if !forward {
            self.held.insert(frame, document);
        }
        Ok(shot)
    }

    /// Puts the alpha that came with the motion in the place of the layers' own, unless they contradict each other. Returns by how
    /// much they do; 0 if they agree.
    fn guide(&self, View { size, targets, layers, moved }: &mut View) -> f32 {
        let Some(alpha) = moved.alpha.as_ref().filter(|_| self.command.guide == Guide::Alpha) else { return 0.0 };
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
        let names: Vec<Option<&str>> = match &self.command.layers[..] {
            [] => vec![None],
            names => names.iter().map(|name| Some(name.as_str())).collect(),
        };
        let views = header.views();
        let mut targets = vec![Vec::new(); views.len().max(1)];
        for name in names {
            let named = document.layer(name)?;
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

    /// Returns the channels of a layer: its colors, and its alpha where that is to be denoised, too.
    fn of_layer(&self, document: &Document, layer: &LayerInfo) -> Result<Vec<Target>> {
        let channels = document.colors(layer).ok_or_else(|| {
            Error::invalid("the layer has no three channels of color")
                .part(format!("layer '{}'", layer.name))
                .hint("name layers with R, G and B with --layers; `cumulo info` lists them")
        })?;
        let own = document.component(layer, "A");
        let guide = match self.command.guide {
            Guide::Alpha => own.or_else(|| beauty_alpha(document, layer)),
            Guide::None => None,
        };
        let colors = Target { part: layer.part, channels: channels.to_vec(), alpha: guide };
        let alpha = own.filter(|_| self.command.alpha);
        let alpha = alpha.map(|alpha| Target { part: layer.part, channels: vec![alpha], alpha: None });
        Ok(std::iter::once(colors).chain(alpha).collect())
    }
}

fn no_counterpart(layer: &LayerInfo, view: &str) -> Error {
    Error::invalid(format!("the view '{view}' has no layer that corresponds to '{}'", layer.name))
        .hint("all views of a picture are denoised: name layers with --layers that each view has")
}

/// Returns the channel of the alpha of the beauty in a layer's view, if it lies in the layer's part.
fn beauty_alpha(document: &Document, layer: &LayerInfo) -> Option<usize> {
    let header = document.header();
    let beauty = header.counterpart(&document.layer(None).ok()?, header.view_of(layer))?;
    document.component(&beauty, "A").filter(|_| beauty.part == layer.part)
}

/// Reads layers of one size, and counts the pixels that are not finite.
fn layers(document: &Document, targets: &[Target], alphas: &mut Alphas, filled: &mut usize) -> Result<Vec<Layer>> {
    let size = document.size(targets[0].part);
    let layer = |target: &Target| {
        if document.size(target.part) != size {
            return Err(Error::invalid("the layers have different sizes")
                .hint("denoise them one after the other, with --layers"));
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
        *filled += missing;
        let alpha = target.alpha.map(|channel| {
            let samples = || Arc::new(document.samples(target.part, channel).into_owned());
            Arc::clone(alphas.entry([target.part, channel]).or_insert_with(samples))
        });
        Ok(Layer { color, alpha })
    };
    targets.iter().map(layer).collect()
}
