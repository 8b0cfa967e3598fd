//! The values of scans, slice by slice: their range, how they are distributed, and what is wrong with them.

use super::ScanSettings;
use crate::error::Result;
use crate::formats::format::Format;
use crate::formats::imaging::ImageFormat;
use crate::formats::imaging::image::{Header, Image};
use crate::formats::imaging::options::{Options, ReadOption};
use crate::formats::limits::Limits;
use glam::DVec3;
use serde::Serialize;
use std::path::Path;

/// Number of bins of the histogram that is told.
const BINS: usize = 16;
/// Number of bins by which percentiles are found.
const FINE: usize = 1 << 16;
/// Percentiles that are told.
const PERCENTS: [f64; 5] = [1.0, 25.0, 50.0, 75.0, 99.0];

/// Statistics of all values of a scan, those of the background among them; a vector counts by its length.
#[derive(Debug, Clone, Default, PartialEq, Serialize, schemars::JsonSchema)]
pub(crate) struct ValueStatistics {
    /// Number of values.
    pub count: u64,
    /// Smallest finite value; none if there are no finite values.
    pub min: Option<f64>,
    /// Largest finite value; none if there are no finite values.
    pub max: Option<f64>,
    /// Mean of the finite values; none if there are none.
    pub mean: Option<f64>,
    /// Number of values that are NaN.
    pub nan: u64,
    /// Number of infinite values.
    pub infinite: u64,
    /// Number of finite values below zero.
    pub negative: u64,
    /// Number of values that are zero.
    pub zero: u64,
    /// Counts in 16 bins of equal width from `min` to `max`; empty if there are no finite values.
    pub histogram: Vec<u64>,
    /// Percentiles, exact for whole numbers in a range below 65536, else to a 65536th of the range.
    pub percentiles: Vec<Percentile>,
    /// True while every value is a whole number.
    #[serde(skip)]
    whole: bool,
}

/// Value that a share of the finite values does not exceed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub(crate) struct Percentile {
    /// Share of the values in per cent.
    pub percent: f64,
    /// Value.
    pub value: f64,
}

/// An image of a scan with its values.
#[derive(Debug)]
pub(crate) struct Measured {
    pub header: Header,
    /// False where neither the file nor the settings say how large voxels are.
    pub spacing: bool,
    pub statistics: ValueStatistics,
}

/// Reads the headers and all values of a scan. Of several points in time or channels the first one is read unless the
/// settings choose another.
///
/// # Errors
/// If the file cannot be read or is damaged.
pub(crate) fn measured(
    path: &Path,
    (format, reader): (&Format, &ImageFormat),
    scan: &ScanSettings,
    limits: Limits,
) -> Result<Vec<Measured>> {
    let mut options = scan.reading()?;
    let unstated = format.kind.heeds(ReadOption::Placement) && options.placement()?.is_none();
    let (images, spacing) = match reader.open(path, &options, limits) {
        Err(error) if unstated => {
            // What does not say how large its voxels are is described all the same.
            options.spacing = Some(DVec3::ONE);
            (reader.open(path, &options, limits).map_err(|_| error)?, false)
        }
        images => (images?, true),
    };
    let mut all = Vec::new();
    for mut image in images {
        let statistics = ValueStatistics::first_pass(&mut image).map_err(|e| e.at(path))?;
        image.header.notes.extend(image.slices.notes());
        all.push(Measured { header: image.header, spacing, statistics });
    }
    second_pass(path, reader, &options, limits, &mut all)?;
    Ok(all)
}

/// Counts the values of all images in bins.
fn second_pass(
    path: &Path,
    reader: &ImageFormat,
    options: &Options,
    limits: Limits,
    all: &mut [Measured],
) -> Result<()> {
    let images = reader.open(path, options, limits)?;
    for (mut image, measured) in images.into_iter().zip(all) {
        let bins = Bins::of(&measured.statistics);
        let Some(mut bins) = bins else { continue };
        each(&mut image, |value| bins.count(value)).map_err(|e| e.at(path))?;
        measured.statistics.histogram = bins.coarse;
        let total = bins.fine.iter().sum::<u64>();
        let value = |percent: f64| {
            let wanted = (percent / 100.0 * total as f64).max(1.0);
            let mut sum = 0;
            let at = bins.fine.iter().position(|count| {
                sum += count;
                sum as f64 >= wanted
            });
            match at.unwrap_or_default() {
                0 => bins.low,
                at => bins.low + (at as f64 + bins.inside) * bins.width,
            }
        };
        measured.statistics.percentiles =
            PERCENTS.iter().map(|percent| Percentile { percent: *percent, value: value(*percent) }).collect();
    }
    Ok(())
}

