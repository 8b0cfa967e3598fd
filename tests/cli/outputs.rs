//! What a command may write: regular files with fitting names, never one of its own inputs, nor somebody else's capture.

use crate::common::replaced::{self, Spelling};
use crate::common::work::{Work, errors, fixture};
use cumulo::prelude::{Code, Context, ConvertSettings, PoseSettings};
use std::any::TypeId;
use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::Command;

fn with_inputs() -> Work {
    let work = Work::new();
    for name in ["cube.vdb", "slab.vdb"] {
        std::fs::copy(fixture(name), work.path(name)).unwrap();
    }
    let tf = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise",
                 "points": [[0.0, 1, 1, 1, 0.0], [1.0, 0.2, 0.5, 0.9, 2.0]]}}"#;
    std::fs::write(work.path("two.tf.json"), tf).unwrap();
    work.json("render cube.vdb --views 4 --size 12x12 -o cap");
    work.json("render cube.vdb --views 4 --size 12x12 --tf two.tf.json -o bright");
    work
}

#[test]
fn devices_pipes_and_folders_are_refused() {
    let work = with_inputs();
    assert!(Command::new("mkfifo").arg(work.path("pipe.vdb")).status().unwrap().success());
    // Where the test may make a device, it is one of its own: a fault would replace it.
    let made = Command::new("mknod").arg(work.path("device")).args(["c", "1", "3"]).output().unwrap();
    let device = if made.status.success() { work.path("device") } else { "/dev/null".into() };
    symlink(&device, work.path("null.vdb")).unwrap();
    let device = device.to_str().unwrap();
    for (words, code, expected) in [
        (&*format!("convert cube.vdb {device}"), Code::Invalid, "device"),
        ("convert cube.vdb null.vdb", Code::Invalid, "device"),
        ("convert cube.vdb pipe.vdb", Code::Invalid, "pipe"),
        ("convert cube.vdb cap", Code::Invalid, "folder"),
        (&*format!("reconstruct density cap -o {device}"), Code::Invalid, "device"),
        ("gradient cube.vdb --wrt density --loss mean --views 1 -o pipe.vdb", Code::Invalid, "pipe"),
        ("transfer two.tf.json -o /dev/stdout", Code::Invalid, "device"),
        (&*format!("render cube.vdb --views 1 -o {device}"), Code::Invalid, "folder"),
        ("convert cube.vdb -", Code::Unsupported, "standard output"),
        ("render cube.vdb --views 1 -o -", Code::Unsupported, "standard output"),
        ("reconstruct density cap -o o.vdb --report -", Code::Unsupported, "standard output"),
    ] {
        work.refused(words, code, &[expected]);
    }
    assert!(std::fs::metadata(device).unwrap().file_type().is_char_device());
    assert!(std::fs::metadata(work.path("pipe.vdb")).unwrap().file_type().is_fifo());
    assert!(!work.path("-").exists());
}

#[test]
fn links_stay_links_and_modes_stay_modes() {
    let work = with_inputs();
    std::fs::create_dir(work.path("store")).unwrap();
    symlink("store/real.vdb", work.path("link.vdb")).unwrap();
    work.json("convert cube.vdb link.vdb");
    let mode = |name: &str| std::fs::metadata(work.path(name)).unwrap().permissions().mode() & 0o777;
    std::fs::set_permissions(work.path("store/real.vdb"), PermissionsExt::from_mode(0o604)).unwrap();
    work.json("convert slab.vdb link.vdb");
    assert!(std::fs::symlink_metadata(work.path("link.vdb")).unwrap().is_symlink());
    assert_eq!(mode("store/real.vdb"), 0o604);
    assert_eq!(work.difference("slab.vdb", "store/real.vdb")["max_abs"], 0.0);
    // A new file has the mode that the umask leaves; nothing outside the output's folder is touched for it.
    let line = format!("umask 027; exec {} convert cube.vdb new.vdb", env!("CARGO_BIN_EXE_cumulo"));
    let out = Command::new("sh").args(["-c", &line]).current_dir(work.path("")).env("TMPDIR", "/nowhere").output();
    assert!(out.as_ref().unwrap().status.success(), "{}", errors(&out.unwrap()));
    assert_eq!(mode("new.vdb"), 0o640);
    // Pictures too.
    std::fs::set_permissions(work.path("cap/view_000.exr"), PermissionsExt::from_mode(0o600)).unwrap();
    work.json("render cube.vdb --views 2 --size 12x12 -o cap --overwrite");
    assert_eq!(mode("cap/view_000.exr"), 0o600);
}

