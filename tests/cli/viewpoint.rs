//! `cumulo viewpoint`: what it finds, that its derivative is one, and how it ends.

use crate::common::fields::{field, grid, lumps, noise, odd, unit};
use crate::common::work::{Work, errors, interrupt, until};
use cumulo::cancel::Cancel;
use cumulo::differentiate::gradient::camera_jacobian::Rows;
use cumulo::error::Code;
use cumulo::formats::{transfer, transforms};
use cumulo::inverse::viewpoint::entropy;
use cumulo::render::dvr::Dvr;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::grid::Grid;
use cumulo::scene::medium::{Medium, Source};
use cumulo::scene::sphere::{Sphere, fibonacci, stepped, upright};
use cumulo::scene::table::Table;
use cumulo::scene::transfer::Transfer;
use cumulo::scene::up::Up;
use glam::{DVec2, DVec3};
use serde_json::Value;
use std::sync::Arc;

static NEVER: Cancel = Cancel::NEVER;

/// Lumps, flat enough that some sides show more than others.
fn lumpy() -> Grid {
    grid(24, unit(), |p| 0.4 * lumps(24)(p * DVec3::new(1.0, 0.8, 1.0)))
}

/// Bars in three directions that cross nowhere.
fn bars() -> Grid {
    grid(24, unit(), |p| {
        let bar = |a: f64, b: f64, x: f64, y: f64| (-((a - x).powi(2) + (b - y).powi(2)) / 4.0).exp();
        0.3 * (bar(p.x, p.y, 7.0, 9.0) + bar(p.y, p.z, 15.0, 14.0) + bar(p.x, p.z, 17.0, 5.0))
    })
}

/// A step, and a slope.
fn table() -> Table {
    let value = |c: f64, s: f64| [c, 0.2, 1.0 - c, s];
    Table::new(vec![0.02, 0.1, 0.2, 0.9], vec![value(0.0, 0.0), value(0.3, 0.8), value(1.0, 0.1), value(0.5, 1.0)])
        .unwrap()
}

#[test]
fn the_derivative_is_that_of_the_entropy() {
    let smooth: Bricks<f32> = field(24, odd(), |p| 0.4 * lumps(24)(p));
    for (name, source) in [("absorption", Source::Grey([0.0; 3])), ("transfer", Source::Transfer(Arc::new(table())))] {
        let dvr = Dvr::new(&smooth, Medium::new(0.7, source)).unwrap().over([1.0; 3]);
        let sphere = Sphere::around(&smooth.outline(), [48, 40], 35.0, Up::Z).unwrap();
        for (i, direction) in fibonacci(6, Up::Z).into_iter().chain([DVec3::Z, DVec3::NEG_Z]).enumerate() {
            let axes = stepped(&upright(direction, Up::Z), DVec2::new(0.05, -0.03));
            let camera = sphere.camera(&axes);
            let at = |step: DVec2| {
                let camera = sphere.camera(&stepped(&axes, step));
                entropy::value(&Rows {
                    renderer: &dvr,
                    reference: None,
                    camera: &camera,
                    rays_per_edge: 1,
                    cancel: &NEVER,
                })
                .value
            };
            let found = entropy::gradient(
                &Rows { renderer: &dvr, reference: None, camera: &camera, rays_per_edge: 1, cancel: &NEVER },
                sphere.centre,
            );
            assert!((found.value - at(DVec2::ZERO)).abs() < 1e-6, "{name} {i}: one value from both walks");
            for (axis, unit) in [(axes.x_axis, DVec2::X), (axes.y_axis, DVec2::Y)] {
                // 32-bit densities leave errors of about 1e-7 in the entropy: 1e-4 in the difference. Its own error is
                // h²/6 of the third derivative.
                let h = 1e-3;
                let difference = (at(h * unit) - at(-h * unit)) / (2.0 * h);
                let slope = found.by_turn.dot(axis);
                assert!(
                    (slope - difference).abs() < 3e-4 + 0.01 * difference.abs(),
                    "{name} {i}: {slope} {difference}"
                );
            }
        }
    }
}

#[test]
fn the_best_start_reaches_the_best_sample() {
    let work = Work::new();
    work.write("lumpy.vdb", &[&lumpy()]);
    work.write("bars.vdb", &[&bars()]);
    for name in ["lumpy", "bars"] {
        std::fs::create_dir(work.path(name)).unwrap();
        let report =
            work.json(&format!("viewpoint {name}.vdb --size 96x96 --samples 64 -o {name}/best.json --pictures {name}"));
        let (best, sampled) = (report["entropy"].as_f64().unwrap(), report["sampled_best_entropy"].as_f64().unwrap());
        assert!(best >= sampled, "{name}: {best} {sampled}");
        assert!(sampled > 0.5 && best < 1.0 && report["blank"] == false);
        let starts = report["starts"].as_array().unwrap();
        assert_eq!(starts.len(), 8);
        let top = starts.iter().map(|s| s["entropy"].as_f64().unwrap()).fold(0.0, f64::max);
        assert_eq!(top, best);
        // What is written is what was found: the entropy of the first picture is that of the report.
        let capture = transforms::load(&work.path(&format!("{name}/best.json"))).unwrap();
        assert_eq!(capture.frames.len() as u64, report["views"].as_u64().unwrap());
        let alphas: Vec<f64> =
            work.picture(&format!("{name}/view_000.exr")).rgba.iter().map(|p| f64::from(p[3])).collect();
        let s: f64 = alphas.iter().sum();
        let p = alphas.iter().map(|a| a / s).filter(|p| *p > 0.0);
        let h = -p.map(|p| p * p.log2()).sum::<f64>() / (alphas.len() as f64).log2();
        assert!((h - best).abs() < 1e-5, "{name}: {h} {best}");
    }
}

