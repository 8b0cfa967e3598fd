//! The denoisers as one.

use super::ema::Ema;
use super::frame::{Denoised, Frame};
use super::guided::GuidedDenoiser;
use super::settings::Settings;
use super::svgf::Svgf;
use super::wrls::Wrls;
use crate::error::Result;

/// Way to denoise a sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Guided filter in space and time, of the frames before and, where a [`Lookahead`](super::Lookahead) shows them,
    /// after.
    Wrls2,
    /// Weighted recursive least squares as published (Iglesias-Guitian, Mane & Moon 2020).
    Wrls,
    /// Recursive least squares without weights: outliers are learned as they are.
    Rls,
    /// Spatiotemporal variance-guided filtering (Schied et al. 2017), without G-buffers.
    Svgf,
    /// Exponential moving average with the history clamped to the colors around.
    Ema,
}

impl Method {
    /// True if the frames that follow a frame are used, too.
    pub fn looks_ahead(self) -> bool {
        self == Self::Wrls2
    }
}

#[derive(Debug)]
enum Engine {
    Guided(Box<GuidedDenoiser>),
    Wrls(Wrls),
    Svgf(Svgf),
    Ema(Ema, f32),
}

/// Denoiser of a sequence in one direction of time: it takes a frame after the other and keeps the state of one.
#[derive(Debug)]
pub struct Denoiser(Engine);

impl Denoiser {
    /// Creates a denoiser that has seen nothing. The settings are those of weighted recursive least squares; the moving
    /// average takes its share of the history from them.
    ///
    /// # Errors
    /// If a constant is out of its range.
    pub fn new(method: Method, settings: Settings) -> Result<Self> {
        let settings = settings.checked()?;
        Ok(Self(match method {
            Method::Wrls2 => Engine::Guided(Box::default()),
            Method::Wrls => Engine::Wrls(Wrls::new(settings)?),
            Method::Rls => Engine::Wrls(Wrls::new(Settings { bandwidth: f32::INFINITY, ..settings })?),
            Method::Svgf => Engine::Svgf(Svgf::default()),
            Method::Ema => Engine::Ema(Ema::default(), settings.history),
        }))
    }

    /// Returns the denoiser so that it maps the noise that comes in and the error that is left around each pixel, as
    /// far as [`Method::Wrls2`] can tell them; the other methods cannot.
    #[must_use]
    pub fn with_map(mut self) -> Self {
        if let Engine::Guided(engine) = &mut self.0 {
            engine.mapped = true;
        }
        self
    }

    /// Forgets all, as at a cut.
    pub fn reset(&mut self) {
        match &mut self.0 {
            Engine::Guided(engine) => engine.reset(),
            Engine::Wrls(engine) => engine.reset(),
            Engine::Svgf(engine) => engine.reset(),
            Engine::Ema(engine, _) => engine.reset(),
        }
    }

    /// Forgets all but what was learned of the noise, to begin again at the first frame: a sequence's first frames have
    /// none before them that tell their noise.
    pub fn rewind(&mut self) {
        match &mut self.0 {
            Engine::Guided(engine) => engine.rewind(),
            _ => self.reset(),
        }
    }

    /// Denoises the next frame. A frame of another size begins anew.
    ///
    /// # Errors
    /// If the frame does not have as many colors, or motions, as pixels.
    pub fn denoise(&mut self, frame: &Frame<'_>) -> Result<Denoised> {
        let mut to = Denoised::default();
        self.denoise_into(frame, &mut to)?;
        Ok(to)
    }

