//! Denoising: input without variety, light of any brightness, pixels that are missing or wrong.

use super::fixtures::noise;
use super::{Area, Case, Formula, Naive, worse};
use crate::denoise::model::{Coefficients, Model, Predictor, predictor};
use crate::denoise::{Denoiser, Frame, Method, Settings};
use crate::error::Result;
use glam::Vec3;

pub(super) const CASES: &[Case] = &[
    Case {
        name: "varied-input",
        area: Area::Denoising,
        hazard: "60 frames of varied colors, which any form of least squares learns",
        remedy: "information matrix and moments, solved by Cholesky's method",
        naive_formula: "recursion for the inverse of the information matrix",
        figure: "error of the predicted color",
        bound: 5e-3,
        naive: Naive::Holds("varied input confirms every component of the model"),
        measured: varied_input,
    },
    Case {
        name: "input-without-variety",
        area: Area::Denoising,
        hazard: "100 000 frames of constant, grey, black, spiky and bright input, of which 5 % are forgotten a frame",
        remedy: "information matrix and moments, solved by Cholesky's method with a relative ridge",
        naive_formula: "recursion for the inverse of the information matrix, which winds up",
        figure: "largest prediction, relative to the brightest color",
        bound: 1.5,
        naive: Naive::Fails(f64::INFINITY),
        measured: |formula| input_without_variety(formula, 0.95),
    },
    Case {
        name: "long-memory-without-variety",
        area: Area::Denoising,
        hazard: "100 000 frames of constant, grey, black, spiky and bright input, of which 0.2 % are forgotten a frame",
        remedy: "information matrix and moments, solved by Cholesky's method with a relative ridge",
        naive_formula: "recursion for the inverse of the information matrix, which winds up",
        figure: "largest prediction, relative to the brightest color",
        bound: 1.5,
        naive: Naive::Fails(f64::INFINITY),
        measured: |formula| input_without_variety(formula, 0.998),
    },
    Case {
        name: "still-picture",
        area: Area::Denoising,
        hazard: "1000 frames of the same picture through the denoiser, of which 5 % are forgotten a frame",
        remedy: "information matrix and moments, solved by Cholesky's method with a relative ridge",
        naive_formula: "recursion for the inverse of the information matrix, which winds up",
        figure: "largest relative error of a color",
        bound: 1e-6,
        naive: Naive::Fails(f64::INFINITY),
        measured: still_picture,
    },
    Case {
        name: "missing-pixels",
        area: Area::Denoising,
        hazard: "a pixel that is NaN and one that is infinite in a frame, by each method",
        remedy: "pixels that are not finite are left out, and filled from their history",
        naive_formula: "exponential moving average",
        figure: "largest relative error of a color, then and in the frames that follow",
        bound: 1e-6,
        naive: Naive::Fails(f64::INFINITY),
        measured: missing_pixels,
    },
    Case {
        name: "one-pixel-spikes",
        area: Area::Denoising,
        hazard: "a pixel 10 000 times too bright in a frame",
        remedy: "weights by the distance from the history, which is clamped to the colors around",
        naive_formula: "exponential moving average",
        figure: "relative error of its color three frames later",
        bound: 1e-6,
        naive: Naive::Fails(1.0),
        measured: spikes,
    },
    Case {
        name: "light-of-any-brightness",
        area: Area::Denoising,
        hazard: "the same sequence in light of 1e-9 to 1e9",
        remedy: "relative distances, equations scaled to a diagonal of 1",
        naive_formula: "distance with an ε of 1e-3, squared in single precision",
        figure: "largest change of a color, relative to the brightest",
        bound: 1e-3,
        naive: Naive::Fails(1e-2),
        measured: any_brightness,
    },
];

/// The textbook's recursion for the inverse of the information matrix (Ljung & Söderström 1987).
struct Inverse {
    covariance: [[f32; 4]; 4],
    beta: [Vec3; 4],
}

impl Inverse {
    fn new() -> Self {
        let covariance = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1e3 } else { 0.0 }));
        Self { covariance, beta: [Vec3::ZERO; 4] }
    }

    fn learn(&mut self, p: &Predictor, color: Vec3, weight: f32, lambda: f32) {
        let dot = |a: &[f32; 4], b: &[f32; 4]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        let ahead: [f32; 4] = std::array::from_fn(|i| dot(&self.covariance[i], p));
        let gain = ahead.map(|v| v / (lambda / weight + dot(&ahead, p)));
        let error = color - Coefficients(self.beta).predict(p);
        let row: [f32; 4] = std::array::from_fn(|j| (0..4).map(|i| p[i] * self.covariance[i][j]).sum());
        for i in 0..4 {
            self.beta[i] += gain[i] * error;
            for j in 0..4 {
                self.covariance[i][j] = (self.covariance[i][j] - gain[i] * row[j]) / lambda;
            }
        }
    }

    /// True while all is finite and the diagonal positive.
    fn holds(&self) -> bool {
        let finite = self.covariance.iter().flatten().all(|v| v.is_finite()) && self.beta.iter().all(|b| b.is_finite());
        finite && (0..4).all(|i| self.covariance[i][i] > 0.0)
    }
}