#[test]
fn inputs_are_never_replaced() {
    let work = with_inputs();
    symlink("cube.vdb", work.path("same.vdb")).unwrap();
    std::fs::hard_link(work.path("cap/view_001.exr"), work.path("hard.vdb")).unwrap();
    std::fs::hard_link(work.path("bright/view_001.exr"), work.path("bright.vdb")).unwrap();
    let before = work.files("");
    for words in [
        "convert cube.vdb cube.vdb",
        "convert cube.vdb same.vdb",
        "convert cube.vdb --tf two.tf.json ./cap/../cube.vdb",
        "gradient cube.vdb --wrt density --loss mean --views 1 -o cube.vdb",
        "gradient cube.vdb --wrt density --loss l2 --target cap -o hard.vdb",
        "reconstruct density cap -o hard.vdb",
        "reconstruct density cap --init slab.vdb -o slab.vdb",
        "reconstruct color bright -o bright.vdb --resolution 8",
        "reconstruct tf bright --volume cube.vdb -o bright/transforms.json",
        "pose cap --volume cube.vdb -o cap/transforms.json",
        "transfer two.tf.json -o two.tf.json",
    ] {
        work.refused(words, Code::OutputIsInput, &["is an input of this command", "another name"]);
    }
    // Names that end otherwise are refused before.
    for words in [
        "viewpoint cube.vdb -o cube.vdb",
        "pose cap --volume cube.vdb -o cube.vdb",
        "reconstruct density cap -o cap/view_000.exr",
        "reconstruct tf bright --volume cube.vdb -o cube.vdb",
        "compare cap/view_000.exr cap/view_001.exr --heatmap cap/view_000.exr",
    ] {
        work.refused(words, Code::OutputName, &["would be written"]);
    }
    assert_eq!(work.files(""), before);
}

/// Whichever option leads to a file, and whatever it would become: it stays, `--overwrite` or not.
#[test]
fn no_input_of_any_option_becomes_an_output() {
    let work = replaced::prepared();
    let before = work.files("in");
    for case in replaced::ALL.iter().chain([&replaced::REPORT]) {
        replaced::works(&work, case);
        let first = case.inputs.iter().map(|input| (input, &case.outputs[0]));
        let others = case.outputs[1..].iter().map(|output| (&case.inputs[0], output));
        for (number, (input, output)) in first.chain(others).enumerate() {
            let spelling = if number % 2 == 0 { Spelling::Symbolic } else { Spelling::Hard };
            replaced::refused(&work, case, input, output, spelling);
        }
    }
    assert_eq!(work.files("in"), before);
}

/// An option that takes a path is among those above, so that a new one cannot be forgotten.
#[test]
fn every_option_with_a_path_is_tried_as_an_output() {
    // These write nothing beside what they print, or pages of their own.
    const WITHOUT_OUTPUTS: [&str; 9] =
        ["completions", "diff", "info", "man", "plan", "schema", "study", "try-grid", "validate"];
    let mut left: Vec<(String, clap::Command)> = vec![(String::new(), cumulo::cli::parser())];
    let mut seen = 0;
    while let Some((path, command)) = left.pop() {
        for sub in command.get_subcommands().filter(|sub| !WITHOUT_OUTPUTS.contains(&sub.get_name())) {
            left.push((format!("{path} {}", sub.get_name()).trim().to_owned(), sub.clone()));
        }
        for arg in command.get_arguments().filter(|arg| !arg.is_positional()) {
            let name = arg.get_long().unwrap_or_default();
            // A scratch folder gets files without names, and jobs that reconstruct refuse pictures to compare with.
            let refused = name == "openjd-reference" && path.starts_with("reconstruct");
            let takes_path =
                arg.get_value_parser().type_id() == TypeId::of::<PathBuf>() && name != "scratch" && !refused;
            if takes_path || ["sky", "motion", "beside"].contains(&name) {
                let of_command = |case: &&replaced::Case| case.words.starts_with(&format!("{path} "));
                let mut cases = replaced::ALL.iter().chain([&replaced::REPORT]).filter(of_command);
                let named = |case: &replaced::Case| {
                    let short = arg.get_short().map_or(String::new(), |short| format!(" -{short} "));
                    case.words.contains(&format!(" --{name} ")) || !short.is_empty() && case.words.contains(&short)
                };
                assert!(cases.any(named), "cumulo {path} --{name} is not tried in tests/replaced");
                seen += 1;
            }
        }
    }
    assert!(seen > 30, "{seen}");
}

