//! The medium of a volume as attributes of its prim, in the namespace `cumulo`.
//!
//! The module [`scene`](super::super::scene) reads them.

use super::text::{Literal, Property};
use crate::formats::scene_file::{BlackbodyEntry, EmissionGridEntry, MediumEntry};
use crate::scene::albedo::TransferColor;
use crate::scene::capture::Model;

/// Returns the light model that a medium asks for.
pub(crate) fn model(medium: &MediumEntry) -> Model {
    if medium.albedo != [0.0; 3] {
        Model::Scattering
    } else if medium.transfer.is_some() || medium.emission.is_some_and(|color| color != [0.0; 3]) {
        Model::EmissionAbsorption
    } else {
        Model::Absorption
    }
}

/// Returns the attributes of a medium; `transfer` is the path of its transfer function from the stage's folder.
pub(crate) fn attributes(medium: &MediumEntry, transfer: Option<String>) -> Vec<Property> {
    let name = match model(medium) {
        Model::Scattering => "scattering",
        Model::EmissionAbsorption => "emission-absorption",
        Model::PreShaded => "pre-shaded",
        Model::Absorption => "absorption",
    };
    // All properties are named, so that a new one is not left out unnoticed.
    let MediumEntry {
        density_scale,
        albedo,
        anisotropy,
        gradient_shading,
        specular,
        roughness,
        extinction_color,
        emission,
        transfer: _,
        tf_color,
        emission_grid,
        blackbody,
    } = medium;
    let number = |name: &str, value: f64| Property::new("custom double", name, Literal::Number(value));
    let color = |name: &str, value: [f32; 3]| Property::new("custom color3f", name, Literal::floats(value));
    let mut all = vec![
        Property::new("custom token", "cumulo:model", Literal::text(name)),
        number("cumulo:densityScale", *density_scale),
        color("cumulo:albedo", *albedo),
        number("cumulo:anisotropy", *anisotropy),
        color("cumulo:extinctionColor", *extinction_color),
    ];
    all.extend(gradient_shading.map(|half| number("cumulo:gradientShading", half)));
    all.extend(specular.map(|reflectance| number("cumulo:specular", reflectance)));
    all.extend(roughness.map(|roughness| number("cumulo:roughness", roughness)));
    // The names of grids are those of the fields that play the part.
    if let Some(EmissionGridEntry { grid: _, radiance }) = emission_grid {
        all.push(color("cumulo:emissionRadiance", *radiance));
    }
    if let Some(BlackbodyEntry { grid: _, kelvin, intensity, tint }) = blackbody {
        all.push(number("cumulo:blackbodyKelvin", *kelvin));
        all.push(number("cumulo:blackbodyIntensity", *intensity));
        all.push(color("cumulo:blackbodyTint", *tint));
    }
    all.extend(emission.map(|value| color("cumulo:emission", value)));
    all.extend(transfer.map(|path| Property::new("custom asset", "cumulo:transfer", Literal::Asset(path))));
    let color =
        |color: &TransferColor| Property::new("custom token", "cumulo:transferColor", Literal::text(color.name()));
    all.extend(tf_color.as_ref().map(color));
    all
}
