//! Report of a statistical comparison.

use super::side::{Noise, Source};
use crate::metrics::statistical::{Region, Verdict};
use serde::Serialize;
use std::fmt;

/// Verdict on two noisy pictures with what it rests on.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct StatisticalReport {
    #[serde(flatten)]
    verdict: Verdict,
    noise: Sides,
    #[serde(skip_serializing_if = "Option::is_none")]
    heatmap_scale: Option<f64>,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Sides {
    a: Noise,
    b: Noise,
}

impl StatisticalReport {
    /// True if the expected values differ.
    pub(in crate::app::compare) fn differ(&self) -> bool {
        self.verdict.differ
    }

    /// Joins a verdict with the noise of both sides.
    pub(super) fn new(verdict: Verdict, [a, b]: [Noise; 2], heatmap_scale: Option<f64>) -> Self {
        Self { verdict, noise: Sides { a, b }, heatmap_scale }
    }
}

impl fmt::Display for Noise {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.source {
            Source::None => write!(f, "free of noise")?,
            Source::Repeats => write!(f, "{} renders", self.pictures)?,
            Source::Variance => write!(f, "a variance by pixel")?,
            Source::Halves => write!(f, "two halves of the samples")?,
        }
        if let Some(freedom) = self.freedom {
            write!(f, ", {freedom} degrees of freedom")?;
        }
        self.remark.as_ref().map_or(Ok(()), |remark| write!(f, "; {remark}"))
    }
}

/// Writes a row of the table; t is that of the worst region, or z.
fn row(f: &mut fmt::Formatter<'_>, name: &str, t: Option<f64>, p: f64, place: &str) -> fmt::Result {
    let t = t.map_or_else(|| format!("{:>9}", "inf"), |t| format!("{t:9.2}"));
    writeln!(f, "  {name:8} {t} {p:11.3e}  {place}")
}

/// Writes a row with the place of the worst region.
fn place(f: &mut fmt::Formatter<'_>, name: &str, region: Option<&Region>, p: f64) -> fmt::Result {
    let Some(r) = region else { return Ok(()) };
    let at = format!("worst at ({}, {}): {:+.3e} +- {:.1e}", r.x, r.y, r.difference, r.standard_error);
    row(f, name, r.t, p, &at)
}

impl fmt::Display for StatisticalReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let v = &self.verdict;
        writeln!(f, "size      {} x {}", v.size[0], v.size[1])?;
        writeln!(f, "noise a   {}", self.noise.a)?;
        writeln!(f, "noise b   {}", self.noise.b)?;
        for c in &v.channels {
            writeln!(f, "{:10}     t or z           p", c.channel)?;
            let interval = c.mean.interval.map_or_else(
                || String::from("no interval"),
                |[low, high]| format!("{low:+.3e} to {high:+.3e} with 95 % confidence"),
            );
            row(f, "mean", c.mean.t, c.mean.p, &format!("{:+.3e}, {interval}", c.mean.difference))?;
            place(f, "tiles", c.tiles.worst.as_ref(), c.tiles.p)?;
            place(f, "pixels", c.pixels.worst.as_ref(), c.pixels.p)?;
            let squares = format!("mean square {:.3e}, variance {:.3e}", c.spread.mean_square, c.spread.mean_variance);
            row(f, "spread", Some(c.spread.z), c.spread.p, &squares)?;
        }
        if v.left_out > 0 {
            writeln!(
                f,
                "left out  {} pixels, {} of them not finite and different",
                v.left_out, v.non_finite_differences
            )?;
        }
        if let Some(scale) = self.heatmap_scale {
            writeln!(f, "heatmap   brightest at {scale:.6e}")?;
        }
        writeln!(f, "p         {:.3e} of all tests; below {} the pictures differ", v.p, v.false_alarm)?;
        write!(f, "{}", if v.differ { "the expected values differ" } else { "no difference of expected values found" })
    }
}
