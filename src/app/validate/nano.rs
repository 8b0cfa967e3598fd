//! Faults of a NanoVDB file.

use super::findings::Findings;
use super::traits::Traits;
use super::volume;
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::nanovdb::File;
use std::path::Path;

/// Checks all grids of a file and their values, and returns what the file is compared by if it is a frame of a
/// sequence.
///
/// # Errors
/// If the operating system keeps the file from being read.
pub(super) fn check(path: &Path, limits: Limits, findings: &mut Findings) -> Result<Traits> {
    let mut traits = Traits::new();
    let mut file = match File::open(path, limits) {
        Ok(file) => file,
        Err(error) => {
            findings.refusal(error)?;
            return Ok(traits);
        }
    };
    for index in 0..file.entries().len() {
        let place = format!("grid '{}'", file.entries()[index].name);
        let native = file.read(index).and_then(|read| read.into_native());
        match native.and_then(|(native, notes)| native.info().map(|info| (native, info, notes))) {
            Ok((native, info, notes)) => {
                notes.iter().for_each(|n| findings.note(Some(&info.name), n, "cumulo convert makes a .vdb of it"));
                let statistics = volume::values(&native, &info, findings)?;
                traits.insert(place, volume::of_grid(&info, statistics.as_ref()));
            }
            Err(error) => findings.refusal(error.part(place))?,
        }
    }
    Ok(traits)
}
