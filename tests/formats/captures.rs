//! Captures of other programs: COLMAP's models, files of instant-ngp and nerfstudio, PNG and JPEG pictures.

use crate::common::refusal;
use cumulo::error::Code;
use cumulo::formats::limits::Limits;
use cumulo::formats::picture::{self, Options};
use cumulo::formats::{captures, colmap, exr, transforms};
use cumulo::scene::camera::Camera;
use cumulo::scene::capture::Capture;
use cumulo::scene::color_space::ColorSpace;
use cumulo::scene::film::Film;
use cumulo::scene::lens::Lens;
use glam::{DMat3, DQuat, DVec2, DVec3};
use serde_json::{Value, json};
use std::path::Path;

/// Numbers of a generator whose sequence is the same on every machine.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % n.max(1)
    }
}

/// A binary model, written by the documented layout: cameras of a model's number and parameters, one image each.
fn binary(folder: &Path, cameras: &[(i32, [u64; 2], Vec<f64>)], poses: &[(DQuat, DVec3)]) {
    let mut bytes = (cameras.len() as u64).to_le_bytes().to_vec();
    for (id, (model, size, parameters)) in cameras.iter().enumerate() {
        bytes.extend((id as u32 + 7).to_le_bytes());
        bytes.extend(model.to_le_bytes());
        size.iter().for_each(|side| bytes.extend(side.to_le_bytes()));
        parameters.iter().for_each(|p| bytes.extend(p.to_le_bytes()));
    }
    std::fs::write(folder.join("cameras.bin"), bytes).unwrap();
    let mut bytes = (poses.len() as u64).to_le_bytes().to_vec();
    for (i, (q, t)) in poses.iter().enumerate() {
        bytes.extend((i as u32 + 1).to_le_bytes());
        [q.w, q.x, q.y, q.z, t.x, t.y, t.z].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.extend((i as u32 + 7).to_le_bytes());
        bytes.extend(format!("view_{i:03}.exr\0").as_bytes());
        // Points in the picture, which are skipped.
        bytes.extend((i as u64).to_le_bytes());
        bytes.extend(std::iter::repeat_n(1, 24 * i));
    }
    std::fs::write(folder.join("images.bin"), bytes).unwrap();
}

/// A camera at the world's origin of COLMAP's axes, moved: world points four units along +Z of the camera.
#[test]
fn colmaps_axes_are_right_down_and_forward() {
    let dir = tempfile::tempdir().unwrap();
    // A quarter turn about y: (x, y, z) of the world becomes (z, y, -x) of the camera.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let text = format!(
        "# comment\n1 0.5 0.5 0.5 0.5 0 0 0 3 unused.png\n\n2 1 0 0 0 0 0 4 3 a b.png\n10 20 -1 30 40 5\n3 {half} 0 {half} 0 0 0 4 3 c.png\n\n"
    );
    std::fs::write(dir.path().join("images.txt"), text).unwrap();
    std::fs::write(dir.path().join("cameras.txt"), "# comment\n3 PINHOLE 640 480 500 510 320.5 241\n").unwrap();
    let capture = captures::load(dir.path()).unwrap();
    let names: Vec<_> = capture.frames.iter().map(|f| f.picture.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, ["a b.png", "c.png", "unused.png"], "sorted by name, blanks kept");
    let [plain, turned, _] = [0, 1, 2].map(|i| capture.frames[i].camera);
    assert_eq!((plain.width, plain.height, plain.position()), (640, 480, DVec3::new(0.0, 0.0, -4.0)));
    // (1, 2, 0) of the world is (1, 2, 4) of the camera: 500 / 4 right of and 510 · 2 / 4 below the principal point.
    let (pixel, depth) = plain.project(DVec3::new(1.0, 2.0, 0.0)).unwrap();
    assert!((pixel - DVec2::new(320.5 + 125.0, 241.0 + 255.0)).length() < 1e-10 && (depth - 4.0).abs() < 1e-12);
    // (0, 1, 2) becomes (2, 1, 4).
    let (pixel, _) = turned.project(DVec3::new(0.0, 1.0, 2.0)).unwrap();
    assert!((pixel - DVec2::new(320.5 + 250.0, 241.0 + 127.5)).length() < 1e-10, "{pixel}");
    assert!(capture.remarks.iter().any(|r| r.contains("points3D")));
    for name in ["images.txt", "cameras.txt"] {
        assert_eq!(captures::load(&dir.path().join(name)).unwrap(), capture, "by a file of the model");
    }
}

