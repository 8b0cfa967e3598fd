//! The tile driver: the one place where rays and pixels are distributed over threads.
//!
//! Callers that render, project or differentiate cut their pixels into units (tiles, runs along a curve) that depend on
//! the pictures alone, and pass the work on one unit as a closure. Results and sums are returned in the order of the
//! units or of the partitions, so that they are bit-identical for any number of threads. A cancel flag stops the work
//! between two units.

use crate::cancel::Cancel;
use rayon::prelude::*;
use std::ops::Range;

/// Watch over the pixels of a picture: a flag that stops the work, and who is told of the pixels that are done.
#[derive(Clone, Copy)]
pub struct Watch<'w> {
    /// Flag that stops the work once it is set.
    pub cancel: &'w Cancel,
    /// Receiver of the number of pixels that have been done since it was called last, on any thread.
    pub done: Option<&'w (dyn Fn(u64) + Sync)>,
}

impl<'w> From<&'w Cancel> for Watch<'w> {
    /// Creates the watch of a flag, which tells nobody.
    fn from(cancel: &'w Cancel) -> Self {
        Self { cancel, done: None }
    }
}

/// The rays of a pixel: through the centres of `per_edge`² equal squares of it, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Subpixels {
    per_edge: usize,
}

impl Subpixels {
    /// Creates `per_edge` rays along each edge of a pixel, at least one.
    pub(crate) fn new(per_edge: usize) -> Self {
        Self { per_edge: per_edge.max(1) }
    }

    /// Returns the number of rays of a pixel.
    #[inline(always)]
    pub(crate) fn count(self) -> usize {
        self.per_edge * self.per_edge
    }

    /// Returns the image position of a pixel's ray, in pixels.
    #[inline(always)]
    pub(crate) fn position(self, [x, y]: [usize; 2], ray: usize) -> [f64; 2] {
        let n = self.per_edge;
        let offset = |k: usize| (k as f64 + 0.5) / n as f64;
        [x as f64 + offset(ray % n), y as f64 + offset(ray / n)]
    }

    /// Returns the image positions of all rays of a pixel, in pixels.
    #[inline(always)]
    pub(crate) fn positions(self, pixel: [usize; 2]) -> impl Iterator<Item = [f64; 2]> {
        (0..self.count()).map(move |ray| self.position(pixel, ray))
    }
}

/// Applies `work` to each unit, with scratch memory for each unit at work, and returns the results in the units' order;
/// `None` if `cancel` was set before all were done.
pub(crate) fn map<U: Sync, S, T: Send>(
    units: &[U],
    cancel: &Cancel,
    scratch: impl Fn() -> S + Sync + Send,
    work: impl Fn(&mut S, &U) -> T + Sync + Send,
) -> Option<Vec<T>> {
    // No grouping: the cost of units varies widely.
    let one = |scratch: &mut S, unit: &U| (!cancel.requested()).then(|| work(scratch, unit));
    units.par_iter().with_max_len(1).map_init(scratch, one).collect()
}

/// Computes the pixels of a picture in row-major order, in parallel over bands of rows: `pixel(scratch, [x, y])`
/// returns the value of one. `None` if the watch stopped the work before all were done.
pub(crate) fn pixels<S, T: Send + Default + Clone>(
    [width, height]: [usize; 2],
    watch: Option<Watch<'_>>,
    scratch: impl Fn() -> S + Sync + Send,
    pixel: impl Fn(&mut S, [usize; 2]) -> T + Sync + Send,
) -> Option<Vec<T>> {
    let mut values = vec![T::default(); width * height];
    let cancel = watch.map_or(&Cancel::NEVER, |watch| watch.cancel);
    let bands = values.par_chunks_mut((width * TILE[1]).max(1)).enumerate().with_max_len(1);
    bands.for_each_init(scratch, |scratch, (band, rows)| {
        for left in (0..width).step_by(TILE[0]) {
            if cancel.requested() {
                return;
            }
            let across = left..width.min(left + TILE[0]);
            for (row, values) in rows.chunks_mut(width).enumerate() {
                for x in across.clone() {
                    values[x] = pixel(scratch, [x, band * TILE[1] + row]);
                }
            }
            if let Some(done) = watch.and_then(|watch| watch.done) {
                done((across.len() * (rows.len() / width)) as u64);
            }
        }
    });
    (!cancel.requested()).then_some(values)
}

