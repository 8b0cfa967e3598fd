//! A program that is killed at any moment leaves whole outputs or none, and `--resume` goes on after each. A short round;
//! `CUMULO_KILLS=200 cargo test --release --test process killed::` is the long one.

use crate::common::work::{self, Work, errors, interrupt, until};
use crate::writing::{ALL, completed, faults, prepared, restore, snapshot};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

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
        let mut child = work.begun("convert @plume.vdb big.vdb --resample 0.02");
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

/// Signals that come while files are being written, moments after the first of them has begun.
#[test]
fn signals_amid_writing_leave_no_litter() {
    let work = Work::new();
    work.json("render @plume.vdb --views 24 --size 64x64 --density-scale auto -o in");
    work.json("render @plume.vdb --views 24 --size 64x64 --density-scale auto --overwrite -o other");
    std::fs::create_dir(work.path("s")).unwrap();
    for frame in 1..=24 {
        std::fs::copy(work::fixture("plume.vdb"), work.path(&format!("s/s.{frame:04}.vdb"))).unwrap();
    }
    let mut stopped = 0;
    for words in [
        "capture convert in -o out --to colmap",
        "motion @plume.vdb --cameras in --samples 4 -o out/m_%03d.exr",
        "denoise in/view_%03d.exr -o out/q_%03d.exr",
        "render @plume.vdb --views 24 --size 64x64 --png -o out",
        "render @plume.vdb --cameras in --frames 0-23 -o out",
        "convert s out",
        "view in other -o out",
        "compare in/view_%03d.exr other/view_%03d.exr --report out",
        "usd author s/s.####.vdb -o out/s.usda",
        "viewpoint @plume.vdb --starts 2 --iterations 1 --size 32x32 --pictures out/best -o out/best.json --report out/page",
    ] {
        for (number, signal) in ["-TERM", "-INT", "-TERM", "-TERM"].into_iter().enumerate() {
            let _ = std::fs::remove_dir_all(work.path("out"));
            std::fs::create_dir(work.path("out")).unwrap();
            let mut child = work.start(words);
            while litter(&work).is_empty() && child.try_wait().unwrap().is_none() {
                std::thread::sleep(Duration::from_micros(200));
            }
            std::thread::sleep(Duration::from_millis(3 * number as u64));
            let _ = Command::new("kill").args([signal, &child.id().to_string()]).stderr(Stdio::null()).status();
            let status = child.wait().unwrap();
            stopped += u32::from(matches!(status.code(), Some(130 | 143)));
            assert!(litter(&work).is_empty(), "{words}, {signal}, {number}: {:?}", litter(&work));
        }
    }
    assert!(stopped > 10, "only {stopped} were stopped in the midst");
}

/// Temporary files and folders in `out` and its folders.
fn litter(work: &Work) -> Vec<PathBuf> {
    let mut left = vec![work.path("out")];
    let mut found = Vec::new();
    while let Some(folder) = left.pop() {
        // Folders come and go meanwhile.
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let temporary = entry.file_name().to_string_lossy().starts_with(".cumulo-");
            match entry.path() {
                path if temporary => found.push(path),
                path if path.is_dir() => left.push(path),
                _ => {}
            }
        }
    }
    found
}
