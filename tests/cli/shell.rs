//! Manners of the command line: completions, manual pages, help, JSON documents and errors, remarks and timings.

use crate::common::work::{self, Work, errors};
use cumulo::error::Code;
use serde_json::{Value, json};
use std::process::Stdio;

#[test]
fn shells_get_their_scripts_and_manual_pages_are_written() {
    let work = Work::new();
    for (shell, word) in [
        ("bash", "complete -F"),
        ("zsh", "#compdef cumulo"),
        ("fish", "complete -c cumulo"),
        ("elvish", "edit:"),
        ("powershell", "Register-"),
    ] {
        let script = work.text(&format!("completions {shell}"));
        assert!(script.contains(word) && script.contains("reconstruct") && script.contains("density-scale"), "{shell}");
    }
    work.refused("completions csh", Code::Usage, &["csh"]);
    assert!(work.text("man").contains(".TH CUMULO 1"));
    let page = work.text("man reconstruct density");
    assert!(page.contains(".TH CUMULO-RECONSTRUCT-DENSITY 1") && page.contains("held\\-out"), "{page}");
    work.refused("man nonsense", Code::Invalid, &["no command 'nonsense'"]);
    let report = work.json("man -o pages");
    let pages: Vec<&str> = report["pages"].as_array().unwrap().iter().map(|p| p.as_str().unwrap()).collect();
    assert!(["cumulo.1", "cumulo-render.1", "cumulo-usd-lint.1"].iter().all(|p| pages.contains(p)), "{pages:?}");
    assert!(!pages.iter().any(|p| p.contains("try-grid")), "{pages:?}");
    assert!(pages.iter().all(|page| work.path(&format!("pages/{page}")).exists()));
}

#[test]
fn help_has_headings_and_examples() {
    let work = Work::new();
    let help = work.text("render --help");
    for text in ["Cameras and pictures:", "Medium and light:", "Accuracy and cost:", "General:", "Examples:"] {
        assert!(help.lines().any(|line| line == text), "'{text}' is not in {help}");
    }
    assert!(help.contains("  cumulo render smoke.vdb --views 16"), "{help}");
    // The words of `diff` about its figures are still there.
    assert!(work.text("diff --help").contains("PSNR is taken over the union"));
}

/// Documents of commands whose reports have little in common.
#[test]
fn every_document_names_its_version_and_command() {
    let work = Work::new();
    work.json("render @plume.vdb --views 3 --size 12x12 --density-scale auto -o cap");
    for (words, command) in [
        ("info @plume.vdb cap", "info"),
        ("validate @plume.vdb", "validate"),
        ("convert @plume.vdb a.vdb", "convert"),
        ("diff @plume.vdb a.vdb", "diff"),
        ("compare cap/view_000.exr cap/view_000.exr", "compare"),
        ("render a.vdb --views 2 --size 8x8 -o b", "render"),
        ("plan @plume.vdb --albedo 0.9 --sky 0.1", "plan"),
        ("reconstruct density cap -o c.vdb --resolution 8 --iterations 1", "reconstruct density"),
        ("gradient @plume.vdb --views 1 --size 8x8 --loss mean --wrt extinction", "gradient"),
        ("usd author @plume.vdb -o s.usda", "usd author"),
        ("usd lint s.usda", "usd lint"),
        ("man -o pages", "man"),
    ] {
        let report = work.json(words);
        assert_eq!((&report["version"], &report["command"]), (&json!(1), &json!(command)), "{words}");
        let text = work.command(words).arg("--json").output().unwrap().stdout;
        // Nothing of the report is hidden by the keys of all documents.
        let text = String::from_utf8(text).unwrap();
        let keys = |name: &str| text.matches(&format!("\n  \"{name}\":")).count();
        assert_eq!((keys("version"), keys("command")), (1, 1), "{text}");
        assert!(text.starts_with("{\n  \"version\": 1,\n  \"command\": "), "{text}");
    }
}

