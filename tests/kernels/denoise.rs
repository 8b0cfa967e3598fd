//! Denoising of path-traced sequences: nearer to converged pictures, and steadier, than what goes in.

use crate::common::fields;
use cumulo::cancel::Cancel;
use cumulo::denoise::{Ahead, Denoiser, Estimate, Frame, Lookahead, Method, Settings};
use cumulo::math::Affine;
use cumulo::scene::blur::Blur;

use cumulo::render::film::{self, Aov, Sampling, View};
use cumulo::render::path::PathTracer;
use cumulo::scene::camera::{Camera, Projection};
use cumulo::scene::environment::Environment;
use cumulo::scene::film::Film;
use cumulo::scene::light::Light;
use cumulo::scene::medium::{Medium, Scattering};
use cumulo::scene::phase::Phase;
use cumulo::scene::scene::Scene;
use cumulo::scene::volume::Volume;
use glam::{DVec2, DVec3, Vec2, Vec3};

const WIDTH: u32 = 48;
const HEIGHT: u32 = 36;
const SIZE: [usize; 2] = [WIDTH as usize, HEIGHT as usize];
const FRAMES: u32 = 24;
/// Frames after which models have learned enough to be judged.
const LEARNING: u32 = 12;

/// A camera on a circle around the unit cube.
fn camera(angle: f64) -> Camera {
    let eye = DVec3::new(0.5 + 2.2 * angle.sin(), 0.5 - 2.2 * angle.cos(), 0.9);
    Camera {
        camera_to_world: Camera::look_at(eye, DVec3::splat(0.5), DVec3::Z),
        projection: Projection::Perspective,
        focal: DVec2::splat(1.6 * f64::from(WIDTH)),
        centre: 0.5 * DVec2::new(f64::from(WIDTH), f64::from(HEIGHT)),
        width: WIDTH,
        height: HEIGHT,
        near: 0.0,
        blur: Blur::default(),
    }
}

/// A frame of two paths a pixel with its motion, and the converged one.
struct Shot {
    noisy: Vec<Vec3>,
    alpha: Vec<f32>,
    motion: Vec<Vec2>,
    /// Motion to the frame after.
    onward: Vec<Vec2>,
    truth: Vec<Vec3>,
}

fn colors(film: &Film) -> Vec<Vec3> {
    film.rgba.iter().map(|[r, g, b, _]| Vec3::new(*r, *g, *b)).collect()
}

/// Lumps of smoke in sun and sky light; the camera and the sun turn by these angles from frame to frame.
fn shots(turn: f64, sun_turns: f64, extinction: f64) -> Vec<Shot> {
    let lumps = fields::lumps(32);
    let lattice = Affine::uniform(1.0 / 32.0, DVec3::ZERO).unwrap();
    let field = fields::field::<f32>(32, lattice, |p| (lumps(p) - 0.1).max(0.0));
    let shot = |frame: u32| {
        let angle = 0.5 + sun_turns * f64::from(frame);
        let direction = DVec3::new(angle.cos(), -0.5 * angle.sin(), 0.8);
        let sun = Light::Sun { direction, irradiance: Vec3::new(4.0, 3.5, 3.0), angle: 0.05 };
        let scattering = Some(Scattering::new([0.95, 0.9, 0.8], Phase::HenyeyGreenstein(0.3)));
        let medium = Medium { scattering, ..Medium::absorbing(extinction) };
        let scene = Scene {
            volumes: vec![Volume::Density(field.clone(), medium)],
            environment: Environment::constant([0.1, 0.15, 0.3]),
            lights: vec![sun],
            ..Scene::default()
        };
        let tracer = PathTracer::new(&scene).unwrap().background([0.0; 3]);
        let [before, camera, after] = [-1.0, 0.0, 1.0].map(|step| camera(turn * (f64::from(frame) + step)));
        let view = View { camera: &camera, before: Some(&before), after: Some(&after), holdout: None, velocities: &[] };
        let go = Cancel::NEVER;
        let noisy = film::render(&tracer, view, Sampling::random(2, frame.into()), &[Aov::Motion], &go).unwrap().film;
        let paths = if frame < LEARNING { 1 } else { 128 };
        let truth =
            film::render(&tracer, &camera, Sampling::random(paths, 1000 + u64::from(frame)), &[], &go).unwrap().film;
        let [x, y, z, w] = ["X", "Y", "Z", "W"].map(|name| noisy.plane(&format!("Vector.{name}")).unwrap());
        let motion = x.iter().zip(y).map(|(right, up)| Vec2::new(*right, -up)).collect();
        let onward = z.iter().zip(w).map(|(left, up)| Vec2::new(-left, *up)).collect();
        let alpha = noisy.rgba.iter().map(|pixel| pixel[3]).collect();
        Shot { noisy: colors(&noisy), alpha, motion, onward, truth: colors(&truth) }
    };
    (0..FRAMES).map(shot).collect()
}

