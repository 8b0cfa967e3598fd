//! Every error says which file, what was found and what to do: thousands of damaged captures, transfer
//! functions and pictures, made from sound ones with a seed, go through the readers.

use crate::common::random::Random;
use cumulo::error::{Error, Kind};
use cumulo::formats::exr::deep;
use cumulo::formats::limits::Limits;
use cumulo::formats::transfer::{self, Options};
use cumulo::formats::{captures, exr, transforms};
use cumulo::text::acts;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// What was seen of the errors of one kind of file.
#[derive(Default)]
struct Seen {
    refused: usize,
    /// What was found, without digits.
    found: BTreeSet<String>,
    remedies: BTreeSet<String>,
}

impl Seen {
    fn check(&mut self, error: &Error, path: &Path) {
        let text = error.to_string();
        assert!(text.starts_with(&format!("{}: ", path.display())), "no file: {text}");
        assert!(error.what().len() > 5, "nothing found: {text}");
        let remedy = error.remedy().unwrap_or_default();
        assert!(remedy.len() > 10 && remedy != error.what(), "no remedy: {text}");
        assert_eq!(text.lines().count(), 2, "{text}");
        assert!(!text.contains(|c| acts(c) && c != '\n'), "control characters: {text}");
        assert!(text.len() < 3000, "{} bytes: {text}", text.len());
        // Neither may send the reader round in a circle, to what was tried already.
        assert!(!remedy.contains("raise `max_memory`") || error.what().contains("MiB"), "{text}");
        self.refused += 1;
        self.found.insert(error.what().replace(|c: char| c.is_ascii_digit(), "").chars().take(24).collect());
        self.remedies.insert(remedy.into_owned());
    }
}

/// A value that stands where another is expected.
fn odd(random: &mut Random) -> Value {
    let all = [
        json!(null),
        json!(true),
        json!(-1),
        json!(0),
        json!(0.5),
        json!(1e308),
        json!(-1e308),
        json!(70_000),
        json!(""),
        json!("1"),
        json!("x\u{1b}]0;title\u{7}\u{9b}2J\u{202e}\nforged: line"),
        json!([]),
        json!([1]),
        json!([1, 2, 3]),
        json!([-1, 2, 3]),
        json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]]),
        json!({}),
        json!({"kind": "texture"}),
        json!({"x": [{}]}),
    ];
    random.of(&all).clone()
}

/// All places in a document, as JSON pointers.
fn places(value: &Value, at: &str, all: &mut Vec<String>) {
    all.push(at.to_owned());
    match value {
        Value::Object(map) => map.iter().for_each(|(k, v)| places(v, &format!("{at}/{k}"), all)),
        Value::Array(list) => list.iter().enumerate().for_each(|(i, v)| places(v, &format!("{at}/{i}"), all)),
        _ => {}
    }
}

/// The text of a document with one to three faults.
fn damaged_json(sound: &Value, random: &mut Random) -> Vec<u8> {
    let mut value = sound.clone();
    for _ in 0..1 + random.below(3) {
        let mut all = Vec::new();
        places(&value, "", &mut all);
        let place = random.of(&all).clone();
        let (parent, key) = place.rsplit_once('/').unwrap_or(("", ""));
        let fault = random.below(4);
        match value.pointer_mut(parent) {
            Some(Value::Object(map)) if fault == 0 => drop(map.remove(key)),
            Some(Value::Array(list)) if fault == 0 => drop(list.pop()),
            Some(Value::Array(list)) if fault == 1 => list.push(odd(random)),
            _ => *value.pointer_mut(&place).unwrap() = odd(random),
        }
    }
    damaged_text(serde_json::to_string(&value).unwrap(), random)
}

/// Now and then a text is cut off, or one of its bytes is another one.
fn damaged_text(text: String, random: &mut Random) -> Vec<u8> {
    let mut bytes = text.into_bytes();
    match random.below(8) {
        0 => bytes.truncate(random.below(bytes.len() + 1)),
        1 if !bytes.is_empty() => {
            let at = random.below(bytes.len());
            bytes[at] = *random.of(b"\0\x1b\xff{}[]<>\",:&;-9e ");
        }
        _ => {}
    }
    bytes
}

fn rounds() -> usize {
    std::env::var("CUMULO_FUZZ_ROUNDS").ok().and_then(|v| v.parse().ok()).unwrap_or(3000)
}

