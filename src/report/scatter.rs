//! Points with intervals over logarithmic axes, as SVG in the page.

use super::number;
use super::plot::{Canvas, DASH, GRID, INK, NARROW, PALETTE, WIDE};
use crate::error::{Error, Result};
use maud::{Markup, PreEscaped, html};
use plotters::prelude::*;
use std::ops::Range;

/// Most labels of a vertical axis of many powers of ten.
const HEIGHT_LABELS: usize = 8;

/// A point with the intervals that it may lie in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Dot {
    /// Place along the horizontal axis.
    pub x: f64,
    /// Place along the vertical axis.
    pub y: f64,
    /// Interval along the horizontal axis.
    pub x_range: Option<[f64; 2]>,
    /// Interval along the vertical axis.
    pub y_range: Option<[f64; 2]>,
}

/// Points of one kind.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Cloud {
    /// Name of the kind in the legend.
    pub label: String,
    /// Points; those that are not above 0 are left out.
    pub dots: Vec<Dot>,
}

/// A plot of points over two logarithmic axes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Scatter {
    /// Label of the horizontal axis, with its unit.
    pub x: String,
    /// Label of the vertical axis, with its unit.
    pub y: String,
    /// Points by their kinds.
    pub clouds: Vec<Cloud>,
    /// Points that no other one is left of and below, from left to right.
    pub front: Vec<(f64, f64)>,
    /// Height of a dashed line with its name; 0 for none.
    pub floor: (String, f64),
}

impl Scatter {
    /// Markup of the plot with its legend.
    ///
    /// # Errors
    /// If the plot cannot be drawn.
    pub(super) fn draw(&self) -> Result<Markup> {
        let dots = || self.clouds.iter().flat_map(|cloud| &cloud.dots).filter(|dot| is_plottable(dot));
        let (Some(x), Some(y)) = (decades(dots().map(|dot| dot.x)), decades(self.heights())) else {
            return Ok(html! { p { "There are no points to plot." } });
        };
        let svg = |canvas: &Canvas| {
            let mut svg = String::new();
            self.paint((x.clone(), y.clone()), canvas, &mut svg)
                .map_err(|e| Error::invalid(format!("the plot of {} cannot be drawn: {e}", self.y)))?;
            Ok::<_, Error>(svg.replacen(" xmlns=\"http://www.w3.org/2000/svg\"", "", 1))
        };
        let label = format!("{} over {}, logarithmic", self.y, self.x);
        let canvases = [("wide-only", svg(&WIDE)?), ("narrow-only", svg(&NARROW)?)];
        Ok(html! {
            figure.plot {
                @for (class, svg) in canvases {
                    div class=(class) role="img" aria-label=(label) { (PreEscaped(svg)) }
                }
                figcaption {
                    @for (i, cloud) in self.clouds.iter().enumerate() {
                        span.key { span class={ "swatch c" (i % PALETTE.len()) } {} (cloud.label) }
                    }
                    span.caption {
                        "The line joins the points that no other one beats; whiskers are intervals."
                        @if self.floor.1 > 0.0 { " Dashed: " (self.floor.0) ", " (number::short(self.floor.1)) "." }
                    }
                }
            }
        })
    }

    /// Heights that are drawn.
    fn heights(&self) -> impl Iterator<Item = f64> {
        let dots = self.clouds.iter().flat_map(|cloud| &cloud.dots).filter(|dot| is_plottable(dot));
        dots.map(|dot| dot.y).chain(Some(self.floor.1).filter(|y| *y > 0.0))
    }

    fn paint(
        &self,
        (x, y): (Range<f64>, Range<f64>),
        canvas: &Canvas,
        svg: &mut String,
    ) -> std::result::Result<(), Box<dyn std::error::Error>> {
        let area = SVGBackend::with_string(svg, canvas.size).into_drawing_area();
        let mut chart = ChartBuilder::on(&area)
            .margin(12)
            .margin_right(24)
            .x_label_area_size(46)
            .y_label_area_size(64)
            .build_cartesian_2d(
                x.clone().log_scale().with_key_points(ticks(&x, canvas.labels)),
                y.clone().log_scale().with_key_points(ticks(&y, HEIGHT_LABELS)),
            )?;
        let text = ("sans-serif", 14).into_font().color(&INK.0);
        chart
            .configure_mesh()
            .x_label_formatter(&|v| power(*v))
            .y_label_formatter(&|v| power(*v))
            .x_desc(&self.x)
            .y_desc(&self.y)
            .label_style(text.clone())
            .axis_desc_style(text)
            .axis_style(INK.0)
            .bold_line_style(GRID.0)
            .light_line_style(TRANSPARENT)
            .draw()?;
        if self.floor.1 > 0.0 {
            let line = [(x.start, self.floor.1), (x.end, self.floor.1)];
            chart.draw_series(DashedLineSeries::new(line, DASH.0, DASH.1, INK.0.stroke_width(1)))?;
        }
        chart.draw_series(LineSeries::new(stairs(&self.front), INK.0.stroke_width(1)))?;
        let within = |[a, b]: [f64; 2], range: &Range<f64>| [a, b].map(|v| v.clamp(range.start, range.end));
        for (i, cloud) in self.clouds.iter().enumerate() {
            let color = PALETTE[i % PALETTE.len()].0;
            for dot in cloud.dots.iter().filter(|dot| is_plottable(dot)) {
                let horizontal = dot.x_range.map(|ends| within(ends, &x).map(|x| (x, dot.y)));
                let vertical = dot.y_range.map(|ends| within(ends, &y).map(|y| (dot.x, y)));
                let whiskers = [horizontal, vertical].into_iter().flatten();
                chart.draw_series(whiskers.map(|ends| PathElement::new(ends, color.stroke_width(1))))?;
                let best = self.front.contains(&(dot.x, dot.y));
                let at = (dot.x, dot.y);
                chart.draw_series([Circle::new(at, if best { 5 } else { 3 }, color.filled())])?;
            }
        }
        area.present()?;
        Ok(())
    }
}

