//! The settings of denoising that are varied.

use crate::app::denoise::{DenoiseSettings, Direction, Filter};
use serde::{Deserialize, Serialize};

/// Setting of denoising that a study varies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DenoiseKnob {
    /// Filter.
    Method,
    /// Frames that a frame learns from.
    Direction,
    /// Frames after a frame that are read to learn from.
    Overlap,
}

/// Filters; the first is the usual one.
const METHODS: [Filter; 5] = [Filter::Wrls2, Filter::Wrls, Filter::Rls, Filter::Svgf, Filter::Ema];
/// Frames after a frame that are read to learn from.
const OVERLAPS: [u32; 3] = [12, 4, 1];

/// Returns all combinations of the settings that are varied, those that have no effect left out.
pub(super) fn variants(base: &DenoiseSettings, knobs: &[DenoiseKnob]) -> Vec<DenoiseSettings> {
    let has = |knob| knobs.is_empty() || knobs.contains(&knob);
    let methods = if has(DenoiseKnob::Method) { &METHODS[..] } else { &METHODS[..1] };
    let overlaps = if has(DenoiseKnob::Overlap) { &OVERLAPS[..] } else { &OVERLAPS[..1] };
    let mut all = Vec::new();
    for method in methods {
        let own = DenoiseSettings { method: *method, ..base.clone() };
        // The others know no frames but those before.
        if *method != Filter::Wrls2 {
            all.push(own);
            continue;
        }
        all.extend(overlaps.iter().map(|overlap| DenoiseSettings { overlap: *overlap, ..own.clone() }));
        if has(DenoiseKnob::Direction) {
            all.push(DenoiseSettings { direction: Direction::Forward, ..own });
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_without_effect_are_not_combined() {
        let base = DenoiseSettings::default();
        assert_eq!(variants(&base, &[]).len(), 3 + 1 + 4);
        assert_eq!(variants(&base, &[DenoiseKnob::Method]).len(), 5);
        assert_eq!(variants(&base, &[DenoiseKnob::Direction]).len(), 2);
        assert_eq!(variants(&base, &[DenoiseKnob::Overlap]).len(), 3);
    }
}
