//! What `info` and `validate` say of an OpenEXR file.

use super::header::{ChannelInfo, Part};
use super::{Channel, Window, header, read};
use crate::error::Result;
use crate::formats::problem::Problem;
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
    /// Matrices of the camera (`worldToCamera`, `worldToNDC`), row by row, where the file has them.
    pub camera: BTreeMap<String, String>,
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
    let (camera, attributes) =
        header.attributes().into_iter().partition(|(name, _)| matches!(name.as_str(), "worldToCamera" | "worldToNDC"));
    Ok(ExrSummary {
        display_window: header.display_window,
        pixel_aspect: header.pixel_aspect,
        parts,
        camera,
        attributes,
    })
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

/// What is wrong with a file; empty if nothing is. A file that cannot be read is one problem.
pub fn problems(path: &Path) -> Vec<Problem> {
    let summary = match summary(path) {
        Ok(summary) => summary,
        Err(error) => return vec![error.into()],
    };
    let mut found = Vec::new();
    for (i, part) in summary.parts.iter().enumerate() {
        for channel in part.layers.iter().flat_map(|l| &l.channels).filter(|c| c.non_finite > 0) {
            found.push(Problem::new(
                format!(
                    "{}: channel '{}' has {} NaN or infinite samples",
                    path.display(),
                    channel.info.name,
                    channel.non_finite
                ),
                "render it again, or fill the holes before it is used",
            ));
        }
        if apart(&part.data_window, &summary.display_window) {
            found.push(Problem::new(
                format!(
                    "{}: part {i} is stored at {}, outside the display window {}",
                    path.display(),
                    part.data_window,
                    summary.display_window
                ),
                "nothing of it would be seen; correct the windows",
            ));
        }
    }
    if !(summary.pixel_aspect.is_finite() && summary.pixel_aspect > 0.0) {
        found.push(Problem::new(
            format!("{}: pixel aspect ratio {}", path.display(), summary.pixel_aspect),
            "a positive number is expected, 1 for square pixels",
        ));
    }
    found
}

fn apart(a: &Window, b: &Window) -> bool {
    (0..2).any(|axis| a.end(axis) <= i64::from(b.min[axis]) || b.end(axis) <= i64::from(a.min[axis]))
}

impl fmt::Display for ExrSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "OpenEXR, display window {}, pixel aspect {}", self.display_window, self.pixel_aspect)?;
        for (i, part) in self.parts.iter().enumerate() {
            let name = part.name.as_deref().map(|n| format!(" '{n}'")).unwrap_or_default();
            let storage = if part.tiled { "tiles" } else { "scan lines" };
            writeln!(f, "part {i}{name}: data window {}, {storage}, {}", part.data_window, part.compression)?;
            for layer in &part.layers {
                writeln!(f, "  layer '{}'", layer.name)?;
                for c in &layer.channels {
                    let kind = format!("{:?}", c.info.sample_type).to_lowercase();
                    write!(f, "    {:<8} {kind:<5}", c.info.component)?;
                    if let (Some(min), Some(max), Some(mean)) = (c.min, c.max, c.mean) {
                        write!(f, "  {min} to {max}, mean {mean:.6}")?;
                    }
                    if c.non_finite > 0 {
                        write!(f, "  {} NaN or infinite", c.non_finite)?;
                    }
                    writeln!(f)?;
                }
            }
        }
        for (name, value) in self.camera.iter().chain(&self.attributes) {
            writeln!(f, "{name}: {value}")?;
        }
        Ok(())
    }
}
