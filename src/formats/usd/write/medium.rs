//! The medium of a volume as attributes of its prim, in the namespace `cumulo`, which [`scene`](super::super::scene) reads.

use super::text::{Property, Value};
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
        Property::new("custom token", "cumulo:model", Value::text(name)),
        Property::new("custom double", "cumulo:densityScale", Value::Number(medium.density_scale)),
        Property::new("custom color3f", "cumulo:albedo", Value::floats(medium.albedo)),
        Property::new("custom double", "cumulo:anisotropy", Value::Number(medium.anisotropy)),
        Property::new("custom color3f", "cumulo:extinctionColor", Value::floats(medium.extinction_color)),
    ];
    let emission = medium.emission.map(|value| color("cumulo:emission", value));
    let transfer = transfer.map(|path| Property::new("custom asset", "cumulo:transfer", Value::Asset(path)));
    all.extend(emission.into_iter().chain(transfer));
    all
}