/// A capture of pinhole cameras all around, whose pictures need not exist.
fn around(folder: &Path) -> Capture {
    let frames: Vec<Value> = (0..12)
        .map(|i| {
            let angle = 0.61 * f64::from(i) + 0.1;
            let eye = DVec3::new(3.0 * angle.cos(), f64::from(i) * 0.3 - 1.7, 3.0 * angle.sin());
            let m = Camera::look_at(eye, DVec3::new(0.1, 0.2, 0.3), DVec3::Y);
            let rows: Vec<_> = (0..4).map(|r| m.row(r).to_array()).collect();
            json!({"file_path": format!("view_{i:03}.exr"), "transform_matrix": rows, "fl_x": 50.0 + f64::from(i) / 7.0})
        })
        .collect();
    let text = json!({"w": 64, "h": 48, "fl_y": 51.5, "cx": 31.7, "cy": 24.3, "frames": frames});
    std::fs::write(folder.join("transforms.json"), text.to_string()).unwrap();
    captures::load(folder).unwrap()
}

fn close(a: &Capture, b: &Capture) {
    assert_eq!(a.frames.len(), b.frames.len());
    for (a, b) in a.frames.iter().zip(&b.frames) {
        assert_eq!(a.picture.file_name(), b.picture.file_name());
        let (a, b) = (a.camera, b.camera);
        assert_eq!((a.focal, a.centre, a.width, a.height), (b.focal, b.centre, b.width, b.height));
        // A quaternion of a rotation and back rounds some ten times; positions are of order 4.
        assert!(a.camera_to_world.abs_diff_eq(b.camera_to_world, 1e-13), "{a:?} {b:?}");
    }
}

#[test]
fn cameras_go_to_colmap_and_back() {
    let dir = tempfile::tempdir().unwrap();
    let capture = around(dir.path());
    let text = dir.path().join("text/sparse/0");
    std::fs::create_dir_all(&text).unwrap();
    let texts = colmap::save(&capture, dir.path()).unwrap();
    std::fs::write(text.join("cameras.txt"), &texts.cameras).unwrap();
    std::fs::write(text.join("images.txt"), &texts.images).unwrap();
    close(&captures::load(&dir.path().join("text")).unwrap(), &capture);
    close(&captures::load(&text).unwrap(), &capture);

    let flip = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    let pose = |c: &Camera| {
        let to_camera = (DMat3::from_mat4(c.camera_to_world) * flip).transpose();
        (DQuat::from_mat3(&to_camera), -(to_camera * c.position()))
    };
    let cameras: Vec<_> = capture.frames.iter().map(|f| f.camera).collect();
    let written = cameras.iter().map(|c| (1, [64, 48], vec![c.focal.x, c.focal.y, c.centre.x, c.centre.y]));
    let folder = dir.path().join("binary");
    std::fs::create_dir(&folder).unwrap();
    binary(&folder, &written.collect::<Vec<_>>(), &cameras.iter().map(pose).collect::<Vec<_>>());
    close(&captures::load(&folder).unwrap(), &capture);
}

