//! OpenEXR files: our own round trip, every layout that other software writes, damaged files.

use crate::common::refusal;
use crate::common::work::fixture;
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::formats::limits::Limits;
use cumulo::scene::film::{Film, Plane};
use std::path::Path;

fn film(width: usize, height: usize) -> Film {
    let rgba = (0..width * height)
        .map(|i| {
            let v = i as f32;
            [v * 0.37, (v * 0.1).sin(), -v / 3.0, 1.0 / (1.0 + v)]
        })
        .collect();
    Film::of(width, height, rgba)
}

#[test]
fn a_written_picture_is_read_back_to_the_bit() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    for (width, height) in [(1, 1), (17, 5), (64, 48), (3, 100)] {
        let film = film(width, height);
        let attributes = [("cumulo:plan", "größe"), ("software", "cumulo test")];
        let attributes = attributes.map(|(k, v)| (k.to_string(), v.to_string())).into_iter().collect();
        exr::write_picture(&path, &film, &attributes, exr::Half::None).unwrap();
        assert_eq!(exr::read_picture(&path, None).unwrap(), film);
        let image = exr::read(&path).unwrap();
        assert_eq!((image.width, image.height), (width, height));
        assert_eq!(image.attributes["cumulo:plan"], "größe");
        assert_eq!(image.attributes["software"], "cumulo test");
        let names: Vec<&str> = image.layers[0].channels.iter().map(|c| c.name.as_str()).collect();
        assert_eq!((image.layers.len(), names), (1, vec!["A", "B", "G", "R"]));
    }
}

#[test]
fn planes_are_written_and_read_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("planes.exr");
    let plane = |name: &str, v: f32| Plane { name: name.into(), samples: (0..35).map(|i| v * i as f32).collect() };
    let mut picture = film(7, 5);
    picture.planes = vec![plane("Z", 0.5), plane("variance.B", -2.0), plane("variance.R", 0.1)];
    exr::write_picture(&path, &picture, &Default::default(), exr::Half::None).unwrap();
    let mut found = exr::read_film_within(&path, None, Default::default()).unwrap();
    found.planes.sort_by(|a, b| a.name.cmp(&b.name));
    assert_eq!(found, picture);
    assert_eq!(found.plane("variance.R"), Some(&picture.planes[2].samples[..]));
    assert_eq!(exr::read_picture(&path, None).unwrap().rgba, picture.rgba);
    // A layer of planes is a picture to whoever names it.
    assert!(exr::read_picture(&path, Some("variance")).is_err(), "two channels are no picture");
    for (planes, word) in [
        (vec![plane("R", 1.0)], "'R'"),
        (vec![plane("a", 1.0), plane("a", 2.0)], "'a'"),
        (vec![plane("ä", 1.0)], "'ä'"),
        (vec![Plane { name: "short".into(), samples: vec![0.0; 3] }], "3 samples for 35 pixels"),
    ] {
        picture.planes = planes;
        let error = exr::write_picture(&path, &picture, &Default::default(), exr::Half::None).unwrap_err();
        refusal::is(&error, Code::Invalid, &[word]);
    }
    assert_eq!(exr::read_film_within(&path, None, Default::default()).unwrap().planes.len(), 3, "the file stands");
}

#[test]
fn half_floats_are_rounded_and_refuse_what_does_not_fit() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    let mut film = film(20, 10);
    exr::write_picture(&path, &film, &Default::default(), exr::Half::All).unwrap();
    let back = exr::read_picture(&path, None).unwrap();
    for (a, b) in film.rgba.iter().flatten().zip(back.rgba.iter().flatten()) {
        // 11 significant bits; subnormals below 2^-14 are spaced by 2^-24.
        assert!((a - b).abs() <= (a.abs() * 2_f32.powi(-11)).max(2_f32.powi(-25)), "{a} {b}");
    }
    film.rgba[3][1] = 7e4;
    let error = exr::write_picture(&path, &film, &Default::default(), exr::Half::All).unwrap_err();
    refusal::is(&error, Code::Invalid, &["a.exr", "65504"]);
}