#[test]
fn damaged_captures() {
    let frame = |x: f64| {
        json!({
            "file_path": "view.exr", "w": 8, "h": 6, "fl_x": 9.0, "fl_y": 9.0, "cx": 4.0, "cy": 3.0, "near": 0.1,
            "camera_model": "PINHOLE", "k1": 0.0,
            "transform_matrix": [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]],
        })
    };
    let sound = json!({
        "frames": [frame(0.0), frame(1.0)], "camera_angle_x": 0.5, "model": "emission-absorption",
        "background": [1, 0.5, 0], "pixel_filter": "box", "density_scale": 2, "emission": [1, 1, 1],
        "emission_model": "linear", "lattice": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        "transfer": {"kind": "piecewise", "points": [[0, 1, 1, 1, 0], [1, 0, 0, 0, 2]]},
    });
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("transforms.json");
    std::fs::write(&path, sound.to_string()).unwrap();
    transforms::load(&path).unwrap();
    let (mut random, mut seen) = (Random(16), Seen::default());
    for _ in 0..rounds() {
        std::fs::write(&path, damaged_json(&sound, &mut random)).unwrap();
        let loaded = transforms::load(&path);
        if let Err(error) = &loaded {
            seen.check(error, &path);
        }
        for problem in captures::problems(&path).unwrap() {
            assert!(problem.what.len() > 5 && problem.remedy.len() > 10, "{problem}");
            assert_eq!(problem.to_string().lines().count(), 2, "{problem}");
        }
    }
    assert!(seen.refused > rounds() / 2, "{} refused", seen.refused);
    assert!(seen.found.len() > 40 && seen.remedies.len() > 20, "{:#?}\n{:#?}", seen.found, seen.remedies);
}

#[test]
fn damaged_transfer_functions() {
    let ours = |transfer: Value| {
        json!({"format": transfer::FORMAT, "version": 1, "name": "n", "transfer": transfer}).to_string()
    };
    let documents: Vec<String> = vec![
        ours(json!({"kind": "texture", "domain": [0, 1], "texels": [[1, 1, 1, 0], [0, 0, 0, 2]]})),
        ours(json!({"kind": "piecewise", "points": [[0, 1, 1, 1, 0], [1, 0, 0, 0, 2]]})),
        ours(json!({"kind": "gaussians", "domain": [0, 1],
            "lobes": [{"mean": 0.5, "ln_width": -1, "rgbs": [1, 1, 1, 2]}]})),
        ours(json!({"kind": "identity", "domain": [0, 1], "color": [1, 0.5, 0]})),
        json!([{"Name": "a", "ColorSpace": "Lab", "HSVWrap": 0, "UseLogScale": 0,
            "RGBPoints": [0, 1, 0, 0, 1, 0, 0, 1], "Points": [0, 0, 0.5, 0, 1, 0.9, 0.5, 0]},
            {"Name": "b", "RGBPoints": [0, 1, 0, 0, 1, 0, 0, 1]}])
        .to_string(),
        json!({"Name": "c", "IndexedColors": [1, 0, 0]}).to_string(),
        "<ColorMaps><ColorMap name=\"a\" space=\"HSV\"><Point x=\"0\" o=\"0.1\" r=\"1\" g=\"0\" b=\"0\"/>\
         <Point x=\"1\" o=\"0.5\" r=\"0\" g=\"0\" b=\"1\"/></ColorMap>\
         <ColorMap name=\"k\" indexedLookup=\"1\"><Point r=\"1\" g=\"0\" b=\"0\"/></ColorMap></ColorMaps>"
            .into(),
    ];
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("f.tf.json");
    let (mut random, mut seen) = (Random(17), Seen::default());
    let options = |random: &mut Random| Options {
        preset: [None, None, None, Some("a"), Some("k"), Some("\u{1b}[2J\nno")][random.below(6)].map(str::to_owned),
        range: [None, None, Some([0.0, 2.0]), Some([1.0, 1.0]), Some([f64::NAN, 1.0])][random.below(5)],
        unit_distance: [None, None, None, Some(2.0), Some(0.0)][random.below(5)],
        extinction: [None, None, None, Some(2.0), Some(f64::INFINITY)][random.below(5)],
        limits: Limits::default(),
    };
    for _ in 0..rounds() {
        let document = random.of(&documents).clone();
        let bytes = match serde_json::from_str::<Value>(&document) {
            Ok(sound) => damaged_json(&sound, &mut random),
            Err(_) => damaged_xml(&document, &mut random),
        };
        std::fs::write(&path, bytes).unwrap();
        if let Err(error) = transfer::load(&path, &options(&mut random)) {
            seen.check(&error, &path);
        }
    }
    assert!(seen.refused > rounds() / 2, "{} refused", seen.refused);
    assert!(seen.found.len() > 40 && seen.remedies.len() > 20, "{:#?}\n{:#?}", seen.found, seen.remedies);
}

