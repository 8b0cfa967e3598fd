//! Progress of a reconstruction of voxels: its steps, reported one by one, and the time of its stages.

use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::time::Instant;

/// One iteration, for the progress display and the convergence plot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Step {
    /// Level, 0 the finest.
    pub level: u32,
    /// Iteration, all levels counted.
    pub iteration: u32,
    /// Seconds since the start.
    pub seconds: f64,
    /// Objective: the weighted RMS of the optical depths' residuals; for the recipe of Weiss & Westermann (2021), the
    /// mean absolute difference of the batch's pictures.
    pub loss: f64,
    /// PSNR of the held-out views' transmittance (peak 1), if there are any.
    pub held_out_psnr_db: Option<f64>,
}

/// A stage of the work and the wall time it took.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Stage {
    /// Name of the stage.
    pub name: String,
    /// Wall time in seconds.
    pub seconds: f64,
}

/// Steps of a reconstruction so far, which are reported one by one.
pub(crate) struct Progress<'w> {
    begun: Instant,
    /// Steps so far.
    pub history: Vec<Step>,
    /// Stages that are done.
    pub stages: Vec<Stage>,
    /// True once the work is to stop.
    pub stopped: bool,
    watch: &'w mut dyn FnMut(&Step) -> ControlFlow<()>,
}

impl<'w> Progress<'w> {
    /// Begins now; `watch` is called with every step and may stop the work.
    pub(crate) fn new(watch: &'w mut dyn FnMut(&Step) -> ControlFlow<()>) -> Self {
        Self { begun: Instant::now(), history: Vec::new(), stages: Vec::new(), stopped: false, watch }
    }

    /// Reports a step on a level, 0 the finest.
    pub(crate) fn step(&mut self, level: u32, loss: f64, held_out_psnr_db: Option<f64>) {
        let iteration = self.history.len() as u32 + 1;
        let step = Step { level, iteration, seconds: self.begun.elapsed().as_secs_f64(), loss, held_out_psnr_db };
        self.history.push(step);
        self.stopped |= (self.watch)(&step).is_break();
    }

    /// Reports a step of other work that keeps its own history.
    pub(crate) fn watch(&mut self, step: &Step) -> ControlFlow<()> {
        (self.watch)(step)
    }

    /// Notes the time of a stage.
    pub(crate) fn stage(&mut self, name: impl Into<String>, since: Instant) {
        self.stages.push(Stage { name: name.into(), seconds: since.elapsed().as_secs_f64() });
    }
}
