//! The choice of the differentiation mode: forward for few parameters, reverse for many. How the backward pass gets at
//! its samples follows from the loss.
//!
//! Measured in units of the backward pass, one thread, 256² pixels of the plume (`cumulo gradient`): where the
//! source varies, forward takes 1.0 for one parameter and 1.4 for four under a local loss; 0.7 for one, 1.0 for
//! four and 2.1 for ten under a global one, as it need not walk again. Where light depends on the optical depth
//! alone, a ray has one derivative for all its voxels, and forward takes 1 (the step) to 4.

use crate::differentiate::loss::Reach;
use crate::render::differentiable::Adjoint;
use serde::{Deserialize, Serialize};

/// Differentiation mode that is requested.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// Choice by the number of parameters and the loss.
    Auto,
    /// Backward: all parameters at once.
    Reverse,
    /// Forward: dual numbers, a few parameters at a time.
    Forward,
}

/// The mode that is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AdMode {
    /// Backward.
    Reverse(Adjoint),
    /// Forward.
    Forward,
}

/// The mode that was chosen, and why.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Choice {
    /// The mode.
    pub mode: AdMode,
    /// Why, for people.
    pub reason: String,
}

/// Number and kind of the derivatives that are requested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Task {
    /// Number of parameters.
    pub parameters: usize,
    /// Pixels that the loss's derivatives depend on.
    pub reach: Reach,
    /// True if light depends on the optical depth alone.
    pub depth_alone: bool,
}

impl Task {
    /// The most parameters for which forward is no slower.
    fn few(&self) -> usize {
        match (self.depth_alone, self.reach) {
            (true, _) => 0,
            (false, Reach::Local) => 1,
            (false, Reach::Global) => 6,
        }
    }
}

impl Choice {
    /// Chooses; an adjoint that is requested by name is taken.
    pub fn new(task: Task, mode: Mode, adjoint: Option<Adjoint>) -> Self {
        let (count, few) = (task.parameters, task.few());
        let parameters = if count == 1 { "1 parameter".to_owned() } else { format!("{count} parameters") };
        let forward = mode == Mode::Auto && adjoint.is_none() && count <= few;
        if forward || mode == Mode::Forward {
            let reason = if forward {
                format!("{parameters}, at most {few}: one walk carries all derivatives forward")
            } else {
                format!("forward as asked, {parameters} at up to 7 a walk")
            };
            return Self { mode: AdMode::Forward, reason };
        }
        let backward = match (mode, adjoint, few) {
            (Mode::Auto, None, 0) => {
                format!("{parameters}; light depends on the optical depth alone, for which backward is the cheaper way")
            }
            (Mode::Auto, None, _) => format!("{parameters}, more than {few}: one backward pass finds all derivatives"),
            _ => "backward as asked".to_owned(),
        };
        let (chosen, samples) = match (adjoint, task.reach) {
            (Some(requested), _) => (requested, "samples as asked"),
            (None, Reach::Local) => {
                (Adjoint::Tape, "the loss is a mean over pixels: each ray is seen and gone back on its tape")
            }
            (None, Reach::Global) => {
                (Adjoint::Replay, "the loss needs whole pictures: rays are walked again (replay) once these are known")
            }
        };
        Self { mode: AdMode::Reverse(chosen), reason: format!("{backward}; {samples}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_go_forward_and_many_back() {
        let plan = |parameters, reach, depth_alone, mode, adjoint| {
            Choice::new(Task { parameters, reach, depth_alone }, mode, adjoint)
        };
        for (parameters, reach, depth_alone, expected) in [
            (1, Reach::Local, false, AdMode::Forward),
            (2, Reach::Local, false, AdMode::Reverse(Adjoint::Tape)),
            (6, Reach::Global, false, AdMode::Forward),
            (7, Reach::Global, false, AdMode::Reverse(Adjoint::Replay)),
            (1, Reach::Local, true, AdMode::Reverse(Adjoint::Tape)),
            (1, Reach::Global, true, AdMode::Reverse(Adjoint::Replay)),
        ] {
            assert_eq!(plan(parameters, reach, depth_alone, Mode::Auto, None).mode, expected, "{parameters} {reach:?}");
            // Who names a mode or an adjoint gets it.
            assert_eq!(plan(parameters, reach, depth_alone, Mode::Forward, None).mode, AdMode::Forward);
            let mode = plan(parameters, reach, depth_alone, Mode::Auto, Some(Adjoint::Inversion)).mode;
            assert_eq!(mode, AdMode::Reverse(Adjoint::Inversion));
        }
        assert!(plan(26, Reach::Global, false, Mode::Auto, None).reason.contains("26 parameters, more than 6"));
        assert!(plan(26, Reach::Local, true, Mode::Auto, None).reason.contains("optical depth alone"));
    }
}
