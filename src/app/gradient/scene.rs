//! The scene and the loss that is differentiated, from the settings and the target.

use super::{GradientSettings, Wrt};
use crate::app::Context;
use crate::app::checks::pictures::PictureFacts;
use crate::app::checks::{self, Emission, Warning, values};
use crate::app::up::ChosenUp;
use crate::app::{photos, run, volume};
use crate::differentiate::loss::Rgba;
use crate::differentiate::study::Study;
use crate::differentiate::study::setting::{Setting, Units};
use crate::differentiate::study::subject::{Subject, depth_channel, largest};
use crate::error::{Code, Error, Result};
use crate::formats::captures;
use crate::inverse::observation::photo::Photo;
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::Bricks;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, EmissionModel, Model, PixelFilter};
use crate::scene::medium::Source;
use crate::scene::orbit::{self, Layout};
use crate::scene::transfer::Transfer;
use crate::scene::volume::{Grids, scale};

/// Target, model, transfer function and cameras that go with the voxels.
#[derive(Debug)]
pub(in crate::app) struct Setup {
    target: Option<Capture>,
    model: Option<Model>,
    transfer: Option<Transfer>,
    cameras: Vec<Camera>,
    /// Warning that the values do not meet the transfer function.
    unmet: Option<Warning>,
    /// Up axis about which cameras were placed; none where the target states them.
    pub up: Option<ChosenUp>,
}

impl GradientSettings {
    /// Reads the volume, and takes what goes with it from the settings and, where they are silent, from the target.
    pub(in crate::app) fn scene(&self) -> Result<(Grids, Setup)> {
        let target = self.target.as_deref().map(captures::load).transpose()?;
        let emits = self.transfer.tf.is_some() || self.emission.is_some();
        let model = self.model.or(emits.then_some(Model::EmissionAbsorption)).or(target.as_ref().map(|c| c.model));
        let (scene, transfer) = match model {
            Some(Model::PreShaded) => (self.pre_shaded(target.as_ref())?, None),
            model => self.density(model, target.as_ref())?,
        };
        let outline = scene.density_or_extinction().outline();
        if outline.is_empty() && target.is_none() {
            return Err(Error::invalid("the grid is empty: there is nothing to place cameras around")
                .coded(Code::EmptyGrid)
                .at(&self.input)
                .hint("choose another grid with ⟨grid⟩"));
        }
        let unmet = match (&scene, &transfer) {
            (Grids::Density(field), Some(transfer)) => values::unmet(field, transfer, self.transfer.unit()),
            _ => None,
        };
        let up = target.is_none().then(|| self.up.of(&self.input, self.limits)).transpose()?;
        let cameras = match (&target, &up) {
            (Some(capture), _) => capture.frames.iter().map(|f| f.camera).collect(),
            (None, up) => {
                let ([w, h], axis) = (self.size, up.as_ref().map(|up| up.axis).unwrap_or_default());
                orbit::cameras(&outline, self.views.unwrap_or(1) as usize, Layout::Sphere, w, h, 40.0, axis)
            }
        };
        Ok((scene, Setup { target, model, transfer, cameras, unmet, up }))
    }

    fn pre_shaded(&self, target: Option<&Capture>) -> Result<Grids> {
        let unsuited = [
            (self.wrt.contains(&Wrt::Tf), "⟨wrt=tf⟩: a pre-shaded volume has no transfer function"),
            (
                self.wrt.contains(&Wrt::Extinction),
                "⟨wrt=extinction⟩: the extinctions of a pre-shaded volume are its voxels",
            ),
            (self.emission.is_some(), "⟨emission⟩: the emissions of a pre-shaded volume are its voxels"),
            (self.quadrature != Quadrature::Exact, "⟨quadrature⟩: pre-shaded volumes have one of their own"),
        ];
        if let Some((_, what)) = unsuited.into_iter().find(|(given, _)| *given) {
            return Err(Error::invalid(what).at(&self.input).hint(
                "of a pre-shaded volume there are ⟨wrt=density⟩, emission, camera and background; ⟨model⟩ says what \
                 else the volume could be",
            ));
        }
        let mut scene = volume::read_pre_shaded(&self.input, self.grid.as_deref(), &self.scan, self.limits)?;
        if let Grids::EmissionExtinction(volume) = &mut scene {
            let shown = target.filter(|c| c.model == Model::PreShaded).map(|c| c.density_scale);
            scale(volume, self.density_scale.or(shown).unwrap_or(1.0)).map_err(|e| e.at(&self.input))?;
        }
        Ok(scene)
    }

