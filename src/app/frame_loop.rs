//! Work on the frames of a sequence: several at a time, or one after the other.

use super::context::{Context, Picture, Stage};
use super::failed::Failed;
use crate::error::{Error, Kind, Result};
use crate::formats::limits::Limits;
use rayon::prelude::*;

/// Result of each frame, in ascending order.
pub(crate) type Results<T> = Vec<(u32, Result<T>)>;

/// A loop over frames, given in ascending order, under one bar. A frame that fails does not stop the others; one that
/// was stopped by the user stops them all.
pub(crate) struct FrameLoop<'f> {
    numbers: &'f [u32],
    context: &'f Context,
    bar: Stage,
    /// True to say which frames failed, and why.
    told: bool,
}

impl<'f> FrameLoop<'f> {
    /// Begins a stage of a step for each frame.
    pub(crate) fn steps(numbers: &'f [u32], name: &'static str, context: &'f Context) -> Self {
        Self { numbers, context, bar: context.steps(numbers.len() as u64, name), told: false }
    }

    /// Begins a stage of a picture for each frame.
    pub(crate) fn pictures(numbers: &'f [u32], name: &'static str, context: &'f Context) -> Self {
        Self { numbers, context, bar: context.pictures(numbers.len() as u64, name), told: false }
    }

    /// Has it said which frames failed, and why.
    #[must_use]
    pub(crate) fn telling(self) -> Self {
        Self { told: true, ..self }
    }

    /// Works on independent frames, several at a time. These share the memory; a frame for which its share is too small
    /// is done again alone.
    ///
    /// # Errors
    /// If the work is stopped by the user.
    pub(crate) fn parallel<T: Send>(
        self,
        limits: Limits,
        work: impl Fn(u32, Limits) -> Result<T> + Sync,
    ) -> Result<Results<T>> {
        let results = at_once(self.numbers, limits, work, &|| self.bar.inc(1))?;
        drop(self.bar);
        if self.told {
            results.iter().for_each(|(number, result)| tell(self.context, *number, result));
        }
        Ok(results)
    }

