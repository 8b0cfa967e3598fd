//! One run of a setting.

use super::errors::Errors;
use serde::{Deserialize, Serialize};

/// One run of a setting.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Run {
    /// Seconds that it took.
    pub seconds: f64,
    /// Errors of its result.
    #[serde(flatten)]
    pub errors: Errors,
}