    fn density(&self, model: Option<Model>, target: Option<&Capture>) -> Result<(Grids, Option<Transfer>)> {
        if self.wrt.contains(&Wrt::Emission) {
            return Err(Error::invalid("⟨wrt=emission⟩: only pre-shaded volumes have emissions of their own")
                .at(&self.input)
                .hint("add ⟨model=pre-shaded⟩, or leave emission out of ⟨wrt⟩"));
        }
        if self.emission.is_some() && self.model == Some(Model::Absorption) {
            return Err(
                Error::invalid("⟨emission⟩: with ⟨model=absorption⟩ nothing is emitted").hint("leave one of them out")
            );
        }
        let (grid, loaded) =
            volume::read(&self.input, self.grid.as_deref(), (&self.scan, &self.transfer), self.limits)?;
        let transfer = self.transfer(loaded, model, target);
        if self.wrt.contains(&Wrt::Tf) && transfer.is_none() {
            return Err(Error::invalid("⟨wrt=tf⟩: there is no transfer function")
                .at(&self.input)
                .hint("give one with ⟨tf⟩, or leave tf out of ⟨wrt⟩"));
        }
        let mut field =
            volume::arrange_by_voxel(&grid, transfer.as_ref(), self.limits).map_err(|e| e.at(&self.input))?;
        if self.wrt.contains(&Wrt::Tf) {
            // A parameter may make empty space absorb: its derivative is there.
            field = field.filled(self.limits.max_memory).map_err(|e| e.at(&self.input))?;
        }
        Ok((Grids::Density(field), transfer))
    }

    /// Returns scene and loss, with warnings about pictures that contradict the model.
    pub(in crate::app) fn study<V: Subject>(
        &self,
        field: Bricks<V>,
        setup: Setup,
        context: &Context,
    ) -> Result<(Study<V>, Vec<Warning>)> {
        let Setup { target, model, transfer, cameras, unmet, .. } = setup;
        let mut warnings: Vec<Warning> = unmet.into_iter().collect();
        let targets = match &target {
            Some(capture) if self.loss().compares() => {
                let bar = context.steps(capture.frames.len() as u64, "reading pictures");
                // What the settings say otherwise is what is differentiated at.
                let background = self.background.unwrap_or(capture.background);
                let shown =
                    Capture { background, emission: self.emission.unwrap_or(capture.emission), ..capture.clone() };
                let take = |photo: Photo| {
                    let target: Vec<Rgba> = photo.film.rgba.iter().map(|p| p.map(f64::from)).collect();
                    (PictureFacts::new(&photo, &shown, Emission::Stated), target)
                };
                let read = photos::each(capture, None, self.limits, photos::WHOLE, &|| bar.inc(1), take)?;
                drop(bar);
                let (facts, targets): (Vec<PictureFacts>, Vec<Vec<Rgba>>) = read.into_iter().unzip();
                warnings.extend(checks::warnings(checks::pictures::pictures(&facts, &shown, Emission::Stated)));
                targets
            }
            _ => Vec::new(),
        };
        context.warn(&warnings);
        let peak = transfer.as_ref().map_or(Ok(0.0), |t| t.table().map(|table| table.peak()[3]))?;
        let study = Study {
            priors: self.prior.clone(),
            units: Units {
                density: largest(&field, depth_channel::<V>()),
                extinction: if peak > 0.0 { peak } else { 1.0 },
            },
            field,
            setting: self.setting(cameras, model, transfer, target.as_ref())?,
            loss: self.loss(),
            targets,
            rays_per_edge: run::rays_per_edge(target.as_ref().map_or(PixelFilter::Point, |c| c.pixel_filter)),
            cancel: context.cancel(),
        };
        self.fits(&study)?;
        Ok((study, warnings))
    }

