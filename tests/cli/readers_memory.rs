//! Readers of pictures and JSON know what memory they need before they ask for it, and keep to
//! `--max-memory`; what has no end is not read.

use crate::common::refusal;
use crate::common::work::{Work, errors, fixture};
use ::exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, Layer, LayerAttributes, WritableImage, f16};
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::scene::film::Film;
use std::path::Path;
use std::process::{Command, Output};

/// What `info` of a small file takes by this measure, rounded up: heap, a thread's stack, and the writable
/// tables of OpenVDB and its libraries.
const BASE_MIB: u64 = 36;

/// Runs the program on one thread with `mib` MiB of data beside what it has without work. What asks for more
/// ends by a signal, not by an exit code.
fn run(work: &Work, words: &str, mib: u64) -> Output {
    let kib = (mib + BASE_MIB) << 10;
    let program = env!("CARGO_BIN_EXE_cumulo");
    let line = format!("ulimit -d {kib} && exec timeout 60 {program} {words} --threads 1");
    let out = Command::new("sh").args(["-c", &line]).current_dir(work.path(".")).output().unwrap();
    assert!(out.status.code().is_some_and(|c| c <= 2), "{words}: {:?}\n{}", out.status, errors(&out));
    out
}

/// Expects an error of this code that names these facts, within so much memory.
fn refused(work: &Work, command: &str, mib: u64, code: Code, facts: &[&str]) {
    refusal::told(&run(work, &format!("{command} --json"), mib), command, code, facts);
}

/// A picture of one color with a window that is changed to `side`² pixels; a kilobyte.
fn with_display_window(path: &Path, side: i32) {
    let mut bytes = std::fs::read(fixture("exr/grey.exr")).unwrap();
    let what = b"displayWindow\0box2i\0\x10\0\0\0";
    let at = bytes.windows(what.len()).position(|w| w == what).unwrap() + what.len() + 8;
    bytes[at..at + 4].copy_from_slice(&(side - 1).to_le_bytes());
    bytes[at + 4..at + 8].copy_from_slice(&(side - 1).to_le_bytes());
    std::fs::write(path, bytes).unwrap();
}

/// Four channels of half floats, all 0, which takes few bytes.
fn plain(path: &Path, [width, height]: [usize; 2]) {
    let zeros = || FlatSamples::F16(vec![f16::ZERO; width * height]);
    let channels = ["A", "B", "G", "R"].map(|name| AnyChannel::new(name, zeros()));
    let channels = AnyChannels::sort(channels.into_iter().collect());
    let encoding = ::exr::image::Encoding {
        compression: ::exr::prelude::Compression::ZIP16,
        blocks: ::exr::image::Blocks::ScanLines,
        line_order: ::exr::prelude::LineOrder::Increasing,
    };
    let layer = Layer::new((width, height), LayerAttributes::default(), encoding, channels);
    Image::from_layer(layer).write().to_file(path).unwrap();
}

#[test]
fn windows_are_measured_against_the_limit_first() {
    let work = Work::new();
    with_display_window(&work.path("bomb.exr"), 11_000);
    refused(
        &work,
        "compare bomb.exr bomb.exr --max-memory 1G",
        16,
        Code::MemoryLimit,
        &["bomb.exr", "need", "MiB", "--max-memory"],
    );
    let capture = r#"{"frames": [{"file_path": "bomb.exr", "fl_x": 9,
        "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}"#;
    std::fs::write(work.path("c.json"), capture).unwrap();
    let out = run(&work, "validate c.json --max-memory 500M", 16);
    let said = String::from_utf8(out.stdout).unwrap();
    assert!(out.status.code() == Some(1) && said.contains("bomb.exr") && said.contains("--max-memory"), "{said}");
    // Few chunks of it are in memory at a time, whatever the window: nothing is held.
    assert_eq!(run(&work, "info bomb.exr --max-memory 112M", 20).status.code(), Some(0));
}

#[test]
fn figures_of_a_picture_need_its_chunks_only() {
    let work = Work::new();
    // 4096² pixels of four channels are 256 MiB as 32-bit floats; 8 chunks at work thrice 1/2 MiB are 12 MiB.
    plain(&work.path("p.exr"), [4096; 2]);
    for command in ["info p.exr", "validate p.exr"] {
        assert_eq!(run(&work, command, 30).status.code(), Some(0), "{command}");
        assert_eq!(run(&work, &format!("{command} --max-memory 112M"), 20).status.code(), Some(0), "{command}");
    }
    // A chunk at work of 16 rows of 2¹⁹ pixels takes thrice 64 MiB.
    plain(&work.path("wide.exr"), [1 << 19, 16]);
    refused(
        &work,
        "info wide.exr --max-memory 112M",
        16,
        Code::MemoryLimit,
        &["wide.exr", "4 channel(s)", "112 MiB are allowed"],
    );
}

