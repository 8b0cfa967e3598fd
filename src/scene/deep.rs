//! Deep pictures: pixels of any number of samples, each with a depth.

/// A sample of a pixel: a point, or a homogeneous volume between two depths.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DeepSample {
    /// Distance of the front: along the viewing axis, from the camera.
    pub z: f32,
    /// Distance of the back; not above `z` for a point.
    pub z_back: f32,
    /// Premultiplied red, green and blue, and alpha.
    pub rgba: [f32; 4],
}

/// A row of a picture, all pixels of the data window from left to right.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DeepLine {
    /// Number of samples of each pixel.
    pub counts: Vec<u32>,
    /// Samples of the first pixel, then those of the second, and so on.
    pub samples: Vec<DeepSample>,
}

impl DeepLine {
    /// Appends a pixel of the given samples.
    pub fn push(&mut self, samples: &[DeepSample]) {
        // A pixel of four billion samples does not fit in memory.
        self.counts.push(samples.len() as u32);
        self.samples.extend_from_slice(samples);
    }

    /// Samples of each pixel, from left to right.
    pub fn pixels(&self) -> impl Iterator<Item = &[DeepSample]> {
        let mut rest = &self.samples[..];
        self.counts.iter().map(move |&count| {
            let (pixel, behind) = rest.split_at(rest.len().min(count as usize));
            rest = behind;
            pixel
        })
    }
}