#[test]
fn a_search_goes_on_where_it_was_left() {
    let work = Work::new();
    work.write("bars.vdb", &[&bars()]);
    let run = |words: &str| work.json(&format!("viewpoint bars.vdb --size 64x64 -o best.json {words}"));
    let entropy = |report: &Value| report["entropy"].as_f64().unwrap();
    let first = run("--starts 8 --resume");
    let alone = work.json("viewpoint bars.vdb --size 64x64 --starts 1 --iterations 1 -o alone.json --pictures alone");
    let on = work.json("viewpoint bars.vdb --size 64x64 --starts 1 --iterations 1 --init best.json -o on.json");
    let again = run("--starts 8 --iterations 1 --resume");
    assert_eq!(again["starts"].as_array().unwrap().len() as u64, 8 + first["views"].as_u64().unwrap());
    assert_eq!(on["starts"].as_array().unwrap().len() as u64, 1 + first["views"].as_u64().unwrap());
    assert!(entropy(&on) > entropy(&first) - 1e-4 && entropy(&on) >= entropy(&alone), "{first} {alone} {on}");
}

/// Extinction by density, of one color.
fn transfer_function(work: &Work, name: &str, points: &[[f64; 2]]) {
    let points = points.iter().map(|[density, extinction]| [*density, 1.0, 0.5, 0.2, *extinction]).collect();
    transfer::save(&work.path(name), &Transfer::Piecewise { points }, None, None).unwrap();
}

fn without_times(mut report: Value) -> Value {
    for key in ["seconds", "sampled_seconds", "render_seconds", "equivalent_renders", "output", "pictures"] {
        report.as_object_mut().unwrap().remove(key);
    }
    report
}

#[test]
fn threads_change_nothing() {
    let work = Work::new();
    work.write("a.vdb", &[&bars()]);
    let run = |n: u32| {
        std::fs::create_dir(work.path(&n.to_string())).unwrap();
        let report = work.json(&format!(
            "viewpoint a.vdb --starts 5 --size 130x140 --samples 7 --threads {n} -o {n}/b.json --pictures {n}"
        ));
        let text = std::fs::read_to_string(work.path(&format!("{n}/b.json"))).unwrap();
        let frames = serde_json::from_str::<Value>(&text).unwrap()["frames"].clone();
        let picture = work.picture(&format!("{n}/view_000.exr"));
        (without_times(report), frames, picture)
    };
    let one = run(1);
    assert!(one == run(2) && one == run(5));
}

#[test]
fn a_transfer_function_decides_what_shows() {
    let work = Work::new();
    work.write("a.vdb", &[&lumpy()]);
    transfer_function(&work, "thin.tf.json", &[[0.1, 0.0], [0.12, 2.0], [0.14, 0.0]]);
    let out = work
        .command("viewpoint a.vdb --tf thin.tf.json --size 64x64 -o b.json --pictures seen --json")
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", errors(&out));
    let capture = transforms::load(&work.path("b.json")).unwrap();
    assert!(capture.transfer.is_some() && capture.background == [0.0; 3]);
    assert!(work.picture("seen/view_000.exr").rgba.iter().any(|p| p[0] > 0.01));
    // What is usual, and what has no error, find as much.
    let fast: Value = serde_json::from_slice(&out.stdout).unwrap();
    let exact =
        work.json("viewpoint a.vdb --tf thin.tf.json --size 64x64 --quadrature exact -o exact.json --pictures p");
    let of = |report: &Value| report["entropy"].as_f64().unwrap();
    assert!((of(&fast) - of(&exact)).abs() < 2e-3 && of(&exact) > 0.1, "{} {}", of(&fast), of(&exact));
}

#[test]
fn cameras_alone_are_written_unless_pictures_are_asked_for() {
    let work = Work::new();
    work.write("a.vdb", &[&lumpy()]);
    let before = work.files("").len();
    let report = work.json("viewpoint a.vdb --size 32x32 --starts 4 --iterations 4 --hemisphere --samples 6 -o b.json");
    assert!(report.get("pictures").is_none());
    assert_eq!(work.files("").len(), before + 1, "the capture alone");
    let starts = report["starts"].as_array().unwrap();
    assert_eq!(starts.len(), 4);
    // Nothing that was tried or found lies in the lower half.
    for start in starts {
        assert!(start["start"][2].as_f64().unwrap() >= 0.0 && start["end"][2].as_f64().unwrap() >= 0.0, "{start}");
    }
    let capture = transforms::load(&work.path("b.json")).unwrap();
    assert!(capture.frames.iter().all(|f| f.camera.forward().z <= 0.0 && !f.picture.exists()));
    // The cameras can be rendered into the very folder that the capture names.
    work.json("render a.vdb --cameras b.json -o b");
    assert!(capture.frames.iter().all(|f| f.picture.exists()));
}

