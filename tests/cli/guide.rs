//! Every command of README.md and of the guide runs, and ends with the exit code that the page states.
//!
//! The ```` ```sh ```` fences of a page run in one folder, from top to bottom. A fence ```` ```json NAME ````,
//! ```` ```usda NAME ```` or ```` ```python NAME ```` is the file of that name. A comment with the words "exit code 1" states that exit code; without it 0 is expected.

use crate::common::work::{Work, errors, fixture};
use std::collections::BTreeSet;
use std::path::Path;

/// The pages, relative to the repository. `no_page_is_forgotten` holds this list against the folder.
const PAGES: &[&str] = &[
    "README.md",
    "src/guide/accuracy-and-cost.md",
    "src/guide/blender.md",
    "src/guide/captures.md",
    "src/guide/denoising.md",
    "src/guide/farms.md",
    "src/guide/getting-started.md",
    "src/guide/gradients.md",
    "src/guide/grids.md",
    "src/guide/library.md",
    "src/guide/looking.md",
    "src/guide/own-loss.md",
    "src/guide/reconstruction.md",
    "src/guide/scans.md",
    "src/guide/scattering.md",
    "src/guide/self-test.md",
    "src/guide/paths.md",
    "src/guide/planning.md",
    "src/guide/python.md",
    "src/guide/shell.md",
    "src/guide/torch.md",
    "src/guide/transfer-functions.md",
    "src/guide/usd-authoring.md",
    "src/guide/usd.md",
    "src/guide/volumes.md",
];

/// Volumes, and a picture, that the pages name and the reader brings.
const VOLUMES: [(&str, &str); 8] = [
    ("atlas.nii.gz", "head.nii.gz"),
    ("smoke.vdb", "plume.vdb"),
    ("head.vdb", "plume.vdb"),
    ("head.nii.gz", "head.nii.gz"),
    ("smoke.0001.vdb", "plume.vdb"),
    ("smoke.0002.vdb", "cube.vdb"),
    ("smoke.0003.vdb", "plume.vdb"),
    ("deep.exr", "exr/deep_tiles.exr"),
];

/// Commands that make further inputs of pages.
const PREPARED: [(&str, &str); 3] = [
    ("src/guide/scans.md", "convert head.nii.gz field.vdb"),
    ("src/guide/scans.md", "convert field.vdb c60.npy"),
    ("src/guide/scans.md", "convert field.vdb vorticity.npy"),
];

/// Commands that other programs run or have to precede. They are not run here: `make demo`, `tests/kernels/examples.rs` and Python's
/// tests do that.
const OTHERS: &[&str] = &[
    "make demo",
    "make demo BLENDER=1",
    "make install",
    // Of OpenImageIO: `python/tests/imaging/test_deep.py` runs it.
    "oiiotool smoke.deep.exr prop.exr --deepen --deepholdout --flatten -o before.exr",
    "PYTHONPATH=python .venvs/bpy/bin/python -m cumulo.blender render smoke.vdb --capture path --frames 0-23 --albedo 0.95 --sun -1 0.6 0.7 --sun-color 3 3 3 --samples 4 -o cycles",
    // Of Cycles' frames: `python/tests/blender/test_denoising.py` runs them.
    "cumulo denoise cycles/view_%03d.exr -o quiet/frame.%04d.exr --motion files:motion/frame.%04d.exr",
    "cumulo compare quiet/frame.%04d.exr cycles/view_%03d.exr --report page",
    // Of a Blender file: `python/tests/blender/test_guide.py` runs them.
    "PYTHONPATH=python .venvs/bpy/bin/python -m cumulo.bpy_scene export smoke.blend --animation -o scene",
    "cumulo render scene/scene.json --cameras scene --frames 1-3 --samples 16 -o pictures",
    "PYTHONPATH=python .venvs/bpy/bin/python -m cumulo.bpy_scene capture smoke.blend --views 16 --size 48x48 -o shots",
    "cumulo reconstruct density shots -o found.vdb",
    "PYTHONPATH=python .venvs/bpy/bin/python -m cumulo.bpy_scene load found.vdb --into smoke.blend --like Smoke -o both.blend",
    "sudo apt-get install libopenvdb-dev libboost-dev libclang-dev g++",
    "cargo install --path . --locked",
    "usdview smoke.usda",
    // Of a series of DICOM files: `python/tests/imaging/test_dicom.py` renders such ones.
    "cumulo render series --tf mr-default --tf-range 20,130 --tf-unit-distance 0.1 --azimuth 235 --elevation 20 --albedo 1 --sun=-0.7,0.9,0.8 --sun-color 5 --sun-angle 8 --sky 0.5 --gradient-shading 10 --gradient-scale 1 --specular 0.04 --samples 16 --denoise --background 1,1,1 -o series.exr",
    "cumulo figure c60.exr series.exr vorticity.exr --label A,B,C --orientation axes --scale-bar -o fields.pdf",
    // Of a volume that is too large for a test: `tests/process/scratch.rs` runs such ones.
    "cumulo render large.vdb --views 64 -o shots --max-memory 2G --scratch /var/tmp",
    "cumulo reconstruct density shots -o found.vdb --resolution 1024 --max-memory 2G --scratch /var/tmp",
    // Of a depth picture of another program: `tests/cli/holdout.rs` runs such ones.
    "cumulo render smoke.vdb --cameras shots --view 0 --density-scale auto --albedo 0.9 --samples 16 --holdout prop.exr -o before.exr",
    // `python/tests/test_commands.py` runs it.
    "python3 own_loss.py guess.vdb shots",
    "cargo run --release --example load_and_render -- smoke.vdb view.exr",
    "cargo run --release --example gradient_of_a_picture -- smoke.vdb",
    "cargo run --release --example reconstruct -- shots found.vdb",
];

