//! Files are told by their content, whatever they are called: a file of every format of the registry.

use crate::common::images;
use crate::common::work::fixture;
use cumulo::formats::registry::{self, FORMATS, RAW};
use std::collections::BTreeSet;

/// Formats by name, each with what a file of it begins with.
fn beginnings() -> Vec<(&'static str, Vec<u8>)> {
    let fixture = |name: &str| std::fs::read(fixture(name)).unwrap();
    let at = |offset: usize, word: &[u8]| [&vec![0; offset], word].concat();
    let mut all = vec![
        ("VDB", fixture("plume.vdb")),
        ("NanoVDB", b"NanoVDB2".to_vec()),
        ("OpenEXR", fixture("exr/zip.exr")),
        ("deep OpenEXR", fixture("exr/deep.exr")),
        ("USD", b"#usda 1.0\n".to_vec()),
        ("USD", b"\xef\xbb\xbf#usda 1.0\n".to_vec()),
        ("USD", b"PXR-USDC".to_vec()),
        ("capture", b"\xef\xbb\xbf \n{\"frames\": []}".to_vec()),
        ("PNG", b"\x89PNG\r\n".to_vec()),
        ("JPEG", b"\xff\xd8\xff\xe0".to_vec()),
        ("DICOM", at(128, b"DICM")),
        ("DICOM", [b"II*\0".to_vec(), at(124, b"DICM")].concat()),
        ("MRC", at(208, b"MAP ")),
        // A map of 348 columns, which is the length of a header of Analyze, too.
        ("MRC", [348_i32.to_le_bytes().to_vec(), at(204, b"MAP ")].concat()),
        (".cvol", b"cvol".to_vec()),
        ("NIfTI", fixture("head.nii.gz")),
        ("PLY", b"ply\nformat ascii 1.0\n".to_vec()),
        ("glTF", b"glTF\x02\0\0\0".to_vec()),
    ];
    for mut sample in images::samples() {
        let name = match sample.name.split([',', '-', ' ', '\'']).next().unwrap() {
            "NumPy" if sample.files[0].0.ends_with(".npz") => ".npz",
            "NumPy" => ".npy",
            "legacy" => "legacy VTK",
            "NIfTI" => "NIfTI",
            "NRRD" => "NRRD",
            "MetaImage" => "MetaImage",
            "Mitsuba" => ".vol",
            "TIFF" => "TIFF",
            "raw" => continue,
            _ => ".vti",
        };
        all.push((name, sample.files.swap_remove(0).1));
    }
    all
}

#[test]
fn files_of_every_format_are_told_by_their_content() {
    let folder = tempfile::tempdir().unwrap();
    let mut told = BTreeSet::from(["Zarr", "OBJ"]);
    let named = folder.path().join("mesh.obj");
    std::fs::write(&named, "v 0 0 0\n").unwrap();
    assert_eq!(registry::sniff(&named).unwrap().name, "OBJ");
    for (name, bytes) in beginnings() {
        // No ending, and that of a format whose files have no other sign.
        for file in ["file", "file.0001", "file.txt", "file.vdb", "file.nii"] {
            let path = folder.path().join(file);
            std::fs::write(&path, &bytes).unwrap();
            assert_eq!(registry::sniff(&path).unwrap().name, name, "{file}");
        }
        told.insert(name);
    }
    let all: BTreeSet<&str> = FORMATS.iter().map(|format| format.name).collect();
    assert_eq!(told, all, "a row has no file here");
    assert!(!all.contains(RAW.name));
}

#[test]
fn names_tell_what_content_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let told = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        registry::sniff(&path).unwrap().name
    };
    assert_eq!([told("a.usdz", b"PK"), told("a.usd", b""), told("b.usd", b" BDV")], ["USD", "USD", "VDB"]);
    assert_eq!([told("images.txt", b"# Image list"), told("other.txt", b"# Image list")], ["capture", "unknown"]);
    assert_eq!([told("a.json", b"{}"), told("zarr.json", b"{}")], ["capture", "Zarr"]);
    assert_eq!(["empty.nii", "empty.vdb"].map(|name| told(name, b"")), ["unknown"; 2]);
    // Folders: of Zarr, else a capture's, whose reader says what it lacks, unless images are asked for.
    assert_eq!(registry::sniff(folder.path()).unwrap().name, "Zarr");
    let stack = tempfile::tempdir().unwrap();
    std::fs::write(stack.path().join("s1.tif"), b"II*\0").unwrap();
    assert_eq!(registry::sniff(stack.path()).unwrap().name, "capture");
    assert_eq!(images::found(stack.path()), Some("TIFF"));
    assert_eq!(images::found(&stack.path().join("s*.tif")), Some("TIFF"));
    assert!(registry::sniff(&stack.path().join("none.nii")).is_err());
}
