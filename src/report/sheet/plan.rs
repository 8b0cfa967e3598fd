//! Where cameras stand and look, from above.

use super::{Canvas, Color, Font, INK, PALE, PAPER, with_axes};
use crate::report::number;
use crate::scene::up::Up;
use glam::{DVec2, DVec3};

/// Colors of cameras above and below the middle of their heights, and of what they see.
const HIGH: Color = [196, 84, 24];
const LOW: Color = [31, 95, 191];
const SUBJECT: Color = [176, 180, 188];

/// Least side of what cameras see, in pixels.
const LEAST: f64 = 9.0;

/// Share of the plan's side that a camera's line of sight takes.
const SIGHT: f64 = 0.07;
/// Pixels between the plan's border and the outermost camera.
const ROOM: f64 = 22.0;

/// A camera of a plan.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Stand {
    /// Number beside the camera; none for cameras without room for it.
    pub label: Option<String>,
    /// Position in world units.
    pub position: DVec3,
    /// Viewing direction.
    pub forward: DVec3,
    /// Half of the angle of view, in radians, from the middle to the left or right edge.
    pub half_angle: f64,
}

/// Draws cameras from above on a square of `side` pixels, in a world with `up` upwards: x to the right and y up where
/// that is z, -z up where it is y. `subject` are world points around what the cameras see; there may be none. Returns
/// the plan, and the world length of its bar.
pub(crate) fn plan(stands: &[Stand], subject: &[DVec3], side: usize, up: Up) -> (Canvas, f64) {
    let turn = up.turn(Up::Z);
    let turned = |stand: &Stand| Stand {
        position: turn * stand.position,
        forward: turn * stand.forward,
        label: stand.label.clone(),
        half_angle: stand.half_angle,
    };
    let stands: Vec<Stand> = stands.iter().map(turned).collect();
    let subject: Vec<DVec3> = subject.iter().map(|point| turn * *point).collect();
    let vertical = match up {
        Up::Z => "y",
        Up::Y => "-z",
    };
    upright(&stands, &subject, side, vertical)
}

/// Draws the plan of a world whose z axis is up. `vertical` names the axis up the plan.
fn upright(stands: &[Stand], subject: &[DVec3], side: usize, vertical: &str) -> (Canvas, f64) {
    let mut canvas = Canvas::new(side, side, PAPER);
    let flat = |p: DVec3| p.truncate();
    let points = || stands.iter().map(|s| flat(s.position)).chain(subject.iter().copied().map(flat));
    let finite = || points().filter(|p| p.is_finite());
    let low = finite().fold(DVec2::INFINITY, DVec2::min);
    let high = finite().fold(DVec2::NEG_INFINITY, DVec2::max);
    if !(low.is_finite() && high.is_finite()) {
        return (with_axes(&canvas, "x", vertical), 0.0);
    }
    let extent = (high - low).max_element();
    // A single camera stands in the middle of a plan of one unit.
    let extent = if extent > 0.0 { extent } else { 1.0 };
    // A camera looks as far as its line of sight, beyond the outermost one.
    let inner = (side as f64 - 2.0 * ROOM) * (1.0 - 2.0 * SIGHT);
    let scale = inner / extent;
    let middle = 0.5 * (low + high);
    let at = |p: DVec2| {
        let p = (p - middle) * scale;
        [0.5 * side as f64 + p.x, 0.5 * side as f64 - p.y]
    };
    box_of(&mut canvas, subject, at);
    let heights = stands.iter().map(|s| s.position.z).filter(|z| z.is_finite());
    let (bottom, top) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), z| (a.min(z), b.max(z)));
    let sight = SIGHT * side as f64 / scale;
    for stand in stands.iter().filter(|s| s.position.is_finite() && s.forward.is_finite()) {
        let color = if stand.position.z > 0.5 * (bottom + top) { HIGH } else { LOW };
        let from = flat(stand.position);
        let ahead = flat(stand.forward) * sight;
        let half = stand.half_angle.clamp(0.0, 1.2);
        for turn in [-half, half] {
            let edge = DVec2::from_angle(turn).rotate(ahead) / half.cos();
            canvas.line(at(from), at(from + edge), 1, color);
        }
        let [left, right] = [-half, half].map(|turn| at(from + DVec2::from_angle(turn).rotate(ahead) / half.cos()));
        canvas.line(left, right, 1, color);
        let [x, y] = at(from).map(|v| v.round() as i64);
        (-2..3).for_each(|dy| (-2..3).for_each(|dx| canvas.set(x + dx, y + dy, color)));
        if let Some(label) = &stand.label {
            // Beside the camera, away from where it looks.
            let away = -flat(stand.forward).normalize_or(DVec2::NEG_Y) * 12.0;
            let [width, height] = [Font::Small.width(label) as f64, Font::Small.size()[1] as f64];
            let place = [x as f64 + away.x - 0.5 * width, y as f64 - away.y - 0.5 * height];
            let inside = |v: f64, own: f64| v.clamp(0.0, (side as f64 - own).max(0.0)) as usize;
            canvas.text([inside(place[0], width), inside(place[1], height)], label, Font::Small, INK);
        }
    }
    let bar = round_below(0.25 * side as f64 / scale);
    let length = (bar * scale).round() as usize;
    canvas.fill([4, 6], [length, 2], PALE);
    canvas.text([8 + length, 0], &number::short(bar), Font::Small, PALE);
    (with_axes(&canvas, "x", vertical), bar)
}

