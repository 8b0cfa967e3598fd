//! Views put into place. Runs of the same settings share a folder, at once or one after the other, whichever views each
//! of them renders: its capture lists the pictures of all of them.

use super::begun::is_stopped;
use super::views::{Integration, Views};
use crate::app::earlier::{self, Earlier, Keys, Policy, Standing};
use crate::app::render::RenderSettings;
use crate::error::{Code, Error, Result};
use crate::formats::atomic::{self, Batch};
use crate::formats::limits::Limits;
use crate::formats::{protected, transforms};
use crate::plan::Plan;
use crate::scene::capture::{Capture, Frame};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

impl Views<'_> {
    /// Returns how pictures are treated that lie where the views go.
    fn policy(&self) -> Policy<'_> {
        let RenderSettings { overwrite, resume, .. } = *self.settings;
        Policy { own: &self.provenance, keys: Keys::RENDERED, overwrite, resume }
    }

    /// Returns the files of a view.
    pub(super) fn files(&self, place: usize) -> Vec<PathBuf> {
        self.settings.files_of(&self.capture.frames[place].picture)
    }

    /// Makes sure that the outputs replace neither inputs nor files that other settings wrote.
    ///
    /// # Errors
    /// If one would be replaced; the error names it.
    pub(super) fn refuse_overwrite(&self) -> Result<()> {
        let json = self.target.json();
        let pictures: Vec<PathBuf> = (0..self.numbers.len()).flat_map(|place| self.files(place)).collect();
        pictures.iter().chain(&json).try_for_each(|path| protected::check(path))?;
        match json {
            _ if self.settings.overwrite => Ok(()),
            Some(json)
                if self.settings.resume && Standing::of_capture(&json, &self.provenance) == Standing::Nothing =>
            {
                pictures.iter().try_for_each(|picture| self.policy().check(picture))
            }
            Some(json) => {
                earlier::spare_captures(&json, &pictures, &self.provenance)?;
                self.other_views(&json, &BTreeSet::new()).map(drop)
            }
            None => pictures.iter().try_for_each(|picture| self.policy().check(picture)),
        }
    }

    /// Returns the places of the views that are to be rendered: all but those that an earlier run of the same settings
    /// has left as they would be, if these are to stay.
    pub(super) fn left(&self) -> Vec<usize> {
        let needs: Vec<PathBuf> = self.provenance.inputs.keys().map(PathBuf::from).collect();
        let listed = self.target.json().map(|json| self.standing(&json).map(|capture| capture.frames));
        let is_listed = |picture: &Path| match &listed {
            None => true,
            Some(frames) => frames.iter().flatten().any(|frame| frame.picture == picture),
        };
        let is_there = |place: &usize| {
            let files = self.files(*place);
            self.policy().left(&files, &needs) == Earlier::Whole && !is_stopped(&files[0]) && is_listed(&files[0])
        };
        (0..self.numbers.len()).filter(|place| !(self.settings.resume && is_there(place))).collect()
    }

    /// Returns the capture that runs of the same settings have left in the folder; none if there is none.
    fn standing(&self, json: &Path) -> Option<Capture> {
        if Standing::of_capture(json, &self.provenance) != Standing::Own {
            return None;
        }
        protected::unprotected(json, || transforms::load(json)).ok()
    }

    /// Returns the views in the folder's capture that stay beside those which are put into place now: pictures that
    /// runs of the same settings have made of the same content.
    ///
    /// # Errors
    /// If other runs have made views of other content, and they are not to be replaced.
    fn other_views(&self, json: &Path, now: &BTreeSet<&Path>) -> Result<Vec<Frame>> {
        let Some(capture) = self.standing(json) else { return Ok(Vec::new()) };
        let others = |frame: &Frame| !now.contains(frame.picture.as_path()) && frame.picture.exists();
        let frames: Vec<Frame> = capture.frames.into_iter().filter(others).collect();
        if earlier::provenance(json).is_some_and(|before| before.inputs == self.provenance.inputs) {
            return Ok(frames);
        }
        // Views of this run that are outdated are rendered again.
        let own: BTreeSet<&Path> = self.capture.frames.iter().map(|frame| frame.picture.as_path()).collect();
        match frames.iter().find(|frame| !own.contains(frame.picture.as_path())) {
            Some(other) if !self.settings.overwrite => {
                Err(Error::invalid("this view, which the run does not render again, was made from other content")
                    .coded(Code::OutputExists)
                    .at(&other.picture)
                    .hint("render all views again, give another folder, or ⟨overwrite⟩ to begin a new capture"))
            }
            _ => Ok(Vec::new()),
        }
    }

    /// Puts views, which wait in a batch, into place with their entries in the capture of the folder. Of two runs that
    /// end at once, one waits for the other.
    ///
    /// # Errors
    /// If files of other settings lie there by now, or a file cannot be written.
    pub(super) fn put(
        &self,
        places: &[usize],
        mut batch: Batch,
        (way, plan): (&Integration, Option<&Plan>),
    ) -> Result<()> {
        let Some(json) = self.target.json() else {
            self.refuse_overwrite()?;
            return batch.commit();
        };
        let waiting = batch.add(&json)?;
        let _lock = json.parent().map(atomic::lock_folder);
        self.refuse_overwrite()?;
        let mut frames: Vec<Frame> = places.iter().map(|place| self.capture.frames[*place].clone()).collect();
        let kept = self.other_views(&json, &frames.iter().map(|frame| frame.picture.as_path()).collect())?;
        let before = if kept.is_empty() { Map::new() } else { protected::unprotected(&json, || root(&json)) };
        frames.extend(kept);
        frames.sort_by(|a, b| a.picture.cmp(&b.picture));
        let mut extra = Map::new();
        let mut provenance = self.provenance.clone();
        provenance.lap();
        extra.insert("provenance".into(), json!(provenance));
        extra.extend(plan.map(|plan| ("plan".to_owned(), json!(plan))));
        let pictures = &self.settings.pictures;
        way.record(self.paths.then(|| pictures.scattering.record(self.colors.as_ref())), &mut extra);
        largest_error(&mut extra, &before);
        let capture = Capture { frames, ..self.capture.clone() };
        transforms::save_for(&json, &waiting, &pictures.recorded_as(&capture, &mut extra), &extra)?;
        batch.commit()
    }
}

/// Returns a capture's JSON; empty if it cannot be read.
fn root(json: &Path) -> Map<String, Value> {
    transforms::read_object(json, Limits::default()).unwrap_or_default()
}

/// Has the capture of several runs state the largest of their errors.
fn largest_error(extra: &mut Map<String, Value>, before: &Map<String, Value>) {
    let earlier = before.get("early_stop").and_then(|stop| stop["error_bound"].as_f64());
    if let (Some(earlier), Some(bound)) = (earlier, extra.get_mut("early_stop").map(|stop| &mut stop["error_bound"]))
        && bound.as_f64().is_some_and(|now| now < earlier)
    {
        *bound = json!(earlier);
    }
}