#[test]
fn figures_are_those_of_all_samples() {
    // Overscan, a data window within the display window, parts, tiles, holes: by chunk as by plane.
    for name in ["overscan.exr", "multipart.exr", "tiled.exr", "nan.exr", "mipmap.exr", "blender.exr", "zip.exr"] {
        let path = fixture("exr").join(name);
        let (image, summary) = (exr::read(&path).unwrap(), exr::summary(&path).unwrap());
        let planes = image.layers.iter().flat_map(|l| &l.channels);
        let all: Vec<_> = summary.parts.iter().flat_map(|p| &p.layers).flat_map(|l| &l.channels).collect();
        for (plane, figures) in planes.zip(&all) {
            let finite = || plane.samples.iter().copied().filter(|v| v.is_finite());
            assert_eq!(plane.name, figures.info.component, "{name}");
            assert_eq!((finite().reduce(f32::min), finite().reduce(f32::max)), (figures.min, figures.max), "{name}");
            let sum: f64 = finite().map(f64::from).sum();
            let mean = sum / finite().count() as f64;
            // Sums of n values in another order differ by n units in the last place of the sum of magnitudes.
            let magnitude: f64 = finite().map(|v| f64::from(v).abs()).sum();
            assert!((mean - figures.mean.unwrap()).abs() <= magnitude * f64::EPSILON, "{name}");
            assert_eq!(plane.non_finite, figures.non_finite, "{name}");
        }
        assert_eq!(image.layers.iter().map(|l| l.channels.len()).sum::<usize>(), all.len(), "{name}");
    }
}

#[test]
fn compare_keeps_to_its_limit() {
    let work = Work::new();
    let side = 1408;
    let write = |name: &str, offset: f32, hole: bool| {
        let mut film = Film::new(side, side);
        film.rgba.iter_mut().enumerate().for_each(|(i, p)| *p = [(i % 97) as f32 / 97.0 + offset, 0.5, 0.1, 1.0]);
        if hole {
            film.rgba[5][0] = f32::NAN;
        }
        exr::write_picture(&work.path(name), &film, &Default::default(), exr::Half::None).unwrap();
    };
    write("a.exr", 0.0, true);
    write("b.exr", 0.25, false);
    // 72 bytes a pixel are 136 MiB, and some rows; the program itself takes some more.
    refused(
        &work,
        "compare a.exr b.exr --max-memory 130M",
        70,
        Code::MemoryLimit,
        &["comparing them needs", "130 MiB are allowed"],
    );
    let out = run(&work, "compare a.exr b.exr --max-memory 180M --heatmap h.png --json", 180);
    assert_eq!(out.status.code(), Some(1), "{}", errors(&out));
    let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    // The sums with the offset are rounded to 24 bits.
    assert!((report["max_abs"].as_f64().unwrap() - 0.25).abs() < 1.5 * f64::from(f32::EPSILON), "{report}");
    assert_eq!(report["non_finite_pixels"], 1);
    assert!(work.path("h.png").exists());
}

#[test]
fn json_is_measured_before_it_is_parsed() {
    let work = Work::new();
    // Each of these objects of seven bytes takes 700 in memory.
    let objects = format!("[{}0]", r#"{"":0},"#.repeat(1 << 19));
    std::fs::write(work.path("c.json"), format!("{{\"frames\": {objects}}}")).unwrap();
    std::fs::write(work.path("t.json"), format!("{{\"RGBPoints\": {objects}}}")).unwrap();
    std::fs::write(work.path("l.json"), &objects).unwrap();
    for command in ["info c.json", "validate c.json", "transfer t.json", "transfer l.json"] {
        let out = run(&work, &format!("{command} --max-memory 112M"), 40);
        let said = String::from_utf8(out.stdout.clone()).unwrap() + &errors(&out);
        assert!(out.status.code() != Some(0) && said.contains("112 MiB are allowed"), "{command}: {said}");
    }
    // Deep nesting ends the parser, not the stack.
    std::fs::write(work.path("c.json"), format!("{{\"frames\": {}", "[".repeat(1 << 20))).unwrap();
    refused(&work, "info c.json", 400, Code::Invalid, &["c.json", "recursion limit"]);
    // A million faults are told in a few words.
    std::fs::write(work.path("c.json"), format!("{{\"frames\": [{}0]}}", "0,".repeat(1 << 20))).unwrap();
    let out = run(&work, "validate c.json", 400);
    let said = String::from_utf8(out.stdout).unwrap();
    assert!(out.status.code() == Some(1) && said.contains("1048477 more frames"), "{} bytes", said.len());
}

#[test]
fn what_has_no_end_is_not_read() {
    let work = Work::new();
    assert!(Command::new("mkfifo").arg(work.path("fifo")).status().unwrap().success());
    for path in ["/dev/zero", "fifo"] {
        for command in [
            "transfer",
            "info",
            "validate",
            "compare a.exr",
            "diff @cube.vdb",
            "gradient --views 1 --wrt density --loss mean",
            "render @cube.vdb -o out --views 1 --tf",
        ] {
            // Words that begin with @ are fixtures, which the shell knows nothing of.
            let command = command.replace("@cube.vdb", fixture("cube.vdb").to_str().unwrap());
            std::fs::copy(fixture("exr/grey.exr"), work.path("a.exr")).unwrap();
            refused(&work, &format!("{command} {path}"), 60, Code::Invalid, &[path, "regular file"]);
        }
        refused(&work, &format!("convert {path} out.vdb"), 60, Code::Invalid, &[path, "regular file"]);
    }
}
