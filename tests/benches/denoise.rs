//! B9: denoising of 1280x720 pixels, beside a copy of as many bytes as it must touch.

use crate::row::Row;
use crate::turns;
use cumulo::denoise::{Denoiser, Frame, Method, Settings, fused};
use glam::{Vec2, Vec3};
use std::hint::black_box;

/// `-- --denoise` prints the rows.
pub const DENOISE: &str = "--denoise";

const SIZE: [usize; 2] = [1280, 720];

/// Bytes of a pixel that a direction of time touches once: color, alpha, motion, the history before and after, the feature
/// written and read, color and confidence out, and a sixteenth of a block's sums, read and written in both orders.
const BYTES: usize = 12 + 4 + 8 + 32 + 32 + 2 * 12 + 16 + 4 * 48 * 4 / 16;

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
    let (mut guided, mut alone, mut published) =
        (denoiser(Method::Wrls2), denoiser(Method::Wrls2), denoiser(Method::Wrls));
    let mut at = 0;
    let mut next = |denoiser: &mut Denoiser, alpha: Option<&[f32]>| {
        at += 1;
        let color = &frames[at % frames.len()];
        denoiser.denoise(&Frame { size: SIZE, color, motion: Some(&motion), alpha }).unwrap()
    };
    let other = next(&mut guided, Some(&alpha));
    let mut forward = Some(other.clone());
    let [from, mut to] = [vec![1_u8; count * BYTES / 2], vec![0_u8; count * BYTES / 2]];
    let next = std::cell::RefCell::new(&mut next);
    let seconds = turns::in_turn([
        &mut || drop(black_box((*next.borrow_mut())(&mut guided, Some(&alpha)))),
        &mut || drop(black_box((*next.borrow_mut())(&mut alone, None))),
        &mut || drop(black_box((*next.borrow_mut())(&mut published, None))),
        &mut || forward = forward.take().map(|forward| fused(forward, &other)),
        &mut || {
            let parts = to.chunks_mut(count * BYTES / 4).zip(from.chunks(count * BYTES / 4));
            std::thread::scope(|scope| {
                for (to, from) in parts {
                    scope.spawn(|| to.copy_from_slice(from));
                }
            });
            black_box(&to);
        },
    ]);
    let [guided, alone, published, fusion, copy] = seconds.map(|s| turns::median(&s));
    let ms = |seconds: f64| format!("{:.1} ms", 1e3 * seconds);
    let works = [
        ("wrls2, one direction", guided),
        ("wrls2, one direction, without alpha", alone),
        ("wrls2, both directions", 2.0 * guided + fusion),
        ("wrls as published", published),
    ];
    let row = |(name, time): (&str, f64)| Row {
        ratio: Some(time / copy),
        ..Row::figure("B9", format!("1280x720, {name}"), ms(time))
            .against(format!("copy of {BYTES} bytes a pixel: {}", ms(copy)))
    };
    works.into_iter().map(row).collect()
}
