//! Assertions on errors: their code and the facts that they name, such as a file, a grid, a setting or a value, whatever
//! the words of the message are.

use cumulo::error::{Code, Error};
use serde_json::Value;
use std::process::{Command, Output};

/// Runs a command with `--json`, and asserts of what it tells as [`told`] does.
pub fn refused(command: &mut Command, code: Code, facts: &[&str]) {
    if !command.get_args().any(|word| word == "--json") {
        command.arg("--json");
    }
    let out = command.output().unwrap();
    told(&out, &format!("{command:?}"), code, facts);
}

/// Runs the program with these arguments, and asserts of what it tells as [`told`] does.
pub fn of(arguments: &[&str], code: Code, facts: &[&str]) {
    refused(Command::new(env!("CARGO_BIN_EXE_cumulo")).args(arguments), code, facts);
}

/// Asserts that a command with `--json` ended with exit code 2 and an error of this code that names these facts. Of a
/// sequence this is the error of the first frame that failed.
pub fn told(out: &Output, command: &str, code: Code, facts: &[&str]) {
    let place = format!("{command}\n{}{}", String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    assert_eq!(out.status.code(), Some(2), "{place}");
    let document: Value = serde_json::from_slice(&out.stdout).unwrap_or_else(|e| panic!("{e}: {place}"));
    let error = document.get("error").unwrap_or(&document["failed"][0]);
    assert_eq!(error["code"], code.to_string(), "{place}");
    let told = ["file", "part", "what", "do", "error"].map(|key| error[key].as_str().unwrap_or_default()).join("\n");
    names(&told, facts, &place);
}

/// Asserts that an error has this code and names these facts.
pub fn is(error: &Error, code: Code, facts: &[&str]) {
    let told = error.to_string();
    assert_eq!(error.code(), code, "{told}");
    names(&told, facts, &told);
}

fn names(told: &str, facts: &[&str], place: &str) {
    for fact in facts {
        assert!(told.contains(fact), "'{fact}' is not named: {place}");
    }
}
