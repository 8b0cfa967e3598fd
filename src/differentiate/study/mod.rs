//! A scene and a loss whose gradient is computed parameter by parameter; [`difference`]
//! checks it.

pub mod ad_mode;
pub mod difference;
pub mod parameter;
pub mod setting;
pub mod subject;

use crate::cancel::Cancel;
use crate::differentiate::gradient::objective::Objective;
use crate::differentiate::loss::prior::{Prior, Weighted};
use crate::differentiate::loss::{Loss, Rgba};
use crate::differentiate::study::ad_mode::AdMode;
use crate::differentiate::study::subject::{Subject, depth_channel};
use crate::error::{Error, Result};
use crate::scene::bricks::Bricks;
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::neighbours::Neighbours;
use crate::scene::transfer::Transfer;
use parameter::Parameter;
use setting::{Setting, Units};

/// A scene and a loss.
#[derive(Debug, Clone)]
pub struct Study<V> {
    /// The voxels.
    pub field: Bricks<V>,
    /// Medium, cameras and quadrature.
    pub setting: Setting,
    /// The loss of the pictures.
    pub loss: Loss,
    /// Priors that are added to the loss of the pictures.
    pub priors: Vec<Weighted<Prior>>,
    /// Units of the priors.
    pub units: Units,
    /// Target pictures, row-major, one per camera; none for losses that compare with nothing.
    pub targets: Vec<Vec<Rgba>>,
    /// A pixel is the mean over the square of so many rays.
    pub rays_per_edge: usize,
    /// Flag that stops the work.
    pub cancel: Cancel,
}

/// Value of a loss, and its derivatives by parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct StudyGradient {
    /// The loss.
    pub value: f64,
    /// In the order of the parameters.
    pub derivatives: Vec<f64>,
    /// Derivatives by owned voxel, 512 a brick, and in each by the requested channels.
    pub by_voxel: Vec<f64>,
}

/// Priors with their derivatives.
#[derive(Debug, Default)]
struct PriorGradient {
    value: f64,
    by_transfer: Vec<f64>,
    by_density: Vec<f64>,
}

