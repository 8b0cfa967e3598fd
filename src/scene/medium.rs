//! What the density does to light: extinction, and the radiance of the source.
//!
//! `σ = extinction · d` per world unit of length, or `extinction · τ(d)` with a transfer function; the
//! emitted radiance per length is `σ c`.

use crate::error::{Error, Result};
use crate::scene::table::Table;
use std::sync::Arc;

/// Source radiance `c` as a function of the density `d`, per color channel.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// `c` is the same everywhere (absorption alone is `c = 0`): the picture depends on the optical
    /// depth alone, `L = c (1 - T) + T · background`.
    Grey([f32; 3]),
    /// `c = color · d`: denser is brighter.
    Linear([f32; 3]),
    /// Color and extinction are a piecewise linear function of the density. Where the field has no
    /// voxels the density is zero; beyond its domain there is nothing.
    Transfer(Arc<Table>),
}

/// A participating medium without scattering.
#[derive(Debug, Clone, PartialEq)]
pub struct Medium {
    /// Extinction per unit of density (of the transfer function's extinction, if there is one) and world
    /// length.
    pub extinction: f64,
    /// Radiance of the source.
    pub source: Source,
}

impl Medium {
    /// A medium that only absorbs.
    pub fn absorbing(extinction: f64) -> Self {
        Self { extinction, source: Source::Grey([0.0; 3]) }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// If the extinction is not positive and finite, or a source radiance is negative or not finite.
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

    /// True if light is emitted at all.
    pub fn emits(&self) -> bool {
        match &self.source {
            Source::Grey(c) | Source::Linear(c) => *c != [0.0; 3],
            Source::Transfer(table) => table.peak()[..3] != [0.0; 3],
        }
    }
}