/// The document with another value of an attribute, without one of its words, or with a byte changed.
fn damaged_xml(sound: &str, random: &mut Random) -> Vec<u8> {
    let mut words: Vec<String> = sound.split(' ').map(str::to_owned).collect();
    let at = random.below(words.len());
    match random.below(3) {
        0 => drop(words.remove(at)),
        1 => {
            words[at] =
                words[at].replace(['0', '1'], random.of::<&str>(&["", "nan", "1e999", "-7", "300", "&#27;", "&no;"]))
        }
        _ => {}
    }
    damaged_text(words.join(" "), random)
}

#[test]
fn damaged_pictures() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/exr");
    let files = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let mut files: Vec<PathBuf> = files.filter(|p| p.extension().is_some_and(|e| e == "exr")).collect();
    files.sort();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged.exr");
    let (mut random, mut seen) = (Random(18), Seen::default());
    for _ in 0..rounds() / 4 {
        let mut bytes = std::fs::read(random.of(&files)).unwrap();
        let reach = bytes.len().min(700);
        for _ in 0..1 + random.below(3) {
            let at = random.below(reach);
            bytes[at] = random.next() as u8;
        }
        if random.below(5) == 0 {
            bytes.truncate(random.below(bytes.len()));
        }
        std::fs::write(&path, &bytes).unwrap();
        let layer = *random.of(&[None, None, None, Some("Depth"), Some("none\u{1b}[2J")]);
        let limits = Limits { max_memory: *random.of(&[1 << 33, 1 << 33, 1 << 12]) };
        if let Err(error) = exr::picture_within(&path, layer, limits) {
            seen.check(&error, &path);
        }
        if let Err(error) = exr::summary_within(&path, limits) {
            seen.check(&error, &path);
        }
        if deep::is_deep(&path)
            && let Err(error) = deep::summary_within(&path, limits)
        {
            seen.check(&error, &path);
        }
    }
    assert!(seen.refused > rounds() / 8, "{} refused", seen.refused);
    assert!(seen.found.len() > 15 && seen.remedies.len() > 5, "{:#?}\n{:#?}", seen.found, seen.remedies);
}

/// What a feature needs is said for this feature.
#[test]
fn unsupported_pictures_are_told_what_helps() {
    let fixture = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/exr").join(name);
    let remedy = |path: &Path| exr::read_picture(path, None).unwrap_err().remedy().unwrap().into_owned();
    assert!(remedy(&fixture("deep.exr")).contains("convert.flatten"));
    assert!(remedy(&fixture("htj2k32.exr")).contains("OpenEXR 3.4"));
    // Sampling rates stand after the name, the type and 4 bytes of flags in the list of channels.
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("chroma.exr");
    let mut bytes = std::fs::read(fixture("grey.exr")).unwrap();
    let at = bytes.windows(6).position(|w| w == b"Y\0\x01\0\0\0").unwrap() + 10;
    bytes[at..at + 8].copy_from_slice(&[2, 0, 0, 0, 2, 0, 0, 0]);
    std::fs::write(&path, bytes).unwrap();
    let chroma = remedy(&path);
    assert!(chroma.contains("full resolution") && chroma.contains("OpenImageIO 3.0"), "{chroma}");
}

#[test]
fn errors_of_the_system() {
    let dir = tempfile::tempdir().unwrap();
    let mut seen = Seen::default();
    let mut check = |path: &Path, kind: Kind| {
        for error in [
            transforms::load(path).unwrap_err(),
            transfer::load(path, &Options::default()).unwrap_err(),
            exr::read_picture(path, None).unwrap_err(),
            exr::summary(path).unwrap_err(),
        ] {
            assert_eq!(error.kind(), kind, "{error}");
            seen.check(&error, path);
        }
    };
    check(&dir.path().join("none.json"), Kind::Io);
    let file = dir.path().join("file");
    std::fs::write(&file, "x").unwrap();
    check(&file.join("below.json"), Kind::Io);
    #[cfg(unix)]
    {
        check(Path::new("/dev/zero"), Kind::Invalid);
        let socket = dir.path().join("socket");
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        check(&socket, Kind::Invalid);
        // Names of 256 bytes are longer than file systems allow.
        check(&dir.path().join("n".repeat(256)), Kind::Io);
    }
}
