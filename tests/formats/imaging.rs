//! Images keep their voxels where they are: through every reader, and through every writer and reader in turn. Grids of
//! Mitsuba have floats along the world's axes alone, and tests of their own.

use crate::common::images::{self, SIZE, oblique, samples, value};
use cumulo::formats::imaging::image::Image;
use cumulo::formats::imaging::options::{Axes, Options, RawLayout};
use cumulo::formats::imaging::source::Source;
use cumulo::formats::imaging::values::Mapping;
use cumulo::formats::imaging::volume::{GridType, Settings, build};
use cumulo::formats::imaging::write::Target;
use cumulo::formats::limits::Limits;
use cumulo::formats::sample;
use cumulo::formats::vdb::{DenseBox, NativeGrid, ValueKind};
use cumulo::math::Affine;
use cumulo::scene::grid::GridClass;
use glam::{DMat4, DVec3};
use std::path::Path;

fn reading(sample: &images::Sample) -> Options {
    let raw = sample.name == "raw";
    let layout = RawLayout { size: SIZE, sample: sample::Sample::U16, endian: sample::Endian::Big, skip: 7 };
    Options {
        transform: (sample.options.contains("--transform") || raw).then(|| Affine::new(sample.map).unwrap()),
        origin: sample.options.contains("--origin").then_some(DVec3::new(10.5, -20.25, 30.125)),
        axes: if sample.options.contains("zyx") { Axes::Zyx } else { Axes::Xyz },
        raw: raw.then_some(layout),
        ..Options::default()
    }
}

fn open(path: &Path, options: &Options) -> Image {
    let name = if options.raw.is_some() { "raw" } else { images::found(path).unwrap() };
    let mut images = images::format_of(name).open(path, options, Limits::default()).unwrap();
    assert_eq!(images.len(), 1, "{}", path.display());
    images.remove(0)
}

fn built(image: &mut Image, name: &str, grid_type: GridType) -> NativeGrid {
    let settings = Settings { name, grid_type, mapping: Mapping::default(), limits: Limits::default() };
    build(image, &settings, |_, _| {}).unwrap().0
}

fn grid(image: &mut Image) -> NativeGrid {
    built(image, "density", GridType::Auto)
}

/// Largest distance of a corner of the volume from where it belongs.
fn error(map: &Affine, expected: DMat4) -> f64 {
    let corners = (0..8)
        .map(|i| DVec3::from_array(std::array::from_fn(|a| if i >> a & 1 == 1 { (SIZE[a] - 1) as f64 } else { 0.0 })));
    corners.map(|c| (map.to_world(c) - expected.transform_point3(c)).length()).fold(0.0, f64::max)
}

/// Every voxel of the grid has the value that belongs there; indices begin at 0.
fn whole(native: &NativeGrid) {
    let high = SIZE.map(|n| n as i32 - 1);
    assert_eq!(native.info().unwrap().index_box, Some(([0; 3], high)));
    let mut found = vec![0.0; 60];
    native.read_box(&DenseBox { low: [0; 3], high, strides: [1, 5, 20] }, &mut found).unwrap();
    for (i, v) in found.iter().enumerate() {
        assert_eq!(*v, f64::from(value(i % 5, i / 5 % 4, i / 20)), "voxel {i}");
    }
}

#[test]
fn every_format_puts_every_voxel_where_it_belongs() {
    let dir = tempfile::tempdir().unwrap();
    for sample in samples() {
        let path = sample.write(dir.path());
        let mut image = open(&path, &reading(&sample));
        let off = error(&image.header.index_to_world, sample.map);
        assert!(off <= sample.tolerance, "{}: {off} > {}", sample.name, sample.tolerance);
        assert_eq!(image.header.size, SIZE, "{}", sample.name);
        let native = grid(&mut image);
        whole(&native);
        assert_eq!(native.info().unwrap().affine().unwrap(), image.header.index_to_world, "{}", sample.name);
    }
}

