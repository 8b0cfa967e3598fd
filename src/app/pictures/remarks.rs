//! What is remarked of a subject before its pictures are made.

use super::PictureSettings;
use super::subject::Subject;
use crate::app::checks::{Warning, values};
use crate::scene::capture::Capture;
use crate::scene::transfer::Transfer;
use crate::scene::volume::Grids;

/// Returns the remarks on a subject, its cameras and its lights.
pub(in crate::app) fn remarks(
    pictures: &PictureSettings,
    (subject, transfer): (&Subject, Option<&Transfer>),
    template: Option<&Capture>,
) -> Vec<String> {
    let cameras = template.filter(|_| subject.is_scene()).map_or(&[][..], |capture| &capture.remarks);
    let lights = if subject.is_scene() { None } else { pictures.other_light() };
    let unmet = match (subject, transfer) {
        (Subject::Grids { grids: Grids::Density(field), .. }, Some(transfer)) => {
            values::unmet(field, transfer, pictures.transfer.unit())
        }
        _ => None,
    };
    let unmet = unmet.map(|Warning { what, remedy }| format!("{what}; {remedy}"));
    subject.remarks().iter().chain(cameras).cloned().chain(lights).chain(unmet).collect()
}