#[test]
fn names_of_other_formats_are_refused() {
    let work = with_inputs();
    let before = work.files("");
    work.refused("convert cube.vdb out.usd", Code::OutputName, &["OpenVDB", "usd", ".vdb"]);
    work.refused("convert cube.vdb out.exr", Code::Unsupported, &["cube.vdb", "from VDB to OpenEXR", ".npy"]);
    work.refused("reconstruct density cap -o o.npy", Code::OutputName, &["OpenVDB", ".npy"]);
    work.refused("render cube.vdb --views 2 -o cloud.png", Code::Invalid, &["2 views", "one picture", "--view"]);
    work.refused("render cube.vdb --views 1 -o cloud.jpg", Code::OutputName, &["folder", ".jpg"]);
    work.refused("render cube.vdb --views 1 -o -", Code::Unsupported, &["standard output"]);
    work.refused("reconstruct density cap -o o.vdb --report page.html", Code::OutputName, &["folder", ".html"]);
    work.refused("viewpoint cube.vdb -o best.json --pictures shots.exr", Code::OutputName, &["folder", ".exr"]);
    assert_eq!(work.files(""), before);
}

#[test]
fn a_capture_of_another_command_is_spared() {
    let work = with_inputs();
    let before = work.files("cap");
    work.refused("render slab.vdb --views 2 --size 8x8 -o cap", Code::OutputExists, &["--overwrite"]);
    assert_eq!(work.files("cap"), before);
    // The very same command again is no surprise.
    work.json("render cube.vdb --views 4 --size 12x12 -o cap");
    work.json("render slab.vdb --views 2 --size 8x8 -o cap --overwrite");
    assert_ne!(work.files("cap"), before);
    // Pictures without a capture are somebody's too.
    std::fs::create_dir(work.path("lone")).unwrap();
    std::fs::copy(work.path("bright/view_000.exr"), work.path("lone/view_001.exr")).unwrap();
    work.refused("render slab.vdb --views 2 --size 8x8 -o lone", Code::OutputExists, &["view_001.exr", "--overwrite"]);
    work.refused(
        "viewpoint cube.vdb --starts 2 --iterations 1 --size 8x8 -o best.json --pictures lone",
        Code::OutputExists,
        &["view_001.exr", "--overwrite"],
    );
    assert_eq!(work.files("lone").len(), 1);
    work.json("viewpoint cube.vdb --starts 2 --iterations 1 --size 8x8 -o fresh.json --pictures shots");
    work.json("viewpoint cube.vdb --starts 2 --iterations 1 --size 8x8 -o fresh.json --pictures shots");
    // A search replaces no capture of another command; resumed, it goes on from its own.
    let search = "viewpoint cube.vdb --starts 1 --iterations 1 --size 8x8";
    let before = work.files("cap");
    for (words, what) in [("", "another capture"), ("--resume", "does not state the settings")] {
        let expected = ["cap/transforms.json", what, "--overwrite"];
        work.refused(&format!("{search} {words} -o cap/transforms.json"), Code::OutputExists, &expected);
    }
    work.refused(&format!("{search} -o fresh.json"), Code::OutputExists, &["fresh.json"]);
    assert_eq!(work.files("cap"), before);
    let expected = ["fresh.json", "other settings", "--overwrite"];
    work.refused(&format!("{search} --resume -o fresh.json"), Code::OutputExists, &expected);
    work.json(&format!("{search} --resume --overwrite -o fresh.json"));
    work.json(&format!("{search} --overwrite -o cap/transforms.json"));
    assert_ne!(work.files("cap"), before);
}

/// Searches by command and the change of a setting, and files of others to start from.
const SEARCHES: [(&str, &str, &str, &str); 5] = [
    ("reconstruct density cap --resolution 8", "found.vdb", "--loss l2", "slab.vdb"),
    ("reconstruct color bright --resolution 8", "shaded.vdb", "--smoothing 3", "other.vdb"),
    ("reconstruct tf bright --volume cube.vdb --rays 128 --texels 8", "found.tf.json", "--smooth 1", "two.tf.json"),
    ("pose cap --volume cube.vdb", "posed.json", "--solve-focal", "bright/transforms.json"),
    ("viewpoint cube.vdb --size 8x8 --starts 2", "best.json", "--hemisphere", "cap"),
];

