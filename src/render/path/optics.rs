//! Extinction and source by density, one type for each kind of medium: what a medium does not do costs nothing in the
//! kernels that are made of them.

use crate::render::curve::Curve;
use crate::scene::albedo::AlbedoFunction;
use crate::scene::medium::{Medium, Source};
use glam::Vec3;
use std::sync::Arc;

/// Extinction and source of a medium by its density.
pub(super) trait DensityMedium: Sync + Send {
    /// False if the source is black for every density.
    const EMITS: bool;
    /// Returns the extinction per world length.
    fn extinction(&self, density: f32) -> f32;
    /// Returns the radiance of the source.
    fn source(&self, density: f32) -> Vec3;
    /// Returns the share of the extinction that is scattered, where the volume has this albedo.
    #[inline(always)]
    fn albedo(&self, _: f32, of_volume: Vec3) -> Vec3 {
        of_volume
    }
}

/// A medium without emission, whose extinction is proportional to the density.
pub(super) struct Dark {
    /// Extinction per unit of density.
    pub extinction: f32,
}

impl DensityMedium for Dark {
    const EMITS: bool = false;

    #[inline(always)]
    fn extinction(&self, density: f32) -> f32 {
        self.extinction * density
    }

    #[inline(always)]
    fn source(&self, _: f32) -> Vec3 {
        Vec3::ZERO
    }
}

/// A medium whose extinction is proportional to the density and whose source is `constant + slope · density`.
pub(super) struct Emitting {
    /// Extinction per unit of density.
    pub extinction: f32,
    /// Radiance of the source at density 0.
    pub constant: Vec3,
    /// Change of that radiance with the density.
    pub slope: Vec3,
}

impl DensityMedium for Emitting {
    const EMITS: bool = true;

    #[inline(always)]
    fn extinction(&self, density: f32) -> f32 {
        self.extinction * density
    }

    #[inline(always)]
    fn source(&self, density: f32) -> Vec3 {
        self.constant + self.slope * density
    }
}

/// A medium with a transfer function.
pub(super) struct Transfer {
    /// Extinction and source by density.
    pub curve: Curve<f32, 3>,
}

impl DensityMedium for Transfer {
    const EMITS: bool = true;

    #[inline(always)]
    fn extinction(&self, density: f32) -> f32 {
        let piece = self.curve.piece(self.curve.find(density));
        piece.extinction[0] + piece.extinction[1] * (density - piece.base)
    }

    #[inline(always)]
    fn source(&self, density: f32) -> Vec3 {
        let piece = self.curve.piece(self.curve.find(density));
        Vec3::from_array(piece.source.map(|[at_base, slope]| at_base + slope * (density - piece.base)))
    }
}

/// A medium whose albedo depends on the density, or may do.
pub(super) struct ByDensity<O> {
    /// Extinction and source.
    pub optics: O,
    /// Color of the albedo by density; `None` for 1 at every density.
    pub color: Option<Curve<f32, 3>>,
}

impl<O> ByDensity<O> {
    /// Returns optics with the albedo of their medium, for densities that are stored as differences to a reference.
    pub(crate) fn new(optics: O, medium: &Medium, reference: f64) -> Self {
        let curve = |function: &Arc<AlbedoFunction>| Curve::new(&function.table().relative_to(reference), 1.0);
        let color = medium.albedo_function.as_ref().map(curve);
        Self { optics, color }
    }
}

impl<O: DensityMedium> DensityMedium for ByDensity<O> {
    const EMITS: bool = O::EMITS;

    #[inline(always)]
    fn extinction(&self, density: f32) -> f32 {
        self.optics.extinction(density)
    }

    #[inline(always)]
    fn source(&self, density: f32) -> Vec3 {
        self.optics.source(density)
    }

    #[inline(always)]
    fn albedo(&self, density: f32, of_volume: Vec3) -> Vec3 {
        let Some(curve) = &self.color else { return of_volume };
        let piece = curve.piece(curve.find(density));
        let color = piece.source.map(|[at_base, slope]| at_base + slope * (density - piece.base));
        // Rounding must not make light.
        of_volume * Vec3::from_array(color).clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// A medium of any kind, for scenes with several volumes.
pub(super) enum Any {
    /// See [`Dark`].
    Dark(Dark),
    /// See [`Emitting`].
    Emitting(Emitting),
    /// See [`Transfer`].
    Transfer(Transfer),
}

impl Any {
    /// Returns the optics of a medium.
    pub(crate) fn new(medium: &Medium) -> Self {
        let extinction = medium.extinction as f32;
        let emitting = |constant, slope| match (constant, slope) {
            (Vec3::ZERO, Vec3::ZERO) => Self::Dark(Dark { extinction }),
            _ => Self::Emitting(Emitting { extinction, constant, slope }),
        };
        match &medium.source {
            Source::Grey(color) => emitting(Vec3::from_array(*color), Vec3::ZERO),
            Source::Linear(color) => emitting(Vec3::ZERO, Vec3::from_array(*color)),
            Source::Transfer(table) => Self::Transfer(Transfer { curve: Curve::new(table, medium.extinction) }),
        }
    }
}

impl DensityMedium for Any {
    const EMITS: bool = true;

    #[inline(always)]
    fn extinction(&self, density: f32) -> f32 {
        match self {
            Self::Dark(dark) => dark.extinction(density),
            Self::Emitting(emitting) => emitting.extinction(density),
            Self::Transfer(transfer) => transfer.extinction(density),
        }
    }

    #[inline(always)]
    fn source(&self, density: f32) -> Vec3 {
        match self {
            Self::Dark(dark) => dark.source(density),
            Self::Emitting(emitting) => emitting.source(density),
            Self::Transfer(transfer) => transfer.source(density),
        }
    }
}