#[test]
fn what_cannot_be_written_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    let refused = |film: &Film, name: &str, word: &str| {
        let attributes = [(name.to_string(), String::new())].into();
        let error = exr::write_picture(&path, film, &attributes, exr::Half::None).unwrap_err();
        refusal::is(&error, Code::Invalid, &[word]);
        assert!(!path.exists());
    };
    refused(&Film::new(0, 4), "x", "0x4");
    refused(&Film::of(2, 2, vec![]), "x", "0 pixels");
    refused(&film(2, 2), "channels", "'channels'");
    refused(&film(2, 2), "", "attribute");
    refused(&film(2, 2), &"n".repeat(256), "attribute");
    let nowhere = dir.path().join("no/such/a.exr");
    assert!(exr::write_picture(&nowhere, &film(2, 2), &Default::default(), exr::Half::None).is_err());
}

#[test]
fn other_files_are_no_openexr() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    for bytes in [&b""[..], b"v/1", b"\x89PNG\r\n\x1a\n", b"v/1\x01\x02\0\0\0"] {
        std::fs::write(&path, bytes).unwrap();
        refusal::is(&exr::read(&path).unwrap_err(), Code::Invalid, &["a.exr", "OpenEXR"]);
    }
    assert!(exr::header(Path::new("/no/such.exr")).unwrap_err().io_kind().is_some());
    assert!(exr::read(dir.path()).is_err(), "a folder");
}

/// Channel `c` of every fixture at pixel (x, y) in the display's coordinates; exact as a half.
fn value(c: usize, x: i64, y: i64) -> f32 {
    c as f32 + (x.rem_euclid(16) + 16 * y.rem_euclid(16)) as f32 / 256.0
}

/// Compares a film with `value` inside the data window and with nothing outside. `alpha`: from the
/// fourth channel, else 1.
fn check(name: &str, film: &Film, display: [i64; 4], data: [i64; 4], first: usize, alpha: bool, tolerance: f32) {
    assert_eq!((film.width as i64, film.height as i64), (display[2], display[3]), "{name}");
    for y in 0..film.height as i64 {
        for x in 0..film.width as i64 {
            let (px, py) = (x + display[0], y + display[1]);
            let inside = px >= data[0] && py >= data[1] && px < data[0] + data[2] && py < data[1] + data[3];
            let v = |c: usize| value(first + c, px, py);
            let expected = match (inside, alpha) {
                (false, _) => [0.0; 4],
                (true, true) => [v(0), v(1), v(2), v(3)],
                (true, false) => [v(0), v(1), v(2), 1.0],
            };
            let found = film.rgba[(y * display[2] + x) as usize];
            for (f, e) in found.iter().zip(expected) {
                assert!((f - e).abs() <= tolerance, "{name} at ({x}, {y}): {found:?}, expected {expected:?}");
            }
        }
    }
}

#[test]
fn layouts_of_other_software_are_understood() {
    let whole = [0, 0, 24, 10];
    let picture = |name: &str, layer: Option<&str>| exr::picture(&fixture("exr").join(name), layer).unwrap();

    let blender = picture("blender.exr", None);
    assert_eq!(blender.layer, "Composite.Combined");
    check("blender", &blender.film, whole, whole, 0, true, 0.0);
    for name in ["ViewLayer.Combined", "viewlayer.combined"] {
        check("blender", &picture("blender.exr", Some(name)).film, whole, whole, 4, true, 0.0);
    }
    assert_eq!(
        picture("blender.exr", Some("Depth")).film.rgba[25],
        [100.0 + 17.0 / 256.0, 100.0 + 17.0 / 256.0, 100.0 + 17.0 / 256.0, 1.0]
    );
    let error = exr::read_picture(&fixture("exr/blender.exr"), Some("Combined")).unwrap_err();
    let layers = ["blender.exr", "'Combined'", "'Composite.Combined'", "'ViewLayer.Combined'", "'ViewLayer.Depth'"];
    refusal::is(&error, Code::NoSuchLayer, &layers);

    let parts = picture("multipart.exr", None);
    assert_eq!(parts.layer, "ViewLayer.Combined");
    check("multipart", &parts.film, whole, whole, 0, true, 0.0);
    check("multipart", &picture("multipart.exr", Some("Normal")).film, whole, whole, 0, false, 0.0);
    let depth = picture("multipart.exr", Some("ViewLayer.Depth")).film;
    assert_eq!((depth.rgba[0], depth.rgba[2 * 24 + 4][0]), ([0.0; 4], value(0, 4, 2)));

    let houdini = picture("houdini.exr", None);
    assert_eq!(houdini.layer, "C");
    check("houdini", &houdini.film, whole, whole, 0, false, 0.0);

    for name in ["nuke.exr", "nuke_parts.exr"] {
        let nuke = picture(name, None);
        assert_eq!(nuke.layer, "rgba");
        check(name, &nuke.film, whole, [-3, 4, 20, 9], 0, true, 0.0);
        let header = exr::header(&fixture("exr").join(name)).unwrap();
        assert_eq!((header.data_window.min, header.data_window.size), ([-3, 4], [20, 9]));
        let layers: Vec<String> = header.layers().into_iter().map(|l| l.name).collect();
        assert_eq!(layers.iter().filter(|l| ["rgba", "depth"].contains(&l.as_str())).count(), layers.len());
    }
    check("overscan", &picture("overscan.exr", None).film, [-2, 5, 24, 10], [-20, -8, 70, 40], 0, false, 0.0);
    for name in ["tiled.exr", "mipmap.exr"] {
        check(name, &picture(name, None).film, [0, 0, 37, 21], [0, 0, 37, 21], 0, true, 0.0);
    }
}