/// What the frames that follow show of each.
fn aheads(shots: &[Shot]) -> Vec<Ahead> {
    let mut lookahead = Lookahead::default();
    let mut look = |shot: &Shot| {
        let mut ahead = Ahead::default();
        let (motion, alpha) = (Some(&shot.onward[..]), Some(&shot.alpha[..]));
        let frame = Frame { size: SIZE, color: &shot.noisy, motion, alpha, ahead: None };
        lookahead.observe(&frame, &mut ahead).unwrap();
        ahead
    };
    let mut aheads: Vec<Ahead> = shots.iter().rev().map(&mut look).collect();
    aheads.reverse();
    aheads
}

/// Mean squared error of the judged frames, and of their differences from frame to frame: flicker.
fn errors(shots: &[Shot], frames: &[Vec<Vec3>]) -> [f64; 2] {
    let mean = |of: &mut dyn Iterator<Item = Vec3>| {
        let (sum, count) = of.fold((0.0, 0.0), |(s, n), v| (s + f64::from(v.length_squared()), n + 1.0));
        sum / count
    };
    let judged = LEARNING as usize..FRAMES as usize;
    let error = |frame: usize, pixel: usize| frames[frame][pixel] - shots[frame].truth[pixel];
    let pixels = 0..(WIDTH * HEIGHT) as usize;
    let each = judged.clone().flat_map(|frame| pixels.clone().map(move |pixel| (frame, pixel)));
    let later = each.clone().filter(|(frame, _)| *frame > judged.start);
    [
        mean(&mut each.map(|(frame, pixel)| error(frame, pixel))),
        mean(&mut later.map(|(frame, pixel)| error(frame, pixel) - error(frame - 1, pixel))),
    ]
}

/// Of two paths a pixel, the error falls to less than half as published, and to less than a tenth with a feature that is
/// independent of the colors, to less than a twenty-eighth where alpha guides it, and to less than a fortieth where the frames
/// that follow are known, too: at rest, while the camera moves, while the sun moves, and in thin smoke.
#[test]
fn sequences_come_nearer_to_converged_ones() {
    for (name, turn, sun_turns, extinction) in
        [("at rest", 0.0, 0.0, 20.0), ("camera", 0.02, 0.0, 20.0), ("sun", 0.0, 0.03, 20.0), ("thin", 0.02, 0.0, 4.0)]
    {
        let shots = shots(turn, sun_turns, extinction);
        let noisy: Vec<Vec<Vec3>> = shots.iter().map(|shot| shot.noisy.clone()).collect();
        let [error, flicker] = errors(&shots, &noisy);
        let aheads = aheads(&shots);
        for (method, guided, looks, left) in [
            (Method::Wrls, false, false, 0.5),
            (Method::Wrls2, false, false, 0.1),
            (Method::Wrls2, true, false, 0.035),
            (Method::Wrls2, true, true, 0.025),
        ] {
            let mut denoiser = Denoiser::new(method, Settings::default()).unwrap();
            let denoise = |(shot, ahead): (&Shot, &Ahead)| {
                let alpha = guided.then_some(&shot.alpha[..]);
                let ahead = looks.then_some(ahead);
                let motion = Some(&shot.motion[..]);
                denoiser.denoise(&Frame { size: SIZE, color: &shot.noisy, motion, alpha, ahead }).unwrap().color
            };
            let frames: Vec<Vec<Vec3>> = shots.iter().zip(&aheads).map(denoise).collect();
            let [now, flickers] = errors(&shots, &frames);
            let decibels = |ratio: f64| -10.0 * ratio.log10();
            println!(
                "{name}, {method:?}, guide {guided}, ahead {looks}: error {:.1} dB, flicker {:.1} dB lower",
                decibels(now / error),
                decibels(flickers / flicker)
            );
            assert!(now < left * error && flickers < left * flicker, "{name}, {method:?}: {now} of {error}");
        }
    }
}

