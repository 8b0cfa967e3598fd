//! A flag by which long computations are asked to stop.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that asks computations to stop. Clones refer to the same flag.
///
/// A pass that was stopped leaves incomplete sums; its caller asks [`Cancel::requested`] before it uses them.
#[derive(Debug, Clone, Default)]
pub struct Cancel(Option<Arc<AtomicBool>>);

impl Cancel {
    /// A flag that is never set.
    pub const NEVER: Self = Self(None);

    /// Creates a flag that is not set.
    pub fn new() -> Self {
        Self(Some(Arc::default()))
    }

    /// Asks all computations that poll the flag to stop, and returns true if they were asked before. [`Cancel::NEVER`]
    /// asks nobody.
    pub fn request(&self) -> bool {
        self.0.as_ref().is_some_and(|flag| flag.swap(true, Ordering::SeqCst))
    }

    /// True once computations have been asked to stop.
    #[inline]
    pub fn requested(&self) -> bool {
        self.0.as_ref().is_some_and(|flag| flag.load(Ordering::Relaxed))
    }
}
