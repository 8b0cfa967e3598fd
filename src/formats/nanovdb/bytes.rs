//! Bounded access to the memory of a grid: no offset is followed before it is known to lie inside.

use crate::error::{Error, Result};

/// Memory of a grid, addressed from its first byte.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bytes<'a>(pub &'a [u8]);

impl<'a> Bytes<'a> {
    /// Returns `length` bytes at `at`; `what` names them in the error.
    ///
    /// # Errors
    /// If they do not lie inside the memory.
    pub(crate) fn slice(self, at: u64, length: usize, what: &str) -> Result<&'a [u8]> {
        let start = usize::try_from(at).ok();
        let found = start.and_then(|start| self.0.get(start..start.checked_add(length)?));
        found.ok_or_else(|| {
            Error::invalid(format!("{what} at byte {at} lies outside the grid's {} bytes", self.0.len())).hint(DAMAGED)
        })
    }

    fn array<const N: usize>(self, at: u64, what: &str) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.slice(at, N, what)?);
        Ok(bytes)
    }

    pub(crate) fn u32(self, at: u64, what: &str) -> Result<u32> {
        self.array(at, what).map(u32::from_le_bytes)
    }

    pub(crate) fn u64(self, at: u64, what: &str) -> Result<u64> {
        self.array(at, what).map(u64::from_le_bytes)
    }

    pub(crate) fn i64(self, at: u64, what: &str) -> Result<i64> {
        self.array(at, what).map(i64::from_le_bytes)
    }

    pub(crate) fn f64(self, at: u64, what: &str) -> Result<f64> {
        self.array(at, what).map(f64::from_le_bytes)
    }
}

/// Advice on a file whose parts contradict each other.
pub(super) const DAMAGED: &str =
    "the file is damaged or incomplete: copy it again, or write it again where it was made";
