//! Contact sheets of what is in files.

pub(in crate::app) mod camera;
mod capture;
mod exposure;
mod layers;
mod sequence;
mod shown;
mod slices;
mod subject;
mod volume;

pub use shown::ViewReport;

use crate::app::failure::Failure;
use crate::app::inputs;
use crate::app::outputs::{self, Content as Output};
use crate::app::pictures::DensityScale;
use crate::app::scan::ScanSettings;
use crate::app::sequence::FrameSelection;
use crate::app::transfer::TransferSettings;
use crate::app::up::{self, UpChoice};
use crate::app::use_case::{Report, Status, use_case};
use crate::app::{self, Context};
use crate::error::{Error, Kind, Result};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::sequence::{Frames, Pattern};
use crate::formats::vdb::File;
use crate::formats::{captures, png, protected, registry};
use crate::report::sheet::{Canvas, Sheet};
use crate::scene::up::Up;
use crate::text::{listed, shell_quoted};
use serde::{Deserialize, Serialize};
use shown::{Content, FileSheet, NotShown};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Settings of contact sheets of files: volumes, pictures, captures and sequences, one sheet for each.
///
/// A VDB is shown by a picture of its density, three slices and a histogram; an OpenEXR picture by its layers; a
/// capture by its views and a plan of its cameras; a sequence by its frames. Scales and exposures are chosen so that
/// something can be seen, and are stated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ViewSettings {
    /// OpenVDB and NanoVDB files, scans, pictures (OpenEXR, PNG, JPEG), captures, and patterns or folders of sequences.
    #[serde(with = "crate::app::paths")]
    pub files: Vec<PathBuf>,
    /// PNG to write the sheet to; of several files, the folder to write into; none to write no file.
    #[serde(with = "crate::app::paths")]
    pub output: Option<PathBuf>,
    /// Name of the grid of a VDB to show; none for density, else the only scalar one, else the first.
    pub grid: Option<String>,
    /// Parts of scans that are shown, and where their voxels lie.
    #[serde(flatten)]
    pub scan: ScanSettings,
    /// Longer side of each picture in pixels, from 16 to 2048; none for 320, of views and frames 160.
    pub size: Option<u32>,
    /// Exposure of pictures in stops, from -60 to 60; none to make the 99th percentile white, of volumes for 0.
    pub exposure: Option<f64>,
    /// Extinction per unit of density and length.
    pub density_scale: DensityScale,
    /// Axis that points upwards, of a volume or of a capture's world, which states none: Z.
    pub up: UpChoice,
    /// Frames of a sequence to show; none for 24 of all, evenly.
    pub frames: Option<Frames>,
    /// Transfer function that makes extinctions and colors of densities.
    #[serde(flatten)]
    pub transfer: TransferSettings,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

impl Default for ViewSettings {
    fn default() -> Self {
        Self {
            files: Vec::new(),
            output: None,
            grid: None,
            scan: ScanSettings::default(),
            size: None,
            exposure: None,
            density_scale: DensityScale::Auto,
            up: UpChoice::Auto,
            frames: None,
            transfer: TransferSettings::default(),
            limits: Limits::default(),
        }
    }
}

use_case!(ViewSettings => ViewReport, limits);

impl Report for ViewReport {
    fn status(&self) -> Result<Status> {
        Ok(Status::complete(self.complete()))
    }
}

