//! Progress of a use case, as events that its face shows.

use crate::app::checks::Warning;
use crate::error::Code;
use serde::Serialize;

/// Receiver of what happens while a use case runs, from any thread.
pub trait Progress: Send + Sync {
    /// Takes note of an event. The work waits until it returns.
    fn event(&self, event: &Event<'_>);
}

/// Progress that nobody watches.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unwatched;

impl Progress for Unwatched {
    fn event(&self, _: &Event<'_>) {}
}

/// Unit of a stage's steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Unit {
    /// Pieces of work, each done at once: frames, iterations, files.
    Steps,
    /// Pictures, whose pixels count as parts of one: a picture may take hours.
    Pictures,
}

/// An event while a use case runs.
#[derive(Debug, Clone, Copy, Serialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum Event<'e> {
    /// A stage of the work begins.
    Began {
        /// Number of the stage; stages may overlap.
        stage: u64,
        /// Name of the stage, such as "render".
        name: &'e str,
        /// Number of its steps; none where it is not known.
        total: Option<u64>,
        /// Unit of the steps.
        unit: Unit,
    },
    /// A stage goes on.
    Advanced {
        /// Number of the stage.
        stage: u64,
        /// Steps that are done.
        done: f64,
        /// Number of its steps; none where it is not known.
        total: Option<u64>,
        /// State of the work in words; empty if there is nothing to say.
        message: &'e str,
    },
    /// A stage is over.
    Ended {
        /// Number of the stage.
        stage: u64,
        /// Name of the stage.
        name: &'e str,
        /// Wall time that it took in seconds.
        seconds: f64,
    },
    /// A remark on the result. Each is made once.
    Remark {
        /// The remark.
        text: &'e str,
    },
    /// A detail of how the work is done, for those who want to know.
    Detail {
        /// The detail.
        text: &'e str,
    },
    /// A warning about the result, which the report holds, too.
    Warned {
        /// The warning.
        #[serde(flatten)]
        warning: &'e Warning,
    },
    /// A frame of a sequence failed, and the others go on.
    Failed {
        /// Number of the frame.
        frame: u32,
        /// Code of the error, for programs.
        code: Code,
        /// Error with its remedy.
        error: &'e str,
    },
    /// One of several files could not be read, and the others go on.
    Unread {
        /// Code of the error, for programs.
        code: Code,
        /// Error with its file and remedy.
        error: &'e str,
    },
    /// From here on the work asks whether it is to stop, and ends in order if it is.
    Stoppable,
    /// Inputs of a long task are read, which does not ask whether it is to stop; a face may end the process, as nothing
    /// is written yet.
    Loading,
    /// From here on work that is stopped writes what it has.
    Working,
}