fn is_plottable(dot: &Dot) -> bool {
    [dot.x, dot.y].iter().all(|v| v.is_finite() && *v > 0.0)
}

/// Corners of the line below which no point lies: an error is reached from the time on that it takes.
fn stairs(front: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let corners = front.windows(2).flat_map(|pair| [pair[0], (pair[1].0, pair[0].1)]);
    corners.chain(front.last().copied()).collect()
}

/// Range from 1, 2 or 5 times a power of ten below all values to one above them; none without values.
fn decades(values: impl Iterator<Item = f64>) -> Option<Range<f64>> {
    let (low, high) = values.fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
    let steps = |v: f64| [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0].map(|step| step * 10_f64.powf(v.log10().floor()));
    let below = steps(low).into_iter().rfind(|step| *step < 0.95 * low)?;
    let above = steps(high).into_iter().find(|step| *step > 1.05 * high).unwrap_or(2.0 * high);
    (low <= high).then_some(below..above)
}

/// Ticks of a logarithmic axis: powers of ten, so many of them at most, of fewer than two also their double and
/// fivefold.
fn ticks(range: &Range<f64>, most: usize) -> Vec<f64> {
    let [low, high] = [range.start, range.end].map(f64::log10);
    let steps: &[f64] = if high - low < 2.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
    let every = ((high - low) / most as f64).ceil() as usize;
    let powers = (low.floor() as i32..=high.ceil() as i32).step_by(every.max(1));
    let all = powers.flat_map(|power| steps.iter().map(move |step| step * 10_f64.powi(power)));
    all.filter(|tick| (range.start..=range.end).contains(tick)).collect()
}

/// Formats a number of an axis, of one digit that is not zero.
fn power(value: f64) -> String {
    // Powers of ten are not quite whole in logarithms.
    match (value.log10() + 1e-9).floor() as i32 {
        exponent @ -2..=3 => format!("{value:.*}", (-exponent).max(0) as usize),
        _ => format!("{value:.0e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_hold_all_points_and_name_powers_of_ten() {
        assert_eq!(decades([0.03, 4.0].into_iter()), Some(0.02..5.0));
        assert_eq!(decades([1.0].into_iter()), Some(0.5..2.0));
        assert_eq!(decades(std::iter::empty()), None);
        assert_eq!([1e-5, 1e-2, 1.0, 1e3, 1e4].map(power), ["1e-5", "0.01", "1", "1000", "1e4"].map(String::from));
        assert_eq!([2e-3, 3e-2, 500.0].map(power), ["2e-3", "0.03", "500"].map(String::from));
    }

    #[test]
    fn axes_have_ticks() {
        assert_eq!(ticks(&(0.02..0.5), 5), [0.02, 0.05, 0.1, 0.2, 0.5]);
        assert_eq!(ticks(&(0.5..50.0), 5), [1.0, 10.0]);
        assert_eq!(ticks(&(1e-9..1.0), 5), [1e-9, 1e-7, 1e-5, 1e-3, 0.1]);
    }

    #[test]
    fn an_error_is_reached_from_its_time_on() {
        assert_eq!(stairs(&[(1.0, 3.0), (2.0, 1.0)]), [(1.0, 3.0), (2.0, 3.0), (2.0, 1.0)]);
        assert!(stairs(&[]).is_empty());
    }

    #[test]
    fn points_at_zero_are_no_harm() {
        let dot = |y| Dot { x: 0.1, y, x_range: Some([0.0, 0.2]), y_range: Some([-1.0, 2.0 * y]) };
        let cloud = Cloud { label: "a".into(), dots: vec![dot(0.0), dot(0.1)] };
        let scatter = Scatter {
            x: "s".into(),
            y: "e".into(),
            clouds: vec![cloud],
            front: vec![(0.1, 0.1)],
            floor: ("u".into(), 0.0),
        };
        let html = scatter.draw().map(PreEscaped::into_string).unwrap_or_default();
        assert_eq!(html.matches("<circle").count(), 2, "one point on both canvases: {html}");
    }
}
