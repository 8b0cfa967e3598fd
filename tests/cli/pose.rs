//! `cumulo pose`: that cameras come back to where the pictures were taken, and how it ends.

use crate::common::fields::{field, grid, lumps, noise, odd, tinted, unit};
use crate::common::work::{self, Work, errors, interrupt, until};
use cumulo::cancel::Cancel;
use cumulo::differentiate::gradient::camera_jacobian::Rows;
use cumulo::error::Code;
use cumulo::formats::vdb::shaded;
use cumulo::formats::{transfer, transforms};
use cumulo::inverse::pose::normal::Frame;
use cumulo::render::dvr::Dvr;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::camera::{Camera, CameraGradient, Projection};
use cumulo::scene::capture::Model;
use cumulo::scene::grid::Grid;
use cumulo::scene::medium::{Medium, Source};
use cumulo::scene::sphere::{Sphere, upright};
use cumulo::scene::transfer::Transfer;
use cumulo::scene::up::Up;
use glam::{DMat3, DQuat, DVec2, DVec3};
use serde_json::{Map, Value};
use std::collections::BTreeMap;

static NEVER: Cancel = Cancel::NEVER;

fn lumpy() -> Grid {
    grid(32, unit(), |p| 0.4 * lumps(32)(p))
}

/// A unit vector, the same everywhere.
fn any_direction(seed: u64) -> DVec3 {
    DVec3::new(noise(seed) - 0.5, noise(seed + 1) - 0.5, noise(seed + 2) - 0.5).normalize()
}

/// Where cameras of `render` look: at the middle of the outline.
fn centre(work: &Work, volume: &str) -> DVec3 {
    let field: Bricks<f32> = Bricks::from_grid(&work::density(&work.path(volume)), 1 << 30).unwrap();
    let bounds = field.outline().into_iter().fold(cumulo::math::Aabb::EMPTY, |b, p| b.including(p));
    bounds.centre()
}

/// Turns each camera of a capture by `degrees` and moves it by `percent` of its distance, and writes it beside.
fn disturb(work: &Work, from: &str, to: &str, middle: DVec3, degrees: f64, percent: f64, focal: f64) {
    let mut capture = transforms::load(&work.path(from)).unwrap();
    for (i, frame) in capture.frames.iter_mut().enumerate() {
        let seed = 100 * i as u64 + 7;
        let distance = frame.camera.position().distance(middle);
        let step = CameraGradient {
            rotation: degrees.to_radians() * any_direction(seed),
            position: 0.01 * percent * distance * any_direction(seed + 50),
            ..CameraGradient::default()
        };
        frame.camera = frame.camera.moved(&step);
        frame.camera.focal *= focal;
    }
    transforms::save(&work.path(to), &capture, &Map::new()).unwrap();
}

/// Largest angle in degrees and largest way in percent of the distance between the cameras of two captures.
fn apart(work: &Work, a: &str, b: &str, middle: DVec3) -> (f64, f64) {
    let [a, b] = [a, b].map(|name| transforms::load(&work.path(name)).unwrap().frames);
    assert_eq!(a.len(), b.len());
    let one = |(a, b): (&Camera, &Camera)| {
        let axes = |c: &Camera| DMat3::from_mat4(c.camera_to_world);
        let turn = DQuat::from_mat3(&(axes(b) * axes(a).transpose()));
        let degrees = 2.0 * turn.xyz().length().atan2(turn.w.abs()).to_degrees();
        (degrees, 100.0 * a.position().distance(b.position()) / a.position().distance(middle))
    };
    let all = a.iter().zip(&b).map(|(a, b)| one((&a.camera, &b.camera)));
    all.fold((0.0, 0.0), |(x, y), (p, q)| (f64::max(x, p), f64::max(y, q)))
}

fn two_tone(work: &Work) {
    let points = vec![
        [0.02, 0.0, 0.2, 1.0, 0.0],
        [0.1, 0.3, 0.9, 0.4, 1.5],
        [0.3, 1.0, 0.3, 0.1, 0.4],
        [0.8, 1.0, 1.0, 0.9, 2.0],
    ];
    transfer::save(&work.path("two.tf.json"), &Transfer::Piecewise { points }, None, None).unwrap();
}

