//! A flag by which long computations are asked to stop.

use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that asks a computation to stop. Copies refer to the same flag.
///
/// A pass that was stopped leaves incomplete sums; its caller asks [`Cancel::requested`] before it uses them.
#[derive(Debug, Clone, Copy, Default)]
pub struct Cancel(Option<&'static AtomicBool>);

impl Cancel {
    /// A flag that is never set.
    pub const NEVER: Self = Self(None);

    /// Refers to `flag`: the computation is asked to stop once it is set.
    pub fn on(flag: &'static AtomicBool) -> Self {
        Self(Some(flag))
    }

    /// The underlying flag, for code that polls an [`AtomicBool`]; `None` for [`Cancel::NEVER`].
    pub fn flag(self) -> Option<&'static AtomicBool> {
        self.0
    }

    /// The underlying flag, for code that polls an [`AtomicBool`]; one that is never set for [`Cancel::NEVER`].
    pub fn polled(self) -> &'static AtomicBool {
        static NEVER: AtomicBool = AtomicBool::new(false);
        self.0.unwrap_or(&NEVER)
    }

    /// True once the computation has been asked to stop.
    #[inline]
    pub fn requested(self) -> bool {
        self.0.is_some_and(|flag| flag.load(Ordering::Relaxed))
    }
}
