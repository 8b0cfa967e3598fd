//! What settings are measured against.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Reference of a study: a result that is converged far beyond those of the settings, and how far it may be off itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Reference {
    /// Options that made it.
    pub options: String,
    /// How the uncertainty was found.
    pub method: String,
    /// Uncertainty as a root mean square, in units of the reference's root mean square. Errors below it are not
    /// reported as numbers. 0 where it is not known.
    pub uncertainty: f64,
    /// True if the uncertainty is that of noise, which is independent of the noise of the settings.
    pub random: bool,
    /// Seconds that it took.
    pub seconds: f64,
}

impl Reference {
    /// Uncertainty in words.
    pub(super) fn uncertain_by(&self) -> String {
        if self.uncertainty > 0.0 { format!("{:.1e}", self.uncertainty) } else { "an unknown amount".into() }
    }
}

impl fmt::Display for Reference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; uncertain by {}: {}", self.options, self.uncertain_by(), self.method)
    }
}
