//! What all commands share: threads, paths that are not Unicode, and text from files on its way to the
//! terminal.

use crate::common::grids::fog;
use crate::common::work::{Work, errors, fixture};
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::formats::vdb::{Codec, write_grids};
use cumulo::scene::film::Film;
use cumulo::scene::grid::MetaValue;
use cumulo::text::acts;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::process::Output;

/// Escape sequences, a C1 control, a right-to-left override, and a line that looks like the program's own.
const HOSTILE: &str = "x\u{1b}[31m\u{1b}]0;title\u{7}\u{7f}\u{9b}2J\u{202e}\nforged: valid";

/// Asserts that nothing in either stream acts on a terminal, and that no line was forged.
fn harmless(out: &Output) {
    for stream in [&out.stdout, &out.stderr] {
        let text = String::from_utf8(stream.clone()).unwrap();
        assert!(!text.contains(|c| acts(c) && c != '\n'), "{text:?}");
        assert!(!text.lines().any(|line| line.starts_with("forged:")), "{text}");
    }
}

#[test]
fn program_and_package_state_one_version() {
    let version = env!("CARGO_PKG_VERSION");
    let work = Work::new();
    let text = work.text("-V");
    // A build of a checkout by `make` states its commit, too, and the commit's date.
    let rest = text.trim().strip_prefix(&format!("cumulo {version}")).unwrap();
    assert!(rest.is_empty() || rest.starts_with(" (commit "), "{text}");
    let long = work.text("--version");
    let facts: Vec<&str> =
        long.lines().skip(1).filter_map(|line| line.split_once(": ")).map(|(name, _)| name).collect();
    assert!(long.starts_with(&text) && text.lines().count() == 1, "{text}{long}");
    assert_eq!(facts, ["OpenVDB", "Instructions", "Target", "Compiler"], "{long}");
    // The package has the version of its native module, which is the workspace's, as the program's is.
    assert!(include_str!("../../python/cumulo/__init__.py").contains("__version__ = _native.__version__"));
    assert!(include_str!("../../src/python/Cargo.toml").contains("version.workspace = true"));
    assert!(include_str!("../../python/addon/blender_manifest.toml").contains(&format!("version = \"{version}\"")));
}

/// What no work can be done in was accepted, and failed somewhere.
#[test]
fn a_limit_of_memory_that_cannot_be_kept_to_is_refused_at_once() {
    let work = Work::new();
    for command in ["info @cube.vdb", "render missing.vdb --views 1 -o x", "compare a.exr b.exr", "view a.vdb -o a.png"]
    {
        let expected = ["--max-memory 10.0 MiB", "at least 112 MiB are needed", "--threads"];
        work.refused(&format!("{command} --max-memory 10M --threads 2"), Code::Invalid, &expected);
    }
    work.json("info @cube.vdb --max-memory 112M --threads 2");
}

#[test]
fn threads_are_counted_before_the_work() {
    let work = Work::new();
    work.refused("info @cube.vdb --threads 0", Code::Invalid, &["--threads 0", "1 to 1024", "leave it out"]);
    work.refused("info @cube.vdb --threads 100000", Code::Invalid, &["--threads 100000", "1 to 1024"]);
    for bad in ["abc", "0", "-3", "", "1e3", "99999999999999999999"] {
        let out = work.command("info @cube.vdb").env("RAYON_NUM_THREADS", bad).output().unwrap();
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(2), "'{bad}': {said}");
        assert!(said.contains("RAYON_NUM_THREADS") && said.contains("unset"), "{said}");
        // The option outdoes it.
        let out = work.command("info @cube.vdb --threads 1").env("RAYON_NUM_THREADS", bad).output().unwrap();
        assert!(out.status.success());
    }
    let out = work.command("info @cube.vdb").env("RAYON_NUM_THREADS", "2").output().unwrap();
    assert!(out.status.success());
}

#[cfg(unix)]
#[test]
fn paths_that_are_not_unicode_work_or_are_refused_before_the_work() {
    use std::os::unix::ffi::OsStrExt;
    let work = Work::new();
    let odd = work.path("x").with_file_name(std::ffi::OsStr::from_bytes(b"b\xffad"));
    std::fs::create_dir(&odd).unwrap();
    let (volume, other, cap) = (odd.join("v.vdb"), odd.join("o.vdb"), odd.join("cap"));
    std::fs::copy(fixture("cube.vdb"), &volume).unwrap();
    let json = |words: &str, paths: &[&std::path::Path]| -> Value {
        let out = work.command(words).args(paths).arg("--json").output().unwrap();
        assert!(out.status.success(), "{words}: {}", String::from_utf8_lossy(&out.stderr));
        serde_json::from_slice(&out.stdout).unwrap()
    };
    let info = json("info", &[&volume]);
    assert!(info["files"][0]["path"].as_str().unwrap().ends_with("b\u{fffd}ad/v.vdb"), "{info}");
    json("convert", &[&volume, &other]);
    json("validate", &[&other]);
    json("diff", &[&volume, &other]);
    json("render @cube.vdb --views 2 --size 12x12 -o", &[&cap]);
    json("info", &[&cap]);
    json("reconstruct density --resolution 8 --report rep", &[&cap, "-o".as_ref(), &odd.join("r.vdb")]);
    assert!(work.path("rep/run.json").exists());
    json("pose --volume @cube.vdb", &[&cap, "-o".as_ref(), &cap.join("posed.json")]);
    // From elsewhere the pictures' paths go through the folder, which JSON cannot name.
    let out = work.command("pose --volume @cube.vdb -o posed.json").arg(&cap).output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(2), "{said}");
    assert!(said.contains("not Unicode") && said.contains("rename"), "{said}");
    assert!(!said.contains("rms"), "before the work: {said}");
    assert!(!work.path("posed.json").exists());
}

