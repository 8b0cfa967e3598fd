//! Ctrl-C is obeyed inside a pass, and long work shows that it goes on.

use crate::common::work::{Work, errors, interrupt, until};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Output};
use std::sync::mpsc::channel;
use std::time::Duration;

/// Seconds of work of each thread after Ctrl-C: two, and as much again for slow machines. Time on the clock would depend on
/// what else the machine does.
const OBEYED: f64 = 4.0;
/// Clock ticks of Linux in a second, as `/proc` counts them.
const TICKS: f64 = 100.0;

/// Seconds of work that a process has done on all its threads, and whether it has ended.
fn work_of(id: u32) -> (f64, bool) {
    let stat = std::fs::read_to_string(format!("/proc/{id}/stat")).unwrap();
    // Behind the name, which may hold blanks: state, then 10 fields, then time in user and in kernel mode.
    let fields: Vec<&str> = stat.rsplit_once(") ").unwrap().1.split(' ').collect();
    let ticks: f64 = fields[11..13].iter().map(|f| f.parse::<f64>().unwrap()).sum();
    (ticks / TICKS, fields[0] == "Z")
}

/// Interrupts a process, and returns its output and the seconds of work that it did afterwards.
fn interrupted(child: Child) -> (Output, f64) {
    let id = child.id();
    let (before, ended) = work_of(id);
    assert!(!ended, "the work was over before it was interrupted");
    assert!(Command::new("kill").args(["-INT", &id.to_string()]).status().unwrap().success());
    until("the process ends", || work_of(id).1);
    let (after, _) = work_of(id);
    (child.wait_with_output().unwrap(), after - before)
}

/// A capture whose passes take many seconds: few large voxels, many pixels.
fn long() -> Work {
    let work = Work::new();
    work.json("render @plume.vdb --views 4 --size 64x64 --density-scale auto -o cap");
    work
}

/// Starts a command, interrupts it as each of these stages has begun, and says how it ended.
fn stopped(work: &Work, words: &str, stages: &[&str]) {
    for stage in stages {
        let words = format!("{words} --json");
        let child = work.reached(&words, |event| event["event"] == "began" && event["name"] == *stage);
        // Into the pass: what a stage does first may take no time.
        std::thread::sleep(Duration::from_millis(300));
        let (out, seconds) = interrupted(child);
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        assert!(seconds < OBEYED * threads as f64, "{words}, in {stage}: {seconds} s of {threads} threads");
        match out.status.code() {
            Some(130) => {
                let report: Value = serde_json::from_slice(&out.stdout).unwrap();
                if report["stopped"] == true {
                    assert!(["out", "out.vdb", "out.json"].iter().any(|name| work.path(name).exists()), "{report}");
                } else {
                    // Before anything was found nothing is written.
                    assert!(report["error"]["what"].as_str().unwrap().contains("nothing is written"), "{report}");
                    assert!(errors(&out).contains("nothing is written"), "{}", errors(&out));
                }
            }
            code => panic!("{words}, in {stage}: {code:?} {}", errors(&out)),
        }
    }
}

/// The finest level has millions of voxels: its hull, a pass and a probe of the confidence take seconds each.
#[test]
fn a_reconstruction_stops_inside_its_passes() {
    let work = long();
    let words = "reconstruct density cap -o out.vdb --resolution 400 --report page";
    stopped(&work, words, &["reading pictures", "density"]);
    stopped(&work, &format!("{words} --iterations 1"), &["confidence"]);
    stopped(&work, "reconstruct density cap -o out.vdb --resolution 300 --solver weiss2021", &["density"]);
}

#[test]
fn searches_stop_inside_their_pictures() {
    let work = Work::new();
    work.json("render @plume.vdb --views 2 --size 1500x1500 --density-scale auto -o cap");
    stopped(&work, "pose cap --volume @plume.vdb --quadrature riemann:0.002 -o out.json", &["pose"]);
    stopped(
        &work,
        "viewpoint @plume.vdb --size 4000x4000 --quadrature riemann:0.002 -o out.json --overwrite",
        &["viewpoint"],
    );
}

/// Where standard error is no terminal, a plain line at most every ten seconds: of work that goes on for hours, two of
/// them come in time.
#[test]
fn a_log_is_never_silent_for_ten_seconds() {
    let work = Work::new();
    let mut child = work.start("viewpoint @plume.vdb --size 1000x1000 --samples 1000000 -o out.json");
    let log = child.stderr.take().unwrap();
    let (said, heard) = channel();
    std::thread::spawn(move || {
        BufReader::new(log).lines().map_while(Result::ok).take_while(|line| said.send(line.clone()).is_ok()).count()
    });
    let mut text = Vec::new();
    let is_sign = |line: &String| line.contains("so far") || line.contains(" after ");
    while text.iter().filter(|line| is_sign(line)).count() < 2 {
        // Ten seconds, and as much again for slow machines.
        text.push(heard.recv_timeout(Duration::from_secs(20)).unwrap_or_else(|e| panic!("{e}: {text:?}")));
    }
    assert_eq!(interrupt(child).status.code(), Some(130));
    assert!(!text.iter().any(|line| line.contains('\u{1b}')) && text.len() < 20, "{text:?}");
}
