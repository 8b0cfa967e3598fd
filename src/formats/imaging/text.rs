//! Text headers: lines from the beginning of a file, and numbers in them.

use crate::error::{Error, Result};
use crate::formats::input;
use crate::text::printable;
use glam::DVec3;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Largest header.
const LONGEST: u64 = 1 << 20;

/// Reads lines from the beginning of a file until `last` says that a line is the last one, and returns them, without
/// their ends, with the number of bytes up to the end of the last one. The file may end before.
///
/// # Errors
/// If the file cannot be read, or the lines have more than a mebibyte.
pub(crate) fn lines(path: &Path, mut last: impl FnMut(&str) -> bool) -> Result<(Vec<String>, u64)> {
    let mut reader = BufReader::new(input::open(path)?).take(LONGEST);
    let (mut lines, mut length) = (Vec::new(), 0);
    loop {
        let mut line = Vec::new();
        length += reader.read_until(b'\n', &mut line).map_err(|e| Error::io(path, e))? as u64;
        if line.is_empty() {
            if length >= LONGEST {
                return Err(Error::invalid(format!("a header of more than {LONGEST} bytes"))
                    .hint("the file is damaged: copy it, or write it, again"));
            }
            return Ok((lines, length));
        }
        let text = String::from_utf8_lossy(&line);
        let text = text.trim_end_matches(['\n', '\r']).to_owned();
        let ends = last(&text);
        lines.push(text);
        if ends {
            return Ok((lines, length));
        }
    }
}

/// Beginning of a text of a file, as an error or a note shows it.
pub(crate) fn excerpt(text: &str) -> String {
    let start: String = text.chars().take(60).collect();
    let more = if start.len() < text.len() { "…" } else { "" };
    format!("{}{more}", printable(&start))
}

/// Error that a field of a header cannot be understood.
pub(crate) fn wrong(field: &str, text: &str) -> Error {
    Error::invalid(format!("the field '{}' is '{}', which cannot be understood", excerpt(field), excerpt(text)))
        .hint("correct the file's header, or write the file again where it was made")
}

/// Numbers between blanks or commas.
///
/// # Errors
/// If a word is no finite number.
pub(crate) fn numbers(field: &str, text: &str) -> Result<Vec<f64>> {
    let words = text.split(|c: char| c.is_whitespace() || c == ',').filter(|w| !w.is_empty());
    words.map(|w| w.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| wrong(field, text))).collect()
}

/// Whole numbers from 0 on, between blanks.
///
/// # Errors
/// If a word is none.
pub(crate) fn counts(field: &str, text: &str) -> Result<Vec<usize>> {
    text.split_whitespace().map(|w| w.parse().map_err(|_| wrong(field, text))).collect()
}

/// Vector of three numbers.
///
/// # Errors
/// If there are not three finite numbers.
pub(crate) fn vector(field: &str, text: &str) -> Result<DVec3> {
    match numbers(field, text)?[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err(wrong(field, text)),
    }
}