/// Columns and rows of drawn sequences.
const SIDE: usize = 96;

/// Truth of the drawn pixel of a frame.
type Picture = fn(f32, f32, f32) -> f32;

/// A drawn sequence.
struct Drawn {
    truth: Vec<Vec<Vec3>>,
    frames: Vec<Vec<Vec3>>,
    found: Vec<Vec<Vec3>>,
    estimates: Vec<Option<Estimate>>,
}

/// Decibels of a picture.
fn decibels(picture: &[Vec3], truth: &[Vec3]) -> f64 {
    let squares = picture.iter().zip(truth).map(|(a, b)| f64::from((*a - *b).length_squared()));
    -10.0 * (squares.sum::<f64>() / (3 * SIDE * SIDE) as f64).max(1e-20).log10()
}

/// Draws 24 frames with Gaussian noise of a deviation, in both directions denoised with this motion from frame to frame, and with
/// all of alpha or none.
fn drawn(picture: Picture, deviation: f32, motion: Vec2, opaque: bool) -> Drawn {
    let mut state = 7_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 40) as f32 + 0.5) / 16_777_216.0
    };
    let mut normal = || (-2.0 * random().ln()).sqrt() * (std::f32::consts::TAU * random()).cos();
    let shade = Vec3::new(1.0, 0.9, 0.7);
    let at = |frame: u32, i: usize| {
        let (x, y) = ((i % SIDE) as f32 + 0.5, (i / SIDE) as f32 + 0.5);
        shade * picture(frame as f32, x, y)
    };
    let truth: Vec<Vec<Vec3>> = (0..FRAMES).map(|f| (0..SIDE * SIDE).map(|i| at(f, i)).collect()).collect();
    let mut noisy = |v: &Vec3| *v + deviation * Vec3::new(normal(), normal(), normal());
    let frames: Vec<Vec<Vec3>> = truth.iter().map(|truth| truth.iter().map(&mut noisy).collect()).collect();
    let alpha = vec![1.0; SIDE * SIDE];
    let alpha = opaque.then_some(&alpha[..]);
    let [back, onward] = [vec![-motion; SIDE * SIDE], vec![motion; SIDE * SIDE]];
    let [back, onward] = [&back, &onward].map(|motions| (motion != Vec2::ZERO).then_some(&motions[..]));
    let mut lookahead = Lookahead::default();
    let mut look = |color: &Vec<Vec3>| {
        let mut ahead = Ahead::default();
        let frame = Frame { size: [SIDE; 2], color, motion: onward, alpha, ahead: None };
        lookahead.observe(&frame, &mut ahead).unwrap();
        ahead
    };
    let mut aheads: Vec<Ahead> = frames.iter().rev().map(&mut look).collect();
    aheads.reverse();
    let mut denoiser = Denoiser::new(Method::Wrls2, Settings::default()).unwrap();
    let denoise = |denoiser: &mut Denoiser, (color, ahead): (&Vec<Vec3>, &Ahead)| {
        let frame = Frame { size: [SIDE; 2], color, motion: back, alpha, ahead: Some(ahead) };
        let denoised = denoiser.denoise(&frame).unwrap();
        (denoised.color, denoised.estimate)
    };
    // As the command does.
    frames.iter().zip(&aheads).take(6).for_each(|frame| drop(denoise(&mut denoiser, frame)));
    denoiser.rewind();
    let (found, estimates) = frames.iter().zip(&aheads).map(|frame| denoise(&mut denoiser, frame)).unzip();
    Drawn { truth, frames, found, estimates }
}

fn checkers(_: f32, x: f32, y: f32) -> f32 {
    if ((x / 6.0).floor() + (y / 6.0).floor()) % 2.0 < 1.0 { 0.8 } else { 0.1 }
}

fn shade(_: f32, x: f32, y: f32) -> f32 {
    0.5 + 0.4 * (0.05 * x).sin() * (0.04 * y).cos()
}

