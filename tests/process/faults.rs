//! Whatever write, sync, rename or folder fails, in whatever command: the outputs are the old ones whole, or new ones whole,
//! no temporary file is left, and a failure is never called a success.

use crate::common::work::{self, Work, errors};
use crate::writing::{ALL, Writing, completed, faults, prepared, restore, snapshot};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// Errors that a disk may answer with: full, broken, out of quota, read-only.
const ERRORS: [i32; 4] = [28, 5, 122, 30];

/// The shim that fails calls, compiled once.
fn shim() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/process/faults.c");
        let built = Path::new(env!("CARGO_TARGET_TMPDIR")).join("faults.so");
        let done =
            Command::new("cc").args(["-shared", "-fPIC", "-O1", "-o"]).arg(&built).arg(source).arg("-ldl").status();
        assert!(done.unwrap().success(), "the shim does not compile");
        built
    })
}

/// Runs a command whose `at`-th change fails; what failed, none if there were fewer changes.
fn failing(work: &Work, words: &str, at: usize, error: i32, stay: bool) -> (Output, Option<String>) {
    let log = work.path("failed.log");
    let _ = std::fs::remove_file(&log);
    let mut command = work.command(words);
    command.args(["--threads", "1"]).env("LD_PRELOAD", shim());
    command.env("FAULTS_UNDER", work.path("out").canonicalize().unwrap());
    command.env("FAULTS_AT", at.to_string()).env("FAULTS_ERROR", error.to_string()).env("FAULTS_LOG", &log);
    if stay {
        command.env("FAULTS_STAY", "1");
    }
    let out = command.output().unwrap();
    (out, std::fs::read_to_string(&log).ok())
}

fn prove(writing: &Writing) {
    let work = prepared(writing);
    let fresh = snapshot(&work);
    completed(&work, writing.words);
    let old = snapshot(&work);
    for (start, stay) in [(&old, false), (&fresh, false), (&old, true)] {
        let mut tried = 0;
        for at in 1.. {
            restore(&work, &start.0, &start.1);
            let (out, failed) = failing(&work, writing.words, at, ERRORS[at % ERRORS.len()], stay);
            let place = format!("{}, change {at}, failed: {failed:?}, staying: {stay}\n{}", writing.name, errors(&out));
            let wrong = faults(&work, &start.0, true);
            assert!(wrong.is_empty(), "{wrong:?}\n{place}");
            match (out.status.code(), &failed) {
                (Some(2), Some(_)) => {
                    // The file is named, and there is a remedy below.
                    assert!(errors(&out).contains("out/") || errors(&out).contains("out:"), "{place}");
                    assert!(errors(&out).lines().any(|l| l.starts_with("  ")), "{place}");
                }
                // A second name for an old file is a convenience: a copy does as well.
                (Some(0 | 1), Some(what)) if what.contains("link") && !stay => {}
                (Some(0 | 1), None) => break,
                (code, _) => panic!("exit code {code:?}: {place}"),
            }
            tried = at;
            assert!(at < 500, "no end: {place}");
        }
        assert!(tried >= 4, "{}: only {tried} changes were seen, the shim misses some", writing.name);
    }
}

fn named(name: &str) -> &'static Writing {
    ALL.iter().find(|w| w.name == name).unwrap()
}

macro_rules! proofs {
    ($($name:ident)*) => {$(
        #[test]
        fn $name() {
            prove(named(stringify!($name)));
        }
    )*};
}

proofs! { view convert render viewpoint pose gradient density color tf transfer compare report denoise motion }

/// All of a batch appears, or none of it, when the disk fails once.
#[test]
fn a_capture_is_old_or_new_never_a_mixture() {
    let work = prepared(named("render"));
    completed(&work, "render @slab.vdb --views 3 --size 8x8 -o out/shots");
    let old = snapshot(&work);
    for at in 1.. {
        restore(&work, &old.0, &old.1);
        let (out, failed) = failing(&work, named("render").words, at, 28, false);
        let now = snapshot(&work).0;
        let kept = old.0.iter().filter(|(path, bytes)| now.get(*path) == Some(*bytes)).count();
        let place = format!("change {at} ({failed:?}): {kept} of {} are old\n{}", old.0.len(), errors(&out));
        // The sync of the folder comes last, when all are in place.
        assert!(kept == old.0.len() || kept == 0, "{place}");
        if failed.is_none() {
            assert!(out.status.success() && kept == 0, "{place}");
            break;
        }
    }
}

/// `ulimit -f` ends programs by a signal, unless they see to it.
#[test]
fn a_limit_for_files_is_an_error_not_a_signal() {
    let work = Work::new();
    std::fs::write(work.path("a.vdb"), "old").unwrap();
    let program = env!("CARGO_BIN_EXE_cumulo");
    let line = format!("ulimit -f 8; exec {program} convert {} a.vdb", work::fixture("plume.vdb").display());
    let out = Command::new("bash").args(["-c", &line]).current_dir(work.path("")).output().unwrap();
    assert_eq!(out.status.code(), Some(2), "{}", errors(&out));
    assert!(errors(&out).contains("a.vdb") && errors(&out).contains("bytes are needed"), "{}", errors(&out));
    assert_eq!(std::fs::read(work.path("a.vdb")).unwrap(), b"old");
    assert_eq!(work.files("").len(), 1);
}

/// Standard output that cannot be written is a failure too.
#[test]
fn a_report_that_nobody_gets_is_no_success() {
    let work = Work::new();
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let out = work.command("info @cube.vdb").stdout(full).output().unwrap();
    assert_eq!(out.status.code(), Some(2), "{}", errors(&out));
    assert!(errors(&out).contains("standard output"), "{}", errors(&out));
}
