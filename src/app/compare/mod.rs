//! How far apart two pictures, or two sequences of them, are.

mod figures;
mod frames;
mod page;
mod pictures;
mod space;
mod statistical;
mod traits;

pub use figures::SequencesReport;
pub use pictures::PicturesReport;
pub use statistical::{StatisticalReport, StatisticalSettings, Which};

use crate::app::Context;
use crate::app::inputs;
use crate::app::sequence::FrameSelection;
use crate::app::use_case::{Report, Status, use_case};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::registry::EXR;
use crate::formats::sequence::Pattern;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use space::Space;
use std::fmt;
use std::path::{Path, PathBuf};

/// Settings of the comparison of two EXR pictures, or of two sequences of them.
///
/// Colors of other primaries (the attribute chromaticities) are converted to those of the second picture; another pixel
/// aspect or display window is a difference. Of sequences, frames of equal number are compared.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CompareSettings {
    /// Picture to compare; or the pattern or the folder of a sequence.
    #[serde(with = "crate::app::paths")]
    pub a: PathBuf,
    /// Reference picture; or the pattern or the folder of a sequence.
    #[serde(with = "crate::app::paths")]
    pub b: PathBuf,
    /// Frames of sequences to compare.
    pub frames: FrameSelection,
    /// Layer of both files; none for the beauty.
    pub layer: Option<String>,
    /// Largest absolute difference of samples that still counts as agreement, 0 or more.
    pub tolerance: f64,
    /// PNG to write, of the absolute difference of each pixel in false colors; none for no such picture.
    #[serde(with = "crate::app::paths")]
    pub heatmap: Option<PathBuf>,
    /// Folder for a page with plots over the frames of two sequences, and both as a moving picture with their
    /// differences; none for no page.
    #[serde(with = "crate::app::paths")]
    pub report: Option<PathBuf>,
    /// Pattern or folder of another sequence to compare with the second and to show in the report.
    #[serde(with = "crate::app::paths")]
    pub beside: Option<PathBuf>,
    /// True to compare display values (sRGB, clipped to 0..1), false to compare scene-linear ones.
    pub display: bool,
    /// True to compute FLIP, too, a difference as people see it (0 to 1), of display values.
    pub flip: bool,
    /// Test of the expected values of two noisy pictures.
    #[serde(flatten)]
    pub statistical: StatisticalSettings,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

/// Report of two pictures, of two sequences, or of the expected values of two pictures.
#[derive(Debug, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum CompareReport {
    /// Report of two pictures.
    Pictures(PicturesReport),
    /// Report of two sequences.
    Sequences(SequencesReport),
    /// Report of the expected values of two pictures.
    Statistical(StatisticalReport),
}

impl CompareReport {
    /// True if a difference was found.
    pub(crate) fn differ(&self) -> bool {
        match self {
            Self::Pictures(pictures) => pictures.differ,
            Self::Sequences(sequences) => sequences.differ,
            Self::Statistical(statistical) => statistical.differ(),
        }
    }

    /// True if no frame failed.
    pub(crate) fn complete(&self) -> bool {
        match self {
            Self::Sequences(sequences) => sequences.failed.is_empty(),
            Self::Pictures(_) | Self::Statistical(_) => true,
        }
    }
}

impl fmt::Display for CompareReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pictures(pictures) => pictures.fmt(f),
            Self::Sequences(sequences) => sequences.fmt(f),
            Self::Statistical(statistical) => statistical.fmt(f),
        }
    }
}

use_case!(CompareSettings => CompareReport, limits);

impl Report for CompareReport {
    fn status(&self) -> Result<Status> {
        Ok(Status::of_check(self.complete(), self.differ()))
    }
}

impl CompareSettings {
    /// Paths that are read.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        let repeats = self.statistical.repeats();
        [&self.a, &self.b].into_iter().chain(&self.beside).chain(repeats).map(PathBuf::as_path).collect()
    }

    /// Reads and compares. Frames that fail are part of the report.
    ///
    /// # Errors
    /// If a picture cannot be read, the sizes differ, more memory is needed than is allowed, the heat map or the page
    /// cannot be written, or two sequences have no frame in common.
    pub fn run(&self, context: &Context) -> Result<CompareReport> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        let stage = context.stage("comparing");
        if self.tolerance.is_nan() || self.tolerance < 0.0 {
            return Err(Error::invalid(format!("⟨tolerance⟩ {}: a number from 0 on is expected", self.tolerance))
                .hint("give the largest absolute difference of a sample that still counts as agreement"));
        }
        if self.statistical.statistical {
            drop(stage);
            if [&self.a, &self.b].into_iter().any(|path| path.is_dir() || Pattern::parse(path).is_some()) {
                return Err(Error::invalid("⟨statistical⟩: a sequence is given, and it tests two pictures")
                    .hint("test frames of it one by one"));
            }
            return self.test(context).map(CompareReport::Statistical);
        }
        if let Some([a, b]) = &self.frames.pair([&self.a, &self.b], |path| self.frames.sequence(path, EXR.endings))? {
            drop(stage);
            return self.sequences([a, b], context).map(CompareReport::Sequences);
        }
        for (setting, given) in [("⟨report⟩", &self.report), ("⟨beside⟩", &self.beside)] {
            if given.is_some() {
                return Err(Error::invalid(format!("{setting} is for sequences, and these are two pictures")).hint(
                    "give sequences, 'a.####.exr' and 'b.####.exr', or ⟨heatmap⟩ for the difference of two pictures",
                ));
            }
        }
        self.pictures().map(CompareReport::Pictures)
    }

    fn space(&self) -> Space {
        if self.display { Space::Display } else { Space::Linear }
    }
}
