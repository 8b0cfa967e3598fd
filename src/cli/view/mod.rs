//! `cumulo view`: contact sheets of what is in files.

mod terminal;

use super::args::read_as;
use super::memory::Memory;
use super::output::Output;
use super::parse;
use super::run::{Run, told};
use crate::app::pictures::DensityScale;
use crate::app::scan::ScanSettings;
use crate::app::transfer::TransferSettings;
use crate::app::up::UpChoice;
use crate::app::view::ViewSettings;
use crate::error::{Error, Result};
use crate::formats::sequence::Frames;
use std::io::IsTerminal;
use std::path::PathBuf;
use terminal::Graphics;

/// Look at files: volumes, pictures, captures and sequences, each as one contact sheet
///
/// A VDB, a NanoVDB or a scan is shown by a picture of its density, three slices and a histogram; an OpenEXR picture by
/// its layers; a capture by its views and a plan of its cameras; a sequence by its frames. Scales and exposures are
/// chosen so that something can be seen, and are stated. A file that cannot be shown is named, and the others are
/// shown.
#[derive(Debug, clap::Args)]
struct ViewArgs {
    /// OpenVDB and NanoVDB files, scans, pictures (OpenEXR, PNG, JPEG), captures, and sequences such as smoke.####.vdb,
    /// view.%04d.exr or the folder of one
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
    #[command(flatten)]
    scan: ScanSettings,
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
    memory: Memory,
}

/// Settings of the sheets, and how they are drawn in the terminal.
#[derive(Debug)]
pub(crate) struct View {
    pub(super) settings: ViewSettings,
    terminal: Option<Graphics>,
}

impl From<ViewArgs> for View {
    fn from(args: ViewArgs) -> Self {
        let settings = ViewSettings {
            files: args.files,
            output: args.output,
            grid: args.grid,
            scan: args.scan,
            size: args.size,
            exposure: args.exposure,
            density_scale: args.density_scale,
            up: args.up,
            frames: args.frames,
            transfer: args.transfer,
            limits: args.memory.limits(),
        };
        Self { settings, terminal: args.terminal }
    }
}

read_as!(View, ViewArgs);

impl Run for View {
    fn max_memory(&self) -> Result<u64> {
        Run::max_memory(&self.settings)
    }

    fn widen(&mut self, room: u64) {
        self.settings.widen(room);
    }

    /// Writes the sheets or shows them, and reports.
    fn run(&self, output: &Output) -> Result<u8> {
        if self.settings.output.is_some() {
            return Run::run(&self.settings, output);
        }
        let graphics = self.graphics(output)?;
        told(&self.settings.show(output, &mut |canvas| terminal::show(canvas, graphics))?, output)
    }
}

impl View {
    /// Returns how the terminal draws pictures.
    fn graphics(&self, output: &Output) -> Result<Graphics> {
        if output.is_json() {
            return Err(Error::invalid("--json: standard output cannot hold the report and the pictures")
                .hint("give -o OUT.png for the pictures"));
        }
        if self.terminal.is_none() && !std::io::stdout().is_terminal() {
            return Err(Error::invalid("standard output is no terminal: nothing can be shown there")
                .hint("give -o OUT.png, or choose how to draw all the same with --terminal"));
        }
        Ok(self.terminal.unwrap_or_else(|| Graphics::detected(|name| std::env::var(name).ok())))
    }
}
