//! The camera of each frame of a sequence, between those of the frames before and after.

use crate::error::{Error, Result};
use crate::formats::sequence;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, Frame};
use std::path::Path;

/// Returns the camera of each frame, the one whose picture bears the frame's number plus `offset`, or the only one;
/// before and after it those of the numbers next to it, or itself. `path` is that of the capture.
///
/// # Errors
/// If a frame has no camera.
pub(in crate::app) fn between(
    template: &Capture,
    path: &Path,
    numbers: &[u32],
    offset: i32,
) -> Result<Vec<[Camera; 3]>> {
    if let [only] = &template.frames[..] {
        return Ok(vec![[only.camera; 3]]);
    }
    let of = |number: Option<u32>| {
        let bears = |frame: &&Frame| number.is_some() && sequence::number_of(&frame.picture) == number;
        template.frames.iter().find(bears).map(|frame| frame.camera)
    };
    let find = |frame: &u32| {
        let number = frame.checked_add_signed(offset);
        let beside = |camera| {
            [number.and_then(|n| n.checked_sub(1)), number.and_then(|n| n.checked_add(1))]
                .map(|n| of(n).unwrap_or(camera))
        };
        let between = |camera| {
            let [before, after] = beside(camera);
            [before, camera, after]
        };
        of(number).map(between).ok_or_else(|| {
            let known: Vec<u32> = template.frames.iter().filter_map(|f| sequence::number_of(&f.picture)).collect();
            let range = known.iter().min().zip(known.iter().max());
            let known = range.map_or("no numbers".into(), |(a, b)| format!("the numbers {a} to {b}"));
            Error::invalid(format!("no camera for frame {frame}: the pictures' names have {known}"))
                .at(path)
                .hint("choose frames with ⟨frames⟩, give ⟨camera_offset⟩, or one camera for all of them")
        })
    };
    numbers.iter().map(find).collect()
}
