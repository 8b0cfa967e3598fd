//! The page of a reconstruction, made again with more beside it.

use super::reconstruct::page::{self, Record};
use crate::app::Context;
use crate::app::inputs;
use crate::app::outputs::RECORD;
use crate::app::use_case::{Report, use_case};
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::transfer::Options;
use crate::formats::vdb::File;
use crate::formats::{captures, transfer};
use page::transfer::FunctionError;
use page::volume::VolumeError;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};

/// Settings of the page of a reconstruction that is made again.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PageSettings {
    /// Folder that a reconstruction has written its page into.
    #[serde(with = "crate::app::paths")]
    pub folder: PathBuf,
    /// Volume, or transfer function, to compare with.
    #[serde(with = "crate::app::paths")]
    pub reference: Option<PathBuf>,
    /// Renders of the result from the same cameras, shown beside the program's own.
    pub beside: Option<OtherRenders>,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

/// Renders of another program.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct OtherRenders {
    /// Name that they are shown under.
    pub name: String,
    /// Capture of the pictures.
    #[serde(with = "crate::app::paths")]
    pub capture: PathBuf,
}

/// Report of a page that was made again.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct PageReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    report: PathBuf,
    /// Error of the volume against the reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    volume: Option<VolumeError>,
    /// Error of the transfer function against the reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    transfer: Option<FunctionError>,
}

impl fmt::Display for PageReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.report.display())
    }
}

use_case!(PageSettings => PageReport, limits);

impl Report for PageReport {}

impl PageSettings {
    /// Paths that the page is made from, beside the record.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        self.named_files().collect()
    }

    /// Reads the record, renders and writes the page.
    ///
    /// # Errors
    /// If the record, the volumes or the pictures cannot be read, or the page cannot be written.
    pub fn run(&self, context: &Context) -> Result<PageReport> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        let limits = self.limits;
        let _stage = context.stage("report");
        let path = self.folder.join(RECORD);
        let record = Record::read(&path, limits).map_err(|e| e.at(&path))?;
        let beside = match &self.beside {
            Some(OtherRenders { name, capture }) => Some((name.clone(), captures::load_within(capture, limits)?)),
            None => None,
        };
        // What the record names may be elsewhere by now, or never have been there.
        let folder = record.capture().parent().map(Path::to_path_buf);
        let named = |e: Error| {
            let within = |folder: &Path| e.path().is_some_and(|path| path.starts_with(folder));
            match self.named_files().any(within) && !folder.as_deref().is_some_and(within) {
                true => e,
                false => e.inside(format!("named in {}", path.display())),
            }
        };
        match &record {
            Record::Volume(run) => {
                let reference = self.reference.as_deref().map(|path| File::open(path, limits)?.read_fog(None));
                let (page, volume) =
                    page::volume::page(run, limits, reference.transpose()?.as_ref(), beside.as_ref(), &Cancel::NEVER)
                        .map_err(named)?;
                Ok(PageReport { report: page.write(&self.folder)?, volume, transfer: None })
            }
            Record::Transfer(run) => {
                let options = Options { limits, ..Options::default() };
                let reference = self.reference.as_deref().map(|path| transfer::load(path, &options));
                let reference = reference.transpose()?.map(|loaded| loaded.transfer);
                let views =
                    page::transfer::views(run, &run.shown, limits, beside.as_ref(), &Cancel::NEVER).map_err(named)?;
                let (page, function) = page::transfer::page(run, views, reference.as_ref())?;
                Ok(PageReport { report: page.write(&self.folder)?, volume: None, transfer: function })
            }
        }
    }

    /// Returns the files that the settings name beside the record's folder.
    fn named_files(&self) -> impl Iterator<Item = &Path> {
        let beside = self.beside.as_ref().map(|beside| beside.capture.as_path());
        self.reference.as_deref().into_iter().chain(beside)
    }
}
