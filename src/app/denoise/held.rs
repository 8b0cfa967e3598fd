//! Files that were read for the backward direction, or a first time for the forward one, and are held for the next.

use crate::formats::exr::Document;
use crate::formats::limits::Limits;
use std::collections::BTreeMap;

/// Bytes that the process may take, of which files get what the denoising leaves.
const PROCESS_BYTES: u64 = 1280 << 20;
/// Bytes that the denoising takes for a pixel of a layer, results that are kept and files under way included.
const PIXEL_BYTES: u64 = 580;

/// Files by place in the sequence.
#[derive(Debug)]
pub(super) struct ReadAhead {
    budget: u64,
    bytes: u64,
    documents: BTreeMap<usize, Document>,
}

impl ReadAhead {
    /// Holds nothing of a sequence of so many pixels, of all layers together.
    pub(super) fn new(pixels: usize, limits: Limits) -> Self {
        let all = PROCESS_BYTES.min(limits.max_memory / 2);
        let budget = all.saturating_sub(PIXEL_BYTES * pixels as u64);
        Self { budget, bytes: 0, documents: BTreeMap::new() }
    }

    /// Holds a file. Of more than fit, the frames that are needed last are let go.
    pub(crate) fn insert(&mut self, frame: usize, document: Document) {
        self.bytes += document.bytes();
        self.documents.insert(frame, document);
        while self.bytes > self.budget
            && let Some((_, last)) = self.documents.pop_last()
        {
            self.bytes -= last.bytes();
        }
    }

    /// Returns the file of a frame, if it is held.
    pub(crate) fn take(&mut self, frame: usize) -> Option<Document> {
        let document = self.documents.remove(&frame)?;
        self.bytes -= document.bytes();
        Some(document)
    }
}
