//! Few homogeneous samples that show, up to every depth, what a pixel does.
//!
//! Up to a share x of its length, a sample of opacity α and color C has the opacity α' = 1 - (1 - α)ˣ and the color
//! C α'/α (F. Kainz, "Interpreting OpenEXR Deep Pixels"). Each sample begins where the one before ends, and reaches as
//! far as it stays within the error. Both the curve and what samples show rise: between two places where the curve is
//! known they differ by no more than the value of either at the end from that of the other at the beginning. Depths
//! have single precision, and nothing is asked between two of them.

use super::curve::Entry;
use crate::scene::deep::{DeepLine, DeepSample};
use glam::{DVec3, DVec4, Vec3};

/// Share of the error within which places need not be told apart.
const NEAR: f64 = 0.1;
/// Largest opacity of a volume below 1: one of 1 hides what is inside from its front on.
const MOST_OPAQUE: f32 = 1.0 - f32::EPSILON / 2.0;
/// Transmittance at which a pixel ends: of less, colors have no digits left.
const LEAST: f64 = 1e-6;
/// Share of the error that may be behind that.
const BEHIND: f64 = 0.01;
/// Share of the error that is left of the transmittance where more is behind.
const LEFT: f64 = 0.25;

/// Appends the samples of a pixel that shows what the entries tell, within an error in each channel. Returns what they
/// show together.
pub(super) fn append(entries: Vec<Entry>, error: DVec4, line: &mut DeepLine) -> [f32; 4] {
    let (entries, error) = ended(thinned(entries, NEAR * error), error);
    let mut shown = Composite { color: DVec3::ZERO, transmittance: 1.0 };
    let (mut at, first) = (0, line.samples.len());
    while at + 1 < entries.len() {
        if entries[at + 1].value == entries[at].value {
            at += 1;
            continue;
        }
        let (end, sample) = shown.longest(&entries, at, error);
        // What is too little for single precision is nothing.
        if sample.rgba != [0.0; 4] {
            line.samples.push(sample);
            shown = shown.after(&sample);
        }
        at = end;
    }
    line.counts.push((line.samples.len() - first) as u32);
    shown.value().as_vec4().to_array()
}

/// Leaves out places between which a curve rises by no more than this: what is asked of the places beside them holds
/// there as well. Places where a curve begins or ends to rise stay.
fn thinned(entries: Vec<Entry>, rise: DVec4) -> Vec<Entry> {
    let mut kept: Vec<Entry> = Vec::with_capacity(entries.len());
    for (number, entry) in entries.iter().enumerate() {
        let beside = |other: Option<&Entry>| other.is_none_or(|other| other.value == entry.value);
        let rises = |last: &Entry, next: &Entry| (next.bounds[1] - last.bounds[0]).cmpgt(rise).any();
        let next = entries.get(number + 1);
        let ends = beside(next) || beside(number.checked_sub(1).map(|before| &entries[before]));
        if ends || kept.last().zip(next).is_none_or(|(last, next)| rises(last, next)) {
            kept.push(*entry);
        }
    }
    kept
}

/// Ends a curve where next to nothing is seen through, and what is behind is within an error taken to be there. Returns
/// the error that is left.
///
/// Estimates of colors may go on where those of the transmittance are 0: then a little of it is left to their end.
fn ended(mut entries: Vec<Entry>, error: DVec4) -> (Vec<Entry>, DVec4) {
    let opaque = entries.iter().position(|entry| entry.value.w > 1.0 - LEAST);
    let (Some(last), Some(end)) = (entries.last().copied(), opaque) else { return (entries, error) };
    let behind = (last.value - entries[end].value).abs();
    if behind.cmple(BEHIND * error).all() {
        entries.truncate(end + 1);
        entries[end].value = last.value;
        return (entries, (1.0 - BEHIND) * error);
    }
    let left = LEFT * error.w;
    let before_last = entries.len() - 1;
    entries[..before_last].iter_mut().for_each(|entry| entry.value.w = entry.value.w.min(1.0 - left));
    (entries, error - left * DVec4::W)
}

/// Color and transmittance of the samples so far.
#[derive(Clone, Copy)]
struct Composite {
    color: DVec3,
    transmittance: f64,
}

impl Composite {
    fn value(self) -> DVec4 {
        self.color.extend(1.0 - self.transmittance)
    }

    fn after(self, sample: &DeepSample) -> Self {
        let [r, g, b, alpha] = sample.rgba.map(f64::from);
        Self {
            color: self.color + self.transmittance * DVec3::new(r, g, b),
            transmittance: self.transmittance * (1.0 - alpha),
        }
    }

    /// Returns the entry up to which a sample may reach that begins at an entry, and the sample.
    fn longest(self, entries: &[Entry], at: usize, error: DVec4) -> (usize, DeepSample) {
        let last = entries.len() - 1;
        let to = |end: usize| {
            let sample = self.sample(&entries[at], &entries[end]);
            let keeps =
                if sample.z_back > sample.z { self.keeps(&sample, &entries[at..=end], error) } else { end == at + 1 };
            keeps.then_some((end, sample))
        };
        let (mut best, mut fails) = ((at + 1, self.sample(&entries[at], &entries[at + 1])), last + 1);
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
        let same = |entry: &usize| entries[*entry].value == entries[best.0].value;
        let flat = (at + 1..best.0).rev().take_while(same).last();
        flat.and_then(to).unwrap_or(best)
    }

