//! One layer of a file with all its channels.

use super::decode::{self, Row, Source};
use super::header::{self, LayerInfo};
use super::picture::{default, named};
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use std::path::Path;

/// Names of channels that stand in another order than the alphabet's, by their place among the channels of their kind.
const ORDER: [&[&str]; 2] = [&["r", "g", "b", "a"], &["red", "green", "blue", "alpha"]];

/// All channels of a layer, interleaved.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Samples {
    /// Name of the layer; empty for the unnamed one.
    pub name: String,
    /// Names of the channels within the layer: colors as R, G, B, A, others by the alphabet.
    pub channels: Vec<String>,
    /// Width of the display window in pixels.
    pub width: usize,
    /// Height of the display window in pixels.
    pub height: usize,
    /// Samples `values[(y * width + x) * channels + channel]`, row 0 at the top; 0 outside the data window.
    pub values: Vec<f32>,
}

/// Place of a channel among those of its layer.
fn rank(component: &str) -> (usize, String) {
    let name = component.to_ascii_lowercase();
    let place = ORDER.iter().find_map(|names| names.iter().position(|n| *n == name));
    (place.unwrap_or(0), name)
}

/// Reads all channels of a layer, which is chosen as by [`picture`](super::picture()). The samples and the chunks being
/// decoded must fit into `limits`; nothing is allocated before that is known.
///
/// # Errors
/// If the header is damaged, there is no such layer (the error lists all), chunks are missing, damaged or subsampled,
/// or memory does not suffice.
pub(crate) fn layer_within(path: &Path, layer: Option<&str>, limits: Limits) -> Result<Samples> {
    let _reading = Reading::begin(path);
    let (reader, header) = header::open(path)?;
    let layers = header.layers();
    let chosen = match layer {
        Some(name) => named(&layers, name),
        None => default(&header, &layers),
    };
    let chosen: &LayerInfo = chosen.map_err(|e| e.at(path))?;
    let component = |channel: usize| &header.parts[chosen.part].channels[channel].component;
    let mut order = chosen.channels.clone();
    order.sort_by_cached_key(|channel| rank(component(*channel)));
    let sources: Vec<Source> = order.iter().map(|&channel| Source { part: chosen.part, channel }).collect();
    let [width, height] = header.display_window.size;
    let count = sources.len();
    let held = header.display_window.pixels().saturating_mul(4 * count as u64);
    let mut values = Vec::new();
    decode::rows(path, reader, &header, &sources, (held, limits), |Row { source, x, y, samples }| {
        if values.is_empty() {
            values = vec![0.0; width * height * count];
        }
        let start = (y * width + x) * count + source;
        for (place, sample) in values[start..].iter_mut().step_by(count).zip(samples) {
            *place = *sample;
        }
    })?;
    // A layer without a sample in the display window is 0.
    values.resize(width * height * count, 0.0);
    let channels = order.iter().map(|c| component(*c).clone()).collect();
    Ok(Samples { name: chosen.name.clone(), channels, width, height, values })
}
