//! Settings of the derivatives of a loss on pictures.

use crate::app::scan::ScanSettings;
use crate::app::transfer::TransferSettings;
use crate::app::up::UpChoice;
use crate::differentiate::loss::Loss;
use crate::differentiate::loss::prior::{Prior, Weighted};
use crate::differentiate::study::ad_mode::Mode;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::render::differentiable::Adjoint;
use crate::render::quadrature::Quadrature;
use crate::scene::capture::{EmissionModel, Model};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Settings of the derivatives of a loss on pictures of a volume, and of their check.
///
/// Pictures are those of cameras on a sphere, or are compared with those of a capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct GradientSettings {
    /// VDB, NanoVDB or scan to differentiate at.
    #[serde(with = "crate::app::paths")]
    pub input: PathBuf,
    /// Kinds of parameters to differentiate by.
    pub wrt: Vec<Wrt>,
    /// Loss, a mean over pixels and views.
    pub loss: LossName,
    /// Difference from which on [`LossName::Huber`] grows no faster.
    pub huber_delta: f64,
    /// Transmittance below which [`LossName::LogTransmittance`] asks for nothing.
    pub transmittance_floor: f64,
    /// Priors that are added to the loss; weights are in units of the largest density or extinction.
    pub prior: Vec<Weighted<Prior>>,
    /// Capture whose pictures are compared with, and whose cameras and light model are taken.
    #[serde(with = "crate::app::paths")]
    pub target: Option<PathBuf>,
    /// Number of cameras around the volume, from 1 to 100000, without a target; none for 1.
    pub views: Option<u32>,
    /// Axis that points upwards, about which cameras are placed.
    pub up: UpChoice,
    /// Model of the pictures; none for that of the target, emission-absorption with a transfer function or emission,
    /// else absorption.
    pub model: Option<Model>,
    /// Width and height in pixels of the pictures of cameras that are placed.
    pub size: [u32; 2],
    /// Extinction per world unit at a density of 1; none for that of the target, else 1.
    pub density_scale: Option<f64>,
    /// Radiance behind the volume; none for that of the target, else white for absorption, black for
    /// emission-absorption.
    pub background: Option<[f32; 3]>,
    /// Radiance of the source; none for that of the target.
    pub emission: Option<[f32; 3]>,
    /// How that radiance follows the density; none for the way of the target, else [`EmissionModel::Grey`].
    pub emission_model: Option<EmissionModel>,
    /// Transfer function that makes extinctions and colors of densities.
    #[serde(flatten)]
    pub transfer: TransferSettings,
    /// Integration along rays; pre-shaded volumes have one of their own.
    pub quadrature: Quadrature,
    /// Differentiation forward or backward.
    pub mode: Mode,
    /// How the backward pass gets at its samples; none for the way that suits the loss.
    pub adjoint: Option<Adjoint>,
    /// True to set a difference quotient beside each derivative, both in double precision.
    pub check: bool,
    /// Largest relative error of a derivative that agrees with its difference quotient.
    pub tolerance: f64,
    /// True to check every parameter that is listed, not only a sample of 24 of each kind.
    pub all: bool,
    /// Number of voxels to list, those of the largest derivatives, from 1 to 100000.
    pub largest: u32,
    /// Paths of a pixel, for [`Wrt::Albedo`]; none for 64.
    pub samples: Option<u32>,
    /// Seed of their random numbers; none for 0.
    pub seed: Option<u64>,
    /// VDB to write the derivatives by voxel to.
    #[serde(with = "crate::app::paths")]
    pub output: Option<PathBuf>,
    /// Folder of a page of pictures, slices and all that is listed.
    #[serde(with = "crate::app::paths")]
    pub report: Option<PathBuf>,
    /// Name of the grid; none for density, else the only scalar one.
    pub grid: Option<String>,
    /// Part of a scan that is read, and where its voxels lie.
    #[serde(flatten)]
    pub scan: ScanSettings,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

impl Default for GradientSettings {
    fn default() -> Self {
        Self {
            input: PathBuf::new(),
            wrt: Vec::new(),
            loss: LossName::default(),
            huber_delta: 0.1,
            transmittance_floor: 1e-4,
            prior: Vec::new(),
            target: None,
            views: None,
            up: UpChoice::Auto,
            model: None,
            size: [64; 2],
            density_scale: None,
            background: None,
            emission: None,
            emission_model: None,
            transfer: TransferSettings::default(),
            quadrature: Quadrature::Exact,
            mode: Mode::Auto,
            adjoint: None,
            check: false,
            tolerance: 1e-4,
            all: false,
            largest: 20,
            samples: None,
            seed: None,
            output: None,
            report: None,
            grid: None,
            scan: ScanSettings::default(),
            limits: Limits::default(),
        }
    }
}

