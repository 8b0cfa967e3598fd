//! Transfer functions: what is written is read back to the bit, ParaView's presets are understood, a VDB
//! carries one along, and faults are named.

use crate::common::grids::fog;
use crate::common::refusal;
use crate::common::work::cumulo;
use cumulo::error::Code;
use cumulo::formats::limits::Limits;
use cumulo::formats::transfer::{self, Options, Source};
use cumulo::formats::vdb::{Codec, File, write_grids};
use cumulo::scene::transfer::{Lobe, Transfer};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn report(arguments: &[&str]) -> Value {
    let out = cumulo().args(arguments).arg("--json").assert().success().get_output().stdout.clone();
    serde_json::from_slice(&out).unwrap()
}

fn write(dir: &Path, name: &str, text: impl AsRef<[u8]>) -> PathBuf {
    let path = dir.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

fn str(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn load(path: &Path) -> Transfer {
    transfer::load(path, &Options::default()).unwrap().transfer
}

fn kinds() -> Vec<Transfer> {
    let rgbs = |v: f64| [v, 1.0 - v, v / 3.0, 7.0 * v];
    vec![
        Transfer::Texture { domain: [0.0, 2.0], texels: [0.1, 0.9, 0.4].map(rgbs).to_vec() },
        Transfer::Piecewise { points: vec![[0.1, 0.2, 1.0 / 3.0, 0.0, 0.0], [0.5, 1.0, 0.0, 0.0, 1e-300], [0.5; 5]] },
        Transfer::Gaussians { domain: [-1.0, 1.0], lobes: vec![Lobe { mean: 0.6, ln_width: -2.1, rgbs: rgbs(0.3) }] },
        Transfer::Identity { domain: [0.0, 0.7], color: [0.3, 0.6, 12.5] },
    ]
}

fn presets() -> Value {
    json!([
        {
            "Name": "two tone", "ColorSpace": "RGB", "Creator": "a test", "NanColor": [1, 1, 0],
            "RGBPoints": [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.5, 0.25],
            "Points": [0.0, 0.0, 0.5, 0.0, 0.5, 0.25, 0.5, 0.0, 1.0, 0.75, 0.5, 0.0],
        },
        { "Name": "plain", "ColorSpace": "Lab", "RGBPoints": [-2, 0, 0, 0.5, 6, 1, 1, 0] },
        { "Name": "kinds of rock", "IndexedColors": [1, 0, 0, 0, 1, 0] },
    ])
}

const XML: &str = r#"<?xml version="1.0"?>
<ColorMaps>
  <!-- both kinds of opacity -->
  <ColorMap name="hot &amp; cold" space="Diverging" indexedLookup="false">
    <Point x="-1" o="1" r="0.1" g="0.2" b="0.8"/>
    <Point x="1" o="1" r="0.8" g="0.2" b="0.1"></Point>
    <NaN r="1" g="1" b="0"/>
  </ColorMap>
  <ColorMap name="veil" space="Wrapped">
    <Point x="0" o="0" r="1" g="0" b="0.1"/>
    <Point x="4" o="0.5" r="1" g="0.1" b="0"/>
  </ColorMap>
</ColorMaps>
"#;

#[test]
fn every_kind_is_written_and_read_back_to_the_bit() {
    let dir = tempfile::tempdir().unwrap();
    for t in kinds() {
        let (a, b) = (dir.path().join("a.tf.json"), dir.path().join("b"));
        transfer::save(&a, &t, Some("näme"), None).unwrap();
        assert_eq!(load(&a), t);
        // By the program: a name without an extension, with provenance.
        let said = report(&["transfer", str(&a), "-o", str(&b)]);
        assert_eq!(
            (&said["source"], &said["name"], &said["presets"]),
            (&json!("cumulo"), &json!("näme"), &json!(["näme"]))
        );
        assert_eq!(said["parameters"], t.parameters().len());
        assert_eq!(said["peak_extinction"], t.table().unwrap().peak()[3]);
        assert_eq!(said["empty_at_zero"], t.table().unwrap().at(0.0)[3] == 0.0);
        assert_eq!(load(&b), t);
        let written: Value = serde_json::from_slice(&std::fs::read(&b).unwrap()).unwrap();
        assert!(written["provenance"]["command"].as_str().unwrap().contains("transfer"), "{written}");
        assert_eq!((&written["format"], &written["version"]), (&json!("cumulo-transfer-function"), &json!(1)));
    }
}

#[test]
fn paraview_json_is_read_preset_by_preset() {
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path(), "no-extension-that-helps.exr", format!("\u{feff}  {}", presets()));
    let out = dir.path().join("out.tf.json");
    let said = report(&["transfer", str(&path), "-o", str(&out), "--unit-distance", "2"]);
    assert_eq!((&said["source"], &said["kind"]), (&json!("paraview-json"), &json!("piecewise")));
    assert_eq!(said["presets"], json!(["two tone", "plain", "kinds of rock"]));
    assert_eq!(said["range"], json!([0.0, 1.0]));
    assert_eq!(said["empty_at_zero"], true);
    let table = load(&out).table().unwrap();
    for d in [0.0, 0.2, 0.5, 0.8, 1.0_f64] {
        let alpha = if d < 0.5 { 0.5 * d } else { 0.25 + (d - 0.5) };
        let light = |v: f64| if v > 0.04045 { ((v + 0.055) / 1.055).powf(2.4) } else { v / 12.92 };
        let expected = [light(d), light(0.5 * d), light(0.25 * d), -(1.0 - alpha).ln() / 2.0];
        let got = table.at(d);
        assert!((0..4).all(|c| (got[c] - expected[c]).abs() < 2e-4), "{d}: {got:?} {expected:?}");
    }
    // Another preset, without opacities, over densities of one's own.
    let words =
        ["transfer", str(&path), "--preset", "plain", "--range", "-0.5,0.25", "--extinction", "8", "-o", str(&out)];
    let said = report(&words);
    assert_eq!((&said["name"], &said["peak_extinction"]), (&json!("plain"), &json!(8.0)));
    assert_eq!(said["range"], json!([-0.5, 0.25]));
    assert_eq!(said["empty_at_zero"], false);
    assert!(said["notes"][0].as_str().unwrap().contains("no opacities"), "{said}");
    let table = load(&out).table().unwrap();
    assert!((table.at(-0.125)[3] - 4.0).abs() < 1e-12, "halfway up");
    // One object instead of a list.
    let one = write(dir.path(), "one", presets()[1].to_string());
    assert_eq!(transfer::load(&one, &Options::default()).unwrap().name.as_deref(), Some("plain"));
    // Points in any order, as ParaView takes them.
    let turned = json!({"RGBPoints": [1, 1, 1, 1, 0, 0, 0, 0]});
    let turned = load(&write(dir.path(), "turned", turned.to_string())).table().unwrap();
    assert_eq!((turned.at(0.0), turned.at(1.0)), ([0.0; 4], [1.0; 4]));
}

#[test]
fn paraview_xml_is_read_map_by_map() {
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path(), "maps.json", XML);
    let first = transfer::load(&path, &Options::default()).unwrap();
    assert_eq!((first.source, first.name.as_deref()), (Source::ParaviewXml, Some("hot & cold")));
    assert_eq!(first.presets, ["hot & cold", "veil"]);
    assert!(first.notes[0].contains("no opacities"), "1 at each point states nothing: {:?}", first.notes);
    let table = first.transfer.table().unwrap();
    let [r, g, b, s] = table.at(0.0);
    assert!(r > 0.6 && (r - g).abs() < 0.01 && (g - b).abs() < 0.01, "white in the middle: {r} {g} {b}");
    assert_eq!(s, 0.5);
    let options = Options { preset: Some("veil".into()), ..Options::default() };
    let table = transfer::load(&path, &options).unwrap().transfer.table().unwrap();
    assert!((table.peak()[3] - 2.0_f64.ln()).abs() < 1e-12);
    assert!(table.at(2.0)[0] == 1.0 && table.at(2.0)[1] < 0.01, "the short way around the hues");
    // A document that is one map.
    let one = r#"<ColorMap space="Step"><Point x="0" r="0" g="0" b="0"/><Point x="1" r="1" g="1" b="1"/></ColorMap>"#;
    let one = transfer::load(&write(dir.path(), "one.xml", one), &Options::default()).unwrap();
    assert_eq!((one.name.as_deref(), one.transfer.table().unwrap().at(0.5)[0]), (Some("preset 1"), 1.0));
}