    /// Chooses the transfer function: `loaded` if it is that of the settings, else the target's, else the one that the
    /// grid carries, which is `loaded` then; none where the emission or the model has another source.
    fn transfer(&self, loaded: Option<Transfer>, model: Option<Model>, target: Option<&Capture>) -> Option<Transfer> {
        let shown = target.filter(|c| c.model == Model::EmissionAbsorption);
        match model {
            _ if self.transfer.tf.is_some() => loaded,
            _ if self.emission.is_some() => None,
            Some(Model::EmissionAbsorption) if shown.is_some() => shown.and_then(|c| c.transfer.clone()),
            Some(Model::EmissionAbsorption) | None => loaded,
            _ => None,
        }
    }

    fn setting(
        &self,
        cameras: Vec<Camera>,
        model: Option<Model>,
        transfer: Option<Transfer>,
        target: Option<&Capture>,
    ) -> Result<Setting> {
        let source = match (self.emission, model, target) {
            _ if transfer.is_some() => Source::Grey([0.0; 3]),
            (Some(color), ..) if self.emission_model == Some(EmissionModel::Linear) => Source::Linear(color),
            (Some(color), ..) => Source::Grey(color),
            (None, Some(Model::EmissionAbsorption), Some(capture)) if capture.model == Model::EmissionAbsorption => {
                capture.medium()?.source
            }
            (None, Some(Model::EmissionAbsorption), _) => Source::Grey([1.0; 3]),
            _ => Source::Grey([0.0; 3]),
        };
        let absorbs = transfer.is_none() && matches!(source, Source::Grey([0.0, 0.0, 0.0]));
        let default_background = if absorbs && model != Some(Model::PreShaded) { [1.0; 3] } else { [0.0; 3] };
        Ok(Setting {
            cameras,
            extinction: self.density_scale.or(target.map(|c| c.density_scale)).unwrap_or(1.0),
            source,
            transfer,
            background: self.background.or(target.map(|c| c.background)).unwrap_or(default_background),
            quadrature: self.quadrature,
        })
    }

    /// Refuses pictures and voxels that do not fit in memory with their derivatives.
    fn fits<V: Subject>(&self, study: &Study<V>) -> Result<()> {
        let largest = study.setting.cameras.iter().map(|c| u64::from(c.width) * u64::from(c.height)).max();
        let copies = if self.channels::<V>().is_empty() { 1 } else { 8 };
        let size = if self.check { size_of::<V::Double>() } else { size_of::<V>() };
        // A picture with seven derivatives and the loss's, the voxels and a gradient for each accumulator.
        let bytes = largest.unwrap_or(0) * 384 + (study.field.values.len() * copies * size) as u64;
        if bytes > self.limits.max_memory {
            return Err(Error::unsupported(format!(
                "needs {} MiB in memory, {} MiB are allowed",
                bytes >> 20,
                self.limits.max_memory >> 20
            ))
            .at(&self.input)
            .hint("raise ⟨max_memory⟩, choose a smaller ⟨size⟩, or reduce the grid with ⟨convert.resample⟩"));
        }
        Ok(())
    }
}

/// Converts a study to double precision.
pub(in crate::app) fn in_double<V: Subject>(study: Study<V>) -> Study<V::Double> {
    let Study { field, setting, loss, priors, units, targets, rays_per_edge, cancel } = study;
    let Bricks { topology, values, background, reference, transform, domain } = field;
    let (values, background) = (values.into_iter().map(Subject::double).collect(), background.double());
    let field = Bricks { topology, values, background, reference, transform, domain };
    Study { field, setting, loss, priors, units, targets, rays_per_edge, cancel }
}
