//! Sums whose terms come and go.

/// A sum of f64 with twice their digits, so that what remains once large terms have been taken away is still right.
/// The error of a term is exact (Knuth 1969, TwoSum).
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RunningSum {
    high: f64,
    low: f64,
}

impl RunningSum {
    pub(super) fn add(&mut self, term: f64) {
        let sum = self.high + term;
        let rounded = sum - self.high;
        self.low += (self.high - (sum - rounded)) + (term - rounded);
        self.high = sum;
    }

    pub(super) fn value(self) -> f64 {
        self.high + self.low
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_terms_leave_no_trace() {
        let mut sum = RunningSum::default();
        [1e-9, 1e9, 3e-9, -1e9, -1e-9].into_iter().for_each(|term| sum.add(term));
        assert!((sum.value() - 3e-9).abs() < 1e-24, "{}", sum.value());
    }
}
