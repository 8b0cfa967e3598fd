//! Errors as exceptions.

use cumulo::error::{Code, Error};
use cumulo::wording::{Mention, speak_as};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

/// Advice on arguments that no command has.
const SEE_HELP: &str = "cumulo.help() lists the commands, and cumulo.help(\"render\") the arguments of one, as options";

/// Has settings named as arguments of Python's functions from now on.
pub(crate) fn speak() {
    speak_as(|Mention { use_case, setting, value }| {
        let value = value.map_or("...".to_owned(), |value| match value.parse::<f64>() {
            Ok(_) => value.to_owned(),
            Err(_) => format!("\"{value}\""),
        });
        Some(match use_case {
            Some(case) => format!("`cumulo.{case}({setting}={value})`"),
            None if value == "..." => format!("`{setting}`"),
            None => format!("`{setting}={value}`"),
        })
    });
}

/// Exception of an error, `cumulo.errors.CumuloError`.
pub(crate) fn exception(py: Python<'_>, error: &Error) -> PyErr {
    static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    if error.code() == Code::Cancelled {
        return PyKeyboardInterrupt::new_err(error.to_string());
    }
    let made = || {
        let class = CLASS.import(py, "cumulo.errors", "CumuloError")?;
        let facts = error.facts();
        let what = as_arguments(&facts.what);
        let remedy = facts.remedy.map(|remedy| as_arguments(&remedy));
        let remedy = remedy.or_else(|| (facts.code == Code::Usage).then(|| SEE_HELP.to_owned()));
        class.call1((facts.code.to_string(), what, facts.file, facts.part, remedy))
    };
    made().map_or_else(|error| error, PyErr::from_value)
}

/// Returns a text with the options of a command line, such as `--density-scale`, as arguments of Python's functions.
fn as_arguments(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once("--") {
        let length = after.find(|c: char| !(c.is_ascii_lowercase() || c == '-')).unwrap_or(after.len());
        let (name, behind) = after.split_at(length);
        out.push_str(before);
        // Dashes elsewhere, such as those of a text, stay.
        let option = name.starts_with(|c: char| c.is_ascii_lowercase()) && !before.ends_with(char::is_alphanumeric);
        out += &if option { name.replace('-', "_") } else { format!("--{name}") };
        rest = behind;
    }
    out + rest
}
