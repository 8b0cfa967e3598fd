//! Quadrature rules: how the integrals along a ray are cut into segments and sampled.
//!
//! [`Quadrature`] is the choice that a user makes, `Rule`s and `DepthRule`s are the kernels behind it.
//! Pre-integration has a walk of its own, in [`dvr`](crate::render::dvr).

pub(crate) mod cells;
mod exact;
mod uniform;

pub(crate) use exact::{ExactDepth, ExactSource};
pub(crate) use uniform::Uniform;

use crate::error::{Error, Result};
use crate::real::Real;
use crate::render::cell::Quartet;
use crate::render::curve::Curve;
use crate::render::march::Span;
use crate::scene::medium::Source;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The names of all rules, for help and errors; a macro, for `concat!`.
#[macro_export]
#[doc(hidden)]
macro_rules! quadrature_rules {
    () => {
        "exact, preintegrated, preintegrated:TOLERANCE (largest error of a pixel, in units of the brightest color), \
         midpoint:STEP or riemann:STEP (in voxels; without a bound of the error)"
    };
}
pub use quadrature_rules as rules;

/// The most knots of a transfer function through which exact quadrature is the default.
const FEW_KNOTS: usize = 32;

/// A quadrature rule; steps are in voxels (of the shortest edge).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(into = "String", try_from = "String")]
pub enum Quadrature {
    /// Cell by cell between voxel centres, where the trilinear field along a ray is a cubic: two-point Gauss-Legendre
    /// has no error for the optical depth. A source that varies takes four points in segments short enough for
    /// [`Dvr::tolerance`](crate::render::dvr::Dvr::tolerance).
    Exact,
    /// Pre-integration (Engel, Kraus & Ertl 2001): between two nodes the density is taken as linear, and cumulative
    /// tables of the transfer function give the light however many knots lie between. Nodes are spaced so that each
    /// pixel errs by at most the tolerance given, in units of the brightest color of function and background (alpha:
    /// absolute). Equal to exact quadrature without a transfer function.
    Preintegrated(f64),
    /// Samples in the middle of steps of constant length; order 2.
    Midpoint(f64),
    /// Samples at the beginning of steps of constant length, the last step cut at the exit; order 1
    /// (Weiss & Westermann 2021, algorithm 1).
    Riemann(f64),
}

impl Quadrature {
    /// Pre-integration with the default tolerance.
    pub const PREINTEGRATED: Self = Self::Preintegrated(1e-2);

    /// Pre-integration for descents, which average over many pixels; errors are mostly below a hundredth of the bound.
    pub(crate) const COARSE: Self = Self::Preintegrated(1e-1);

    /// Returns the default rule of a source: pre-integration through a transfer function of many knots, else exact
    /// quadrature, which costs little more then. Knots on a line between others do not count.
    pub fn usual(source: &Source) -> Self {
        match source {
            Source::Transfer(table) if table.simplified(0.0).knots().len() > FEW_KNOTS => Self::PREINTEGRATED,
            _ => Self::Exact,
        }
    }

    /// Returns the step in voxels, of rules that have one.
    pub fn step(self) -> Option<f64> {
        match self {
            Self::Exact | Self::Preintegrated(_) => None,
            Self::Midpoint(step) | Self::Riemann(step) => Some(step),
        }
    }

    /// Returns the rule with its step, in voxels, replaced by a function of it; the rule itself if it has no step.
    #[must_use]
    pub(crate) fn map_step(self, change: impl FnOnce(f64) -> f64) -> Self {
        match self {
            Self::Exact | Self::Preintegrated(_) => self,
            Self::Midpoint(step) => Self::Midpoint(change(step)),
            Self::Riemann(step) => Self::Riemann(change(step)),
        }
    }

    /// True for pre-integration with any tolerance.
    pub fn is_preintegrated(self) -> bool {
        matches!(self, Self::Preintegrated(_))
    }
}

