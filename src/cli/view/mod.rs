//! `cumulo view`: contact sheets of what is in files.

mod camera;
mod capture;
mod exposure;
mod layers;
mod sequence;
mod shown;
mod slices;
mod subject;
mod terminal;
mod volume;

use super::memory::Memory;
use super::output::Output;
use super::parse;
use crate::app::failure::Failure;
use crate::app::outputs::{self, Content as Kind};
use crate::app::pictures::DensityScale;
use crate::app::sequence::FrameSelection;
use crate::app::transfer::TransferSettings;
use crate::app::up::{self, UpChoice};
use crate::error::{Error, Kind as ErrorKind, Result};
use crate::formats::sequence::{Frames, Pattern};
use crate::formats::vdb::File;
use crate::formats::{self, Format, captures, picture, png, protected};
use crate::report::sheet::Sheet;
use crate::scene::up::Up;
use crate::text::shell_quoted;
pub(in crate::cli) use shown::Report;
use shown::{Content, NotShown, Shown};
use std::collections::BTreeSet;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use terminal::Graphics;

/// Look at files: volumes, pictures, captures and sequences, each as one contact sheet
///
/// A VDB is shown by a picture of its density, three slices and a histogram; an OpenEXR picture by its layers; a
/// capture by its views and a plan of its cameras; a sequence by its frames. Scales and exposures are chosen so that
/// something can be seen, and are stated. A file that cannot be shown is named, and the others are shown.
#[derive(Debug, clap::Args)]
pub struct View {
    /// OpenVDB files, pictures (OpenEXR, PNG, JPEG), captures, and sequences such as smoke.####.vdb, view.%04d.exr or
    /// the folder of one
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Write the sheet to this PNG; of several files, into this folder (default: show it in the terminal)
    #[arg(long, short, value_name = "PNG|DIR")]
    output: Option<PathBuf>,
    /// How pictures are drawn in the terminal (default: by the environment; blocks where it tells nothing)
    #[arg(long, value_enum, value_name = "HOW", conflicts_with = "output")]
    terminal: Option<Graphics>,
    /// Grid of a VDB to show (default: density, else the only scalar one, else the first)
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    /// Longer side of each picture in pixels (default: 320; of views and frames 160)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(16..=2048))]
    size: Option<u32>,
    /// Exposure of pictures in stops (default: the 99th percentile becomes white; of volumes 0)
    #[arg(long, value_name = "EV", value_parser = parse::exposure, allow_negative_numbers = true)]
    exposure: Option<f64>,
    /// Extinction per unit of density and length; auto makes the 99th percentile of the optical depth 3
    #[arg(long, value_name = "S|auto", default_value = "auto")]
    density_scale: DensityScale,
    /// Axis that points upwards, of a volume or of a capture's world (which states none: z)
    #[arg(long, value_enum, value_name = "AXIS", default_value_t = UpChoice::Auto)]
    up: UpChoice,
    /// Frames of a sequence to show: A, A-B or A-BxSTEP (default: 24 of all, evenly)
    #[arg(long, value_name = "A-B")]
    frames: Option<Frames>,
    #[command(flatten)]
    transfer: TransferSettings,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

/// Extensions of the files that a folder's sequence consists of.
const ENDINGS: [&str; 3] = ["vdb", "nvdb", "exr"];

/// Where sheets go.
enum Destination {
    Files(Vec<PathBuf>),
    Terminal(Graphics),
}

impl View {
    /// Paths that the command reads.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        self.files.iter().chain(&self.transfer.tf).map(PathBuf::as_path).collect()
    }

