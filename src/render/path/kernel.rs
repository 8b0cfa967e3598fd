//! Choice of the kernel that a scene calls for.

use super::Kernel;
use super::chromatic::Chromatic;
use super::emissive::{Emissive, Integrated};
use super::flames::Flames;
use super::labels::Labelled;
use super::meshes::AmongMeshes;
use super::optics::{Any, ByDensity, DensityMedium};
use super::phase::{HenyeyGreenstein, Isotropic, Phases, Shaded};
use super::tracking::{Media, One, any, any_by_density, any_glossy};
use crate::error::{Error, Result};
use crate::scene::bricks::Bricks;
use crate::scene::medium::Medium;
use crate::scene::meshes::Meshes;
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
    if let Some((field, medium)) = densities.iter().find(|(_, medium)| medium.labels().is_some()) {
        let alone = scene.volumes.len() == 1 && scene.meshes.is_none() && scene.volumes[0].emission().is_none();
        return match alone && !medium.is_chromatic() {
            true => Ok(Box::new(Labelled::new(field, medium)?)),
            false => Err(Error::unsupported(
                "light is scattered by one volume of labels, without others, meshes, grids that emit, or extinctions \
                 by channel",
            )
            .hint("render the labels alone, or give a function that is none of labels")),
        };
    }
    if let Some(meshes) = &scene.meshes {
        return among_meshes(scene, &densities, meshes);
    }
    match &densities[..] {
        several if several.iter().any(|(_, medium)| medium.is_chromatic()) => match Generality::of(scene) {
            Generality::Glossy => with_flames(Chromatic::new(several, any_glossy)?, scene),
            Generality::ByDensity => with_flames(Chromatic::new(several, any_by_density)?, scene),
            Generality::Plain => with_flames(Chromatic::new(several, any)?, scene),
        },
        [(field, medium)] if is_glossy(medium) => match scene.volumes.iter().find_map(Volume::emission) {
            Some(_) => generic(scene),
            None => Ok(Box::new(any_glossy(field, medium)?)),
        },
        [(field, medium)] if medium.albedo_function.is_some() => single_by_density(scene, field, medium),
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
    match Generality::of(scene) {
        Generality::Glossy => {
            let volumes = densities.map(|(field, medium)| any_glossy(field, medium));
            with_flames(volumes.collect::<Result<Vec<_>>>()?, scene)
        }
        Generality::ByDensity => {
            let volumes = densities.map(|(field, medium)| any_by_density(field, medium));
            with_flames(volumes.collect::<Result<Vec<_>>>()?, scene)
        }
        Generality::Plain => {
            let volumes = densities.map(|(field, medium)| any(field, medium));
            with_flames(volumes.collect::<Result<Vec<_>>>()?, scene)
        }
    }
}

/// Returns the kernel of volumes with meshes among them. Volumes that serve fewer media take less time, and surfaces as
/// much again: there is one for plain and one for all media.
fn among_meshes<'a>(
    scene: &'a Scene,
    densities: &[(&'a Bricks<f32>, &Medium)],
    meshes: &'a Meshes,
) -> Result<Box<dyn Kernel + 'a>> {
    fn of<'a, O: DensityMedium + 'a, P: Phases + 'a>(
        (scene, meshes): (&'a Scene, &'a Meshes),
        densities: &[(&'a Bricks<f32>, &Medium)],
        prepared: impl Fn(&'a Bricks<f32>, &Medium) -> Result<One<'a, O, P>>,
    ) -> Result<Box<dyn Kernel + 'a>> {
        let glow = Flames::new(scene.volumes.iter().filter_map(Volume::emission))?;
        Ok(match densities {
            several if several.iter().any(|(_, medium)| medium.is_chromatic()) => {
                let media = Chromatic::new(several, prepared)?;
                Box::new(AmongMeshes { media: Emissive { media, glow }, meshes })
            }
            [(field, medium)] => {
                Box::new(AmongMeshes { media: Emissive { media: prepared(field, medium)?, glow }, meshes })
            }
            several => {
                let media =
                    several.iter().map(|(field, medium)| prepared(field, medium)).collect::<Result<Vec<_>>>()?;
                Box::new(AmongMeshes { media: Emissive { media, glow }, meshes })
            }
        })
    }
    match Generality::of(scene) {
        Generality::Plain => of((scene, meshes), densities, any),
        Generality::ByDensity | Generality::Glossy => of((scene, meshes), densities, any_glossy),
    }
}

/// Media that kernels of several volumes must serve.
enum Generality {
    /// Media of one albedo each.
    Plain,
    /// Albedos by density.
    ByDensity,
    /// Surfaces that reflect as well.
    Glossy,
}

impl Generality {
    fn of(scene: &Scene) -> Self {
        let mut media = scene.volumes.iter().filter_map(Volume::density).map(|(_, medium)| medium);
        if media.clone().any(is_glossy) {
            return Self::Glossy;
        }
        if media.any(|medium| medium.albedo_function.is_some()) { Self::ByDensity } else { Self::Plain }
    }
}

/// True if a medium has surfaces that reflect.
fn is_glossy(medium: &Medium) -> bool {
    medium.scattering.is_some_and(|scattering| scattering.specular.is_some())
}

/// Returns the only volume of a scene, whose albedo depends on the density, as a kernel that is compiled for it: with a
/// transfer function for its phase function as well, since the two go together.
fn single_by_density<'a>(scene: &'a Scene, field: &'a Bricks<f32>, medium: &Medium) -> Result<Box<dyn Kernel + 'a>> {
    if scene.volumes.iter().any(|volume| volume.emission().is_some()) {
        return generic(scene);
    }
    let One { dvr, optics, albedo, phases, shadows } = any(field, medium)?;
    Ok(match optics {
        Any::Transfer(optics) => {
            with_phase(One { dvr, optics: ByDensity::new(optics, medium, field.reference), albedo, phases, shadows })
        }
        optics => {
            Box::new(One { dvr, optics: ByDensity::new(optics, medium, field.reference), albedo, phases, shadows })
        }
    })
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
