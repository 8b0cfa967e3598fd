//! What frames of a sequence are compared by: the names, types, places and sizes of what they hold.

use crate::text::{printable, ranges};
use glam::DMat4;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// A grid, or a layer, of a frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Trait {
    /// Type of its values, or size and channels of a picture.
    pub kind: String,
    /// Index-to-world map; none for pictures.
    pub place: Option<DMat4>,
    /// Largest value, and sum of all values.
    pub figures: Option<[f64; 2]>,
}

/// Grids, or layers, of a frame by their names.
pub(super) type Traits = BTreeMap<String, Trait>;

/// How a sequence departs from itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Deviation {
    /// False if it need not be a fault.
    pub certain: bool,
    pub part: String,
    pub what: String,
    pub remedy: &'static str,
}

/// Factor by which a figure may differ from those of both neighbours before it counts as a leap. Sources that start,
/// and explosions, change by less from frame to frame once they are there; values in other units, and frames that were
/// written twice or not at all, by more.
const LEAP: f64 = 4.0;

/// Largest change of a matrix's entries, relative to its largest, that rounding explains.
const ROUNDING: f64 = 1e-9;

/// Compares frames, in ascending order, with each other.
pub(super) fn deviations(frames: &[(u32, Traits)]) -> Vec<Deviation> {
    let names: BTreeSet<&String> = frames.iter().flat_map(|(_, traits)| traits.keys()).collect();
    let mut found = Vec::new();
    for name in names {
        let (with, without): (Vec<_>, Vec<_>) = frames.iter().partition(|(_, traits)| traits.contains_key(name));
        let of: Vec<(u32, &Trait)> = with.iter().filter_map(|(n, traits)| Some((*n, traits.get(name)?))).collect();
        let mut add = |certain, what: String, remedy| {
            found.push(Deviation { certain, part: name.clone(), what, remedy });
        };
        if !without.is_empty() {
            let [with, without] = [with, without].map(|frames| ranges(frames.iter().map(|(n, _)| *n)));
            let what = format!("it is in frames {with}, but not in frames {without}");
            add(true, what, "write all frames with the same settings, or rename: cumulo convert ⟨rename⟩");
        }
        kinds(&of).into_iter().for_each(|what| {
            add(
                true,
                what,
                "write all frames with the same settings; readers of sequences take the first one's for all",
            );
        });
        if let Some((scaled, what)) = places(&of) {
            let remedy = if scaled {
                "write all frames with one voxel size: motion and denoising compare voxels of equal index"
            } else {
                "nothing needs to be done if the domain moves; densities are found by world positions"
            };
            add(scaled, what, remedy);
        }
        leaps(&of).into_iter().for_each(|what| {
            add(true, what, "look at the frame, and write or simulate it again if it is not meant");
        });
    }
    found
}

/// Frames whose values have another type than those of most frames.
fn kinds(of: &[(u32, &Trait)]) -> Option<String> {
    let mut groups: BTreeMap<&str, Vec<u32>> = BTreeMap::new();
    of.iter().for_each(|(number, t)| groups.entry(&t.kind).or_default().push(*number));
    if groups.len() < 2 {
        return None;
    }
    let usual = groups.iter().max_by_key(|(_, frames)| frames.len()).map(|(kind, _)| *kind)?;
    let mut what = format!("it is {} in most frames", printable(usual));
    for (kind, frames) in groups.iter().filter(|(kind, _)| **kind != usual) {
        let _ = write!(what, ", {} in frames {}", printable(kind), ranges(frames.iter().copied()));
    }
    Some(what)
}

/// Frames from which on the transform is another one; true if the voxels' size or direction changes.
fn places(of: &[(u32, &Trait)]) -> Option<(bool, String)> {
    let (mut scaled, mut moved) = (Vec::new(), Vec::new());
    for pair in of.windows(2) {
        let (Some(before), Some(now)) = (pair[0].1.place, pair[1].1.place) else { continue };
        let apart = |columns: std::ops::Range<usize>| {
            let largest = now.to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            columns.clone().any(|c| (now.col(c) - before.col(c)).abs().max_element() > ROUNDING * largest)
        };
        if apart(0..3) {
            scaled.push(pair[1].0);
        } else if apart(3..4) {
            moved.push(pair[1].0);
        }
    }
    match (&scaled[..], &moved[..]) {
        ([], []) => None,
        ([], _) => Some((false, format!("its origin moves at frames {}", ranges(moved.iter().copied())))),
        _ => Some((
            true,
            format!("the size or direction of its voxels changes at frames {}", ranges(scaled.iter().copied())),
        )),
    }
}