#[test]
fn disturbed_cameras_come_back() {
    let work = Work::new();
    work.write("a.vdb", &[&lumpy()]);
    shaded::write(&work.path("shaded.vdb"), &tinted::<f32>(32, 0.4, unit()), &[], &BTreeMap::new()).unwrap();
    two_tone(&work);
    let (exact, fast) = ("--quadrature exact", "--quadrature preintegrated");
    for (name, volume, options, made, found) in [
        ("absorption", "a.vdb", "", exact, ""),
        ("linear", "a.vdb", "--model emission-absorption --emission-model linear --emission 1,0.5,0.2", exact, ""),
        ("transfer", "a.vdb", "--tf two.tf.json", exact, ""),
        ("fast", "a.vdb", "--tf two.tf.json", fast, fast),
        ("pre-shaded", "shaded.vdb", "--model pre-shaded --background 0.1,0.2,0.3", exact, ""),
    ] {
        let middle = centre(&work, volume);
        work.json(&format!("render {volume} --views 6 --size 96x96 --density-scale auto {made} {options} -o {name}"));
        disturb(&work, &format!("{name}/transforms.json"), &format!("{name}/off.json"), middle, 2.0, 2.0, 1.0);
        let (degrees, percent) = apart(&work, &format!("{name}/transforms.json"), &format!("{name}/off.json"), middle);
        assert!((degrees - 2.0).abs() < 1e-6 && (percent - 2.0).abs() < 1e-6, "{degrees} {percent}");
        let report = work.json(&format!("pose {name}/off.json --volume {volume} {found} -o {name}/found.json"));
        let (degrees, percent) =
            apart(&work, &format!("{name}/transforms.json"), &format!("{name}/found.json"), middle);
        assert!(degrees < 0.05 && percent < 0.05, "{name}: {degrees} degrees, {percent} %\n{report:#}");
        for camera in report["cameras"].as_array().unwrap() {
            let rms = |key: &str| camera[key].as_f64().unwrap();
            assert!(rms("rms_after") < 0.01 * rms("rms_before"), "{camera}");
            assert_eq!((&camera["undetermined"], &camera["note"]), (&0.into(), &Value::Null));
            // Turn and way are 2 each, but for what the weakly known directions leave.
            assert!((rms("rotated_degrees") - 2.0).abs() < 0.06 && (rms("moved_percent") - 2.0).abs() < 0.06);
        }
    }
}

/// The 60 corners of a truncated icosahedron with edges of length 2.
fn atoms() -> Vec<DVec3> {
    let golden = f64::midpoint(1.0, 5.0_f64.sqrt());
    let corners = [[0.0, 1.0, 3.0 * golden], [2.0, 1.0 + 2.0 * golden, golden], [1.0, 2.0 + golden, 2.0 * golden]];
    let mut atoms: Vec<DVec3> = Vec::new();
    for (corner, signs, turn) in
        corners.into_iter().flat_map(|c| (0..8).flat_map(move |s| (0..3).map(move |t| (c, s, t))))
    {
        let at = |k: usize| if signs >> k & 1 == 1 { -corner[k] } else { corner[k] };
        let atom = DVec3::new(at(turn % 3), at((turn + 1) % 3), at((turn + 2) % 3));
        if atoms.iter().all(|a| a.distance(atom) > 1e-6) {
            atoms.push(atom);
        }
    }
    atoms
}