    /// Returns the sample between two entries, after which the value is that of the second.
    fn sample(self, from: &Entry, to: &Entry) -> DeepSample {
        let opacity = ((to.value.w - (1.0 - self.transmittance)) / self.transmittance).clamp(0.0, 1.0);
        let most = if to.z > from.z { MOST_OPAQUE } else { 1.0 };
        let color = ((to.value.truncate() - self.color) / self.transmittance).as_vec3();
        // Rounding of what is before must not darken what shines.
        let falls = to.value.truncate().cmplt(from.value.truncate());
        let color = Vec3::select(falls, color, color.max(Vec3::ZERO));
        let rgba = color.extend((opacity as f32).min(most)).to_array();
        DeepSample { z: from.z as f32, z_back: to.z as f32, rgba }
    }

    /// True if the sample shows what the entries do, the first and the last of which are its ends, within an error.
    fn keeps(self, sample: &DeepSample, entries: &[Entry], error: DVec4) -> bool {
        let [r, g, b, alpha] = sample.rgba.map(f64::from);
        let (start, color) = (f64::from(sample.z), DVec3::new(r, g, b));
        let (length, log) = (f64::from(sample.z_back) - start, (-alpha).ln_1p());
        let mut before = self.value();
        entries.windows(2).all(|pair| {
            let [from, to] = [pair[0], pair[1]];
            let share = (to.z - start) / length;
            let opacity = -(share * log).exp_m1();
            let factor = if alpha > 0.0 { opacity / alpha } else { share };
            let color = self.color + self.transmittance * factor * color;
            let shown = color.extend(1.0 - self.transmittance * (1.0 - opacity));
            let off = match f64::from((from.z as f32).next_up()) < to.z {
                true => (shown - from.bounds[0]).max(to.bounds[1] - before),
                // No depth in single precision is between.
                false => (shown - to.value).abs(),
            };
            before = shown;
            off.cmple(error).all()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn appended(values: &[(f64, [f64; 4])], error: f64) -> (Vec<DeepSample>, [f32; 4]) {
        let entry = |(z, value): &(f64, [f64; 4])| {
            let value = DVec4::from_array(*value);
            Entry { z: *z, value, bounds: [value; 2] }
        };
        let mut line = DeepLine::default();
        let shown = append(values.iter().map(entry).collect(), DVec4::splat(error), &mut line);
        assert_eq!(line.counts, [line.samples.len() as u32]);
        (line.samples, shown)
    }

    /// An exponential curve is one sample; where nothing is there is none, and surfaces are points.
    #[test]
    fn samples_are_few() {
        let fog = |z: f64| {
            let opacity = -(-0.7 * (z - 2.0)).exp_m1();
            (z, [0.5 * opacity, opacity, 3.0 * opacity, opacity])
        };
        let mut values = vec![(1.0, [0.0; 4])];
        values.extend((0..=600).map(|i| fog(2.0 + 0.005 * f64::from(i))));
        let end = values[601].1;
        values.push((9.0, end));
        let (samples, shown) = appended(&values, 0.02);
        assert_eq!(samples.len(), 1, "{samples:?}");
        assert_eq!([samples[0].z, samples[0].z_back], [2.0, 5.0]);
        assert!((0..4).all(|c| (f64::from(shown[c]) - end[c]).abs() < 1e-6));
        // A surface behind it, and nothing else.
        values.push((9.0, [end[0] + 0.01, end[1], end[2], 1.0]));
        values.push((12.0, values[603].1));
        let (samples, shown) = appended(&values, 0.02);
        assert_eq!(samples.len(), 2, "{samples:?}");
        assert_eq!([samples[1].z, samples[1].z_back, samples[1].rgba[3]], [9.0, 9.0, 1.0]);
        assert_eq!(shown[3], 1.0);
        assert_eq!(appended(&[(1.0, [0.0; 4]), (2.0, [0.0; 4])], 0.1), (vec![], [0.0; 4]));
    }

    /// A medium that rises from one depth in single precision to the next is one sample as long as it stays homogeneous.
    #[test]
    fn dense_media_need_no_sample_for_each_depth() {
        let mut values = vec![(0.0, [0.0; 4])];
        let mut z = 1000.0_f32;
        for i in 0..200 {
            let opacity = -(-0.05 * f64::from(i)).exp_m1();
            values.push((z.into(), [0.0, opacity, 0.0, opacity]));
            z = z.next_up();
        }
        let (samples, shown) = appended(&values, 0.001);
        assert_eq!(samples.len(), 1, "{samples:?}");
        assert!((f64::from(shown[3]) - values[200].1[3]).abs() < 1e-6);
    }

    /// Colors go on behind what is opaque.
    #[test]
    fn colors_behind_an_opaque_place_are_kept() {
        let values =
            [(1.0, [0.0; 4]), (1.0, [0.5, 0.5, 0.5, 1.0]), (2.0, [0.5, 0.5, 0.5, 1.0]), (2.0, [0.9, 0.5, 0.5, 1.0])];
        let (samples, shown) = appended(&values, 0.02);
        assert_eq!(samples.len(), 2, "{samples:?}");
        assert!(samples[0].rgba[3] >= 0.99 && (shown[0] - 0.9).abs() < 1e-6 && shown[3] == 1.0, "{shown:?}");
    }
}
