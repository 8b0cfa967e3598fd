//! `cumulo compare`: how far apart two pictures, or two sequences, are.

mod figures;
mod frames;
mod page;
mod space;
mod statistical;
mod traits;

use crate::app::outputs::{self, Content};
use crate::app::sequence::FrameSelection;
use crate::cli::memory::Memory;
use crate::cli::output::Output;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::sequence::Pattern;
use crate::formats::{exr, png};
use crate::metrics::{self, Comparison, flip, heatmap};
use crate::text::printable;
use schemars::JsonSchema;
use serde::Serialize;
use space::Space;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use traits::Matched;

/// Compare two EXR pictures, or two sequences of them
///
/// Exit code 0 if they agree, 1 if they differ, 2 if they cannot be compared. Figures are of the colors in
/// scene-linear values unless --display is given; psnr_db refers to white, or to the second picture's peak if that is
/// brighter. Colors of other primaries (the attribute chromaticities) are converted to those of the second picture;
/// another pixel aspect or display window is a difference. Of sequences,
/// 'a.####.exr' or a folder of numbered files, frames of equal number are compared; flicker_psnr_db is of the changes
/// from frame to frame.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Picture to compare
    a: PathBuf,
    /// Reference picture
    b: PathBuf,
    #[command(flatten)]
    frames: FrameSelection,
    /// Layer of both files (default: the beauty)
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Largest absolute difference that still counts as agreement
    #[arg(long, value_name = "T", default_value_t = 0.0)]
    tolerance: f64,
    /// Write the absolute difference of each pixel as a PNG in false colors
    #[arg(long, value_name = "OUT.png")]
    heatmap: Option<PathBuf>,
    /// Write a page with plots over the frames of two sequences, and both as a moving picture with their differences
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Another sequence to compare with the second and to show in the report, such as the noisy one
    #[arg(long, value_name = "C.####.exr")]
    beside: Option<PathBuf>,
    /// Compare display values (sRGB, clipped to 0..1) instead of scene-linear ones
    #[arg(long)]
    display: bool,
    /// Compute FLIP, too, a difference as people see it (0 to 1), of display values
    #[arg(long)]
    flip: bool,
    #[command(flatten)]
    statistical: statistical::Options,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

/// Extensions of the files that a folder's sequence consists of.
const ENDINGS: [&str; 1] = ["exr"];

impl Arguments {
    /// Paths that the command reads.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        let repeats = self.statistical.repeats();
        [&self.a, &self.b].into_iter().chain(&self.beside).chain(repeats).map(PathBuf::as_path).collect()
    }

    fn space(&self) -> Space {
        if self.display { Space::Display } else { Space::Linear }
    }

    /// Returns the bytes of each film.
    ///
    /// # Errors
    /// If a picture cannot be read, or both films and the working memory of their comparison exceed the limits.
    fn check_memory(&self, paths: [&Path; 2], limits: Limits) -> Result<[u64; 2]> {
        let (mut films, mut working) = ([0; 2], 0);
        for (film, path) in films.iter_mut().zip(paths) {
            let [width, height] = exr::header(path)?.display_window.size;
            *film = 16 * (width as u64).saturating_mul(height as u64);
            let flip = if self.flip { *film / 16 * flip::PIXEL_BYTES } else { 0 };
            // Display values are copies of both pictures.
            let copies = if self.display { 2 * *film } else { 0 };
            working = working.max(metrics::working_memory(width, height).saturating_add(flip).saturating_add(copies));
        }
        let needed = films[0].saturating_add(films[1]).saturating_add(working);
        if needed <= limits.max_memory {
            return Ok(films);
        }
        let mib = |bytes: u64| bytes.div_ceil(1 << 20);
        Err(Error::unsupported(format!(
            "comparing them needs {} MiB, {} MiB are allowed",
            mib(needed),
            mib(limits.max_memory)
        ))
        .part(format!("{} and {}", paths[0].display(), paths[1].display()))
        .hint("raise --max-memory, or compare smaller pictures"))
    }
}

/// Report of two pictures, of two sequences, or of the expected values of two pictures.
#[derive(JsonSchema)]
#[serde(untagged)]
#[allow(dead_code, reason = "it describes documents, and none is made of it")]
pub(in crate::cli) enum AnyReport {
    Pictures(Report),
    Sequences(figures::Report),
    Statistical(statistical::Report),
}