#[test]
fn a_vdb_carries_it_along() {
    let dir = tempfile::tempdir().unwrap();
    let to = |name: &str| dir.path().join(name);
    let (plain, with, again, out) = (to("plain.vdb"), to("with.vdb"), to("again.vdb"), to("out.tf.json"));
    write_grids(&plain, &[&fog("density", 1, 3), &fog("heat", 1, 4)], &BTreeMap::new(), Codec::Blosc, false).unwrap();
    let tf = to("a.tf.json");
    for t in kinds() {
        transfer::save(&tf, &t, None, None).unwrap();
        let done = report(&["convert", str(&plain), str(&with), "--tf", str(&tf), "--grid", "density"]);
        assert_eq!(
            (&done["grids"][0]["transfer"], &done["transfer"]["range"]),
            (&json!(true), &json!(transfer_range(&t)))
        );
        // Another conversion keeps it.
        report(&["convert", str(&with), str(&again), "--half", "--rename", "density=smoke"]);
        let said = report(&["transfer", str(&again), "-o", str(&out)]);
        assert_eq!((&said["source"], &said["presets"]), (&json!("vdb"), &json!(["smoke"])));
        assert_eq!(load(&out), t);
        let grid = File::open(&again, Limits::default()).unwrap().read_grid("smoke").unwrap();
        assert_eq!(transfer::from_metadata(&grid.metadata).unwrap(), Some(t.clone()));
    }
    let info = report(&["info", str(&again)]);
    assert_eq!(info["files"][0]["grids"][0]["transfer"]["kind"], "identity");
    let text = String::from_utf8(cumulo().args(["info", str(&again)]).output().unwrap().stdout).unwrap();
    assert!(text.contains("transfer function: identity of 1 color") && !text.contains("\"kind\""), "{text}");
    // Each grid its own; a preset of ParaView straight into the file.
    let presets = write(dir.path(), "presets", presets().to_string());
    let words =
        ["convert", str(&with), str(&again), "--tf", str(&presets), "--tf-preset", "plain", "--tf-range", "0,1"];
    assert_eq!(report(&words)["transfer"]["range"], json!([0.0, 1.0]));
    assert_eq!(report(&["transfer", str(&again)])["presets"], json!(["density"]));
    // A damaged one is told, and hides nothing else.
    let mut grid = fog("density", 1, 3);
    grid.metadata.insert(transfer::METADATA_KEY.into(), cumulo::scene::grid::MetaValue::Text("{}".into()));
    write_grids(&with, &[&grid], &BTreeMap::new(), Codec::Blosc, false).unwrap();
    let info = report(&["info", str(&with)]);
    assert!(info["files"][0]["grids"][0]["transfer"]["problem"].as_str().unwrap().contains("'format' is missing"));
    refusal::of(&["transfer", str(&with)], Code::Unsupported, &["with.vdb", "grid 'density'", "'format' is missing"]);
    refusal::of(&["transfer", str(&plain)], Code::Invalid, &["plain.vdb", "transfer function"]);
}

