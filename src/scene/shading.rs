//! Surface shading of a density along straight rays, by a light at the camera.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Blinn-Phong shading (Blinn 1977) across the gradient of the density, by a light in the direction of the camera.
///
/// With c for the cosine between the gradient and the ray, on either side of it, a source of color C emits
/// `C (ambient + diffuse c) + specular c^exponent`. Where the gradient is 0 there is no surface, and the source emits
/// `C (ambient + diffuse)`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(default)]
pub struct Shading {
    /// Share of the color that every direction shows, 0 or more.
    pub ambient: f64,
    /// Share of the color that a surface shows which faces the camera, 0 or more.
    pub diffuse: f64,
    /// Radiance of the white highlight of a surface that faces the camera, 0 or more.
    pub specular: f64,
    /// Sharpness of the highlight, 1 to 1000.
    pub exponent: f64,
}

impl Default for Shading {
    /// A matt surface with a faint highlight.
    fn default() -> Self {
        Self { ambient: 0.2, diffuse: 0.8, specular: 0.15, exponent: 20.0 }
    }
}

impl Shading {
    /// Returns the shading if its numbers can be used.
    ///
    /// # Errors
    /// Names the first number that cannot.
    pub fn checked(self) -> Result<Self> {
        let Self { ambient, diffuse, specular, exponent } = self;
        for (name, value, most) in
            [("ambient", ambient, 100.0), ("diffuse", diffuse, 100.0), ("specular", specular, 100.0)]
        {
            if !(0.0..=most).contains(&value) {
                return Err(Error::invalid(format!("{name} share {value} of the shading must lie in 0 to {most}")));
            }
        }
        if !(1.0..=1000.0).contains(&exponent) {
            return Err(Error::invalid(format!("exponent {exponent} of the shading must lie in 1 to 1000")));
        }
        Ok(self)
    }

    /// Returns what the color is multiplied by, and the white radiance that is added, for a cosine of 0 to 1 between
    /// the gradient and the ray; `None` without a gradient.
    #[inline(always)]
    pub fn factors(&self, cosine: Option<f64>) -> [f64; 2] {
        match cosine {
            Some(cosine) => [self.ambient + self.diffuse * cosine, self.specular * cosine.powf(self.exponent)],
            None => [self.ambient + self.diffuse, 0.0],
        }
    }

    /// Returns the largest radiance of a source whose largest radiance is given.
    pub fn brightest(&self, source: f64) -> f64 {
        source * (self.ambient + self.diffuse) + self.specular
    }
}

impl FromStr for Shading {
    type Err = String;

    /// Reads `ambient,diffuse,specular,exponent`; numbers that are left out at the end are the default's.
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let mut found = Self::default();
        let Self { ambient, diffuse, specular, exponent } = &mut found;
        let fields = [ambient, diffuse, specular, exponent];
        let expected = "AMBIENT,DIFFUSE,SPECULAR,EXPONENT such as 0.2,0.8,0.15,20 is expected";
        let words: Vec<&str> = text.split(',').collect();
        if words.len() > fields.len() {
            return Err(format!("'{text}' has {} numbers: {expected}", words.len()));
        }
        for (field, word) in fields.into_iter().zip(words) {
            *field = word.trim().parse().map_err(|_| format!("'{word}' is no number: {expected}"))?;
        }
        found.checked().map_err(|e| e.to_string())
    }
}

impl fmt::Display for Shading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{},{},{},{}", self.ambient, self.diffuse, self.specular, self.exponent)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn texts_round_trip_and_nonsense_is_refused() {
        let all = Shading { ambient: 0.5, diffuse: 0.0, specular: 1.0, exponent: 3.0 };
        assert_eq!(all.to_string().parse(), Ok(all));
        assert_eq!("0.5".parse(), Ok(Shading { ambient: 0.5, ..Shading::default() }));
        for text in ["", "a", "-1", "0,0,nan", "0,0,0,0.5", "1,2,3,4,5", "inf"] {
            assert!(text.parse::<Shading>().is_err(), "{text}");
        }
    }

    #[test]
    fn surfaces_that_face_the_camera_are_brightest() {
        let shading = Shading::default();
        let [facing, highlight] = shading.factors(Some(1.0));
        assert_eq!((facing, highlight), (1.0, 0.15));
        assert!(shading.factors(Some(0.5))[0] < facing && shading.factors(Some(0.5))[1] < 1e-6);
        assert_eq!(shading.factors(None), [1.0, 0.0]);
        assert_eq!(shading.brightest(2.0), 2.15);
    }
}
