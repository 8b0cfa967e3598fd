//! Materials of a volume, one for each renderer, as variants: a stage in which no renderer is chosen names no shader
//! that only one of them knows.
//!
//! - `arnold`: `standard_volume`, at the output `arnold:volume`.
//! - `cycles`: Cycles' `principled_volume`, at the output `cycles:volume`.
//! - `materialx`: `anisotropic_vdf` and `uniform_edf` of MaterialX's PBR library, at the output `mtlx:volume`.

use super::text::{Literal, PrimText, Property, Variant, VariantSet};
use crate::formats::scene_file::MediumEntry;

/// Name of the variant set.
pub(crate) const SET: &str = "renderer";

/// Renderer whose material a volume is bound to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Renderer {
    /// No material: every renderer shows the density as it does by default.
    #[default]
    None,
    /// Autodesk Arnold.
    Arnold,
    /// Cycles as a Hydra delegate.
    Cycles,
    /// Renderers that read MaterialX networks with volumes, such as Karma.
    MaterialX,
}

impl Renderer {
    /// All renderers.
    const ALL: [Self; 4] = [Self::None, Self::Arnold, Self::Cycles, Self::MaterialX];

    /// Returns the name of the variant.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Arnold => "arnold",
            Self::Cycles => "cycles",
            Self::MaterialX => "materialx",
        }
    }

    /// Returns what the renderer's material cannot say of a medium, in words.
    pub(crate) fn omits(self, medium: &MediumEntry) -> Vec<&'static str> {
        let all = [
            (medium.transfer.is_some() && self != Self::None, "the transfer function"),
            (medium.extinction_color != [1.0; 3] && self == Self::Cycles, "the color of the extinction"),
            (emission(medium).is_some() && self == Self::Cycles, "the emission"),
            (medium.gradient_shading.is_some() && self != Self::None, "the gradient shading"),
            (medium.emission_grid.is_some() && self != Self::None, "the emission by a grid"),
            (medium.blackbody.is_some() && self != Self::None, "the emission of black bodies"),
        ];
        all.into_iter().filter(|(omitted, _)| *omitted).map(|(_, what)| what).collect()
    }

    fn material(self, medium: &MediumEntry, path: &str) -> Option<PrimText> {
        let mut material = PrimText::new("Material", "material");
        let (output, from, shaders) = match self {
            Self::None => return None,
            Self::Arnold => ("outputs:arnold:volume", "outputs:out", vec![arnold(medium)]),
            Self::Cycles => ("outputs:cycles:volume", "outputs:Volume", vec![cycles(medium)]),
            Self::MaterialX => ("outputs:mtlx:volume", "outputs:out", materialx(medium, path)),
        };
        material.properties.push(Property::connected("token", output, format!("{path}/{}.{from}", shaders[0].name)));
        material.children = shaders;
        Some(material)
    }
}

/// Returns the variants of a volume at the path `volume`, with one renderer selected.
pub(crate) fn variants(selected: Renderer, medium: &MediumEntry, volume: &str) -> VariantSet {
    let path = format!("{volume}/material");
    let variant = |renderer: Renderer| {
        let material = renderer.material(medium, &path);
        let binding = material.as_ref().map(|_| Property::relationship("rel", "material:binding", path.as_str()));
        Variant {
            name: renderer.name(),
            properties: binding.into_iter().collect(),
            children: material.into_iter().collect(),
        }
    };
    VariantSet { name: SET, selected: selected.name(), variants: Renderer::ALL.map(variant).to_vec() }
}

fn shader(name: &str, id: &str) -> PrimText {
    let mut shader = PrimText::new("Shader", name);
    shader.set("uniform token", "info:id", Literal::text(id));
    shader
}

/// Radiance per length and unit of extinction, where the medium emits by its density.
fn emission(medium: &MediumEntry) -> Option<[f32; 3]> {
    let color = medium.emission.filter(|color| *color != [0.0; 3])?;
    let emitted = |i: usize| (1.0 - medium.albedo[i]) * medium.extinction_color[i] * color[i];
    Some([emitted(0), emitted(1), emitted(2)])
}

