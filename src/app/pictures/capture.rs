//! The capture of pictures: cameras, model and medium from the settings and, where they are silent, from
//! `cameras`.

use super::scales::DensityScales;
use super::scattering::recorded;
use super::settings::DensityScale;
use super::settings::PictureSettings;
use super::subject::Subject;
use crate::app::up::ChosenUp;
use crate::error::{Code, Error, Result};
use crate::formats::{captures, transforms};
use crate::render::scale;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, EmissionModel, Frame, Model, PixelFilter};
use crate::scene::medium::Source;
use crate::scene::transfer::Transfer;
use crate::scene::up::Up;
use crate::scene::volume::Grids;
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

/// Cameras where no capture states them.
#[derive(Debug, Clone, Copy)]
pub(in crate::app) enum Cameras<'c> {
    /// Cameras around the subject, which stand upright with respect to this axis.
    Around(Up),
    /// One camera, which is there already: the subject may be empty.
    Settled(&'c Camera),
}

impl Cameras<'_> {
    /// Returns cameras around the subject by the axis that was chosen; none where a capture states the cameras.
    pub(crate) fn around(up: Option<&ChosenUp>) -> Self {
        Self::Around(up.map_or(Up::default(), |up| up.axis))
    }
}

impl PictureSettings {
    /// Returns the up axis about which cameras are to be placed; `None` where `template` states the cameras.
    ///
    /// # Errors
    /// If the input has to be asked and cannot be read.
    pub(in crate::app) fn chosen_up(&self, template: Option<&Capture>) -> Result<Option<ChosenUp>> {
        template.is_none().then(|| self.up.of(&self.input, self.limits)).transpose()
    }

    /// Returns the capture of what the settings tell. `picture` returns the path of a picture from its name in a
    /// folder, and `cameras` says which cameras there are where `template` states none.
    pub(in crate::app) fn capture(
        &self,
        picture: impl Fn(&str) -> PathBuf,
        subject: &Subject,
        transfer: Option<Transfer>,
        template: Option<&Capture>,
        cameras: Cameras<'_>,
    ) -> Result<Capture> {
        let (cameras, settled) = match cameras {
            Cameras::Settled(camera) if template.is_none() => (vec![*camera], true),
            Cameras::Settled(_) => (self.views_of(subject, transfer.as_ref(), template, Up::default())?, false),
            Cameras::Around(up) => (self.views_of(subject, transfer.as_ref(), template, up)?, false),
        };
        let density_scale = self.scale(subject, transfer.as_ref(), template, &cameras)?;
        let model = self.model_of(subject, transfer.is_some(), template)?;
        let scatters = model == Model::Scattering;
        // A camera that is settled is that of the part of the picture already.
        let part = |camera: Camera| if settled { Ok(camera) } else { self.cropped(camera) };
        let frame = |i: usize| Ok(Frame { camera: part(cameras[i])?, picture: picture(&format!("view_{i:03}.exr")) });
        let frames = self.chosen(cameras.len())?.into_iter().map(frame).collect::<Result<Vec<_>>>()?;
        let template = template.filter(|_| !scatters);
        // The other model's background would be a surprise: white light behind a bright source.
        let same_model = template.filter(|c| (c.model == Model::Absorption) == (model == Model::Absorption));
        let default_background = match (model, subject) {
            (_, Subject::Scene { scene, .. }) => scene.environment.radiance,
            (Model::Absorption, _) => [1.0; 3],
            (Model::Scattering, _) => self.scattering.sky(),
            (Model::EmissionAbsorption | Model::PreShaded, _) => [0.0; 3],
        };
        let default_emission = if scatters { [0.0; 3] } else { [1.0; 3] };
        Ok(Capture {
            frames,
            model,
            background: self.background.or(same_model.map(|c| c.background)).unwrap_or(default_background),
            pixel_filter: if self.supersample > 1 || scatters { PixelFilter::Box } else { PixelFilter::Point },
            density_scale,
            emission: self.emission.or(template.map(|c| c.emission)).unwrap_or(default_emission),
            emission_model: self.emission_model.or(template.map(|c| c.emission_model)).unwrap_or(EmissionModel::Grey),
            transfer,
            lattice: subject.lattice(),
            color_space: None,
            pictures: None,
            remarks: Vec::new(),
        })
    }

    /// Returns a capture as it is written: shaded surfaces are no emission, and their pictures count as those of a
    /// medium that scatters, of which alpha alone tells the densities.
    pub(in crate::app) fn recorded_as(&self, capture: &Capture, extra: &mut Map<String, Value>) -> Capture {
        let Some(shading) = self.shade else { return capture.clone() };
        extra.insert("shading".into(), json!({"terms": shading, "gradient_scale": self.scattering.gradient_scale}));
        Capture { model: Model::Scattering, ..capture.clone() }
    }