/// Through narrow peaks a molecule is made of thin shells, looks alike from many places, and is 30 pixels wide.
#[test]
fn cameras_around_a_symmetric_molecule_do_not_run_off() {
    let work = Work::new();
    let atoms = atoms();
    assert_eq!(atoms.len(), 60);
    let molecule = |p: DVec3| {
        let place = (p - 23.5) * (14.0 / 48.0);
        let sum: f64 = atoms.iter().map(|a| (-place.distance_squared(*a) / 0.98).exp()).sum();
        0.8 * sum * ((6.7 - place.abs().max_element()) / 0.6).clamp(0.0, 1.0)
    };
    work.write("c60.vdb", &[&grid(48, unit(), molecule)]);
    let peak = |(at, color): (f64, [f64; 3])| {
        let point = |d: f64, extinction: f64| [at + d, color[0], color[1], color[2], extinction];
        [point(-0.04, 0.0), point(0.0, 0.7), point(0.04, 0.0)]
    };
    let colors = [[1.0, 0.2, 0.1], [1.0, 0.8, 0.1], [0.2, 0.9, 0.2], [0.1, 0.6, 1.0], [0.8, 0.2, 0.9]];
    let points = [0.15, 0.32, 0.5, 0.68, 0.85].into_iter().zip(colors).flat_map(peak).collect();
    transfer::save(&work.path("peaks.tf.json"), &Transfer::Piecewise { points }, None, None).unwrap();
    let middle = centre(&work, "c60.vdb");
    work.json("render c60.vdb --views 24 --size 48x48 --tf peaks.tf.json -o c");
    disturb(&work, "c/transforms.json", "c/off.json", middle, 5.0, 5.0, 1.0);
    let report = work.json("pose c/off.json --volume c60.vdb -o c/found.json");
    let steps: u64 = report["cameras"].as_array().unwrap().iter().map(|c| c["iterations"].as_u64().unwrap()).sum();
    // Some ten steps a camera: none had to begin again.
    assert!(steps < 24 * 20, "{steps} steps");
    let (degrees, percent) = apart(&work, "c/transforms.json", "c/found.json", middle);
    assert!(degrees < 0.02 && percent < 0.05, "{degrees} degrees, {percent} %");
}

/// White noise is nothing that a camera should explain, though it is a larger share of the variance than may be left.
#[test]
fn noise_calls_no_camera_into_question() {
    const SIGMA: f64 = 0.05;
    let work = Work::new();
    work.write("a.vdb", &[&lumpy()]);
    let middle = centre(&work, "a.vdb");
    work.json("render a.vdb --views 6 --size 64x64 --density-scale auto -o c");
    disturb(&work, "c/transforms.json", "c/off.json", middle, 3.0, 3.0, 1.0);
    work.edit("c", |view, film| {
        for (i, v) in film.rgba.iter_mut().flat_map(|p| &mut p[..3]).enumerate() {
            // Twelve uniform numbers have a variance of 1.
            let sum: f64 = (0..12).map(|k| noise((view * 1_000_000 + 12 * i + k) as u64) - 0.5).sum();
            *v += (SIGMA * sum) as f32;
        }
    });
    let report = work.json("pose c/off.json --volume a.vdb -o c/found.json");
    for camera in report["cameras"].as_array().unwrap() {
        let [before, after] = ["rms_before", "rms_after"].map(|key| camera[key].as_f64().unwrap());
        assert!((after - SIGMA).abs() < 0.002 && after < before, "{camera}");
        assert!(camera["unexplained_variance"].as_f64().unwrap() < 0.02 && camera["note"].is_null(), "{camera}");
    }
}

/// What neighbouring pixels do not share is not noise for that: pairs of one brighter and one darker pixel here and
/// there have means of nothing, but a picture with noise would have it everywhere.
#[test]
fn fine_detail_is_not_taken_for_noise() {
    let work = Work::new();
    work.write("a.vdb", &[&lumpy()]);
    work.json("render a.vdb --views 2 --size 48x48 --density-scale auto -o c");
    work.edit("c", |_, film| {
        for (i, p) in film.rgba.iter_mut().enumerate().filter(|(i, _)| i % 8 < 2 && i / 48 % 8 == 0) {
            let sign = if i % 8 == 0 { 0.5 } else { -0.5 };
            p[..3].iter_mut().for_each(|v| *v += sign);
        }
    });
    let report = work.json("pose c --volume a.vdb -o found.json");
    for camera in report["cameras"].as_array().unwrap() {
        assert!(camera["unexplained_variance"].as_f64().unwrap() > 0.1 && camera["note"].is_string(), "{camera}");
    }
}

