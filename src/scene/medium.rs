//! Optical properties of a density field: extinction and source radiance.
//!
//! The extinction is `σ = extinction · d` per world unit of length, or `extinction · τ(d)` with a transfer function;
//! the emitted radiance per length is `σ c`.

use crate::error::{Error, Result};
use crate::scene::table::Table;
use std::sync::Arc;

/// Source radiance `c` as a function of the density `d`, per color channel.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// Constant radiance: `c` is independent of the density, and absorption alone is `c = 0`. The picture depends only
    /// on the optical depth: `L = c (1 - T) + T · background`.
    Grey([f32; 3]),
    /// Radiance proportional to the density, `c = color · d`.
    Linear([f32; 3]),
    /// Color and extinction as a piecewise linear function of the density. The density is zero where the field has no
    /// voxels; outside its domain the medium is empty.
    Transfer(Arc<Table>),
}

/// A participating medium without scattering.
#[derive(Debug, Clone, PartialEq)]
pub struct Medium {
    /// Extinction per world length and unit of density, or per unit of the transfer function's extinction.
    pub extinction: f64,
    /// Radiance of the source.
    pub source: Source,
}

impl Medium {
    /// A medium that absorbs and does not emit.
    pub fn absorbing(extinction: f64) -> Self {
        Self { extinction, source: Source::Grey([0.0; 3]) }
    }

    /// Returns the medium if its numbers can be used.
    ///
    /// # Errors
    /// If the extinction is not positive and finite, or a source radiance is negative or not finite. Tables were
    /// checked when they were made.
    pub fn checked(self) -> Result<Self> {
        if !(self.extinction > 0.0 && self.extinction.is_finite()) {
            return Err(Error::invalid(format!("extinction {} must be positive and finite", self.extinction))
                .hint("correct --density-scale, or the capture's density_scale"));
        }
        if let Source::Grey(c) | Source::Linear(c) = &self.source
            && c.iter().any(|v| !(v.is_finite() && *v >= 0.0))
        {
            return Err(Error::invalid(format!("source radiance {c:?} must be finite and not negative"))
                .hint("correct --emission, or the capture's emission"));
        }
        Ok(self)
    }

    /// True if the source radiance is not zero everywhere.
    pub fn emits(&self) -> bool {
        match &self.source {
            Source::Grey(c) | Source::Linear(c) => *c != [0.0; 3],
            Source::Transfer(table) => table.peak()[..3] != [0.0; 3],
        }
    }
}