#[test]
fn every_compression_is_read() {
    let whole = [0, 0, 20, 40];
    for name in ["no", "rle", "zips", "zip", "piz", "pxr24"] {
        let film = exr::read_picture(&fixture(&format!("exr/{name}.exr")), None).unwrap();
        check(name, &film, whole, whole, 0, true, 0.0);
    }
    for (name, tolerance) in [
        // Lossy, and these are the worst cases for them: a pattern that jumps by 1 in values up to 4.
        // OpenEXR's own decoder is off by as much; twice what was measured (1/85 and 1/64) is allowed, an
        // order below the pattern's jumps, which a misplaced block or channel would show.
        ("b44", 1.0 / 42.0),
        ("b44a", 1.0 / 42.0),
        ("dwaa", 1.0 / 32.0),
        ("dwab", 1.0 / 32.0),
    ] {
        let film = exr::read_picture(&fixture(&format!("exr/{name}.exr")), None).unwrap();
        check(name, &film, whole, whole, 0, true, tolerance);
    }
}

#[test]
fn grey_uint_and_camera_files() {
    let grey = exr::read_picture(&fixture("exr/grey.exr"), None).unwrap();
    let v = value(0, 3, 2);
    assert_eq!(grey.rgba[2 * 20 + 3], [v, v, v, 1.0]);
    let ids = exr::read(&fixture("exr/uint.exr")).unwrap();
    assert_eq!((ids.layers[0].channels[0].name.as_str(), ids.layers[0].channels[0].samples[799]), ("id", 799.0));
    let camera = exr::read(&fixture("exr/camera.exr")).unwrap();
    assert!(camera.attributes["worldToCamera"].starts_with("0 1 2 3 4"), "{:?}", camera.attributes);
    assert_eq!(camera.attributes["comments"], "none of these is a camera's");
    assert!(!camera.attributes.contains_key("dataWindow"));
}

#[test]
fn not_a_number_is_counted() {
    let picture = exr::picture(&fixture("exr/nan.exr"), None).unwrap();
    assert_eq!(picture.non_finite, 3);
    assert!(picture.film.rgba[3 * 20 + 5][0].is_nan());
    let image = exr::read(&fixture("exr/nan.exr")).unwrap();
    let counts: Vec<(&str, usize)> = image.layers[0].channels.iter().map(|c| (c.name.as_str(), c.non_finite)).collect();
    assert_eq!(counts, [("A", 1), ("B", 0), ("G", 1), ("R", 1)]);
}

#[test]
fn what_is_not_supported_is_named() {
    let unsupported = |path: &Path, what: &str| refusal::is(&exr::read(path).unwrap_err(), Code::Unsupported, &[what]);
    unsupported(&fixture("exr/deep.exr"), "deep OpenEXR picture");
    unsupported(&fixture("exr/htj2k32.exr"), "j2k");
    // Sampling rates stand after the name, the type and 4 bytes of flags in the list of channels.
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("subsampled.exr");
    let mut bytes = std::fs::read(fixture("exr/grey.exr")).unwrap();
    let at = bytes.windows(6).position(|w| w == b"Y\0\x01\0\0\0").unwrap() + 10;
    bytes[at..at + 8].copy_from_slice(&[2, 0, 0, 0, 2, 0, 0, 0]);
    std::fs::write(&path, bytes).unwrap();
    unsupported(&path, "subsampl");
}