/// Hands every value of an image to `take`, of vectors their lengths.
fn each(image: &mut Image, mut take: impl FnMut(f64)) -> Result<()> {
    let components = image.header.components;
    let mut values = vec![0.0; image.header.slice_len().unwrap_or(0)];
    for _ in 0..image.header.size[2] {
        image.slices.next_slice(&mut values)?;
        for voxel in values.chunks_exact(components) {
            take(match voxel {
                [one] => *one,
                many => many.iter().map(|c| c * c).sum::<f64>().sqrt(),
            });
        }
    }
    Ok(())
}

impl ValueStatistics {
    fn first_pass(image: &mut Image) -> Result<Self> {
        let mut statistics = Self { whole: true, ..Self::default() };
        let (mut low, mut high, mut sum) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
        each(image, |value| {
            statistics.count += 1;
            if value.is_nan() {
                statistics.nan += 1;
            } else if value.is_infinite() {
                statistics.infinite += 1;
            } else {
                low = low.min(value);
                high = high.max(value);
                sum += value;
                statistics.negative += u64::from(value < 0.0);
                statistics.zero += u64::from(value == 0.0);
                statistics.whole &= value.fract() == 0.0;
            }
        })?;
        let finite = statistics.count - statistics.nan - statistics.infinite;
        if finite > 0 {
            (statistics.min, statistics.max, statistics.mean) = (Some(low), Some(high), Some(sum / finite as f64));
        }
        Ok(statistics)
    }
}

/// Bins from the smallest to the largest value.
struct Bins {
    low: f64,
    /// Width of a fine bin.
    width: f64,
    /// Where the value of a fine bin lies in it.
    inside: f64,
    /// Width of a coarse bin.
    step: f64,
    fine: Vec<u64>,
    coarse: Vec<u64>,
}

impl Bins {
    /// Returns empty bins; none without finite values.
    fn of(statistics: &ValueStatistics) -> Option<Self> {
        let (low, high) = (statistics.min?, statistics.max?);
        let (low_half, high_half) = (low / 2.0, high / 2.0);
        // Halves, so that the range of the largest numbers is finite.
        let range = 2.0 * (high_half - low_half).min(f64::MAX / 2.0);
        let exact = statistics.whole && range < FINE as f64;
        let (width, inside) = if exact { (1.0, 0.0) } else { (range / FINE as f64, 0.5) };
        Some(Self { low, width, inside, step: range / BINS as f64, fine: vec![0; FINE], coarse: vec![0; BINS] })
    }

    fn count(&mut self, value: f64) {
        if value.is_finite() {
            // With a single distinct value the place is NaN, which counts in the first bin.
            let place = |width: f64, bins: usize| (((value - self.low) / width) as usize).min(bins - 1);
            let (fine, coarse) = (place(self.width, FINE), place(self.step, BINS));
            self.fine[fine] += 1;
            self.coarse[coarse] += 1;
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::formats::imaging::image::{About, Slices, Values};
    use crate::math::Affine;

    struct Numbers(Vec<f64>);

    impl Slices for Numbers {
        fn next_slice(&mut self, values: &mut [f64]) -> Result<()> {
            values.copy_from_slice(&self.0);
            Ok(())
        }
    }

    fn statistics_of(values: &[f64]) -> ValueStatistics {
        let image = || Image {
            header: Header {
                name: None,
                size: [values.len(), 1, 1],
                components: 1,
                values: Values::Real,
                index_to_world: Affine::new(glam::DMat4::IDENTITY).unwrap(),
                about: About::default(),
                notes: Vec::new(),
            },
            slices: Box::new(Numbers(values.to_vec())),
        };
        let mut statistics = ValueStatistics::first_pass(&mut image()).unwrap();
        let mut bins = Bins::of(&statistics).unwrap();
        each(&mut image(), |value| bins.count(value)).unwrap();
        statistics.histogram = bins.coarse;
        statistics
    }

    #[test]
    fn values_are_counted_and_the_extreme_ones_do_not_overflow() {
        let statistics = statistics_of(&[-1.0, 0.0, 2.0, f64::NAN, f64::INFINITY]);
        assert_eq!(
            (statistics.min, statistics.max, statistics.negative, statistics.zero),
            (Some(-1.0), Some(2.0), 1, 1)
        );
        assert_eq!((statistics.nan, statistics.infinite, statistics.histogram.iter().sum::<u64>()), (1, 1, 3));
        assert_eq!(statistics_of(&[f64::MAX, f64::MIN]).histogram.iter().sum::<u64>(), 2);
        assert_eq!(statistics_of(&[7.0, 7.0]).histogram[0], 2);
    }
}
