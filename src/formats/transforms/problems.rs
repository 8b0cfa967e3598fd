//! Faults of a capture's frames, all at once.

use super::{folder, json_path, load};
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::problem::Problem;
use serde_json::Value;
use std::path::Path;

/// Largest number of frames whose faults are listed; further ones are counted.
const LISTED: usize = 100;

/// Problems of all frames that cannot be used as they are, not only of the first; none if the JSON cannot be read at
/// all.
///
/// # Errors
/// If the operating system reports an error.
pub(crate) fn frame_problems(path: &Path, limits: Limits) -> Result<Vec<Problem>> {
    let json = json_path(path);
    let Ok(root) = load::read_object(&json, limits) else { return Ok(Vec::new()) };
    let Some(Value::Array(frames)) = root.get("frames") else { return Ok(Vec::new()) };
    let folder = folder(&json);
    let usable = |frame| load::frame(frame, &root, &folder).and_then(|(_, optics)| optics.direct());
    let fault = |(i, frame)| usable(frame).err().map(|e| e.part(format!("frame {i}")));
    let mut faults = frames.iter().enumerate().filter_map(fault);
    let mut found = faults.by_ref().take(LISTED).map(Problem::of).collect::<Result<Vec<_>>>()?;
    let more = faults.count();
    if more > 0 {
        found.push(Problem::new(format!("{more} more frames cannot be used"), "correct those above first"));
    }
    Ok(found)
}