/// `--resume` goes on from what the same settings left, however far they went; from anything else only `--init` starts.
#[test]
fn a_search_goes_on_from_its_own_output_alone() {
    let work = with_inputs();
    work.json("reconstruct color bright --resolution 4 --iterations 1 -o other.vdb");
    for (search, output, change, foreign) in SEARCHES {
        let refused = |words: &str, what: &str| {
            let out = work.command(&format!("{words} -o {output} --json")).output().unwrap();
            let document: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
            assert_eq!((out.status.code(), document["error"]["code"].as_str()), (Some(2), Some("output-exists")));
            assert!(document["error"]["what"].as_str().unwrap().contains(what), "{words}: {document}");
            assert!(document["error"]["do"].as_str().unwrap().contains("--init"), "{words}: {document}");
        };
        // Where it began, how far it went and what else it wrote does not count.
        work.json(&format!("{search} --iterations 1 --init {foreign} -o {output}"));
        work.json(&format!("{search} --iterations 2 --report page --resume -o {output}"));
        std::fs::create_dir(work.path("moved")).unwrap();
        std::fs::rename(work.path(output), work.path(&format!("moved/{output}"))).unwrap();
        work.json(&format!("{search} --iterations 1 --resume -o moved/{output}"));
        std::fs::rename(work.path(&format!("moved/{output}")), work.path(output)).unwrap();
        std::fs::remove_dir_all(work.path("moved")).unwrap();

        let before = std::fs::read(work.path(output)).unwrap();
        refused(&format!("{search} {change} --iterations 1 --resume"), "other settings");
        work.json(&format!("{search} {change} --iterations 1 --init {output} -o new.{output}"));
        work.refused(
            &format!("{search} --init {output} -o {output}"),
            Code::OutputIsInput,
            &["is an input of this command"],
        );
        work.refused(&format!("{search} --init {foreign} --resume -o {output}"), Code::Usage, &["cannot be used with"]);
        assert_eq!(std::fs::read(work.path(output)).unwrap(), before);
        // An edited volume is no longer what the search has left.
        if output.ends_with(".vdb") {
            work.json(&format!("convert {output} edited.vdb --half"));
            std::fs::rename(work.path("edited.vdb"), work.path(output)).unwrap();
            refused(&format!("{search} --resume"), "does not state the settings");
            std::fs::write(work.path(output), &before).unwrap();
        }
        // The same names with other content are other inputs.
        let captures = search.split(' ').map(|word| work.path(word).join("transforms.json"));
        for json in captures.filter(|json| json.exists()) {
            let text = std::fs::read_to_string(&json).unwrap();
            std::fs::write(&json, format!("{text}\n")).unwrap();
            refused(&format!("{search} --resume"), "other content");
            std::fs::write(&json, text).unwrap();
            assert_eq!(std::fs::read(work.path(output)).unwrap(), before);
        }
        let foreign = if work.path(foreign).is_dir() { format!("{foreign}/transforms.json") } else { foreign.into() };
        std::fs::copy(work.path(&foreign), work.path(output)).unwrap();
        if search.starts_with("reconstruct color") {
            refused(&format!("{search} --resume"), "other settings");
        } else {
            refused(&format!("{search} --resume"), "does not state the settings");
        }
    }
}

/// Programs have no options that exclude each other.
#[test]
fn a_search_of_the_library_begins_in_one_place() {
    let settings = PoseSettings { init: Some("a".into()), resume: true, ..PoseSettings::default() };
    let dir = tempfile::tempdir().unwrap();
    let error = PoseSettings { output: dir.path().join("p.json"), ..settings }.run(&Context::default()).unwrap_err();
    assert!(error.to_string().contains("each say where to begin"), "{error}");
}

/// Who calls the library has no command line that spares inputs; what was one before may be replaced.
#[test]
fn the_library_replaces_no_input() {
    let work = Work::new();
    let [own, other] = ["own.vdb", "other.vdb"].map(|name| work.path(name));
    std::fs::copy(fixture("cube.vdb"), &own).unwrap();
    let before = std::fs::read(&own).unwrap();
    let convert = |input: &Path, output: &Path| {
        let settings = ConvertSettings { input: input.into(), output: output.into(), ..ConvertSettings::default() };
        settings.run(&Context::default())
    };
    assert_eq!(convert(&own, &own).unwrap_err().code(), Code::OutputIsInput);
    assert_eq!(std::fs::read(&own).unwrap(), before);
    convert(&own, &other).unwrap();
    convert(&other, &own).unwrap();
}
