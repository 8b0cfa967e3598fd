//! A whole file with all its layers.

use super::decode::{self, Source};
use super::header::{self, SampleType};
use super::{Window, fault};
use crate::error::Result;
use crate::formats::reading::Reading;
use std::collections::BTreeMap;
use std::path::Path;

/// Samples in all channels together that `read` will hold (4 GiB); pictures are read by layer instead.
const MAX_SAMPLES: u64 = 1 << 30;

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
    /// Attributes of all parts as text; where two differ, the first part's.
    pub attributes: BTreeMap<String, String>,
}

/// Channels that share a prefix.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Name; empty for channels without a prefix in a file of one part.
    pub name: String,
    /// Channels in file order (alphabetical).
    pub channels: Vec<Channel>,
}

/// A plane of samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Name within the layer: `R`.
    pub name: String,
    /// Numbers in the file.
    pub sample_type: SampleType,
    /// `samples[y * width + x]` over the display window; 0 outside the data window.
    pub samples: Vec<f32>,
    /// How many samples are NaN or infinite. They stand in `samples` as they are.
    pub non_finite: usize,
}

/// Reads all layers.
///
/// # Errors
/// As [`header`](super::header()), and if chunks are missing or damaged, channels are subsampled, or
/// all channels together exceed 2³⁰ samples.
pub fn read(path: &Path) -> Result<Image> {
    let _reading = Reading::begin(path);
    let (reader, header) = header::open(path)?;
    let layers = header.layers();
    let sources: Vec<Source> =
        layers.iter().flat_map(|l| l.channels.iter().map(|&channel| Source { part: l.part, channel })).collect();
    if header.display_window.pixels().saturating_mul(sources.len() as u64) > MAX_SAMPLES {
        return Err(fault::too_large(header.display_window, sources.len()).at(path));
    }
    let mut planes = decode::planes(path, reader, &header, &sources)?.into_iter();
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
