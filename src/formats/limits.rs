//! Limits of the memory that reading a file may take.

use crate::error::{Code, Error};

/// Limits of the memory that reading a file may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct Limits {
    /// Largest number of bytes that the content read from a file may take in memory.
    pub max_memory: u64,
}

impl Default for Limits {
    /// Half of the machine's memory, or 4 GiB where its size is unknown.
    fn default() -> Self {
        let half = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| {
            let line = text.lines().find_map(|l| l.strip_prefix("MemTotal:"))?;
            line.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib * 512)
        });
        Self { max_memory: half.unwrap_or(4 << 30) }
    }
}

impl Limits {
    /// The error that a tree needs more than `needed` bytes, found after `leaves` leaves.
    pub(in crate::formats) fn exceeded(&self, needed: u64, leaves: u64) -> Error {
        Error::unsupported(format!(
            "the tree needs more than {needed} bytes ({leaves} leaves so far), {} are allowed",
            self.max_memory
        ))
        .coded(Code::MemoryLimit)
        .hint("raise ⟨max_memory⟩ if the file is to be trusted, or crop or resample it where it was made")
    }
}
