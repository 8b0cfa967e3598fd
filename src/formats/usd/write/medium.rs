//! The medium of a volume as attributes of its prim, in the namespace `cumulo`.
//!
//! The module [`scene`](super::super::scene) reads them.

use super::text::{Literal, Property};
use crate::formats::scene_file::MediumEntry;
use crate::scene::capture::Model;

/// Returns the light model that a medium asks for.
pub fn model(medium: &MediumEntry) -> Model {
    if medium.albedo != [0.0; 3] {
        Model::Scattering
    } else if medium.transfer.is_some() || medium.emission.is_some_and(|color| color != [0.0; 3]) {
        Model::EmissionAbsorption
    } else {
        Model::Absorption
    }
}

/// Returns the attributes of a medium; `transfer` is the path of its transfer function from the stage's folder.
pub fn attributes(medium: &MediumEntry, transfer: Option<String>) -> Vec<Property> {
    let name = match model(medium) {
        Model::Scattering => "scattering",
        Model::EmissionAbsorption => "emission-absorption",
        Model::PreShaded => "pre-shaded",
        Model::Absorption => "absorption",
    };
    let mut all = vec![
        Property::new("custom token", "cumulo:model", Literal::text(name)),
        Property::new("custom double", "cumulo:densityScale", Literal::Number(medium.density_scale)),
        Property::new("custom color3f", "cumulo:albedo", Literal::floats(medium.albedo)),
        Property::new("custom double", "cumulo:anisotropy", Literal::Number(medium.anisotropy)),
        Property::new("custom color3f", "cumulo:extinctionColor", Literal::floats(medium.extinction_color)),
    ];
    let number = |name: &str, value: f64| Property::new("custom double", name, Literal::Number(value));
    let color = |name: &str, value: [f32; 3]| Property::new("custom color3f", name, Literal::floats(value));
    all.extend(medium.gradient_shading.map(|half| number("cumulo:gradientShading", half)));
    all.extend(medium.emission_grid.as_ref().map(|grid| color("cumulo:emissionRadiance", grid.radiance)));
    if let Some(body) = &medium.blackbody {
        all.push(number("cumulo:blackbodyKelvin", body.kelvin));
        all.push(number("cumulo:blackbodyIntensity", body.intensity));
        all.push(color("cumulo:blackbodyTint", body.tint));
    }
    let emission = medium.emission.map(|value| color("cumulo:emission", value));
    let transfer = transfer.map(|path| Property::new("custom asset", "cumulo:transfer", Literal::Asset(path)));
    all.extend(emission.into_iter().chain(transfer));
    all
}