/// Frames whose largest value or sum leaps away from both neighbours, or, at an end, from two that agree.
fn leaps(of: &[(u32, &Trait)]) -> Vec<String> {
    let mut found = Vec::new();
    for (k, name) in ["largest value", "sum of the values"].into_iter().enumerate() {
        let values: Vec<(u32, f64)> = of.iter().filter_map(|(n, t)| Some((*n, t.figures?[k]))).collect();
        let count = values.len();
        if count < 3 {
            continue;
        }
        let at = |i: usize| values[i].1.abs();
        for (i, (number, value)) in values.iter().enumerate() {
            let [a, b] = match i {
                0 => [1, 2],
                _ if i + 1 == count => [count - 2, count - 3],
                _ => [i - 1, i + 1],
            };
            let (low, high) = (at(a).min(at(b)), at(a).max(at(b)));
            // At an end there is no telling a leap from growth, unless the two frames beside it agree.
            let inside = i > 0 && i + 1 < count;
            let agree = high <= if inside { LEAP * LEAP * low } else { 1.5 * low };
            // A signed figure that passes through zero lies between its neighbors.
            let between = inside && (values[a].1 - value) * (values[b].1 - value) <= 0.0;
            if agree && !between && low > 0.0 && (value.abs() > LEAP * high || value.abs() * LEAP < low) {
                let [a, b] = [a, b].map(|i| values[i]);
                found.push(format!(
                    "the {name} of frame {number} is {value:.4e}, in frames {} and {} it is {:.4e} and {:.4e}",
                    a.0, b.0, a.1, b.1
                ));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(number: u32, kind: &str, scale: f64, max: f64) -> (u32, Traits) {
        let place = Some(DMat4::from_scale(glam::DVec3::splat(scale)));
        let of = Trait { kind: kind.into(), place, figures: Some([max, 100.0 * max]) };
        (number, [("grid 'density'".to_owned(), of)].into())
    }

    #[test]
    fn a_steady_sequence_does_not_deviate() {
        let grows: Vec<_> = (1..10).map(|n| frame(n, "float", 0.1, 1.5_f64.powi(n as i32))).collect();
        assert_eq!(deviations(&grows), []);
        assert_eq!(deviations(&grows[..1]), []);
    }

    #[test]
    fn leaps_inside_and_at_the_ends_are_found_and_steps_are_not() {
        let of = |values: &[f64]| {
            let frames: Vec<_> = values.iter().zip(1..).map(|(v, n)| frame(n, "float", 0.1, *v)).collect();
            deviations(&frames).iter().filter(|d| d.what.contains("largest")).count()
        };
        assert_eq!(of(&[1.0, 1.1, 9.0, 1.2, 1.3]), 1);
        assert_eq!(of(&[1.0, 1.1, 0.1, 1.2, 1.3]), 1);
        assert_eq!(of(&[1.0, 1.1, 1.2, 9.0]), 1);
        assert_eq!(of(&[9.0, 1.1, 1.2, 1.3]), 1);
        // A step that stays, and a start from nothing.
        assert_eq!(of(&[1.0, 1.0, 9.0, 9.0, 9.0]), 0);
        assert_eq!(of(&[0.0, 0.01, 0.3, 1.0, 2.0]), 0);
        // A signed value that passes through zero.
        assert_eq!(of(&[20.0, 10.0, 0.1, -10.0, -20.0]), 0);
        assert_eq!(of(&[20.0, 10.0, -50.0, 10.0, 20.0]), 1);
    }

    #[test]
    fn names_types_and_transforms_that_change_are_found() {
        let mut frames: Vec<_> = (1..6).map(|n| frame(n, "float", 0.1, 1.0)).collect();
        frames[2] = frame(3, "double", 0.1, 1.0);
        frames[4] = frame(5, "float", 0.2, 1.0);
        let density = frames[0].1["grid 'density'"].clone();
        frames[1].1.insert("grid 'temperature'".into(), density);
        let found = deviations(&frames);
        let has = |text: &str| found.iter().any(|d| d.what.contains(text));
        assert!(has("float in most frames, double in frames 3"), "{found:?}");
        assert!(has("voxels changes at frames 5") && has("in frames 2, but not in frames 1, 3-5"), "{found:?}");
        assert_eq!(found.len(), 3, "{found:?}");
    }

    #[test]
    fn an_origin_that_moves_is_a_remark() {
        let mut frames: Vec<_> = (1..4).map(|n| frame(n, "float", 0.1, 1.0)).collect();
        if let Some(of) = frames[2].1.get_mut("grid 'density'") {
            of.place = of.place.map(|place| DMat4::from_translation(glam::DVec3::X) * place);
        }
        let found = deviations(&frames);
        assert!(found.len() == 1 && !found[0].certain && found[0].what.contains("origin"), "{found:?}");
    }
}
