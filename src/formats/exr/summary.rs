//! An OpenEXR file in figures, for `info`.

use super::header::{ChannelInfo, Part};
use super::{Channel, Window, header, read};
use crate::error::Result;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// A file in figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ExrSummary {
    /// Window that the picture is for.
    pub display_window: Window,
    /// Width over height of a pixel.
    pub pixel_aspect: f32,
    /// Parts in file order.
    pub parts: Vec<PartSummary>,
    /// Matrices of the camera (`worldToCamera`, `worldToNDC`), row by row, where the file has them. As
    /// OpenEXR has it, points are row vectors: the translation is the last row.
    pub camera: BTreeMap<String, [[f32; 4]; 4]>,
    /// All other attributes.
    pub attributes: BTreeMap<String, String>,
}

/// A part in figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PartSummary {
    /// Name, where it has one.
    pub name: Option<String>,
    /// Pixels that are stored.
    pub data_window: Window,
    /// Compression in the `exr` crate's words.
    pub compression: String,
    /// Tiles instead of scan lines.
    pub tiled: bool,
    /// Layers in file order.
    pub layers: Vec<LayerSummary>,
}

/// A layer in figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LayerSummary {
    /// Name; empty for the unnamed layer.
    pub name: String,
    /// Channels in file order.
    pub channels: Vec<ChannelSummary>,
}

/// A channel in figures, over the display window.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChannelSummary {
    /// Header entry.
    #[serde(flatten)]
    pub info: ChannelInfo,
    /// Smallest finite sample; none if no sample is finite.
    pub min: Option<f32>,
    /// Largest finite sample.
    pub max: Option<f32>,
    /// Mean of the finite samples.
    pub mean: Option<f64>,
    /// NaN and infinite samples.
    pub non_finite: usize,
}

/// Reads a whole file and sums it up.
///
/// # Errors
/// As [`read`](super::read()).
pub fn summary(path: &Path) -> Result<ExrSummary> {
    let header = header(path)?;
    let image = read(path)?;
    let mut layers = image.layers.into_iter();
    let infos = header.layers();
    let mut parts: Vec<PartSummary> = header.parts.iter().map(part).collect();
    for (info, layer) in infos.iter().zip(layers.by_ref()) {
        let channels = info.channels.iter().zip(&layer.channels);
        parts[info.part].layers.push(LayerSummary {
            name: layer.name.clone(),
            channels: channels.map(|(&c, channel)| figures(&header.parts[info.part].channels[c], channel)).collect(),
        });
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

/// An attribute's text as four rows, if it is a matrix.
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

fn figures(info: &ChannelInfo, channel: &Channel) -> ChannelSummary {
    let finite = || channel.samples.iter().copied().filter(|v| v.is_finite());
    let count = channel.samples.len() - channel.non_finite;
    ChannelSummary {
        info: info.clone(),
        min: finite().reduce(f32::min),
        max: finite().reduce(f32::max),
        mean: (count > 0).then(|| finite().map(f64::from).sum::<f64>() / count as f64),
        non_finite: channel.non_finite,
    }
}

impl fmt::Display for ExrSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "OpenEXR, display window {}, pixel aspect {}", self.display_window, self.pixel_aspect)?;
        for (i, part) in self.parts.iter().enumerate() {
            let name = part.name.as_deref().map(|n| format!(" '{n}'")).unwrap_or_default();
            let storage = if part.tiled { "tiles" } else { "scan lines" };
            writeln!(f, "part {i}{name}: data window {}, {storage}, {}", part.data_window, part.compression)?;
            for layer in &part.layers {
                match layer.name.as_str() {
                    "" => writeln!(f, "  unnamed layer")?,
                    name => writeln!(f, "  layer '{name}'")?,
                }
                for c in &layer.channels {
                    let kind = format!("{:?}", c.info.sample_type).to_lowercase();
                    write!(f, "    {:<8} {kind:<5}", c.info.component)?;
                    if let (Some(min), Some(max), Some(mean)) = (c.min, c.max, c.mean) {
                        write!(f, "  {min} to {max}, mean {mean:.6}")?;
                    }
                    if c.non_finite > 0 {
                        write!(f, "  ({} NaN or infinite)", c.non_finite)?;
                    }
                    writeln!(f)?;
                }
            }
        }
        for (name, rows) in &self.camera {
            writeln!(f, "camera matrix {name}, for row vectors")?;
            for [a, b, c, d] in rows {
                writeln!(f, "  [{a:>12.6} {b:>12.6} {c:>12.6} {d:>12.6}]")?;
            }
        }
        for (name, value) in &self.attributes {
            writeln!(f, "{name}: {value}")?;
        }
        Ok(())
    }
}
