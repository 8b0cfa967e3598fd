//! Few homogeneous samples that show, up to every depth, what a pixel does.
//!
//! Up to a share x of its length, a sample of opacity α and color C has the opacity α' = 1 - (1 - α)ˣ and the color
//! C α'/α (F. Kainz, "Interpreting OpenEXR Deep Pixels"). Each sample begins where the one before ends, and reaches as
//! far as it stays within the tolerance at all places where the curve is known. Both rise: what is between two places
//! errs by the rise of the curve there more at most.

use super::slices::Knot;
use crate::scene::deep::{DeepLine, DeepSample};
use glam::{DVec3, DVec4};

/// Largest opacity of a volume below 1: one of 1 hides what is inside from its front on.
const MOST_OPAQUE: f32 = 1.0 - f32::EPSILON / 2.0;
/// Transmittance at which a pixel ends: of less, colors have no digits left.
const LEAST: f64 = 1e-6;
/// Share of the tolerance that may be behind that.
const BEHIND: f64 = 0.01;
/// Share of the tolerance that is left of the transmittance where more is behind.
const LEFT: f64 = 0.25;

/// What the samples so far show.
#[derive(Clone, Copy)]
struct Shown {
    color: DVec3,
    transmittance: f64,
}

impl Shown {
    fn after(self, sample: &DeepSample) -> Self {
        let [r, g, b, alpha] = sample.rgba.map(f64::from);
        Self {
            color: self.color + self.transmittance * DVec3::new(r, g, b),
            transmittance: self.transmittance * (1.0 - alpha),
        }
    }

    /// Returns the sample between two entries, after which the value is that of the second.
    fn sample(self, from: Knot, to: Knot) -> DeepSample {
        let opacity = ((to.1.w - (1.0 - self.transmittance)) / self.transmittance).clamp(0.0, 1.0);
        let is_point = to.0 <= from.0;
        let most = if is_point { 1.0 } else { MOST_OPAQUE };
        let color = ((to.1.truncate() - self.color) / self.transmittance).as_vec3();
        DeepSample { z: from.0 as f32, z_back: to.0 as f32, rgba: color.extend((opacity as f32).min(most)).to_array() }
    }

    /// True if the sample is within the tolerance at all entries, which lie in it.
    fn keeps(self, sample: &DeepSample, entries: &[Knot], tolerance: DVec4) -> bool {
        let [r, g, b, alpha] = sample.rgba.map(f64::from);
        let (start, color) = (f64::from(sample.z), DVec3::new(r, g, b));
        let (length, log) = (f64::from(sample.z_back) - start, (-alpha).ln_1p());
        entries.iter().all(|(z, value)| {
            let share = (z - start) / length;
            let opacity = -(share * log).exp_m1();
            let factor = if alpha > 0.0 { opacity / alpha } else { share };
            let shown = self.color + self.transmittance * factor * color;
            let found = shown.extend(1.0 - self.transmittance * (1.0 - opacity));
            (found - *value).abs().cmple(tolerance).all()
        })
    }
}

/// Appends the samples of a pixel that shows these values up to these depths, within a tolerance in these units.
/// Returns what they show together.
pub(super) fn append(entries: Vec<Knot>, unit: DVec4, tolerance: f64, line: &mut DeepLine) -> [f32; 4] {
    let (entries, tolerance) = ended(entries, tolerance * unit);
    let mut shown = Shown { color: DVec3::ZERO, transmittance: 1.0 };
    let (mut at, first) = (0, line.samples.len());
    while at + 1 < entries.len() {
        if entries[at + 1].1 == entries[at].1 {
            at += 1;
            continue;
        }
        let (end, sample) = shown.longest(&entries, at, tolerance);
        line.samples.push(sample);
        shown = shown.after(&sample);
        at = end;
    }
    line.counts.push((line.samples.len() - first) as u32);
    shown.color.extend(1.0 - shown.transmittance).as_vec4().to_array()
}

impl Shown {
    /// Returns the entry up to which a sample may reach that begins at an entry, and the sample.
    fn longest(self, entries: &[Knot], at: usize, tolerance: DVec4) -> (usize, DeepSample) {
        let last = entries.len() - 1;
        let to = |end: usize| {
            let sample = self.sample(entries[at], entries[end]);
            let inside = &entries[at + 1..end];
            let keeps = if sample.z_back > sample.z { self.keeps(&sample, inside, tolerance) } else { end == at + 1 };
            keeps.then_some((end, sample))
        };
        let (mut best, mut fails) = ((at + 1, self.sample(entries[at], entries[at + 1])), last + 1);
        let mut step = 1;
        while best.0 < last && fails > best.0 + 1 {
            let next = if fails <= last { best.0.midpoint(fails) } else { (best.0 + step).min(last) };
            match to(next) {
                Some(found) => best = found,
                None => fails = next,
            }
            step *= 2;
        }
        // A sample ends where nothing more is to be seen.
        let flat = (at + 1..best.0).rev().take_while(|&entry| entries[entry].1 == entries[best.0].1).last();
        flat.and_then(to).unwrap_or(best)
    }
}

/// Ends a curve where next to nothing is seen through, and what is behind is within a tolerance taken to be there.
/// Returns the tolerance that is left.
///
/// Estimates of colors may go on where those of the transmittance are 0: then a little of it is left to their end.
fn ended(mut entries: Vec<Knot>, tolerance: DVec4) -> (Vec<Knot>, DVec4) {
    let opaque = entries.iter().position(|entry| entry.1.w > 1.0 - LEAST);
    let (Some(&(_, whole)), Some(end)) = (entries.last(), opaque) else { return (entries, tolerance) };
    let behind = (whole - entries[end].1).abs();
    if behind.cmple(BEHIND * tolerance).all() {
        entries.truncate(end + 1);
        entries[end].1 = whole;
        return (entries, (1.0 - BEHIND) * tolerance);
    }
    let left = LEFT * tolerance.w;
    let last = entries.len() - 1;
    entries[..last].iter_mut().for_each(|entry| entry.1.w = entry.1.w.min(1.0 - left));
    (entries, tolerance - left * DVec4::W)
}