/// Fills the rectangle around what cameras see.
fn box_of(canvas: &mut Canvas, subject: &[DVec3], at: impl Fn(DVec2) -> [f64; 2]) {
    let finite = || subject.iter().filter(|p| p.is_finite()).map(|p| p.truncate());
    let (low, high) = (finite().fold(DVec2::INFINITY, DVec2::min), finite().fold(DVec2::NEG_INFINITY, DVec2::max));
    if low.is_finite() && high.is_finite() {
        let ([left, bottom], [right, top]) = (at(low), at(high));
        // A point is seen, too.
        let grown = |low: f64, high: f64| {
            if high - low < LEAST { (0.5 * (low + high - LEAST), LEAST) } else { (low, high - low) }
        };
        let [(x, width), (y, height)] = [grown(left, right), grown(top, bottom)];
        let whole = |v: f64| v.max(0.0).round() as usize;
        canvas.fill([whole(x), whole(y)], [whole(width), whole(height)], SUBJECT);
    }
}

/// The largest of 1, 2 and 5 times a power of ten that does not exceed a number.
fn round_below(value: f64) -> f64 {
    if !(value > 0.0 && value.is_finite()) {
        return 0.0;
    }
    let power = 10_f64.powf(value.log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|f| f * power).find(|v| *v <= value).unwrap_or(power)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stand(x: f64, y: f64, z: f64) -> Stand {
        let position = DVec3::new(x, y, z);
        Stand { label: Some("7".into()), position, forward: -position.normalize_or(DVec3::X), half_angle: 0.35 }
    }

    #[test]
    fn cameras_stand_where_they_are() {
        // One in the east, high up, and one in the north.
        let stands = [stand(10.0, 0.0, 5.0), stand(0.0, 10.0, 0.0), stand(-10.0, 0.0, 0.0), stand(0.0, -10.0, 0.0)];
        let (canvas, bar) = plan(&stands, &[DVec3::splat(-1.0), DVec3::splat(1.0)], 200, Up::Z);
        let mean = |color: Color| {
            let all = (0..canvas.width * canvas.height).map(|i| (i % canvas.width, i / canvas.width));
            let own: Vec<_> = all.filter(|(x, y)| canvas.pixel(*x, *y) == color).collect();
            let n = own.len().max(1) as f64;
            (own.iter().map(|p| p.0 as f64).sum::<f64>() / n, own.iter().map(|p| p.1 as f64).sum::<f64>() / n)
        };
        // The border of the axes shifts columns by 20.
        let (east, middle) = (mean(HIGH), mean(SUBJECT));
        assert!(east.0 > 160.0 && (east.1 - 100.0).abs() < 3.0, "{east:?}");
        assert!((middle.0 - 120.0).abs() < 2.0 && (middle.1 - 100.0).abs() < 2.0, "{middle:?}");
        assert_eq!(bar, 5.0);
        // The same cameras in a world whose y axis is up.
        let turn = Up::Z.turn(Up::Y);
        let others = stands.map(|s| Stand { position: turn * s.position, forward: turn * s.forward, ..s });
        let (other, _) = plan(&others, &[DVec3::splat(-1.0), DVec3::splat(1.0)], 200, Up::Y);
        let inside = |canvas: &Canvas| {
            (0..200).flat_map(|y| (20..220).map(move |x| (x, y))).map(|(x, y)| canvas.pixel(x, y)).collect::<Vec<_>>()
        };
        assert!(inside(&other) == inside(&canvas), "the plan is the same");
        assert!(other != canvas, "but for the names of its axes");
    }

    #[test]
    fn odd_cameras_are_drawn_or_left_out() {
        plan(&[], &[], 100, Up::Z);
        let (alone, bar) = plan(&[stand(7.0, -2.0, 3.0)], &[], 100, Up::Z);
        assert!(bar > 0.0 && alone.pixel(20 + 50, 50) == LOW, "{bar}");
        plan(&[stand(f64::NAN, 0.0, 0.0), stand(1e300, 0.0, 0.0)], &[DVec3::INFINITY], 50, Up::Z);
        assert_eq!([0.37, 99.0, 1.0, 0.0, f64::INFINITY].map(round_below), [0.2, 50.0, 1.0, 0.0, 0.0]);
    }
}
