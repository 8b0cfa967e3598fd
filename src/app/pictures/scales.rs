//! Density scales that pictures are made with, for reports.

use super::subject::Subject;
use serde::Serialize;
use std::fmt;

/// Extinctions per unit of density and length.
#[derive(Debug, Clone, Default, PartialEq, Serialize, schemars::JsonSchema)]
pub(in crate::app) struct DensityScales {
    /// Extinction per unit of density and length; none for a scene whose volumes have different ones.
    density_scale: Option<f64>,
    /// Density scales of the volumes of a scene file or a stage, in their order.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    density_scales: Vec<f64>,
}

impl DensityScales {
    /// Creates the scale of pictures that have one.
    pub(crate) fn one(scale: f64) -> Self {
        Self { density_scale: Some(scale), density_scales: Vec::new() }
    }

    /// Returns the scales of a subject's pictures: those of a scene's media, else `scale`.
    pub(crate) fn of(subject: &Subject, scale: f64) -> Self {
        let Subject::Scene { scene, .. } = subject else { return Self::one(scale) };
        let scales: Vec<f64> =
            scene.volumes.iter().filter_map(|volume| volume.density()).map(|(_, medium)| medium.extinction).collect();
        match scales.first().filter(|first| scales.iter().all(|scale| scale == *first)) {
            Some(first) => Self::one(*first),
            None => Self { density_scale: None, density_scales: scales },
        }
    }

    /// Returns the scale where there is one.
    pub(crate) fn single(&self) -> Option<f64> {
        self.density_scale
    }
}

impl fmt::Display for DensityScales {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.density_scale, &self.density_scales[..]) {
            (Some(scale), _) => write!(f, "density scale {scale}"),
            (None, []) => f.write_str("density scales of the scene"),
            (None, scales) => {
                let listed = scales.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
                write!(f, "density scales {listed}")
            }
        }
    }
}