#[test]
fn blank_and_round_volumes_end_at_once() {
    let work = Work::new();
    // A transfer function that absorbs nowhere where there is density.
    work.write("a.vdb", &[&lumpy()]);
    transfer_function(&work, "none.tf.json", &[[5.0, 0.0], [6.0, 1.0]]);
    let out = work.command("viewpoint a.vdb --tf none.tf.json --size 32x32 -o b.json --json").output().unwrap();
    assert!(out.status.success() && errors(&out).contains("blank"), "{}", errors(&out));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((&report["blank"], &report["entropy"]), (&true.into(), &0.0.into()));
    assert!(report["starts"].as_array().unwrap().iter().all(|s| s["iterations"] == 1));
    // A cube of one density.
    work.write("cube.vdb", &[&grid(16, unit(), |_| 0.1)]);
    let report = work.json("viewpoint cube.vdb --size 32x32 --starts 3 -o c.json --pictures c");
    assert!(report["entropy"].as_f64().unwrap() > 0.5 && report["blank"] == false);
    // A single voxel, a single pixel.
    work.write("voxel.vdb", &[&grid(8, unit(), |p| if p == DVec3::splat(4.0) { 1.0 } else { 0.0 })]);
    work.json("viewpoint voxel.vdb --size 9x5 --starts 1 --density-scale auto -o d.json --pictures d");
    assert_eq!(work.json("viewpoint voxel.vdb --size 1x1 --starts 2 -o e.json --pictures e")["entropy"], 0.0);
}

#[test]
fn the_page_shows_the_paths() {
    let work = Work::new();
    work.write("a.vdb", &[&bars()]);
    let report = work.json("viewpoint a.vdb --size 48x48 --samples 20 --report page -o b.json");
    assert_eq!(report["report"], "page/index.html");
    let page = std::fs::read_to_string(work.path("page/index.html")).unwrap();
    assert_eq!(page.matches("<circle").count(), 2 + 20 + 8 + 1, "discs, samples, starts, best");
    assert!(page.contains("<polyline") && page.contains("start 7") && !page.contains("http://"));
}

#[test]
fn an_interrupt_writes_what_is_there() {
    let work = Work::new();
    work.write("a.vdb", &[&bars()]);
    let child =
        work.start("viewpoint a.vdb --size 64x64 --samples 1000000 --report page -o b.json --pictures p --json");
    until("the work begins", || work.path("page").exists());
    let out = interrupt(child);
    assert_eq!(out.status.code(), Some(130), "{}", errors(&out));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((&report["stopped"], &report["sampled_best_entropy"]), (&true.into(), &Value::Null));
    let capture = transforms::load(&work.path("b.json")).unwrap();
    assert!(capture.frames.iter().all(|f| f.picture.exists()) && work.path("page/index.html").exists());
}

#[test]
fn what_cannot_be_used_is_named() {
    let work = Work::new();
    let empty = Grid { leaves: vec![], ..grid(8, unit(), |_| 0.0) };
    work.write("empty.vdb", &[&empty]);
    work.write("a.vdb", &[&grid(8, unit(), |p| noise(p.x as u64))]);
    work.refused("viewpoint empty.vdb -o b.json", Code::EmptyGrid, &["empty.vdb", "empty", "--grid"]);
    work.refused("viewpoint none.vdb -o b.json", Code::NotFound, &["none.vdb"]);
    work.refused("viewpoint a.vdb -o none/b.json", Code::NotFound, &["none/b.json"]);
    work.refused("viewpoint a.vdb -o b.json --starts 0", Code::Usage, &["--starts"]);
    work.refused("viewpoint a.vdb -o b.json --iterations 0", Code::Usage, &["--iterations"]);
    work.refused("viewpoint a.vdb -o b.json --size 0x9", Code::Usage, &["--size"]);
    work.refused("viewpoint a.vdb -o b.json --fov 180", Code::Usage, &["--fov", "170"]);
    work.refused("viewpoint a.vdb -o b.json --tf none.json", Code::NotFound, &["none.json"]);
    work.refused("viewpoint a.vdb -o b.json --size 60000x60000", Code::MemoryLimit, &["memory", "--size"]);
    work.json("render a.vdb --views 1 --size 8x8 -o views");
    let before = work.files("views");
    work.refused("viewpoint a.vdb -o b.json --pictures views", Code::Invalid, &["another capture", "--pictures"]);
    assert_eq!(before, work.files("views"));
    work.json("viewpoint a.vdb -o views/b.json --pictures seen --starts 1 --size 8x8");
    let capture = transforms::load(&work.path("views/b.json")).unwrap();
    assert!(capture.frames[0].picture.exists(), "{}", capture.frames[0].picture.display());
    assert!(!work.path("b.json").exists());
}