#[test]
fn every_camera_model_has_its_lens() {
    let dir = tempfile::tempdir().unwrap();
    let brown = |radial: [f64; 6], tangential| Lens::brown(radial, tangential);
    let models = [
        (0, vec![50.0, 20.0, 15.0], Lens::Pinhole),
        (1, vec![50.0, 50.0, 20.0, 15.0], Lens::Pinhole),
        (2, vec![50.0, 20.0, 15.0, 0.1], brown([0.1, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0; 2])),
        (3, vec![50.0, 20.0, 15.0, 0.1, 0.2], brown([0.1, 0.2, 0.0, 0.0, 0.0, 0.0], [0.0; 2])),
        (4, vec![50.0, 50.0, 20.0, 15.0, 0.1, 0.2, 0.3, 0.4], brown([0.1, 0.2, 0.0, 0.0, 0.0, 0.0], [0.3, 0.4])),
        (5, vec![50.0, 50.0, 20.0, 15.0, 0.1, 0.2, 0.3, 0.4], Lens::Fisheye { radial: [0.1, 0.2, 0.3, 0.4] }),
        (
            6,
            vec![50.0, 50.0, 20.0, 15.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8],
            brown([0.1, 0.2, 0.5, 0.6, 0.7, 0.8], [0.3, 0.4]),
        ),
        (8, vec![50.0, 20.0, 15.0, 0.1], Lens::Fisheye { radial: [0.1, 0.0, 0.0, 0.0] }),
        (9, vec![50.0, 20.0, 15.0, 0.1, 0.2], Lens::Fisheye { radial: [0.1, 0.2, 0.0, 0.0] }),
    ];
    let written: Vec<_> = models.iter().map(|(id, parameters, _)| (*id, [40, 30], parameters.clone())).collect();
    binary(dir.path(), &written, &vec![(DQuat::IDENTITY, DVec3::Z); models.len()]);
    let stated = captures::stated_within(dir.path(), Limits::default()).unwrap();
    for ((id, _, lens), (optics, frame)) in models.iter().zip(stated.optics.iter().zip(&stated.capture.frames)) {
        assert_eq!(optics.lens, *lens, "model {id}");
        assert_eq!((frame.camera.focal, frame.camera.centre), (DVec2::splat(50.0), DVec2::new(20.0, 15.0)));
    }
    let error = captures::load(dir.path()).unwrap_err();
    refusal::is(&error, Code::Unsupported, &["frame 2", "'k1' is 0.1", "cumulo capture convert"]);
    assert_eq!(captures::summary(dir.path()).unwrap().distorted, 7);
    binary(dir.path(), &[(7, [40, 30], vec![50.0, 50.0, 20.0, 15.0, 1.0])], &[(DQuat::IDENTITY, DVec3::Z)]);
    refusal::is(&captures::load(dir.path()).unwrap_err(), Code::Unsupported, &["'FOV'"]);
}

fn pose() -> Value {
    json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]])
}

fn stated(text: &Value) -> cumulo::Result<cumulo::formats::views::StatedCapture> {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("transforms.json"), text.to_string()).unwrap();
    captures::stated_within(dir.path(), Limits::default())
}

/// As `ns-process-data` writes it, by the documentation of nerfstudio's data conventions.
#[test]
fn a_file_of_nerfstudio() {
    let text = json!({
        "w": 1920, "h": 1080, "fl_x": 1090.9, "fl_y": 1090.9, "cx": 978.6, "cy": 540.6,
        "k1": 0.01, "k2": -0.02, "k3": 0.0, "k4": 0, "p1": 1e-3, "p2": -2e-3, "camera_model": "OPENCV",
        "applied_transform": [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]], "applied_scale": 0.5,
        "ply_file_path": "sparse_pc.ply", "train_filenames": ["images/frame_00001.png"],
        "frames": [{"file_path": "images/frame_00001.png", "transform_matrix": pose(), "colmap_im_id": 1,
                    "depth_file_path": "depth/frame_00001.png", "mask_path": "masks/00001.png"}],
    });
    let view = stated(&text).unwrap();
    assert_eq!(view.optics[0].lens, Lens::brown([0.01, -0.02, 0.0, 0.0, 0.0, 0.0], [1e-3, -2e-3]));
    assert!(view.optics[0].mask.as_ref().unwrap().ends_with("masks/00001.png"));
    let remarks = view.capture.remarks.join("\n");
    for key in ["depth_file_path", "applied_transform", "applied_scale", "ply_file_path", "train_filenames"] {
        assert_eq!(remarks.matches(&format!("'{key}'")).count(), 1, "{key}: {remarks}");
    }
    let mut fisheye = text.clone();
    fisheye["camera_model"] = json!("OPENCV_FISHEYE");
    (fisheye["p1"], fisheye["p2"], fisheye["k4"]) = (json!(0), json!(0), json!(0.5));
    fisheye["fisheye_crop_radius"] = json!(500);
    let view = stated(&fisheye).unwrap();
    assert_eq!(view.optics[0].lens, Lens::Fisheye { radial: [0.01, -0.02, 0.0, 0.5] });
    assert_eq!(view.optics[0].crop_radius, Some(500.0));
    for (key, value) in [
        ("k4", json!(0.1)),
        ("k6", json!(0.1)),
        ("camera_model", json!("EQUIRECTANGULAR")),
        ("rolling_shutter", json!([0, 0.1, 0, 0])),
        ("latlong", json!(true)),
        ("color_space", json!("Filmic")),
        ("mask_path", json!(3)),
    ] {
        let mut bad = text.clone();
        if key == "mask_path" {
            bad["frames"][0][key] = value
        } else {
            bad[key] = value
        };
        let error = stated(&bad).unwrap_err();
        assert!(error.what().contains(key) && error.remedy().is_some(), "{key}: {error}");
    }
}