/// A grid of labels that single precision does not hold apart, whose indices do not begin at 0.
fn labels(map: &Affine) -> NativeGrid {
    let mut native = NativeGrid::empty(ValueKind::Int32, "labels", GridClass::Unknown, map).unwrap();
    let values: Vec<f64> = images::values().iter().map(|v| 16_777_216.0 + f64::from(*v)).collect();
    let place = DenseBox { low: [-3, 7, -9], high: [1, 10, -7], strides: [1, 5, 20] };
    native.write_box(&place, &values, u64::MAX).unwrap();
    native
}

#[test]
fn every_writer_and_reader_in_turn_keep_labels_and_places() {
    let dir = tempfile::tempdir().unwrap();
    let shift = DMat4::from_translation(DVec3::new(3.0, -7.0, 9.0));
    let start = labels(&Affine::new(oblique() * shift).unwrap());
    let pass = |native: &NativeGrid, target: &Target, axes: Axes| {
        let path = dir.path().join(format!("x.{}", target.ending));
        let source = Source::new(native, Limits::default()).unwrap();
        let transform = Some(source.index_to_world);
        target.write(&path, &source, "labels", axes).unwrap();
        let mut image = open(&path, &Options { axes, transform, ..Options::default() });
        let (name, from) = (image.header.name.clone(), image.header.index_to_world);
        assert_eq!(name.as_deref(), (target.ending == "vti").then_some("labels"));
        let native = grid(&mut image);
        assert_eq!(native.info().unwrap().value_type, "int32", "{target:?}");
        (native, from)
    };
    // Grids of Mitsuba hold neither labels nor turned voxels.
    let targets = || images::targets().filter(|target| target.ending != "vol");
    for first in targets() {
        for axes in [Axes::Xyz, Axes::Zyx] {
            let (once, _) = pass(&start, first, axes);
            for second in targets() {
                let (twice, map) = pass(&once, second, axes);
                // Directions and spacings are parted and multiplied again in formats of doubles: coordinates below 64 round
                // by a few units in the last place, twice. NIfTI-1 has single precision.
                let single = [first, second].iter().any(|t| t.ending.starts_with("nii"));
                let unit = if single { f64::from(f32::EPSILON) } else { f64::EPSILON };
                let off = error(&map, oblique());
                assert!(off <= 2.0 * 64.0 * 4.0 * unit, "{first:?} {second:?}: {off}");
                let mut found = vec![0.0; 60];
                twice.read_box(&DenseBox { low: [0; 3], high: [4, 3, 2], strides: [1, 5, 20] }, &mut found).unwrap();
                assert!(found.iter().zip(images::values()).all(|(f, v)| *f == 16_777_216.0 + f64::from(v)));
            }
        }
    }
}

#[test]
fn vectors_and_other_types_pass() {
    let dir = tempfile::tempdir().unwrap();
    let map = Affine::new(images::straight()).unwrap();
    for (kind, step) in [(ValueKind::Float, 0.5), (ValueKind::Double, 0.1), (ValueKind::Vec3, 0.25)] {
        let n = kind.components();
        let values: Vec<f64> = (0..60 * n).map(|i| (i + 1) as f64 * step).collect();
        let place = DenseBox { low: [0; 3], high: [4, 3, 2], strides: [n, 5 * n, 20 * n].map(|s| s as i64) };
        let mut native = NativeGrid::empty(kind, "v", GridClass::Unknown, &map).unwrap();
        native.write_box(&place, &values, u64::MAX).unwrap();
        for target in images::targets() {
            let path = dir.path().join(format!("v.{}", target.ending));
            target.write(&path, &Source::new(&native, Limits::default()).unwrap(), "v", Axes::Xyz).unwrap();
            let mut image = open(&path, &Options { transform: Some(map), ..Options::default() });
            assert_eq!((image.header.components, image.header.size), (n, SIZE), "{target:?}");
            let to = if kind == ValueKind::Double { GridType::Double } else { GridType::Auto };
            let again = built(&mut image, "v", to);
            let mut found = vec![0.0; values.len()];
            again.read_box(&place, &mut found).unwrap();
            let single = |v: &f64| if target.ending == "vol" { f64::from(*v as f32) } else { *v };
            assert_eq!(found, values.iter().map(single).collect::<Vec<_>>(), "{target:?} {kind:?}");
        }
    }
}

