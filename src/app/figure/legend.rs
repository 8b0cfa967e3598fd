//! The legend of a figure: the colors of a transfer function.

use super::bar::Bar;
use super::drawing::{Color, Drawing, Point};
use super::report::LegendReport;
use super::swatches::Swatches;
use crate::error::Result;
use crate::formats::png::ToneMapping;
use crate::scene::transfer::Transfer;

/// Legend of a transfer function.
pub(super) enum Legend {
    /// Colors over a range of densities.
    Bar(Bar),
    /// Colors of classes.
    Swatches(Swatches),
}

impl Legend {
    /// Makes the legend of a function. `caption` stands below it, and `length_unit` is a unit of world lengths.
    ///
    /// # Errors
    /// If the function has one density alone, or too many classes.
    pub(super) fn new(
        transfer: &Transfer,
        tone: ToneMapping,
        caption: Option<String>,
        length_unit: Option<&str>,
    ) -> Result<Self> {
        Ok(match transfer {
            Transfer::Labels { classes } => Self::Swatches(Swatches::new(classes, tone, caption)?),
            _ => Self::Bar(Bar::new(transfer, tone, caption, length_unit)?),
        })
    }

    /// Height in points at a font size in points, within a width.
    pub(super) fn height(&self, size: f64, width: f64) -> f64 {
        match self {
            Self::Bar(bar) => bar.height(size),
            Self::Swatches(swatches) => swatches.height(size, width),
        }
    }

    /// Draws the legend at a position, within a width, in the colors of text and of what is filled.
    pub(super) fn draw(&self, drawing: &mut Drawing, at: Point, width: f64, size: f64, [ink, fill]: [Color; 2]) {
        match self {
            Self::Bar(bar) => bar.draw(drawing, at, width, size, [ink, fill]),
            Self::Swatches(swatches) => swatches.draw(drawing, at, width, size, ink),
        }
    }

    /// Returns the report.
    pub(super) fn report(&self) -> LegendReport {
        match self {
            Self::Bar(bar) => {
                LegendReport { range: bar.range, ticks: bar.ticks.clone(), largest_extinction: bar.peak, classes: None }
            }
            Self::Swatches(swatches) => LegendReport {
                range: swatches.range,
                ticks: Vec::new(),
                largest_extinction: swatches.peak,
                classes: Some(swatches.len()),
            },
        }
    }
}
