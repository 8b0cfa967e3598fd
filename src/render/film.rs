//! The picture a renderer fills.

/// Scene-linear premultiplied RGBA, row-major from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct Film {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `rgba[y * width + x]`; alpha is 1 - transmittance.
    pub rgba: Vec<[f32; 4]>,
}

impl Film {
    /// A black, clear film.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, rgba: vec![[0.0; 4]; width * height] }
    }
}
