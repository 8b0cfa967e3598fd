//! Times that mean something on a busy machine: jobs run in turn, medians of ratios of neighbours.

use std::time::Instant;

/// Rounds of every measurement, after one that warms up.
pub const ROUNDS: usize = 7;

/// Runs the jobs in turn, A B C A B C …; the seconds of each one, by round.
pub fn in_turn<const N: usize>(mut jobs: [&mut dyn FnMut(); N]) -> [Vec<f64>; N] {
    let mut seconds = [const { Vec::new() }; N];
    for round in 0..=ROUNDS {
        for (job, seconds) in jobs.iter_mut().zip(&mut seconds) {
            let start = Instant::now();
            job();
            if round > 0 {
                seconds.push(start.elapsed().as_secs_f64());
            }
        }
    }
    seconds
}

/// The middle value; of an even number the upper one of the two.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

/// Median of `a / b`, round by round.
pub fn ratio(a: &[f64], b: &[f64]) -> f64 {
    median(&a.iter().zip(b).map(|(a, b)| a / b).collect::<Vec<_>>())
}
