//! Choice of the kernel that a scene calls for.

use super::Kernel;
use super::chromatic::Chromatic;
use super::emissive::{Emissive, Integrated};
use super::flames::Flames;
use super::optics::{Any, DensityMedium};
use super::phase::{HenyeyGreenstein, Isotropic, Shaded};
use super::tracking::{Media, One, any};
use crate::error::{Error, Result};
use crate::scene::bricks::Bricks;
use crate::scene::medium::Medium;
use crate::scene::phase::Phase;
use crate::scene::scene::Scene;
use crate::scene::volume::Volume;

/// Returns the kernel that is compiled for the media of a scene.
///
/// # Errors
/// If a medium cannot be used, or a volume is pre-shaded.
pub(super) fn specialised<'a>(scene: &'a Scene) -> Result<Box<dyn Kernel + 'a>> {
    let densities = scene.volumes.iter().map(|volume| {
        volume.density().ok_or_else(|| {
            Error::unsupported("a pre-shaded volume has no albedo: it emits and absorbs, and scatters nothing")
                .hint("render it without lights and albedo")
        })
    });
    let densities = densities.collect::<Result<Vec<_>>>()?;
    match &densities[..] {
        several if several.iter().any(|(_, medium)| medium.is_chromatic()) => {
            with_flames(Chromatic::new(several)?, scene)
        }
        [(field, medium)] => single(scene, field, medium),
        _ => generic(scene),
    }
}

/// Returns the kernel that serves any number of volumes of one extinction for all channels.
///
/// # Errors
/// If a medium cannot be used.
pub(super) fn generic<'a>(scene: &'a Scene) -> Result<Box<dyn Kernel + 'a>> {
    let densities = scene.volumes.iter().filter_map(Volume::density);
    with_flames(densities.map(|(field, medium)| any(field, medium)).collect::<Result<Vec<_>>>()?, scene)
}

/// Returns the kernel of media and of what the volumes of a scene emit by grids.
fn with_flames<'a, M: Media + 'a>(media: M, scene: &'a Scene) -> Result<Box<dyn Kernel + 'a>> {
    let emitted = scene.volumes.iter().filter_map(Volume::emission);
    Ok(match emitted.clone().next() {
        Some(_) => Box::new(Emissive { media, glow: Flames::new(emitted)? }),
        None => Box::new(media),
    })
}

/// Returns the only volume of a scene as a kernel that is compiled for its kind of medium.
fn single<'a>(scene: &'a Scene, field: &'a Bricks<f32>, medium: &Medium) -> Result<Box<dyn Kernel + 'a>> {
    let one = any(field, medium)?;
    if let Some(emission) = scene.volumes.iter().find_map(Volume::emission) {
        return Ok(Box::new(Emissive { media: one, glow: Integrated::new(emission) }));
    }
    let One { dvr, optics, albedo, phases, shadows } = one;
    Ok(match optics {
        Any::Dark(optics) => with_phase(One { dvr, optics, albedo, phases, shadows }),
        Any::Emitting(optics) => with_phase(One { dvr, optics, albedo, phases, shadows }),
        Any::Transfer(optics) => with_phase(One { dvr, optics, albedo, phases, shadows }),
    })
}

/// Returns the volume as a kernel that is compiled for its phase function.
fn with_phase<'a, O: DensityMedium + 'a>(one: One<'a, O, Shaded>) -> Box<dyn Kernel + 'a> {
    let One { dvr, optics, albedo, phases, shadows } = one;
    match phases.unshaded() {
        Some(Phase::Isotropic) => Box::new(One { dvr, optics, albedo, phases: Isotropic, shadows }),
        Some(Phase::HenyeyGreenstein(g)) => Box::new(One { dvr, optics, albedo, phases: HenyeyGreenstein(g), shadows }),
        None => Box::new(One { dvr, optics, albedo, phases, shadows }),
    }
}