/// As `colmap2nerf.py` writes it.
#[test]
fn a_file_of_instant_ngp() {
    let text = json!({
        "camera_angle_x": 0.75, "camera_angle_y": 0.6, "fl_x": 1375.5, "fl_y": 1374.5, "k1": 0.05, "k2": -0.03,
        "k3": 0, "k4": 0, "p1": 0.0, "p2": 0.0, "is_fisheye": false, "cx": 554.5, "cy": 965.25, "w": 1080.0,
        "h": 1920.0, "aabb_scale": 16, "scale": 0.33, "offset": [0.5, 0.5, 0.5],
        "frames": [{"file_path": ".\\images\\0001.jpg", "sharpness": 30.5, "transform_matrix": pose()}],
    });
    let view = stated(&text).unwrap();
    let camera = view.capture.frames[0].camera;
    assert_eq!((camera.focal, camera.width, camera.height), (DVec2::new(1375.5, 1374.5), 1080, 1920));
    assert_eq!(view.optics[0].lens, Lens::brown([0.05, -0.03, 0.0, 0.0, 0.0, 0.0], [0.0; 2]));
    let remarks = view.capture.remarks.join("\n");
    assert!(
        ["'aabb_scale'", "'scale'", "'offset'", "'sharpness'"].iter().all(|key| remarks.contains(key)),
        "{remarks}"
    );
    let mut fisheye = text.clone();
    fisheye["is_fisheye"] = json!(true);
    assert_eq!(stated(&fisheye).unwrap().optics[0].lens, Lens::Fisheye { radial: [0.05, -0.03, 0.0, 0.0] });
    let degrees = json!({"x_fov": 90, "w": 20, "h": 10, "frames": [{"file_path": "a", "transform_matrix": pose()}]});
    assert!((stated(&degrees).unwrap().capture.frames[0].camera.focal.x - 10.0).abs() < 1e-12);
}

fn png(path: &Path, size: [u32; 2], kind: (png::ColorType, png::BitDepth), srgb: bool, bytes: &[u8]) {
    let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), size[0], size[1]);
    encoder.set_color(kind.0);
    encoder.set_depth(kind.1);
    if srgb {
        encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    }
    encoder.write_header().unwrap().write_image_data(bytes).unwrap();
}

/// NeRF's synthetic data: `transforms_train.json`, names without suffix, RGBA with straight alpha.
#[test]
fn synthetic_data_of_nerf_is_composited() {
    use png::{BitDepth::Eight, ColorType::Rgba};
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("train")).unwrap();
    let text = json!({"camera_angle_x": 0.69, "color_space": "sRGB", "frames": [
        {"file_path": "./train/r_0", "rotation": 0.01, "transform_matrix": pose()}]});
    std::fs::write(dir.path().join("transforms_train.json"), text.to_string()).unwrap();
    png(&dir.path().join("train/r_0.png"), [2, 1], (Rgba, Eight), false, &[188, 0, 0, 255, 188, 255, 0, 51]);
    let capture = captures::load(dir.path()).unwrap();
    let frame = &capture.frames[0];
    assert_eq!((frame.camera.width, frame.camera.height), (2, 1));
    assert!(frame.picture.ends_with("train/r_0.png"));
    assert!(capture.remarks.iter().any(|r| r.contains("transforms_train.json")));
    let options = Options { color_space: capture.color_space, background: capture.background, ..Options::default() };
    let film = picture::read(&frame.picture, &options).unwrap().film;
    // 188 of sRGB is 0.502886; an alpha of 1/5 lets four fifths of the white background through.
    let expected = [[0.502_886, 0.0, 0.0, 1.0], [0.2 * 0.502_886 + 0.8, 1.0, 0.8, 0.2]];
    for (found, expected) in film.rgba.iter().zip(expected) {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} {expected:?}");
    }
    assert_eq!(captures::problems(dir.path()).unwrap(), []);
}