/// Sizes that keep the commands short: subcommand, option, its value, and an option beside which it is not allowed.
/// A command that has the option itself keeps its value.
const SIZES: [(&str, &str, &str, Option<&str>); 18] = [
    ("render", "--size", "32x32", Some("--cameras")),
    ("reconstruct density", "--resolution", "12", Some("--voxel-size")),
    ("reconstruct density", "--iterations", "2", None),
    ("reconstruct color", "--resolution", "12", Some("--voxel-size")),
    ("reconstruct color", "--iterations", "2", None),
    ("reconstruct tf", "--texels", "16", None),
    ("reconstruct tf", "--rays", "4000", None),
    ("viewpoint", "--size", "32x32", None),
    ("viewpoint", "--iterations", "2", None),
    ("pose", "--iterations", "2", None),
    ("gradient", "--size", "16x16", Some("--target")),
    ("study render", "--size", "24x24", None),
    ("study render", "--repeats", "1", None),
    ("study gradient", "--size", "16x16", None),
    ("study gradient", "--repeats", "1", None),
    ("study reconstruct", "--repeats", "1", None),
    ("study denoise", "--repeats", "1", None),
    ("study denoise", "--knobs", "method", None),
];

/// A fenced block: the words behind the backticks, and its lines.
struct Fence {
    info: Vec<String>,
    lines: Vec<String>,
}

fn fences(text: &str) -> Vec<Fence> {
    let mut found: Vec<Fence> = Vec::new();
    let mut open = false;
    for line in text.lines() {
        if let Some(info) = line.strip_prefix("```") {
            open = !open;
            if open {
                found.push(Fence { info: info.split_whitespace().map(Into::into).collect(), lines: Vec::new() });
            }
        } else if open {
            found.last_mut().unwrap().lines.push(line.into());
        }
    }
    assert!(!open, "a fence is not closed");
    found
}

/// The words of a command line, a path with `*` replaced by the files that it matches. A product has no slash.
fn expanded(work: &Work, line: &str) -> Vec<String> {
    let matches = |pattern: &str| -> Vec<String> {
        let (folder, name) = pattern.rsplit_once('/').unwrap();
        let (start, end) = name.split_once('*').unwrap();
        let entries = std::fs::read_dir(work.path(folder)).unwrap();
        let names = entries.map(|e| e.unwrap().file_name().into_string().unwrap());
        let mut paths: Vec<String> =
            names.filter(|n| n.starts_with(start) && n.ends_with(end)).map(|n| format!("{folder}/{n}")).collect();
        paths.sort();
        assert!(!paths.is_empty(), "{pattern} matches nothing");
        paths
    };
    let words = line.split_whitespace().map(|word| word.replace('\'', ""));
    words.flat_map(|word| if word.contains('*') && word.contains('/') { matches(&word) } else { vec![word] }).collect()
}

/// Runs the commands of a page and gives their number.
fn run(page: &str) -> usize {
    let work = Work::new();
    for (name, source) in VOLUMES {
        std::fs::copy(fixture(source), work.path(name)).unwrap();
    }
    for (_, command) in PREPARED.iter().filter(|(of, _)| *of == page) {
        work.json(command);
    }
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(page)).unwrap();
    let mut count = 0;
    for fence in fences(&text) {
        match &*fence.info {
            [kind, name] if ["json", "usda", "python", "obj"].contains(&kind.as_str()) => {
                std::fs::write(work.path(name), fence.lines.join("\n")).unwrap()
            }
            [kind] if kind == "sh" => {
                for line in &fence.lines {
                    count += usize::from(command(&work, page, line));
                }
            }
            [kind] if ["text", "json", "toml"].contains(&kind.as_str()) => {}
            other => panic!("{page}: a fence is marked {other:?}; sh, json, toml or text is expected"),
        }
    }
    count
}

