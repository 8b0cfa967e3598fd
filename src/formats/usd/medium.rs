//! Media of volumes: Cumulo's own attributes, or shaders that are understood.
//!
//! Attributes in the namespace `cumulo` of a volume's prim state its medium: `densityScale`, `albedo`, `anisotropy`,
//! `extinctionColor`, `emission` and `transfer` are those of scene files, and `transferColor` is their `tf_color`.
//! `emissionRadiance` makes the flame field emit, `blackbodyKelvin`, `blackbodyIntensity` and `blackbodyTint` the
//! temperature field. Lengths are in units of the stage.

use super::prim::Prim;
use super::stage::Stage;
use super::value::{Asset, Value};
use crate::error::{Error, Result};
use crate::formats::scene_file::{BlackbodyEntry, EmissionGridEntry, MediumEntry};
use crate::formats::transfer;
use crate::scene::albedo::TransferColor;
use std::path::PathBuf;

/// Medium of a volume.
#[derive(Debug, Clone)]
pub(super) struct StatedMedium {
    /// Medium; its grids and its transfer function are named elsewhere.
    pub entry: MediumEntry,
    /// Transfer function's file.
    pub transfer: Option<Asset>,
    /// Remarks on shaders that are not understood, and on what is assumed.
    pub remarks: Vec<String>,
}

/// Properties of a medium that hold in place of those that a stage states.
#[derive(Debug, Clone, Default)]
pub struct Overrides {
    /// Extinction per unit of density and length of the stage.
    pub density_scale: Option<f64>,
    /// Albedo, with the properties of scattering that go with it.
    pub scattering: Option<ScatteringOverride>,
    /// Radiance of the source.
    pub emission: Option<[f32; 3]>,
    /// File, or name, of a transfer function.
    pub transfer: Option<PathBuf>,
    /// Options that it is read with.
    pub transfer_options: transfer::Options,
}

/// Properties of scattering; those that are `None` stay as the stage states them.
#[derive(Debug, Clone, Copy, Default)]
pub struct ScatteringOverride {
    /// Share of the extinction that is scattered.
    pub albedo: [f32; 3],
    /// Meaning of the colors of a transfer function.
    pub tf_color: Option<TransferColor>,
    /// Mean cosine of the angle by which scattered light turns.
    pub anisotropy: Option<f64>,
    /// Change of the density per length at which half of the scattering is that of a surface.
    pub gradient_shading: Option<f64>,
    /// Share of the light that surfaces reflect at normal incidence.
    pub specular: Option<f64>,
    /// Roughness of this reflection.
    pub roughness: Option<f64>,
    /// Factors of the extinction.
    pub extinction_color: Option<[f32; 3]>,
}

impl Overrides {
    /// True if nothing is replaced.
    pub(crate) fn is_empty(&self) -> bool {
        self.density_scale.is_none() && self.scattering.is_none() && self.emission.is_none() && self.transfer.is_none()
    }

    /// Replaces properties of a medium.
    fn apply(&self, medium: &mut StatedMedium) {
        let entry = &mut medium.entry;
        entry.density_scale = self.density_scale.unwrap_or(entry.density_scale);
        if let Some(ScatteringOverride {
            albedo,
            tf_color,
            anisotropy,
            gradient_shading,
            specular,
            roughness,
            extinction_color,
        }) = self.scattering
        {
            entry.albedo = albedo;
            entry.tf_color = tf_color.filter(|_| medium.transfer.is_some()).or(entry.tf_color);
            entry.anisotropy = anisotropy.unwrap_or(entry.anisotropy);
            entry.gradient_shading = gradient_shading.or(entry.gradient_shading);
            (entry.specular, entry.roughness) = (specular.or(entry.specular), roughness.or(entry.roughness));
            entry.extinction_color = extinction_color.unwrap_or(entry.extinction_color);
        }
        if self.emission.is_some() {
            (entry.emission, entry.tf_color, medium.transfer) = (self.emission, None, None);
        }
        if let Some(transfer) = &self.transfer {
            (entry.transfer, entry.emission, medium.transfer) = (Some(transfer.clone()), None, None);
            // What the stage says of its own function says nothing of another.
            entry.tf_color = self.scattering.and_then(|scattering| scattering.tf_color);
        }
    }
}

/// Namespace of the attributes.
const NAMESPACE: &str = "cumulo:";

