//! Axes along the edges of a picture.

use super::{Canvas, Font, INK, PAPER};

/// Width of the border that holds an axis.
const BORDER: usize = 20;
/// Length of an axis' arrow, and of its head.
const ARROW: f64 = 28.0;
const HEAD: f64 = 4.0;

/// Returns a picture with the names of its axes: `right` below its lower left corner with an arrow to the right, and
/// `up` beside it with an arrow up.
pub(crate) fn with_axes(picture: &Canvas, right: &str, up: &str) -> Canvas {
    let mut canvas = Canvas::new(picture.width + BORDER, picture.height + BORDER, PAPER);
    canvas.put(picture, [BORDER, 0]);
    let (x, y) = (0.5 * BORDER as f64, picture.height as f64 + 0.5 * BORDER as f64);
    let length = ARROW.min(0.5 * picture.width as f64).min(0.5 * picture.height as f64);
    let mut arrow = |tip: [f64; 2], sides: [[f64; 2]; 2]| {
        canvas.line([x, y], tip, 1, INK);
        for [dx, dy] in sides {
            canvas.line(tip, [tip[0] + dx, tip[1] + dy], 1, INK);
        }
    };
    let (to_right, to_up) = ([x + length, y], [x, y - length]);
    arrow(to_right, [[-HEAD, -HEAD], [-HEAD, HEAD]]);
    arrow(to_up, [[-HEAD, HEAD], [HEAD, HEAD]]);
    let height = Font::Small.size()[1];
    let beyond = |tip: f64| (tip + 5.0) as usize;
    canvas.text([beyond(to_right[0]), picture.height + (BORDER - height) / 2], right, Font::Small, INK);
    let above = (to_up[1] - 5.0 - height as f64).max(0.0) as usize;
    canvas.text([BORDER.saturating_sub(Font::Small.width(up)) / 2, above], up, Font::Small, INK);
    canvas
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_leave_the_picture_alone() {
        let picture = Canvas::new(60, 50, [200, 0, 0]);
        let framed = with_axes(&picture, "x", "z");
        assert_eq!((framed.width, framed.height), (60 + BORDER, 50 + BORDER));
        assert_eq!(framed.rgb.chunks(3).filter(|p| *p == [200, 0, 0]).count(), 60 * 50);
        let ink = |x: std::ops::Range<usize>, y: std::ops::Range<usize>| {
            y.flat_map(|y| x.clone().map(move |x| (x, y))).filter(|(x, y)| framed.pixel(*x, *y) == INK).count()
        };
        assert!(ink(0..BORDER, 0..50) > 20 && ink(BORDER..80, 50..70) > 20);
    }
}
