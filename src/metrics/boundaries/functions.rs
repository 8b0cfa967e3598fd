//! Transfer functions that show the boundaries of a volume.

use super::{Analysis, Boundary, MOST_BOUNDARIES};
use crate::scene::transfer::Transfer;

/// Colors of the boundaries in ascending order of value, and of the two signs of a ramp, display-referred (sRGB): of
/// Okabe and Ito's palette, which readers with any kind of color vision tell apart.
pub const COLORS: [[u8; 3]; MOST_BOUNDARIES] = [[86, 180, 233], [213, 94, 0], [0, 158, 115], [240, 228, 66]];

/// Optical depth of the innermost boundary, passed straight; and of a ramp, through the volume on the average.
const DEPTH: f64 = 1.5;
/// Ratio of the optical depths of a boundary and the next one inside.
const OUTER: f64 = 0.3;
/// Least part of the range on a side of the background that a ramp shows.
const LEAST_SIDE: f64 = 0.1;

/// A transfer function that suits a volume.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Name by what it shows: `all boundaries`, `boundary 1` and so on in ascending order of value, or `ramp`.
    pub name: String,
    /// The function, in the data's own units.
    pub transfer: Transfer,
}

/// Values at which a boundary's extinction begins, peaks and ends.
type Bump = [f64; 3];

impl Analysis {
    /// Returns the functions, of which there is one at least: all boundaries together, outer ones more transparent than
    /// inner ones; each one alone; and a ramp from the outermost boundary on. None is opaque at the background.
    pub fn candidates(&self) -> Vec<Candidate> {
        let bumps = self.bumps();
        let alone = |i: usize| self.bump(i, bumps[i], DEPTH);
        let mut all = Vec::new();
        if bumps.len() > 1 {
            let depths = self.depths();
            let points = (0..bumps.len()).flat_map(|i| self.bump(i, bumps[i], depths[i])).collect();
            all.push(Candidate { name: "all boundaries".into(), transfer: Transfer::Piecewise { points } });
        }
        all.extend((0..bumps.len()).map(|i| Candidate {
            name: format!("boundary {}", i + 1),
            transfer: Transfer::Piecewise { points: alone(i) },
        }));
        all.push(Candidate { name: "ramp".into(), transfer: Transfer::Piecewise { points: self.ramp() } });
        all
    }

    /// Bumps of all boundaries: of the half width, ending where that of the next boundary or the background begins.
    fn bumps(&self) -> Vec<Bump> {
        let b = &self.boundaries;
        let midway = |a: &Boundary, b: &Boundary| 0.5 * (a.value + b.value);
        let [below, above] = [self.background - self.spread, self.background + self.spread];
        (0..b.len())
            .map(|i| {
                let Boundary { value, half_width, .. } = b[i];
                let mut low = value - half_width;
                let mut high = value + half_width;
                if i > 0 {
                    low = low.max(midway(&b[i - 1], &b[i]));
                }
                if let Some(next) = b.get(i + 1) {
                    high = high.min(midway(&b[i], next));
                }
                if value > above {
                    low = low.max(above);
                } else if value < below {
                    high = high.min(below);
                }
                [low, value, high]
            })
            .collect()
    }

    /// Points of a boundary's bump whose optical depth along the gradient is `depth`.
    fn bump(&self, i: usize, [low, value, high]: Bump, depth: f64) -> Vec<[f64; 5]> {
        // The value passes from one end to the other within this length.
        let length = (high - low) / self.boundaries[i].gradient;
        let [r, g, b] = linear(COLORS[i]);
        let peak = 2.0 * depth / length;
        [(low, 0.0), (value, peak), (high, 0.0)].map(|(at, extinction)| [at, r, g, b, extinction]).to_vec()
    }

    /// Optical depths of all boundaries: those whose values are nearer to the background's lie farther out.
    pub(super) fn depths(&self) -> Vec<f64> {
        let apart = |boundary: &Boundary| (boundary.value - self.background).abs();
        let inside = |boundary: &Boundary| self.boundaries.iter().filter(|b| apart(b) > apart(boundary)).count();
        self.boundaries.iter().map(|boundary| DEPTH * OUTER.powi(inside(boundary) as i32)).collect()
    }

    /// Points of an extinction that grows with the distance from the background, on both of its sides if there are
    /// values enough, from the outermost boundary on if there is one.
    fn ramp(&self) -> Vec<[f64; 5]> {
        let [low, high] = self.range;
        let bumps = self.bumps();
        let [mut below, mut above] = [self.background - self.spread, self.background + self.spread];
        if let Some([start, ..]) = bumps.iter().find(|bump| bump[1] > self.background) {
            above = start.max(above);
        }
        if let Some([.., end]) = bumps.iter().rfind(|bump| bump[1] < self.background) {
            below = end.min(below);
        }
        let least = LEAST_SIDE * (high - low);
        let down = below - low > least;
        let up = !down || high - above > least;
        let top = high.max(above + least);
        let reach = f64::max(if down { below - low } else { 0.0 }, if up { top - above } else { 0.0 });
        let shape = |value: f64| {
            let apart = [(down, below - value), (up, value - above)].into_iter().filter(|(shown, _)| *shown);
            (apart.fold(0.0, |most: f64, (_, apart)| most.max(apart)) / reach).min(1.0)
        };
        let peak = self.ramp_peak(shape);
        let point = |value: f64, color: [u8; 3]| {
            let [r, g, b] = linear(color);
            [value, r, g, b, peak * shape(value)]
        };
        let [cool, warm, _, light] = COLORS;
        let falling = if down { vec![point(low, cool), point(below, cool)] } else { Vec::new() };
        let rising = if up { vec![point(above, warm), point(top, light)] } else { Vec::new() };
        falling.into_iter().chain(rising).collect()
    }

    /// Extinction at the end of a ramp at which the volume's mean optical depth is [`DEPTH`].
    fn ramp_peak(&self, shape: impl Fn(f64) -> f64) -> f64 {
        let width = (self.range[1] - self.range[0]) / self.histogram.len() as f64;
        let centre = |bin: usize| self.range[0] + (bin as f64 + 0.5) * width;
        let sum: f64 = self.histogram.iter().enumerate().map(|(bin, count)| *count as f64 * shape(centre(bin))).sum();
        let mean = self.filled * sum / self.cells as f64;
        let peak = DEPTH / (mean * self.edge);
        if peak.is_finite() { peak } else { 1.0 / self.edge }
    }
}

/// Scene-linear values of a display-referred color (sRGB).
fn linear(color: [u8; 3]) -> [f64; 3] {
    color.map(|level| {
        let v = f64::from(level) / 255.0;
        if v > 0.040_45 { ((v + 0.055) / 1.055).powf(2.4) } else { v / 12.92 }
    })
}
