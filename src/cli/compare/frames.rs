//! Comparison of two sequences.

use super::Arguments;
use crate::cli::output::Output;
use crate::error::{Error, Result};
use crate::formats::sequence::Pattern;
use crate::formats::{exr, png};
use crate::metrics::error::psnr_db;
use crate::metrics::{self, flicker, flip};
use crate::scene::film::Film;
use serde::Serialize;
use std::fmt;
use std::process::ExitCode;

/// Figures of a frame.
#[derive(Debug, Clone, Serialize)]
struct Figures {
    frame: u32,
    /// `null` for identical colors.
    psnr_db: Option<f64>,
    ssim: f64,
    rel_mse: f64,
    max_abs: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    flip: Option<f64>,
    /// PSNR of the change from the frame before; `null` for the first, and without any error.
    flicker_psnr_db: Option<f64>,
}

#[derive(Debug, Serialize)]
struct Report {
    frames: Vec<Figures>,
    /// Of the mean squared error over all frames, for the largest peak.
    psnr_db: Option<f64>,
    /// Of the mean squared error of the changes from frame to frame.
    flicker_psnr_db: Option<f64>,
    /// Means over the frames.
    ssim: f64,
    rel_mse: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    flip: Option<f64>,
    max_abs: f64,
    peak: f64,
    /// Frames that only one of the sequences has.
    left_out: Vec<u32>,
    differ: bool,
}

/// A figure in decibels, or a dash.
struct Decibels(Option<f64>);

impl fmt::Display for Decibels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(v) => f.pad(&format!("{v:.2}")),
            None => f.pad("-"),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "   frame  psnr_db     ssim    rel_mse  flicker_psnr_db{}",
            if self.flip.is_some() { "    flip" } else { "" }
        )?;
        let end = |flip: Option<f64>| flip.map_or_else(String::new, |flip| format!("  {flip:.4}"));
        for g in &self.frames {
            let (psnr, flicker) = (Decibels(g.psnr_db), Decibels(g.flicker_psnr_db));
            writeln!(f, "{:8} {psnr:>8} {:8.5} {:10.3e} {flicker:>16}{}", g.frame, g.ssim, g.rel_mse, end(g.flip))?;
        }
        let (psnr, flicker) = (Decibels(self.psnr_db), Decibels(self.flicker_psnr_db));
        writeln!(f, "     all {psnr:>8} {:8.5} {:10.3e} {flicker:>16}{}", self.ssim, self.rel_mse, end(self.flip))?;
        if !self.left_out.is_empty() {
            writeln!(f, "left out  {} frames that only one of the sequences has", self.left_out.len())?;
        }
        write!(f, "{}", if self.differ { "the sequences differ" } else { "the sequences agree" })
    }
}

/// Compares two sequences frame by frame.
///
/// # Errors
/// If they have no frame in common, or a frame cannot be read or compared.
pub fn run(arguments: &Arguments, [a, b]: [&Pattern; 2], output: &Output) -> Result<ExitCode> {
    if arguments.heatmap.is_some() {
        return Err(Error::invalid("--heatmap: a sequence has many differences").hint("compare one frame of it"));
    }
    let [first, second] = [a.numbers()?, b.numbers()?];
    let both: Vec<u32> = first.iter().copied().filter(|number| second.contains(number)).collect();
    if both.is_empty() {
        return Err(Error::invalid("the sequences have no frame in common")
            .at(&arguments.a)
            .hint("frames are matched by their numbers"));
    }
    let left_out: Vec<u32> = first
        .iter()
        .filter(|n| !both.contains(n))
        .chain(second.iter().filter(|n| !both.contains(n)))
        .copied()
        .collect();
    let limits = arguments.memory.limits();
    let bar = output.progress(both.len() as u64, "compare");
    let mut before: Option<(u32, [Film; 2])> = None;
    let (mut frames, mut errors, mut flickers) = (Vec::new(), Vec::new(), Vec::new());
    let (mut peak, mut differ, mut decibels) = (1.0_f64, false, Vec::new());
    for number in both {
        let paths = [a.path(number), b.path(number)];
        super::check_memory([&paths[0], &paths[1]], arguments.flip, limits)?;
        let layer = arguments.layer.as_deref();
        let films =
            [exr::picture_within(&paths[0], layer, limits)?.film, exr::picture_within(&paths[1], layer, limits)?.film];
        let named = |e: Error| e.part(format!("{} and {}", paths[0].display(), paths[1].display()));
        let c = metrics::compare(&films[0], &films[1]).map_err(named)?;
        let follows = before.as_ref().filter(|(last, old)| last + 1 == number && old[0].width == films[0].width);
        let change = follows.map(|(_, old)| flicker::error([&old[0], &films[0]], [&old[1], &films[1]]));
        flickers.extend(change);
        errors.push(c.rms * c.rms);
        peak = peak.max(c.peak);
        differ |= !c.within(arguments.tolerance);
        decibels.push((c.peak, change));
        frames.push(Figures {
            frame: number,
            psnr_db: Some(c.psnr_db).filter(|v| v.is_finite()),
            ssim: c.ssim,
            rel_mse: c.rel_mse,
            max_abs: c.max_abs,
            flip: arguments.flip.then(|| {
                let [a, b] = [&films[0], &films[1]].map(png::display_rgb8);
                flip::mean(&a, &b, [films[0].width as u32, films[0].height as u32])
            }),
            flicker_psnr_db: None,
        });
        before = Some((number, films));
        bar.inc(1);
    }
    bar.finish_and_clear();
    let decibel = |error: f64| Some(psnr_db(error, peak)).filter(|v| v.is_finite());
    for (figures, (_, change)) in frames.iter_mut().zip(decibels) {
        figures.flicker_psnr_db = change.and_then(decibel);
    }
    let mean = |of: &dyn Fn(&Figures) -> f64| frames.iter().map(of).sum::<f64>() / frames.len() as f64;
    let average = |all: &[f64]| all.iter().sum::<f64>() / all.len().max(1) as f64;
    output.report(&Report {
        psnr_db: decibel(average(&errors)),
        flicker_psnr_db: Some(average(&flickers)).filter(|_| !flickers.is_empty()).and_then(decibel),
        ssim: mean(&|g| g.ssim),
        rel_mse: mean(&|g| g.rel_mse),
        flip: arguments.flip.then(|| mean(&|g| g.flip.unwrap_or_default())),
        max_abs: frames.iter().map(|g| g.max_abs).fold(0.0, f64::max),
        peak,
        left_out,
        differ,
        frames,
    })?;
    Ok(if differ { ExitCode::from(1) } else { ExitCode::SUCCESS })
}