/// A number from 0 to 1 in single precision.
fn random(seed: u32) -> f32 {
    noise(seed.into()) as f32
}

/// A model in either form.
enum Learner {
    Information(Model),
    Covariance(Inverse),
}

impl Learner {
    fn new(formula: Formula) -> Self {
        match formula {
            Formula::Cumulo => Self::Information(Model::default()),
            Formula::Naive => Self::Covariance(Inverse::new()),
        }
    }

    fn learn(&mut self, p: &Predictor, color: Vec3, weight: f32, lambda: f32) {
        match self {
            Self::Information(model) => model.learn(p, color, weight, lambda),
            Self::Covariance(inverse) => inverse.learn(p, color, weight, lambda),
        }
    }

    /// Returns the predicted color; not a number once the model is not definite any more.
    fn predict(&self, p: &Predictor) -> Vec3 {
        match self {
            Self::Information(model) => model.solve().predict(p),
            Self::Covariance(inverse) if inverse.holds() => Coefficients(inverse.beta).predict(p),
            Self::Covariance(_) => Vec3::NAN,
        }
    }
}

fn varied_input(formula: Formula) -> Result<f64> {
    let mut learner = Learner::new(formula);
    let (mut p, mut color) = (predictor(Vec3::ZERO), Vec3::ZERO);
    for frame in 0..60 {
        let feature = Vec3::new(random(3 * frame), random(3 * frame + 1), random(3 * frame + 2));
        color = Vec3::new(0.3, 0.2, 0.1) + Vec3::new(0.5, 1.0, 0.2) * Vec3::new(feature.z, feature.x, feature.y);
        p = predictor(feature);
        learner.learn(&p, color, 0.2 + 0.8 * random(1000 + frame), 0.998);
    }
    Ok(difference(&[learner.predict(&p)], &[color]))
}

/// Returns the largest difference of two pictures' colors.
fn difference(found: &[Vec3], expected: &[Vec3]) -> f64 {
    let each = found.iter().zip(expected).flat_map(|(a, b)| (*a - *b).abs().to_array());
    each.map(f64::from).fold(0.0, worse)
}

fn input_without_variety(formula: Formula, lambda: f32) -> Result<f64> {
    let inputs: [fn(u32) -> Vec3; 5] = [
        |_| Vec3::new(0.8, 0.4, 0.2),
        |frame| Vec3::splat(0.5 + 0.1 * random(frame)),
        |_| Vec3::ZERO,
        |frame| if frame % 997 == 0 { Vec3::splat(1e4) } else { Vec3::new(0.3, 0.2, 0.1) },
        |frame| 1000.0 * Vec3::new(random(frame), 0.5, random(frame ^ 77)),
    ];
    let mut largest = 0.0;
    for input in inputs {
        let (mut learner, mut most) = (Learner::new(formula), 0.0_f32);
        for frame in 0..100_000 {
            let color = input(frame);
            // A history follows the color slowly.
            let p = predictor(0.75 * input(frame.saturating_sub(1)) + 0.25 * color);
            learner.learn(&p, color, 1.0, lambda);
            let found = learner.predict(&p);
            most = most.max(color.max_element());
            // Of black input, black is predicted.
            let share = match most > 0.0 {
                true => found.abs().max_element() / most,
                false if found == Vec3::ZERO => 0.0,
                false => f32::INFINITY,
            };
            largest = worse(largest, if found.is_finite() { share.into() } else { f64::INFINITY });
            if largest.is_infinite() {
                return Ok(largest);
            }
        }
        // What is forgotten and what is learned balance.
        if let Learner::Information(model) = learner
            && (model.samples() * (1.0 - lambda) - 1.0).abs() >= 1e-2
        {
            return Ok(f64::INFINITY);
        }
    }
    Ok(largest)
}

const SIZE: [usize; 2] = [24, 16];

/// A smooth picture of three tints.
fn picture() -> Vec<Vec3> {
    let at = |i: usize| {
        let (x, y) = ((i % SIZE[0]) as f32, (i / SIZE[0]) as f32);
        let wave = 0.5 + 0.4 * (0.11 * x).sin() * (0.07 * y).cos();
        Vec3::new(wave, 0.6 * wave + 0.1, 0.3)
    };
    (0..SIZE[0] * SIZE[1]).map(at).collect()
}

