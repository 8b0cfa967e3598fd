//! Sixels: bands of six rows, each a row of characters for every color in it (DEC VT340, ANSI X3.64).

use crate::report::sheet::{Canvas, Color};
use std::fmt::Write;

/// Levels of red, green and blue in the palette: 252 colors, of which terminals have 256.
const LEVELS: [usize; 3] = [6, 7, 6];
const COLORS: usize = LEVELS[0] * LEVELS[1] * LEVELS[2];

/// Thresholds of ordered dithering over 4 x 4 pixels (Bayer 1973), in sixteenths.
const BAYER: [[u32; 4]; 4] = [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]];

/// Number in the palette of a pixel's color, dithered by its place.
fn nearest(color: Color, x: usize, y: usize) -> usize {
    let threshold = f64::from(2 * BAYER[y % 4][x % 4] + 1) / 32.0;
    (0..3).fold(0, |number, c| {
        let level = f64::from(color[c]) / 255.0 * (LEVELS[c] - 1) as f64;
        number * LEVELS[c] + ((level + threshold) as usize).min(LEVELS[c] - 1)
    })
}

/// Text of a picture, with its palette.
pub(super) fn encode(canvas: &Canvas) -> Vec<u8> {
    let mut text = format!("\x1bPq\"1;1;{};{}", canvas.width, canvas.height);
    for number in 0..COLORS {
        let level = |c: usize, number: usize| 100 * number / (LEVELS[c] - 1);
        let (r, g, b) = (number / (LEVELS[1] * LEVELS[2]), number / LEVELS[2] % LEVELS[1], number % LEVELS[2]);
        // Writing to a string cannot fail.
        let _ = write!(text, "#{number};2;{};{};{}", level(0, r), level(1, g), level(2, b));
    }
    for top in (0..canvas.height).step_by(6) {
        band(canvas, top, &mut text);
    }
    text.push_str("\x1b\\\n");
    text.into_bytes()
}

/// Writes six rows.
fn band(canvas: &Canvas, top: usize, text: &mut String) {
    let mut rows: Vec<Option<Vec<u8>>> = vec![None; COLORS];
    for (row, y) in (top..canvas.height.min(top + 6)).enumerate() {
        for x in 0..canvas.width {
            let bits = rows[nearest(canvas.pixel(x, y), x, y)].get_or_insert_with(|| vec![0; canvas.width]);
            bits[x] |= 1 << row;
        }
    }
    for (number, bits) in rows.iter().enumerate().filter_map(|(number, bits)| Some((number, bits.as_ref()?))) {
        let _ = write!(text, "#{number}");
        for run in bits.chunk_by(|a, b| a == b) {
            let sixel = char::from(63 + run[0]);
            match run.len() {
                n @ 0..4 => text.extend(std::iter::repeat_n(sixel, n)),
                n => {
                    let _ = write!(text, "!{n}{sixel}");
                }
            }
        }
        // The next color begins at the left again.
        text.push('$');
    }
    text.push('-');
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// Number of pixels in each color, as a terminal would draw them.
    fn drawn(text: &str) -> Vec<usize> {
        let mut counts = vec![0; COLORS];
        let body = &text[text.find('#').unwrap()..text.len() - 3];
        let mut color = 0;
        let mut chars = body.chars().peekable();
        let number = |chars: &mut std::iter::Peekable<std::str::Chars>| {
            let mut n = 0;
            while let Some(digit) = chars.peek().and_then(|c| c.to_digit(10)) {
                n = 10 * n + digit as usize;
                chars.next();
            }
            n
        };
        let mut repeat = 1;
        while let Some(c) = chars.next() {
            match c {
                '#' => {
                    color = number(&mut chars);
                    while chars.peek() == Some(&';') {
                        chars.next();
                        number(&mut chars);
                    }
                }
                '!' => repeat = number(&mut chars),
                '$' | '-' => {}
                c => {
                    counts[color] += repeat * (c as u32 - 63).count_ones() as usize;
                    repeat = 1;
                }
            }
        }
        counts
    }

    #[test]
    fn every_pixel_is_drawn_once() {
        let rgb: Vec<u8> = (0..3 * 31 * 17_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let text = String::from_utf8(encode(&Canvas::of(31, 17, rgb))).unwrap();
        assert!(text.starts_with("\x1bPq\"1;1;31;17#0;2;0;0;0") && text.ends_with("\x1b\\\n"));
        assert_eq!(drawn(&text).iter().sum::<usize>(), 31 * 17);
        // Black and white are colors of the palette, and stay what they are.
        let counts = drawn(&String::from_utf8(encode(&Canvas::new(5, 7, [255; 3]))).unwrap());
        assert_eq!(counts[COLORS - 1], 35);
        assert_eq!(drawn(&String::from_utf8(encode(&Canvas::new(9, 3, [0; 3]))).unwrap())[0], 27);
    }
}
