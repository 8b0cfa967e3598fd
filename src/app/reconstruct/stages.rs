//! The wall time of a reconstruction, stage by stage.

use crate::inverse::progress::Stage;
use std::time::Instant;

/// A clock that measures stages one after the other: each begins where the one before it ended.
#[derive(Debug)]
pub(super) struct StageClock {
    begun: Instant,
    stages: Vec<Stage>,
}

impl StageClock {
    /// Starts the clock of the first stage.
    pub(crate) fn start() -> Self {
        Self { begun: Instant::now(), stages: Vec::new() }
    }

    /// Ends a stage under the given name, and begins the next one.
    pub(crate) fn end(&mut self, name: &str) {
        self.stages.push(Stage { name: name.into(), seconds: self.begun.elapsed().as_secs_f64() });
        self.begun = Instant::now();
    }

    /// Adds the stages that a solver has measured itself, and begins the next one.
    pub(crate) fn append(&mut self, solver_stages: Vec<Stage>) {
        self.stages.extend(solver_stages);
        self.begun = Instant::now();
    }

    /// Returns all stages in the order of the work.
    pub(crate) fn into_stages(self) -> Vec<Stage> {
        self.stages
    }
}
