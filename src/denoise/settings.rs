//! Constants of weighted recursive least squares as published.

use crate::error::{Error, Result};

/// Constants of weighted recursive least squares.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Share of the history in the feature, α: 0 to below 1.
    pub history: f32,
    /// Bandwidth h of the distance between color and feature, above which colors count as outliers: smaller is
    /// steadier, and further off. Infinite to take every color as it is.
    pub bandwidth: f32,
    /// Share λ of what was learned that is kept from frame to frame: above 0 to below 1.
    pub forgetting: f32,
    /// Standard deviation in pixels of the weights of the models around a pixel.
    pub spread: f32,
    /// Bandwidth of the distance between the features of pixels whose models predict each other's colors.
    pub likeness: f32,
}

impl Default for Settings {
    /// The paper's constants; it gives neither spread nor likeness.
    fn default() -> Self {
        Self { history: 0.75, bandwidth: 0.75, forgetting: 0.998, spread: 1.5, likeness: 0.75 }
    }
}

impl Settings {
    /// Returns the settings if they can be used.
    ///
    /// # Errors
    /// If a constant is out of its range.
    pub fn checked(self) -> Result<Self> {
        let Self { history, bandwidth, forgetting, spread, likeness, .. } = self;
        let named = [
            ("history", history, (0.0..1.0).contains(&history)),
            ("bandwidth", bandwidth, bandwidth > 0.0),
            ("forgetting factor", forgetting, forgetting > 0.0 && forgetting < 1.0),
            ("spread", spread, spread > 0.0 && spread.is_finite()),
            ("likeness", likeness, likeness > 0.0),
        ];
        match named.iter().find(|(.., fits)| !fits) {
            Some((name, value, _)) => Err(Error::invalid(format!("a {name} of {value} cannot be used"))
                .hint("the history lies in [0, 1), the forgetting factor between 0 and 1, the others above 0")),
            None => Ok(self),
        }
    }
}
