//! A setting that is compared with others.

use super::run::Run;
use crate::cancel::Cancel;
use crate::error::Result;

/// Does the work by a setting for the n-th time, and returns how long it took and how far the result is off; `None` if
/// it was stopped.
pub(super) type Work<'w> = dyn Fn(u32, &Cancel) -> Result<Option<Run>> + 'w;

/// A setting that is compared with others.
pub(super) struct Candidate<'w> {
    /// Options of the setting, by which its runs are known.
    pub options: String,
    /// Group of settings that it is one of: a series of the plot.
    pub group: String,
    /// Command that does the work with this setting.
    pub command: String,
    /// True if each run has random numbers of its own.
    pub random: bool,
    /// The work.
    pub run: Box<Work<'w>>,
}