fn arnold(medium: &MediumEntry) -> PrimText {
    let mut shader = shader("standard_volume", "arnold:standard_volume");
    shader.set("float", "inputs:density", Literal::Number(medium.density_scale));
    shader.set("string", "inputs:density_channel", Literal::text("density"));
    shader.set("float", "inputs:scatter", Literal::Int(1));
    shader.set("color3f", "inputs:scatter_color", Literal::floats(medium.albedo));
    shader.set("float", "inputs:scatter_anisotropy", Literal::Number(medium.anisotropy));
    if medium.extinction_color != [1.0; 3] {
        // Arnold states the transmittance of a unit of depth; its default, 1/e, leaves the density as it is.
        let transparent = medium.extinction_color.map(|factor| (-factor).exp());
        shader.set("color3f", "inputs:transparent", Literal::floats(transparent));
    }
    match emission(medium) {
        Some(color) => {
            shader.set("string", "inputs:emission_mode", Literal::text("density"));
            shader.set("float", "inputs:emission", Literal::Int(1));
            shader.set("color3f", "inputs:emission_color", Literal::floats(color));
        }
        None => drop(shader.set("string", "inputs:emission_mode", Literal::text("none"))),
    }
    shader.properties.push(Property::output("token", "outputs:out"));
    shader
}

fn cycles(medium: &MediumEntry) -> PrimText {
    let mut shader = shader("principled_volume", "cycles_principled_volume");
    shader.set("color3f", "inputs:color", Literal::floats(medium.albedo));
    shader.set("float", "inputs:density", Literal::Number(medium.density_scale));
    shader.set("string", "inputs:density_attribute", Literal::text("density"));
    shader.set("float", "inputs:anisotropy", Literal::Number(medium.anisotropy));
    shader.properties.push(Property::output("token", "outputs:Volume"));
    shader
}

/// Returns the shaders of a MaterialX network, the one that ends it first.
fn materialx(medium: &MediumEntry, path: &str) -> Vec<PrimText> {
    let link = |name: &str| format!("{path}/{name}.outputs:out");
    let coefficient = |share: &dyn Fn(usize) -> f32| {
        let scale = |i: usize| medium.density_scale * f64::from(medium.extinction_color[i] * share(i));
        Literal::doubles([scale(0), scale(1), scale(2)])
    };
    let product = |name: &str, kind: &'static str, id: &str, factor: Literal| {
        let mut product = shader(name, id);
        product.set(kind, "inputs:in1", factor);
        product.properties.push(Property::connected("float", "inputs:in2", link("density")));
        product.properties.push(Property::output(kind, "outputs:out"));
        product
    };
    let vector = |name: &str, factor: Literal| product(name, "float3", "ND_multiply_vector3FA", factor);

    let mut volume = shader("volume", "ND_volume");
    volume.properties.push(Property::connected("token", "inputs:vdf", link("vdf")));
    let mut vdf = shader("vdf", "ND_anisotropic_vdf");
    vdf.properties.push(Property::connected("float3", "inputs:absorption", link("absorption")));
    vdf.properties.push(Property::connected("float3", "inputs:scattering", link("scattering")));
    vdf.set("float", "inputs:anisotropy", Literal::Number(medium.anisotropy));
    vdf.properties.push(Property::output("token", "outputs:out"));
    let mut density = shader("density", "ND_geompropvalue_float");
    density.set("string", "inputs:geomprop", Literal::text("density"));
    density.properties.push(Property::output("float", "outputs:out"));
    let mut shaders = vec![
        vdf,
        vector("absorption", coefficient(&|i| 1.0 - medium.albedo[i])),
        vector("scattering", coefficient(&|i| medium.albedo[i])),
        density,
    ];
    if let Some(color) = emission(medium) {
        volume.properties.push(Property::connected("token", "inputs:edf", link("edf")));
        let mut edf = shader("edf", "ND_uniform_edf");
        edf.properties.push(Property::connected("color3f", "inputs:color", link("emission")));
        edf.properties.push(Property::output("token", "outputs:out"));
        let color = color.map(|v| f64::from(v) * medium.density_scale);
        shaders.extend([edf, product("emission", "color3f", "ND_multiply_color3FA", Literal::doubles(color))]);
    }
    volume.properties.push(Property::output("token", "outputs:out"));
    shaders.insert(0, volume);
    shaders
}
