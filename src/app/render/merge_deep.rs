//! Deep pictures joined: the samples of all, as those of one picture.

use super::merge::MergeSettings;
use crate::app::pictured;
use crate::cancel::Cancel;
use crate::error::{Code, Error, Result};
use crate::formats::exr::deep::{self, DeepLine, DeepPicture, DeepSample, Encoding, Layout};
use crate::formats::exr::{Attributes, Window};
use crate::formats::limits::Limits;
use std::path::Path;

impl MergeSettings {
    /// Joins deep pictures: parts of one, or elements of one shot. Returns the number of samples.
    ///
    /// # Errors
    /// If a picture cannot be read, is flat, or is meant to cover another window than the first one.
    pub(super) fn join_deep(&self, mut attributes: Attributes, cancel: &Cancel) -> Result<u64> {
        if self.target_error.is_some() {
            return Err(Error::invalid(
                "⟨target_error⟩: samples of deep pictures state no error that more could reduce",
            )
            .hint("leave it out"));
        }
        let pictures = self.read_deep(cancel)?;
        let [first, ..] = &pictures[..] else { return Ok(0) };
        for (picture, path) in pictures.iter().zip(&self.inputs) {
            if picture.display_window != first.display_window {
                let [own, other] = [picture.display_window, first.display_window];
                return Err(Error::invalid(format!(
                    "its display window is {own}, and that of '{}' is {other}",
                    self.inputs[0].display()
                ))
                .at(path)
                .hint("join pictures of one view and size, or parts of them by ⟨render.crop⟩"));
            }
        }
        let kept = |name: &str| Some((name.to_owned(), first.attributes.get(name)?.clone()));
        attributes.extend(pictured::NAMES.into_iter().filter_map(kept));
        let data_window = pictures.iter().fold(first.data_window, |all, picture| all.union(&picture.data_window));
        // Counts of all pixels are held by the writer, and lists of samples for those of a row.
        let bytes = data_window.pixels().saturating_mul(8).saturating_add(64 * data_window.size[0] as u64);
        if bytes > self.limits.max_memory {
            return Err(Error::unsupported(format!(
                "the pictures lie too far apart: together they cover {data_window}"
            ))
            .coded(Code::MemoryLimit)
            .hint("join pictures of one view, or raise ⟨max_memory⟩"));
        }
        let layout = Layout { display_window: first.display_window, data_window, pixel_aspect: 1.0 };
        let mut samples = 0;
        deep::write(&self.output, &layout, &attributes, Encoding::default(), |writer| {
            for row in 0..data_window.size[1] {
                if cancel.requested() {
                    return Err(Error::cancelled());
                }
                let line = joined(&pictures, data_window, row);
                samples += line.samples.len() as u64;
                writer.push(line)?;
            }
            Ok(())
        })?;
        Ok(samples)
    }

    /// Reads the pictures, which share the memory that they may take.
    fn read_deep(&self, cancel: &Cancel) -> Result<Vec<DeepPicture>> {
        let limits = Limits { max_memory: self.limits.max_memory / (self.inputs.len() as u64 + 1) };
        let read = |path: &std::path::PathBuf| {
            if cancel.requested() {
                return Err(Error::cancelled());
            }
            if !deep::is_deep(path) {
                return Err(flat(path, &self.inputs[0]));
            }
            deep::read_within(path, limits)
        };
        self.inputs.iter().map(read).collect()
    }
}

fn flat(path: &Path, first: &Path) -> Error {
    Error::unsupported(format!("this is no deep picture, and '{}' is one", first.display()))
        .at(path)
        .hint("join deep pictures with deep ones; ⟨convert.flatten⟩ makes flat ones of them")
}

/// Returns a row of a window with the samples of all pictures, those of each pixel sorted by depth.
fn joined(pictures: &[DeepPicture], window: Window, row: usize) -> DeepLine {
    let mut pixels: Vec<Vec<DeepSample>> = vec![Vec::new(); window.size[0]];
    for picture in pictures {
        let from = |axis: usize| (i64::from(picture.data_window.min[axis]) - i64::from(window.min[axis])) as usize;
        let Some(line) = row.checked_sub(from(1)).and_then(|row| picture.lines.get(row)) else { continue };
        for (to, own) in pixels[from(0)..].iter_mut().zip(line.pixels()) {
            to.extend_from_slice(own);
        }
    }
    let mut line = DeepLine::default();
    for mut samples in pixels {
        samples.sort_by(|a, b| a.z.total_cmp(&b.z).then(a.z_back.total_cmp(&b.z_back)));
        line.push(&samples);
    }
    line
}
