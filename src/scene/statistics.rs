//! What the values of a grid are like.

use serde::Serialize;

/// Bins of a histogram.
pub const BINS: usize = 16;
/// Largest finite half.
const HALF_MAX: f32 = 65_504.0;

/// Statistics of active values; vectors enter by their length.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Statistics {
    /// Smallest finite value; `None` if there is none.
    pub min: Option<f32>,
    /// Largest finite value.
    pub max: Option<f32>,
    /// Mean of finite values.
    pub mean: Option<f64>,
    /// Values that are not a number.
    pub nan: u64,
    /// Infinite values.
    pub infinite: u64,
    /// Finite values below zero.
    pub negative: u64,
    /// Finite values too large for a half (above 65504).
    pub above_half: u64,
    /// Counts in [`BINS`] bins of equal width from `min` to `max`; empty if there are no finite values.
    pub histogram: Vec<u64>,
}

/// Statistics of values, in two passes: `visit` hands all of them, each with how many voxels have it, to its argument.
///
/// # Errors
/// Those of `visit`.
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
            // A single value makes the scale infinite and `at` not a number: the first bin takes it.
            histogram[(at as usize).min(BINS - 1)] += n;
        }
    })?;
    Ok(s)
}
