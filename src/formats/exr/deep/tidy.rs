//! Pixels whose samples are sorted and do not overlap, and what they show up to a depth.
//!
//! F. Kainz, "Interpreting OpenEXR Deep Pixels": a volume of opacity α and color C of which a share x is taken has the
//! opacity α' = 1 - (1 - α)ˣ and the color C α'/α (x C where α is 0). Samples at the same place with optical depths
//! u = -ln(1 - α) become one of u = Σ uᵢ, α = 1 - e⁻ᵘ and C = (α/u) Σ Cᵢ uᵢ/αᵢ; the opaque ones among them hide the
//! others and are averaged.

use super::DeepSample;
use super::running_sum::RunningSum;

/// A sample of a tidy pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Distance of the front.
    pub z: f64,
    /// Distance of the back; `z` for a point.
    pub z_back: f64,
    /// Premultiplied color, seen from the front.
    pub color: [f64; 3],
    /// Opacity, from 0 to 1.
    pub alpha: f64,
}

impl Interval {
    /// Returns the optical depth of a part of a volume of that length.
    fn optical_depth(&self, length: f64) -> f64 {
        if self.alpha == 1.0 { f64::INFINITY } else { -(-self.alpha).ln_1p() * length / (self.z_back - self.z) }
    }

    /// Returns the part in front of a depth within a volume.
    fn in_front_of(&self, z: f64) -> Self {
        let share = ((z - self.z) / (self.z_back - self.z)).clamp(0.0, 1.0);
        if self.alpha == 1.0 {
            return Self { z_back: z, ..*self };
        }
        let alpha = -(share * (-self.alpha).ln_1p()).exp_m1();
        let factor = if self.alpha == 0.0 { share } else { alpha / self.alpha };
        Self { z: self.z, z_back: z, color: self.color.map(|c| c * factor), alpha }
    }
}

/// Samples of a pixel from front to back, none of which overlaps another.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TidyPixel(Vec<Interval>);

impl TidyPixel {
    /// Makes samples tidy: sorts them, splits volumes where others begin or end, and merges those at the same place.
    /// Opacities are clamped to 0 to 1. No depth may be NaN; a volume without end counts as a point. Samples that lie
    /// at the same depth as points are merged, and lie behind volumes that end there and before those that begin.
    ///
    /// Takes n log n steps for n samples, however many of them overlap.
    pub fn new(samples: &[DeepSample]) -> Self {
        let (mut volumes, mut points) = (Vec::new(), Vec::new());
        for sample in samples {
            let extent = Extent::of(sample);
            if extent.is_volume() { volumes.push(extent) } else { points.push(extent) }
        }
        points.sort_by(|a, b| a.z.total_cmp(&b.z));
        let mut starts: Vec<&Extent> = volumes.iter().collect();
        starts.sort_by(|a, b| a.z.total_cmp(&b.z));
        let mut ends: Vec<&Extent> = volumes.iter().collect();
        ends.sort_by(|a, b| a.z_back.total_cmp(&b.z_back));
        let mut depths: Vec<f64> = volumes.iter().flat_map(|v| [v.z, v.z_back]).collect();
        depths.extend(points.iter().map(|p| p.z));
        depths.sort_by(f64::total_cmp);
        depths.dedup();

        let (mut starts, mut ends) = (starts.into_iter().peekable(), ends.into_iter().peekable());
        let mut points = points.iter().peekable();
        let (mut tidy, mut inside) = (Vec::with_capacity(depths.len()), Mixture::default());
        for (k, &z) in depths.iter().enumerate() {
            while let Some(volume) = ends.next_if(|v| v.z_back <= z) {
                inside.add(volume, -1.0 / (volume.z_back - volume.z));
            }
            let mut merged = Mixture::default();
            while let Some(point) = points.next_if(|p| p.z <= z) {
                merged.add(point, 1.0);
            }
            tidy.extend(merged.over(1.0).map(|(color, alpha)| Interval { z, z_back: z, color, alpha }));
            while let Some(volume) = starts.next_if(|v| v.z <= z) {
                inside.add(volume, 1.0 / (volume.z_back - volume.z));
            }
            if let Some(&z_back) = depths.get(k + 1) {
                let through = inside.over(z_back - z);
                tidy.extend(through.map(|(color, alpha)| Interval { z, z_back, color, alpha }));
            }
        }
        Self(tidy)
    }

