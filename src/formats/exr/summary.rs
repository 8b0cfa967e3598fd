//! Statistics of an OpenEXR file, for `info`.

use super::Window;
use super::decode::{self, Row, Source};
use super::header::{self, ChannelInfo, Part};
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::text::{printable, printable_lines};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// Header and sample statistics of a file.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct ExrSummary {
    /// Window that the picture is meant to cover.
    pub display_window: Window,
    /// Width over height of a pixel.
    pub pixel_aspect: f32,
    /// Parts in file order.
    pub parts: Vec<PartSummary>,
    /// Matrices of the camera (`worldToCamera`, `worldToNDC`), row by row, if the file has them. In OpenEXR points are
    /// row vectors: the translation is the last row.
    pub camera: BTreeMap<String, [[f32; 4]; 4]>,
    /// Attributes other than the camera's matrices, as text.
    pub attributes: BTreeMap<String, String>,
}

/// A part with the statistics of its layers.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct PartSummary {
    /// Name of the part, if it has one.
    pub name: Option<String>,
    /// Window of the stored pixels.
    pub data_window: Window,
    /// Compression as the `exr` crate names it.
    pub compression: String,
    /// True if the pixels are stored in tiles, false for scan lines.
    pub tiled: bool,
    /// Layers in file order.
    pub layers: Vec<LayerSummary>,
}

/// A layer with the statistics of its channels.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct LayerSummary {
    /// Name of the layer; empty for the unnamed one.
    pub name: String,
    /// Channels in file order.
    pub channels: Vec<ChannelSummary>,
}

/// Statistics of a channel over the display window.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct ChannelSummary {
    /// Description of the channel in the header.
    #[serde(flatten)]
    pub info: ChannelInfo,
    /// Smallest finite sample; `None` if no sample is finite.
    pub min: Option<f32>,
    /// Largest finite sample; `None` if no sample is finite.
    pub max: Option<f32>,
    /// Mean of the finite samples; `None` if no sample is finite.
    pub mean: Option<f64>,
    /// Number of NaN and infinite samples.
    pub non_finite: usize,
}

/// Reads a whole file and computes the statistics of its channels.
///
/// # Errors
/// If [`header`](super::header()) fails, chunks are missing or damaged, or channels are subsampled.
pub fn summary(path: &Path) -> Result<ExrSummary> {
    summary_within(path, Limits::default())
}

/// Reads a whole file and computes the statistics of its channels, chunk by chunk: samples are not kept, and the chunks
/// being decoded must fit into `limits`.
///
/// # Errors
/// The conditions are those of [`summary`], with these limits.
pub fn summary_within(path: &Path, limits: Limits) -> Result<ExrSummary> {
    let (reader, header) = header::open(path)?;
    let layers = header.layers();
    let sources: Vec<Source> =
        layers.iter().flat_map(|l| l.channels.iter().map(|&channel| Source { part: l.part, channel })).collect();
    let mut figures = vec![Figures::default(); sources.len()];
    decode::rows(path, reader, &header, &sources, (0, limits), |row: Row<'_>| figures[row.source].add(row.samples))?;
    let pixels = header.display_window.pixels();
    let mut figures = figures.into_iter();
    let mut parts: Vec<PartSummary> = header.parts.iter().map(part).collect();
    for layer in layers {
        let infos = layer.channels.iter().map(|&c| &header.parts[layer.part].channels[c]);
        let channels = infos.zip(figures.by_ref()).map(|(info, f)| f.summed_up(info, pixels)).collect();
        parts[layer.part].layers.push(LayerSummary { name: layer.name, channels });
    }
    let mut attributes = header.attributes();
    let mut camera = BTreeMap::new();
    for name in ["worldToCamera", "worldToNDC"] {
        if let Some(rows) = attributes.get(name).and_then(|text| matrix(text)) {
            attributes.remove(name);
            camera.insert(name.to_owned(), rows);
        }
    }
    Ok(ExrSummary {
        display_window: header.display_window,
        pixel_aspect: header.pixel_aspect,
        parts,
        camera,
        attributes,
    })
}

/// Parses an attribute's text as the four rows of a matrix; `None` if it is no matrix.
fn matrix(text: &str) -> Option<[[f32; 4]; 4]> {
    let numbers: Vec<f32> = text.split(' ').map(str::parse).collect::<Result<_, _>>().ok()?;
    let numbers: [f32; 16] = numbers.try_into().ok()?;
    Some(std::array::from_fn(|row| std::array::from_fn(|column| numbers[4 * row + column])))
}

fn part(part: &Part) -> PartSummary {
    PartSummary {
        name: part.name.clone(),
        data_window: part.data_window,
        compression: part.compression.clone(),
        tiled: part.tiled,
        layers: Vec::new(),
    }
}

/// Running statistics of a channel's samples.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Figures {
    min: Option<f32>,
    max: Option<f32>,
    sum: f64,
    finite: u64,
    non_finite: usize,
}

