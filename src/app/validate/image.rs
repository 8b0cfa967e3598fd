//! Faults of a scan or an array.

use super::findings::Findings;
use super::traits::{Trait, Traits};
use crate::app::scan::ScanSettings;
use crate::app::scan::values::{Measured, measured};
use crate::error::Result;
use crate::formats::format::Format;
use crate::formats::imaging::ImageFormat;
use crate::formats::limits::Limits;
use std::path::Path;

/// Checks the headers and all values of a scan, and returns what it is compared by if it is a frame of a sequence.
/// Slices that are missing, lie unevenly or differ are faults by which the reader refuses it.
///
/// # Errors
/// If the operating system keeps the file from being read.
pub(super) fn check(
    path: &Path,
    (format, reader): (&Format, &ImageFormat),
    (scan, limits): (&ScanSettings, Limits),
    findings: &mut Findings,
) -> Result<Traits> {
    let mut traits = Traits::new();
    let images = match measured(path, (format, reader), scan, limits) {
        Ok(images) => images,
        Err(error) => {
            findings.refusal(error)?;
            return Ok(traits);
        }
    };
    for (number, image) in images.iter().enumerate() {
        let name = image.header.name.clone().unwrap_or_else(|| format!("image {number}"));
        values(&name, image, findings);
        let s = &image.statistics;
        let figures = s.max.zip(s.mean).map(|(max, mean)| [max, mean * (s.count - s.nan - s.infinite) as f64]);
        let kind = image.header.about.sample.map_or("numbers", crate::formats::sample::Sample::name).to_owned();
        let place = image.spacing.then(|| image.header.index_to_world.matrix());
        traits.insert(format!("image '{name}'"), Trait { kind, place, figures });
    }
    Ok(traits)
}

/// Checks what is known of an image.
fn values(name: &str, Measured { header, spacing, statistics }: &Measured, findings: &mut Findings) {
    let part = format!("image '{name}'");
    let mut of = |certain: bool, what: String, remedy: &str| findings.of_part(certain, &part, what, remedy);
    if !spacing {
        of(
            false,
            "the file does not say how large its voxels are".into(),
            "give it with ⟨voxel_size⟩ or ⟨spacing⟩ where the file is read",
        );
    }
    if statistics.nan > 0 {
        of(true, format!("{} values are NaN", statistics.nan), "cumulo convert ⟨repair⟩ sets them to 0 in a VDB of it");
    }
    if statistics.infinite > 0 {
        let what = format!("{} values are infinite", statistics.infinite);
        of(true, what, "cumulo convert ⟨repair⟩ sets them to 0 in a VDB of it");
    }
    if statistics.negative > 0 {
        let (count, least) = (statistics.negative, statistics.min.unwrap_or_default());
        of(
            false,
            format!("{count} values are negative (down to {least})"),
            "densities of absorbing media are not: cumulo convert ⟨map=LOW,HIGH⟩ makes densities from 0 to 1 of a \
             range",
        );
    }
    if statistics.min.is_some() && statistics.min == statistics.max {
        let what = format!("all values are {}", statistics.min.unwrap_or_default());
        of(statistics.max == Some(0.0), what, "check that the recording or the export reached this file");
    }
    // Remarks of the reader say what it has assumed.
    header
        .notes
        .iter()
        .for_each(|note| of(false, note.clone(), "check that this is so: the volume is read in this way"));
}