#[test]
fn what_a_format_cannot_hold_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let mut sheared = oblique();
    sheared.y_axis += 0.3 * sheared.x_axis;
    let native = labels(&Affine::new(sheared).unwrap());
    let source = Source::new(&native, Limits::default()).unwrap();
    for target in images::targets() {
        let path = dir.path().join(format!("s.{}", target.ending));
        let written = target.write(&path, &source, "s", Axes::Xyz);
        if ["vti", "vol"].contains(&target.ending) {
            let error = written.unwrap_err().to_string();
            let remedy = if target.ending == "vti" { "`convert.resample`" } else { ".npy" };
            assert!(error.contains("sheared") && error.contains(remedy) && !path.exists(), "{error}");
            continue;
        }
        let notes = written.unwrap().join(" ");
        let silent = ["nrrd", "npy"].contains(&target.ending);
        assert_eq!(notes.contains("sheared"), !silent, "{target:?}: {notes}");
        // The whole map comes back, from the sform or the directions.
        let image = open(&path, &Options { transform: Some(source.index_to_world), ..Options::default() });
        let unit = if target.ending.starts_with("nii") { f64::from(f32::EPSILON) } else { f64::EPSILON };
        assert!(error(&image.header.index_to_world, source.index_to_world.matrix()) <= 64.0 * 4.0 * unit, "{target:?}");
    }
}

/// Target whose files are grids of Mitsuba.
fn mitsuba() -> &'static Target {
    images::targets().find(|target| target.ending == "vol").unwrap()
}

/// Writes a grid of Mitsuba; its notes and the file's image.
fn through_mitsuba(native: &NativeGrid, path: &Path) -> (String, Image) {
    let source = Source::new(native, Limits::default()).unwrap();
    let notes = mitsuba().write(path, &source, "v", Axes::Xyz).unwrap().join("; ");
    (notes, open(path, &Options::default()))
}

#[test]
fn grids_of_mitsuba_keep_values_and_places_to_the_bit() {
    let dir = tempfile::tempdir().unwrap();
    let [first, second] = ["a.vol", "b.vol"].map(|name| dir.path().join(name));
    for n in [1, 3] {
        let kind = if n == 1 { ValueKind::Float } else { ValueKind::Vec3 };
        // Thirds, a zero in the middle and a value that is no power of two's; single precision holds all.
        let values: Vec<f64> =
            (0..60 * n).map(|i| if i / n == 31 { 0.0 } else { f64::from((i as f32 - 20.5) / 3.0) }).collect();
        let place = DenseBox { low: [0; 3], high: [4, 3, 2], strides: [n, 5 * n, 20 * n].map(|s| s as i64) };
        let start = Affine::new(images::straight()).unwrap();
        let mut native = NativeGrid::empty(kind, "v", GridClass::Unknown, &start).unwrap();
        native.write_box(&place, &values, u64::MAX).unwrap();
        let (notes, mut image) = through_mitsuba(&native, &first);
        assert_eq!((notes.as_str(), image.header.index_to_world), ("", start));
        let again = built(&mut image, "v", GridType::Auto);
        let mut found = vec![0.0; values.len()];
        again.read_box(&place, &mut found).unwrap();
        assert_eq!(found, values);
        through_mitsuba(&again, &second);
        assert_eq!(std::fs::read(&first).unwrap(), std::fs::read(&second).unwrap());
    }
}

