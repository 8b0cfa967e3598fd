//! Ranges of settings. A face may check them as it reads them; settings of a library's caller, or of a document, have
//! no face that does.

use crate::error::{Code, Error, Result};
use std::fmt::Debug;

/// Refuses a setting whose `value` is none of those that are `expected`.
///
/// # Errors
/// If it does not hold.
pub(crate) fn require(setting: &str, value: impl Debug, holds: bool, expected: &str) -> Result<()> {
    if holds {
        return Ok(());
    }
    let what = format!("⟨{setting}⟩ is {value:?}: {expected} is expected");
    Err(Error::invalid(what).coded(Code::Usage))
}

/// Refuses a number that is not finite and above 0.
///
/// # Errors
/// If it is given and is none.
pub(crate) fn positive(setting: &str, value: impl Into<Option<f64>>) -> Result<()> {
    let Some(value) = value.into() else { return Ok(()) };
    require(setting, value, value.is_finite() && value > 0.0, "a number above 0")
}

/// Refuses a probability that is not above 0 and below 1.
///
/// # Errors
/// If it is none.
pub(crate) fn probability(setting: &str, value: f64) -> Result<()> {
    require(setting, value, value > 0.0 && value < 1.0, "a probability above 0 and below 1")
}

/// Refuses a whole number that is not from `least` to `most`.
///
/// # Errors
/// If it is given and is none.
pub(crate) fn within(setting: &str, value: impl Into<Option<u32>>, [least, most]: [u32; 2]) -> Result<()> {
    let Some(value) = value.into() else { return Ok(()) };
    require(setting, value, (least..=most).contains(&value), &format!("a number from {least} to {most}"))
}

/// Refuses a picture's size without pixels, or with too many.
///
/// # Errors
/// If it is given and is none.
pub(crate) fn size(setting: &str, value: impl Into<Option<[u32; 2]>>) -> Result<()> {
    let Some(value) = value.into() else { return Ok(()) };
    let holds = value.iter().all(|n| (1..=65_536).contains(n));
    require(setting, value, holds, "a width and a height from 1 to 65536")
}

/// Refuses an angle of view that no camera has.
///
/// # Errors
/// If it is none.
pub(crate) fn fov(setting: &str, value: f64) -> Result<()> {
    require(setting, value, (1e-3..170.0).contains(&value), "an angle from 0.001 to below 170 degrees")
}

/// Refuses a radiance that is negative or not finite, or whose square is.
///
/// # Errors
/// If it is given and is none.
pub(crate) fn radiance(setting: &str, value: impl Into<Option<[f32; 3]>>) -> Result<()> {
    let Some(value) = value.into() else { return Ok(()) };
    let holds = value.iter().all(|v| (0.0..=1e15).contains(v));
    require(setting, value, holds, "three numbers from 0 to 1e15")
}

/// Refuses shares that are not from 0 to 1.
///
/// # Errors
/// If they are given and one is none.
pub(crate) fn shares(setting: &str, value: impl Into<Option<[f32; 3]>>) -> Result<()> {
    let Some(value) = value.into() else { return Ok(()) };
    require(setting, value, value.iter().all(|v| (0.0..=1.0).contains(v)), "three numbers from 0 to 1")
}