#[test]
fn text_from_files_does_not_act_on_the_terminal() {
    let work = Work::new();
    let mut grid = fog(HOSTILE, 1, 1);
    grid.metadata.insert(HOSTILE.into(), MetaValue::Text(HOSTILE.into()));
    grid.metadata.insert("cumulo_transfer".into(), MetaValue::Text(format!("{{\"format\": {}}}", json!(HOSTILE))));
    write_grids(&work.path("v.vdb"), &[&grid], &BTreeMap::new(), Codec::Blosc, false).unwrap();
    let film = Film::of(2, 2, vec![[f32::NAN; 4]; 4]);
    let attributes = [(HOSTILE.to_owned(), HOSTILE.to_owned())].into();
    exr::write_picture(&work.path("p.exr"), &film, &attributes, exr::Half::None).unwrap();
    let preset = json!([
        {"Name": HOSTILE, "RGBPoints": [0, 1, 0, 0, 1, 0, 0, 1]},
        {"Name": HOSTILE, "RGBPoints": [0, 1, 0, 0, 1, 0, 0, 1], "ColorSpace": HOSTILE},
    ]);
    std::fs::write(work.path("t.json"), preset.to_string()).unwrap();
    let capture = json!({"frames": [{"file_path": HOSTILE, "model": HOSTILE}], "model": HOSTILE});
    std::fs::write(work.path("c.json"), capture.to_string()).unwrap();
    std::fs::write(work.path(HOSTILE), "neither").unwrap();
    for words in [
        "info v.vdb p.exr",
        "validate v.vdb p.exr c.json",
        "transfer t.json",
        "transfer t.json --preset none",
        "transfer v.vdb",
        "info c.json",
        "render v.vdb -o out --views 1 --size 4x4",
        "render v.vdb -o out --grid none",
        "convert v.vdb o.vdb",
        "compare p.exr p.exr --layer none",
        "compare p.exr p.exr",
    ] {
        for json in [false, true] {
            let mut command = work.command(words);
            let out = if json { command.arg("--json").output() } else { command.output() }.unwrap();
            assert!(out.status.code().is_some(), "{words}");
            harmless(&out);
            if json && !out.stdout.is_empty() {
                serde_json::from_slice::<Value>(&out.stdout).unwrap();
            }
        }
    }
    for command in ["info", "validate", "transfer"] {
        harmless(&work.command(command).arg(HOSTILE).output().unwrap());
    }
    let shown = work.command("info v.vdb").output().unwrap();
    assert!(String::from_utf8(shown.stdout).unwrap().contains(r"\u{1b}[31m"), "shown, not swallowed");
}

/// Spellings of earlier versions, on the command line and in files.
#[test]
fn old_spellings_are_understood() {
    let work = Work::new();
    let identity = json!({"format": "cumulo-transfer-function", "version": 1,
        "transfer": {"kind": "identity", "domain": [0.0, 1.0], "colour": [0.9, 0.6, 0.3]}});
    std::fs::write(work.path("old.tf.json"), identity.to_string()).unwrap();
    work.json("render @plume.vdb --views 4 --size 12x12 --tf old.tf.json -o cap");
    work.json("reconstruct colour cap -o shaded.vdb --resolution 8 --iterations 1 --report page");
    work.json("reconstruct density cap -o d.vdb --resolution 8 --iterations 1 --solver weiss2021");
    work.json("gradient @plume.vdb --views 1 --size 8x8 --loss mean --wrt extinction --mode adjoint");
    work.json("gradient @plume.vdb --views 1 --size 8x8 --loss mean --wrt extinction --mode tangent");
    let record = std::fs::read_to_string(work.path("page/run.json")).unwrap();
    assert!(record.contains("\"color\""), "{record}");
    std::fs::write(work.path("page/run.json"), record.replace("\"color\"", "\"colour\"")).unwrap();
    work.json("report page");
    let written = work.command("transfer old.tf.json -o new.tf.json").output().unwrap();
    assert!(written.status.success(), "{}", errors(&written));
    let written = std::fs::read_to_string(work.path("new.tf.json")).unwrap();
    assert!(written.contains("\"color\"") && !written.contains("colour"), "{written}");
}

/// A record names files: what is wrong with one of them is said with the record's name.
#[test]
fn what_a_record_names_is_blamed_on_the_record() {
    let work = Work::new();
    work.json("render @plume.vdb --views 4 --size 12x12 -o cap");
    work.json("reconstruct density cap -o d.vdb --resolution 8 --iterations 1 --report page");
    let record: Value = serde_json::from_slice(&std::fs::read(work.path("page/run.json")).unwrap()).unwrap();
    for (key, value, code) in [
        ("output", json!(""), Code::NotFound),
        ("layer", json!("none"), Code::NoSuchLayer),
        ("capture", json!("else\u{1e}where"), Code::NotFound),
    ] {
        let mut damaged = record.clone();
        damaged[key] = value;
        std::fs::write(work.path("page/run.json"), damaged.to_string()).unwrap();
        work.refused("report page", code, &["page/run.json"]);
        work.refused("report page --beside other=cap", code, &["page/run.json"]);
    }
}