/// Stripes are what no camera sees, and one that began far off is named as well.
#[test]
fn what_is_not_found_nearby_is_said() {
    let work = Work::new();
    work.write("a.vdb", &[&lumpy()]);
    let middle = centre(&work, "a.vdb");
    work.json("render a.vdb --views 4 --size 48x48 --density-scale auto -o c");
    disturb(&work, "c/transforms.json", "c/off.json", middle, 2.0, 2.0, 1.0);
    work.edit("c", |i, film| {
        if i == 1 {
            film.rgba
                .iter_mut()
                .enumerate()
                .filter(|(i, _)| i / 6 % 2 == 0)
                .for_each(|(_, p)| *p = [1.0, 1.0, 1.0, 0.0]);
        }
    });
    let mut capture = transforms::load(&work.path("c/off.json")).unwrap();
    let start = capture.frames[1].camera;
    let far = &mut capture.frames[2].camera;
    let turn = DQuat::from_scaled_axis(1.2 * far.camera_to_world.y_axis.truncate());
    let axes = DMat3::from_quat(turn) * DMat3::from_mat4(far.camera_to_world);
    far.camera_to_world = glam::DMat4::from_mat3_translation(axes, middle + turn * (far.position() - middle));
    transforms::save(&work.path("c/off.json"), &capture, &Map::new()).unwrap();
    let report = work.json("pose c/off.json --volume a.vdb -o c/found.json");
    let [cameras, warnings] = ["cameras", "warnings"].map(|key| report[key].as_array().unwrap());
    let note = |i: usize| cameras[i]["note"].as_str().unwrap_or_default();
    let unexplained: Vec<f64> = cameras.iter().map(|c| c["unexplained_variance"].as_f64().unwrap()).collect();
    assert!(unexplained[1] > 0.02 && note(1).contains("unexplained"), "{}", cameras[1]);
    assert!(warnings.iter().any(|w| w["what"].as_str().unwrap().contains("of 4 pictures")), "{warnings:?}");
    assert!(unexplained[0] < 1e-4 && unexplained[3] < 1e-4 && note(0).is_empty() && note(3).is_empty());
    assert!(note(2).contains(if unexplained[2] > 0.02 { "unexplained" } else { "moved far" }), "{}", cameras[2]);
    // Never led astray: either near where it was, or there.
    let kept = transforms::load(&work.path("c/found.json")).unwrap().frames[1].camera;
    assert!(start.rotation_to(&kept).length() < 0.25, "{report:#}");
    assert_eq!(kept == start, note(1).starts_with("no pose was found"), "{report:#}");
}

#[test]
fn a_shared_focal_length_is_found() {
    let work = Work::new();
    work.write("a.vdb", &[&lumpy()]);
    let middle = centre(&work, "a.vdb");
    work.json("render a.vdb --views 5 --size 96x80 --fov 60 --density-scale auto -o c");
    disturb(&work, "c/transforms.json", "c/off.json", middle, 1.0, 1.0, 1.02);
    let report = work.json("pose c/off.json --volume a.vdb --solve-focal -o c/found.json");
    let factor = report["focal_factor"].as_f64().unwrap();
    assert!((factor * 1.02 - 1.0).abs() < 5e-4, "{factor}");
    let (degrees, percent) = apart(&work, "c/transforms.json", "c/found.json", middle);
    assert!(degrees < 0.05 && percent < 0.1, "{degrees} {percent}");
    assert_eq!(work.json("pose c/off.json --volume a.vdb -o c/f.json --iterations 1")["focal_factor"], Value::Null);
}

