//! A frame as it is denoised.

use super::motion::Moved;
use crate::denoise::Frame;
use crate::formats::exr::Document;
use glam::Vec3;
use std::sync::Arc;

/// Channels of a document that are denoised together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Target {
    pub part: usize,
    pub channels: Vec<usize>,
    /// Channel of the alpha that shows its outlines, if there is one.
    pub alpha: Option<usize>,
    /// Channel of the layer's own alpha that is written as it is, but for what is not finite in it.
    pub kept: Option<usize>,
}

/// Layer of a frame.
#[derive(Debug)]
pub(super) struct Layer {
    pub color: Vec<Vec3>,
    pub alpha: Option<Arc<Vec<f32>>>,
}

/// One of the views of a frame, such as an eye of stereo, which has a history of its own; most frames have one.
#[derive(Debug)]
pub(super) struct View {
    pub size: [usize; 2],
    /// Channels of the layers.
    pub targets: Vec<Target>,
    /// Colors of the layers.
    pub layers: Vec<Layer>,
    pub moved: Moved,
}

impl View {
    /// Returns a layer as a picture at rest.
    pub(crate) fn frame<'l>(&self, layer: &'l Layer) -> Frame<'l> {
        let alpha = layer.alpha.as_ref().map(|alpha| &alpha[..]);
        Frame { size: self.size, color: &layer.color, alpha, ..Frame::default() }
    }
}

/// Colors and motion of a frame.
#[derive(Debug)]
pub(super) struct Shot {
    pub views: Vec<View>,
    /// Channels of each view that the mean of its first two layers replaces; empty unless these are halves.
    pub whole: Vec<Target>,
    /// Number of pixels that are not finite in color or alpha, each view's counted once whatever its layers.
    pub filled: usize,
    /// Difference between the alpha that came with the motion and the picture's own, where they contradict each other;
    /// else 0.
    pub contradiction: f32,
    /// The file, if it will be written.
    pub document: Option<Document>,
}

impl Shot {
    /// Returns columns, rows and number of layers of each view.
    pub(crate) fn shape(&self) -> Vec<([usize; 2], usize)> {
        self.views.iter().map(|view| (view.size, view.layers.len())).collect()
    }
}
