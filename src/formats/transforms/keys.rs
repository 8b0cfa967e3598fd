//! Typed access to the keys of a capture; faults name the key.

use crate::error::{Error, Result};
use crate::scene::color_space::ColorSpace;
use crate::scene::transfer::Transfer;
use glam::DMat4;
use serde_json::{Map, Value, json};

/// Advice on where to take a transfer function from.
const TRANSFER: &str =
    "copy the value of 'transfer' from a .tf.json that `cumulo transfer` reads, or leave the key out";

/// Keys of a frame, which take precedence over those of the whole file.
pub(super) struct Keys<'a> {
    pub(super) own: &'a Map<String, Value>,
    pub(super) shared: Option<&'a Map<String, Value>>,
}

impl Keys<'_> {
    /// Value of a key; `null` counts as absent.
    pub(super) fn get(&self, key: &str) -> Option<&Value> {
        let set = |v: &&Value| !v.is_null();
        self.own.get(key).filter(set).or_else(|| self.shared?.get(key).filter(set))
    }

    pub(super) fn number(&self, key: &str) -> Result<Option<f64>> {
        match self.get(key) {
            None => Ok(None),
            Some(v) => v.as_f64().filter(|n| n.is_finite()).map(Some).ok_or_else(|| {
                Error::invalid(format!("'{key}' is {}; a number is expected", short(v)))
                    .hint(format!("write '{key}' as a finite number without quotes, or leave it out"))
            }),
        }
    }

    /// A picture's size in pixels, which may be written as 800.0.
    pub(super) fn size(&self, key: &str) -> Result<Option<u32>> {
        match self.number(key)? {
            None => Ok(None),
            Some(v) if (1.0..=65_536.0).contains(&v) && v.fract() == 0.0 => Ok(Some(v as u32)),
            Some(v) => Err(Error::invalid(format!("'{key}' is {v}; a whole number from 1 to 65536 is expected"))
                .hint("give the picture's size in pixels, or leave it out: the picture's header is asked then")),
        }
    }

    pub(super) fn color(&self, key: &str, unless_given: &str) -> Result<Option<[f32; 3]>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let numbers: Option<Vec<f32>> = value.as_array().and_then(|list| {
            list.iter().map(|v| v.as_f64().map(|n| n as f32).filter(|n| n.is_finite() && *n >= 0.0)).collect()
        });
        numbers.and_then(|n| <[f32; 3]>::try_from(n).ok()).map(Some).ok_or_else(|| {
            Error::invalid(format!("'{key}' is {}; three numbers from 0 on are expected", short(value)))
                .hint(format!("write scene-linear red, green and blue, or leave it out: it is {unless_given} then"))
        })
    }

    pub(super) fn matrix(&self, key: &str) -> Result<Option<DMat4>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let rows: Option<Vec<[f64; 4]>> = value.as_array().and_then(|rows| {
            rows.iter()
                .map(|row| {
                    let numbers: Option<Vec<f64>> = row.as_array()?.iter().map(Value::as_f64).collect();
                    <[f64; 4]>::try_from(numbers?).ok()
                })
                .collect()
        });
        let rows = rows.filter(|r| r.len() == 4 || r.len() == 3);
        let Some(rows) = rows else {
            return Err(Error::invalid(format!("'{key}' is {}; four rows of four numbers are expected", short(value)))
                .hint("write an affine map row by row; its last row is 0, 0, 0, 1"));
        };
        let last = rows.get(3).copied().unwrap_or([0.0, 0.0, 0.0, 1.0]);
        Ok(Some(DMat4::from_cols_array_2d(&[rows[0], rows[1], rows[2], last]).transpose()))
    }

    pub(super) fn transfer(&self) -> Result<Option<Transfer>> {
        let Some(value) = self.get("transfer") else { return Ok(None) };
        let transfer: Transfer = serde_json::from_value(value.clone())
            .map_err(|e| Error::invalid(format!("'transfer' is no transfer function: {e}")).hint(TRANSFER))?;
        transfer.checked().map(Some).map_err(|e| e.part("'transfer'").hint(TRANSFER))
    }

    /// Color space of integer pictures.
    pub(super) fn color_space(&self) -> Result<Option<ColorSpace>> {
        let Some(value) = self.get("color_space") else { return Ok(None) };
        let text = value.as_str().ok_or_else(|| "a text is expected".to_owned());
        text.and_then(str::parse).map(Some).map_err(|expected: String| {
            Error::invalid(format!("'color_space' is {}; {expected}", short(value)))
                .hint("name the transfer curve with which the integer pictures were written; EXRs are scene-linear")
        })
    }

    /// True if a key is there and `true`.
    pub(super) fn is_set(&self, key: &str) -> Result<bool> {
        match self.get(key) {
            None => Ok(false),
            Some(Value::Bool(set)) => Ok(*set),
            Some(other) => Err(Error::invalid(format!("'{key}' is {}; true or false is expected", short(other)))
                .hint(format!("correct '{key}', or leave it out"))),
        }
    }

    pub(super) fn named<T: serde::de::DeserializeOwned>(&self, key: &str, names: &[&str]) -> Result<Option<T>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        serde_json::from_value(value.clone()).map(Some).map_err(|_| {
            Error::invalid(format!("'{key}' is {}; {} is expected", short(value), names.join(" or ")))
                .hint(format!("correct '{key}', or leave it out: it is {} then", names[0]))
        })
    }
}

/// Returns a matrix as it is written: row by row.
pub(super) fn rows(m: DMat4) -> Value {
    let rows = [0, 1, 2, 3].map(|i| m.row(i).to_array());
    json!(rows)
}

/// Text of a value, shortened for an error message.
pub(super) fn short(value: &Value) -> String {
    let text = value.to_string();
    if text.chars().count() <= 60 { text } else { text.chars().take(57).chain("...".chars()).collect() }
}

/// The error that a required key is not there.
pub(super) fn missing(key: &str, what: &str) -> Error {
    Error::invalid(format!("no key '{key}'")).hint(format!("'{key}' is {what}"))
}
