//! Whole deep pictures in memory.

use super::header::open;
use super::{DeepLine, DeepSample};
use crate::error::Result;
use crate::formats::exr::Window;
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use std::collections::BTreeMap;
use std::path::Path;

/// A deep picture.
#[derive(Debug, Clone, PartialEq)]
pub struct DeepPicture {
    /// Window that the picture is meant to cover.
    pub display_window: Window,
    /// Window of the pixels that are stored.
    pub data_window: Window,
    /// Rows of the data window, from top to bottom.
    pub lines: Vec<DeepLine>,
    /// Attributes of all parts as text; where two parts differ, the first one's value.
    pub attributes: BTreeMap<String, String>,
}

impl DeepPicture {
    /// Samples of a pixel, counted from the data window's first one, in the file's order.
    ///
    /// # Panics
    /// If the pixel is not in the data window.
    pub fn samples(&self, x: usize, y: usize) -> &[DeepSample] {
        let line = &self.lines[y];
        let before = line.counts[..x].iter().map(|&n| n as usize).sum::<usize>();
        &line.samples[before..before + line.counts[x] as usize]
    }
}

/// Reads a deep picture.
///
/// # Errors
/// If the file cannot be read, is no deep OpenEXR picture, is damaged, has no channel Z or A, or takes more than half
/// of the machine's memory.
pub fn read(path: &Path) -> Result<DeepPicture> {
    read_within(path, Limits::default())
}

/// Reads a deep picture. Its samples (24 bytes each) and the chunks being unpacked must fit into `limits`; nothing is
/// unpacked before that is known.
///
/// # Errors
/// The conditions are those of [`read`], with these limits.
pub fn read_within(path: &Path, limits: Limits) -> Result<DeepPicture> {
    let _reading = Reading::begin(path);
    let mut source = open(path, limits)?;
    let [width, height] = source.size();
    let rows = (size_of::<DeepLine>() + width * size_of::<u32>()) as u64;
    let samples = source.samples().saturating_mul(size_of::<DeepSample>() as u64);
    let held = samples.saturating_add(rows.saturating_mul(height as u64));
    let mut lines = Vec::new();
    source.lines((held, limits), |_, line| {
        lines.push(line);
        Ok(())
    })?;
    let data_window = source.part().data_window;
    let attributes = source.header.attributes();
    Ok(DeepPicture { display_window: source.header.display_window, data_window, lines, attributes })
}
