//! A program that is killed at any moment leaves whole outputs or none, and `--resume` goes on after each. A short round;
//! `CUMULO_KILLS=200 cargo test --release --test killed` is the long one.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a panic is how a test fails")]

mod work;
mod writing;

use std::process::Command;
use std::time::{Duration, Instant};
use work::{Work, errors, interrupt, until};
use writing::{ALL, completed, faults, prepared, restore, snapshot};

fn kills() -> u32 {
    std::env::var("CUMULO_KILLS").map_or(6, |text| text.parse().unwrap())
}

#[test]
fn killed_at_any_moment() {
    for writing in &ALL {
        let work = prepared(writing);
        let fresh = snapshot(&work);
        let begun = Instant::now();
        completed(&work, writing.words);
        let whole = begun.elapsed();
        let old = snapshot(&work);
        for number in 0..kills() {
            let start = if number % 2 == 0 { &old } else { &fresh };
            restore(&work, &start.0, &start.1);
            // The golden ratio's multiples spread the moments evenly, however many there are.
            let moment = (f64::from(number) * 0.618_033_988_749_895).fract() * 1.05;
            let mut child = work.start(&format!("{} --threads 1", writing.words));
            std::thread::sleep(whole.mul_f64(moment));
            child.kill().unwrap();
            child.wait().unwrap();
            // Nobody cleans up after SIGKILL: temporary files may stay.
            let wrong = faults(&work, &start.0, false);
            assert!(wrong.is_empty(), "{}, killed after {moment:.3} of {whole:?}: {wrong:?}", writing.name);
            if writing.resumes {
                completed(&work, &format!("{} --resume", writing.words));
                let wrong = faults(&work, &start.0, false);
                assert!(wrong.is_empty(), "{}, resumed: {wrong:?}", writing.name);
            }
        }
    }
}

/// SIGINT and SIGTERM leave nothing temporary behind, in commands that have nothing to save either.
#[test]
fn signals_leave_no_litter() {
    let work = Work::new();
    for (signal, code) in [("-INT", 130), ("-TERM", 143), ("-HUP", 129)] {
        // A pipe that nobody reads holds the program while it has written its temporary files.
        let mut child = work.start("convert @plume.vdb big.vdb --resample 0.02");
        std::thread::sleep(Duration::from_millis(150));
        let sent = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
        assert!(sent.success());
        let status = child.wait().unwrap();
        let left: Vec<_> = work.files("").into_keys().filter(|p| !p.ends_with("big.vdb")).collect();
        assert!(left.is_empty(), "{signal}: {left:?}");
        assert!(status.code() == Some(code) || status.success(), "{signal}: {status}");
    }
    // A render of many pictures has a folder of them waiting.
    let child = work.start("render @plume.vdb --views 400 --size 128x128 --supersample 4 -o shots --threads 1");
    until("pictures wait", || work.path("shots").is_dir() && work.files("shots").len() > 2);
    let out = interrupt(child);
    assert_eq!(out.status.code(), Some(130), "{}", errors(&out));
    assert!(work.files("").into_keys().all(|p| p.ends_with("big.vdb")), "{:?}", work.files("").keys());
}
