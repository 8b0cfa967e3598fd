//! USD stages as the subject of pictures, and as what states their cameras.

use super::settings::DensityScale;
use super::settings::PictureSettings;
use crate::app::provenance::Provenance;
use crate::app::sequence::{self, FrameSelection};
use crate::app::volume;
use crate::error::{Error, Result};
use crate::formats::captures;
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::registry;
use crate::formats::scene_file::LoadedScene;
use crate::formats::usd::{self, Overrides, Stage, Views};
use crate::scene::capture::Capture;
use std::path::{Path, PathBuf};

/// Size of pictures in pixels where nothing states it.
pub(crate) const SIZE: [u32; 2] = [256, 256];

impl PictureSettings {
    /// Returns the pattern of the numbered volumes in the folder that is named as the input; `None` for any other
    /// input, such as the folder of a scan.
    ///
    /// # Errors
    /// If the folder holds several sequences, or none.
    pub(in crate::app) fn sequence_of_folder(&self) -> Result<Option<PathBuf>> {
        if !self.input.is_dir() {
            return Ok(None);
        }
        let is_volume = |kind| matches!(kind, FileKind::Vdb | FileKind::NanoVdb);
        match FrameSelection::default().of_volumes(&self.input, is_volume)? {
            Some(sequence) => Ok(Some(sequence.pattern.name())),
            None if volume::is_scan(&self.input) => Ok(None),
            None => Err(Error::invalid("the folder holds no numbered VDBs")
                .at(&self.input)
                .hint("give a VDB, a scan, a USD stage or a scene file, or a folder of files such as smoke.0001.vdb")),
        }
    }

    /// True if a stage is to be rendered.
    ///
    /// # Errors
    /// If the input cannot be read.
    pub(crate) fn shows_stage(&self) -> Result<bool> {
        if sequence::pattern(&self.input).is_some() {
            return Ok(false);
        }
        Ok(matches!(volume::format_of(&self.input)?.kind, FileKind::Usd))
    }

    /// Returns the cameras of the pictures with what else a capture tells: those of `cameras`, or of the stage that
    /// is rendered, at the time codes `frames`, or all of them; `None` where cameras are to be placed. The files of
    /// `cameras` become inputs of the pictures.
    ///
    /// # Errors
    /// If there are no cameras, the capture or the stage cannot be read, or options contradict each other.
    pub(in crate::app) fn template(
        &self,
        frames: Option<&[u32]>,
        provenance: &mut Provenance,
    ) -> Result<Option<Capture>> {
        let refused = |option: &str, remedy: &str| {
            Err(Error::invalid(format!("{option} cannot be used here: no cameras of a USD stage are taken"))
                .hint(remedy))
        };
        let limits = self.limits;
        let stage = match &self.cameras {
            // Paths that cannot be read are those of captures, whose errors say what is looked for.
            Some(path) => {
                let is_stage = registry::sniff(path).is_ok_and(|format| matches!(format.kind, FileKind::Usd));
                is_stage.then(|| Stage::open(path, limits))
            }
            None if self.placed().is_none() && self.shows_stage()? => Some(self.stage(limits)),
            None => None,
        };
        let Some(stage) = stage.transpose()? else {
            if self.camera.is_some() {
                return refused("⟨camera⟩", "leave it out, or give a stage as the input or with ⟨cameras⟩");
            }
            let Some(path) = &self.cameras else { return Ok(None) };
            let capture = captures::load(path)?;
            provenance.files(captures::files(path).iter().map(PathBuf::as_path))?;
            return Ok(Some(self.resized(capture)));
        };
        if self.cameras.is_some() {
            provenance.files(stage.layers.iter().map(PathBuf::as_path))?;
        }
        // Frames before and after tell how the camera moves.
        let beside = |numbers: &[u32]| {
            let around = numbers.iter().flat_map(|n| [n.saturating_sub(1), *n, n.saturating_add(1)]);
            around.collect::<std::collections::BTreeSet<_>>().into_iter().collect()
        };
        let whole = if self.cameras.is_some() { None } else { Some(self.frame.into_iter().collect()) };
        let views = Views { camera: self.camera.as_deref(), size: self.size, frames: frames.map(beside).or(whole) };
        stage.capture(&views).map(Some)
    }

    /// Returns a capture with the size of pictures that the settings state, if they do.
    fn resized(&self, mut capture: Capture) -> Capture {
        if let Some(size) = self.size {
            for frame in &mut capture.frames {
                frame.camera = frame.camera.resized(size);
            }
        }
        capture
    }

    /// Refuses pictures for which no cameras are told.
    ///
    /// # Errors
    /// If there is no template, and `views` is not given.
    pub(in crate::app) fn check_cameras(&self, template: Option<&Capture>) -> Result<()> {
        if template.is_some() || self.placed().is_some() {
            return Ok(());
        }
        Err(Error::invalid("no cameras: one of ⟨views⟩ and ⟨cameras⟩ is required").hint(
            "give ⟨views=N⟩ to place cameras around the volume, one by ⟨from⟩, ⟨azimuth⟩ or ⟨eye⟩, or ⟨cameras⟩ \
                 with a capture or USD stage",
        ))
    }

    /// Opens the stage that is rendered.
    fn stage(&self, limits: Limits) -> Result<Stage> {
        Stage::open(&self.input, limits)
    }

    /// Reads the stage's scene at the frame.
    ///
    /// # Errors
    /// If a setting has no meaning for a stage, or the stage or one of its files cannot be used.
    pub(in crate::app) fn staged(&self, limits: Limits) -> Result<LoadedScene> {
        let overrides = self.overrides()?;
        let stage = self.stage(limits)?;
        let time = self.frame.map_or_else(|| stage.first_time(), f64::from);
        usd::scene::load(&stage, time, limits, &overrides)
    }

    /// Returns the properties of media that the settings state.
    fn overrides(&self) -> Result<Overrides> {
        let given = [
            ("⟨model⟩", self.model.is_some()),
            ("⟨density_scale=auto⟩", self.density_scale == Some(DensityScale::Auto)),
            ("⟨emission_model⟩", self.emission_model.is_some()),
            ("⟨grid⟩", self.grid.is_some()),
            ("⟨quadrature⟩", self.quadrature.is_some()),
            ("⟨supersample⟩", self.supersample > 1),
            ("⟨sun⟩ and ⟨sky⟩", self.scattering.lights()),
        ];
        if let Some((option, _)) = given.iter().find(|(_, given)| *given) {
            return Err(Error::invalid(format!("{option}: the stage states its own volumes and lights"))
                .at(&self.input)
                .hint(format!("leave {option} out, or render the VDB itself")));
        }
        let density_scale = match self.density_scale {
            Some(DensityScale::Given(scale)) => Some(scale),
            _ => None,
        };
        let scattering = self.scattering.overrides();
        let transfer = self.transfer.tf.as_deref().map(Path::to_path_buf);
        let transfer_options = self.transfer.options(self.limits);
        Ok(Overrides { density_scale, scattering, emission: self.emission, transfer, transfer_options })
    }
}
