//! The settings of derivatives that are varied.

use crate::app::gradient::GradientSettings;
use crate::render::differentiable::Adjoint;
use crate::render::quadrature::Quadrature;
use serde::{Deserialize, Serialize};

/// Setting of derivatives that a study varies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GradientKnob {
    /// How the backward pass gets at its samples.
    Adjoint,
    /// Single and double precision.
    Precision,
    /// Integration along rays.
    Quadrature,
    /// Step of the quadratures that have one, in voxels.
    Step,
}

/// Ways of the backward pass.
const ADJOINTS: [Adjoint; 3] = [Adjoint::Tape, Adjoint::Replay, Adjoint::Inversion];
/// Steps in voxels, and the one where steps are not varied.
const STEPS: [f64; 4] = [0.25, 0.5, 1.0, 2.0];
const STEP: f64 = 0.5;

/// A setting of derivatives that is compared with others.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Variant {
    pub settings: GradientSettings,
    /// True for double precision.
    pub double: bool,
}

/// Returns all combinations of the settings that are varied and that fit together; `shaded` is true for pre-shaded
/// volumes, which have a quadrature of their own.
pub(super) fn variants(base: &GradientSettings, knobs: &[GradientKnob], shaded: bool) -> Vec<Variant> {
    let has = |knob| knobs.is_empty() || knobs.contains(&knob);
    let adjoints = if has(GradientKnob::Adjoint) { &ADJOINTS[..] } else { &[base.adjoint.unwrap_or(Adjoint::Tape)] };
    let precisions = if has(GradientKnob::Precision) { &[false, true][..] } else { &[false] };
    let (rules, steps) = (has(GradientKnob::Quadrature), has(GradientKnob::Step));
    let quadratures = if shaded || !(rules || steps) { vec![base.quadrature] } else { quadratures(rules, steps) };
    let mut all = Vec::new();
    for quadrature in quadratures {
        for adjoint in adjoints {
            let settings = GradientSettings { quadrature, adjoint: Some(*adjoint), ..base.clone() };
            if settings.fits_together().is_err() {
                continue;
            }
            all.extend(precisions.iter().map(|double| Variant { settings: settings.clone(), double: *double }));
        }
    }
    all
}

fn quadratures(rules: bool, steps: bool) -> Vec<Quadrature> {
    let steps = if steps { &STEPS[..] } else { &[STEP] };
    let midpoint = steps.iter().copied().map(Quadrature::Midpoint);
    let riemann = steps.iter().copied().map(Quadrature::Riemann).filter(|_| rules);
    let exact = [Quadrature::Exact].into_iter().filter(|_| rules);
    exact.chain(midpoint).chain(riemann).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_combinations_are_there() {
        let base = GradientSettings { loss: crate::app::gradient::LossName::Mean, ..GradientSettings::default() };
        assert_eq!(variants(&base, &[], false).len(), (1 + 2 * 4) * 3 * 2);
        assert_eq!(variants(&base, &[], true).len(), 3 * 2);
        assert_eq!(variants(&base, &[GradientKnob::Step], false).len(), 4);
        let one = variants(&base, &[GradientKnob::Precision], false);
        assert_eq!(one.iter().map(|v| v.double).collect::<Vec<_>>(), [false, true]);
    }
}