    /// Reads, draws, writes or shows, and reports.
    ///
    /// # Errors
    /// If the only file cannot be read or shown, a sheet cannot be written, or there is neither a terminal nor an
    /// output.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        let destination = self.destination(output)?;
        let (mut sheets, mut failed) = (Vec::new(), Vec::new());
        for (i, file) in self.files.iter().enumerate() {
            let drawn = {
                let _stage = output.stage("looking");
                self.sheet(file)
            };
            let (sheet, content) = match drawn {
                Ok(drawn) => drawn,
                Err(e) if self.files.len() == 1 || e.kind() == ErrorKind::Cancelled => return Err(e),
                Err(e) => {
                    failed.push(NotShown { input: file.clone(), error: Failure::new(&e.at(file), output) });
                    continue;
                }
            };
            let canvas = sheet.draw();
            let written = match &destination {
                Destination::Files(paths) => {
                    png::write_rgb8(&paths[i], canvas.width, canvas.height, &canvas.rgb)?;
                    Some(paths[i].clone())
                }
                Destination::Terminal(graphics) => {
                    terminal::show(&canvas, *graphics)?;
                    None
                }
            };
            let size = [canvas.width, canvas.height];
            sheets.push(Shown { input: file.clone(), output: written, size, content });
        }
        sheets.iter().for_each(|shown| output.failed(shown.content.failed()));
        let whole = failed.is_empty() && sheets.iter().all(|shown| shown.content.failed().is_empty());
        output.report(&Report { sheets, failed })?;
        Ok(if whole { ExitCode::SUCCESS } else { ExitCode::from(2) })
    }

    /// Returns the up axis of a volume: that of `--up`, else what the file states, else Z.
    fn up_of(&self, file: &File) -> Up {
        self.up.stated().unwrap_or_else(|| up::of_file(file).axis)
    }

    /// Draws the sheet of a file or a sequence.
    fn sheet(&self, path: &Path) -> Result<(Sheet, Content)> {
        let limits = self.memory.limits();
        if let Some(pattern) = self.pattern(path)? {
            return sequence::sheet(self, path, &pattern, limits);
        }
        if self.frames.is_some() {
            return Err(Error::invalid("--frames: this is one file, and no sequence")
                .at(path)
                .hint("leave --frames out, or name a sequence such as smoke.####.vdb"));
        }
        match formats::sniff(path)? {
            Format::Vdb | Format::NanoVdb => volume::sheet(self, path, limits),
            Format::Exr => layers::sheet(self, path, limits),
            Format::Capture => capture::sheet(self, path, limits),
            Format::Unknown if picture::kind(path).is_ok() => layers::plain(self, path, limits),
            Format::Unknown => Err(formats::unknown(path)),
            other => Err(Error::unsupported(format!("{} has no sheet", other.name())).at(path).hint(format!(
                "render a picture of it: cumulo render {} --views 1 --size 512x512 -o picture.png",
                shell_quoted(&path.to_string_lossy())
            ))),
        }
    }

    /// Returns the names of the sequence that a path stands for: a pattern, or a folder that is no capture; none for a
    /// file.
    ///
    /// # Errors
    /// If a folder holds several sequences, or neither a sequence nor a capture.
    fn pattern(&self, path: &Path) -> Result<Option<Pattern>> {
        if path.is_dir() && captures::file(path).exists() {
            return Ok(None);
        }
        let found = FrameSelection::default().sequence(path, &ENDINGS)?;
        if found.is_none() && path.is_dir() {
            return Err(Error::invalid("the folder holds neither a capture nor a sequence")
                .at(path)
                .hint("a sequence is two numbered files or more, .vdb or .exr; of other files give the names"));
        }
        Ok(found.map(|sequence| sequence.pattern))
    }

    /// Returns where sheets go, once that is known to be possible.
    fn destination(&self, output: &Output) -> Result<Destination> {
        let Some(path) = &self.output else {
            if output.is_json() {
                return Err(Error::invalid("--json: standard output cannot hold the report and the pictures")
                    .hint("give -o OUT.png for the pictures"));
            }
            if self.terminal.is_none() && !std::io::stdout().is_terminal() {
                return Err(Error::invalid("standard output is no terminal: nothing can be shown there")
                    .hint("give -o OUT.png, or choose how to draw all the same with --terminal"));
            }
            let graphics = self.terminal.unwrap_or_else(|| Graphics::detected(|name| std::env::var(name).ok()));
            return Ok(Destination::Terminal(graphics));
        };
        let paths = match &self.files[..] {
            [_] if !path.is_dir() => {
                outputs::file(path, Kind::Png)?;
                vec![path.clone()]
            }
            files => {
                outputs::folder(path)?;
                let names: Vec<String> = files.iter().map(|file| name_of(file)).collect();
                if names.iter().collect::<BTreeSet<_>>().len() < names.len() {
                    return Err(Error::invalid("several files have one name, and so would their sheets")
                        .at(path)
                        .hint("view them one by one, each with an output of its own"));
                }
                std::fs::create_dir_all(path).map_err(|e| Error::io(path, e))?;
                names.iter().map(|name| path.join(format!("{name}.png"))).collect()
            }
        };
        paths.iter().try_for_each(|path| protected::check(path))?;
        Ok(Destination::Files(paths))
    }

    /// Longer side of each of `count` pictures in pixels: that of the options, else `usual`.
    ///
    /// # Errors
    /// If so many pictures do not fit in memory.
    fn side(&self, usual: usize, count: usize) -> Result<usize> {
        let side = self.size.map_or(usual, |side| side as usize);
        // Floating-point pixels, their levels, and those of the sheet.
        let bytes = (count * side * side * (size_of::<[f32; 4]>() + 8)) as u64;
        if bytes > self.memory.limits().max_memory {
            return Err(Error::unsupported(format!("{count} pictures of {side} pixels do not fit in memory"))
                .hint("give a smaller --size, or raise --max-memory"));
        }
        Ok(side)
    }
}

/// Name of a file for a heading.
fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}