/// Texture at rest stays, as far as its noise allows, and noise is no texture: the mean of the frames has 53.8 dB of noise of
/// 1 %, and 33.8 of 10 %.
#[test]
fn texture_at_rest_stays_and_noise_does_not() {
    for opaque in [false, true] {
        let middle = |picture, deviation| {
            let Drawn { truth, found, .. } = drawn(picture, deviation, Vec2::ZERO, opaque);
            decibels(&found[FRAMES as usize / 2], &truth[0])
        };
        let textured = [0.0, 0.01, 0.1].map(|deviation| middle(checkers, deviation));
        let smooth = [0.0, 0.1].map(|deviation| middle(shade, deviation));
        // Frames near an end have as many others to learn from, and thin lines are no bright paths.
        let lines: Picture = |_, x, _| if x as u32 % 16 == 3 { 0.9 } else { 0.1 };
        for (name, picture) in [("checkers", checkers as Picture), ("lines", lines)] {
            for deviation in [0.01, 0.1] {
                let Drawn { truth, frames, found, .. } = drawn(picture, deviation, Vec2::ZERO, opaque);
                let gain = |f: usize| decibels(&found[f], &truth[f]) - decibels(&frames[f], &truth[f]);
                let worst = (0..FRAMES as usize).map(gain).fold(f64::INFINITY, f64::min);
                println!("{name}, noise {deviation}: at worst {worst:+.1} dB");
                assert!(worst > 9.5, "{name}, noise {deviation}: {worst}");
            }
        }
        println!("opaque {opaque}: checkerboard {textured:.1?} dB, shade {smooth:.1?} dB");
        assert!(textured.iter().zip([120.0, 52.8, 32.5]).all(|(found, least)| *found > least), "{textured:?}");
        assert!(smooth[0] > 85.0 && smooth[1] > 44.0, "{smooth:?}");
    }
}