/// Kind of parameters to differentiate by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Wrt {
    /// The quadrature's step, in voxels.
    Step,
    /// Position, rotation, focal lengths and principal point of each view.
    Camera,
    /// The transfer function's parameters.
    Tf,
    /// Every voxel's density, or extinction of a pre-shaded volume.
    Density,
    /// Every voxel's emission in red, green and blue, of a pre-shaded volume.
    Emission,
    /// Radiance behind the volume.
    Background,
    /// Extinction per unit of density.
    Extinction,
    /// Albedo of the medium, and its color by density, in pictures of scattered light.
    Albedo,
}

/// Name of a loss.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LossName {
    /// |c - c'|.
    L1,
    /// (c - c')².
    #[default]
    L2,
    /// Quadratic for small differences, linear for large ones.
    Huber,
    /// (ln T - ln T')² of the transmittances.
    LogTransmittance,
    /// 1 - SSIM of the colors.
    Ssim,
    /// Entropy of the alphas, 1 where all are equal.
    OpacityEntropy,
    /// The colors themselves.
    Mean,
}

impl LossName {
    /// Name of the loss in settings, such as `log-transmittance`.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::L1 => "l1",
            Self::L2 => "l2",
            Self::Huber => "huber",
            Self::LogTransmittance => "log-transmittance",
            Self::Ssim => "ssim",
            Self::OpacityEntropy => "opacity-entropy",
            Self::Mean => "mean",
        }
    }
}

impl GradientSettings {
    /// Paths that the derivatives are found from.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        [&self.input].into_iter().chain(&self.target).chain(&self.transfer.tf).map(PathBuf::as_path).collect()
    }

    /// Refuses settings that contradict each other, before anything is read.
    pub(in crate::app) fn fits_together(&self) -> Result<()> {
        let by = |w: Wrt| self.wrt.contains(&w);
        let inverts = self.adjoint == Some(Adjoint::Inversion);
        if self.quadrature.is_preintegrated() && self.check {
            return Err(Error::invalid(
                "⟨check⟩: values of pre-integration jump, by less than its tolerance, where segments begin to be \
                 divided",
            )
            .hint("check the derivatives of ⟨quadrature=exact⟩, which has difference quotients everywhere"));
        }
        if self.quadrature.is_preintegrated() && inverts {
            return Err(Error::unsupported("pre-integration has no ⟨adjoint=inversion⟩")
                .hint("exact is what it approaches: ⟨quadrature=exact⟩"));
        }
        if by(Wrt::Step) && self.quadrature.step().is_none() {
            return Err(Error::invalid(format!("⟨wrt=step⟩: the {} quadrature has no step", self.quadrature))
                .hint("choose one that has: ⟨quadrature=midpoint:0.5⟩ or riemann:0.5"));
        }
        if self.output.is_some() && !by(Wrt::Density) && !by(Wrt::Emission) {
            return Err(Error::invalid("⟨output⟩ is for derivatives by voxel, which ⟨wrt⟩ does not ask for")
                .hint("add density or emission to ⟨wrt⟩, or leave ⟨output⟩ out"));
        }
        if self.mode == Mode::Forward && self.adjoint.is_some() {
            return Err(Error::invalid("⟨mode=forward⟩ has no backward pass, ⟨adjoint⟩ says how to go backward")
                .hint("leave one of them out"));
        }
        if self.loss().compares() && self.target.is_none() {
            return Err(Error::invalid("this loss compares with pictures, and ⟨views⟩ has none")
                .hint("give pictures with ⟨target⟩, or use ⟨loss=mean⟩ or opacity-entropy"));
        }
        Ok(())
    }

    /// Returns the loss with its parameter.
    pub(super) fn loss(&self) -> Loss {
        match self.loss {
            LossName::L1 => Loss::L1,
            LossName::L2 => Loss::L2,
            LossName::Huber => Loss::Huber { delta: self.huber_delta },
            LossName::LogTransmittance => Loss::LogTransmittance { floor: self.transmittance_floor },
            LossName::Ssim => Loss::Dissimilarity { peak: 1.0 },
            LossName::OpacityEntropy => Loss::OpacityEntropy,
            LossName::Mean => Loss::Mean,
        }
    }
}