    /// Samples from front to back.
    pub fn intervals(&self) -> &[Interval] {
        &self.0
    }

    /// Premultiplied color and opacity of the whole pixel.
    pub fn rgba(&self) -> [f64; 4] {
        composited(self.0.iter().copied())
    }

    /// Premultiplied color and opacity of what lies before a depth: what hides an object there. A point at the depth
    /// itself does not count; of a volume that reaches beyond the depth the part before it does.
    pub fn rgba_before(&self, z: f64) -> [f64; 4] {
        let before = self.0.iter().take_while(|interval| interval.z < z);
        composited(before.map(|interval| if interval.z_back > z { interval.in_front_of(z) } else { *interval }))
    }

    /// Opacity of what lies before a depth, as [`Self::rgba_before`] tells it.
    pub fn alpha_before(&self, z: f64) -> f64 {
        self.rgba_before(z)[3]
    }

    /// Premultiplied color of what lies before a depth, as [`Self::rgba_before`] tells it.
    pub fn color_before(&self, z: f64) -> [f64; 3] {
        let [r, g, b, _] = self.rgba_before(z);
        [r, g, b]
    }

    /// Premultiplied color and opacity of what is seen of the pixel where another one holds it out: what lies behind or
    /// within the other is hidden as far as that is opaque, and the other itself shows nothing. A point hides what lies
    /// at its own depth.
    pub fn rgba_held_out(&self, holdout: &Self) -> [f64; 4] {
        let mut depths: Vec<f64> = self.0.iter().chain(&holdout.0).flat_map(|i| [i.z, i.z_back]).collect();
        depths.sort_by(f64::total_cmp);
        depths.dedup();
        let (mut own, mut others) = (Cursor(&self.0), Cursor(&holdout.0));
        let (mut rgba, mut through, mut open) = ([0.0; 4], 1.0, 1.0);
        for (k, &z) in depths.iter().enumerate() {
            while let Some(point) = others.point(z) {
                open *= 1.0 - point.alpha;
            }
            while let Some(Interval { color: [r, g, b], alpha, .. }) = own.point(z) {
                rgba.iter_mut().zip([r, g, b, alpha]).for_each(|(sum, v)| *sum += through * open * v);
                through *= 1.0 - alpha;
            }
            let Some(&end) = depths.get(k + 1).filter(|_| through * open > 0.0) else { break };
            let hidden = others.volume(z).map_or(0.0, |volume| volume.optical_depth(end - z));
            if let Some(volume) = own.volume(z) {
                let Interval { color: [r, g, b], alpha, .. } = *volume;
                let depth = volume.optical_depth(end - z);
                // What reaches the front of what glows along the part, through both. An opaque volume shows its front.
                let seen = if alpha == 1.0 {
                    1.0
                } else {
                    let share = (end - z) / (volume.z_back - volume.z);
                    let glow = if alpha == 0.0 { share } else { depth / alpha };
                    glow * mean_transmittance(depth + hidden)
                };
                rgba.iter_mut().zip([r, g, b, alpha]).for_each(|(sum, v)| *sum += through * open * seen * v);
                through *= (-depth).exp();
            }
            open *= (-hidden).exp();
        }
        rgba
    }

    /// Depth of the front of the nearest sample that is not fully transparent.
    pub fn depth(&self) -> Option<f64> {
        self.0.iter().find(|interval| interval.alpha > 0.0).map(|interval| interval.z)
    }
}

/// Mean transmittance from the front to the places of a homogeneous medium of an optical depth.
fn mean_transmittance(optical_depth: f64) -> f64 {
    if optical_depth == 0.0 { 1.0 } else { -(-optical_depth).exp_m1() / optical_depth }
}