#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct Report {
    #[serde(flatten)]
    comparison: Comparison,
    layers: [String; 2],
    differ: bool,
    /// Differences between the pictures beside their samples, in words.
    differences: Vec<String>,
    /// Conversion of the first picture's colors to the primaries of the second.
    #[serde(skip_serializing_if = "Option::is_none")]
    converted: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    flip: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    heatmap_scale: Option<f64>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let c = &self.comparison;
        writeln!(f, "size      {} x {}", c.size[0], c.size[1])?;
        if self.layers.iter().any(|l| !l.is_empty()) {
            writeln!(f, "layers    '{}' and '{}'", printable(&self.layers[0]), printable(&self.layers[1]))?;
        }
        writeln!(f, "psnr_db   {:.4} (peak {})", c.psnr_db, c.peak)?;
        writeln!(f, "ssim      {:.6}", c.ssim)?;
        writeln!(f, "rel_mse   {:.6e}", c.rel_mse)?;
        writeln!(f, "max_abs   {:.6e}", c.max_abs)?;
        writeln!(f, "rms       {:.6e}", c.rms)?;
        writeln!(f, "alpha     {:.6e} (largest difference)", c.alpha_max_abs)?;
        if let Some(flip) = self.flip {
            writeln!(f, "flip      {flip:.6}")?;
        }
        if c.non_finite_pixels > 0 {
            writeln!(
                f,
                "left out  {} pixels with NaN or infinite samples, {} of them different",
                c.non_finite_pixels, c.non_finite_differences
            )?;
        }
        if let Some(scale) = self.heatmap_scale {
            writeln!(f, "heatmap   brightest at {scale:.6e}")?;
        }
        if let Some(converted) = &self.converted {
            writeln!(f, "converted {converted}")?;
        }
        f.write_str(&traits::verdict("pictures", &self.differences))
    }
}

/// Runs the command.
///
/// # Errors
/// If a picture cannot be read, the sizes differ, more memory is needed than is allowed, or the heat map
/// cannot be written.
pub fn run(arguments: &Arguments, output: &Output) -> Result<ExitCode> {
    let stage = output.stage("comparing");
    if arguments.tolerance.is_nan() || arguments.tolerance < 0.0 {
        return Err(Error::invalid(format!("--tolerance {}: a number from 0 on is expected", arguments.tolerance))
            .hint("give the largest absolute difference of a sample that still counts as agreement"));
    }
    if arguments.statistical.asked() {
        drop(stage);
        if [&arguments.a, &arguments.b].into_iter().any(|path| path.is_dir() || Pattern::parse(path).is_some()) {
            return Err(Error::invalid("--statistical: a sequence is given, and it tests two pictures")
                .hint("test frames of it one by one"));
        }
        return statistical::run(arguments, output);
    }
    if let Some([a, b]) = &arguments.frames.pair([&arguments.a, &arguments.b], &ENDINGS)? {
        drop(stage);
        return frames::run(arguments, [a, b], output);
    }
    for (option, given) in [("--report", &arguments.report), ("--beside", &arguments.beside)] {
        if given.is_some() {
            return Err(Error::invalid(format!("{option} is for sequences, and these are two pictures")).hint(
                "give sequences, 'a.####.exr' and 'b.####.exr', or --heatmap for the difference of two pictures",
            ));
        }
    }
    if let Some(path) = &arguments.heatmap {
        outputs::file(path, Content::Png)?;
    }
    let limits = arguments.memory.limits();
    let films = arguments.check_memory([&arguments.a, &arguments.b], limits)?;
    let (reference, layer) = (exr::header(&arguments.b)?, arguments.layer.as_deref());
    let a = Matched::read(&arguments.a, &reference, layer, limits)?;
    let rest = Limits { max_memory: limits.max_memory.saturating_sub(films[0]) };
    let b = Matched::read(&arguments.b, &reference, layer, rest)?;
    let shown = [&a.film, &b.film].map(|film| arguments.space().of(film));
    let comparison = metrics::compare(&shown[0], &shown[1])
        .map_err(|e| e.part(format!("{} and {}", arguments.a.display(), arguments.b.display())))?;
    let mut heatmap_scale = None;
    if let Some(path) = &arguments.heatmap {
        let (rgb, scale) = heatmap::difference_rgb8(&shown[0], &shown[1]);
        png::write_rgb8(path, a.film.width, a.film.height, &rgb)?;
        heatmap_scale = Some(scale);
    }
    let flip = arguments.flip.then(|| space::flip([&a.film, &b.film]));
    let differences = [traits::of_samples(&comparison, arguments.tolerance), a.differences].concat();
    let (differ, layers) = (!differences.is_empty(), [a.layer, b.layer]);
    drop(stage);
    output.report(&Report { comparison, layers, differ, differences, converted: a.converted, flip, heatmap_scale })?;
    Ok(if differ { ExitCode::from(1) } else { ExitCode::SUCCESS })
}
