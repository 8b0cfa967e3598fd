//! Map of a sphere of directions, with paths and measured values.
//!
//! Two discs show the half seen from above and the half seen from below, each in Lambert's azimuthal equal-area
//! projection: a direction at angle θ from the pole lies `√2 sin(θ/2)` of the radius from the middle.

use super::plot::{INK_RGB, PALETTE, hex};
use super::{number, picture};
use crate::error::Result;
use crate::metrics::heatmap;
use glam::{DVec2, DVec3};
use maud::{Markup, html};
use std::f64::consts::SQRT_2;
use std::fmt::Write;

/// Radius of a disc in the units of the drawing; `MARGIN` is the room around it.
const RADIUS: f64 = 200.0;
const MARGIN: f64 = 30.0;

/// A path over the sphere.
#[derive(Debug, Clone, PartialEq)]
pub struct Walk {
    /// Name of the path in the legend.
    pub label: String,
    /// Unit vectors along the path, from its start.
    pub directions: Vec<DVec3>,
}

/// A map of the sphere of directions.
#[derive(Debug, Clone, PartialEq)]
pub struct SphereMap {
    /// Name of the measured quantity.
    pub quantity: String,
    /// Unit vectors with the values measured there.
    pub samples: Vec<(DVec3, f64)>,
    /// Paths over the sphere.
    pub walks: Vec<Walk>,
    /// Best direction, which is marked by a ring.
    pub best: Option<DVec3>,
}

/// Halves of the sphere: the sign of z, and the label.
const HALVES: [(f64, &str); 2] = [(1.0, "from above (+z in the middle)"), (-1.0, "from below (-z in the middle)")];

/// Position of a direction in the disc of its half, in the units of the drawing.
/// Both halves are seen from outside: +x to the right, +y up above, and below as if the sphere were turned over its x
/// axis.
fn place(direction: DVec3, sign: f64) -> DVec2 {
    let across = DVec2::new(direction.x, sign * direction.y).normalize_or_zero();
    let reach = (1.0 - sign * direction.z).max(0.0).sqrt();
    let p = RADIUS * reach * across;
    DVec2::new(p.x, -p.y)
}

impl SphereMap {
    /// Markup of the map with its legend.
    pub(super) fn draw(&self) -> Result<Markup> {
        let finite = || self.samples.iter().map(|s| s.1).filter(|v| v.is_finite());
        let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let edge = 2.0 * (RADIUS + MARGIN);
        let middle = |half: usize| DVec2::new((half as f64 + 0.5) * edge, RADIUS + MARGIN);
        let ink = hex(INK_RGB);
        let color = |i: usize| hex(PALETTE[i % PALETTE.len()].0);
        // Dots are so large that the samples of a half cover it.
        let dot = (RADIUS * SQRT_2 / (self.samples.len() as f64).sqrt()).clamp(2.0, 24.0);
        let scale = |v: f64| if high > low { (v - low) / (high - low) } else { 0.5 };
        let rgb = |v: f64| {
            let c = heatmap::shade_rgb8(&[scale(v)], 1.0);
            format!("rgb({},{},{})", c[0], c[1], c[2])
        };
        let bar = (low <= high)
            .then(|| picture::bar(|t| heatmap::shade_rgb8(t, 1.0), &short(low), &short(high)))
            .transpose()?;
        Ok(html! {
            figure.plot {
                div.wide {
                    svg viewBox=(format!("0 0 {} {}", 2.0 * edge, edge + 24.0)) role="img"
                        aria-label=(format!("{} over the sphere of directions", self.quantity)) {
                        @for (half, (sign, name)) in HALVES.iter().enumerate() {
                            @let m = middle(half);
                            @for (d, v) in self.samples.iter().filter(|s| s.0.z * sign >= 0.0) {
                                @let p = m + place(*d, *sign);
                                circle cx=(coordinate(p.x)) cy=(coordinate(p.y)) r=(coordinate(dot)) fill=(rgb(*v)) {}
                            }
                            circle cx=(m.x) cy=(m.y) r=(RADIUS) fill="none" stroke=(ink) stroke-width="1" {}
                            @for (i, walk) in self.walks.iter().enumerate() {
                                @for line in lines(&walk.directions, *sign, m) {
                                    polyline points=(line) fill="none" stroke=(color(i)) stroke-width="2.5" {}
                                }
                                @if let Some(d) = walk.directions.first().filter(|d| d.z * sign >= 0.0) {
                                    @let p = m + place(*d, *sign);
                                    circle cx=(coordinate(p.x)) cy=(coordinate(p.y)) r="5" fill=(color(i))
                                        stroke=(ink) stroke-width="1" {}
                                }
                            }
                            @if let Some(d) = self.best.filter(|d| d.z * sign >= 0.0) {
                                @let p = m + place(d, *sign);
                                circle cx=(coordinate(p.x)) cy=(coordinate(p.y)) r="9" fill="none" stroke=(ink)
                                    stroke-width="3" {}
                            }
                            text x=(m.x) y=(edge + 12.0) text-anchor="middle" font-size="16" fill=(ink) { (name) }
                        }
                    }
                }
                figcaption {
                    @for (i, walk) in self.walks.iter().enumerate() {
                        span.key { span class={ "swatch c" (i % PALETTE.len()) } {} (walk.label) }
                    }
                    @if let Some(bar) = bar { span.key { (self.quantity) " " (bar) } }
                    span.key { "Dots are where walks begin" @if self.best.is_some() { ", the ring is the best \
                         end" } "." }
                }
            }
        })
    }
}

