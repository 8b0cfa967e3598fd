//! Commands in the process of a caller answer what the program does.

use crate::common::work::{Work, cumulo as program};
use cumulo::app::Context;
use cumulo::app::progress::{Event, Progress};
use cumulo::cancel::Cancel;
use cumulo::cli::embedded;
use cumulo::prelude::Code;
use serde_json::Value;
use std::sync::{Arc, Mutex};

fn run(words: &[&str]) -> cumulo::Result<embedded::Answer> {
    embedded::run(words.iter().map(Into::into), Context::default())
}

#[test]
fn the_document_is_that_of_the_program() {
    let words = ["info", "fixtures/plume.vdb"];
    let answer = run(&words).unwrap();
    let said = program().args(words).arg("--json").current_dir(env!("CARGO_MANIFEST_DIR")).output().unwrap();
    assert_eq!(answer.code, 0);
    let document: Value = serde_json::from_str(&answer.document).unwrap();
    assert_eq!(document, serde_json::from_slice::<Value>(&said.stdout).unwrap());
    // Of a check that finds a difference.
    let differ = run(&["diff", "fixtures/plume.vdb", "fixtures/cube.vdb", "--grid", "density"]).unwrap();
    assert_eq!(differ.code, 1, "{}", differ.document);
}

#[test]
fn what_cannot_be_read_or_done_is_an_error_and_help_is_an_answer() {
    let usage = run(&["render", "a.vdb", "--densty-scale", "2"]).unwrap_err();
    assert_eq!(usage.code(), Code::Usage);
    assert!(usage.what().contains("'--densty-scale'"), "{usage}");
    let missing = run(&["info", "missing.vdb"]).unwrap_err();
    assert_eq!((missing.code(), missing.path()), (Code::NotFound, Some("missing.vdb".as_ref())));
    let help = run(&["render", "--help"]).unwrap();
    assert!(help.code == 0 && help.document.contains("--density-scale"), "{}", help.document);
}

struct Names(Arc<Mutex<Vec<String>>>);

impl Progress for Names {
    fn event(&self, event: &Event<'_>) {
        if let Event::Began { name, .. } = event {
            self.0.lock().unwrap().push((*name).to_owned());
        }
    }
}

#[test]
fn progress_is_told_and_work_is_stopped_from_outside() {
    let work = Work::new();
    let output = work.path("view.exr");
    let render = |cancel: &Cancel| {
        let names = Arc::<Mutex<Vec<String>>>::default();
        let context = Context::new(Names(Arc::clone(&names))).stopped_by(cancel.clone(), cancel.clone());
        let words = ["render", "fixtures/plume.vdb", "--views", "1", "--size", "32x32", "-o", output.to_str().unwrap()];
        let answer = embedded::run(words.iter().map(Into::into), context);
        (answer, Arc::into_inner(names).unwrap().into_inner().unwrap())
    };
    let cancel = Cancel::new();
    cancel.request();
    let (stopped, _) = render(&cancel);
    assert_eq!(stopped.unwrap_err().code(), Code::Cancelled);
    assert!(!output.exists());
    let (answer, names) = render(&Cancel::NEVER);
    assert_eq!(answer.unwrap().code, 0);
    assert!(output.exists() && names.iter().any(|name| name == "render"), "{names:?}");
}
