//! What `cumulo gradient` differentiates: a scene and a loss, from the options and the target.

use super::{GradientCommand, Wrt};
use crate::cli::{photos, run, volume};
use crate::error::{Error, Result};
use crate::formats::transforms;
use crate::formats::vdb::Limits;
use crate::optimise::loss::Rgba;
use crate::optimise::study::{Setting, Study, Units};
use crate::real::Real;
use crate::scene::bricks::Bricks;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, EmissionModel, Model, PixelFilter};
use crate::scene::medium::Source;
use crate::scene::orbit::{self, Layout};
use crate::scene::transfer::Transfer;

impl GradientCommand {
    /// Scene and loss, from the options and, where they are silent, from the target.
    pub(super) fn study(&self, limits: Limits) -> Result<Study<f32>> {
        let target = self.target.as_deref().map(transforms::load).transpose()?;
        let (grid, carried) = volume::read(&self.input, self.grid.as_deref(), &self.transfer, limits)?;
        let transfer = self.transfer(carried, target.as_ref());
        if self.wrt.contains(&Wrt::Tf) && transfer.is_none() {
            return Err(Error::invalid("--wrt tf: there is no transfer function")
                .at(&self.input)
                .hint("give one with --tf, or leave tf out of --wrt"));
        }
        let mut field = volume::arrange(&grid, transfer.as_ref(), limits).map_err(|e| e.at(&self.input))?;
        if self.wrt.contains(&Wrt::Tf) {
            // A parameter may make empty space absorb: its derivative is there.
            field = field.filled(limits.max_memory).map_err(|e| e.at(&self.input))?;
        }
        let outline = field.outline();
        if outline.is_empty() && target.is_none() {
            return Err(Error::invalid("the grid is empty: there is nothing to place cameras around")
                .at(&self.input)
                .hint("choose another grid with --grid"));
        }
        let cameras = match (&target, self.views) {
            (Some(capture), _) => capture.frames.iter().map(|f| f.camera).collect(),
            (None, count) => {
                let [w, h] = self.size;
                orbit::cameras(&outline, count.unwrap_or(1) as usize, Layout::Sphere, w, h, 40.0)
            }
        };
        let wanted = match &target {
            Some(capture) if self.loss().compares() => photos::read(capture, None, limits)?
                .into_iter()
                .map(|photo| photo.film.rgba.iter().map(|p| p.map(f64::from)).collect::<Vec<Rgba>>())
                .collect(),
            _ => Vec::new(),
        };
        let largest = |value: f64| if value > 0.0 { value } else { 1.0 };
        let extinction = transfer.as_ref().map_or(Ok(0.0), |t| t.table().map(|table| table.peak()[3]))?;
        let study = Study {
            priors: self.prior.clone(),
            units: Units { density: largest(field.range().1.into()), extinction: largest(extinction) },
            field,
            setting: self.setting(cameras, transfer, target.as_ref())?,
            loss: self.loss(),
            wanted,
            rays_per_edge: run::rays_per_edge(target.as_ref().map_or(PixelFilter::Point, |c| c.pixel_filter)),
        };
        self.fits(&study, limits)?;
        Ok(study)
    }

    /// The function asked for, else that of the target, else the one that the grid carries; none with a
    /// source of its own.
    fn transfer(&self, found: Option<Transfer>, target: Option<&Capture>) -> Option<Transfer> {
        match target {
            _ if self.transfer.tf.is_some() => found,
            _ if self.emission.is_some() => None,
            Some(capture) => capture.transfer.clone().filter(|_| capture.model == Model::EmissionAbsorption),
            None => found,
        }
    }

    fn setting(&self, cameras: Vec<Camera>, transfer: Option<Transfer>, target: Option<&Capture>) -> Result<Setting> {
        let source = match (self.emission, target) {
            (Some(colour), _) if self.emission_model == Some(EmissionModel::Linear) => Source::Linear(colour),
            (Some(colour), _) => Source::Grey(colour),
            (None, Some(capture)) if transfer.is_none() => capture.medium()?.source,
            _ => Source::Grey([0.0; 3]),
        };
        let emits = transfer.is_some() || !matches!(source, Source::Grey([0.0, 0.0, 0.0]));
        let behind = if emits { [0.0; 3] } else { [1.0; 3] };
        Ok(Setting {
            cameras,
            extinction: self.density_scale.or(target.map(|c| c.density_scale)).unwrap_or(1.0),
            source,
            transfer,
            background: self.background.or(target.map(|c| c.background)).unwrap_or(behind),
            quadrature: self.quadrature,
        })
    }

    /// Refuses what could not be held in memory.
    fn fits(&self, study: &Study<f32>, limits: Limits) -> Result<()> {
        let largest = study.setting.cameras.iter().map(|c| u64::from(c.width) * u64::from(c.height)).max();
        let copies = if self.wrt.contains(&Wrt::Density) { 8 } else { 1 };
        let size = if self.check { size_of::<f64>() } else { size_of::<f32>() };
        // A picture with seven derivatives and the loss's, the voxels and a gradient for each lane.
        let bytes = largest.unwrap_or(0) * 384 + (study.field.values.len() * copies * size) as u64;
        if bytes > limits.max_memory {
            return Err(Error::unsupported(format!(
                "needs {} MiB in memory, {} MiB are allowed",
                bytes >> 20,
                limits.max_memory >> 20
            ))
            .at(&self.input)
            .hint("raise --max-memory, choose a smaller --size, or reduce the grid with `cumulo convert --resample`"));
        }
        Ok(())
    }
}

/// The same in double precision.
pub(super) fn in_double(study: Study<f32>) -> Study<f64> {
    let Study { field, setting, loss, priors, units, wanted, rays_per_edge } = study;
    let Bricks { topology, values, transform, domain } = field;
    let values = values.into_iter().map(Real::f64).collect();
    let field = Bricks { topology, values, transform, domain };
    Study { field, setting, loss, priors, units, wanted, rays_per_edge }
}
