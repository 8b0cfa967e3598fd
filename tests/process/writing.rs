//! Every command that writes, on small inputs, with what its outputs must be after whatever happened to it.

use crate::common::work::{Work, errors};
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::preflight;
use cumulo::formats::{exr, transforms};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A command that writes into the folder `out`.
pub struct Writing {
    pub name: &'static str,
    pub words: &'static str,
    /// `--resume` goes on from its output.
    pub resumes: bool,
}

const fn writing(name: &'static str, words: &'static str, resumes: bool) -> Writing {
    Writing { name, words, resumes }
}

pub const ALL: [Writing; 14] = [
    writing("view", "view @cube.vdb --size 32 -o out/sheet.png", false),
    writing("convert", "convert @cube.vdb out/a.vdb", false),
    writing("render", "render @cube.vdb --views 3 --size 8x8 --overwrite -o out/shots", false),
    writing(
        "viewpoint",
        "viewpoint @cube.vdb --starts 2 --iterations 1 --size 16x16 --overwrite --pictures out/best -o out/best.json --report out/page",
        true,
    ),
    writing("pose", "pose in/cap --volume @cube.vdb --iterations 1 -o out/cameras.json --report out/page", true),
    writing(
        "gradient",
        "gradient @cube.vdb --wrt density --loss mean --views 1 --size 8x8 --largest 1 -o out/g.vdb --report out/page",
        false,
    ),
    writing(
        "density",
        "reconstruct density in/cap -o out/found.vdb --resolution 8 --iterations 2 --report out/page",
        true,
    ),
    writing(
        "color",
        "reconstruct color in/bright -o out/shaded.vdb --resolution 8 --iterations 2 --report out/page",
        true,
    ),
    writing(
        "tf",
        "reconstruct tf in/bright --volume @cube.vdb --texels 4 --rays 128 --iterations 1 -o out/found.tf.json --report out/page",
        true,
    ),
    writing("transfer", "transfer in/two.tf.json -o out/again.tf.json", false),
    writing("compare", "compare in/cap/view_000.exr in/cap/view_001.exr --heatmap out/apart.png", false),
    writing("report", "report out/page", false),
    writing("denoise", "denoise in/cap/view_%03d.exr -o out/quiet_%03d.exr", true),
    writing("motion", "motion @cube.vdb --cameras in/cap --samples 1 -o out/motion_%03d.exr", false),
];

/// A folder with the inputs, and `out`, empty but for what the command itself goes on from.
pub fn prepared(writing: &Writing) -> Work {
    let work = Work::new();
    let tf = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise",
                 "points": [[0.0, 1, 1, 1, 0.0], [1.0, 0.2, 0.5, 0.9, 2.0]]}}"#;
    std::fs::create_dir(work.path("in")).unwrap();
    std::fs::create_dir(work.path("out")).unwrap();
    std::fs::write(work.path("in/two.tf.json"), tf).unwrap();
    work.json("render @cube.vdb --views 4 --size 12x12 -o in/cap");
    work.json("render @cube.vdb --views 4 --size 12x12 --tf in/two.tf.json -o in/bright");
    if writing.name == "report" {
        work.json("reconstruct density in/cap -o in/found.vdb --resolution 8 --iterations 2 --report out/page");
    }
    work
}

/// Runs the command to its end.
pub fn completed(work: &Work, words: &str) {
    let out = work.command(words).output().unwrap();
    assert!(matches!(out.status.code(), Some(0 | 1)), "{words}: {}", errors(&out));
}

/// Makes a folder hold these files and nothing else.
pub fn restore(work: &Work, files: &BTreeMap<PathBuf, Vec<u8>>, folders: &[PathBuf]) {
    std::fs::remove_dir_all(work.path("out")).unwrap();
    std::fs::create_dir(work.path("out")).unwrap();
    folders.iter().for_each(|f| std::fs::create_dir_all(f).unwrap());
    for (path, bytes) in files {
        std::fs::write(path, bytes).unwrap();
    }
}

/// Every file beneath `out`, and every folder.
pub fn snapshot(work: &Work) -> (BTreeMap<PathBuf, Vec<u8>>, Vec<PathBuf>) {
    let all = work.files("out");
    let folders = all.keys().filter(|p| p.is_dir()).cloned().collect();
    (all.into_iter().filter(|(p, _)| p.is_file()).collect(), folders)
}

/// What is wrong with what stands in `out`: nothing there may be half-written, and no old file may be missing.
pub fn faults(work: &Work, old: &BTreeMap<PathBuf, Vec<u8>>, litter: bool) -> Vec<String> {
    let mut found: Vec<String> =
        old.keys().filter(|p| !p.exists()).map(|p| format!("{} is gone", p.display())).collect();
    for (path, bytes) in work.files("out") {
        let temporary = path.iter().any(|part| part.to_string_lossy().starts_with(".cumulo-"));
        if temporary {
            if litter {
                found.push(format!("{} was left", path.display()));
            }
            continue;
        }
        if path.is_file()
            && old.get(&path) != Some(&bytes)
            && let Err(what) = whole(&path, &bytes)
        {
            found.push(format!("{}: {what}", path.display()));
        }
    }
    found
}

fn whole(path: &Path, bytes: &[u8]) -> Result<(), String> {
    let words = |e: cumulo::Error| e.to_string();
    match path.extension().and_then(|e| e.to_str()) {
        Some("vdb") => preflight::check(path, &Limits::default()).map(drop).map_err(words),
        Some("exr") => exr::read_picture(path, None).map(drop).map_err(words),
        Some("json") => {
            let value: serde_json::Value = serde_json::from_slice(bytes).map_err(|e| e.to_string())?;
            if value.get("frames").is_none() {
                return Ok(());
            }
            let capture = transforms::load(path).map_err(words)?;
            match capture.frames.iter().find(|f| !f.picture.exists()) {
                Some(frame) => Err(format!("{} is not there", frame.picture.display())),
                None => Ok(()),
            }
        }
        Some("html") if bytes.trim_ascii_end().ends_with(b"</html>") => Ok(()),
        Some("png") => {
            let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().map_err(|e| e.to_string())?;
            let mut pixels = vec![0; reader.output_buffer_size().ok_or("no size")?];
            reader.next_frame(&mut pixels).map(drop).map_err(|e| e.to_string())
        }
        other => Err(format!("half a file, or one of another kind ({other:?})")),
    }
}
