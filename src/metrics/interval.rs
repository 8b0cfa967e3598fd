//! Means of few independent samples, with intervals of confidence.

use super::statistical::probability;
use crate::scene::film::Moments;

/// Returns the mean of independent samples, and the interval that holds their expected value with 95 % confidence if
/// they are normally distributed; no interval for fewer than two samples.
pub fn of_mean(samples: &[f64]) -> (f64, Option<[f64; 2]>) {
    let mut moments = Moments::default();
    samples.iter().for_each(|sample| moments.add(*sample));
    let half = |n: usize| probability::quantile(0.95, (n - 1) as f64) * moments.variance_of_mean().sqrt();
    let interval = (samples.len() > 1).then(|| half(samples.len()));
    (moments.mean(), interval.map(|half| [moments.mean() - half, moments.mean() + half]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_those_of_students_t() {
        // Mean 2, standard error 1/√3; t = 4.302653 for two degrees of freedom (Abramowitz and Stegun, table 26.10).
        let (mean, interval) = of_mean(&[1.0, 2.0, 3.0]);
        let [low, high] = interval.unwrap();
        assert_eq!(mean, 2.0);
        assert!((high - 2.0 - 4.302_653 / 3.0_f64.sqrt()).abs() < 1e-5 && (low + high - 4.0).abs() < 1e-12);
        assert_eq!((of_mean(&[5.0]), of_mean(&[])), ((5.0, None), (0.0, None)));
    }
}