#[test]
fn errors_are_documents_too() {
    let work = Work::new();
    std::fs::write(work.path("bad.vdb"), "nothing of the kind").unwrap();
    let failed = |words: &str| -> Value {
        let out = work.command(words).arg("--json").output().unwrap();
        assert_eq!(out.status.code(), Some(2), "{words}");
        // People still read it on standard error.
        assert!(errors(&out).contains("cumulo: ") || errors(&out).contains("error: "), "{}", errors(&out));
        serde_json::from_slice(&out.stdout).unwrap_or_else(|e| panic!("{words}: {e}"))
    };
    let none = failed("info none.vdb");
    assert_eq!((&none["version"], &none["command"]), (&json!(1), &json!("info")));
    let error = &none["error"];
    assert!(error["what"].as_str().unwrap().contains("No such file") && error["file"] == "none.vdb", "{none}");
    assert!(error["do"].as_str().unwrap().contains("spelling"), "{none}");
    assert_eq!(failed("render @plume.vdb --views 1 --grid none -o no")["command"], "render");
    assert!(failed("diff @plume.vdb bad.vdb")["error"]["file"].as_str().unwrap().ends_with("bad.vdb"));
    let usage = failed("info");
    assert_eq!(failed("reconstruct density")["command"], "reconstruct density");
    let what = usage["error"]["what"].as_str().unwrap();
    assert!(what.contains("required") && what.contains("<FILE>"), "{usage}");
    assert_eq!(failed("--threads 4 info --nonsense")["command"], "info");
    assert!(!errors(&work.command("--json").output().unwrap()).contains("try-grid"));
    assert!(failed("info a.vdb --nonsense")["error"]["what"].as_str().unwrap().contains("--nonsense"));
    let threads = work.command("info @cube.vdb --json").env("RAYON_NUM_THREADS", "abc").output().unwrap();
    assert!(String::from_utf8_lossy(&threads.stdout).contains("\"error\"") && threads.status.code() == Some(2));
    // Without --json standard output stays empty.
    assert!(work.command("info none.vdb").output().unwrap().stdout.is_empty());
}

/// Codes stay, whatever the words of an error become.
#[test]
fn errors_have_codes() {
    let work = Work::new();
    std::fs::write(work.path("bad.vdb"), "nothing of the kind").unwrap();
    work.text("render @plume.vdb --views 1 --size 16x16 -o a.exr");
    work.text("render @plume.vdb --views 1 --size 16x16 -o shots");
    work.text("convert @plume.vdb own.vdb");
    for (words, code) in [
        ("info", "usage"),
        ("info none.vdb", "not-found"),
        ("info a.exr/none.vdb", "not-found"),
        ("render bad.vdb --views 1 -o b.exr", "unknown-format"),
        ("render @plume.vdb --views 1 --grid none -o b.exr", "no-such-grid"),
        ("compare a.exr a.exr --layer none", "no-such-layer"),
        ("render @plume.vdb --views 1 --size 8x8 -o a.exr", "output-exists"),
        ("render @plume.vdb --views 1 --size 8x8 -o shots", "output-exists"),
        ("convert own.vdb own.vdb --half", "output-is-input"),
        ("reconstruct density shots -o found.exr", "output-name"),
        ("render @plume.vdb --views 1 --size 60000x60000 --max-memory 200M -o b.exr", "memory-limit"),
        ("render @plume.vdb --views 1 --albedo 0.5 --model absorption -o b.exr", "usage"),
        ("pose shots --volume @plume.vdb -o @plume.vdb", "output-name"),
    ] {
        let out = work.command(words).arg("--json").output().unwrap();
        let document: Value = serde_json::from_slice(&out.stdout).unwrap_or_else(|e| panic!("{words}: {e}"));
        let error = &document["error"];
        assert_eq!((out.status.code(), &error["code"]), (Some(2), &json!(code)), "{words}: {document}");
        // People read the same as programs.
        let said = errors(&work.command(words).output().unwrap());
        let facts = ["file", "part", "what", "do"].iter().filter_map(|key| error[key].as_str());
        assert!(code == "usage" || facts.clone().all(|fact| said.contains(fact)), "{words}: {document}\n{said}");
    }
    let failed = work.command("info bad.vdb @plume.vdb --json").output().unwrap();
    let report: Value = serde_json::from_slice(&failed.stdout).unwrap();
    assert_eq!(report["files"][0]["error"]["code"], "unknown-format", "{report}");
}

/// A disk that is full is no success, whatever is printed.
#[cfg(target_os = "linux")]
#[test]
fn help_that_cannot_be_printed_is_an_error() {
    let work = Work::new();
    for words in ["--help", "--version", "man", "schema scene", "info @cube.vdb"] {
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let out = work.command(words).stdout(full).stderr(Stdio::piped()).spawn().unwrap().wait_with_output().unwrap();
        assert_eq!(out.status.code(), Some(2), "{words}");
        assert!(errors(&out).contains("standard output") && errors(&out).contains("space"), "{}", errors(&out));
    }
}

/// Commands that have nothing to keep end at once, and say so.
#[test]
fn an_interrupt_is_a_document_too() {
    let work = Work::new();
    work.json("convert @plume.vdb large.vdb --resample 0.004");
    let child = work.begun("diff large.vdb @plume.vdb --voxels all --json --threads 1");
    let out = work::interrupt(child);
    assert_eq!(out.status.code(), Some(130), "{}", errors(&out));
    let document: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((&document["command"], &document["error"]["what"]), (&json!("diff"), &json!("stopped by the user")));
}