impl ViewSettings {
    /// Paths that the sheets show, and that of the transfer function.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        self.files.iter().chain(&self.transfer.tf).map(PathBuf::as_path).collect()
    }

    /// Reads, draws and writes. A file that cannot be shown is part of the report, and the others are shown.
    ///
    /// # Errors
    /// If the only file cannot be read or shown, or a sheet cannot be written.
    pub fn run(&self, context: &Context) -> Result<ViewReport> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        self.show(context, &mut |_| Ok(()))
    }

    /// Reads, draws and writes as [`Self::run`] does; without an output each sheet is given to `show` as it is drawn.
    ///
    /// # Errors
    /// Those of [`Self::run`] and of `show`.
    pub(crate) fn show(&self, context: &Context, show: &mut dyn FnMut(&Canvas) -> Result<()>) -> Result<ViewReport> {
        let files = self.files.iter().map(PathBuf::as_path);
        self.scan.check_files(files, FrameSelection(self.frames))?;
        let outputs = self.output.as_deref().map(|path| self.outputs(path)).transpose()?;
        let (mut sheets, mut failed) = (Vec::new(), Vec::new());
        for (i, file) in self.files.iter().enumerate() {
            let drawn = {
                let _stage = context.stage("looking");
                self.sheet(file, context)
            };
            let (sheet, content) = match drawn {
                Ok(drawn) => drawn,
                Err(e) if self.files.len() == 1 || e.kind() == Kind::Cancelled => return Err(e),
                Err(e) => {
                    failed.push(NotShown { input: file.clone(), error: Failure::new(&e.at(file), context) });
                    continue;
                }
            };
            let canvas = sheet.draw();
            let output = outputs.as_ref().map(|paths| paths[i].clone());
            match &output {
                Some(path) => png::write_rgb8(path, canvas.width, canvas.height, &canvas.rgb)?,
                None => show(&canvas)?,
            }
            sheets.push(FileSheet { input: file.clone(), output, size: [canvas.width, canvas.height], content });
        }
        sheets.iter().for_each(|shown| context.failed(shown.content.failed()));
        Ok(ViewReport { sheets, failed })
    }

    /// Opens a volume.
    fn open(&self, path: &Path) -> Result<File> {
        let scan = self.scan.of(app::volume::format_of(path)?);
        app::volume::open(path, &scan, self.limits)
    }

    /// Returns the up axis of a volume: that of the settings, else what the file states, else Z.
    fn up_of(&self, file: &File) -> Up {
        self.up.stated().unwrap_or_else(|| up::of_file(file).axis)
    }

    /// Draws the sheet of a file or a sequence.
    fn sheet(&self, path: &Path, context: &Context) -> Result<(Sheet, Content)> {
        if let Some(pattern) = self.pattern(path)? {
            return sequence::sheet(self, path, &pattern, context);
        }
        if self.frames.is_some() {
            return Err(Error::invalid("⟨frames⟩: this is one file, and no sequence")
                .at(path)
                .hint("leave ⟨frames⟩ out, or name a sequence such as smoke.####.vdb"));
        }
        let format = app::volume::format_of(path)?;
        match format.kind {
            FileKind::Vdb | FileKind::NanoVdb | FileKind::Image(_) => volume::sheet(self, path, context),
            FileKind::Exr | FileKind::DeepExr => layers::sheet(self, path),
            FileKind::Picture(_) => layers::plain(self, path, format.name),
            FileKind::Capture => capture::sheet(self, path),
            FileKind::Mesh(_) | FileKind::Unknown => Err(registry::unread(format, path)),
            FileKind::Usd => Err(Error::unsupported(format!("{} has no sheet", format.phrase)).at(path).hint(format!(
                "render a picture of it: cumulo render {} ⟨views=1⟩ ⟨size=512x512⟩ -o picture.png",
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
        let is_shown = |kind| sequence::shows(kind) && !matches!(kind, FileKind::Image(_));
        let found = FrameSelection::default().of_volumes(path, is_shown)?;
        if found.is_none() && path.is_dir() && !app::volume::is_scan(path) {
            let endings = registry::frame_endings(sequence::shows);
            let endings: Vec<String> = endings.iter().map(|ending| format!(".{ending}")).collect();
            return Err(Error::invalid("the folder holds neither a capture nor a sequence").at(path).hint(format!(
                "a sequence is two numbered files or more, {}; of other files give the names",
                listed(&endings, "or")
            )));
        }
        Ok(found.map(|sequence| sequence.pattern))
    }

    /// Returns the PNGs of the sheets at `path`, once they are known to be possible.
    fn outputs(&self, path: &Path) -> Result<Vec<PathBuf>> {
        let paths = match &self.files[..] {
            [_] if !path.is_dir() => {
                outputs::file(path, Output::Png)?;
                vec![path.to_path_buf()]
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
        Ok(paths)
    }

    /// Longer side of each of `count` pictures in pixels: that of the settings, else `usual`.
    ///
    /// # Errors
    /// If so many pictures do not fit in memory.
    fn side(&self, usual: usize, count: usize) -> Result<usize> {
        let side = self.size.map_or(usual, |side| side as usize);
        // Floating-point pixels, their levels, and those of the sheet.
        let bytes = (count * side * side * (size_of::<[f32; 4]>() + 8)) as u64;
        if bytes > self.limits.max_memory {
            return Err(Error::unsupported(format!("{count} pictures of {side} pixels do not fit in memory"))
                .hint("give a smaller ⟨size⟩, or raise ⟨max_memory⟩"));
        }
        Ok(side)
    }
}

/// Name of a file for a heading.
fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}
