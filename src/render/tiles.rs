//! The tile driver: the one place where rays and pixels are distributed over threads.
//!
//! Callers that render, project or differentiate cut their pixels into units (tiles, runs along a curve) that depend on
//! the pictures alone, and pass the work on one unit as a closure. Results and sums are returned in the order of the
//! units or of the partitions, so that they are bit-identical for any number of threads. A cancel flag stops the work
//! between two units.

use crate::cancel::Cancel;
use crate::ranks;
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

/// Applies `work` to each unit, with scratch memory for each unit at work, and returns the results in the units' order;
/// `None` if `cancel` was set before all were done.
pub fn map<U: Sync, S, T: Send>(
    units: &[U],
    cancel: &Cancel,
    scratch: impl Fn() -> S + Sync + Send,
    work: impl Fn(&mut S, &U) -> T + Sync + Send,
) -> Option<Vec<T>> {
    // No grouping: the cost of units varies widely.
    let one = |scratch: &mut S, unit: &U| (!cancel.requested()).then(|| work(scratch, unit));
    units.par_iter().with_max_len(1).map_init(scratch, one).collect()
}

/// Computes the pixels of a picture in row-major order, in parallel over bands of rows. `begin` creates what a band has
/// beside its pixels, by their number, and `pixel(scratch, [x, y], (band, index))` returns the value of one, whose
/// `index` in its band is row-major. Returns the pixels and the bands from top to bottom; `None` if the watch stopped
/// the work before all were done.
pub(crate) fn pixels<S, B: Send, T: Send + Default + Clone>(
    [width, height]: [usize; 2],
    watch: Watch<'_>,
    scratch: impl Fn() -> S + Sync + Send,
    begin: impl Fn(usize) -> B + Sync + Send,
    pixel: impl Fn(&mut S, [usize; 2], (&mut B, usize)) -> T + Sync + Send,
) -> Option<(Vec<T>, Vec<B>)> {
    let mut values = vec![T::default(); width * height];
    let bands = values.par_chunks_mut((width * TILE[1]).max(1)).enumerate().with_max_len(1);
    let bands = bands.map_init(scratch, |scratch, (number, pixels)| {
        let mut band = begin(pixels.len());
        for left in (0..width).step_by(TILE[0]) {
            if watch.cancel.requested() {
                return None;
            }
            let across = left..width.min(left + TILE[0]);
            for row in 0..pixels.len() / width {
                for x in across.clone() {
                    let index = row * width + x;
                    pixels[index] = pixel(scratch, [x, number * TILE[1] + row], (&mut band, index));
                }
            }
            if let Some(done) = watch.done {
                done((across.len() * (pixels.len() / width)) as u64);
            }
        }
        Some(band)
    });
    let bands = bands.collect::<Option<_>>()?;
    (!watch.cancel.requested()).then_some((values, bands))
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
    of_partitions(0..partitions.len(), partitions, cancel, units, begin, work)
}

/// Sums over the units of the partitions that this process has among [`ranks`], as [`partitions`] does over those of
/// all.
pub(crate) fn own_partitions<P: Send, U, I: Iterator<Item = U>, T: Send>(
    partitions: &mut [P],
    cancel: &Cancel,
    units: impl Fn(usize) -> I + Sync,
    begin: impl Fn(&mut P) -> T + Sync,
    work: impl Fn(&mut P, &mut T, U) + Sync,
) -> Vec<T> {
    of_partitions(ranks::own(partitions.len()), partitions, cancel, units, begin, work)
}

fn of_partitions<P: Send, U, I: Iterator<Item = U>, T: Send>(
    some: Range<usize>,
    partitions: &mut [P],
    cancel: &Cancel,
    units: impl Fn(usize) -> I + Sync,
    begin: impl Fn(&mut P) -> T + Sync,
    work: impl Fn(&mut P, &mut T, U) + Sync,
) -> Vec<T> {
    // No grouping: the cost of partitions varies widely.
    let first = some.start;
    let all = partitions[some].par_iter_mut().enumerate().with_max_len(1);
    all.map(|(i, partition)| {
        let number = first + i;
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
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[test]
    fn every_pixel_has_its_own_value_and_a_flag_stops_all() {
        for size in [[0, 3], [1, 1], [17, 5], [40, 31]] {
            let found = pixels(
                size,
                (&Cancel::NEVER).into(),
                || (),
                |_| 0,
                |(), [x, y], (count, _)| {
                    *count += 1;
                    (x + 1, y + 1)
                },
            );
            let (found, counts) = found.unwrap();
            let expected: Vec<_> = (0..size[0] * size[1]).map(|i| (i % size[0] + 1, i / size[0] + 1)).collect();
            assert_eq!((found, counts.iter().sum()), (expected, size[0] * size[1]), "{size:?}");
        }
        let set = Cancel::new();
        set.request();
        assert_eq!(pixels([4, 4], (&set).into(), || (), |_| (), |(), _, _| 1), None);
        assert_eq!(map(&[1, 2], &set, || (), |(), unit| *unit), None);
    }

    #[test]
    fn every_pixel_is_counted_once() {
        let (cancel, count) = (Cancel::new(), AtomicU64::new(0));
        let done = |pixels| {
            count.fetch_add(pixels, Ordering::Relaxed);
        };
        let watch = Watch { cancel: &cancel, done: Some(&done) };
        assert!(pixels([37, 11], watch, || (), |_| (), |(), _, _| 1).is_some());
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
}
