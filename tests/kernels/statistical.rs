//! Tests of noisy pictures: rate of false alarms under the null hypothesis, and power.

use cumulo::metrics::statistical::{Estimate, Freedom, Question, Verdict, test};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

const WIDTH: usize = 48;
const HEIGHT: usize = 32;
const QUESTION: Question = Question { false_alarm: 0.05, tolerance: 0.0, tile: 16 };

/// A standard normal number (Box and Muller 1958).
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let mut unit = || (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0;
    let (r, turn) = ((-2.0 * unit().ln()).sqrt(), unit() * std::f64::consts::TAU);
    r * turn.cos()
}

/// Expected values and standard deviations of one sample: a bright blob whose noise varies a hundredfold over the picture,
/// and a background without any.
fn scene(pixel: usize) -> (f64, f64) {
    let (x, y) = ((pixel % WIDTH) as f64 / WIDTH as f64 - 0.5, (pixel / WIDTH) as f64 / HEIGHT as f64 - 0.5);
    let blob = (1.0 - 5.0 * (x * x + y * y)).max(0.0);
    (blob, if blob > 0.0 { 0.01 + blob * blob } else { 0.0 })
}

/// Estimate from `count` samples a pixel, drawn from `noise`, whose mean is 0 and variance 1; `change` moves the expected
/// values.
fn sampled(
    rng: &mut ChaCha8Rng,
    count: usize,
    noise: impl Fn(&mut ChaCha8Rng) -> f64,
    change: impl Fn(usize) -> f64,
) -> Estimate {
    let (mut mean, mut variance) = (Vec::new(), Vec::new());
    for pixel in 0..WIDTH * HEIGHT {
        let (expected, deviation) = scene(pixel);
        let channels: [[f64; 2]; 4] = std::array::from_fn(|_| {
            let samples: Vec<f64> = (0..count).map(|_| expected + change(pixel) + deviation * noise(rng)).collect();
            let average = samples.iter().sum::<f64>() / count as f64;
            let squares: f64 = samples.iter().map(|v| (v - average).powi(2)).sum();
            [average, squares / (count * (count - 1)) as f64]
        });
        mean.push(channels.map(|c| c[0] as f32));
        variance.push(channels.map(|c| c[1] as f32));
    }
    Estimate {
        width: WIDTH,
        height: HEIGHT,
        mean,
        variance,
        freedom: Freedom::All((count - 1) as f64),
        has_alpha: true,
    }
}

fn none(_: usize) -> f64 {
    0.0
}

fn verdict(a: &Estimate, b: &Estimate) -> Verdict {
    test(a, b, QUESTION).unwrap()
}

/// Number of alarms of `trials` comparisons of equal scenes.
fn alarms(trials: u64, counts: [usize; 2], noise: impl Fn(&mut ChaCha8Rng) -> f64 + Copy) -> usize {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    (0..trials)
        .filter(|_| {
            let [a, b] = counts.map(|count| sampled(&mut rng, count, noise, none));
            verdict(&a, &b).differ
        })
        .count()
}

/// Most alarms that a rate of 0.05 gives in so many trials, but for one case in a thousand: mean and 3.1 deviations.
fn most(trials: u64) -> f64 {
    let expected = 0.05 * trials as f64;
    expected + 3.1 * (expected * 0.95).sqrt()
}

#[test]
fn equal_scenes_are_called_different_no_more_often_than_asked() {
    // Two seeds on each side, many samples, and different numbers of samples.
    for counts in [[2, 2], [16, 16], [2, 16], [4, 32]] {
        let found = alarms(120, counts, normal);
        assert!(found as f64 <= most(120), "{found} of 120 with {counts:?} samples");
    }
}

#[test]
fn skewed_noise_gives_no_more_alarms() {
    // Exponential, and rare: one sample in twenty carries all the light, as small lights and fireflies do.
    let unit = |rng: &mut ChaCha8Rng| (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0;
    let exponential = |rng: &mut ChaCha8Rng| -unit(rng).ln() - 1.0;
    let rare = |rng: &mut ChaCha8Rng| (if unit(rng) < 0.05 { 20.0 } else { 0.0 } - 1.0) / 19_f64.sqrt();
    for counts in [[2, 2], [32, 32]] {
        let found = [alarms(80, counts, exponential), alarms(80, counts, rare)];
        assert!(found.iter().all(|n| *n as f64 <= most(80)), "{found:?} of 80 with {counts:?} samples");
    }
}

#[test]
fn p_values_of_the_mean_are_uniform() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut p: Vec<f64> = (0..150)
        .flat_map(|_| {
            let [a, b] = [sampled(&mut rng, 8, normal, none), sampled(&mut rng, 8, normal, none)];
            verdict(&a, &b).channels.into_iter().map(|c| c.mean.p).collect::<Vec<_>>()
        })
        .collect();
    p.sort_by(f64::total_cmp);
    let n = p.len() as f64;
    let distance = p.iter().enumerate().map(|(i, p)| (p - (i as f64 + 0.5) / n).abs()).fold(0.0, f64::max);
    // Kolmogorov and Smirnov: 1.95/sqrt(n) is exceeded once in a thousand times.
    assert!(distance < 1.95 / n.sqrt() + 0.5 / n, "{distance}");
}

