//! A frame as it is denoised.

use super::motion::Moved;
use crate::formats::exr::Document;
use glam::Vec3;

/// Channels of a document that are denoised together.
#[derive(Debug, Clone)]
pub struct Target {
    pub part: usize,
    pub channels: Vec<usize>,
}

/// Colors and motion of a frame.
#[derive(Debug)]
pub struct Shot {
    pub size: [usize; 2],
    /// Colors by layer.
    pub layers: Vec<Vec<Vec3>>,
    pub moved: Moved,
    /// Number of pixels that are not finite.
    pub filled: usize,
    pub targets: Vec<Target>,
    /// The file, if it will be written.
    pub document: Option<Document>,
}