/// Whatever a sequence does, no frame of it comes out farther from the truth than it went in: a light that is halved at once, a
/// shot that is mirrored, and one that is another; lights that alternate, change at random and pass in bands; points whose light
/// varies; a spot and checkers that move without a motion; shades, waves, sharp checkers and text that move with theirs.
#[test]
fn no_frame_is_harmed() {
    let halved: Picture = |t, x, y| shade(t, x, y) * if t < 12.0 { 1.0 } else { 0.5 };
    let mirrored: Picture = |t, x, y| {
        let x = if t < 12.0 { x } else { SIDE as f32 - x };
        0.1 * shade(t, x, y) + 0.9 * (-((x - 30.0).powi(2) + (y - 45.0).powi(2)) / 400.0).exp()
    };
    let cut: Picture = |t, x, y| if t < 12.0 { checkers(t, x, y) } else { 0.5 + 0.3 * (0.7 * x + 0.4 * y).sin() };
    let spot: Picture = |t, x, y| (-((x - 15.0 - 2.5 * t).powi(2) + (y - 45.0).powi(2)) / 150.0).exp();
    let shades: Picture = |t, x, y| shade(t, x - 0.37 * t, y - 0.21 * t);
    let waves: Picture = |t, x, y| 0.5 + 0.2 * (0.9 * (x - 0.37 * t)).sin() * (0.8 * (y - 0.21 * t)).sin();
    let alternating: Picture = |t, x, y| checkers(t, x, y) * (1.0 + 0.3 * (t % 2.0));
    let random: Picture = |t, x, y| checkers(t, x, y) * (1.0 + 0.05 * (7.3 * t * t).sin());
    let bands: Picture = |t, x, y| checkers(t, x, y) * (1.0 + 0.1 * (y / 15.0 - 1.3 * t).sin());
    let passing: Picture = |t, x, y| checkers(t, x + 96.0 - 2.0 * t, y);
    // Means over the pixels of checkers that move.
    let sharp: Picture = |t, x, y| {
        let at = |i: i32| ((i % 4) as f32 / 4.0 - 0.375, (i / 4) as f32 / 4.0 - 0.375);
        let of = |(a, b): (f32, f32)| checkers(t, x + 96.0 + a - 0.37 * t, y + 96.0 + b - 0.21 * t);
        (0..16).map(|i| of(at(i))).sum::<f32>() / 16.0
    };
    // Means over the pixels of letters of pixels two wide.
    let prose: Picture = |t, x, y| {
        let at = |i: i32| ((i % 4) as f32 / 4.0 - 0.375, (i / 4) as f32 / 4.0 - 0.375);
        let letter = |x: f32, y: f32| {
            let [i, j] = [x as u32 / 2, y as u32 / 2];
            if j % 6 < 4 && (i * i * 3 + j * 5 + i * j) % 7 < 3 { 0.05 } else { 0.9 }
        };
        let of = |(a, b): (f32, f32)| letter(x + 96.0 + a - 0.37 * t, y + 96.0 + b - 0.21 * t);
        (0..16).map(|i| of(at(i))).sum::<f32>() / 16.0
    };
    // Its edges lie on those of pixels, so that single frames differ from all around.
    let hard: Picture = |t, x, y| checkers(t, x + 96.0 - 0.37 * t, y + 96.0 - 0.21 * t);
    let whole: Picture = |t, x, y| checkers(t, x + 96.0 - t, y + 96.0 - t);
    let stars: Picture = |_, x, y| if (x as u32 * 29 + y as u32 * 31).is_multiple_of(151) { 0.8 } else { 0.1 };
    let points: Picture = |t, x, y| {
        if (x as u32 * 29 + y as u32 * 31).is_multiple_of(151) { 30.0 + 1.5 * (0.5 * t).sin() } else { 0.08 }
    };
    let texts: Picture = |t, x, y| {
        let [i, j] = [(x + 96.0 - 1.5 * t) as u32 / 2, y as u32 / 2];
        if j % 6 < 4 && (i * i * 3 + j * 5 + i * j) % 7 < 3 { 0.05 } else { 0.9 }
    };
    let slow = Vec2::new(0.37, 0.21);
    // Of frames with more decibels than these no more is asked: resampling misses a little of text. The last number is the
    // least gain at the most noise: errors as large as the noise pass by chance where resampling misses much.
    for (name, picture, motion, most, least) in [
        ("at rest", checkers as Picture, Vec2::ZERO, 80.0, -0.1),
        ("light halved", halved, Vec2::ZERO, 80.0, -0.1),
        ("light alternates", alternating, Vec2::ZERO, 80.0, -0.1),
        ("light at random", random, Vec2::ZERO, 80.0, -0.1),
        ("bands of light", bands, Vec2::ZERO, 80.0, -0.1),
        ("mirrored", mirrored, Vec2::ZERO, 80.0, -0.1),
        ("cut", cut, Vec2::ZERO, 80.0, -0.1),
        ("spot without motion", spot, Vec2::ZERO, 80.0, -0.1),
        ("checkers without motion", passing, Vec2::ZERO, 80.0, -0.1),
        ("stars", stars, Vec2::ZERO, 80.0, -0.1),
        ("varying points", points, Vec2::ZERO, 80.0, -0.1),
        ("text without motion", texts, Vec2::ZERO, 80.0, -3.5),
        ("checkers by whole pixels", whole, Vec2::ONE, 80.0, -0.1),
        ("hard checkers", hard, slow, 80.0, -0.1),
        ("shades", shades, slow, 80.0, -0.1),
        ("waves", waves, slow, 70.0, -0.1),
        ("sharp checkers", sharp, slow, 75.0, -0.1),
        ("text", prose, slow, 61.0, -0.1),
    ] {
        for deviation in [0.0, 0.01, 0.1] {
            let Drawn { truth, frames, found, .. } = drawn(picture, deviation, motion, false);
            let gain = |f: usize| decibels(&found[f], &truth[f]) - decibels(&frames[f], &truth[f]).min(most);
            let worst = (0..FRAMES as usize).min_by(|a, b| gain(*a).total_cmp(&gain(*b))).unwrap();
            println!("{name}, noise {deviation}: at worst {:+.1} dB, in frame {worst}", gain(worst));
            let least = if deviation == 0.1 { least } else { -0.1 };
            assert!(gain(worst) >= least, "{name}, noise {deviation}: {} in frame {worst}", gain(worst));
        }
    }
}