fn still_picture(formula: Formula) -> Result<f64> {
    // Even, so that the feature is the color.
    let color = Vec3::new(0.8, 0.4, 0.2);
    if formula == Formula::Naive {
        let mut inverse = Inverse::new();
        (0..1000).for_each(|_| inverse.learn(&predictor(color), color, 1.0, 0.95));
        let found = if inverse.holds() { Coefficients(inverse.beta).predict(&predictor(color)) } else { Vec3::NAN };
        return Ok(difference(&[found / color], &[Vec3::ONE]));
    }
    let frame = vec![color; SIZE[0] * SIZE[1]];
    let mut denoiser = Denoiser::new(Method::Wrls, Settings { forgetting: 0.95, ..Settings::default() })?;
    let mut most = 0.0;
    for _ in 0..1000 {
        let found = denoiser.denoise(&Frame { size: SIZE, color: &frame, ..Frame::default() })?.color;
        let shares: Vec<Vec3> = found.iter().map(|found| *found / color).collect();
        most = worse(most, difference(&shares, &vec![Vec3::ONE; shares.len()]));
    }
    Ok(most)
}

const METHODS: [Method; 5] = [Method::Wrls2, Method::Wrls, Method::Rls, Method::Svgf, Method::Ema];

/// Returns the moving average of a sequence, the newest frame weighted by a quarter.
fn average(frames: &[Vec<Vec3>]) -> Vec<Vec3> {
    let mut history = frames.first().cloned().unwrap_or_default();
    for frame in frames.iter().skip(1) {
        history.iter_mut().zip(frame).for_each(|(history, color)| *history = 0.75 * *history + 0.25 * *color);
    }
    history
}

fn missing_pixels(formula: Formula) -> Result<f64> {
    const HIT: usize = 3;
    let color = Vec3::new(0.8, 0.4, 0.2);
    let even = vec![color; SIZE[0] * SIZE[1]];
    let mut frames = vec![even.clone(); 8];
    frames[HIT][5 * SIZE[0] + 7] = Vec3::NAN;
    frames[HIT][9 * SIZE[0] + 20] = Vec3::splat(f32::INFINITY);
    if formula == Formula::Naive {
        return Ok(difference(&average(&frames), &even));
    }
    let mut most = 0.0;
    for method in METHODS {
        let mut denoiser = Denoiser::new(method, Settings::default())?;
        for frame in &frames {
            let found = denoiser.denoise(&Frame { size: SIZE, color: frame, ..Frame::default() })?.color;
            let shares: Vec<Vec3> = found.iter().map(|found| *found / color).collect();
            most = worse(most, difference(&shares, &vec![Vec3::ONE; shares.len()]));
        }
    }
    Ok(most)
}

fn spikes(formula: Formula) -> Result<f64> {
    let color = Vec3::new(0.8, 0.4, 0.2);
    let (even, at) = (vec![color; SIZE[0] * SIZE[1]], 8 * SIZE[0] + 12);
    let mut frames = vec![even; 24];
    frames[20][at] *= 1e4;
    let found = match formula {
        Formula::Cumulo => {
            let mut denoiser = Denoiser::new(Method::Wrls, Settings::default())?;
            let mut last = Vec::new();
            for frame in &frames {
                last = denoiser.denoise(&Frame { size: SIZE, color: frame, ..Frame::default() })?.color;
            }
            last
        }
        Formula::Naive => average(&frames),
    };
    let shares: Vec<Vec3> = found.iter().map(|found| *found / color).collect();
    Ok(difference(&shares, &vec![Vec3::ONE; shares.len()]))
}

fn any_brightness(formula: Formula) -> Result<f64> {
    let truth = picture();
    let frames: Vec<Vec<Vec3>> = (0..6)
        .map(|frame| {
            let of = |(i, color): (usize, &Vec3)| *color * 2.0 * random(frame * 7919 + i as u32);
            truth.iter().enumerate().map(of).collect()
        })
        .collect();
    let denoised = |method: Method, light: f32| -> Result<Vec<Vec3>> {
        let mut denoiser = Denoiser::new(method, Settings::default())?;
        let mut last = Vec::new();
        for frame in &frames {
            let lit: Vec<Vec3> = frame.iter().map(|color| light * *color).collect();
            last = denoiser.denoise(&Frame { size: SIZE, color: &lit, ..Frame::default() })?.color;
        }
        Ok(last.into_iter().map(|color| color / light).collect())
    };
    // A moving average whose newest frame counts by its distance from the history.
    let naive = |light: f32| -> Vec<Vec3> {
        let mut history: Vec<Vec3> = frames[0].iter().map(|color| light * *color).collect();
        for frame in &frames[1..] {
            for (history, color) in history.iter_mut().zip(frame) {
                let color = light * *color;
                let far = (color - *history).length_squared();
                let near = color.length_squared().min(history.length_squared()) + 1e-3;
                let share = 0.25 * (-far / (near * 0.75 * 0.75)).exp();
                *history += share * (color - *history);
            }
        }
        history.into_iter().map(|color| color / light).collect()
    };
    let mut most = 0.0;
    for light in [1e-9, 1e-3, 1e3, 1e9] {
        match formula {
            Formula::Naive => most = worse(most, difference(&naive(light), &naive(1.0))),
            Formula::Cumulo => {
                for method in [Method::Wrls2, Method::Wrls, Method::Rls] {
                    most = worse(most, difference(&denoised(method, light)?, &denoised(method, 1.0)?));
                }
            }
        }
    }
    Ok(most)
}