fn transfer_range(t: &Transfer) -> [f64; 2] {
    match t {
        Transfer::Texture { domain, .. } | Transfer::Gaussians { domain, .. } | Transfer::Identity { domain, .. } => {
            *domain
        }
        Transfer::Piecewise { points } => [points[0][0], points[points.len() - 1][0]],
        Transfer::Labels { classes } => [0, classes.len() - 1].map(|i| classes[i].label.into()),
    }
}

#[test]
fn faults_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let ours =
        |transfer: Value| json!({"format": "cumulo-transfer-function", "version": 1, "transfer": transfer}).to_string();
    let points = |points: Value| ours(json!({"kind": "piecewise", "points": points}));
    let map = |attributes: &str| format!(r#"<ColorMap name="m"><Point {attributes}/></ColorMap>"#);
    let one = |preset: Value| preset.to_string();
    for (text, code, words) in [
        (String::new(), Code::Unsupported, ["it is empty", "is expected"]),
        ("hello".into(), Code::Unsupported, ["neither JSON nor XML nor a VDB", ".tf.json"]),
        ("{\"frames\": []}".into(), Code::Unsupported, ["without 'format'", "RGBPoints"]),
        ("{\"format\": ".into(), Code::Invalid, ["no valid JSON", "line 1"]),
        (json!({"format": "other"}).to_string(), Code::Unsupported, ["'format' is \"other\"", "is expected"]),
        (
            json!({"format": "cumulo-transfer-function", "version": 3}).to_string(),
            Code::Unsupported,
            ["'version' is 3", "newer version"],
        ),
        (
            json!({"format": "cumulo-transfer-function", "version": 1}).to_string(),
            Code::Invalid,
            ["no key 'transfer'", "kind"],
        ),
        (json!({"transfer": {}}).to_string(), Code::Unsupported, ["'format' is missing", "is expected"]),
        (ours(json!({"kind": "spline"})), Code::Invalid, ["'transfer' cannot be used", "spline"]),
        (points(json!([[0, 0, 0, 0, -1]])), Code::Invalid, ["-1", "not negative"]),
        (points(json!([[1, 0, 0, 0, 1], [0, 0, 0, 0, 1]])), Code::Invalid, ["density 0 comes after 1", "ascend"]),
        (points(json!([[0, 0, 0, 1]])), Code::Invalid, ["'transfer' cannot be used", "length 4"]),
        (points(json!([])), Code::Invalid, ["0 entries", "1 to"]),
        ("[]".into(), Code::Invalid, ["list of presets is empty", ""]),
        ("[1]".into(), Code::Invalid, ["preset 1", "not a JSON object"]),
        (one(json!({"Name": 3, "RGBPoints": [0, 0, 0, 0]})), Code::Invalid, ["'Name' is 3", "a text is expected"]),
        (one(json!({"Name": "p", "RGBPoints": [0, 0, 0]})), Code::Invalid, ["preset 'p'", "'RGBPoints' has 3 numbers"]),
        (one(json!({"RGBPoints": []})), Code::Invalid, ["'RGBPoints' has 0 numbers", "density, red"]),
        (
            one(json!({"RGBPoints": [0, 0, "x", 0]})),
            Code::Invalid,
            ["'RGBPoints' is [0,0,\"x\",0]", "a list of numbers"],
        ),
        (one(json!({"RGBPoints": [0, 0, 255, 0]})), Code::Invalid, ["green of 255", "from 0 to 1"]),
        (
            one(json!({"RGBPoints": [0, 0, 0, 0], "Points": [0, 0, 0]})),
            Code::Invalid,
            ["'Points' has 3 numbers", "midpoint"],
        ),
        (
            one(json!({"RGBPoints": [0, 0, 0, 0], "Points": [0, 2, 0.5, 0]})),
            Code::Invalid,
            ["an opacity of 2", "from 0 to 1"],
        ),
        (
            one(json!({"RGBPoints": [0, 0, 0, 0], "ColorSpace": "Oklab"})),
            Code::Unsupported,
            ["color space 'Oklab'", "Diverging"],
        ),
        (one(json!({"RGBPoints": [0, 0, 0, 0], "UseLogScale": 1})), Code::Unsupported, ["logarithmic", "switch"]),
        (one(json!({"RGBPoints": [-1e308, 0, 0, 0, 1e308, 0, 0, 0]})), Code::Invalid, ["too wide a range", ""]),
        (one(json!({"IndexedColors": [0, 0, 0]})), Code::Unsupported, ["for categories", "RGBPoints"]),
        (one(json!({"Points": [0, 0, 0.5, 0]})), Code::Invalid, ["no key 'RGBPoints'", "lists the colors"]),
        ("<a><b></a>".into(), Code::Invalid, ["no valid XML", "byte"]),
        ("<a><b>".into(), Code::Invalid, ["ends within an element", "cut off"]),
        ("<svg/>".into(), Code::Unsupported, ["without a 'ColorMap'", "is expected"]),
        (map(r#"x="0" r="1" g="1""#), Code::Invalid, ["point 0 has no attribute 'b'", "byte"]),
        (map(r#"x="0" r="1" g="1" b="blue""#), Code::Invalid, ["attribute 'b' is \"blue\"", "a number"]),
        (map(r#"x="inf" r="1" g="1" b="1""#), Code::Invalid, ["density inf", "preset 'm'"]),
        (map(r#"x="0" r="1" g="1" b="1" o="-3""#), Code::Invalid, ["an opacity of -3", "from 0 to 1"]),
        (map(r#"x="0" x="1""#), Code::Invalid, ["no valid XML", "duplicate"]),
        (map(r#"x="&lots;""#), Code::Invalid, ["no valid XML", "lots"]),
        (r#"<ColorMap name="m"/>"#.into(), Code::Invalid, ["preset 'm'", "no color points"]),
        (
            r#"<ColorMap name="m" indexedLookup="1"><Point r="1"/></ColorMap>"#.into(),
            Code::Unsupported,
            ["for categories", "another"],
        ),
    ] {
        let path = write(dir.path(), "fault", &text);
        refusal::of(&["transfer", str(&path)], code, &["fault", words[0], words[1]]);
    }
    let latin = write(dir.path(), "latin", b"<ColorMap name=\"\xe9\"/>");
    refusal::of(&["transfer", str(&latin)], Code::Unsupported, &["latin", "UTF-8"]);
    refusal::of(&["transfer", str(dir.path())], Code::Unsupported, &["folder"]);
    refusal::of(&["transfer", str(&dir.path().join("none"))], Code::NotFound, &["none"]);
    let large = std::fs::File::create(dir.path().join("large")).unwrap();
    large.set_len(1 << 26).unwrap();
    refusal::of(&["transfer", str(&dir.path().join("large"))], Code::Invalid, &["large", "too many"]);
}

#[test]
fn options_that_do_not_fit_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let ours = dir.path().join("ours.tf.json");
    transfer::save(&ours, &kinds()[3], None, None).unwrap();
    let presets = write(dir.path(), "presets", presets().to_string());
    for (path, words, code, fact) in [
        (&ours, &["--unit-distance", "2"][..], Code::Invalid, "a unit distance of 2"),
        (&ours, &["--extinction", "2"], Code::Invalid, "an extinction of 2"),
        (&ours, &["--preset", "x"], Code::Invalid, "has none"),
        (&presets, &["--preset", "x"], Code::Invalid, "'two tone', 'plain', 'kinds of rock'"),
        (&presets, &["--preset", "kinds of rock"], Code::Unsupported, "for categories"),
        (&presets, &["--extinction", "2"], Code::Invalid, "preset 'two tone'"),
        (&presets, &["--preset", "plain", "--unit-distance", "2"], Code::Invalid, "has no opacities"),
        (&presets, &["--range", "1,0"], Code::Usage, "do not ascend"),
        (&presets, &["--unit-distance", "0"], Code::Usage, "above zero"),
        (&presets, &["-o", "no/such/folder/x.tf.json"], Code::NotFound, "no/such/folder/x.tf.json"),
    ] {
        refusal::of(&[&["transfer", str(path)], words].concat(), code, &[fact]);
    }
    refusal::of(&["convert", "a.vdb", "b.vdb", "--tf-range", "0,1"], Code::Usage, &["--tf"]);
}

#[test]
fn damaged_files_are_read_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cut");
    let ours = dir.path().join("ours.tf.json");
    transfer::save(&ours, &kinds()[1], Some("a"), None).unwrap();
    let json = serde_json::to_string_pretty(&presets()).unwrap();
    let texts = [std::fs::read(&ours).unwrap(), json.into_bytes(), XML.as_bytes().to_vec()];
    let mut state = 20_261_u64;
    for text in &texts {
        let whole = text.trim_ascii_end().len();
        for length in 0..whole {
            std::fs::write(&path, &text[..length]).unwrap();
            assert!(transfer::load(&path, &Options::default()).is_err(), "{length} of {whole} bytes");
        }
        for _ in 0..1000 {
            let mut bytes = text.clone();
            for _ in 0..3 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let (at, what) = ((state >> 33) as usize % bytes.len(), (state >> 20) as usize);
                bytes[at] = b"0919-eE.\"<>{}[],&;/ \0\xff"[what % 22];
            }
            std::fs::write(&path, &bytes).unwrap();
            // Read or refused; a panic fails the test.
            let _ = transfer::load(&path, &Options::default());
        }
        // The exit code, for a few.
        for length in [1, whole / 3, whole / 2, whole - 1] {
            std::fs::write(&path, &text[..length]).unwrap();
            refusal::of(&["transfer", str(&path)], Code::Invalid, &["cut"]);
        }
    }
    // A VDB that carries one, cut anywhere.
    let (plain, vdb) = (dir.path().join("plain.vdb"), dir.path().join("with.vdb"));
    write_grids(&plain, &[&fog("density", 1, 3)], &BTreeMap::new(), Codec::Blosc, false).unwrap();
    report(&["convert", str(&plain), str(&vdb), "--tf", str(&ours)]);
    let bytes = std::fs::read(&vdb).unwrap();
    for length in (0..bytes.len()).step_by(bytes.len() / 50) {
        std::fs::write(&path, &bytes[..length]).unwrap();
        assert!(transfer::load(&path, &Options::default()).is_err(), "{length} bytes of a VDB");
    }
    refusal::of(&["transfer", str(&path)], Code::Invalid, &["cut"]);
}

#[test]
fn hostile_files_take_no_longer_than_their_size() {
    let dir = tempfile::tempdir().unwrap();
    let start = std::time::Instant::now();
    let many = |text: &str, n: usize| text.repeat(n);
    let points: String = (0..60_000).map(|i| format!("{i},0,{},0,", i % 2)).collect();
    for text in [
        many("[", 1 << 20),
        many("{\"format\":", 1 << 20),
        many("<a>", 1 << 20),
        format!("<ColorMap {}/>", (0..200_000).map(|i| format!("a{i}='' ")).collect::<String>()),
        format!("<ColorMaps>{}</ColorMaps>", many("<ColorMap name='x'/>", 1 << 17)),
        format!("{{\"RGBPoints\":[{}0,0,0,0],\"Points\":[{}0,0,0.5,0.5]}}", points, points),
        format!("{{\"RGBPoints\":[{}0]}}", many("0,", 1 << 22)),
        format!("[{}{{}}]", many("{},", 1 << 20)),
        format!("{{{}\"RGBPoints\":[0,0,0,0]}}", many("\"a\":0,", 1 << 20)),
    ] {
        let path = write(dir.path(), "hostile", text);
        let _ = transfer::load(&path, &Options::default());
    }
    // About two seconds; what is quadratic would take hours.
    assert!(start.elapsed().as_secs() < 60, "{:?}", start.elapsed());
}
