//! Histograms as pictures.

use super::{Canvas, Font, INK, PALE, PAPER};
use crate::report::number;

/// Counts of values in bins of equal width.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Histogram {
    /// Number of values in each bin.
    pub counts: Vec<u64>,
    /// Lower edge of the first bin, and upper edge of the last.
    pub range: [f64; 2],
}

const BAR: [u8; 3] = [58, 104, 172];
/// Room above the bars, and below them for the edges' numbers.
const TOP: usize = 20;
const BOTTOM: usize = 24;

impl Histogram {
    /// Edges of all bins, one more than there are bins.
    pub(crate) fn edges(&self) -> Vec<f64> {
        let [low, high] = self.range;
        let count = self.counts.len().max(1);
        (0..=count).map(|i| low + (high - low) * i as f64 / count as f64).collect()
    }

    /// Draws the bars over a line with a tick at every edge and numbers at as many as have room. Heights are logarithms
    /// of counts: most voxels of a cloud are all but empty.
    pub(crate) fn draw(&self, width: usize, height: usize) -> Canvas {
        let mut canvas = Canvas::new(width, height, PAPER);
        let count = self.counts.len().max(1);
        let floor = height.saturating_sub(BOTTOM);
        let level = |count: u64| (1.0 + count as f64).ln();
        let top = self.counts.iter().copied().max().unwrap_or(0);
        let edge = |i: usize| i * (width - 1) / count;
        for (i, n) in self.counts.iter().enumerate() {
            let share = if top > 0 { level(*n) / level(top) } else { 0.0 };
            let bar = (share * floor.saturating_sub(TOP) as f64).round() as usize;
            canvas.fill([edge(i) + 1, floor - bar], [(edge(i + 1) - edge(i)).saturating_sub(1).max(1), bar], BAR);
        }
        canvas.fill([0, floor], [width, 1], INK);
        for i in 0..=count {
            canvas.fill([edge(i), floor], [1, 4], INK);
        }
        let labels: Vec<String> = self.edges().into_iter().map(number::short).collect();
        let widest = labels.iter().map(|l| Font::Small.width(l)).max().unwrap_or(0) * 3 / 2;
        let step = (1..=count).find(|s| count.is_multiple_of(*s) && edge(*s) >= widest).unwrap_or(count);
        for i in (0..=count).step_by(step) {
            let own = Font::Small.width(&labels[i]);
            let x = edge(i).saturating_sub(own / 2).min(width.saturating_sub(own));
            canvas.text([x, floor + 6], &labels[i], Font::Small, INK);
        }
        canvas.text([2, 0], &format!("most in a bin: {top}"), Font::Small, PALE);
        canvas
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_grow_with_counts() {
        let histogram = Histogram { counts: vec![1000, 0, 10, 100], range: [-1.0, 3.0] };
        assert_eq!(histogram.edges(), [-1.0, 0.0, 1.0, 2.0, 3.0]);
        let canvas = histogram.draw(161, 120);
        let bar = |i: usize| (0..120).filter(|y| canvas.pixel(20 + 40 * i, *y) == BAR).count();
        let heights = [0, 1, 2, 3].map(bar);
        assert_eq!((heights[0], heights[1]), (120 - TOP - BOTTOM, 0));
        assert!(heights[2] < heights[3] && heights[3] < heights[0], "{heights:?}");
        // Nothing to show is shown as that.
        Histogram { counts: vec![], range: [0.0, 0.0] }.draw(40, 50);
        Histogram { counts: vec![0; 16], range: [1.0, 1.0] }.draw(1, 1);
    }
}