/// Reads the medium of a volume at a time code, with properties that hold in place of the stage's.
///
/// # Errors
/// If an attribute of the namespace has a value of another kind.
pub(super) fn medium(stage: &Stage, volume: &Prim, time: f64, overrides: &Overrides) -> Result<StatedMedium> {
    let mut medium = stated(stage, volume, time, overrides.is_empty())?;
    overrides.apply(&mut medium);
    Ok(medium)
}

/// Reads the medium that a stage states; `told` if a remark is to say that it states none.
fn stated(stage: &Stage, volume: &Prim, time: f64, told: bool) -> Result<StatedMedium> {
    if volume.attributes.keys().any(|name| name.starts_with(NAMESPACE)) {
        return own(volume, time);
    }
    let mut remarks = Vec::new();
    let shaders = bound_shaders(stage, volume, "volume");
    for shader in &shaders {
        match shaded(shader, time) {
            Some((entry, left_out)) => {
                remarks.extend(left_out);
                return Ok(StatedMedium { entry, transfer: None, remarks });
            }
            None => remarks.push(format!(
                "the shader {} ({}) is not understood",
                shader.path,
                shader.text("info:id", time).unwrap_or_else(|| "no info:id".into())
            )),
        }
    }
    let none = told.then_some(
        "no medium is stated that is understood: the density is the extinction per unit of the stage, and nothing is \
         scattered; ⟨density_scale⟩, ⟨albedo⟩ and the like state another",
    );
    remarks.extend(none.map(str::to_owned));
    Ok(StatedMedium { entry: MediumEntry::default(), transfer: None, remarks })
}

/// Reads the attributes of the namespace.
///
/// # Errors
/// If one has a value of another kind: a medium without it would be another one.
fn own(volume: &Prim, time: f64) -> Result<StatedMedium> {
    let number = |key: &str| own_value(volume, key, time, "a number such as 0.5", Value::number);
    let color = |key: &str| {
        let color = |value: &Value| value.tuple::<3>().map(|v| v.map(|v| v as f32));
        own_value(volume, key, time, "three numbers such as (0.5, 0.5, 0.5)", color)
    };
    let mut entry = MediumEntry::default();
    entry.density_scale = number("densityScale")?.unwrap_or(entry.density_scale);
    entry.albedo = color("albedo")?.unwrap_or(entry.albedo);
    entry.anisotropy = number("anisotropy")?.unwrap_or(entry.anisotropy);
    entry.extinction_color = color("extinctionColor")?.unwrap_or(entry.extinction_color);
    entry.gradient_shading = number("gradientShading")?;
    (entry.specular, entry.roughness) = (number("specular")?, number("roughness")?);
    entry.emission = color("emission")?;
    entry.emission_grid =
        color("emissionRadiance")?.map(|radiance| EmissionGridEntry { grid: String::new(), radiance });
    let intensity = number("blackbodyIntensity")?.unwrap_or(1.0);
    let tint = color("blackbodyTint")?.unwrap_or([1.0; 3]);
    entry.blackbody =
        number("blackbodyKelvin")?.map(|kelvin| BlackbodyEntry { grid: String::new(), kelvin, intensity, tint });
    let transfer = own_value(volume, "transfer", time, "the path of a file such as @./fire.json@", |value| {
        value.asset().cloned()
    })?;
    let meaning = "one of emission, albedo and both";
    entry.tf_color = own_value(volume, "transferColor", time, meaning, |value| {
        TransferColor::ALL.into_iter().find(|color| value.text() == Some(color.name()))
    })?;
    let known = [
        "model",
        "densityScale",
        "albedo",
        "anisotropy",
        "extinctionColor",
        "gradientShading",
        "specular",
        "roughness",
        "emission",
        "transfer",
        "transferColor",
        "emissionRadiance",
        "blackbodyKelvin",
        "blackbodyIntensity",
        "blackbodyTint",
    ];
    let keys = volume.attributes.keys().filter_map(|key| key.strip_prefix(NAMESPACE));
    let unknown = keys.filter(|key| !known.contains(key) && !key.contains(':'));
    let remarks = unknown.map(|key| format!("the attribute '{NAMESPACE}{key}' is unknown and has no effect")).collect();
    Ok(StatedMedium { entry, transfer: transfer.filter(|asset| !asset.authored.is_empty()), remarks })
}

