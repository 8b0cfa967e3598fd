//! Work on all threads whose failure does not depend on which thread was first.

use crate::error::{Error, Result};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Maps items on all threads and returns their results in the order of the items. Once an item has failed, those after
/// it are not begun; those before it are, so that the error does not depend on the number of threads.
///
/// # Errors
/// If an item fails: the first that does, in the order of the items.
pub fn try_map<T: Send, R: Send>(
    items: impl IndexedParallelIterator<Item = T>,
    one: impl Fn(T) -> Result<R> + Sync + Send,
) -> Result<Vec<R>> {
    let first_failure = AtomicUsize::new(usize::MAX);
    let of = |(index, item): (usize, T)| -> Option<Result<R, Error>> {
        (index < first_failure.load(Ordering::Relaxed)).then(|| {
            one(item).inspect_err(|_| {
                first_failure.fetch_min(index, Ordering::Relaxed);
            })
        })
    };
    let results: Vec<Option<Result<R, Error>>> = items.enumerate().map(of).collect();
    results.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::try_map;
    use crate::error::Error;
    use rayon::prelude::*;
    use std::time::Duration;

    #[test]
    fn the_first_failure_in_order_is_told() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
        for slowest in 0..8 {
            let one = |item: usize| {
                // Whichever fails last in time, the first in order is told.
                std::thread::sleep(Duration::from_millis(if item == slowest { 20 } else { 0 }));
                if item < 3 { Ok(item) } else { Err(Error::invalid(format!("item {item}"))) }
            };
            let error = pool.install(|| try_map((0..8_usize).into_par_iter().with_max_len(1), one)).unwrap_err();
            assert!(error.to_string().contains("item 3"), "{error}");
        }
        assert_eq!(try_map((0..100_usize).into_par_iter(), |i| Ok(2 * i)).unwrap()[99], 198);
    }
}
