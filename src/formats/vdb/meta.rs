//! Metadata of files and grids, read and written.

use super::ffi;
use crate::error::Result;
use crate::scene::grid::MetaValue;
use std::collections::BTreeMap;
use std::ffi::c_char;
use std::ptr::{NonNull, null, null_mut};

/// A metadata map on the native side: an owned copy, or a view of a grid's map. It stays on its thread, because values
/// are returned through buffers that belong to the thread.
pub(super) struct Meta(NonNull<ffi::RawMeta>);

impl Meta {
    /// Takes ownership of a raw handle; `None` if it is null.
    ///
    /// # Safety
    /// `raw` must come from the shim and be owned by nobody else; a view must not outlive its grid.
    pub(super) unsafe fn own(raw: *mut ffi::RawMeta) -> Option<Self> {
        NonNull::new(raw).map(Self)
    }

    pub(super) fn new() -> Result<Self> {
        let mut raw = null_mut();
        // SAFETY: `raw` is a valid place for the new handle.
        ffi::call(|s| unsafe { ffi::meta_new(&mut raw, s) })?;
        // SAFETY: fresh from the shim.
        unsafe { Self::own(raw) }.ok_or_else(|| crate::Error::native("no metadata handle"))
    }

    pub(super) fn as_ptr(&self) -> *mut ffi::RawMeta {
        self.0.as_ptr()
    }

    /// All entries by name. Values of types without a counterpart appear as text.
    pub(super) fn entries(&self) -> Result<BTreeMap<String, MetaValue>> {
        let mut all = BTreeMap::new();
        let mut count = 0;
        // SAFETY: the handle is alive and `count` a valid place.
        ffi::call(|s| unsafe { ffi::meta_count(self.as_ptr(), &mut count, s) })?;
        for index in 0..count {
            let mut entry = ffi::MetaEntry::default();
            // SAFETY: the handle is alive and `entry` is a valid place.
            ffi::call(|s| unsafe { ffi::meta_get(self.as_ptr(), index, &mut entry, s) })?;
            // SAFETY: the pointers stay valid until the next call on this handle or thread.
            let (name, text) = unsafe { (slice(entry.name, entry.name_length), slice(entry.text, entry.text_length)) };
            let count = entry.count.clamp(0, 16) as usize;
            let value = match entry.kind {
                1 => MetaValue::Bool(entry.ints[0] != 0),
                2 => MetaValue::Int(entry.ints[0]),
                3 => MetaValue::Float(entry.floats[0]),
                5 => MetaValue::Ints(entry.ints[..count.min(4)].to_vec()),
                6 => MetaValue::Floats(entry.floats[..count].to_vec()),
                _ => MetaValue::Text(ffi::printable(text)),
            };
            all.insert(ffi::printable(name), value);
        }
        Ok(all)
    }

    /// Sets or replaces the entry `name`.
    pub(super) fn set(&mut self, name: &str, value: &MetaValue) -> Result<()> {
        let mut entry =
            ffi::MetaEntry { name: name.as_ptr().cast(), name_length: name.len(), ..ffi::MetaEntry::default() };
        entry.text = null();
        match value {
            MetaValue::Bool(b) => (entry.kind, entry.ints[0]) = (1, i64::from(*b)),
            MetaValue::Int(i) => (entry.kind, entry.ints[0]) = (2, *i),
            MetaValue::Float(f) => (entry.kind, entry.floats[0]) = (3, *f),
            MetaValue::Text(t) => {
                (entry.kind, entry.text, entry.text_length) = (4, t.as_ptr().cast(), t.len());
            }
            MetaValue::Ints(v) => {
                (entry.kind, entry.count) = (5, v.len() as i32);
                entry.ints.iter_mut().zip(v).for_each(|(to, from)| *to = *from);
            }
            MetaValue::Floats(v) => {
                (entry.kind, entry.count) = (6, v.len() as i32);
                entry.floats.iter_mut().zip(v).for_each(|(to, from)| *to = *from);
            }
        }
        // SAFETY: handle and entry are alive, and the shim copies the strings.
        ffi::call(|s| unsafe { ffi::meta_set(self.as_ptr(), &entry, s) })
            .map_err(|e| e.part(format!("metadata '{name}'")))
    }
}

/// The `length` bytes at `start`, or none if it is null.
///
/// # Safety
/// `start` must be null, or valid for `length` bytes while the result is used.
unsafe fn slice<'a>(start: *const c_char, length: usize) -> &'a [u8] {
    if start.is_null() {
        return &[];
    }
    // SAFETY: `start` is not null, and the caller upholds the contract.
    unsafe { std::slice::from_raw_parts(start.cast(), length) }
}

impl Drop for Meta {
    /// Releases the reference to the map; the grid behind a view lives on.
    fn drop(&mut self) {
        // SAFETY: owned, and freed once.
        unsafe { ffi::meta_free(self.as_ptr()) }
    }
}
