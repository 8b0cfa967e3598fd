//! What a pixel shows up to a depth: a smooth curve, known at knots, and steps.

use super::slices::Knot;
use glam::DVec4;

/// A place of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Entry {
    /// Depth.
    pub z: f64,
    /// Value, estimated where it is not known.
    pub value: DVec4,
    /// Bounds of the value.
    pub bounds: [DVec4; 2],
}

/// A curve over depth.
#[derive(Debug, Default)]
pub(super) struct Curve {
    steps: Vec<Knot>,
}

impl Curve {
    /// Adds a step at a depth, to the precision of depths of samples.
    pub(super) fn step(&mut self, z: f64, by: DVec4) {
        if by != DVec4::ZERO {
            self.steps.push((f64::from(z as f32), by));
        }
    }

    /// Returns the sum of the steps.
    pub(super) fn drawn(&self) -> DVec4 {
        self.steps.iter().map(|step| step.1).sum()
    }

    /// Returns the curve of the steps and of a smooth part, which rises from knot to knot, by ascending depths: two
    /// entries at the place of a step, before and after it.
    pub(super) fn entries(mut self, knots: &[Knot]) -> Vec<Entry> {
        self.steps.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut entries = Vec::with_capacity(knots.len() + 2 * self.steps.len());
        let (mut drawn, mut steps) = (DVec4::ZERO, &self.steps[..]);
        let mut before = knots.first().copied().unwrap_or_default();
        let end = (f64::INFINITY, knots.last().copied().unwrap_or_default().1);
        for knot in knots.iter().copied().chain([end]) {
            let (within, behind) = steps.split_at(steps.partition_point(|step| step.0 < knot.0));
            steps = behind;
            for place in within.chunk_by(|a, b| a.0 == b.0) {
                let z = place[0].0;
                // Between knots the smooth part is somewhere between its values there.
                let share = (z - before.0) / (knot.0 - before.0);
                let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
                let entry = |drawn: DVec4| Entry {
                    z,
                    value: before.1 + share * (knot.1 - before.1) + drawn,
                    bounds: [before.1 + drawn, knot.1 + drawn],
                };
                entries.push(entry(drawn));
                drawn += place.iter().map(|step| step.1).sum::<DVec4>();
                entries.push(entry(drawn));
            }
            if knot.0.is_finite() {
                let value = knot.1 + drawn;
                entries.push(Entry { z: knot.0, value, bounds: [value; 2] });
            }
            before = knot;
        }
        entries
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_stand_among_knots() {
        let all = DVec4::splat;
        let mut curve = Curve::default();
        for (z, by) in [(2.0, 0.25), (1.5, 0.125), (2.0, 0.5), (0.5, 1.0), (9.0, 2.0)] {
            curve.step(z, all(by));
        }
        curve.step(3.0, DVec4::ZERO);
        assert_eq!(curve.drawn(), all(3.875));
        let entries = curve.entries(&[(1.0, all(0.0)), (2.0, all(0.5)), (3.0, all(0.75))]);
        let found: Vec<_> = entries.iter().map(|e| [e.z, e.value.x, e.bounds[0].x, e.bounds[1].x]).collect();
        let expected = [
            [0.5, 0.0, 0.0, 0.0],
            [0.5, 1.0, 1.0, 1.0],
            [1.0, 1.0, 1.0, 1.0],
            [1.5, 1.25, 1.0, 1.5],
            [1.5, 1.375, 1.125, 1.625],
            [2.0, 1.625, 1.625, 1.625],
            [2.0, 1.625, 1.625, 1.875],
            [2.0, 2.375, 2.375, 2.625],
            [3.0, 2.625, 2.625, 2.625],
            [9.0, 2.625, 2.625, 2.625],
            [9.0, 4.625, 4.625, 4.625],
        ];
        assert_eq!(found, expected);
    }
}
