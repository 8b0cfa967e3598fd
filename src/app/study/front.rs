//! The settings that no other one beats.

use super::measurement::Measurement;

/// Marks the settings of which no other one is as accurate in as little time (Pareto front).
pub(super) fn mark(measurements: &mut [Measurement]) {
    let mut order: Vec<(usize, (f64, f64))> =
        measurements.iter().enumerate().filter_map(|(i, m)| Some((i, m.point()?))).collect();
    order.sort_by(|(_, a), (_, b)| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    measurements.iter_mut().for_each(|m| m.on_front = false);
    let mut least = f64::INFINITY;
    for (i, (_, error)) in order {
        measurements[i].on_front = error < least;
        least = least.min(error);
    }
}

/// Returns the marked settings, the fastest first.
pub(super) fn of(measurements: &[Measurement]) -> Vec<&Measurement> {
    let mut front: Vec<_> = measurements.iter().filter(|m| m.on_front).collect();
    front.sort_by(|a, b| a.seconds.unwrap_or_default().total_cmp(&b.seconds.unwrap_or_default()));
    front
}
