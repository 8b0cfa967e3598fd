//! What a pixel shows up to a depth: a smooth curve, known at knots, and steps.

use super::slices::Knot;
use glam::DVec4;

/// A curve over depth.
#[derive(Debug, Default)]
pub(super) struct Curve {
    steps: Vec<Knot>,
    knots: Vec<Knot>,
}

impl Curve {
    /// Adds a step at a depth, to the precision of depths of samples.
    pub fn step(&mut self, z: f64, by: DVec4) {
        if by != DVec4::ZERO {
            self.steps.push((f64::from(z as f32), by));
        }
    }

    /// Returns the sum of the steps.
    pub fn drawn(&self) -> DVec4 {
        self.steps.iter().map(|step| step.1).sum()
    }

    /// Sets the smooth part, by ascending depths.
    pub fn smooth(&mut self, knots: &[Knot]) {
        self.knots = knots.to_vec();
    }

    /// Returns values by ascending depths, two at the place of a step: before and after it.
    pub fn entries(mut self) -> Vec<Knot> {
        self.steps.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut entries = Vec::with_capacity(self.knots.len() + 2 * self.steps.len());
        let (mut drawn, mut steps) = (DVec4::ZERO, self.steps.into_iter().peekable());
        let mut last: Knot = self.knots.first().copied().unwrap_or_default();
        // Rounding may put steps a little before the first knot.
        let mut all_steps_until = |until: Knot, from: Knot, entries: &mut Vec<Knot>| {
            while let Some((z, first)) = steps.next_if(|step| step.0 < until.0 || until.0.is_infinite()) {
                let mut by = first;
                while let Some((_, more)) = steps.next_if(|step| step.0 == z) {
                    by += more;
                }
                // Between knots the smooth part is taken for a line, which its slices allow.
                let share = (z - from.0) / (until.0 - from.0);
                let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
                let smooth = from.1 + share * (until.1 - from.1);
                entries.push((z, smooth + drawn));
                drawn += by;
                entries.push((z, smooth + drawn));
            }
            drawn
        };
        for knot in self.knots {
            let drawn = all_steps_until(knot, last, &mut entries);
            entries.push((knot.0, knot.1 + drawn));
            last = knot;
        }
        all_steps_until((f64::INFINITY, last.1), last, &mut entries);
        entries
    }
}
