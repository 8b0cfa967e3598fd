//! Cameras of a stage, from a capture.

use crate::formats::sequence::number_of;
use crate::formats::usd::write::camera::CameraPrim;
use crate::formats::usd::write::names::Names;
use crate::scene::capture::{Capture, Frame};

/// Returns one prim for each view, named like its picture, or one prim for all views, each at the time code of its
/// number, from 0 on.
pub(super) fn prims(capture: &Capture, path: bool) -> Vec<CameraPrim> {
    if path {
        let samples =
            capture.frames.iter().enumerate().map(|(number, frame)| (u32::try_from(number).ok(), frame.camera));
        return vec![CameraPrim { name: "camera".into(), samples: samples.collect() }];
    }
    let mut names = Names::default();
    let prim = |(i, frame): (usize, &Frame)| {
        let stem = frame.picture.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        // A picture that is a mere number says no more than its place.
        let stem = stem.filter(|stem| stem.contains(|c: char| c.is_ascii_alphabetic()));
        let number = number_of(&frame.picture).unwrap_or(u32::try_from(i).unwrap_or(u32::MAX));
        let name = names.take(&stem.unwrap_or_else(|| format!("view_{number:03}")));
        CameraPrim { name, samples: vec![(None, frame.camera)] }
    };
    capture.frames.iter().enumerate().map(prim).collect()
}
