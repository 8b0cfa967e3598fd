//! `cumulo schema`: JSON schemas of the files that Cumulo reads, and of the documents that it writes.

use super::document;
use super::output::Output;
use super::run::Run;
use crate::error::{Error, Result};
use crate::formats::scene_file;
use clap::builder::{PossibleValue, PossibleValuesParser};
use schemars::Schema as JsonSchema;
use std::sync::LazyLock;

/// Print the JSON schema of a kind of file, or of what a command writes with --json
///
/// A document holds the report of the command or, if it failed, its error; `error` is the schema of such documents
/// alone.
#[derive(Debug, clap::Args)]
pub(crate) struct Schema {
    /// Kind of file, or command with dashes between its words
    #[arg(value_parser = PossibleValuesParser::new(KINDS.iter().map(Kind::value)))]
    kind: String,
}

/// Kind of documents.
struct Kind {
    name: String,
    about: String,
    schema: Box<dyn Fn() -> JsonSchema + Send + Sync>,
}

impl Kind {
    fn value(&'static self) -> PossibleValue {
        PossibleValue::new(self.name.as_str()).help(self.about.as_str())
    }
}

/// Scene files, failures, and the documents of each command by its words with dashes between them.
static KINDS: LazyLock<Vec<Kind>> = LazyLock::new(|| {
    let of = |name: &str, about: &str, schema: Box<dyn Fn() -> JsonSchema + Send + Sync>| Kind {
        name: name.replace(' ', "-"),
        about: about.into(),
        schema,
    };
    let failures = || document::schema_of_failures("cumulo --json, failed");
    let mut kinds = vec![
        of("scene", "Scene files of `cumulo render`", Box::new(scene_file::schema)),
        of("error", "Documents of commands that failed", Box::new(failures)),
    ];
    let mut rows: Vec<_> = super::documents().collect();
    rows.sort_unstable_by_key(|(words, _)| *words);
    kinds.extend(rows.into_iter().map(|(words, schema)| {
        let title = format!("cumulo {words} --json");
        of(words, &format!("Documents of `{title}`"), Box::new(move || schema(&title)))
    }));
    kinds
});

impl Run for Schema {
    fn run(&self, output: &Output) -> Result<u8> {
        let kind = KINDS.iter().find(|kind| kind.name == self.kind);
        // The words of a command line name one.
        let schema = kind.map_or_else(scene_file::schema, |kind| (kind.schema)());
        let text = serde_json::to_string_pretty(&schema).map_err(|e| Error::invalid(e.to_string()))?;
        output.plain(&text)?;
        Ok(0)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// Documents have schemas by the words of their commands, with dashes between them, in the order of the alphabet.
    #[test]
    fn kinds_are_found_by_their_names() {
        let names: Vec<&str> = KINDS.iter().map(|kind| kind.name.as_str()).collect();
        assert_eq!(names[..4], ["scene", "error", "capture-convert", "capture-new"]);
        assert!(names.is_sorted_by(|a, b| a < b || *a == "scene" || *a == "error"));
    }
}
