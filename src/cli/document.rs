//! JSON documents of `--json`: every one names the version of its layout and the command that wrote it.

use crate::error::{Error, Facts};
use crate::text::printable_json;
use schemars::generate::SchemaSettings;
use schemars::transform::{Transform, transform_subschemas};
use schemars::{JsonSchema, Schema};
use serde::Serialize;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Version of the layout of all documents. Keys are only added within a version; it rises when one is renamed, removed
/// or changes its meaning.
pub(crate) const VERSION: u32 = 1;

/// Command whose documents are asked for; not set without `--json`.
static COMMAND: OnceLock<String> = OnceLock::new();

/// True once the document is written: standard output holds one. (An error that follows a report says again what it
/// says of frames that failed, and a signal may come while an error is written.)
static REPORTED: AtomicBool = AtomicBool::new(false);

/// Has errors written as JSON on standard output from now on, as those of a command such as `reconstruct density`.
pub(crate) fn begin(command: &str) {
    let _ = COMMAND.set(command.to_owned());
}

/// Keeps errors from being written behind the report that is written now, since standard output holds one document.
pub(crate) fn reported() {
    REPORTED.store(true, Ordering::SeqCst);
}

/// A command's report with the keys that all of them share.
#[derive(Debug, Serialize)]
pub(crate) struct Document<'d, T> {
    /// [`VERSION`].
    pub version: u32,
    /// Words of the command, such as `reconstruct density`.
    pub command: &'d str,
    /// Report of the command, whose keys stand beside the ones above.
    #[serde(flatten)]
    pub report: &'d T,
}

/// Report of a command that failed.
#[derive(Debug, Serialize, JsonSchema)]
struct Failure<'d> {
    /// Error that ended the command.
    error: Facts<'d>,
}

/// Document of a command.
#[derive(JsonSchema)]
#[allow(dead_code, reason = "it describes documents, and none is made of it")]
struct Described<T> {
    /// Version of the layout of all documents: keys are only added within a version.
    version: u32,
    /// Words of the command, such as `reconstruct density`.
    command: String,
    #[serde(flatten)]
    report: T,
}

/// Report of a command, or that of its failure.
#[derive(JsonSchema)]
#[serde(untagged)]
#[allow(dead_code, reason = "it describes documents, and none is made of it")]
enum Either<T> {
    Report(T),
    Failure(Failure<'static>),
}

/// Returns the JSON schema of the documents of a command with such a report, that of its failure included.
pub(crate) fn schema<T: JsonSchema>(title: &str) -> Schema {
    described::<Either<T>>(title)
}

/// Returns the JSON schema of the documents of commands that failed.
pub(crate) fn schema_of_failures(title: &str) -> Schema {
    described::<Failure<'static>>(title)
}

fn described<T: JsonSchema>(title: &str) -> Schema {
    // The contract of what is written: keys that a report may leave out are not required.
    let settings = SchemaSettings::default().for_serialize().with_transform(Nullable);
    let mut schema = settings.into_generator().into_root_schema_for::<Described<T>>();
    schema.insert("title".into(), title.into());
    schema.insert(
        "description".into(),
        "Document that the command writes on standard output. A number that is not finite is null.".into(),
    );
    schema
}

/// Lets floating-point numbers be null: JSON has neither NaN nor infinity, and they are written so.
#[derive(Debug, Clone, Copy)]
struct Nullable;

impl Transform for Nullable {
    fn transform(&mut self, schema: &mut Schema) {
        let format = schema.get("format").and_then(|format| format.as_str());
        if format.is_some_and(|format| ["float", "double"].contains(&format)) {
            schema.insert("type".into(), vec!["number", "null"].into());
        }
        transform_subschemas(self, schema);
    }
}

/// Writes the error that ended the program as JSON on standard output, if `--json` is given and no document is written
/// yet. The standard library's stream is avoided because another thread may hold its lock.
pub(crate) fn error(error: &Error) {
    // Its words take memory, and may be what fails: the error of that is written then.
    let report = Failure { error: error.facts() };
    let Some(command) = COMMAND.get().filter(|_| !REPORTED.swap(true, Ordering::SeqCst)) else { return };
    if let Ok(json) = serde_json::to_string_pretty(&Document { version: VERSION, command, report: &report }) {
        let text = format!("{}\n", printable_json(&json));
        let mut rest = text.as_bytes();
        while let Ok(written @ 1..) = rustix::io::write(rustix::stdio::stdout(), rest) {
            rest = &rest[written..];
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[derive(Serialize)]
    struct Report {
        single: f32,
        none: Option<u32>,
        raw: Box<serde_json::value::RawValue>,
    }

    /// Keys keep their order and numbers their precision: a report is not taken apart on its way.
    #[test]
    fn reports_are_embedded_as_they_are() {
        let raw = serde_json::value::RawValue::from_string("{\"b\":0.1,\"a\":1}".into()).unwrap();
        let report = Report { single: 0.1, none: None, raw };
        let text = serde_json::to_string(&Document { version: VERSION, command: "info", report: &report }).unwrap();
        assert_eq!(
            text,
            "{\"version\":1,\"command\":\"info\",\"single\":0.1,\"none\":null,\"raw\":{\"b\":0.1,\"a\":1}}"
        );
    }
}
