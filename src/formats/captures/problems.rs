//! Problems of captures, for `validate`.

use super::{file, load_within};
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::problem::Problem;
use crate::formats::{colmap, picture, transforms};
use crate::scene::capture::{Capture, Frame};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Problems of a capture and its pictures, all of which are read; empty if there are none.
///
/// # Errors
/// If the operating system does not let the JSON file be read. A picture that cannot be read is a problem of the
/// capture.
pub fn problems(path: &Path) -> Result<Vec<Problem>> {
    problems_within(path, Limits::default())
}

/// Problems of a capture, as [`problems`] lists them; the values of its JSON, and each picture, must fit into `limits`.
///
/// # Errors
/// The conditions are those of [`problems`].
pub(crate) fn problems_within(path: &Path, limits: Limits) -> Result<Vec<Problem>> {
    let file = file(path);
    let json = !colmap::is_model_file(&file);
    let mut found = if json { transforms::frame_problems(&file, limits)? } else { Vec::new() };
    // Faults of frames are listed one by one; any other fault that keeps the capture from loading is one more.
    match load_within(path, limits) {
        Err(error) if found.is_empty() => found.push(Problem::of(error)?),
        Err(_) => {}
        Ok(capture) => found.extend(picture_problems(&capture, limits)),
    }
    Ok(found)
}

fn picture_problems(capture: &Capture, limits: Limits) -> Vec<Problem> {
    let mut found = Vec::new();
    let mut users: BTreeMap<&PathBuf, usize> = BTreeMap::new();
    for (i, frame) in capture.frames.iter().enumerate() {
        let mut add = |problem: Problem| found.push(problem.part(format!("frame {i}")));
        if let Some(earlier) = users.insert(&frame.picture, i) {
            add(Problem::new(
                format!("it has the same picture as frame {earlier}, {}", frame.picture.display()),
                "give each view a picture of its own",
            ));
        }
        of_picture(frame, capture, limits).into_iter().for_each(add);
    }
    found
}

fn of_picture(frame: &Frame, capture: &Capture, limits: Limits) -> Vec<Problem> {
    let path = frame.picture.display();
    let options = picture::Options { color_space: capture.color_space, limits, ..picture::Options::default() };
    let picture = match picture::read_or_flattened(&frame.picture, &options) {
        Ok(picture) => picture,
        Err(error) => {
            let missing = error.io_kind() == Some(std::io::ErrorKind::NotFound);
            let what = if missing { "there is no such picture".into() } else { error.what() };
            // The user corrects 'file_path' in the capture, not a path on the command line.
            let remedy = match error.remedy() {
                _ if missing => "correct 'file_path', or add the picture".into(),
                Some(remedy) => remedy,
                None => "render or copy it again".into(),
            };
            return vec![Problem::new(format!("{path}: {what}"), remedy)];
        }
    };
    let mut found = Vec::new();
    let (stated, actual) =
        ([frame.camera.width as usize, frame.camera.height as usize], [picture.film.width, picture.film.height]);
    if stated != actual {
        found.push(Problem::new(
            format!("its size is {}x{}, but {path} has {}x{} pixels", stated[0], stated[1], actual[0], actual[1]),
            "correct 'w' and 'h' together with 'fl_x', 'fl_y', 'cx' and 'cy', or leave them out",
        ));
    }
    if picture.non_finite > 0 {
        found.push(Problem::new(
            format!("{path}: NaN or infinite samples: {}", picture.non_finite),
            "render it again, or fill the holes before it is used",
        ));
    }
    found
}
