//! Statistics of the active values of a node, which renderers skip empty space by.

/// Number, extremes, mean and spread of measures: values of scalars, lengths of vectors.
#[derive(Debug, Clone, Copy)]
pub(super) struct Statistics<V> {
    count: f64,
    mean: f64,
    /// Sum of the squared distances from the mean.
    squares: f64,
    /// Values of the least and of the greatest measure, with these.
    extremes: Option<[(f64, V); 2]>,
    /// Inclusive box of the active voxels.
    pub bounds: Option<([i32; 3], [i32; 3])>,
}

impl<V: Copy> Statistics<V> {
    /// Statistics of nothing.
    pub(crate) fn new() -> Self {
        Self { count: 0.0, mean: 0.0, squares: 0.0, extremes: None, bounds: None }
    }

    /// Adds a value that `count` voxels have.
    pub(crate) fn add(&mut self, value: V, measure: f64, count: f64) {
        let one = Self { count, mean: measure, squares: 0.0, extremes: Some([(measure, value); 2]), bounds: None };
        self.merge(&one);
    }

    /// Widens the box to include that from `low` to `high`.
    pub(crate) fn include(&mut self, low: [i32; 3], high: [i32; 3]) {
        let (l, h) = self.bounds.unwrap_or((low, high));
        self.bounds = Some((std::array::from_fn(|a| l[a].min(low[a])), std::array::from_fn(|a| h[a].max(high[a]))));
    }

    /// Adds the statistics of other voxels (Chan et al., "Updating formulae and a pairwise algorithm", 1979).
    pub(crate) fn merge(&mut self, other: &Self) {
        if let Some((low, high)) = other.bounds {
            self.include(low, high);
        }
        if other.count == 0.0 {
            return;
        }
        let count = self.count + other.count;
        let delta = other.mean - self.mean;
        self.squares += other.squares + delta * delta * self.count * other.count / count;
        self.mean += delta * other.count / count;
        self.count = count;
        self.extremes = match (self.extremes, other.extremes) {
            (Some([l, h]), Some([low, high])) => {
                Some([if low.0 < l.0 { low } else { l }, if high.0 > h.0 { high } else { h }])
            }
            (own, other) => own.or(other),
        };
    }

    /// Values of the least and the greatest measure; `empty` where there are none.
    pub(crate) fn extremes(&self, empty: V) -> [V; 2] {
        self.extremes.map_or([empty; 2], |both| both.map(|(_, value)| value))
    }

    /// Mean and standard deviation of the measures; 0 where there are none.
    pub(crate) fn moments(&self) -> [f64; 2] {
        [self.mean, if self.count > 0.0 { (self.squares / self.count).sqrt() } else { 0.0 }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_merge_to_the_whole() {
        let values = [3.0, -1.0, 4.0, 1.0, -5.0, 9.0, 2.0];
        let (mut whole, mut left, mut right) = (Statistics::new(), Statistics::new(), Statistics::new());
        for (i, v) in values.iter().enumerate() {
            whole.add(*v, *v, 1.0);
            if i < 3 { &mut left } else { &mut right }.add(*v, *v, 1.0);
        }
        right.include([0; 3], [7; 3]);
        left.include([-8; 3], [-8; 3]);
        left.merge(&right);
        left.merge(&Statistics::new());
        assert_eq!(left.extremes(0.0), [-5.0, 9.0]);
        assert_eq!(left.bounds, Some(([-8; 3], [7; 3])));
        let mean = values.iter().sum::<f64>() / 7.0;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 7.0;
        // Seven values of at most 9 lose a few of 2^-53 * 9 each.
        for found in [whole.moments(), left.moments()] {
            assert!((found[0] - mean).abs() < 1e-14 && (found[1] - variance.sqrt()).abs() < 1e-14, "{found:?}");
        }
        assert_eq!(Statistics::<f64>::new().moments(), [0.0; 2]);
    }
}
