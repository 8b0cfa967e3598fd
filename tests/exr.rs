//! OpenEXR files: our own round trip, every layout that other software writes, damaged files.

use cumulo::formats::exr;
use cumulo::render::film::Film;
use std::path::Path;

fn film(width: usize, height: usize) -> Film {
    let rgba = (0..width * height)
        .map(|i| {
            let v = i as f32;
            [v * 0.37, (v * 0.1).sin(), -v / 3.0, 1.0 / (1.0 + v)]
        })
        .collect();
    Film { width, height, rgba }
}

#[test]
fn a_written_picture_is_read_back_to_the_bit() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    for (width, height) in [(1, 1), (17, 5), (64, 48), (3, 100)] {
        let film = film(width, height);
        let attributes = [("cumulo:plan", "größe"), ("software", "cumulo test")];
        let attributes = attributes.map(|(k, v)| (k.to_string(), v.to_string())).into_iter().collect();
        exr::write_picture(&path, &film, &attributes, false).unwrap();
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
fn half_floats_are_rounded_and_refuse_what_does_not_fit() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    let mut film = film(20, 10);
    exr::write_picture(&path, &film, &Default::default(), true).unwrap();
    let back = exr::read_picture(&path, None).unwrap();
    for (a, b) in film.rgba.iter().flatten().zip(back.rgba.iter().flatten()) {
        // 11 significant bits; subnormals below 2^-14 are spaced by 2^-24.
        assert!((a - b).abs() <= (a.abs() * 2_f32.powi(-11)).max(2_f32.powi(-25)), "{a} {b}");
    }
    film.rgba[3][1] = 7e4;
    let message = exr::write_picture(&path, &film, &Default::default(), true).unwrap_err().to_string();
    assert!(message.contains("65504") && message.contains("a.exr"), "{message}");
}

#[test]
fn what_cannot_be_written_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    let refused = |film: &Film, name: &str, word: &str| {
        let attributes = [(name.to_string(), String::new())].into();
        let message = exr::write_picture(&path, film, &attributes, false).unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
        assert!(!path.exists());
    };
    refused(&Film::new(0, 4), "x", "0x4");
    refused(&Film { width: 2, height: 2, rgba: vec![] }, "x", "0 pixels");
    refused(&film(2, 2), "channels", "'channels'");
    refused(&film(2, 2), "", "attribute");
    refused(&film(2, 2), &"n".repeat(256), "attribute");
    let nowhere = dir.path().join("no/such/a.exr");
    assert!(exr::write_picture(&nowhere, &film(2, 2), &Default::default(), false).is_err());
}

#[test]
fn other_files_are_no_openexr() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    for bytes in [&b""[..], b"v/1", b"\x89PNG\r\n\x1a\n", b"v/1\x01\x02\0\0\0"] {
        std::fs::write(&path, bytes).unwrap();
        let message = exr::read(&path).unwrap_err().to_string();
        assert!(message.contains("a.exr") && message.contains("OpenEXR"), "{message}");
    }
    assert!(exr::header(Path::new("/no/such.exr")).unwrap_err().io_kind().is_some());
    assert!(exr::read(dir.path()).is_err(), "a folder");
}
