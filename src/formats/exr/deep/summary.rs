//! Statistics of a deep picture, for `info`.

use super::DeepLine;
use super::header::{Component, open};
use super::problems::Order;
use crate::error::Result;
use crate::formats::exr::Window;
use crate::formats::exr::summary::{ChannelSummary, Figures, write_attributes, write_channel};
use crate::formats::limits::Limits;
use crate::text::printable;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// Header and statistics of a deep picture.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct DeepSummary {
    /// Window that the picture is meant to cover.
    pub display_window: Window,
    /// Window of the pixels that are stored.
    pub data_window: Window,
    /// Width over height of a pixel.
    pub pixel_aspect: f32,
    /// Name of the part, if it has one.
    pub part: Option<String>,
    /// Compression as the `exr` crate names it.
    pub compression: String,
    /// True if the samples are stored in tiles, false for scan lines.
    pub tiled: bool,
    /// Number of samples of all pixels.
    pub samples: u64,
    /// Number of samples of the pixels of the data window.
    pub samples_per_pixel: SamplesPerPixel,
    /// Number of pixels of the data window without samples.
    pub empty_pixels: u64,
    /// Nearest front and farthest back of the samples with finite depths; none without such samples.
    pub depth: Option<[f32; 2]>,
    /// True if the samples of all pixels are sorted by depth.
    pub sorted: bool,
    /// True if they are sorted and none overlaps another.
    pub tidy: bool,
    /// Channels in file order with the statistics of their samples; those that are not read have none.
    pub channels: Vec<ChannelSummary>,
    /// Attributes as text.
    pub attributes: BTreeMap<String, String>,
}

/// Number of samples of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub struct SamplesPerPixel {
    /// Least of all pixels.
    pub min: u32,
    /// Mean over all pixels.
    pub mean: f64,
    /// Most of all pixels.
    pub max: u32,
}

/// Running statistics of samples.
struct Running {
    least: u32,
    most: u32,
    empty: u64,
    depth: Option<[f32; 2]>,
    order: Order,
    z: Figures,
    z_back: Figures,
    rgba: [Figures; 4],
}

impl Running {
    fn add(&mut self, line: &DeepLine) {
        for &count in &line.counts {
            (self.least, self.most) = (self.least.min(count), self.most.max(count));
            self.empty += u64::from(count == 0);
        }
        self.order = line.pixels().map(Order::of).fold(self.order, Order::min);
        for sample in &line.samples {
            self.z.add(&[sample.z]);
            self.z_back.add(&[sample.z_back]);
            self.rgba.iter_mut().zip(sample.rgba).for_each(|(figures, value)| figures.add(&[value]));
            let back = sample.z_back.max(sample.z);
            if sample.z.is_finite() && back.is_finite() {
                let [near, far] = self.depth.unwrap_or([sample.z, back]);
                self.depth = Some([near.min(sample.z), far.max(back)]);
            }
        }
    }
}

/// Reads a whole deep picture and computes its statistics, row by row: samples are not kept, and the chunks being
/// unpacked must fit into `limits`.
///
/// # Errors
/// The conditions are those of [`read_within`](super::read_within).
pub fn summary_within(path: &Path, limits: Limits) -> Result<DeepSummary> {
    let mut source = open(path, limits)?;
    let mut running = Running {
        least: u32::MAX,
        most: 0,
        empty: 0,
        depth: None,
        order: Order::Tidy,
        z: Figures::default(),
        z_back: Figures::default(),
        rgba: [Figures::default(); 4],
    };
    let samples = source.samples();
    source.lines((0, limits), |_, line| {
        running.add(&line);
        Ok(())
    })?;
    let channels = source.described_channels().map(|(info, component)| {
        let figures = match component {
            Component::Z => running.z,
            Component::ZBack => running.z_back,
            Component::Rgba(number) => running.rgba[number],
            Component::Other => Figures::default(),
        };
        figures.summed_up(info, 0)
    });
    let channels = channels.collect();
    let part = source.part();
    let pixels = part.data_window.pixels();
    Ok(DeepSummary {
        display_window: source.header.display_window,
        data_window: part.data_window,
        pixel_aspect: source.header.pixel_aspect,
        part: part.name.clone(),
        compression: part.compression.clone(),
        tiled: part.tiled,
        samples,
        samples_per_pixel: SamplesPerPixel {
            min: running.least.min(running.most),
            mean: samples as f64 / pixels.max(1) as f64,
            max: running.most,
        },
        empty_pixels: running.empty,
        depth: running.depth,
        sorted: running.order >= Order::Sorted,
        tidy: running.order == Order::Tidy,
        channels,
        attributes: source.header.attributes(),
    })
}

impl fmt::Display for DeepSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "deep OpenEXR, display window {}, pixel aspect {}", self.display_window, self.pixel_aspect)?;
        let name = self.part.as_deref().map(|n| format!("part '{}': ", printable(n))).unwrap_or_default();
        let storage = if self.tiled { "tiles" } else { "scan lines" };
        writeln!(f, "{name}data window {}, {storage}, {}", self.data_window, self.compression)?;
        let SamplesPerPixel { min, mean, max } = self.samples_per_pixel;
        writeln!(
            f,
            "{} samples, {min} to {max} a pixel, mean {mean:.3}; {} pixels are empty",
            self.samples, self.empty_pixels
        )?;
        if let Some([near, far]) = self.depth {
            writeln!(f, "depth {near} to {far}")?;
        }
        let order = match (self.sorted, self.tidy) {
            (_, true) => "tidy: sorted by depth, and none overlaps another",
            (true, _) => "sorted by depth, and some overlap",
            _ => "not sorted by depth",
        };
        writeln!(f, "samples are {order}")?;
        self.channels.iter().try_for_each(|channel| write_channel(f, channel))?;
        write_attributes(f, &self.attributes)
    }
}