/// Width and height of the tiles of [`pixels`]. A band of as many rows is one task; within it pixels go tile by tile,
/// so that consecutive rays visit the same bricks. Small pictures need many tasks.
const TILE: [usize; 2] = [16, 4];

/// Sums over the units of each partition, in order, bit-identical for any number of threads if the number of partitions
/// does not depend on it: `begin` creates a partition's sum, `work` adds a unit. Returns the
/// sums in the partitions' order; those of work that `cancel` stopped are incomplete.
pub(crate) fn partitions<P: Send, U, I: Iterator<Item = U>, T: Send>(
    partitions: &mut [P],
    cancel: &Cancel,
    units: impl Fn(usize) -> I + Sync,
    begin: impl Fn(&mut P) -> T + Sync,
    work: impl Fn(&mut P, &mut T, U) + Sync,
) -> Vec<T> {
    // No grouping: the cost of partitions varies widely.
    let all = partitions.par_iter_mut().enumerate().with_max_len(1);
    all.map(|(number, partition)| {
        let mut sum = begin(partition);
        for unit in units(number) {
            if cancel.requested() {
                break;
            }
            work(partition, &mut sum, unit);
        }
        sum
    })
    .collect()
}

/// Deals units out in turn, and returns those of partition `number` among `partitions`.
pub(crate) fn dealt<U>(units: &[U], number: usize, partitions: usize) -> impl Iterator<Item = &U> {
    units.iter().skip(number).step_by(partitions.max(1))
}

/// Cuts `0..count` into consecutive runs of at most `length`.
pub(crate) fn runs(count: usize, length: usize) -> Vec<Range<usize>> {
    (0..count).step_by(length.max(1)).map(|begin| begin..count.min(begin + length)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[test]
    fn every_pixel_has_its_own_value_and_a_flag_stops_all() {
        for size in [[0, 3], [1, 1], [17, 5], [40, 31]] {
            let found = pixels(size, None, || (), |(), [x, y]| (x + 1, y + 1));
            let expected: Vec<_> = (0..size[0] * size[1]).map(|i| (i % size[0] + 1, i / size[0] + 1)).collect();
            assert_eq!(found, Some(expected), "{size:?}");
        }
        let set = Cancel::new();
        set.request();
        assert_eq!(pixels([4, 4], Some((&set).into()), || (), |(), _| 1), None);
        assert_eq!(map(&[1, 2], &set, || (), |(), unit| *unit), None);
    }

    #[test]
    fn every_pixel_is_counted_once() {
        let (cancel, count) = (Cancel::new(), AtomicU64::new(0));
        let done = |pixels| {
            count.fetch_add(pixels, Ordering::Relaxed);
        };
        let watch = Watch { cancel: &cancel, done: Some(&done) };
        assert!(pixels([37, 11], Some(watch), || (), |(), _| 1).is_some());
        assert_eq!(count.into_inner(), 37 * 11);
    }

    #[test]
    fn results_come_in_order() {
        let units: Vec<u64> = (0..1000).collect();
        assert_eq!(map(&units, &Cancel::NEVER, || 0, |_, unit| 3 * unit), Some(units.iter().map(|u| 3 * u).collect()));
        let sums = partitions(&mut [0; 7], &Cancel::NEVER, |k| dealt(&units, k, 7), |_| 0, |_, sum, unit| *sum += unit);
        let expected: Vec<u64> = (0..7).map(|k| units.iter().filter(|u| *u % 7 == k).sum()).collect();
        assert_eq!(sums, expected);
        assert_eq!(runs(10, 4), [0..4, 4..8, 8..10]);
    }

    #[test]
    fn rays_of_a_pixel_stand_in_the_middle_of_equal_squares() {
        let two: Vec<[f64; 2]> = Subpixels::new(2).positions([3, 5]).collect();
        assert_eq!(two, [[3.25, 5.25], [3.75, 5.25], [3.25, 5.75], [3.75, 5.75]]);
        assert_eq!(Subpixels::new(0).positions([0, 0]).collect::<Vec<_>>(), [[0.5, 0.5]]);
    }
}