/// Formats a number with four decimals from 0.01 to 10, where values differ little, and with three digits elsewhere.
fn short(value: f64) -> String {
    if (0.01..10.0).contains(&value.abs()) { format!("{value:.4}") } else { number::short(value) }
}

fn coordinate(value: f64) -> String {
    format!("{value:.1}")
}

/// Parts of a path that lie in one half, each a list of points; steps are drawn as great circles.
fn lines(directions: &[DVec3], sign: f64, middle: DVec2) -> Vec<String> {
    let mut found = Vec::new();
    let mut line = String::new();
    let mut count = 0;
    let mut end = |line: &mut String, count: &mut usize| {
        if *count > 1 {
            found.push(line.trim_end().to_owned());
        }
        line.clear();
        *count = 0;
    };
    let between = directions.windows(2).flat_map(|pair| {
        let parts = (pair[0].angle_between(pair[1]) / 0.03).ceil().clamp(1.0, 200.0) as usize;
        let (a, b) = (pair[0], pair[1]);
        (0..parts).map(move |i| a.lerp(b, i as f64 / parts as f64).normalize_or_zero())
    });
    for d in between.chain(directions.last().copied()) {
        if d.z * sign < 0.0 {
            end(&mut line, &mut count);
            continue;
        }
        let p = middle + place(d, sign);
        let _ = write!(line, "{},{} ", coordinate(p.x), coordinate(p.y));
        count += 1;
    }
    end(&mut line, &mut count);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_map_keeps_areas() {
        // A cap of half the hemisphere's area ends at z = 1/2.
        let z: f64 = 0.5;
        let p = place(DVec3::new((1.0 - z * z).sqrt(), 0.0, z), 1.0);
        assert!((p.length_squared() / (RADIUS * RADIUS) - 0.5).abs() < 1e-12);
        assert!((place(DVec3::Y, 1.0) - DVec2::new(0.0, -RADIUS)).length() < 1e-9);
        assert!((place(DVec3::Y, -1.0) - DVec2::new(0.0, RADIUS)).length() < 1e-9);
        assert_eq!(place(DVec3::NEG_Z, -1.0), DVec2::ZERO);
    }

    #[test]
    fn a_walk_over_the_equator_is_cut_there() {
        let walk = [DVec3::new(1.0, 0.0, 0.3).normalize(), DVec3::new(1.0, 0.0, -0.3).normalize()];
        for sign in [1.0, -1.0] {
            let parts = lines(&walk, sign, DVec2::ZERO);
            assert_eq!(parts.len(), 1);
            assert!((5..16).contains(&parts[0].split(' ').count()), "{parts:?}");
        }
    }

    #[test]
    fn names_are_escaped() {
        let map = SphereMap {
            quantity: "<b>".into(),
            samples: vec![(DVec3::Z, 0.25), (DVec3::X, 0.75)],
            walks: vec![Walk { label: "<i>".into(), directions: vec![DVec3::Z, DVec3::X] }],
            best: Some(DVec3::X),
        };
        let text = map.draw().unwrap().into_string();
        assert!(
            !text.contains("<b>") && !text.contains("<i>") && text.contains("&lt;i&gt;") && text.contains("0.7500")
        );
    }
}
