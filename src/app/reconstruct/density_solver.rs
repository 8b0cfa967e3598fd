//! The solvers of densities, and what each of them costs.

use super::forecast::ExpectedSearch;
use super::region::Placed;
use super::sample::{Measured, Sample};
use super::volume::{Measurements, Pictures};
use crate::app::run::Solver;
use crate::error::{Error, Result};
use crate::inverse::cost::effort::{self, Rates};
use crate::inverse::cost::{Cost, Method, PictureSizes};
use crate::inverse::density::{Outcome, Request};
use crate::inverse::density::{multilevel, weiss2021};
use crate::inverse::observation::Observation;
use crate::inverse::progress::Step;
use crate::inverse::through_transfer;
use crate::scene::capture::Capture;
use crate::scene::medium::{Medium, Source};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// Iterations on the finest level from which on a volume suits its cameras, if they suit one another.
pub(super) const SETTLED: usize = 8;

/// How densities are to be found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Choice {
    /// Conjugate gradients where the pictures depend on the optical depth alone, colors first where there is a transfer
    /// function, else as in Weiss & Westermann (2021).
    #[default]
    Auto,
    /// Conjugate gradients in the smoothness prior's metric.
    Cg,
    /// Adam as in Weiss & Westermann (2021).
    Weiss2021,
}

/// Solver of densities, as [`Choice`] and the medium of the pictures choose it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DensitySolver {
    Cg,
    Weiss2021,
    ThroughTransfer,
}

impl DensitySolver {
    /// Returns the solver for pictures of a medium.
    ///
    /// # Errors
    /// If the choice does not suit the medium.
    pub(super) fn of(choice: Choice, medium: &Medium) -> Result<Self> {
        Ok(match (choice, &medium.source) {
            (Choice::Auto | Choice::Cg, Source::Grey(_)) => Self::Cg,
            (Choice::Cg, _) => {
                return Err(Error::unsupported("⟨solver=cg⟩ needs pictures that depend on the optical depth alone")
                    .hint("these show emission that follows the density: leave it out, or use ⟨solver=weiss2021⟩"));
            }
            (Choice::Auto, Source::Transfer(_)) => Self::ThroughTransfer,
            (Choice::Weiss2021, _) | (Choice::Auto, Source::Linear(_)) => Self::Weiss2021,
        })
    }

    /// Returns the largest number of iterations on the finest level, or of epochs, unless the settings say so.
    pub(super) fn usual_iterations(self, noisy: bool) -> u32 {
        match self {
            Self::Cg if noisy => 40,
            Self::Cg => 24,
            Self::Weiss2021 | Self::ThroughTransfer => 50,
        }
    }

    /// Returns the largest number of steps that a run reports, over all levels.
    pub(super) fn most_iterations(self, observation: &Observation, request: &Request, views: usize) -> u64 {
        let training = views - request.held_out.len();
        match self {
            Self::Cg => multilevel::most_iterations(observation, request),
            Self::Weiss2021 => weiss2021::most_iterations(request, training),
            Self::ThroughTransfer => through_transfer::most_iterations(observation, request, training),
        }
    }

    pub(super) fn reconstruct(
        self,
        measurements: &Measurements,
        request: &Request,
        watch: impl FnMut(&Step) -> ControlFlow<()>,
    ) -> Result<Outcome> {
        let Pictures { photos, observation, .. } = &measurements.pictures;
        match self {
            Self::Cg => multilevel::reconstruct(observation, request, watch),
            Self::Weiss2021 => weiss2021::reconstruct(photos, observation, request, watch),
            Self::ThroughTransfer => through_transfer::reconstruct(photos, observation, request, watch),
        }
    }

    /// Times the search with a few of the pictures; none for a search that has no model of its time but steps.
    ///
    /// # Errors
    /// If the pictures leave no unknown.
    pub(super) fn measured(
        self,
        sample: &Sample,
        capture: &Capture,
        placed: &Placed,
        request: &Request,
    ) -> Result<Option<Measured>> {
        let settled = request.iterations as usize >= SETTLED;
        (self == Self::Cg).then(|| sample.measure(capture, placed, request, settled)).transpose()
    }

    /// Returns the expected cost by a few of the pictures.
    pub(super) fn cost(
        self,
        observation: &Observation,
        placed: &Placed,
        request: &Request,
        capture: &Capture,
        measured: Option<&Measured>,
    ) -> Cost {
        let (sizes, survey) = (PictureSizes::of(capture), &placed.survey);
        let seconds = match self {
            Self::Cg => {
                ExpectedSearch::new(observation, survey, request, (sizes.count, sizes.pixels), measured).seconds()
            }
            _ => {
                let steps = self.most_iterations(observation, request, sizes.count);
                effort::of_steps(self.method(), survey, request, sizes.pixels, steps, &Rates::USUAL)
            }
        };
        Cost::new(self.method(), survey, sizes, seconds)
    }

    /// Returns the method that the solver's cost is estimated for.
    pub(super) fn method(self) -> Method {
        match self {
            Self::Cg => Method::Cg,
            Self::Weiss2021 => Method::Descent,
            Self::ThroughTransfer => Method::ThroughTransfer,
        }
    }
}

impl From<DensitySolver> for Solver {
    fn from(solver: DensitySolver) -> Self {
        match solver {
            DensitySolver::Cg => Self::Cg,
            DensitySolver::Weiss2021 => Self::Weiss2021,
            DensitySolver::ThroughTransfer => Self::ThroughTransfer,
        }
    }
}