/// Returns the value of an attribute of the namespace, as `read` has it; `None` if the attribute has none.
///
/// # Errors
/// If it is of another kind than `expected`.
fn own_value<T>(
    volume: &Prim,
    key: &str,
    time: f64,
    expected: &str,
    read: impl Fn(&Value) -> Option<T>,
) -> Result<Option<T>> {
    let name = format!("{NAMESPACE}{key}");
    let Some(value) = volume.value(&name, time) else { return Ok(None) };
    let kind = volume.attribute(&name).map_or("", |attribute| attribute.type_name.as_str());
    read(&value).map(Some).ok_or_else(|| {
        Error::invalid(format!("the attribute '{name}' of type {kind} is not {expected}"))
            .hint("correct its type and value, or remove it")
    })
}

/// Returns the shaders of the material that is bound to a prim or to one above it, at the material's outputs for
/// `volume` or `surface`.
pub(super) fn bound_shaders<'s>(stage: &'s Stage, prim: &'s Prim, output: &str) -> Vec<&'s Prim> {
    // What is bound for full renders anywhere above goes before what is bound for all purposes, as in UsdShade.
    let bound = ["material:binding:full", "material:binding", "material:binding:preview"];
    let nearest = |name: &&str| stage.upwards(prim).find_map(|prim| prim.targets(name).first());
    let Some(material) = bound.iter().find_map(nearest).and_then(|path| stage.prim(path)) else {
        return Vec::new();
    };
    let outputs = material.attributes.values().filter(|a| a.name.starts_with("outputs:") && a.name.ends_with(output));
    let sources = outputs.flat_map(|output| &output.connections);
    sources.filter_map(|source| stage.prim(source.rsplit_once('.').map_or(source, |(prim, _)| prim))).collect()
}

/// Returns the medium of a shader, and what of it is left out; `None` if the shader is not understood.
fn shaded(shader: &Prim, time: f64) -> Option<(MediumEntry, Vec<String>)> {
    let id = shader.text("info:id", time)?;
    let inputs = shader.attributes.values().filter(|a| a.name.starts_with("inputs:"));
    if inputs.into_iter().any(|input| !input.connections.is_empty()) {
        return None;
    }
    let number = |name: &str| shader.number(&format!("inputs:{name}"), time);
    let color = |name: &str| shader.tuple::<3>(&format!("inputs:{name}"), time).map(|v| v.map(|v| v as f32));
    let mut left_out = Vec::new();
    let mut entry = MediumEntry::default();
    match id.as_str() {
        // Cycles and Blender: extinction is the density, albedo the color.
        "cycles_principled_volume" | "ShaderNodeVolumePrincipled" | "principled_volume" => {
            entry.density_scale = number("density").unwrap_or(1.0);
            entry.albedo = color("color").unwrap_or([0.5; 3]);
            if let Some(passed) = color("absorption_color").filter(|color| *color != [0.0; 3]) {
                // Of what is not scattered, 1 - color, the root of the absorption color is not absorbed either.
                for (albedo, (factor, passed)) in
                    entry.albedo.iter_mut().zip(entry.extinction_color.iter_mut().zip(passed))
                {
                    *factor = *albedo + (1.0 - *albedo).max(0.0) * (1.0 - passed.max(0.0).sqrt()).max(0.0);
                    *albedo = if *factor > 0.0 { *albedo / *factor } else { 0.0 };
                }
            }
            entry.anisotropy = number("anisotropy").unwrap_or(0.0);
            let emits = number("emission_strength").unwrap_or(0.0) != 0.0
                || number("blackbody_intensity").unwrap_or(0.0) != 0.0;
            left_out.extend(emits.then(|| format!("the emission of the shader {} is left out", shader.path)));
        }
        "arnold:standard_volume" => {
            entry.density_scale = number("density").unwrap_or(1.0);
            let scatter = number("scatter").unwrap_or(1.0) as f32;
            entry.albedo = color("scatter_color").unwrap_or([0.5; 3]).map(|v| scatter * v);
            entry.anisotropy = number("scatter_anisotropy").unwrap_or(0.0);
            // The transmittance of a unit of depth.
            let transparent = color("transparent").unwrap_or([(-1.0_f32).exp(); 3]);
            entry.extinction_color = transparent.map(|v| -v.max(1e-30).ln());
            let mode = shader.text("inputs:emission_mode", time);
            let emits = !matches!(mode.as_deref(), None | Some("none"));
            left_out.extend(emits.then(|| format!("the emission of the shader {} is left out", shader.path)));
        }
        _ => return None,
    }
    Some((entry, left_out))
}