impl Figures {
    pub(super) fn add(&mut self, samples: &[f32]) {
        for &v in samples {
            if v.is_finite() {
                self.min = Some(self.min.map_or(v, |m| m.min(v)));
                self.max = Some(self.max.map_or(v, |m| m.max(v)));
                self.sum += f64::from(v);
                self.finite += 1;
            } else {
                self.non_finite += 1;
            }
        }
    }

    /// Statistics of the channel over a display window of `pixels` pixels; pixels without a sample are 0.
    pub(super) fn summed_up(mut self, info: &ChannelInfo, pixels: u64) -> ChannelSummary {
        let outside = pixels.saturating_sub(self.finite + self.non_finite as u64);
        if outside > 0 {
            self.add(&[0.0]);
            self.finite += outside - 1;
        }
        ChannelSummary {
            info: info.clone(),
            min: self.min,
            max: self.max,
            mean: (self.finite > 0).then(|| self.sum / self.finite as f64),
            non_finite: self.non_finite,
        }
    }
}

impl fmt::Display for ExrSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "OpenEXR, display window {}, pixel aspect {}", self.display_window, self.pixel_aspect)?;
        for (i, part) in self.parts.iter().enumerate() {
            let name = part.name.as_deref().map(|n| format!(" '{}'", printable(n))).unwrap_or_default();
            let storage = if part.tiled { "tiles" } else { "scan lines" };
            writeln!(f, "part {i}{name}: data window {}, {storage}, {}", part.data_window, part.compression)?;
            for layer in &part.layers {
                match layer.name.as_str() {
                    "" => writeln!(f, "  unnamed layer")?,
                    name => writeln!(f, "  layer '{}'", printable(name))?,
                }
                layer.channels.iter().try_for_each(|channel| write_channel(f, channel))?;
            }
        }
        for (name, rows) in &self.camera {
            writeln!(f, "camera matrix {name}, for row vectors")?;
            for [a, b, c, d] in rows {
                writeln!(f, "  [{a:>12.6} {b:>12.6} {c:>12.6} {d:>12.6}]")?;
            }
        }
        write_attributes(f, &self.attributes)
    }
}

/// Writes a line on a channel.
pub(super) fn write_channel(f: &mut fmt::Formatter<'_>, channel: &ChannelSummary) -> fmt::Result {
    let kind = format!("{:?}", channel.info.sample_type).to_lowercase();
    write!(f, "    {:<8} {kind:<5}", printable(&channel.info.component))?;
    if let (Some(min), Some(max), Some(mean)) = (channel.min, channel.max, channel.mean) {
        write!(f, "  {min} to {max}, mean {mean:.6}")?;
    }
    if channel.non_finite > 0 {
        write!(f, "  ({} NaN or infinite)", channel.non_finite)?;
    }
    writeln!(f)
}

/// Writes a line on each attribute. Lines of a longer text are indented, so that none passes for an attribute.
pub(super) fn write_attributes(f: &mut fmt::Formatter<'_>, attributes: &BTreeMap<String, String>) -> fmt::Result {
    attributes.iter().try_for_each(|(name, value)| {
        writeln!(f, "{}: {}", printable(name), printable_lines(value).replace('\n', "\n  "))
    })
}
