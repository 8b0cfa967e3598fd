//! Random hard scenes, path-traced for as long as `SOAK_SECONDS` says: no pixel is negative or not a number, no majorant is
//! exceeded, no scene takes beyond all measure.

use crate::alone::alone;
use crate::common::scenes::Draw;
use cumulo::cancel::Cancel;
use cumulo::plan::{Plan, Request};
use cumulo::render::film::{self, Aov, Sampling};
use cumulo::render::path::{Limits, PathTracer};
use std::sync::mpsc;
use std::time::{Duration, Instant};

const AOVS: [Aov; 5] = [Aov::Direct, Aov::Indirect, Aov::Normal, Aov::Variance, Aov::Halves];

/// Seconds after which a scene counts as hanging.
const PATIENCE: Duration = Duration::from_secs(60);

#[test]
fn hard_scenes_stay_finite() {
    // A scene that hangs ends the process.
    if !alone("soak::hard_scenes_stay_finite") {
        return;
    }
    let variable = |name: &str| std::env::var(name).ok().and_then(|v| v.parse().ok());
    let seconds = variable("SOAK_SECONDS").unwrap_or(8);
    let first = variable("SOAK_SEED").unwrap_or(0);
    let (start, mut number, mut slowest) = (Instant::now(), first, (Duration::ZERO, 0));
    while start.elapsed() < Duration::from_secs(seconds) {
        let began = Instant::now();
        let (done, wait) = mpsc::channel::<()>();
        let watch = std::thread::spawn(move || {
            if wait.recv_timeout(PATIENCE) == Err(mpsc::RecvTimeoutError::Timeout) {
                println!("scene {number} hangs");
                std::process::abort();
            }
        });
        let scene = Draw(100_000 * number).hard_scene();
        let never = Cancel::NEVER;
        let request = Request { max_omitted: 0.1 * (number % 2) as f64, ..Request::default() };
        let plan = Plan::new(&scene, &scene.cameras, &request).unwrap();
        let scene = plan.simplify(scene).unwrap();
        let limits = Limits { max_bounces: plan.limits.max_bounces.min(200) };
        let tracer = PathTracer::new(&scene).unwrap().limits(limits);
        let picture = film::render(&tracer, &scene.cameras[0], Sampling::random(8, number), &AOVS, &never).unwrap();
        let values = picture.film.rgba.iter().flatten();
        assert!(values.clone().all(|v| v.is_finite() && *v >= 0.0), "scene {number}: {:?}", picture.film.rgba);
        for plane in &picture.film.planes {
            assert!(plane.samples.iter().all(|v| v.is_finite()), "scene {number}: {} {:?}", plane.name, plane.samples);
        }
        let counts = picture.counts;
        assert_eq!((counts.violations, counts.impossible), (0, 0), "scene {number}: {counts:?}");
        drop(done);
        watch.join().unwrap();
        slowest = slowest.max((began.elapsed(), number));
        number += 1;
    }
    println!(
        "{} scenes in {:.0?}; the slowest, {}, took {:.1?}",
        number - first,
        start.elapsed(),
        slowest.1,
        slowest.0
    );
    assert!(number - first > 20, "{number}");
}
