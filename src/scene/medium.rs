//! What the density does to light: extinction, and the radiance of the source.
//!
//! `σ = extinction · d` per world unit of length; the emitted radiance per length is `σ c`. Transfer
//! functions will stand beside these two sources.

use crate::error::{Error, Result};

/// Source radiance `c` as a function of the density `d`, per colour channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Source {
    /// `c` is the same everywhere (absorption alone is `c = 0`): the picture depends on the optical
    /// depth alone, `L = c (1 - T) + T · background`.
    Grey([f32; 3]),
    /// `c = colour · d`: denser is brighter.
    Linear([f32; 3]),
}

/// A participating medium without scattering.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Medium {
    /// Extinction per unit of density and world length.
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
            return Err(Error::invalid(format!("extinction {} must be positive and finite", self.extinction)));
        }
        let (Source::Grey(c) | Source::Linear(c)) = self.source;
        if c.iter().any(|v| !(v.is_finite() && *v >= 0.0)) {
            return Err(Error::invalid(format!("source radiance {c:?} must be finite and not negative")));
        }
        Ok(self)
    }

    /// True if light is emitted at all.
    pub fn emits(&self) -> bool {
        let (Source::Grey(c) | Source::Linear(c)) = self.source;
        c != [0.0; 3]
    }
}
