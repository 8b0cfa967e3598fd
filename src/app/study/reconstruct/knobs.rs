//! The settings of reconstructions that are varied.

use crate::app::reconstruct::density::Choice;
use crate::app::reconstruct::{DensitySettings, RegionSettings};
use serde::{Deserialize, Serialize};

/// Setting of reconstructions of densities that a study varies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReconstructKnob {
    /// Number of views that are fitted.
    Views,
    /// Voxels along the longest edge of the region.
    Resolution,
    /// How the densities are found.
    Solver,
    /// Iterations on the finest level, at most.
    Iterations,
    /// Noise that is added to the pictures.
    Noise,
}

/// Settings that are varied by default.
const USUAL: [ReconstructKnob; 3] = [ReconstructKnob::Views, ReconstructKnob::Resolution, ReconstructKnob::Iterations];
/// Shares of the views that are fitted.
const SHARES: [f64; 3] = [1.0, 0.5, 0.25];
/// Fewest views that are fitted.
const LEAST_VIEWS: usize = 3;
/// Voxels along the longest edge of the region, from few to many.
pub(super) const RESOLUTIONS: [u32; 4] = [16, 32, 64, 128];
/// Solvers.
const SOLVERS: [Choice; 2] = [Choice::Auto, Choice::Weiss2021];
/// Iterations on the finest level; none for as many as are usual.
const ITERATIONS: [Option<u32>; 3] = [None, Some(8), Some(2)];
/// Standard deviations of the noise that is added to the pictures, in units of their radiance.
const NOISE: [f64; 3] = [0.0, 0.01, 0.05];

/// A reconstruction that is compared with others.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Variant {
    pub settings: DensitySettings,
    /// Number of views that are fitted.
    pub views: usize,
    /// Standard deviation of the noise that is added to the pictures.
    pub noise: f64,
}

impl Variant {
    /// Name of the folder of the capture that it is found from.
    pub(super) fn capture(&self) -> String {
        if self.noise > 0.0 {
            format!("views_{}_noise_{}", self.views, self.noise)
        } else {
            format!("views_{}", self.views)
        }
    }
}

/// Returns all combinations of the settings that are varied. `views` is the number of views that may be fitted, and
/// `finest` the highest resolution that the time allows.
pub(super) fn variants(base: &DensitySettings, knobs: &[ReconstructKnob], views: usize, finest: u32) -> Vec<Variant> {
    let has = |knob| if knobs.is_empty() { USUAL.contains(&knob) } else { knobs.contains(&knob) };
    let some = |varied: bool, count: usize| if varied { count } else { 1 };
    let mut counts: Vec<usize> = SHARES[..some(has(ReconstructKnob::Views), SHARES.len())]
        .iter()
        .map(|share| ((views as f64 * share).round() as usize).max(LEAST_VIEWS).min(views))
        .collect();
    counts.dedup();
    let affordable = RESOLUTIONS.into_iter().filter(|resolution| *resolution <= finest);
    let resolutions: Vec<u32> = match has(ReconstructKnob::Resolution) {
        true => affordable.collect(),
        false => vec![base.region.resolution.unwrap_or(finest)],
    };
    let solvers = if has(ReconstructKnob::Solver) { SOLVERS.to_vec() } else { vec![base.solver] };
    let iterations = if has(ReconstructKnob::Iterations) { ITERATIONS.to_vec() } else { vec![base.iterations] };
    let noise = &NOISE[..some(has(ReconstructKnob::Noise), NOISE.len())];
    let mut all = Vec::new();
    for (views, noise) in counts.iter().flat_map(|views| noise.iter().map(move |noise| (*views, *noise))) {
        for solver in &solvers {
            for resolution in &resolutions {
                let region = RegionSettings { resolution: Some(*resolution), ..base.region };
                let settings = DensitySettings { region, solver: *solver, ..base.clone() };
                let own =
                    |iterations| Variant { settings: DensitySettings { iterations, ..settings.clone() }, views, noise };
                all.extend(iterations.iter().map(|iterations| own(*iterations)));
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_combinations_are_there() {
        let base = DensitySettings::default();
        let all = variants(&base, &[], 14, 32);
        assert_eq!(all.len(), 3 * 2 * 3);
        assert_eq!(all.iter().map(|v| v.views).max(), Some(14));
        assert_eq!(variants(&base, &[ReconstructKnob::Noise], 14, 32).len(), 3);
        assert_eq!(variants(&base, &[ReconstructKnob::Views], 4, 32).len(), 2, "as few as are useful");
    }
}
