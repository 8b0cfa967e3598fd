//! How the integrals along a ray are formed from samples.

use crate::error::{Error, Result};
use std::fmt;
use std::str::FromStr;

/// A quadrature rule; steps are in voxels (of the shortest edge).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quadrature {
    /// Cell by cell between voxel centres, where the trilinear field along a ray is a cubic:
    /// two-point Gauss-Legendre has no error for the optical depth.
    Exact,
    /// Between points as far apart as the density's bends allow, through a transfer function's cumulative
    /// tables, however many knots lie between: errors are of second order in the distance. The same as exact
    /// without a transfer function, for derivatives with respect to where rays go, and for tangents.
    Preintegrated,
    /// Samples in the middle of steps of constant length; order 2.
    Midpoint(f64),
    /// Samples at the beginning of steps of constant length, the last step cut at the exit; order 1
    /// (Weiss & Westermann 2021, algorithm 1).
    Riemann(f64),
}

impl FromStr for Quadrature {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let expected =
            "expected exact, preintegrated, midpoint:STEP or riemann:STEP with STEP in voxels, such as midpoint:0.5";
        let (name, step) = text.split_once(':').unwrap_or((text, ""));
        let step = || match step.parse::<f64>() {
            // Below a thousandth of a voxel nothing is gained but waiting.
            Ok(s) if (1e-3..=1e3).contains(&s) => Ok(s),
            _ => Err(Error::invalid(format!("quadrature '{text}': step must lie in 0.001..1000; {expected}"))),
        };
        match name {
            "exact" if !text.contains(':') => Ok(Self::Exact),
            "preintegrated" if !text.contains(':') => Ok(Self::Preintegrated),
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
            Self::Preintegrated => f.write_str("preintegrated"),
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
        for q in ["exact", "preintegrated", "midpoint:0.5", "riemann:0.2"] {
            assert_eq!(q.parse::<Quadrature>().unwrap().to_string(), q);
        }
        for q in ["exact:1", "preintegrated:1", "midpoint", "midpoint:0", "riemann:-1", "riemann:nan", "euler:1", ""] {
            assert!(q.parse::<Quadrature>().unwrap_err().to_string().contains("midpoint:0.5"), "{q}");
        }
    }
}
