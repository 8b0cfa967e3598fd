//! Hard cases: inputs on which a textbook formula fails, each with the error that this crate makes on them.
//!
//! A [`Case`] runs the code that users run, on inputs that cancel, overflow, underflow or divide by zero, and compares
//! it with double precision or with a closed form. Beside it the naive formula is run on the same inputs, so that the
//! figure shows what the difference is worth. The cases are the tests of this crate's numerics and the self-test of the
//! program at once.

mod denoising;
mod dvr;
mod fixtures;
mod geometry;
mod path_tracing;
mod reconstruction;
mod transfer_function;

use crate::error::Result;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Part of the program that a case belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Area {
    /// Light along straight rays, and its derivatives.
    Dvr,
    /// Functions from density to color and extinction.
    TransferFunction,
    /// Estimates of light that is scattered.
    PathTracing,
    /// Noise that is taken out of sequences.
    Denoising,
    /// Volumes, functions and cameras that are found from pictures.
    Reconstruction,
    /// Rays, boxes, maps and the values of grids.
    Geometry,
}

impl Area {
    /// All areas, in the order of [`cases`].
    pub const ALL: [Self; 6] =
        [Self::Dvr, Self::TransferFunction, Self::PathTracing, Self::Denoising, Self::Reconstruction, Self::Geometry];

    /// Returns the area's name, as in `path-tracing`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dvr => "dvr",
            Self::TransferFunction => "transfer-function",
            Self::PathTracing => "path-tracing",
            Self::Denoising => "denoising",
            Self::Reconstruction => "reconstruction",
            Self::Geometry => "geometry",
        }
    }
}

impl fmt::Display for Area {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Which of two formulas a case is measured with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Formula {
    /// The formula of this crate.
    Cumulo,
    /// The formula of a textbook, written down in the most direct way.
    Naive,
}

/// Behaviour of the naive formula.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Naive {
    /// It errs by at least this much, which is more than the bound of the case.
    Fails(f64),
    /// It stays below the bound as well, for this reason.
    Holds(&'static str),
}

/// A hard case.
#[derive(Debug, Clone, Copy)]
pub struct Case {
    /// Name in words joined by dashes.
    pub name: &'static str,
    /// Part of the program that the case belongs to.
    pub area: Area,
    /// Input, and what goes wrong on it.
    pub hazard: &'static str,
    /// Formula that this crate uses.
    pub remedy: &'static str,
    /// Formula that it is compared with.
    pub naive_formula: &'static str,
    /// Meaning of the figure, and its unit.
    pub figure: &'static str,
    /// Largest figure with which the case passes: one and a half to five times what was measured on x86-64, so that
    /// other roundings of exponentials and logarithms pass; where nothing was measured, 0 or a few roundings.
    pub bound: f64,
    /// Behaviour of the naive formula.
    pub naive: Naive,
    measured: fn(Formula) -> Result<f64>,
}

impl Case {
    /// Returns the figure of a formula. It is infinite where a result is not a number or not finite, or where an input
    /// is refused that has a result.
    pub fn measure(&self, formula: Formula) -> f64 {
        match (self.measured)(formula) {
            Ok(error) if !error.is_nan() => error,
            _ => f64::INFINITY,
        }
    }

    /// True if a figure is at most the bound.
    pub fn passes(&self, error: f64) -> bool {
        error <= self.bound
    }
}

/// Returns all cases, area by area.
pub fn cases() -> impl Iterator<Item = &'static Case> {
    let all = [
        dvr::CASES,
        transfer_function::CASES,
        path_tracing::CASES,
        denoising::CASES,
        reconstruction::CASES,
        geometry::CASES,
    ];
    all.into_iter().flatten()
}

/// Returns the larger of two errors; infinite if one of them is not a number.
fn worse(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::INFINITY } else { a.max(b) }
}

/// Returns the difference of two numbers, relative to the second.
fn off(found: f64, expected: f64) -> f64 {
    worse(0.0, ((found - expected) / expected).abs())
}

/// Returns the largest difference over the largest magnitude of the second; infinite if anything is not finite.
fn relative(found: &[f64], expected: &[f64]) -> f64 {
    if found.iter().any(|v| !v.is_finite()) {
        return f64::INFINITY;
    }
    let scale = expected.iter().fold(f64::MIN_POSITIVE, |m, v| m.max(v.abs()));
    found.iter().zip(expected).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs())) / scale
}