#[test]
fn rows_are_derivatives() {
    let smooth: Bricks<f32> = field(24, odd(), |p| 0.4 * lumps(24)(p));
    let dvr = Dvr::new(&smooth, Medium::new(0.7, Source::Linear([1.0, 0.5, 0.2]))).unwrap().over([1.0; 3]);
    let sphere = Sphere::around(&smooth.outline(), [24, 20], 35.0, Up::Z).unwrap();
    let camera = sphere.camera(&upright(DVec3::new(0.3, -0.5, 0.8).normalize(), Up::Z));
    let frame = Frame::new(&camera, sphere.distance);
    let seen = |camera: &Camera| -> Vec<[f64; 4]> {
        let rows = Rows { renderer: &dvr, reference: None, camera, rays_per_edge: 2, cancel: &NEVER };
        let all = rows.fold(|_| true, &[], |all: &mut Vec<(usize, [f64; 4])>, i, seen, _| all.push((i, *seen)));
        let mut all: Vec<_> = all.into_iter().flatten().collect();
        all.sort_by_key(|p| p.0);
        all.into_iter().map(|p| p.1).collect()
    };
    let rows = Rows { renderer: &dvr, reference: None, camera: &camera, rays_per_edge: 2, cancel: &NEVER };
    let losses: [[f32; 4]; 2] = [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    let found = rows.fold(
        |i| i % 3 == 0,
        &losses,
        |all: &mut Vec<_>, i, _, by| {
            all.push((i, [0, 1].map(|k| frame.derivative(&by[k]))));
        },
    );
    let found: Vec<_> = found.into_iter().flatten().collect();
    assert_eq!(found.len(), 160);
    for k in 0..7 {
        let h = 1e-3;
        let at = |h: f64| {
            let mut step = cumulo::inverse::pose::normal::Pose::zeros();
            if k < 6 {
                step[k] = h;
            }
            seen(&frame.moved(&camera, &step, if k < 6 { 0.0 } else { h }))
        };
        let (up, down) = (at(h), at(-h));
        for (i, by) in &found {
            for (loss, channel) in [1, 3].into_iter().enumerate() {
                let difference = (up[*i][channel] - down[*i][channel]) / (2.0 * h);
                let slope = if k < 6 { by[loss].0[k] } else { by[loss].1 };
                // 32-bit radiance: 1e-7 in 2e-3, and kinks of the trilinear interpolation.
                assert!((slope - difference).abs() < 0.02 + 0.02 * difference.abs(), "{k} {i}: {slope} {difference}");
            }
        }
    }
}

#[test]
fn threads_change_nothing_and_pictures_stay_found() {
    let work = Work::new();
    work.write("a.vdb", &[&lumpy()]);
    let middle = centre(&work, "a.vdb");
    work.json("render a.vdb --views 3 --size 40x33 --density-scale auto -o c");
    disturb(&work, "c/transforms.json", "c/off.json", middle, 1.0, 1.0, 1.0);
    std::fs::create_dir(work.path("other")).unwrap();
    for extra in ["", "--solve-focal"] {
        let run = |n: u32| {
            work.json(&format!("pose c/off.json --volume a.vdb -o other/{n}.json --threads {n} {extra}"));
            let capture = transforms::load(&work.path(&format!("other/{n}.json"))).unwrap();
            assert!(capture.frames.iter().all(|f| f.picture.exists()), "{:?}", capture.frames[0].picture);
            capture
        };
        let one = run(1);
        assert!(one == run(2) && one == run(5));
    }
}

#[test]
fn what_a_picture_does_not_tell_stays_and_is_said() {
    let work = Work::new();
    work.write("a.vdb", &[&lumpy()]);
    let middle = centre(&work, "a.vdb");
    work.json("render a.vdb --views 3 --size 32x32 --density-scale auto -o c");
    disturb(&work, "c/transforms.json", "c/off.json", middle, 1.0, 1.0, 1.0);
    // One camera's picture asks for nothing; one looks away from the volume.
    work.edit("c", |i, film| {
        if i == 1 {
            film.rgba.fill([f32::NAN; 4]);
        }
    });
    let mut capture = transforms::load(&work.path("c/off.json")).unwrap();
    let away = DQuat::from_axis_angle(DVec3::Z, std::f64::consts::PI);
    let camera = &mut capture.frames[2].camera;
    let axes = DMat3::from_quat(away) * DMat3::from_mat4(camera.camera_to_world);
    camera.camera_to_world = glam::DMat4::from_mat3_translation(axes, camera.position());
    transforms::save(&work.path("c/off.json"), &capture, &Map::new()).unwrap();
    let out = work.command("pose c/off.json --volume a.vdb -o c/found.json --report page --json").output().unwrap();
    assert!(out.status.success(), "{}", errors(&out));
    assert!(errors(&out).contains("view_001.exr: the picture says nothing"), "{}", errors(&out));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    let told: Vec<_> = report["cameras"].as_array().unwrap().iter().map(|c| c["undetermined"].clone()).collect();
    assert_eq!(told, [0, 6, 6]);
    let found = transforms::load(&work.path("c/found.json")).unwrap();
    for i in [1, 2] {
        assert_eq!(found.frames[i].camera, capture.frames[i].camera, "{i}");
    }
    let page = std::fs::read_to_string(work.path("page/index.html")).unwrap();
    assert!(page.contains("view_001.exr") && page.contains("says nothing"));
}

#[test]
fn what_no_parallel_ray_tells_stays() {
    let work = Work::new();
    work.write("a.vdb", &[&lumpy()]);
    let middle = centre(&work, "a.vdb");
    work.json("render a.vdb --views 2 --size 48x48 --density-scale auto -o c");
    let mut capture = transforms::load(&work.path("c")).unwrap();
    for frame in &mut capture.frames {
        frame.camera.projection = Projection::Orthographic;
        frame.camera.focal = DVec2::splat(1.2);
    }
    transforms::save(&work.path("parallel.json"), &capture, &Map::new()).unwrap();
    work.json("render a.vdb --cameras parallel.json -o p");
    disturb(&work, "p/transforms.json", "p/off.json", middle, 1.0, 1.0, 1.0);
    let report = work.json("pose p/off.json --volume a.vdb -o p/found.json");
    let [truth, found] = ["p/transforms.json", "p/found.json"].map(|name| transforms::load(&work.path(name)).unwrap());
    for (i, camera) in report["cameras"].as_array().unwrap().iter().enumerate() {
        assert_eq!(camera["undetermined"], 1, "{camera}");
        assert!(camera["note"].as_str().unwrap().contains("1 of the camera's six directions"), "{camera}");
        assert!(camera["rms_after"].as_f64().unwrap() < 1e-5, "{camera}");
        let [truth, found] = [&truth, &found].map(|capture| capture.frames[i].camera);
        assert!(truth.forward().angle_between(found.forward()) < 1e-4);
        let off = found.position() - truth.position();
        // It came back across the rays, and stayed within what it was moved by along them.
        assert!(off.reject_from(truth.forward()).length() < 0.01, "{off}");
        assert!(off.length() < 0.021 * truth.position().distance(middle), "{off}");
    }
}

#[test]
fn a_ball_is_told_by_its_voxels() {
    let work = Work::new();
    let ball = grid(64, unit(), |p| (-(p - 31.5).length_squared() / 128.0).exp().max(0.01) - 0.01);
    work.write("ball.vdb", &[&ball]);
    let middle = centre(&work, "ball.vdb");
    work.json("render ball.vdb --views 2 --size 64x64 --density-scale auto -o c");
    disturb(&work, "c/transforms.json", "c/off.json", middle, 1.0, 1.0, 1.0);
    work.json("pose c/off.json --volume ball.vdb -o c/found.json");
    let (degrees, percent) = apart(&work, "c/transforms.json", "c/found.json", middle);
    assert!(degrees < 0.05 && percent < 0.05, "{degrees} {percent}");
}

#[test]
fn an_interrupt_writes_what_is_there() {
    let work = Work::new();
    work.write("a.vdb", &[&lumpy()]);
    let middle = centre(&work, "a.vdb");
    work.json("render a.vdb --views 6 --size 256x256 -o c");
    disturb(&work, "c/transforms.json", "c/off.json", middle, 2.0, 2.0, 1.0);
    let child = work.start("pose c/off.json --volume a.vdb -o found.json --report page --json");
    until("the work begins", || work.path("page").exists());
    let out = interrupt(child);
    assert_eq!(out.status.code(), Some(130), "{}", errors(&out));
    assert_eq!(serde_json::from_slice::<Value>(&out.stdout).unwrap()["stopped"], true);
    assert_eq!(transforms::load(&work.path("found.json")).unwrap().frames.len(), 6);
}

#[test]
fn a_search_goes_on_where_it_was_left() {
    let work = Work::new();
    work.write("a.vdb", &[&lumpy()]);
    let middle = centre(&work, "a.vdb");
    work.json("render a.vdb --views 2 --size 32x32 --density-scale auto -o c");
    disturb(&work, "c/transforms.json", "c/off.json", middle, 2.0, 2.0, 1.0);
    let run = |words: &str| work.json(&format!("pose c/off.json --volume a.vdb -o c/found.json {words}"));
    let rms = |report: &Value, key: &str| report[key].as_f64().unwrap();
    let first = run("--iterations 1 --resume");
    let on = run("--resume");
    assert!((rms(&on, "rms_before") / rms(&first, "rms_after") - 1.0).abs() < 1e-3, "{first} {on}");
    assert!(rms(&on, "rms_after") < 0.01 * rms(&first, "rms_before"), "{first} {on}");
    // Motion is told from where the capture has its cameras, not from where the search went on.
    assert!((on["cameras"][0]["rotated_degrees"].as_f64().unwrap() - 2.0).abs() < 0.1, "{on}");
    work.json("render a.vdb --views 3 --size 32x32 -o other");
    work.refused(
        "pose other --volume a.vdb -o c/found.json --resume",
        Code::OutputExists,
        &["c/found.json", "--resume"],
    );
}

#[test]
fn what_cannot_be_used_is_named() {
    let work = Work::new();
    work.write("a.vdb", &[&lumpy()]);
    work.write("empty.vdb", &[&Grid { leaves: vec![], ..grid(8, unit(), |_| 0.0) }]);
    work.json("render a.vdb --views 2 --size 16x16 -o c");
    work.refused("pose none --volume a.vdb -o o.json", Code::NotFound, &["none", "transforms.json"]);
    work.refused("pose c --volume none.vdb -o o.json", Code::NotFound, &["none.vdb"]);
    work.refused("pose c --volume empty.vdb -o o.json", Code::EmptyGrid, &["empty.vdb", "empty", "--grid"]);
    work.refused("pose c --volume a.vdb -o none/o.json", Code::NotFound, &["none/o.json"]);
    work.refused("pose c --volume a.vdb -o o.json --tf none.json", Code::NotFound, &["none.json"]);
    work.refused("pose c -o o.json", Code::Usage, &["--volume"]);
    let mut shaded = transforms::load(&work.path("c")).unwrap();
    shaded.model = Model::PreShaded;
    transforms::save(&work.path("c/shaded.json"), &shaded, &Map::new()).unwrap();
    work.refused("pose c/shaded.json --volume a.vdb -o o.json", Code::Invalid, &["a.vdb", "'emission'", "vec3s"]);
    let mut capture = transforms::load(&work.path("c")).unwrap();
    capture.frames[1].camera.width = 17;
    transforms::save(&work.path("c/wide.json"), &capture, &Map::new()).unwrap();
    work.refused("pose c/wide.json --volume a.vdb -o o.json", Code::Invalid, &["view_001.exr", "16x16", "17x16"]);
    std::fs::remove_file(work.path("c/view_000.exr")).unwrap();
    work.refused("pose c --volume a.vdb -o o.json", Code::NotFound, &["view_000.exr"]);
    assert!(!work.path("o.json").exists());
}