#[test]
fn pictures_of_integers_are_read_by_their_curve() {
    use png::{BitDepth, ColorType};
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let read = |space: Option<ColorSpace>| {
        picture::read(&path, &Options { color_space: space, ..Options::default() }).map(|p| p.film.rgba)
    };
    png(&path, [2, 1], (ColorType::Grayscale, BitDepth::Sixteen), false, &[0x80, 0, 0xff, 0xff]);
    refusal::is(&read(None).unwrap_err(), Code::Invalid, &["a.png", "16 bits", "`capture.convert.color_space`"]);
    let grey = 32768.0 / 65535.0;
    assert_eq!(read(Some(ColorSpace::Linear)).unwrap(), [[grey, grey, grey, 1.0], [1.0; 4]]);
    // Four pixels of a bit each are expanded.
    png(&path, [4, 1], (ColorType::Grayscale, BitDepth::One), false, &[0b1010_0000]);
    assert_eq!(read(Some(ColorSpace::Srgb)).unwrap().iter().map(|p| p[0]).collect::<Vec<_>>(), [1.0, 0.0, 1.0, 0.0]);
    // A picture that says that it is sRGB needs no word of the capture.
    png(&path, [1, 1], (ColorType::Rgb, BitDepth::Eight), true, &[188, 128, 255]);
    let [r, g, b, a] = read(None).unwrap()[0];
    assert!((r - 0.502_886).abs() < 1e-6 && (g - 0.215_861).abs() < 1e-6 && b == 1.0 && a == 1.0);
    let layer = Options { layer: Some("Combined"), ..Options::default() };
    refusal::is(&picture::read(&path, &layer).unwrap_err(), Code::NoSuchLayer, &["a.png", "layers"]);

    let jpeg = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/pictures/two_blocks.jpg");
    assert_eq!(picture::header(&jpeg).unwrap().size, [16, 8]);
    let error = picture::read(&jpeg, &Options::default()).unwrap_err();
    refusal::is(&error, Code::Invalid, &["two_blocks.jpg", "8 bits", "`capture.convert.color_space`"]);
    let film =
        picture::read(&jpeg, &Options { color_space: Some(ColorSpace::Linear), ..Options::default() }).unwrap().film;
    for (x, color) in [(1, [200.0, 100.0, 50.0]), (14, [40.0, 40.0, 200.0])] {
        // Quantisation of three components and the conversion from YCbCr: two levels each at most.
        let pixel = film.rgba[3 * 16 + x];
        assert!(pixel.iter().zip(color).all(|(v, c): (&f32, f32)| (v * 255.0 - c).abs() < 3.5), "{x}: {pixel:?}");
        assert_eq!(pixel[3], 1.0);
    }
    let small =
        Options { color_space: Some(ColorSpace::Srgb), limits: Limits { max_memory: 1000 }, ..Options::default() };
    assert!(picture::read(&jpeg, &small).is_err());
    std::fs::write(&path, "GIF89a").unwrap();
    refusal::is(&read(None).unwrap_err(), Code::Unsupported, &["a.png", "OpenEXR", "PNG", "JPEG"]);
}

/// Changes a few bytes of a file, or cuts it.
fn damaged(whole: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = whole.to_vec();
    if random.below(4) == 0 {
        bytes.truncate(random.below(bytes.len()));
    }
    for _ in 0..=random.below(4) {
        let (at, length) = (random.below(bytes.len()), bytes.len());
        match random.below(3) {
            0 if length > 8 => {
                let at = random.below(length - 8);
                bytes[at..at + 8].copy_from_slice(&[u64::MAX, 1 << 40, 0][random.below(3)].to_le_bytes());
            }
            _ => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte = random.below(256) as u8;
                }
            }
        }
    }
    bytes
}

