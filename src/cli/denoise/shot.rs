//! A frame as it is denoised.

use super::motion::Moved;
use crate::formats::exr::Document;
use glam::Vec3;
use std::sync::Arc;

/// Channels of a document that are denoised together.
#[derive(Debug, Clone)]
pub struct Target {
    pub part: usize,
    pub channels: Vec<usize>,
    /// Channel of the alpha that shows its outlines, if there is one.
    pub alpha: Option<usize>,
}

/// Layer of a frame.
#[derive(Debug)]
pub struct Layer {
    pub color: Vec<Vec3>,
    pub alpha: Option<Arc<Vec<f32>>>,
}

/// Colors and motion of a frame.
#[derive(Debug)]
pub struct Shot {
    pub size: [usize; 2],
    pub layers: Vec<Layer>,
    pub moved: Moved,
    /// Number of pixels that are not finite.
    pub filled: usize,
    pub targets: Vec<Target>,
    /// The file, if it will be written.
    pub document: Option<Document>,
}
