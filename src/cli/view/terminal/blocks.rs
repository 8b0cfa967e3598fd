//! Half blocks: each character shows two pixels, one by its color and one by that of its background.

use crate::report::sheet::{Canvas, Color};
use std::fmt::Write;

/// Text of a picture: one column for each pixel across, one row for two pixels down.
pub(super) fn encode(canvas: &Canvas) -> Vec<u8> {
    let mut text = String::new();
    for y in (0..canvas.height).step_by(2) {
        let mut last: Option<[Color; 2]> = None;
        for x in 0..canvas.width {
            let upper = canvas.pixel(x, y);
            let lower = if y + 1 < canvas.height { canvas.pixel(x, y + 1) } else { upper };
            if last != Some([upper, lower]) {
                let ([r, g, b], [s, t, u]) = (upper, lower);
                // Writing to a string cannot fail.
                let _ = write!(text, "\x1b[38;2;{r};{g};{b};48;2;{s};{t};{u}m");
                last = Some([upper, lower]);
            }
            text.push('▀');
        }
        text.push_str("\x1b[0m\n");
    }
    text.into_bytes()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn two_pixels_share_a_character() {
        let canvas = Canvas::of(2, 3, vec![1, 2, 3, 1, 2, 3, 4, 5, 6, 4, 5, 6, 7, 8, 9, 0, 0, 0]);
        let text = String::from_utf8(encode(&canvas)).unwrap();
        let lines: Vec<_> = text.lines().collect();
        assert_eq!(lines[0], "\x1b[38;2;1;2;3;48;2;4;5;6m▀▀\x1b[0m");
        assert_eq!(lines[1], "\x1b[38;2;7;8;9;48;2;7;8;9m▀\x1b[38;2;0;0;0;48;2;0;0;0m▀\x1b[0m");
    }
}
