//! A request to stop, as long passes poll it.

use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that asks a computation to stop. Copies refer to the same flag.
///
/// A pass that was stopped leaves incomplete sums; its caller asks [`Cancel::requested`] before it uses them.
#[derive(Debug, Clone, Copy, Default)]
pub struct Cancel(Option<&'static AtomicBool>);

impl Cancel {
    /// A computation that is never asked to stop.
    pub const NEVER: Self = Self(None);

    /// Stops once `flag` is set.
    pub fn on(flag: &'static AtomicBool) -> Self {
        Self(Some(flag))
    }

    /// The flag, for what polls it as it is.
    pub fn flag(self) -> Option<&'static AtomicBool> {
        self.0
    }

    /// True once the computation is to stop.
    #[inline]
    pub fn requested(self) -> bool {
        self.0.is_some_and(|flag| flag.load(Ordering::Relaxed))
    }
}
