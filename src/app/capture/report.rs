//! The report of a capture that was converted.

use crate::app::checks::Warning;
use crate::app::provenance::Provenance;
use crate::app::run::write_warnings;
use crate::scene::color_space::ColorSpace;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// Report of a capture that was converted.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct CaptureReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    pub(super) output: PathBuf,
    pub(super) views: usize,
    /// Number of pictures that were written.
    pub(super) written: usize,
    /// Number of pictures that were resampled to a pinhole camera.
    pub(super) undistorted: usize,
    /// Number of pictures with integer samples.
    pub(super) integer: usize,
    /// Smallest and largest width and height of the pictures in pixels.
    pub(super) sizes: [[u32; 2]; 2],
    pub(super) color_space: Option<ColorSpace>,
    /// Medium and background of photographs, in words.
    pub(super) setting: Option<String>,
    pub(super) warnings: Vec<Warning>,
    pub(super) provenance: Provenance,
}

impl fmt::Display for CaptureReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {} view(s)", self.output.display(), self.views)?;
        let [[w0, h0], [w1, h1]] = self.sizes;
        let sizes = if [w0, h0] == [w1, h1] { format!("{w0}x{h0}") } else { format!("{w0}x{h0} to {w1}x{h1}") };
        writeln!(
            f,
            "  pictures: {sizes}; {} written, {} stay where they are",
            self.written,
            self.views - self.written
        )?;
        if self.undistorted > 0 {
            writeln!(f, "  {} undistorted, cropped to what every pixel was seen in", self.undistorted)?;
        }
        if let Some(space) = self.color_space {
            writeln!(f, "  {} of integer samples, decoded from {space}", self.integer)?;
        }
        if let Some(setting) = &self.setting {
            writeln!(f, "  {setting}")?;
        }
        write_warnings(f, &self.warnings)
    }
}