    /// Returns the numbers of the views that are rendered, of `count`: those of `view`, else all.
    ///
    /// # Errors
    /// If there is no view of a number.
    pub(in crate::app) fn chosen(&self, count: usize) -> Result<Vec<usize>> {
        if self.view.is_empty() {
            return Ok((0..count).collect());
        }
        let numbers: BTreeSet<usize> = self.view.iter().flat_map(|range| range.numbers()).map(|n| n as usize).collect();
        match numbers.last() {
            Some(last) if *last >= count => Err(Error::invalid(format!("⟨view={last}⟩: there are {count} views"))
                .hint("views count from 0; give numbers and ranges such as 0,4-7")),
            _ => Ok(numbers.into_iter().collect()),
        }
    }

    /// Returns the camera of the part of a picture that is rendered.
    pub(in crate::app) fn cropped(&self, camera: Camera) -> Result<Camera> {
        self.crop.map_or(Ok(camera), |window| camera.cropped(window))
    }

    /// Returns the cameras: those of `cameras`, else new ones around the subject.
    fn views_of(
        &self,
        subject: &Subject,
        transfer: Option<&Transfer>,
        template: Option<&Capture>,
        up: Up,
    ) -> Result<Vec<Camera>> {
        if let Some(capture) = template {
            return Ok(capture.frames.iter().map(|f| f.camera).collect());
        }
        let outline = subject.outline(transfer);
        if outline.is_empty() {
            return Err(Error::invalid("the grid is empty: there is nothing to place cameras around")
                .coded(Code::EmptyGrid)
                .at(&self.input)
                .hint("choose another grid with ⟨grid⟩, or give the cameras with ⟨cameras⟩"));
        }
        Ok(self.place(&outline, up))
    }

    /// Returns the extinction per unit of density and length: that of the media of a scene, 1 where they differ.
    fn scale(
        &self,
        subject: &Subject,
        transfer: Option<&Transfer>,
        template: Option<&Capture>,
        cameras: &[Camera],
    ) -> Result<f64> {
        let Subject::Grids { grids, .. } = subject else {
            return Ok(DensityScales::of(subject, 1.0).single().unwrap_or(1.0));
        };
        match (self.density_scale, template) {
            (Some(DensityScale::Given(scale)), _) => Ok(scale),
            (Some(DensityScale::Auto), _) => {
                let source = match transfer {
                    Some(transfer) => Source::Transfer(Arc::new(transfer.table()?)),
                    None => Source::Grey([0.0; 3]),
                };
                scale::density_scale(&grids.density_or_extinction(), &source, cameras).ok_or_else(|| {
                    Error::invalid("no pixel meets any density, so that no scale can be found")
                        .at(&self.input)
                        .hint("check the grid and the cameras, or give the scale as a number")
                })
            }
            // A pre-shaded volume's extinctions are those of the pictures that it explains.
            (None, Some(capture)) if matches!(grids, Grids::Density(_)) || capture.model == Model::PreShaded => {
                Ok(capture.density_scale)
            }
            (None, _) => Ok(1.0),
        }
    }

    /// Returns the settings of the albedo and the lights that the capture of `cameras` records.
    fn recorded(&self) -> Option<String> {
        let json = captures::file(self.cameras.as_deref()?);
        let root = transforms::read_object(&json, self.limits).ok()?;
        recorded(root.get("scattering")?)
    }

    /// Says that the lights that the capture of `cameras` records are not taken, where others light the volume.
    pub(in crate::app) fn other_light(&self) -> Option<String> {
        let options = self.recorded().filter(|_| self.scattering.on() && !self.scattering.lights())?;
        Some(format!(
            "the volume is lit by a white sky: ⟨cameras⟩ gives no lights; those that it records are: {options}"
        ))
    }

    /// Returns the light model.
    fn model_of(&self, subject: &Subject, by_function: bool, template: Option<&Capture>) -> Result<Model> {
        if self.scattering.on() || subject.is_scene() {
            return Ok(Model::Scattering);
        }
        let of_volume = match subject {
            Subject::Grids { grids: Grids::EmissionExtinction(_), .. } => Some(Model::PreShaded),
            _ => by_function.then_some(Model::EmissionAbsorption),
        };
        match self.model.or(of_volume).or(template.map(|c| c.model)) {
            Some(Model::Scattering) => {
                let recorded = self.recorded().map(|options| format!(" (those that ⟨cameras⟩ records are: {options})"));
                let recorded = recorded.unwrap_or_default();
                Err(Error::invalid("the model is scattering, and no albedo is given")
                    .hint(format!("give ⟨albedo⟩ and the lights{recorded}, or choose another ⟨model⟩")))
            }
            model => Ok(model.unwrap_or(Model::Absorption)),
        }
    }
}
