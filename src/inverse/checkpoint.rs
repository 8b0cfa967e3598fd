//! What a reconstruction has found so far, handed out now and then, so that an end before its time loses little.

use crate::ranks;
use crate::scene::bricks::Bricks;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Receiver of densities.
type Keep = Arc<dyn Fn(&Bricks<f32>) + Send + Sync>;

/// Receiver of the densities so far; clones share the time of the last ones.
#[derive(Clone)]
pub struct Checkpoint {
    every: Duration,
    last: Arc<Mutex<Instant>>,
    keep: Keep,
}

impl fmt::Debug for Checkpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Checkpoint").field("every", &self.every).finish_non_exhaustive()
    }
}

impl Checkpoint {
    /// Creates a receiver `keep` of densities, which is called at the first step after each such time.
    pub fn new(every: Duration, keep: impl Fn(&Bricks<f32>) + Send + Sync + 'static) -> Self {
        Self { every, last: Arc::new(Mutex::new(Instant::now())), keep: Arc::new(keep) }
    }

    /// Hands out the densities if it is time. Of several processes the first one does.
    pub(crate) fn offer(&self, field: impl FnOnce() -> Bricks<f32>) {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if ranks::is_first() && last.elapsed() >= self.every {
            (self.keep)(&field());
            *last = Instant::now();
        }
    }
}
