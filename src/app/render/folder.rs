//! Folder of a sequence. Runs of the same settings share it, at once or one after the other: what each of them may
//! replace, what it skips, and the list of cameras that it adds its own to.

use super::RenderSettings;
use super::sequence::{Done, Sequence};
use crate::app::Context;
use crate::app::earlier::{self, Earlier, Keys, Policy, Standing};
use crate::app::pictures::scales::DensityScales;
use crate::app::provenance::Provenance;
use crate::app::volume;
use crate::error::{Code, Error, Result};
use crate::formats::atomic::{self, Batch};
use crate::formats::format::FileKind;
use crate::formats::{protected, transforms};
use crate::scene::capture::{Capture, Frame};
use serde_json::{Map, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Error that other settings wrote the capture in the folder.
fn other_capture(json: &Path) -> Error {
    let error = Error::invalid("another capture lies here, of another command than this one");
    error.coded(Code::OutputExists).at(json).hint(
        "runs of the very same settings, whichever ⟨frames⟩ they render, add to one folder; give another folder, or \
         ⟨overwrite⟩ to replace what is there",
    )
}

impl Sequence<'_> {
    /// Makes sure that neither inputs nor anything of other settings is replaced.
    pub(super) fn refuse_overwrite(&self, frames: &[(u32, PathBuf)]) -> Result<()> {
        let pictures: Vec<PathBuf> = frames.iter().flat_map(|(_, path)| self.render.files_of(path)).collect();
        let json = self.target.json();
        pictures.iter().chain(&json).try_for_each(|path| protected::check(path))?;
        if self.render.overwrite {
            return Ok(());
        }
        json.iter().try_for_each(|json| self.spare_capture(json))?;
        let policy = self.policy();
        pictures.iter().try_for_each(|path| {
            policy.check(path).map_err(|e| match json {
                _ if policy.standing(path) == Standing::Damaged => e.instead(
                    "⟨overwrite⟩ replaces it, and ⟨resume⟩ renders it again and leaves the others as they are",
                ),
                Some(_) => e.instead("runs of the very same settings share a folder; give another one, or ⟨overwrite⟩"),
                None => e,
            })
        })
    }

    /// Makes sure that no capture of other settings is replaced.
    fn spare_capture(&self, json: &Path) -> Result<()> {
        match Standing::of_capture(json, &self.provenance) {
            Standing::Nothing | Standing::Own => Ok(()),
            _ if self.render.overwrite => Ok(()),
            _ => Err(other_capture(json)),
        }
    }

    /// Returns the capture that runs of these settings have left in the folder; none if there is none.
    pub(super) fn earlier(&self) -> Option<Capture> {
        let json = self.target.json()?;
        if Standing::of_capture(&json, &self.provenance) != Standing::Own {
            return None;
        }
        protected::unprotected(&json, || transforms::load(&json)).ok()
    }

    /// Returns how pictures are treated that lie where this run's go.
    fn policy(&self) -> Policy<'_> {
        let RenderSettings { overwrite, resume, .. } = *self.render;
        Policy { own: &self.provenance, keys: Keys::RENDERED, overwrite, resume }
    }

    /// Returns what an earlier run has left of a frame, for `resume`.
    pub(super) fn state(&self, number: u32, path: &Path) -> Earlier {
        let mut pictures = self.pictures.clone();
        if let Some(pattern) = &self.pattern {
            pictures.input = pattern.path(number);
        }
        // The picture itself names what lies behind a scene or a stage.
        let cameras = self.provenance.inputs.keys().map(PathBuf::from);
        let others = cameras.chain(self.render.holdout.file(number));
        let needs: Vec<PathBuf> = pictures.files().into_iter().chain(others).collect();
        self.policy().left(&self.render.files_of(path), &needs)
    }

    /// Returns the frames of a capture that this run leaves alone: those of other runs.
    pub(super) fn others(&self, capture: Capture, own: &[&Path]) -> Vec<Frame> {
        let other = |frame: &Frame| !own.contains(&frame.picture.as_path()) && frame.picture.exists();
        capture.frames.into_iter().filter(other).collect()
    }

    /// Writes a frame's files through `write`, and puts them into place unless a run of other settings, at the same
    /// time, has written a capture or the same frame: then the error that says so is returned as a value.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub(super) fn place(&self, picture: &Path, write: impl FnOnce(&[PathBuf]) -> Result<()>) -> Result<Option<Error>> {
        let files = self.render.files_of(picture);
        let mut batch = Batch::new();
        let waiting = files.iter().map(|file| batch.add(file)).collect::<Result<Vec<_>>>()?;
        write(&waiting)?;
        let json = self.target.json();
        let _lock = json.as_deref().and_then(Path::parent).map(atomic::lock_folder);
        let capture = json.iter().try_for_each(|json| self.spare_capture(json));
        match capture.and_then(|()| files.iter().try_for_each(|file| self.policy().check(file))) {
            Ok(()) => batch.commit().map(|()| None),
            Err(refused) => Ok(Some(refused)),
        }
    }

    /// Adds the frames that are there to the capture in the folder, and returns its density scales. Of two runs that
    /// end at once, one waits for the other.
    ///
    /// # Errors
    /// If a run of other settings has written a capture meanwhile, or the file cannot be written.
    pub(super) fn write(
        &mut self,
        done: &[Done],
        provenance: &mut Provenance,
        context: &Context,
    ) -> Result<DensityScales> {
        let Some((first, ..)) = done.first() else {
            return Ok(self.earlier_scales());
        };
        let Some(json) = self.target.json() else {
            return Ok(self.shot.as_ref().map(|shot| shot.scales.clone()).unwrap_or_default());
        };
        let own: Vec<&Path> = done.iter().map(|(.., picture)| picture.as_path()).collect();
        if self.shot.is_none() {
            // Nothing was rendered now: an earlier capture stands, unless it lacks frames.
            let earlier = self.earlier().filter(|earlier| {
                own.iter().all(|picture| earlier.frames.iter().any(|frame| frame.picture == **picture))
            });
            if earlier.is_some() {
                return Ok(self.earlier_scales());
            }
            self.shot = Some(Arc::new(self.shot(*first, done[0].1, context)?));
        }
        let Some(shot) = &self.shot else { return Ok(DensityScales::default()) };
        let _lock = json.parent().map(atomic::lock_folder);
        self.spare_capture(&json)?;
        let kept = self.earlier().map(|capture| self.others(capture, &own)).unwrap_or_default();
        if !kept.is_empty() {
            let before = earlier::provenance(&json).map(|before| before.inputs).unwrap_or_default();
            // What this run has read is newer.
            let own = std::mem::replace(&mut provenance.inputs, before);
            provenance.inputs.extend(own);
        }
        let mine =
            done.iter().map(|(place, _, picture)| Frame { camera: self.camera(*place), picture: picture.clone() });
        let mut frames: Vec<Frame> = mine.chain(kept).collect();
        frames.sort_by(|a, b| a.picture.cmp(&b.picture));
        let capture = Capture { frames, ..shot.capture.clone() };
        let mut extra = Map::new();
        extra.insert("provenance".into(), json!(provenance));
        extra.extend(shot.plan.iter().map(|plan| ("plan".to_owned(), json!(plan))));
        let record = || self.pictures.scattering.record(shot.colors.as_ref());
        extra.extend(shot.paths.then(|| ("scattering".to_owned(), record())));
        transforms::save_for(&json, &json, &self.pictures.recorded_as(&capture, &mut extra), &extra)?;
        Ok(shot.scales.clone())
    }

    /// Returns the density scales of an earlier capture; the capture of a scene does not tell those of its volumes.
    fn earlier_scales(&self) -> DensityScales {
        let is_scene = self.pattern.is_none()
            && volume::format_of(&self.pictures.input)
                .is_ok_and(|format| matches!(format.kind, FileKind::Capture | FileKind::Usd));
        let earlier = self.earlier().filter(|_| !is_scene);
        earlier.map(|capture| DensityScales::one(capture.density_scale)).unwrap_or_default()
    }
}