    /// Denoises the next frame into `to`. [`Method::Wrls2`] uses its memory again: fresh memory costs a tenth of the
    /// time.
    ///
    /// # Errors
    /// If the frame does not have as many colors, or motions, as pixels; `to` is as it was then.
    pub fn denoise_into(&mut self, frame: &Frame<'_>, to: &mut Denoised) -> Result<()> {
        *to = match &mut self.0 {
            Engine::Guided(engine) => return engine.denoise(frame, to),
            Engine::Wrls(engine) => engine.denoise(frame)?,
            Engine::Svgf(engine) => engine.denoise(frame)?,
            Engine::Ema(engine, alpha) => engine.denoise(frame, *alpha)?,
        };
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::denoise::{Ahead, Lookahead};
    use glam::{Vec2, Vec3};

    const SIZE: [usize; 2] = [40, 30];

    fn noise(seed: u32) -> f32 {
        let h = (seed ^ 0x9E37_79B9).wrapping_mul(0x85EB_CA6B);
        let h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
        ((h ^ (h >> 16)) >> 8) as f32 / (1 << 24) as f32
    }

    /// A smooth picture that goes to the right by `shift` pixels.
    fn truth(shift: f32) -> Vec<Vec3> {
        let at = |i: usize| {
            let (x, y) = ((i % SIZE[0]) as f32 - shift, (i / SIZE[0]) as f32);
            let wave = 0.5 + 0.4 * (0.21 * x).sin() * (0.17 * y).cos();
            Vec3::new(wave, 0.6 * wave + 0.1, 0.3)
        };
        (0..SIZE[0] * SIZE[1]).map(at).collect()
    }

    /// Colors that are right on average: most are dark, a few bright.
    fn noisy(truth: &[Vec3], frame: u32) -> Vec<Vec3> {
        let of = |(i, color): (usize, &Vec3)| *color * 2.0 * noise(frame * 7919 + i as u32);
        truth.iter().enumerate().map(of).collect()
    }

    fn error(a: &[Vec3], b: &[Vec3]) -> f32 {
        a.iter().zip(b).map(|(a, b)| (*a - *b).length_squared()).sum::<f32>() / a.len() as f32
    }

    fn last(frames: u32, shift: f32, method: Method) -> (Vec<Vec3>, Denoised) {
        let mut denoiser = Denoiser::new(method, Settings::default()).unwrap();
        let motion = vec![Vec2::new(-shift, 0.0); SIZE[0] * SIZE[1]];
        let denoise = |frame: u32| {
            let color = noisy(&truth(shift * frame as f32), frame);
            denoiser
                .denoise(&Frame { size: SIZE, color: &color, motion: Some(&motion), alpha: None, ahead: None })
                .unwrap()
        };
        let out = (0..frames).map(denoise).last().unwrap();
        (noisy(&truth(shift * (frames - 1) as f32), frames - 1), out)
    }

    const ALL: [Method; 5] = [Method::Wrls2, Method::Wrls, Method::Rls, Method::Svgf, Method::Ema];

    /// Pictures at rest, and those that move by whole pixels and parts of them, lose most of their noise.
    #[test]
    fn noise_is_taken_away() {
        for (method, left) in ALL.into_iter().zip([0.02, 0.4, 0.5, 0.2, 0.3]) {
            for shift in [0.0, 1.0, 0.4] {
                let frames = 40;
                let wanted = truth(shift * (frames - 1) as f32);
                let (input, out) = last(frames, shift, method);
                let [before, after] = [error(&input, &wanted), error(&out.color, &wanted)];
                println!("{method:?} {shift}: {:.3}", after / before);
                assert!(after < left * before, "{method:?}, {shift}: {before} {after}");
                assert!(out.confidence.iter().all(|n| *n > 0.0 && n.is_finite()));
            }
        }
    }

    /// Light that grows steadily neither lags nor runs ahead, not in frames near to an end of the sequence either,
    /// if the first frames were rehearsed.
    #[test]
    fn steady_changes_do_not_lag() {
        let frames = 24;
        let still = truth(0.0);
        let light = |frame: u32| 1.0 + 0.1 * frame as f32;
        let pictures: Vec<Vec<Vec3>> =
            (0..frames).map(|f| noisy(&still, f).iter().map(|color| *color * light(f)).collect()).collect();
        let frame = |i: usize| Frame { size: SIZE, color: &pictures[i], ..Frame::default() };
        let mut lookahead = Lookahead::default();
        let mut aheads = vec![Ahead::default(); pictures.len()];
        for (i, ahead) in aheads.iter_mut().enumerate().rev() {
            lookahead.observe(&frame(i), ahead).unwrap();
        }
        let mut denoiser = Denoiser::new(Method::Wrls2, Settings::default()).unwrap();
        for (i, ahead) in aheads.iter().enumerate().take(6) {
            denoiser.denoise(&Frame { ahead: Some(ahead), ..frame(i) }).unwrap();
        }
        denoiser.rewind();
        for (i, ahead) in aheads.iter().enumerate() {
            let out = denoiser.denoise(&Frame { ahead: Some(ahead), ..frame(i) }).unwrap().color;
            let sum = |colors: &[Vec3]| colors.iter().map(|color| color.element_sum()).sum::<f32>();
            let bias = sum(&out) / (light(i as u32) * sum(&still)) - 1.0;
            println!("{i}: {:+.2} %", 100.0 * bias);
            assert!(bias.abs() < 0.07, "frame {i}: {bias}");
        }
    }

    /// Points that shine on keep most of their brightness under noise that makes them look like bright paths, with an
    /// alpha that guides and without.
    #[test]
    fn points_that_shine_on_keep_their_brightness() {
        let (frames, point) = (24_u32, |i: usize| (i % SIZE[0]) % 9 == 4 && (i / SIZE[0]) % 9 == 4);
        let inside = |i: usize| if (i % SIZE[0]).abs_diff(20) < 17 { 1.0 } else { 0.0 };
        let truth: Vec<Vec3> =
            (0..SIZE[0] * SIZE[1]).map(|i| Vec3::splat(inside(i) * if point(i) { 0.8 } else { 0.02 })).collect();
        // Mean of colors with heavy tails, whose mean is 2.
        let of_path = |seed: u32| (1.0 - noise(seed)).ln().powi(2);
        let paths = |seed: u32| (0..32).map(|k| of_path(seed.wrapping_mul(32) + k)).sum::<f32>() / 64.0;
        let pictures: Vec<Vec<Vec3>> = (0..frames)
            .map(|f| truth.iter().enumerate().map(|(i, color)| *color * paths(f * 7919 + i as u32)).collect())
            .collect();
        let alphas: Vec<f32> = (0..truth.len()).map(inside).collect();
        for alpha in [None, Some(&alphas[..])] {
            let frame = |i: usize| Frame { size: SIZE, color: &pictures[i], alpha, ..Frame::default() };
            let mut lookahead = Lookahead::default();
            let mut aheads = vec![Ahead::default(); pictures.len()];
            for (i, ahead) in aheads.iter_mut().enumerate().rev() {
                lookahead.observe(&frame(i), ahead).unwrap();
            }
            let mut denoiser = Denoiser::new(Method::Wrls2, Settings::default()).unwrap();
            let points = || (0..truth.len()).filter(|i| point(*i) && truth[*i].x > 0.1);
            let kept = aheads.iter().enumerate().map(|(i, ahead)| {
                let out = denoiser.denoise(&Frame { ahead: Some(ahead), ..frame(i) }).unwrap().color;
                points().map(|i| out[i].x).sum::<f32>() / (0.8 * points().count() as f32)
            });
            let kept = kept.sum::<f32>() / frames as f32;
            println!("alpha {}: {kept:.3}", alpha.is_some());
            assert!((0.79..1.05).contains(&kept), "alpha {}: {kept}", alpha.is_some());
        }
    }

    /// Missing pixels are filled in, spikes are not learned, and nothing that comes out is missing or negative.
    #[test]
    fn missing_pixels_and_spikes_do_no_harm() {
        for method in ALL {
            let mut denoiser = Denoiser::new(method, Settings::default()).unwrap();
            let wanted = truth(0.0);
            let mut out = Vec::new();
            for frame in 0..40 {
                let mut color = noisy(&wanted, frame);
                color[frame as usize * 3] = Vec3::NAN;
                color[600 + frame as usize] = Vec3::splat(f32::INFINITY);
                color[(50 + frame as usize * 457) % 1200] = Vec3::splat(1e9);
                let motion: Vec<Vec2> =
                    (0..color.len()).map(|i| if i % 97 == 0 { Vec2::splat(f32::NAN) } else { Vec2::ZERO }).collect();
                // Neither does an alpha that is out of its range, or missing here and there.
                let alpha: Vec<f32> = (0..color.len())
                    .map(|i| if i % 89 == 0 { f32::NAN } else { 1.2 * ((i % SIZE[0]) as f32 / 40.0) - 0.1 })
                    .collect();
                let alpha = (frame % 3 > 0).then_some(&alpha[..]);
                out = denoiser
                    .denoise(&Frame { size: SIZE, color: &color, motion: Some(&motion), alpha, ahead: None })
                    .unwrap()
                    .color;
                assert!(out.iter().all(|c| c.is_finite() && c.min_element() >= 0.0), "{method:?} {frame}");
            }
            let far = out.iter().zip(&wanted).filter(|(a, b)| (**a - **b).abs().max_element() > 0.5).count();
            // Neither average knows outliers.
            let most = if matches!(method, Method::Wrls2 | Method::Wrls) { 60 } else { SIZE[0] * SIZE[1] };
            println!("{method:?}: {far} far off");
            assert!(far <= most, "{method:?}: {far} pixels are far off");
            let all_missing = vec![Vec3::NAN; wanted.len()];
            let filled = denoiser
                .denoise(&Frame { size: SIZE, color: &all_missing, motion: None, alpha: None, ahead: None })
                .unwrap()
                .color;
            assert!(filled.iter().all(|c| c.is_finite()), "{method:?}");
            let mut fresh = Denoiser::new(method, Settings::default()).unwrap();
            let black = fresh
                .denoise(&Frame { size: SIZE, color: &all_missing, motion: None, alpha: None, ahead: None })
                .unwrap();
            assert!(black.color.iter().all(|c| *c == Vec3::ZERO) && black.confidence.iter().all(|n| *n == 0.0));
        }
    }

    /// Input of all kinds that goes on for long, and jumps of brightness, leave results finite and near to what came
    /// in.
    #[test]
    fn long_sequences_of_hard_input_stay_sane() {
        const SMALL: [usize; 2] = [13, 10];
        type Input = fn(u32, usize) -> Vec3;
        let inputs: [(&str, Input); 6] = [
            ("constant", |_, _| Vec3::new(0.8, 0.4, 0.2)),
            ("grey", |f, i| Vec3::splat(noise(f * 977 + i as u32))),
            ("black", |_, _| Vec3::ZERO),
            ("spiky", |f, i| {
                if (f as usize * 31 + i).is_multiple_of(997) { Vec3::splat(1e8) } else { Vec3::new(0.3, 0.2, 0.1) }
            }),
            ("x1000", |f, i| 1000.0 * Vec3::new(noise(f + i as u32), 0.5, 0.25)),
            ("jumps", |f, i| 10_f32.powi((f / 50 % 13) as i32 * 2 - 12) * Vec3::splat(0.5 + noise(f * 61 + i as u32))),
        ];
        for (name, input) in inputs {
            let mut denoiser = Denoiser::new(Method::Wrls2, Settings::default()).unwrap();
            let mut most = 0.0_f32;
            for frame in 0..2000 {
                let color: Vec<Vec3> = (0..SMALL[0] * SMALL[1]).map(|i| input(frame, i)).collect();
                most = color.iter().fold(most, |most, c| most.max(c.max_element()));
                let out = denoiser
                    .denoise(&Frame { size: SMALL, color: &color, motion: None, alpha: None, ahead: None })
                    .unwrap();
                let sane = |c: &Vec3| c.is_finite() && c.min_element() >= 0.0 && c.max_element() <= 4.0 * most;
                assert!(out.color.iter().all(sane), "{name} {frame}: {:?}", out.color.iter().find(|c| !sane(c)));
            }
            if name == "constant" || name == "spiky" {
                let color = vec![input(1, 0); SMALL[0] * SMALL[1]];
                let out = denoiser
                    .denoise(&Frame { size: SMALL, color: &color, motion: None, alpha: None, ahead: None })
                    .unwrap();
                let far = out.color.iter().map(|c| (*c - color[0]).abs().max_element()).fold(0.0, f32::max);
                assert!(far < if name == "spiky" { 30.0 } else { 1e-3 }, "{name}: {far}");
            }
        }
    }

    /// A pixel of large negative numbers spoils what is around it alone.
    #[test]
    fn dark_spikes_do_no_harm() {
        let wanted = truth(0.0);
        let of = |spike: f32| {
            let mut denoiser = Denoiser::new(Method::Wrls2, Settings::default()).unwrap();
            let mut out = Vec::new();
            for frame in 0..12 {
                let mut color = noisy(&wanted, frame);
                color[50 + frame as usize * 7] *= spike;
                out = denoiser.denoise(&Frame { size: SIZE, color: &color, ..Frame::default() }).unwrap().color;
            }
            // The spikes lie in the upper rows.
            error(&out[SIZE[0] * 12..], &wanted[SIZE[0] * 12..])
        };
        let [without, with] = [1.0, -1e9].map(of);
        assert!(with < 1.5 * without, "{with}, {without}");
    }

    /// Pixels that are empty, in color and in alpha, stay exactly so where other frames are known.
    #[test]
    fn empty_pixels_stay_empty() {
        let inside = |i: usize| ((i % SIZE[0]) as f32 - 20.0).hypot((i / SIZE[0]) as f32 - 15.0) < 9.0;
        for opacity in [0.7, 1.0] {
            let alpha: Vec<f32> = (0..SIZE[0] * SIZE[1]).map(|i| if inside(i) { opacity } else { 0.0 }).collect();
            let truth: Vec<Vec3> = alpha.iter().map(|alpha| Vec3::new(0.9, 0.6, 0.3) * *alpha).collect();
            let mut denoiser = Denoiser::new(Method::Wrls2, Settings::default()).unwrap();
            for number in 0..6 {
                let noisy = noisy(&truth, number);
                let frame = Frame { size: SIZE, color: &noisy, alpha: Some(&alpha), ..Frame::default() };
                let out = denoiser.denoise(&frame).unwrap();
                assert!(number == 0 || (0..alpha.len()).all(|i| inside(i) || out.color[i] == Vec3::ZERO));
            }
        }
    }

    /// Alpha goes on where it tells nothing: where all is opaque until a corner clears, it guides as it would have from
    /// the start.
    #[test]
    fn alpha_that_counts_from_a_frame_on_is_none_the_worse() {
        let truth = truth(0.0);
        let corner = |i: usize| if i % SIZE[0] + i / SIZE[0] < 8 { 0.5 } else { 1.0 };
        let cleared: Vec<f32> = (0..truth.len()).map(corner).collect();
        let opaque = vec![1.0; truth.len()];
        let last = |alphas: [&[f32]; 2]| {
            let mut denoiser = Denoiser::new(Method::Wrls2, Settings::default()).unwrap();
            let mut color = Vec::new();
            for frame in 0..12 {
                let noisy = noisy(&truth, frame);
                let alpha = Some(alphas[usize::from(frame >= 9)]);
                color =
                    denoiser.denoise(&Frame { size: SIZE, color: &noisy, alpha, ..Frame::default() }).unwrap().color;
            }
            error(&color, &truth)
        };
        let [always, at_last] = [last([&cleared, &cleared]), last([&opaque, &cleared])];
        assert!(at_last < 1.5 * always, "{at_last}, {always}");
    }

    /// Frames are the same bit for bit with one thread and with several.
    #[test]
    fn threads_do_not_change_the_result() {
        for method in ALL {
            let of = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| last(5, 0.4, method).1)
            };
            assert_eq!(of(1), of(5), "{method:?}");
        }
        // Of several bands of rows, with alpha.
        let size = [20, 130];
        let of = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut denoiser = Denoiser::new(Method::Wrls2, Settings::default()).unwrap();
            let mut lookahead = Lookahead::default();
            let alpha: Vec<f32> = (0..size[0] * size[1]).map(|i| (i % 20) as f32 / 19.0).collect();
            let mut denoise = |frame: u32| {
                let color: Vec<Vec3> =
                    (0..alpha.len()).map(|i| alpha[i] * Vec3::splat(noise(frame * 7919 + i as u32))).collect();
                let motion = vec![Vec2::new(0.3, -0.2); alpha.len()];
                let frame = Frame { size, color: &color, motion: Some(&motion), alpha: Some(&alpha), ahead: None };
                let mut ahead = Ahead::default();
                lookahead.observe(&frame, &mut ahead).unwrap();
                denoiser.denoise(&Frame { ahead: Some(&ahead), ..frame }).unwrap()
            };
            pool.install(|| (0..4).map(&mut denoise).collect::<Vec<_>>())
        };
        assert_eq!(of(1), of(7));
    }

    /// A frame of another size begins anew; frames that do not fit, and constants out of range, are refused.
    #[test]
    fn frames_of_another_size_begin_anew() {
        for method in ALL {
            let mut denoiser = Denoiser::new(method, Settings::default()).unwrap();
            denoiser
                .denoise(&Frame { size: SIZE, color: &truth(0.0), motion: None, alpha: None, ahead: None })
                .unwrap();
            let small = [Vec3::splat(0.25); 6];
            let out = denoiser
                .denoise(&Frame { size: [3, 2], color: &small, motion: None, alpha: None, ahead: None })
                .unwrap();
            assert!(out.color.iter().all(|c| c.abs_diff_eq(small[0], 1e-4)), "{method:?} {:?}", out.color);
            assert!(
                denoiser
                    .denoise(&Frame { size: [3, 3], color: &small, motion: None, alpha: None, ahead: None })
                    .is_err()
            );
            let frame = Frame { size: [3, 2], color: &small, ..Frame::default() };
            assert!(denoiser.denoise(&Frame { motion: Some(&[Vec2::ZERO]), ..frame }).is_err());
            // A larger one begins anew, too.
            let wanted = truth(0.0);
            let large = Frame { size: SIZE, color: &wanted, ..Frame::default() };
            let out = denoiser.denoise(&large).unwrap();
            assert!(error(&out.color, &wanted) < 0.05, "{method:?}");
            // Histories of another frame do not fit.
            assert!(denoiser.denoise(&Frame { ahead: Some(&Ahead::default()), ..frame }).is_err());
        }
        for settings in [
            Settings { history: 1.0, ..Settings::default() },
            Settings { forgetting: f32::NAN, ..Settings::default() },
            Settings { bandwidth: 0.0, ..Settings::default() },
            Settings { spread: -1.0, ..Settings::default() },
        ] {
            assert!(Denoiser::new(Method::Wrls, settings).is_err(), "{settings:?}");
        }
    }
}