#[test]
fn each_kind_of_difference_is_found_by_a_test_of_its_own() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let probability = |v: &Verdict, name: &str| {
        let of = |c: &cumulo::metrics::statistical::ChannelTests| {
            c.probabilities().into_iter().find(|(n, _)| *n == name).unwrap().1
        };
        v.channels.iter().map(of).fold(1.0, f64::min)
    };
    let a = sampled(&mut rng, 64, normal, none);
    // Brighter by a hundredth of the noise of a pixel: none shows it, the mean does.
    let everywhere = sampled(&mut rng, 64, normal, |p| 0.015 * f64::from(scene(p).1 > 0.0));
    assert!(verdict(&a, &everywhere).differ && probability(&verdict(&a, &everywhere), "mean") < 1e-4);
    // A gradient across the picture, whose mean is 0.
    let gradient = sampled(&mut rng, 64, normal, |p| scene(p).0 * ((p % WIDTH) as f64 / WIDTH as f64 - 0.5) * 0.3);
    assert!(probability(&verdict(&a, &gradient), "tiles") < 1e-6);
    // A checkerboard below the noise of any pixel, which cancels in tiles and in the mean.
    let sign = |p: usize| if (p % WIDTH + p / WIDTH).is_multiple_of(2) { 1.0 } else { -1.0 };
    let checkered = verdict(&a, &sampled(&mut rng, 64, normal, |p| 0.12 * sign(p) * scene(p).1));
    assert!(checkered.differ && probability(&checkered, "spread") < 1e-6);
    assert!(probability(&checkered, "pixels") > 1e-3 && probability(&checkered, "mean") > 1e-3);
    // One pixel by eight standard errors.
    let middle = HEIGHT / 2 * WIDTH + WIDTH / 2;
    let spot = verdict(&a, &sampled(&mut rng, 64, normal, |p| if p == middle { 1.5 } else { 0.0 }));
    assert!(spot.differ && probability(&spot, "pixels") < 1e-4);
    let worst = spot.channels[0].pixels.worst.as_ref().unwrap();
    assert_eq!((worst.x, worst.y, worst.width, worst.height), (WIDTH / 2, HEIGHT / 2, 1, 1));
}

#[test]
fn intervals_hold_the_difference_and_tolerances_forgive_it() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let (mut held, trials) = (0, 60);
    for _ in 0..trials {
        let a = sampled(&mut rng, 4, normal, |_| 0.125);
        let b = sampled(&mut rng, 4, normal, none);
        let found = verdict(&a, &b);
        assert!(found.differ);
        let [low, high] = found.channels[0].mean.interval.unwrap();
        held += usize::from(low <= 0.125 && 0.125 <= high);
        let forgiving = test(&a, &b, Question { tolerance: 0.125, false_alarm: 1e-3, ..QUESTION }).unwrap();
        assert!(!forgiving.differ, "{forgiving:?}");
    }
    // 95 % of 60 are 57; fewer than 50 happen once in ten thousand times.
    assert!(held >= 50, "{held} of {trials}");
}

#[test]
fn pictures_without_noise_differ_by_anything_beyond_rounding() {
    let film = |offset: f32| Estimate {
        width: 4,
        height: 4,
        mean: vec![[0.5 + offset; 4]; 16],
        variance: vec![[0.0; 4]; 16],
        freedom: Freedom::All(f64::INFINITY),
        has_alpha: true,
    };
    assert!(!verdict(&film(0.0), &film(0.0)).differ);
    assert!(!verdict(&film(0.0), &film(f32::EPSILON / 2.0)).differ);
    let found = verdict(&film(0.0), &film(1e-5));
    assert!(found.differ && found.p == 0.0 && found.channels[0].pixels.worst.as_ref().unwrap().t.is_none());
    assert!(!test(&film(0.0), &film(1e-5), Question { tolerance: 1.1e-5, ..QUESTION }).unwrap().differ);
}

#[test]
fn pixels_that_are_not_finite_are_left_out_and_counted() {
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    let (mut a, mut b) = (sampled(&mut rng, 8, normal, none), sampled(&mut rng, 8, normal, none));
    a.variance[40][1] = f32::INFINITY;
    (a.mean[41][0], b.mean[41][0]) = (f32::NAN, f32::NAN);
    let found = test(&a, &b, Question { false_alarm: 1e-4, ..QUESTION }).unwrap();
    assert_eq!((found.left_out, found.non_finite_differences, found.differ), (2, 0, false));
    assert_eq!(found.channels[0].pixels.count, WIDTH * HEIGHT - 2);
    b.mean[41][0] = 1.0;
    let found = verdict(&a, &b);
    assert!(found.differ && found.non_finite_differences == 1, "NaN against a number is a difference");
    a.variance.iter_mut().for_each(|v| *v = [f32::INFINITY; 4]);
    assert!(test(&a, &b, QUESTION).unwrap_err().to_string().contains("no pixel"));
    let smaller = Estimate { width: 1, height: 1, mean: vec![[0.0; 4]], variance: vec![[0.0; 4]], ..a.clone() };
    assert!(test(&a, &smaller, QUESTION).unwrap_err().to_string().contains("48x32 and 1x1"));
}
