//! Quadrature rules for the integrals along a ray.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// A quadrature rule; steps are in voxels (of the shortest edge).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum Quadrature {
    /// Cell by cell between voxel centres, where the trilinear field along a ray is a cubic:
    /// two-point Gauss-Legendre has no error for the optical depth.
    Exact,
    /// Pre-integration: a transfer function's cumulative tables between nodes whose distance follows the curvature of
    /// the density, however many knots lie between; errors are of second order in the distance. The number is the
    /// allowed error of the density between nodes, in units of the range of the function's knots. Equal to exact
    /// quadrature without a transfer function, and for tangents.
    Preintegrated(f64),
    /// Samples in the middle of steps of constant length; order 2.
    Midpoint(f64),
    /// Samples at the beginning of steps of constant length, the last step cut at the exit; order 1
    /// (Weiss & Westermann 2021, algorithm 1).
    Riemann(f64),
}

impl Quadrature {
    /// Pre-integration with the default tolerance: half a step of an 8-bit lookup table.
    pub const PREINTEGRATED: Self = Self::Preintegrated(2e-3);

    /// Returns the default rule: pre-integration through a transfer function, else exact quadrature.
    pub fn usual(through_function: bool) -> Self {
        if through_function { Self::PREINTEGRATED } else { Self::Exact }
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
        let expected = "expected exact, preintegrated, preintegrated:TOLERANCE with TOLERANCE in units of the \
                        function's range, midpoint:STEP or riemann:STEP with STEP in voxels, such as midpoint:0.5";
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip_and_nonsense_is_refused() {
        for q in ["exact", "preintegrated", "preintegrated:0.01", "midpoint:0.5", "riemann:0.2"] {
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