#[test]
fn boxes_that_no_double_holds_come_back_to_the_bit() {
    let dir = tempfile::tempdir().unwrap();
    let [first, second] = ["a.vol", "b.vol"].map(|name| dir.path().join(name));
    // Voxels of 1/5, 1/4 and 1/3 of edges that are no fractions of powers of two.
    let mut file = images::mitsuba(1, &images::values());
    let corners = [-0.1_f32, 7.3, 1e4, 0.9, 7.7, 10_001.3];
    corners.iter().enumerate().for_each(|(i, v)| file[24 + 4 * i..28 + 4 * i].copy_from_slice(&v.to_le_bytes()));
    std::fs::write(&first, &file).unwrap();
    let mut image = open(&first, &Options::default());
    let (notes, again) = through_mitsuba(&grid(&mut image), &second);
    assert_eq!((notes.as_str(), again.header.index_to_world), ("", image.header.index_to_world));
    assert!(std::fs::read(&second).unwrap() == file);
}

#[test]
fn mirrored_voxels_lie_where_they_did_in_grids_of_mitsuba() {
    let dir = tempfile::tempdir().unwrap();
    let mirrored = images::straight() * DMat4::from_scale(DVec3::new(-1.0, 1.0, -1.0));
    let start = Affine::new(mirrored).unwrap();
    let mut native = NativeGrid::empty(ValueKind::Float, "v", GridClass::Unknown, &start).unwrap();
    let place = DenseBox { low: [0; 3], high: [4, 3, 2], strides: [1, 5, 20] };
    let values: Vec<f64> = images::values().into_iter().map(f64::from).collect();
    native.write_box(&place, &values, u64::MAX).unwrap();
    let (notes, mut image) = through_mitsuba(&native, &dir.path().join("m.vol"));
    assert!(notes.contains("reverse along x") && notes.contains("along z") && !notes.contains("along y"), "{notes}");
    let map = image.header.index_to_world;
    let again = grid(&mut image);
    for (i, value) in values.iter().enumerate() {
        let index = [i % 5, i / 5 % 4, i / 20];
        let world = start.to_world(DVec3::from_array(index.map(|c| c as f64)));
        let low = map.to_index(world).round().as_ivec3().to_array();
        assert_eq!(map.to_world(DVec3::from_array(low.map(f64::from))), world);
        let mut found = [0.0];
        again.read_box(&DenseBox { low, high: low, strides: [1; 3] }, &mut found).unwrap();
        assert_eq!(found[0], *value, "{index:?}");
    }
}

#[test]
fn what_grids_of_mitsuba_round_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r.vol");
    let place = DenseBox { low: [0; 3], high: [2, 0, 0], strides: [1; 3] };
    let written = |map: DMat4, kind: ValueKind, values: [f64; 3]| {
        let mut native = NativeGrid::empty(kind, "v", GridClass::Unknown, &Affine::new(map).unwrap()).unwrap();
        native.write_box(&place, &values, u64::MAX).unwrap();
        let source = Source::new(&native, Limits::default()).unwrap();
        mitsuba().write(&path, &source, "v", Axes::Xyz).map(|notes| notes.join("; "))
    };
    let tenths = DMat4::from_scale(DVec3::splat(0.1));
    let notes = written(tenths, ValueKind::Float, [1.0, 2.0, 3.0]).unwrap();
    assert!(notes.contains("the box is held in single precision"), "{notes}");
    let notes = written(DMat4::IDENTITY, ValueKind::Int32, [1.0, 16_777_217.0, 3.0]).unwrap();
    assert!(notes.contains("integers become") && notes.contains("1 whole numbers"), "{notes}");
    let notes = written(DMat4::IDENTITY, ValueKind::Double, [1e300, 0.1, 1e-300]).unwrap();
    for words in ["64-bit floats are rounded", "1 values are too large", "1 values are too small"] {
        assert!(notes.contains(words), "{notes} lacks {words}");
    }
    std::fs::remove_file(&path).unwrap();
    let far = DMat4::from_translation(DVec3::splat(1e9)) * tenths;
    let error = written(far, ValueKind::Float, [1.0, 2.0, 3.0]).unwrap_err();
    assert!(error.to_string().contains("single precision") && error.remedy().is_some() && !path.exists(), "{error}");
}
