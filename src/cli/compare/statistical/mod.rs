//! Comparison of two noisy pictures by tests of their expected values.

mod report;
mod side;

use super::{Arguments, traits};
use crate::app::outputs::{self, Content};
use crate::cli::output::Output;
use crate::error::{Error, Result};
use crate::formats::{exr, png};
use crate::metrics::heatmap;
use crate::metrics::statistical::{self, Estimate, PIXEL_BYTES, Question};
use crate::scene::film::Film;
pub(in crate::cli) use report::Report;
use side::{Read, Side};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Options of the statistical comparison.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Test whether two noisy pictures have the same expected values, within --tolerance: pixel by pixel, in tiles, in
    /// the mean, and by the spread of the differences. The noise is known from --repeat-a and --repeat-b, else from the
    /// layer 'variance', else from the layers 'half_a' and 'half_b' (cumulo render --aov variance,halves)
    #[arg(long, conflicts_with_all = ["display", "flip", "report", "beside"])]
    statistical: bool,
    /// Another render of A by another seed (repeatable)
    #[arg(long, value_name = "A2.exr", requires = "statistical")]
    repeat_a: Vec<PathBuf>,
    /// Another render of B by another seed (repeatable)
    #[arg(long, value_name = "B2.exr", requires = "statistical")]
    repeat_b: Vec<PathBuf>,
    /// Take a picture for free of noise, such as a closed form (repeatable)
    #[arg(long, value_enum, value_name = "SIDE", requires = "statistical")]
    noiseless: Vec<Which>,
    /// Layer with the variance of each pixel's mean (default: 'variance')
    #[arg(long, value_name = "NAME", requires = "statistical")]
    variance_layer: Option<String>,
    /// Probability with which pictures of equal expected values may be called different (default: 0.001)
    #[arg(long, value_name = "P", requires = "statistical")]
    false_alarm: Option<f64>,
    /// Edge of a tile in pixels (default: 16)
    #[arg(long, value_name = "N", requires = "statistical", value_parser = clap::value_parser!(u32).range(1..))]
    tile: Option<u32>,
}

/// One of the two pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Which {
    /// The first picture.
    A,
    /// The second picture.
    B,
}

impl Options {
    /// True if the statistical comparison is asked for.
    pub fn asked(&self) -> bool {
        self.statistical
    }

    /// Returns the paths of the further renders.
    pub fn repeats(&self) -> impl Iterator<Item = &PathBuf> {
        self.repeat_a.iter().chain(&self.repeat_b)
    }

    fn question(&self, tolerance: f64) -> Result<Question> {
        let false_alarm = self.false_alarm.unwrap_or(1e-3);
        if !(false_alarm > 0.0 && false_alarm < 1.0) {
            return Err(Error::invalid(format!("--false-alarm {false_alarm}: a number between 0 and 1 is expected"))
                .hint("0.001 lets one of a thousand comparisons of equal scenes fail"));
        }
        Ok(Question { false_alarm, tolerance, tile: self.tile.unwrap_or(16) as usize })
    }
}

impl Arguments {
    fn side(&self, which: Which) -> Result<Side<'_>> {
        let options = &self.statistical;
        let (name, picture, repeats) = match which {
            Which::A => ("a", &self.a, &options.repeat_a),
            Which::B => ("b", &self.b, &options.repeat_b),
        };
        let noiseless = options.noiseless.contains(&which);
        if noiseless && !repeats.is_empty() {
            return Err(Error::invalid(format!("--noiseless {name} and --repeat-{name} contradict each other"))
                .hint("renders of several seeds tell the noise; leave one of the two out"));
        }
        let layer = self.layer.as_deref();
        let variance_layer = options.variance_layer.as_deref();
        Ok(Side { name, picture, repeats, noiseless, layer, variance_layer })
    }

    /// Refuses pictures whose samples do not mean the same.
    fn check_headers(&self) -> Result<()> {
        let [a, b] = [exr::header(&self.a)?, exr::header(&self.b)?];
        let mut differences = traits::of_headers(&a, &b);
        if !a.primaries().is_same(&b.primaries()) {
            differences.push(format!("primaries {} and {}", a.primaries(), b.primaries()));
        }
        if differences.is_empty() {
            return Ok(());
        }
        Err(Error::invalid(format!("the pictures differ in their headers: {}", differences.join("; ")))
            .part(format!("{} and {}", self.a.display(), self.b.display()))
            .hint("render both with the same camera and in the same color space"))
    }

    fn check_statistical_memory(&self) -> Result<()> {
        let pixels = |path: &Path| Ok(exr::header(path)?.display_window.pixels());
        let needed = pixels(&self.a)?.max(pixels(&self.b)?).saturating_mul(PIXEL_BYTES);
        let allowed = self.memory.limits().max_memory;
        if needed <= allowed {
            return Ok(());
        }
        let mib = |bytes: u64| bytes.div_ceil(1 << 20);
        Err(Error::unsupported(format!("testing them needs {} MiB, {} MiB are allowed", mib(needed), mib(allowed)))
            .part(format!("{} and {}", self.a.display(), self.b.display()))
            .hint("raise --max-memory, or compare smaller pictures"))
    }
}

/// Runs the statistical comparison of two pictures.
///
/// # Errors
/// If a picture cannot be read, the noise of a side is not known, the sizes differ, more memory is needed than is
/// allowed, or the heat map cannot be written.
pub fn run(arguments: &Arguments, output: &Output) -> Result<ExitCode> {
    let stage = output.stage("testing");
    let question = arguments.statistical.question(arguments.tolerance)?;
    let sides = [arguments.side(Which::A)?, arguments.side(Which::B)?];
    if let Some(path) = &arguments.heatmap {
        outputs::file(path, Content::Png)?;
    }
    arguments.check_statistical_memory()?;
    arguments.check_headers()?;
    let limits = arguments.memory.limits();
    let [a, b] = sides.each_ref().map(|side| side.read(limits));
    let (a, b): (Read, Read) = (a?, b?);
    let named = |e: Error| e.part(format!("{} and {}", arguments.a.display(), arguments.b.display()));
    let verdict = statistical::test(&a.estimate, &b.estimate, question).map_err(named)?;
    let mut heatmap_scale = None;
    if let Some(path) = &arguments.heatmap {
        let [left, right] = [&a.estimate, &b.estimate].map(film);
        let (rgb, scale) = heatmap::difference_rgb8(&left, &right);
        png::write_rgb8(path, left.width, left.height, &rgb)?;
        heatmap_scale = Some(scale);
    }
    let differ = verdict.differ;
    drop(stage);
    output.report(&Report::new(verdict, [a.noise, b.noise], heatmap_scale))?;
    Ok(if differ { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

/// Film of the means.
fn film(estimate: &Estimate) -> Film {
    Film::of(estimate.width, estimate.height, estimate.mean.clone())
}
