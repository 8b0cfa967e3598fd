//! Fields of a header, and vectors in them.

use crate::error::{Error, Result};
use crate::formats::imaging::text::{self, excerpt, wrong};
use glam::DVec3;
use std::collections::BTreeMap;

pub(crate) const AGAIN: &str = "correct the file's header, or write the file again where it was made";

/// Fields by their names in lower case.
pub(crate) struct Fields(BTreeMap<String, String>);

impl Fields {
    pub(crate) fn of(lines: &[String]) -> Result<Self> {
        let mut fields = BTreeMap::new();
        for line in lines.iter().skip(1).filter(|l| !l.is_empty() && !l.starts_with('#')) {
            // `key:=value` is the user's own, and says nothing of the format.
            match line.split_once(':') {
                Some((_, value)) if value.starts_with('=') => {}
                Some((name, value)) => {
                    fields.insert(name.trim().to_ascii_lowercase(), value.trim().to_owned());
                }
                None => {
                    return Err(
                        Error::invalid(format!("the header's line '{}' is no field", excerpt(line))).hint(AGAIN)
                    );
                }
            }
        }
        Ok(Self(fields))
    }

    /// Value of the first of several spellings.
    pub(crate) fn get(&self, names: &[&str]) -> Option<&str> {
        names.iter().find_map(|n| self.0.get(*n)).map(String::as_str)
    }

    pub(crate) fn need(&self, name: &str) -> Result<&str> {
        self.get(&[name]).ok_or_else(|| Error::invalid(format!("the header lacks the field '{name}'")).hint(AGAIN))
    }
}

/// Directions of the axes; none for an axis that is not in space.
pub(crate) fn directions(text: &str) -> Result<Vec<Option<DVec3>>> {
    let mut found = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            found.push(None);
            rest = after.trim_start();
        } else if let Some(after) = unknown(rest) {
            found.push(None);
            rest = after;
        } else {
            let (vector, after) = bracketed("space directions", rest)?;
            found.push(Some(vector));
            rest = after;
        }
    }
    Ok(found)
}

/// Returns the text behind a vector of `nan`, by which some writers say that an axis is not in space; none if there is
/// no such vector.
fn unknown(text: &str) -> Option<&str> {
    let (inner, after) = text.strip_prefix('(')?.split_once(')')?;
    let nan = inner.split(',').all(|word| word.trim().eq_ignore_ascii_case("nan"));
    nan.then(|| after.trim_start())
}

/// Vector in brackets at the beginning of a text, and what follows it. Two numbers are a vector in the plane.
pub(crate) fn bracketed<'t>(field: &str, text: &'t str) -> Result<(DVec3, &'t str)> {
    let inner = text.trim_start().strip_prefix('(').and_then(|t| t.split_once(')'));
    let (inner, after) = inner.ok_or_else(|| wrong(field, text))?;
    let vector = match text::numbers(field, inner)?[..] {
        [x, y, z] => DVec3::new(x, y, z),
        [x, y] => DVec3::new(x, y, 0.0),
        _ => return Err(wrong(field, text)),
    };
    Ok((vector, after.trim_start()))
}