/// Runs a line of a page if it is a command of ours; false if it is empty, a comment or another program's.
fn command(work: &Work, page: &str, line: &str) -> bool {
    let (line, comment) = line.split_once('#').unwrap_or((line, ""));
    let line = line.trim();
    if line.is_empty() || OTHERS.contains(&line) {
        return false;
    }
    let Some(arguments) = line.strip_prefix("cumulo ") else {
        panic!("{page}: `{line}` is neither run nor in the list of others");
    };
    let mut words = expanded(work, arguments);
    for (subcommand, option, value, beside) in SIZES {
        let has = |name: &str| words.iter().any(|word| word == name);
        if line.starts_with(&format!("cumulo {subcommand} ")) && !has(option) && !beside.is_some_and(has) {
            words.extend([option.to_owned(), value.to_owned()]);
        }
    }
    let out = work.command(&words.join(" ")).output().unwrap();
    let expected = if comment.contains("exit code 1") { 1 } else { 0 };
    assert_eq!(out.status.code(), Some(expected), "{page}: {line}\n{}", errors(&out));
    true
}

#[test]
fn readme() {
    assert!(run("README.md") >= 5);
}

#[test]
fn accuracy_and_cost() {
    assert!(run("src/guide/accuracy-and-cost.md") >= 14);
}

/// Its commands are of a Blender file.
#[test]
fn blender() {
    assert_eq!(run("src/guide/blender.md"), 0);
}

#[test]
fn captures() {
    assert!(run("src/guide/captures.md") >= 9);
}

#[test]
fn denoising() {
    assert!(run("src/guide/denoising.md") >= 6);
}

#[test]
fn getting_started() {
    assert!(run("src/guide/getting-started.md") >= 8);
}

#[test]
fn gradients() {
    assert!(run("src/guide/gradients.md") >= 8);
}

#[test]
fn grids() {
    assert!(run("src/guide/grids.md") >= 17);
}

/// Its programs run in `tests/kernels/examples.rs`.
#[test]
fn library() {
    assert_eq!(run("src/guide/library.md"), 0);
}

#[test]
fn looking() {
    assert!(run("src/guide/looking.md") >= 16);
}

#[test]
fn own_loss() {
    assert!(run("src/guide/own-loss.md") >= 2);
}

#[test]
fn python() {
    assert!(run("src/guide/python.md") >= 9);
}

#[test]
fn reconstruction() {
    assert!(run("src/guide/reconstruction.md") >= 10);
}

#[test]
fn paths() {
    assert!(run("src/guide/paths.md") >= 22);
}

#[test]
fn farms() {
    assert!(run("src/guide/farms.md") >= 10);
}

#[test]
fn planning() {
    assert!(run("src/guide/planning.md") >= 5);
}

#[test]
fn scattering() {
    assert!(run("src/guide/scattering.md") >= 6);
}

#[test]
fn self_test() {
    assert!(run("src/guide/self-test.md") >= 3);
}

#[test]
fn shell() {
    assert!(run("src/guide/shell.md") >= 18);
}

#[test]
fn scans() {
    assert!(run("src/guide/scans.md") >= 9);
}

/// Its programs run in `python/tests/torch/test_guide.py`.
#[test]
fn torch() {
    assert_eq!(run("src/guide/torch.md"), 0);
}

#[test]
fn transfer_functions() {
    assert!(run("src/guide/transfer-functions.md") >= 5);
}

#[test]
fn usd_authoring() {
    assert!(run("src/guide/usd-authoring.md") >= 9);
}

#[test]
fn usd() {
    assert!(run("src/guide/usd.md") >= 6);
}

#[test]
fn volumes() {
    assert!(run("src/guide/volumes.md") >= 10);
}

#[test]
fn no_page_is_forgotten() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let names =
        std::fs::read_dir(root.join("src/guide")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let mut pages: BTreeSet<String> = names.map(|name| format!("src/guide/{name}")).collect();
    pages.insert("README.md".into());
    assert_eq!(pages, PAGES.iter().map(|page| page.to_string()).collect(), "each page needs a test of its own here");
}

#[test]
fn links_of_the_pages_lead_somewhere() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for page in PAGES {
        let text = std::fs::read_to_string(root.join(page)).unwrap();
        for target in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let local = !target.starts_with("http") && !target.starts_with('#');
            let path = root.join(page).parent().unwrap().join(target.split('#').next().unwrap());
            assert!(!local || path.exists(), "{page}: {target} is not there");
        }
    }
}
