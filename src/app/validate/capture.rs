//! Faults of a capture, and contradictions between what it states and what its pictures show.

use super::findings::Findings;
use crate::app::checks::pictures::PictureFacts;
use crate::app::checks::{self, Emission};
use crate::app::photos;
use crate::error::{Kind, Result};
use crate::formats::captures;
use crate::formats::limits::Limits;
use crate::scene::capture::Model;
use std::path::Path;

/// Checks a capture and its pictures. What every reconstruction checks before its work is checked too: the background
/// against the border, alpha against transmittance, and whether the pixels are scene-linear.
///
/// # Errors
/// If the operating system keeps the capture's file from being read.
pub(super) fn check(path: &Path, limits: Limits, findings: &mut Findings) -> Result<()> {
    findings.extend(captures::problems_within(path, limits)?);
    // Captures whose pictures cannot be read have problems already, and distorted views become pixels of a camera
    // first.
    let Some(capture) = captures::load_within(path, limits).ok().filter(|_| findings.valid()) else { return Ok(()) };
    if capture.model == Model::Scattering {
        findings.note(
            None,
            "the pictures show a medium that scatters light",
            "reconstruct what they tell of it: `cumulo reconstruct density` takes the densities from alpha, `cumulo \
             reconstruct color` finds the light as emission",
        );
    }
    let facts = |photo| PictureFacts::new(&photo, &capture, Emission::Stated);
    match photos::each(&capture, None, limits, 0, &|| {}, facts) {
        Ok(facts) => {
            let contradictions = checks::warnings(checks::pictures::pictures(&facts, &capture, Emission::Stated));
            contradictions.into_iter().for_each(|warning| findings.warning(warning));
        }
        Err(error) if error.kind() == Kind::Unsupported => {
            findings.note(
                None,
                format!("its pixels were not compared: {}", error.what()),
                &error.remedy().unwrap_or("-".into()),
            );
        }
        Err(error) => findings.refusal(error)?,
    }
    Ok(())
}
