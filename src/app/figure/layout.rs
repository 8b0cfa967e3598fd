//! The arrangement of a figure: title, panels in rows with their labels, marks in the panels, and the legend.

use super::drawing::{Anchor, BLACK, Color, Drawing, Point, Raster, Shape, Style, WHITE};
use super::legend::Legend;
use super::orientation;
use super::panel::Panel;
use super::scale_bar::{ScaleBar, contrasting};
use super::settings::{Background, FigureSettings};
use crate::error::{Error, Result};

/// Gap between panels in font sizes.
const GAP: f64 = 0.8;
/// Height of a panel's label and of the title in font sizes.
const LABEL: f64 = 1.6;
const TITLE: f64 = 2.2;
/// Colors of the area under the legend's curve, on light and dark pages.
const FILLS: [Color; 2] = [[205; 3], [80; 3]];

/// Elements that are drawn beside the pictures.
pub(super) struct Marks {
    /// Scale bar of each panel; empty for none.
    pub bars: Vec<ScaleBar>,
    pub legend: Option<Legend>,
}

impl FigureSettings {
    /// Returns the number of panels in a row.
    pub(super) fn in_row(&self, panels: usize) -> usize {
        let columns = self.columns.map_or_else(
            || if panels <= 3 { panels } else { (panels as f64).sqrt().ceil() as usize },
            |columns| columns as usize,
        );
        columns.clamp(1, panels.max(1))
    }

    /// Arranges a figure.
    ///
    /// # Errors
    /// If the panels have no room.
    pub(super) fn arrange(&self, panels: &[Panel], marks: &Marks) -> Result<Drawing> {
        let size = self.font_size;
        let columns = self.in_row(panels.len());
        let widest = panels.iter().map(|panel| panel.raster.size[0]).max().unwrap_or_default();
        let width = self.points(columns, widest);
        let gap = GAP * size;
        let each = (width - gap * (columns - 1) as f64) / columns as f64;
        if each < 4.0 * size {
            return Err(Error::invalid(format!(
                "panels would be {:.1} mm wide, with letters of {size} points",
                each.max(0.0) / super::settings::POINTS
            ))
            .hint("give a larger ⟨width⟩, fewer ⟨columns⟩ or a smaller ⟨font_size⟩"));
        }
        let dark = self.background == Some(Background::Black);
        let ink = if dark { WHITE } else { BLACK };
        let background = match self.background {
            None | Some(Background::White) => Some(WHITE),
            Some(Background::Black) => Some(BLACK),
            Some(Background::Transparent) => None,
        };
        let mut drawing = Drawing { size: [width, 0.0], background, shapes: Vec::new() };
        let mut y = 0.0;
        if let Some(title) = &self.title {
            let style = Style { size: 1.25 * size, bold: true, color: ink };
            drawing.text_within(title, [0.5 * width, 1.4 * size], Anchor::Middle, style, width - size);
            y += TITLE * size;
        }
        for (row, line) in panels.chunks(columns).enumerate() {
            if row > 0 {
                y += gap;
            }
            y += if self.label.is_empty() { 0.0 } else { LABEL * size };
            let heights = line.iter().map(|panel| each * panel.raster.size[1] as f64 / panel.raster.size[0] as f64);
            let height = heights.fold(0.0, f64::max);
            for (column, panel) in line.iter().enumerate() {
                let x = column as f64 * (each + gap);
                self.place(&mut drawing, row * columns + column, panel, ([x, y], each), (ink, &marks.bars));
            }
            y += height;
        }
        if let Some(legend) = &marks.legend {
            y += 1.2 * gap;
            let room = (0.8 * width).clamp(width.min(24.0 * size), width);
            let fill = FILLS[usize::from(dark)];
            legend.draw(&mut drawing, [0.5 * (width - room), y], room, size, [ink, fill]);
            y += legend.height(size, room) + 0.3 * size;
        }
        drawing.size[1] = y;
        Ok(drawing)
    }

    /// Draws a panel with its label and marks at a position.
    fn place(
        &self,
        drawing: &mut Drawing,
        number: usize,
        panel: &Panel,
        (at, width): (Point, f64),
        (ink, bars): (Color, &[ScaleBar]),
    ) {
        let [columns, rows] = panel.raster.size;
        let scale = width / columns as f64;
        let extent = [width, rows as f64 * scale];
        let name = panel.picture.display().to_string();
        drawing.shapes.push(Shape::Picture { raster: panel.raster.clone(), at, extent, name });
        let size = self.font_size;
        if let Some(label) = self.label.get(number) {
            let style = Style { size: 1.1 * size, bold: true, color: ink };
            let place = [at[0] + 0.3 * size, at[1] - 0.45 * size];
            drawing.text_within(label, place, Anchor::Start, style, width - 0.6 * size);
        }
        // On a transparent page what lies behind is not known: pages are mostly white.
        let color = |from: [f64; 2], to: [f64; 2]| contrasting(level(&panel.raster, from, to));
        if let Some(bar) = bars.get(number) {
            let color = color([1.0 - (bar.pixels / columns as f64).clamp(0.2, 1.0), 0.85], [1.0, 1.0]);
            bar.draw(drawing, (at, extent), scale, (self.length_unit.as_deref(), size), color);
        }
        if let (Some(orientation), Some(camera)) = (self.orientation, &panel.camera) {
            let reach = orientation.inset() * size;
            let ink = color([0.0, 1.0 - (2.0 * reach / extent[1]).min(1.0)], [(2.0 * reach / width).min(1.0), 1.0]);
            let middle = [at[0] + reach, at[1] + extent[1] - reach];
            orientation::draw(orientation, drawing, camera, middle, size, ink);
        }
    }
}

/// Mean display level of a part of a picture, whose corners are shares of its sides, over white.
fn level(raster: &Raster, from: [f64; 2], to: [f64; 2]) -> f64 {
    let [width, height] = raster.size;
    let range = |axis: usize, side: usize| {
        let last = side.saturating_sub(1);
        let first = ((from[axis] * side as f64) as usize).min(last);
        first..((to[axis] * side as f64).ceil() as usize).clamp(first + 1, side.max(first + 1))
    };
    let (mut sum, mut count) = (0.0, 0.0);
    for y in range(1, height) {
        for x in range(0, width) {
            if let Some([r, g, b, a]) = raster.rgba.get(4 * (y * width + x)..4 * (y * width + x) + 4) {
                let luma = 0.2126 * f64::from(*r) + 0.7152 * f64::from(*g) + 0.0722 * f64::from(*b);
                let alpha = f64::from(*a) / 255.0;
                sum += alpha * luma + 255.0 * (1.0 - alpha);
                count += 1.0;
            }
        }
    }
    if count > 0.0 { sum / count } else { 255.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_means_of_a_part() {
        let rgba = [[0, 0, 0, 255], [255, 255, 255, 255], [0, 0, 0, 0], [255, 255, 255, 255]].concat();
        let raster = Raster { size: [2, 2], rgba };
        assert!((level(&raster, [0.0, 0.0], [1.0, 0.5]) - 127.5).abs() < 1e-9);
        assert_eq!(level(&raster, [0.0, 0.5], [0.4, 1.0]), 255.0);
        assert_eq!(level(&raster, [0.0, 0.0], [0.5, 0.5]), 0.0);
    }

    #[test]
    fn rows_are_full() {
        let settings = FigureSettings::default();
        assert_eq!([1, 2, 3, 4, 5, 9, 10].map(|n| settings.in_row(n)), [1, 2, 3, 2, 3, 3, 4]);
        assert_eq!(FigureSettings { columns: Some(4), ..settings }.in_row(3), 3);
    }
}