impl<V: Subject> Study<V> {
    /// The loss on its pictures.
    pub fn objective(&self) -> Objective<'_> {
        Objective {
            loss: self.loss,
            cameras: &self.setting.cameras,
            targets: &self.targets,
            rays_per_edge: self.rays_per_edge,
            cancel: &self.cancel,
        }
    }

    /// Returns what was computed, unless the work was cancelled meanwhile.
    fn whole<T>(&self, computed: T) -> Result<T> {
        if self.cancel.requested() { Err(Error::cancelled()) } else { Ok(computed) }
    }

    /// Number of voxels that bricks own.
    pub fn voxels(&self) -> usize {
        self.field.topology.len() * LEAF_VOXELS
    }

    /// The loss, with its priors.
    ///
    /// # Errors
    /// As [`Subject::renderer`], if a prior does not suit the transfer function, or the work was cancelled.
    pub fn value(&self) -> Result<f64> {
        let value = self.objective().value(&V::renderer(&self.field, &self.setting)?);
        self.whole(value + self.prior_gradient()?.value)
    }

    /// The priors, by parameter of the transfer function and by owned voxel's density; empty without priors on them.
    fn prior_gradient(&self) -> Result<PriorGradient> {
        let mut all = PriorGradient::default();
        for Weighted { prior, weight } in &self.priors {
            match (prior, &self.setting.transfer) {
                (Prior::Volume(prior), _) => {
                    let (density, reference) = (|v: V| v.channel(depth_channel::<V>()), self.field.reference);
                    let scaled: Vec<f64> =
                        self.field.owned().into_iter().map(|v| (reference + density(v)) / self.units.density).collect();
                    let neighbours = Neighbours::new(&self.field.topology);
                    let mut by = vec![0.0; scaled.len()];
                    all.value += prior.add(*weight, &scaled, &neighbours, scaled.len(), &mut by);
                    all.by_density.resize(by.len(), 0.0);
                    all.by_density.iter_mut().zip(by).for_each(|(sum, by)| *sum += by / self.units.density);
                }
                (Prior::Transfer(prior), Some(transfer)) => {
                    let (value, by) = prior.evaluate_transfer(transfer, self.units.extinction)?;
                    all.value += weight * value;
                    all.by_transfer.resize(by.len(), 0.0);
                    all.by_transfer.iter_mut().zip(by).for_each(|(sum, by)| *sum += weight * by);
                }
                (Prior::Transfer(_), None) => {
                    return Err(Error::invalid("there is no transfer function for the prior")
                        .hint("give one with ⟨tf⟩, or leave the prior out"));
                }
            }
        }
        Ok(all)
    }

    /// The loss and its derivatives by the parameters, and by these channels of all voxels.
    ///
    /// # Errors
    /// As [`Subject::renderer`].
    pub fn gradient(&self, mode: AdMode, parameters: &[Parameter], channels: &[usize]) -> Result<StudyGradient> {
        let gradient = self.of_pictures(mode, parameters, channels)?;
        let (mut gradient, prior_gradient) = (self.whole(gradient)?, self.prior_gradient()?);
        gradient.value += prior_gradient.value;
        for (derivative, parameter) in gradient.derivatives.iter_mut().zip(parameters) {
            *derivative += match parameter {
                Parameter::Transfer(i) => prior_gradient.by_transfer.get(*i).copied().unwrap_or(0.0),
                Parameter::Voxel { voxel, channel } if *channel == depth_channel::<V>() => {
                    prior_gradient.by_density.get(*voxel).copied().unwrap_or(0.0)
                }
                _ => 0.0,
            };
        }
        if let Some(at) = channels.iter().position(|c| *c == depth_channel::<V>()) {
            let densities = gradient.by_voxel.iter_mut().skip(at).step_by(channels.len());
            densities.zip(prior_gradient.by_density).for_each(|(sum, by)| *sum += by);
        }
        Ok(gradient)
    }

    fn of_pictures(&self, mode: AdMode, parameters: &[Parameter], channels: &[usize]) -> Result<StudyGradient> {
        let (renderer, transfer) = (V::renderer(&self.field, &self.setting)?, self.setting.transfer.as_ref());
        let objective = self.objective();
        let topology = &self.field.topology;
        match mode {
            AdMode::Reverse(adjoint) => {
                let knots = transfer.map(|t| Ok::<_, Error>(t.table()?.knots().len())).transpose()?;
                let active = parameter::active_parameters(parameters, !channels.is_empty(), knots);
                let gradient = objective.adjoint(&renderer, adjoint, active);
                let has_table = !gradient.table.pieces.is_empty();
                let by_transfer =
                    transfer.filter(|_| has_table).map_or(Ok(Vec::new()), |t| t.chain(&gradient.table))?;
                let by_voxel = if channels.is_empty() {
                    Vec::new()
                } else {
                    let stored: Vec<V::Double> = gradient.voxels.iter().map(|v| v.double()).collect();
                    let mut owned = vec![V::Double::default(); self.voxels()];
                    topology.gather_apron(&stored, &mut owned);
                    owned.into_iter().flat_map(|v| channels.iter().map(move |c| v.channel(*c))).collect()
                };
                let of = |p: &Parameter| parameter::derivative(&gradient, topology, &by_transfer, *p);
                Ok(StudyGradient { value: gradient.value, derivatives: parameters.iter().map(of).collect(), by_voxel })
            }
            AdMode::Forward => {
                let voxel = |voxel| channels.iter().map(move |channel| Parameter::Voxel { voxel, channel: *channel });
                let all = parameters.iter().copied().chain((0..self.voxels()).flat_map(voxel));
                let directions: Vec<_> =
                    all.map(|p| parameter::direction(p, &self.field, transfer)).collect::<Result<_>>()?;
                let (value, mut derivatives) = objective.tangent(&renderer, &directions);
                let by_voxel = derivatives.split_off(parameters.len());
                Ok(StudyGradient { value, derivatives, by_voxel })
            }
        }
    }

    /// Names of parameters, those of the groups whose derivatives are of one kind, and values.
    pub fn described(&self, parameters: &[Parameter]) -> Vec<(String, &'static str, f64)> {
        let transfer = self.setting.transfer.as_ref().map_or_else(Vec::new, Transfer::parameters);
        parameters.iter().map(|p| self.describe(*p, &transfer)).collect()
    }

    fn describe(&self, parameter: Parameter, transfer: &[(String, f64)]) -> (String, &'static str, f64) {
        let setting = &self.setting;
        match parameter {
            Parameter::Step => ("step".into(), "step", setting.quadrature.step().unwrap_or(0.0)),
            Parameter::Camera { view, part } => {
                let (name, value) = (parameter::CAMERA[part], parameter::camera_value(&setting.cameras[view], part));
                (format!("camera[{view}].{name}"), name.split('.').next().unwrap_or(name), value)
            }
            Parameter::Transfer(i) => {
                let (name, value) = &transfer[i];
                let group = match name.rsplit('.').next() {
                    Some("density" | "mean") => "tf.density",
                    Some("ln_width") => "tf.width",
                    Some("extinction") => "tf.extinction",
                    _ => "tf.color",
                };
                (format!("tf.{name}"), group, *value)
            }
            Parameter::Voxel { voxel, channel } => {
                let topology = &self.field.topology;
                let (at, slots) = (parameter::coordinates(topology, voxel), topology.slots(voxel));
                let value =
                    slots[0].map_or(0.0, |slot| self.field.reference + self.field.values[slot].channel(channel));
                let name = V::CHANNELS[channel];
                let group = name.split('.').next().unwrap_or(name);
                (format!("{name}[{},{},{}]", at.x, at.y, at.z), group, value)
            }
            Parameter::Background(c) => {
                (format!("background.{}", ["red", "green", "blue"][c]), "background", setting.background[c].into())
            }
            Parameter::Extinction => ("extinction".into(), "extinction", setting.extinction),
        }
    }
}