/// Samples of a tidy pixel of which those before a depth are done with.
struct Cursor<'p>(&'p [Interval]);

impl<'p> Cursor<'p> {
    /// Returns the next point at a depth.
    fn point(&mut self, z: f64) -> Option<&'p Interval> {
        while let Some((first, rest)) = self.0.split_first().filter(|(first, _)| first.z_back <= z) {
            self.0 = rest;
            if first.z == first.z_back && first.z == z {
                return Some(first);
            }
        }
        None
    }

    /// Returns the volume that goes on behind a depth, none of which end there any more.
    fn volume(&self, z: f64) -> Option<&'p Interval> {
        self.0.first().filter(|first| first.z <= z && first.z_back > z)
    }
}

/// Composites samples from front to back by "over". Opacity is summed up, since 1 minus the transmittance has no digits
/// left where it is small.
fn composited(intervals: impl Iterator<Item = Interval>) -> [f64; 4] {
    let (mut rgba, mut transmittance) = ([0.0; 4], 1.0);
    for Interval { color: [r, g, b], alpha, .. } in intervals {
        for (sum, term) in rgba.iter_mut().zip([r, g, b, alpha]) {
            *sum += transmittance * term;
        }
        transmittance *= 1.0 - alpha;
        if transmittance == 0.0 {
            rgba[3] = 1.0;
            break;
        }
    }
    rgba
}

/// A sample in double precision.
struct Extent {
    z: f64,
    z_back: f64,
    color: [f64; 3],
    alpha: f64,
}

impl Extent {
    fn of(sample: &DeepSample) -> Self {
        let [r, g, b, alpha] = sample.rgba.map(f64::from);
        Self { z: sample.z.into(), z_back: sample.z_back.into(), color: [r, g, b], alpha: alpha.clamp(0.0, 1.0) }
    }

    fn is_volume(&self) -> bool {
        self.z_back > self.z && self.z.is_finite() && self.z_back.is_finite()
    }
}

/// Samples at one place, per length where they are volumes.
#[derive(Default)]
struct Mixture {
    count: usize,
    optical_depth: RunningSum,
    /// Colors by which the samples would glow if nothing was before them: Σ Cᵢ uᵢ/αᵢ.
    emission: [RunningSum; 3],
    opaque: usize,
    opaque_color: [RunningSum; 3],
}

impl Mixture {
    /// Adds a share of a sample, or takes one away that is negative. Once all are gone nothing is left of them.
    fn add(&mut self, sample: &Extent, share: f64) {
        let change = |count: usize| if share < 0.0 { count - 1 } else { count + 1 };
        self.count = change(self.count);
        if sample.alpha == 1.0 {
            self.opaque = change(self.opaque);
            let sign = share.signum();
            self.opaque_color.iter_mut().zip(sample.color).for_each(|(sum, c)| sum.add(sign * c));
        } else {
            let optical_depth = -(-sample.alpha).ln_1p();
            // NaN is none of both, and stays.
            let ratio = if sample.alpha == 0.0 { 1.0 } else { optical_depth / sample.alpha };
            self.optical_depth.add(share * optical_depth);
            self.emission.iter_mut().zip(sample.color).for_each(|(sum, c)| sum.add(share * ratio * c));
        }
        if self.count == 0 {
            *self = Self::default();
        }
    }

    /// Color and opacity over a length; none if nothing is there.
    fn over(&self, length: f64) -> Option<([f64; 3], f64)> {
        if self.count == 0 {
            return None;
        }
        if self.opaque > 0 {
            return Some((self.opaque_color.map(|sum| sum.value() / self.opaque as f64), 1.0));
        }
        let optical_depth = length * self.optical_depth.value();
        // What rounding leaves of terms that were taken away may be below 0.
        let optical_depth = if optical_depth < 0.0 { 0.0 } else { optical_depth };
        let alpha = -(-optical_depth).exp_m1();
        let factor = if optical_depth == 0.0 { length } else { length * (alpha / optical_depth) };
        Some((self.emission.map(|sum| factor * sum.value()), alpha))
    }
}
