//! Problems of OpenEXR files, for `validate`.

use super::{Window, summary_within};
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::problem::Problem;
use std::path::Path;

/// Problems of a file; empty if there are none. A file that cannot be decoded is one problem.
///
/// # Errors
/// If the operating system does not let the file be read.
pub fn problems(path: &Path) -> Result<Vec<Problem>> {
    problems_within(path, Limits::default())
}

/// Problems of a file, as [`problems`] lists them; the chunks being decoded must fit into `limits`.
///
/// # Errors
/// The conditions are those of [`problems`].
pub(crate) fn problems_within(path: &Path, limits: Limits) -> Result<Vec<Problem>> {
    let summary = match summary_within(path, limits) {
        Ok(summary) => summary,
        Err(error) => return Ok(vec![Problem::of(error)?]),
    };
    let mut found = Vec::new();
    for (i, part) in summary.parts.iter().enumerate() {
        for channel in part.layers.iter().flat_map(|l| &l.channels).filter(|c| c.non_finite > 0) {
            let what = format!("NaN or infinite samples: {}", channel.non_finite);
            found.push(
                Problem::new(what, "render it again, or fill the holes before it is used")
                    .part(format!("channel '{}'", channel.info.name)),
            );
        }
        if apart(&part.data_window, &summary.display_window) {
            let what = format!(
                "its pixels lie at {}, outside the display window {}",
                part.data_window, summary.display_window
            );
            found
                .push(Problem::new(what, "nothing of it would be seen; correct the windows").part(format!("part {i}")));
        }
    }
    if !(summary.pixel_aspect.is_finite() && summary.pixel_aspect > 0.0) {
        found.push(Problem::new(
            format!("the pixel aspect ratio is {}", summary.pixel_aspect),
            "a positive number is expected, 1 for square pixels",
        ));
    }
    Ok(found)
}

fn apart(a: &Window, b: &Window) -> bool {
    (0..2).any(|axis| a.end(axis) <= i64::from(b.min[axis]) || b.end(axis) <= i64::from(a.min[axis]))
}
