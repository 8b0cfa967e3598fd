//! Comparison of two sequences.

use super::Arguments;
use super::page::Gallery;
use crate::cli::output::Output;
use crate::cli::provenance::Provenance;
use crate::cli::report;
use crate::error::{Error, Result};
use crate::formats::sequence::Pattern;
use crate::formats::{exr, png};
use crate::metrics::error::psnr_db;
use crate::metrics::{self, Comparison, flicker, flip};
use crate::scene::film::Film;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;
use std::process::ExitCode;

/// Figures of a frame.
#[derive(Debug, Clone, Serialize)]
pub struct Figures {
    pub frame: u32,
    /// `null` for identical colors.
    pub psnr_db: Option<f64>,
    pub ssim: f64,
    pub rel_mse: f64,
    pub max_abs: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flip: Option<f64>,
    /// PSNR of the change from the frame before; `null` for the first, and without any error.
    pub flicker_psnr_db: Option<f64>,
}

/// Figures of a sequence against its reference.
#[derive(Debug, Serialize)]
pub struct Track {
    pub frames: Vec<Figures>,
    /// Of the mean squared error over all frames, for the largest peak.
    pub psnr_db: Option<f64>,
    /// Of the mean squared error of the changes from frame to frame.
    pub flicker_psnr_db: Option<f64>,
    /// Means over the frames.
    pub ssim: f64,
    pub rel_mse: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flip: Option<f64>,
    pub max_abs: f64,
    pub peak: f64,
}

#[derive(Debug, Serialize)]
pub struct Report {
    #[serde(flatten)]
    pub all: Track,
    /// The sequence of `--beside` against the same reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beside: Option<Track>,
    /// Frames that not all of the sequences have.
    left_out: Vec<u32>,
    differ: bool,
    #[serde(skip_serializing_if = "Option::is_none", serialize_with = "crate::cli::paths::text")]
    report: Option<PathBuf>,
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

impl fmt::Display for Track {
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
        writeln!(f, "     all {psnr:>8} {:8.5} {:10.3e} {flicker:>16}{}", self.ssim, self.rel_mse, end(self.flip))
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.all)?;
        if let Some(beside) = &self.beside {
            write!(f, "beside\n{beside}")?;
        }
        if !self.left_out.is_empty() {
            writeln!(f, "left out  {} frames that not all of the sequences have", self.left_out.len())?;
        }
        if let Some(report) = &self.report {
            writeln!(f, "report    {}", report.display())?;
        }
        write!(f, "{}", if self.differ { "the sequences differ" } else { "the sequences agree" })
    }
}

/// Comparison of a sequence with its reference, frame by frame.
#[derive(Debug, Default)]
struct Gauge {
    frames: Vec<Figures>,
    errors: Vec<f64>,
    /// Of the change to each frame, where the one before is there.
    changes: Vec<Option<f64>>,
    peak: f64,
    before: Option<(u32, [Film; 2])>,
}

impl Gauge {
    /// Compares the next frame.
    fn add(&mut self, number: u32, films: [&Film; 2], with_flip: bool) -> Result<Comparison> {
        let c = metrics::compare(films[0], films[1])?;
        let follows = self.before.as_ref().filter(|(last, old)| last + 1 == number && old[0].width == films[0].width);
        self.changes.push(follows.map(|(_, old)| flicker::error([&old[0], films[0]], [&old[1], films[1]])));
        self.errors.push(c.rms * c.rms);
        self.peak = self.peak.max(c.peak);
        self.frames.push(Figures {
            frame: number,
            psnr_db: Some(c.psnr_db).filter(|v| v.is_finite()),
            ssim: c.ssim,
            rel_mse: c.rel_mse,
            max_abs: c.max_abs,
            flip: with_flip.then(|| {
                let [a, b] = films.map(png::display_rgb8);
                flip::mean(&a, &b, [films[0].width as u32, films[0].height as u32])
            }),
            flicker_psnr_db: None,
        });
        self.before = Some((number, films.map(Film::clone)));
        Ok(c)
    }