#[test]
fn timings_and_plans_are_said_if_asked_for() {
    let work = Work::new();
    let words = "render @plume.vdb --views 1 --size 8x8 --albedo 0.9 --sky 0.1 --samples 1 -o lit --overwrite";
    let said = |more: &str| errors(&work.command(&format!("{words} {more}")).output().unwrap());
    let loud = said("-v --threads 2");
    for text in ["2 threads", "plan: path tracing; on: ", "render: 0."] {
        assert!(loud.contains(text), "'{text}' is not in {loud}");
    }
    assert!(said("").lines().all(|line| line.starts_with("up axis Z")) && said("--quiet").is_empty());
    work.refused(&format!("{words} -v -q"), Code::Usage, &["--verbose", "--quiet"]);
}

/// Each of four frames has a remark; it is made once.
#[test]
fn a_remark_is_made_once() {
    let work = Work::new();
    for n in 1..=4 {
        std::fs::copy(work::fixture("plume.vdb"), work.path(&format!("s.{n:04}.vdb"))).unwrap();
    }
    let out = work.command("convert s.####.vdb t.####.vdb --crop 900,900,900,901,901,901").output().unwrap();
    assert_eq!(out.status.code(), Some(0), "{}", errors(&out));
    assert_eq!(errors(&out).matches("no active voxel lies").count(), 1, "{}", errors(&out));
}

/// Work on unlike volumes shows in a log, and its figures say of how many voxels they are.
#[test]
fn unlike_volumes_are_sampled_and_say_so() {
    let work = Work::new();
    work.json("convert @plume.vdb coarse.vdb --resample 0.09");
    let difference = |more: &str| {
        let out =
            work.command(&format!("diff @plume.vdb coarse.vdb --json {more}")).stderr(Stdio::piped()).output().unwrap();
        assert_eq!(out.status.code(), Some(1), "{}", errors(&out));
        serde_json::from_slice::<Value>(&out.stdout).unwrap()["grids"][0].clone()
    };
    let (whole, part) = (difference("--voxels all"), difference("--voxels 20000"));
    let number = |of: &Value, key: &str| of[key].as_f64().unwrap();
    assert_eq!((&whole["sampled"], &whole["compared"]), (&json!(false), &whole["voxels"]));
    assert_eq!(part["sampled"], true);
    assert!(number(&part, "compared") < 0.8 * number(&part, "voxels"), "{part}");
    assert!(number(&part, "max_abs") <= number(&whole, "max_abs"));
    // Blocks are alike within a factor: about forty of a few hundred give the mean square within a third or so.
    let ratio = number(&part, "rms") / number(&whole, "rms");
    assert!((0.6..1.6).contains(&ratio), "{ratio}");
    work.refused("diff @plume.vdb coarse.vdb --voxels none", Code::Usage, &["--voxels"]);
}

/// Stages that begin end, and what counts steps reaches their number. The error that ends a command is an event, too.
#[test]
fn events_are_lines_of_json() {
    let work = Work::new();
    let events = |words: &str| -> Vec<Value> {
        let out = work.command(&format!("{words} --progress json")).output().unwrap();
        let read = |line: &str| serde_json::from_str(line).unwrap_or_else(|e| panic!("{words}: {e}: {line}"));
        errors(&out).lines().map(read).collect()
    };
    let all = events("render @plume.vdb --views 7 --size 24x24 --albedo 0.9 --samples 4 -o shots");
    let of = |kind: &str| -> Vec<&Value> { all.iter().filter(|event| event["event"] == kind).collect() };
    let [began] = of("began")[..] else { panic!("{all:?}") };
    assert_eq!((&began["name"], &began["total"], of("ended").len()), (&json!("render"), &json!(7), 1));
    let done: Vec<f64> = of("advanced").iter().map(|event| event["done"].as_f64().unwrap()).collect();
    assert!(done.is_sorted() && done.len() > 7 && done.last() == Some(&7.0), "{done:?}");
    assert!(of("remark").iter().any(|remark| remark["text"].as_str().unwrap().starts_with("up axis")), "{all:?}");
    let failed = events("render missing.vdb --views 1 -o shots");
    let last = failed.last().unwrap();
    assert_eq!((&last["event"], &last["file"]), (&json!("error"), &json!("missing.vdb")));
    work.refused("render @plume.vdb --views 1 -o shots --quiet --progress json", Code::Usage, &["--quiet"]);
}
