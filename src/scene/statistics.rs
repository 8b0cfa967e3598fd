//! Statistics of a grid's values.

use serde::Serialize;

/// Number of bins of a histogram.
pub(crate) const BINS: usize = 16;
/// Largest finite half-precision number.
const HALF_MAX: f32 = 65_504.0;

/// Statistics of a grid's active values; a vector counts by its length.
#[derive(Debug, Clone, Default, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Statistics {
    /// Smallest finite value; `None` if there are no finite values.
    pub min: Option<f32>,
    /// Largest finite value; `None` if there are no finite values.
    pub max: Option<f32>,
    /// Mean of the finite values; `None` if there are none.
    pub mean: Option<f64>,
    /// Number of values that are NaN.
    pub nan: u64,
    /// Number of infinite values.
    pub infinite: u64,
    /// Number of finite values below zero.
    pub negative: u64,
    /// Number of finite values whose magnitude exceeds the largest half-precision number (65504).
    pub above_half: u64,
    /// Counts in 16 bins of equal width from `min` to `max`; empty if there are no finite values.
    pub histogram: Vec<u64>,
}

/// Computes statistics in two passes. `visit` hands every value, with the number of voxels that have it, to its
/// argument; it is called twice.
///
/// # Errors
/// Errors of `visit` are passed on.
pub fn of<E>(mut visit: impl FnMut(&mut dyn FnMut(f32, u64)) -> Result<(), E>) -> Result<Statistics, E> {
    let mut s = Statistics::default();
    let (mut low, mut high, mut sum, mut count) = (f32::INFINITY, f32::NEG_INFINITY, 0.0_f64, 0_u64);
    visit(&mut |v, n| {
        if v.is_nan() {
            s.nan += n;
        } else if v.is_infinite() {
            s.infinite += n;
        } else {
            low = low.min(v);
            high = high.max(v);
            sum += f64::from(v) * n as f64;
            count += n;
            s.negative += if v < 0.0 { n } else { 0 };
            s.above_half += if v.abs() > HALF_MAX { n } else { 0 };
        }
    })?;
    if count == 0 {
        return Ok(s);
    }
    (s.min, s.max, s.mean) = (Some(low), Some(high), Some(sum / count as f64));
    s.histogram = vec![0; BINS];
    let scale = BINS as f64 / (f64::from(high) - f64::from(low));
    let histogram = &mut s.histogram;
    visit(&mut |v, n| {
        if v.is_finite() {
            let at = (f64::from(v) - f64::from(low)) * scale;
            // With a single distinct value `at` is NaN, which counts in the first bin.
            histogram[(at as usize).min(BINS - 1)] += n;
        }
    })?;
    Ok(s)
}