    /// Works on one frame after the other, where the work on each is parallel by itself, or needs what those before it
    /// have left. It is given the place and the number of the frame, and the picture of the stage.
    ///
    /// # Errors
    /// If the work is stopped by the user.
    pub(crate) fn in_order<T>(self, mut work: impl FnMut(usize, u32, &Picture<'_>) -> Result<T>) -> Result<Results<T>> {
        let frames = self.numbers.iter().enumerate();
        frames.map(|(place, number)| self.one(*number, |picture| work(place, *number, picture))).collect()
    }

    /// Works on one frame after the other as [`Self::in_order`] does, on what `read` has read of it: as many frames at
    /// a time as there are threads.
    ///
    /// # Errors
    /// If the work is stopped by the user.
    pub(crate) fn in_order_of<R: Send, T>(
        self,
        limits: Limits,
        read: impl Fn(u32, Limits) -> Result<R> + Sync,
        mut work: impl FnMut(usize, u32, R) -> Result<T>,
    ) -> Result<Results<T>> {
        let mut results = Vec::new();
        for numbers in self.numbers.chunks(rayon::current_num_threads().max(1)) {
            for (number, input) in at_once(numbers, limits, &read, &|| ())? {
                let place = results.len();
                results.push(self.one(number, |_| work(place, number, input?))?);
            }
        }
        Ok(results)
    }

    fn one<T>(&self, number: u32, work: impl FnOnce(&Picture<'_>) -> Result<T>) -> Result<(u32, Result<T>)> {
        // It counts as done once it is dropped.
        let picture = self.bar.picture();
        match work(&picture) {
            Err(error) if error.kind() == Kind::Cancelled => Err(error),
            result => {
                if self.told {
                    tell(self.context, number, &result);
                }
                Ok((number, result))
            }
        }
    }
}

/// Works on frames at once, which share the memory, and calls `tick` for each that is done.
fn at_once<T: Send>(
    numbers: &[u32],
    limits: Limits,
    work: impl Fn(u32, Limits) -> Result<T> + Sync,
    tick: &(dyn Fn() + Sync),
) -> Result<Results<T>> {
    let at_once = rayon::current_num_threads().min(numbers.len()).max(1) as u64;
    let share = Limits { max_memory: limits.max_memory / at_once };
    let first = |number: &u32| {
        let result = work(*number, share);
        if !too_large(&result, at_once) {
            tick();
        }
        (*number, result)
    };
    let mut results: Results<T> = numbers.par_iter().with_max_len(1).map(first).collect();
    for (number, result) in &mut results {
        if too_large(result, at_once) {
            *result = work(*number, limits);
            tick();
        }
    }
    let stopped = |(_, result): &(u32, Result<T>)| matches!(result, Err(e) if e.kind() == Kind::Cancelled);
    if results.iter().any(stopped) { Err(Error::cancelled()) } else { Ok(results) }
}

/// True if a frame may have failed for want of memory that others held: readers refuse what exceeds their limits as
/// unsupported.
fn too_large<T>(result: &Result<T>, at_once: u64) -> bool {
    at_once > 1 && result.as_ref().is_err_and(|error| error.kind() == Kind::Unsupported)
}

fn tell<T>(context: &Context, number: u32, result: &Result<T>) {
    if let Err(error) = result {
        context.failed(&[Failed::new(number, error)]);
    }
}

/// Results that are there, and the frames that failed.
pub(crate) type Parted<T> = (Vec<(u32, T)>, Vec<Failed>);

/// Parts the results into those that are there and the frames that failed.
pub(crate) fn parted<T>(results: Results<T>) -> Parted<T> {
    let (mut done, mut failed) = (Vec::new(), Vec::new());
    for (number, result) in results {
        match result {
            Ok(value) => done.push((number, value)),
            Err(error) => failed.push(Failed::new(number, &error)),
        }
    }
    (done, failed)
}

/// Parts the results as [`parted`] does, where one frame at least is needed.
///
/// # Errors
/// If all frames fail: that of the first one.
pub(crate) fn some<T>(mut results: Results<T>) -> Result<Parted<T>> {
    if results.is_empty() || results.iter().any(|(_, result)| result.is_ok()) {
        return Ok(parted(results));
    }
    results.swap_remove(0).1.map(|_| (Vec::new(), Vec::new()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    fn failing(number: u32, limits: Limits) -> Result<u32> {
        match number {
            3 => Err(Error::invalid("bad")),
            // More than the share of one of two or more.
            7 if limits.max_memory < 600 => Err(Error::unsupported("too large")),
            9 => Err(Error::unsupported("never")),
            _ => Ok(number * 2),
        }
    }

    #[test]
    fn a_frame_that_fails_stops_no_other_and_one_that_is_too_large_is_done_alone() {
        let context = Context::default();
        let limits = Limits { max_memory: 1000 };
        let numbers: Vec<u32> = (1..=20).collect();
        let begin = || FrameLoop::steps(&numbers, "test", &context).telling();
        let in_order = begin().in_order(|place, number, _| {
            assert_eq!(place + 1, number as usize);
            failing(number, limits)
        });
        let read = begin().in_order_of(limits, failing, |_, _, value| Ok(value));
        for results in [begin().parallel(limits, failing), in_order, read] {
            let (done, failed) = parted(results.unwrap());
            assert_eq!(failed.iter().map(|f| f.frame).collect::<Vec<_>>(), [3, 9]);
            let there = numbers.iter().filter(|n| ![3, 9].contains(*n));
            assert_eq!(done, there.map(|n| (*n, n * 2)).collect::<Vec<_>>());
        }
        let stopped = begin().parallel(limits, |_, _| Err::<(), _>(Error::cancelled()));
        assert_eq!(stopped.unwrap_err().kind(), Kind::Cancelled);
        let stopped = begin().in_order(|place, _, _| if place < 2 { Ok(()) } else { Err(Error::cancelled()) });
        assert_eq!(stopped.unwrap_err().kind(), Kind::Cancelled);
    }

    #[test]
    fn one_frame_at_least_is_needed() {
        let bad = |number| (number, Err::<u32, _>(Error::invalid(format!("bad {number}"))));
        assert!(some(vec![bad(1), bad(2)]).unwrap_err().to_string().contains("bad 1"));
        assert_eq!(some(vec![bad(1), (2, Ok(4))]).unwrap().0, [(2, 4)]);
        assert!(some(Results::<u32>::new()).unwrap().0.is_empty());
    }
}
