//! Reading of a whole file with all its layers.

use super::Window;
use super::decode::{self, Row, Source};
use super::header::{self, SampleType};
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use std::collections::BTreeMap;
use std::path::Path;

/// All layers of a file over its display window.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Width of the display window in pixels.
    pub width: usize,
    /// Height of the display window in pixels.
    pub height: usize,
    /// Smallest window around the data windows of all parts.
    pub data_window: Window,
    /// Window that the samples cover.
    pub display_window: Window,
    /// Layers in file order.
    pub layers: Vec<Layer>,
    /// Attributes of all parts as text; where two parts differ, the first one's value.
    pub attributes: BTreeMap<String, String>,
}

/// A layer: channels that share a prefix.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Name of the layer; empty for channels without a prefix in a file of one part.
    pub name: String,
    /// Channels in file order (alphabetical).
    pub channels: Vec<Channel>,
}

/// A channel as a plane of samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Name of the channel within its layer: `R`.
    pub name: String,
    /// Type of the samples in the file.
    pub sample_type: SampleType,
    /// Samples `samples[y * width + x]` over the display window; 0 outside the data window.
    pub samples: Vec<f32>,
    /// Number of samples that are NaN or infinite. They are kept in `samples`.
    pub non_finite: usize,
}

/// Reads all layers of a file.
///
/// # Errors
/// If [`header`](super::header()) fails, chunks are missing or damaged, channels are subsampled, or all channels
/// together take more than half of the machine's memory.
pub fn read(path: &Path) -> Result<Image> {
    read_within(path, Limits::default())
}

/// Reads all layers of a file. Their samples (4 bytes each) and the chunks being decoded must fit into `limits`;
/// nothing is allocated before that is known.
///
/// # Errors
/// The conditions are those of [`read`], with these limits.
pub fn read_within(path: &Path, limits: Limits) -> Result<Image> {
    let _reading = Reading::begin(path);
    let (reader, header) = header::open(path)?;
    let layers = header.layers();
    let sources: Vec<Source> =
        layers.iter().flat_map(|l| l.channels.iter().map(|&channel| Source { part: l.part, channel })).collect();
    let display = header.display_window;
    let held = display.pixels().saturating_mul(4 * sources.len() as u64);
    let mut planes: Vec<Plane> = sources.iter().map(|_| Plane::default()).collect();
    decode::rows(path, reader, &header, &sources, (held, limits), |Row { source, x, y, samples }| {
        let plane = &mut planes[source];
        if plane.samples.is_empty() {
            plane.samples = vec![0.0; display.size[0] * display.size[1]];
        }
        let start = y * display.size[0] + x;
        plane.samples[start..start + samples.len()].copy_from_slice(samples);
        plane.non_finite += samples.iter().filter(|v| !v.is_finite()).count();
    })?;
    // Channels without a sample in the display window are 0.
    for plane in planes.iter_mut().filter(|p| p.samples.is_empty()) {
        plane.samples = vec![0.0; display.size[0] * display.size[1]];
    }
    let mut planes = planes.into_iter();
    let layers = layers
        .into_iter()
        .map(|layer| Layer {
            channels: layer
                .channels
                .iter()
                .zip(planes.by_ref())
                .map(|(&index, plane)| {
                    let info = &header.parts[layer.part].channels[index];
                    Channel {
                        name: info.component.clone(),
                        sample_type: info.sample_type,
                        samples: plane.samples,
                        non_finite: plane.non_finite,
                    }
                })
                .collect(),
            name: layer.name,
        })
        .collect();
    Ok(Image {
        width: header.display_window.size[0],
        height: header.display_window.size[1],
        data_window: header.data_window,
        display_window: header.display_window,
        layers,
        attributes: header.attributes(),
    })
}

/// Samples of a channel over the display window, row-major; empty until the first sample arrives.
#[derive(Default)]
struct Plane {
    samples: Vec<f32>,
    non_finite: usize,
}