#[test]
fn damaged_models_are_refused_or_usable() {
    let dir = tempfile::tempdir().unwrap();
    let folder = |name: &str| {
        let folder = dir.path().join(name);
        std::fs::create_dir(&folder).unwrap();
        folder
    };
    let (text, bin) = (folder("text"), folder("bin"));
    let capture = around(&folder("own"));
    let texts = colmap::save(&capture, &dir.path().join("own")).unwrap();
    std::fs::write(text.join("cameras.txt"), &texts.cameras).unwrap();
    std::fs::write(text.join("images.txt"), &texts.images).unwrap();
    let camera = (4, [64, 48], vec![50.0, 51.0, 32.0, 24.0, 0.1, 0.0, 0.0, 0.0]);
    binary(&bin, &vec![camera; 5], &[(DQuat::IDENTITY, DVec3::Z); 5]);
    let mut random = Random(3);
    let mut refused = 0;
    for (folder, suffix) in [(&text, "txt"), (&bin, "bin")] {
        for stem in ["cameras", "images"] {
            let path = folder.join(format!("{stem}.{suffix}"));
            let whole = std::fs::read(&path).unwrap();
            for _ in 0..100 {
                std::fs::write(&path, damaged(&whole, &mut random)).unwrap();
                match captures::stated_within(folder, Limits { max_memory: 1 << 26 }) {
                    Ok(read) => assert!(read.capture.frames.iter().all(|f| f.camera.checked().is_ok())),
                    Err(error) => {
                        refused += 1;
                        assert!(error.path().is_some() && error.remedy().is_some(), "{error}");
                    }
                }
                captures::problems(folder).unwrap();
            }
            std::fs::write(&path, whole).unwrap();
        }
    }
    assert!((100..400).contains(&refused), "{refused} of 400");
}

#[test]
fn damaged_pictures_are_refused_or_read() {
    let dir = tempfile::tempdir().unwrap();
    let whole_png = dir.path().join("whole.png");
    let bytes: Vec<u8> = (0..8 * 6 * 4).map(|i| (i * 37 % 251) as u8).collect();
    png(&whole_png, [8, 6], (png::ColorType::Rgba, png::BitDepth::Eight), true, &bytes);
    let jpeg = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/pictures/two_blocks.jpg");
    let options =
        Options { color_space: Some(ColorSpace::Srgb), limits: Limits { max_memory: 1 << 26 }, ..Options::default() };
    let mut random = Random(11);
    for whole in [whole_png, jpeg] {
        let bytes = std::fs::read(&whole).unwrap();
        let path = dir.path().join("damaged");
        let mut refused = 0;
        for _ in 0..200 {
            std::fs::write(&path, damaged(&bytes, &mut random)).unwrap();
            match picture::read(&path, &options) {
                Ok(read) => assert!(read.film.rgba.iter().flatten().all(|v| (0.0..=1.0).contains(v))),
                Err(error) => {
                    refused += 1;
                    assert!(error.path().is_some() && error.remedy().is_some(), "{error}");
                }
            }
        }
        assert!(refused > 40, "{refused} of {}", whole.display());
    }
}

/// A model in `sparse/0` finds its pictures in `images`, and EXRs of the same names.
#[test]
fn pictures_lie_beside_a_model() {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("sparse/0");
    std::fs::create_dir_all(&model).unwrap();
    std::fs::create_dir(dir.path().join("images")).unwrap();
    std::fs::write(model.join("cameras.txt"), "1 SIMPLE_PINHOLE 4 3 5 2 1.5\n").unwrap();
    std::fs::write(model.join("images.txt"), "1 1 0 0 0 0 0 0 1 a.jpg\n\n").unwrap();
    let picture = |path: &Path| captures::load(path).unwrap().frames[0].picture.clone();
    assert!(picture(dir.path()).ends_with("images/a.jpg"), "where it is expected");
    exr::write_picture(&dir.path().join("images/a.exr"), &Film::new(4, 3), &Default::default(), exr::Half::None)
        .unwrap();
    for path in [dir.path(), &model, &model.join("images.txt")] {
        assert!(picture(path).ends_with("images/a.exr"));
    }
    assert_eq!(captures::problems(dir.path()).unwrap(), []);
    std::fs::remove_file(model.join("cameras.txt")).unwrap();
    assert!(captures::load(&model.join("images.txt")).unwrap_err().remedy().is_some());
    assert!(transforms::load(dir.path()).is_err());
}
