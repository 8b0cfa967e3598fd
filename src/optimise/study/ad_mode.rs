//! Which way to a gradient: forward for few parameters, backward for many; how the backward pass gets at its
//! samples follows from the loss.
//!
//! Measured in units of the backward way, one thread, 256² pixels of the plume (`cumulo gradient`): where the
//! source varies, forward takes 1.0 for one parameter and 1.4 for four under a local loss; 0.7 for one, 1.0 for
//! four and 2.1 for ten under a global one, as it need not walk again. Where light depends on the optical depth
//! alone, a ray has one derivative for all its voxels, and forward takes 1 (the step) to 4.

use crate::optimise::loss::Reach;
use crate::render::differentiable::Adjoint;

/// What is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Mode {
    /// By the number of parameters and the loss
    Auto,
    /// Backward: all parameters at once
    Adjoint,
    /// Forward: dual numbers, a few parameters at a time
    Tangent,
}

/// What is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// Backward.
    Adjoint(Adjoint),
    /// Forward.
    Tangent,
}

/// The way to a gradient, and why.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
    /// The way.
    pub way: Way,
    /// Why, for people.
    pub reason: String,
}

/// What there is to differentiate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Task {
    /// How many parameters.
    pub parameters: usize,
    /// How far the loss sees.
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

impl Plan {
    /// Chooses; an adjoint that is asked for by name is taken.
    pub fn new(task: Task, mode: Mode, adjoint: Option<Adjoint>) -> Self {
        let (count, few) = (task.parameters, task.few());
        let parameters = if count == 1 { "1 parameter".to_owned() } else { format!("{count} parameters") };
        let forward = mode == Mode::Auto && adjoint.is_none() && count <= few;
        if forward || mode == Mode::Tangent {
            let reason = if forward {
                format!("{parameters}, at most {few}: one walk carries all derivatives forward")
            } else {
                format!("forward as asked, {parameters} at up to 7 a walk")
            };
            return Self { way: Way::Tangent, reason };
        }
        let backward = match (mode, adjoint, few) {
            (Mode::Auto, None, 0) => {
                format!("{parameters}; light depends on the optical depth alone, for which backward is the cheaper way")
            }
            (Mode::Auto, None, _) => format!("{parameters}, more than {few}: one backward pass finds all derivatives"),
            _ => "backward as asked".to_owned(),
        };
        let (chosen, samples) = match (adjoint, task.reach) {
            (Some(asked), _) => (asked, "samples as asked"),
            (None, Reach::Local) => {
                (Adjoint::Tape, "the loss is a mean over pixels: each ray is seen and gone back on its tape")
            }
            (None, Reach::Global) => {
                (Adjoint::Replay, "the loss needs whole pictures: rays are walked again (replay) once these are known")
            }
        };
        Self { way: Way::Adjoint(chosen), reason: format!("{backward}; {samples}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_go_forward_and_many_back() {
        let plan = |parameters, reach, depth_alone, mode, adjoint| {
            Plan::new(Task { parameters, reach, depth_alone }, mode, adjoint)
        };
        for (parameters, reach, depth_alone, expected) in [
            (1, Reach::Local, false, Way::Tangent),
            (2, Reach::Local, false, Way::Adjoint(Adjoint::Tape)),
            (6, Reach::Global, false, Way::Tangent),
            (7, Reach::Global, false, Way::Adjoint(Adjoint::Replay)),
            (1, Reach::Local, true, Way::Adjoint(Adjoint::Tape)),
            (1, Reach::Global, true, Way::Adjoint(Adjoint::Replay)),
        ] {
            assert_eq!(plan(parameters, reach, depth_alone, Mode::Auto, None).way, expected, "{parameters} {reach:?}");
            // Who names a mode or an adjoint gets it.
            assert_eq!(plan(parameters, reach, depth_alone, Mode::Tangent, None).way, Way::Tangent);
            let way = plan(parameters, reach, depth_alone, Mode::Auto, Some(Adjoint::Inversion)).way;
            assert_eq!(way, Way::Adjoint(Adjoint::Inversion));
        }
        assert!(plan(26, Reach::Global, false, Mode::Auto, None).reason.contains("26 parameters, more than 6"));
        assert!(plan(26, Reach::Local, true, Mode::Auto, None).reason.contains("optical depth alone"));
    }
}