    /// Closes with the figures over all frames.
    fn closed(self) -> Track {
        let Self { mut frames, errors, changes, peak, .. } = self;
        let decibel = |error: f64| Some(psnr_db(error, peak)).filter(|v| v.is_finite());
        for (figures, change) in frames.iter_mut().zip(&changes) {
            figures.flicker_psnr_db = change.and_then(decibel);
        }
        let average = |all: &[f64]| all.iter().sum::<f64>() / all.len().max(1) as f64;
        let mean = |of: &dyn Fn(&Figures) -> f64| average(&frames.iter().map(of).collect::<Vec<_>>());
        let flickers: Vec<f64> = changes.into_iter().flatten().collect();
        Track {
            psnr_db: decibel(average(&errors)),
            flicker_psnr_db: Some(average(&flickers)).filter(|_| !flickers.is_empty()).and_then(decibel),
            ssim: mean(&|g| g.ssim),
            rel_mse: mean(&|g| g.rel_mse),
            flip: frames.iter().any(|g| g.flip.is_some()).then(|| mean(&|g| g.flip.unwrap_or_default())),
            max_abs: frames.iter().map(|g| g.max_abs).fold(0.0, f64::max),
            peak,
            frames,
        }
    }
}

/// Compares two sequences frame by frame.
///
/// # Errors
/// If they have no frame in common, a frame cannot be read or compared, or the report cannot be written.
pub fn run(arguments: &Arguments, [a, b]: [&Pattern; 2], output: &Output) -> Result<ExitCode> {
    if arguments.heatmap.is_some() {
        return Err(Error::invalid("--heatmap: a sequence has many differences")
            .hint("compare one frame of it, or show them all with --report"));
    }
    let provenance = Provenance::begin();
    let beside = arguments.beside.as_ref().map(|path| {
        Pattern::parse(path).ok_or_else(|| {
            Error::invalid("--beside: this names no sequence").at(path).hint("give a name such as 'noisy.####.exr'")
        })
    });
    let beside = beside.transpose()?;
    let patterns: Vec<&Pattern> = beside.iter().chain([a, b]).collect();
    let numbers = patterns.iter().map(|pattern| pattern.numbers()).collect::<Result<Vec<_>>>()?;
    let mut union: Vec<u32> = numbers.concat();
    union.sort_unstable();
    union.dedup();
    let (both, left_out): (Vec<u32>, Vec<u32>) =
        union.into_iter().partition(|number| numbers.iter().all(|list| list.binary_search(number).is_ok()));
    if both.is_empty() {
        return Err(Error::invalid("the sequences have no frame in common")
            .at(&arguments.a)
            .hint("frames are matched by their numbers"));
    }
    if let Some(dir) = &arguments.report {
        report::prepare(dir)?;
    }
    let bar = output.progress(both.len() as u64, "compare");
    let (mut first, mut other, mut gallery) = (Gauge::default(), Gauge::default(), Gallery::new(both.len()));
    let mut differ = false;
    for (at, number) in both.into_iter().enumerate() {
        let paths: Vec<PathBuf> = patterns.iter().map(|pattern| pattern.path(number)).collect();
        let films = films(arguments, &paths)?;
        let films: Vec<&Film> = films.iter().collect();
        let reference = films.len() - 1;
        let add = |gauge: &mut Gauge, which: usize| {
            let named = |e: Error| e.part(format!("{} and {}", paths[which].display(), paths[reference].display()));
            gauge.add(number, [films[which], films[reference]], arguments.flip).map_err(named)
        };
        if reference == 2 {
            add(&mut other, 0)?;
        }
        let c = add(&mut first, reference - 1)?;
        differ |= !c.within(arguments.tolerance);
        if arguments.report.is_some() {
            gallery.add(at, number, &films, c.psnr_db);
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let beside = beside.map(|_| other.closed());
    let mut report = Report { all: first.closed(), beside, left_out, differ, report: None };
    if let Some(dir) = &arguments.report {
        let mut page = gallery.page([&arguments.a, &arguments.b], arguments.beside.as_deref(), &report)?;
        page.provenance(&provenance.rows());
        report.report = Some(page.write(dir)?);
    }
    output.report(&report)?;
    Ok(if differ { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

/// Reads the pictures of a frame, of which the last is the reference.
fn films(arguments: &Arguments, paths: &[PathBuf]) -> Result<Vec<Film>> {
    let limits = arguments.memory.limits();
    let [.., reference] = paths else { return Ok(Vec::new()) };
    for path in &paths[..paths.len() - 1] {
        super::check_memory([path, reference], arguments.flip, limits)?;
    }
    let layer = arguments.layer.as_deref();
    paths.iter().map(|path| Ok(exr::picture_within(path, layer, limits)?.film)).collect()
}
