//! B9: denoising of 1280x720 pixels, beside a copy of as many bytes as it must touch.

use crate::row::Row;
use crate::turns;
use cumulo::denoise::{Ahead, Denoised, Denoiser, Frame, Lookahead, Method, Settings};
use glam::{Vec2, Vec3};
use std::hint::black_box;

/// `-- --denoise` prints the rows.
pub const DENOISE: &str = "--denoise";

const SIZE: [usize; 2] = [1280, 720];

/// Bytes of a pixel that both directions touch once. Looking ahead: color, alpha, motion, the history before and after, and what
/// is kept of it. Denoising: the same, the feature written and read, color and confidence out, and a sixteenth of a block's sums,
/// read, written, and read and written in planes.
const BYTES: usize = 2 * (12 + 4 + 8 + 16 + 16 + 10) + 2 * 12 + 16 + 4 * 24 * 4 / 16;

/// Colors of few paths of a smooth picture.
fn noisy(seed: u32) -> Vec<Vec3> {
    let mut state = seed;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let at = |i: usize| Vec3::new(0.4 + 0.3 * ((i % SIZE[0]) as f32 / 70.0).sin(), 0.3, 0.5) * 2.0 * random();
    (0..SIZE[0] * SIZE[1]).map(at).collect()
}

/// Returns the rows.
pub fn rows() -> Vec<Row> {
    let count = SIZE[0] * SIZE[1];
    let frames: Vec<Vec<Vec3>> = (1..5).map(noisy).collect();
    let motion: Vec<Vec2> = (0..count).map(|i| Vec2::new(1.3, 0.4 + 1e-4 * (i % SIZE[0]) as f32)).collect();
    let alpha: Vec<f32> = (0..count).map(|i| 0.5 + 0.5 * ((i / SIZE[0]) as f32 / 90.0).sin()).collect();
    let denoiser = |method| Denoiser::new(method, Settings::default()).unwrap();
    let [mut guided, mut forward, mut alone, mut published] =
        [Method::Wrls2, Method::Wrls2, Method::Wrls2, Method::Wrls].map(denoiser);
    let size = SIZE;
    let mut at = 0;
    let mut next = |alpha| {
        at += 1;
        Frame { size, color: &frames[at % frames.len()], motion: Some(&motion), alpha, ahead: None }
    };
    let (mut lookahead, mut ahead) = (Lookahead::default(), Ahead::default());
    lookahead.observe(&next(Some(&alpha)), &mut ahead).unwrap();
    // Memory is used again, as where results are written and frames are many.
    let mut to: [Denoised; 4] = Default::default();
    let [both, one, plain, paper] = &mut to;
    let (kept, mut looked) = (ahead.clone(), ahead);
    let [from, mut copy] = [vec![1_u8; count * BYTES / 2], vec![0_u8; count * BYTES / 2]];
    let next = std::cell::RefCell::new(&mut next);
    let frame = |alpha| (*next.borrow_mut())(alpha);
    let alpha = Some(&alpha[..]);
    let seconds = turns::in_turn([
        &mut || lookahead.observe(&frame(alpha), &mut looked).unwrap(),
        &mut || guided.denoise_into(&Frame { ahead: Some(&kept), ..frame(alpha) }, both).unwrap(),
        &mut || forward.denoise_into(&frame(alpha), one).unwrap(),
        &mut || alone.denoise_into(&frame(None), plain).unwrap(),
        &mut || published.denoise_into(&frame(None), paper).unwrap(),
        &mut || {
            let parts = copy.chunks_mut(count * BYTES / 4).zip(from.chunks(count * BYTES / 4));
            std::thread::scope(|scope| {
                for (to, from) in parts {
                    scope.spawn(|| to.copy_from_slice(from));
                }
            });
            black_box(&copy);
        },
    ]);
    black_box(&to);
    let [look, guided, forward, alone, published, copy] = seconds.map(|s| turns::median(&s));
    let ms = |seconds: f64| format!("{:.1} ms", 1e3 * seconds);
    let works = [
        ("wrls2, both directions", look + guided),
        ("wrls2, the look ahead of it", look),
        ("wrls2, forward", forward),
        ("wrls2, forward, without alpha", alone),
        ("wrls as published", published),
    ];
    let row = |(name, time): (&str, f64)| Row {
        ratio: Some(time / copy),
        ..Row::figure("B9", format!("1280x720, {name}"), ms(time))
            .against(format!("copy of {BYTES} bytes a pixel: {}", ms(copy)))
    };
    works.into_iter().map(row).collect()
}
