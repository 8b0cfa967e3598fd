//! What the program asks of a command, whichever it is.

use super::cancel;
use super::memory::Memory;
use super::output::Output;
use crate::app::{Report, Status, UseCase};
use crate::error::Result;
use crate::formats::limits::Limits;

/// A command that was read.
pub(super) trait Run {
    /// Returns the memory in bytes that the whole process may take.
    ///
    /// # Errors
    /// If it is less than the process needs for work of any size.
    fn max_memory(&self) -> Result<u64> {
        Ok(Limits::default().max_memory)
    }

    /// Lets the work have so many bytes beside its memory.
    fn widen(&mut self, _room: u64) {}

    /// Does the work and reports; returns the exit code.
    ///
    /// # Errors
    /// Those of the work.
    fn run(&self, output: &Output) -> Result<u8>;
}

impl<U: UseCase> Run for U {
    fn max_memory(&self) -> Result<u64> {
        let memory = Memory::of(self.limits());
        memory.check()?;
        Ok(memory.limits().max_memory)
    }

    fn widen(&mut self, room: u64) {
        let most = &mut self.limits_mut().max_memory;
        *most = most.saturating_add(room);
    }

    fn run(&self, output: &Output) -> Result<u8> {
        told(&UseCase::run(self, output)?, output)
    }
}

/// Prints a report, and returns the exit code of work that ended so.
///
/// # Errors
/// If standard output cannot be written, or the report is of work of which parts failed without a word.
pub(super) fn told(report: &impl Report, output: &Output) -> Result<u8> {
    output.report(report)?;
    Ok(match report.status()? {
        Status::Success => 0,
        Status::Found => 1,
        Status::Incomplete => 2,
        Status::Stopped => cancel::code(),
    })
}