/// A frame that no other shows keeps its detail where that is told from noise, and loses noise elsewhere: a single picture, and a
/// sequence whose motions are not numbers.
#[test]
fn frames_that_no_other_shows_are_not_smoothed_away() {
    let lines: Picture = |_, x, _| if x as u32 % 16 == 3 { 0.9 } else { 0.1 };
    let waves: Picture = |_, x, y| 0.5 + 0.3 * (0.7 * x + 0.4 * y).sin();
    let half: Picture = |t, x, y| if x < 40.0 { checkers(t, x, y) } else { shade(t, x, y) };
    // Decibels without noise, and the gain in decibels with noise of 1 and of 10 %.
    for (name, picture, clean, least) in [
        ("checkers", checkers as Picture, 120.0, [-0.1, -4.2]),
        ("lines", lines, 120.0, [-0.1, -0.1]),
        ("waves", waves, 50.0, [-0.1, -0.1]),
        ("half checkers", half, 85.0, [-0.1, -0.1]),
        ("shade", shade, 120.0, [8.5, 8.5]),
    ] {
        for deviation in [0.0, 0.01, 0.1] {
            let Drawn { truth, frames, found, .. } = drawn(picture, deviation, Vec2::NAN, false);
            let frame = Frame { size: [SIDE; 2], color: &frames[9], ..Frame::default() };
            let alone = Denoiser::new(Method::Wrls2, Settings::default()).unwrap().denoise(&frame).unwrap().color;
            let [given, alone, lost] = [&frames[9], &alone, &found[9]].map(|picture| decibels(picture, &truth[9]));
            println!("{name}, noise {deviation}: {given:.1} dB, alone {alone:.1}, without motion {lost:.1}");
            let least = if deviation == 0.0 { clean } else { given + least[usize::from(deviation > 0.05)] };
            assert!(alone.min(lost) > least, "{name}, noise {deviation}: {alone} {lost}");
            // Of a single picture lines and edges are told from noise as such, too.
            assert!(alone > given.min(80.0) - 0.1, "{name}, noise {deviation}: {alone}");
        }
    }
}

/// Noise and error are told without a reference wherever the frames around show the same signal, in whatever light, and
/// nothing is told where they do not: of noise-free frames, a spot that moves without a motion, and texture that resampling loses.
#[test]
fn errors_are_told_or_said_to_be_unknown() {
    let spot: Picture = |t, x, y| (-((x - 15.0 - 2.5 * t).powi(2) + (y - 45.0).powi(2)) / 150.0).exp();
    let shades: Picture = |t, x, y| shade(t, x - 0.37 * t, y - 0.21 * t);
    let fast: Picture = |t, x, y| 0.5 + 0.2 * (2.6 * (x - 0.37 * t)).sin() * (2.4 * (y - 0.21 * t)).sin();
    let flicker: Picture = |t, x, y| shade(t, x, y) * (1.0 + 0.03 * (7.3 * t * t).sin());
    let slow = Vec2::new(0.37, 0.21);
    // The last numbers are the least and the largest difference in decibels of what is told: errors a hundredth of the
    // noise and less are of the size of chance.
    for (name, picture, motion, deviation, told) in [
        ("checkers", checkers as Picture, Vec2::ZERO, 0.01, Some([-0.5, 0.5])),
        ("checkers", checkers, Vec2::ZERO, 0.1, Some([-0.5, 0.5])),
        ("smooth", shade, Vec2::ZERO, 0.1, Some([-4.5, 1.0])),
        ("shades", shades, slow, 0.1, Some([-4.5, 1.0])),
        ("checkers", checkers, Vec2::ZERO, 0.0, None),
        ("spot without motion", spot, Vec2::ZERO, 0.01, None),
        ("fast waves", fast, slow, 0.001, None),
        ("flicker", flicker, Vec2::ZERO, 0.05, Some([-4.5, 1.0])),
    ] {
        let Drawn { truth, frames, found, estimates } = drawn(picture, deviation, motion, false);
        assert!(estimates[0].is_none() && estimates[FRAMES as usize - 1].is_none(), "{name}");
        let known: Vec<usize> = (0..FRAMES as usize).filter(|f| estimates[*f].is_some()).collect();
        let all = known.iter().fold(Estimate::default(), |all, f| all.plus(estimates[*f].unwrap()));
        assert_eq!(all.fits(), told.is_some(), "{name}, noise {deviation}");
        let Some([least, most]) = told else { continue };
        let rms = |pictures: &[Vec<Vec3>]| {
            let mean = known.iter().map(|f| 10_f64.powf(-0.1 * decibels(&pictures[*f], &truth[*f]))).sum::<f64>();
            (mean / known.len() as f64).sqrt()
        };
        let [noise, error] = [rms(&frames), rms(&found)];
        let off = 20.0 * (error / all.error()).log10();
        println!(
            "{name}, noise {deviation}: {:.4} of {noise:.4}, error {:.5} of {error:.5}, {off:+.2} dB",
            all.noise(),
            all.error()
        );
        assert!((all.noise() / noise - 1.0).abs() < 0.03, "{name}: {} of {noise}", all.noise());
        assert!((least..most).contains(&off) && error < all.error_high(), "{name}: {off} dB, {error}, {all:?}");
    }
}
