//! The folder of a study: its record, its table and its page, and what an earlier study has left there.

use super::options::StudyOptions;
use super::report::StudyReport;
use crate::app::earlier::Standing;
use crate::app::outputs;
use crate::app::provenance::Provenance;
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::{atomic, protected, transforms};
use crate::report::FILE_NAME as PAGE;
use std::path::{Path, PathBuf};

/// Names of the record and of the table in the folder.
pub(super) const RECORD: &str = "study.json";
pub(super) const TABLE: &str = "study.csv";

/// Makes the folder, and returns the record of an earlier study of the same settings if this one goes on from it.
///
/// # Errors
/// If the folder cannot be written to, or holds what other settings have made and may not be replaced.
pub(super) fn open(options: &StudyOptions, own: &Provenance) -> Result<Option<StudyReport>> {
    let dir = &options.output;
    outputs::report_folder(dir)?;
    let [record, table, page] = [RECORD, TABLE, PAGE].map(|name| dir.join(name));
    [&record, &table, &page].into_iter().try_for_each(|path| protected::check(path))?;
    let refused = |what: &str, place: &Path| {
        Err(Error::invalid(what)
            .coded(Code::OutputExists)
            .at(place)
            .hint("give another folder, or ⟨overwrite⟩ to replace it"))
    };
    match Standing::of_capture(&record, own) {
        Standing::Own if options.resume => read(&record).map(Some),
        Standing::Own => Ok(None),
        _ if options.overwrite => Ok(None),
        Standing::Nothing if page.exists() => refused("the page of another command lies here", &page),
        Standing::Nothing => Ok(None),
        Standing::Other | Standing::Damaged => refused("a study of other settings lies here", &record),
    }
}

fn read(record: &Path) -> Result<StudyReport> {
    let root = protected::unprotected(record, || transforms::read_object(record, Limits::default()))?;
    serde_json::from_value(root.into()).map_err(|e| {
        Error::invalid(format!("the record of the study cannot be read: {e}"))
            .at(record)
            .hint("run the study without ⟨resume⟩")
    })
}

/// Writes the record of a study.
///
/// # Errors
/// If it cannot be written.
pub(super) fn save(dir: &Path, report: &StudyReport) -> Result<()> {
    let text = serde_json::to_vec_pretty(report).map_err(|e| Error::invalid(e.to_string()))?;
    atomic::write_bytes(&dir.join(RECORD), &text)
}

/// Returns the path of the picture of a view of the reference.
pub(super) fn reference(dir: &Path, view: usize) -> PathBuf {
    dir.join(format!("reference_{view:03}.exr"))
}