/// The crate's own multi-layer writer, as a third opinion beside OpenEXR and OpenImageIO.
#[test]
fn files_of_the_crates_own_writer_are_read() {
    use ::exr::prelude::{
        AnyChannel, AnyChannels, FlatSamples, Image, Layer, LayerAttributes, SmallVec, WritableImage,
    };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("layers.exr");
    let layer = |name: &str, channels: &[&str], at: f32| {
        let list: SmallVec<[AnyChannel<FlatSamples>; 4]> = channels
            .iter()
            .enumerate()
            .map(|(c, n)| {
                AnyChannel::new(*n, FlatSamples::F32((0..6).map(|i| at + c as f32 + i as f32 / 8.0).collect()))
            })
            .collect();
        let encoding = ::exr::image::Encoding::FAST_LOSSLESS;
        Layer::new((3, 2), LayerAttributes::named(name), encoding, AnyChannels::sort(list))
    };
    let layers: SmallVec<[Layer<AnyChannels<FlatSamples>>; 2]> = [
        layer("left", &["R", "G", "B"], 0.0),
        layer("right", &["diffuse.R", "diffuse.G", "diffuse.B"], 10.0),
        layer("normal", &["X", "Y", "Z"], 20.0),
    ]
    .into_iter()
    .collect();
    let attributes = ::exr::prelude::ImageAttributes::with_size((3, 2));
    Image::from_layers(attributes, layers).write().to_file(&path).unwrap();
    let film = exr::read_picture(&path, Some("right.diffuse")).unwrap();
    assert_eq!(film.rgba[5], [10.625, 11.625, 12.625, 1.0]);
    // What the picture holds is no plane beside it.
    let film = exr::read_film_within(&path, Some("normal"), Limits::default()).unwrap();
    assert_eq!(film.rgba[5], [20.625, 21.625, 22.625, 1.0]);
    let names: Vec<&str> = film.planes.iter().map(|plane| &plane.name[..]).collect();
    let others = ["left.B", "left.G", "left.R", "right.diffuse.B", "right.diffuse.G", "right.diffuse.R"];
    assert_eq!(names, others);
    // 96 bytes of film, 216 of planes, and the chunks while they are decoded.
    let error = exr::read_film_within(&path, Some("normal"), Limits { max_memory: 300 }).unwrap_err();
    refusal::is(&error, Code::MemoryLimit, &["layers.exr", "`max_memory`"]);
    let error = exr::read_picture(&path, None).unwrap_err();
    refusal::is(&error, Code::Invalid, &["'left'", "'right.diffuse'", "`layer`"]);
}

#[test]
fn summaries_say_what_is_in_a_file() {
    let text = exr::summary(&fixture("exr/blender.exr")).unwrap().to_string();
    for word in ["24x10", "zip", "'Composite.Combined'", "'ViewLayer.Depth'", "half", "float", "mean"] {
        assert!(text.contains(word), "'{word}' is not in: {text}");
    }
    let camera = serde_json::to_value(exr::summary(&fixture("exr/camera.exr")).unwrap()).unwrap();
    assert_eq!(camera["camera"]["worldToCamera"][3], serde_json::json!([12.0, 13.0, 14.0, 15.0]));
    let red = &camera["parts"][0]["layers"][0]["channels"][3];
    assert_eq!((&red["name"], &red["sample_type"], &red["min"]), (&"R".into(), &"float".into(), &0.0.into()));
    let nan = exr::summary(&fixture("exr/nan.exr")).unwrap();
    assert_eq!(nan.parts[0].layers[0].channels.iter().map(|c| c.non_finite).sum::<usize>(), 3);
    assert!(nan.parts[0].layers[0].channels.iter().all(|c| c.max.unwrap().is_finite()));
}

#[test]
fn problems_are_listed_with_what_to_do() {
    for name in ["blender.exr", "multipart.exr", "overscan.exr", "mipmap.exr"] {
        assert_eq!(exr::problems(&fixture("exr").join(name)).unwrap(), [], "{name}");
    }
    let nan = exr::problems(&fixture("exr/nan.exr")).unwrap();
    assert_eq!(nan.len(), 3);
    let first = (nan[0].part.as_deref(), nan[0].what.as_str());
    assert_eq!(first, (Some("channel 'A'"), "NaN or infinite samples: 1"));
    assert!(!nan[0].remedy.is_empty());
    let deep = exr::problems(&fixture("exr/deep.exr")).unwrap();
    assert!(deep.len() == 1 && deep[0].what.contains("deep"), "{deep:?}");
    assert!(exr::problems(&fixture("exr/make_exr.py")).unwrap()[0].what.contains("no OpenEXR file"));
    assert!(exr::problems(Path::new("/no/such.exr")).unwrap_err().io_kind().is_some(), "no fault of the content");
}