impl From<Quadrature> for String {
    fn from(q: Quadrature) -> Self {
        q.to_string()
    }
}

impl TryFrom<String> for Quadrature {
    type Error = Error;

    fn try_from(text: String) -> Result<Self> {
        text.parse()
    }
}

impl FromStr for Quadrature {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let expected = concat!("expected ", rules!(), ", such as midpoint:0.5");
        let (name, number) = text.split_once(':').unwrap_or((text, ""));
        let number = |what: &str, [least, most]: [f64; 2]| match number.parse::<f64>() {
            Ok(v) if (least..=most).contains(&v) => Ok(v),
            _ => Err(Error::invalid(format!("quadrature '{text}': {what} must lie in {least}..{most}; {expected}"))),
        };
        // Below a thousandth of a voxel nothing is gained but waiting.
        let step = || number("step", [1e-3, 1e3]);
        match name {
            "exact" if !text.contains(':') => Ok(Self::Exact),
            "preintegrated" if !text.contains(':') => Ok(Self::PREINTEGRATED),
            "preintegrated" => Ok(Self::Preintegrated(number("tolerance", [1e-6, 1.0])?)),
            "midpoint" => Ok(Self::Midpoint(step()?)),
            "riemann" => Ok(Self::Riemann(step()?)),
            _ => Err(Error::invalid(format!("quadrature '{text}' is unknown; {expected}"))),
        }
    }
}

impl fmt::Display for Quadrature {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exact => f.write_str("exact"),
            whole if *whole == Self::PREINTEGRATED => f.write_str("preintegrated"),
            Self::Preintegrated(tolerance) => write!(f, "preintegrated:{tolerance}"),
            Self::Midpoint(s) => write!(f, "midpoint:{s}"),
            Self::Riemann(s) => write!(f, "riemann:{s}"),
        }
    }
}

/// Cuts spans into segments; `C` is the number of channels of the source, 1 or 3.
pub(crate) trait Rule<R: Real, const C: usize>: Copy + Sync {
    /// Type of the segments.
    type Segment: Copy;
    /// Appends the segments of at most [`BATCH`](crate::render::march::BATCH) spans, near to far, with the densities in
    /// them.
    fn segments(&self, curve: &Curve<R, C>, values: &[R], spans: &[Span<R>], segments: &mut Vec<Self::Segment>);
    /// True if the result does not depend on where the interior is cut: derivatives with respect to entry and exit are
    /// then the integrand there. Else, for samples that move with the ends, [`Rule::vjp`] returns them.
    const BOUNDED: bool;
    /// Returns the derivatives with respect to entry, exit and step (world lengths), from those with respect to a
    /// segment's length and position.
    fn vjp(&self, segment: &Self::Segment, by_length: f64, by_position: f64) -> [f64; 3];
    /// Returns the change of a segment's length and position for changes of entry, exit and step: the transpose of
    /// [`Rule::vjp`].
    fn jvp(&self, segment: &Self::Segment, by: [f64; 3]) -> [f64; 2];
}

/// Cuts spans into cells with weights, for optical depths alone.
pub(crate) trait DepthRule<R: Real>: Copy + Sync {
    /// Appends the cells of at most [`BATCH`](crate::render::march::BATCH) spans of one ray.
    fn cells(&self, spans: &[Span<R>], cells: &mut Vec<Quartet<R>>);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip_and_nonsense_is_refused() {
        for q in ["exact", "preintegrated", "preintegrated:0.02", "midpoint:0.5", "riemann:0.2"] {
            assert_eq!(q.parse::<Quadrature>().unwrap().to_string(), q);
        }
        for q in [
            "exact:1",
            "preintegrated:2",
            "preintegrated:",
            "midpoint",
            "midpoint:0",
            "riemann:-1",
            "riemann:nan",
            "euler:1",
            "",
        ] {
            assert!(q.parse::<Quadrature>().unwrap_err().to_string().contains("midpoint:0.5"), "{q}");
        }
    }
}
