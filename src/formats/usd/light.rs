//! Lights of stages, after UsdLux.
//!
//! The radiance that leaves a light is `L = color · intensity · 2^exposure`, times the color of its temperature if that
//! is enabled, and divided by the light's size if it is normalized: `4 π r²` for spheres, `width · height` for
//! rectangles, `π sin²(angle / 2)` for distant lights, all in the units of the stage. From it follow
//!
//! - the irradiance `E = L π sin²(angle / 2)` of distant lights, and `E = L` where the angle is 0,
//! - the radiant intensity `I = L π r²` of spheres that are treated as points.
//!
//! The cone of a `ShapingAPI` falls off from the angle `angle · (1 - softness)` to `angle`, in between as
//! [`Cone`] says. A sphere with `cumulo:softFalloff` is a disc that turns to whatever it lights.
//!
//! Blender writes and reads suns in its own way: `L` is a quarter of a sun's strength, normalized, and the angle is
//! half of the sun's. Its color temperature is enabled though none is meant, and the softness of its cones is the blend
//! of its spots. Lights that Blender wrote are read as it does.

use super::metadata::UpAxis;
use super::prim::Prim;
use super::stage::Stage;
use super::value::Asset;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::scene_file::environment_map;
use crate::scene::cone::Cone;
use crate::scene::emission;
use crate::scene::environment::{BLACK, Environment};
use crate::scene::light::Light;
use glam::{DMat3, DMat4, DVec3, Vec3};
use std::f64::consts::PI;
use std::path::PathBuf;
use std::sync::Arc;

/// Lights of a stage at a time code.
#[derive(Debug, Default)]
pub(super) struct Lights {
    /// Lights with a place or a direction.
    pub lights: Vec<Light>,
    /// Light from all around.
    pub environment: Environment,
    /// Pictures that were read.
    pub files: Vec<PathBuf>,
    /// Lights that are left out, and what of others has no effect, in words.
    pub remarks: Vec<String>,
}

/// Attribute of spheres that are discs which turn to whatever they light.
pub(super) const SOFT_FALLOFF: &str = "cumulo:softFalloff";

/// Types of lights that shine in pictures.
const UNDERSTOOD: [&str; 5] = ["DistantLight", "SphereLight", "RectLight", "DomeLight", "DomeLight_1"];

/// Names of inputs that lights of earlier releases have without a namespace.
const OLD_INPUTS: [&str; 11] = [
    "intensity",
    "exposure",
    "color",
    "normalize",
    "enableColorTemperature",
    "colorTemperature",
    "angle",
    "radius",
    "width",
    "height",
    "texture:file",
];

/// True if a prim is a light of any type.
pub(super) fn is_light(prim: &Prim) -> bool {
    UNDERSTOOD.contains(&prim.type_name.as_str())
        || ["DiskLight", "CylinderLight", "GeometryLight", "PortalLight", "PluginLight"]
            .contains(&prim.type_name.as_str())
        || prim.schemas.iter().any(|schema| schema == "MeshLightAPI" || schema == "VolumeLightAPI")
}

/// Reads the lights of a stage.
///
/// # Errors
/// If a number of a light cannot be used, or a picture cannot be read; the error names the light.
pub(super) fn lights(stage: &Stage, time: f64, limits: Limits) -> Result<Lights> {
    let mut all = Lights::default();
    for prim in stage.prims().filter(|prim| is_light(prim)) {
        if !stage.is_visible(prim, time) {
            continue;
        }
        let blame = |e: Error| stage.blame(e, prim);
        let left_out = match stage.is_prototype(prim) {
            true => Some("instances of a PointInstancer are not rendered".to_owned()),
            false => left_out(prim, time),
        };
        if let Some(reason) = left_out {
            all.remarks.push(format!("light {} is left out: {reason}", prim.path));
            continue;
        }
        all.remarks.extend(without_effect(prim, time).map(|what| format!("light {}: {what}", prim.path)));
        let map = stage.local_to_world(prim, time)?;
        let radiance = radiance(stage, prim, time);
        let light = match prim.type_name.as_str() {
            "DomeLight" | "DomeLight_1" => {
                dome(stage, prim, time, Dome { map, radiance, limits }, &mut all).map_err(blame)?;
                continue;
            }
            "DistantLight" => distant(stage, prim, time, map, radiance),
            "SphereLight" => {
                let soft = prim.bool(SOFT_FALLOFF, time) == Some(true);
                let light = sphere(prim, time, map, radiance).map_err(blame)?;
                match cone(stage, prim, time, map).map_err(blame)? {
                    Some(cone) => spot(light, soft, cone),
                    None => softened(light, soft),
                }
            }
            _ => rectangle(prim, time, map, radiance),
        };
        let light = light.checked().map_err(blame)?;
        if radiance == DVec3::ZERO {
            all.remarks.push(format!("light {} is dark: its intensity or color is 0", prim.path));
        } else if is_dark_point(&light) {
            all.remarks.push(format!("light {} is dark: its radius is 0, and it is not normalized", prim.path));
        } else {
            all.lights.push(light);
        }
    }
    Ok(all)
}

/// True of a point, or a spot of one, without light.
fn is_dark_point(light: &Light) -> bool {
    matches!(light, Light::Point { intensity, .. } | Light::Spot { intensity, .. } if *intensity == Vec3::ZERO)
}

/// Returns why a light cannot be simulated; `None` if it can.
fn left_out(prim: &Prim, time: f64) -> Option<String> {
    if !UNDERSTOOD.contains(&prim.type_name.as_str()) {
        return Some(format!("lights of type {} are not simulated", prim.type_name));
    }
    let number = |name: &str| prim.number(name, time);
    // Spheres have their cones.
    let cone = prim.type_name != "SphereLight" && number("inputs:shaping:cone:angle").is_some_and(|angle| angle < 90.0);
    let focus = number("inputs:shaping:focus").is_some_and(|focus| focus != 0.0);
    let profile = prim.value("inputs:shaping:ies:file", time).is_some_and(|file| has_path(file.asset()));
    let shaped = prim.schemas.iter().any(|schema| schema == "ShapingAPI") || cone || focus || profile;
    if shaped && (cone || focus || profile) {
        return Some("its cone, focus or profile (ShapingAPI) is not simulated".into());
    }
    if !prim.targets("light:filters").is_empty() {
        return Some("its filters are not simulated".into());
    }
    let textured = prim.type_name == "RectLight"
        && prim.value("inputs:texture:file", time).is_some_and(|file| has_path(file.asset()));
    textured.then(|| "textures of rectangles are not simulated".into())
}

fn has_path(asset: Option<&Asset>) -> bool {
    asset.is_some_and(|asset| !asset.authored.is_empty())
}

/// Returns what a light states that has no effect.
fn without_effect(prim: &Prim, time: f64) -> impl Iterator<Item = String> {
    let number = |name: &str| prim.number(name, time);
    let link = |name: &str| {
        let part = |part: &str| !prim.targets(&format!("collection:{name}:{part}")).is_empty();
        let root = prim.bool(&format!("collection:{name}:includeRoot"), time) == Some(false);
        (part("includes") || part("excludes") || root)
            .then(|| format!("its {name} is not followed: it lights everything"))
    };
    let factor = |name: &str| {
        number(name).filter(|v| *v != 1.0).map(|v| format!("the factor '{name}' of {v} for surfaces has no effect"))
    };
    let shadow = prim.bool("inputs:shadow:enable", time) == Some(false);
    // Until release 21.02 of OpenUSD, inputs of lights had no namespace. Later ones do not read them.
    let old = OLD_INPUTS.into_iter().find(|name| {
        let stated = |name: &str| prim.value(name, time).is_some();
        stated(name) && !stated(&format!("inputs:{name}"))
    });
    [
        old.map(|name| format!("its attribute '{name}' has no effect, as it is not named 'inputs:{name}'")),
        link("lightLink"),
        link("shadowLink"),
        factor("inputs:diffuse"),
        shadow.then(|| "it casts shadows though the stage disables them".to_owned()),
    ]
    .into_iter()
    .flatten()
}

/// True if Blender wrote a light.
fn is_of_blender(stage: &Stage, prim: &Prim) -> bool {
    let named = |name: &String| name.starts_with("userProperties:blender:");
    let documented = stage.metadata.documentation.as_deref().is_some_and(|doc| doc.starts_with("Blender v"));
    documented || stage.upwards(prim).take(2).any(|prim| prim.attributes.keys().any(named))
}

/// Returns the radiance of a light before it is normalized.
fn radiance(stage: &Stage, prim: &Prim, time: f64) -> DVec3 {
    let number = |name: &str, fallback: f64| prim.number(name, time).unwrap_or(fallback);
    let fallback = if prim.type_name == "DistantLight" { 50_000.0 } else { 1.0 };
    let color = prim.tuple::<3>("inputs:color", time).unwrap_or([1.0; 3]);
    let mut radiance =
        DVec3::from_array(color) * number("inputs:intensity", fallback) * number("inputs:exposure", 0.0).exp2();
    let stated = prim.number("inputs:colorTemperature", time);
    let meant = stated.is_some() || !is_of_blender(stage, prim);
    if prim.bool("inputs:enableColorTemperature", time) == Some(true) && meant {
        radiance *= emission::color(stated.unwrap_or(6500.0).clamp(1000.0, 10_000.0));
    }
    radiance
}

fn is_normalized(prim: &Prim, time: f64) -> bool {
    prim.bool("inputs:normalize", time) == Some(true)
}

/// Returns a sun. Light travels along the prim's -Z.
fn distant(stage: &Stage, prim: &Prim, time: f64, map: DMat4, radiance: DVec3) -> Light {
    let blender = is_of_blender(stage, prim);
    let angle = prim.number("inputs:angle", time).unwrap_or(0.53).to_radians() * if blender { 2.0 } else { 1.0 };
    let size = if angle > 0.0 { PI * (0.5 * angle).sin().powi(2) } else { 1.0 };
    let irradiance = match (blender, is_normalized(prim, time)) {
        (true, true) => 4.0 * radiance,
        (_, true) => radiance,
        (_, false) => radiance * size,
    };
    let direction = map.transform_vector3(DVec3::Z);
    Light::Sun { direction, irradiance: irradiance.as_vec3(), angle }
}

/// Returns a sphere or a point.
///
/// # Errors
/// If the sphere is scaled by another factor along each axis.
fn sphere(prim: &Prim, time: f64, map: DMat4, radiance: DVec3) -> Result<Light> {
    let axes = [map.x_axis, map.y_axis, map.z_axis].map(|axis| axis.truncate().length());
    let (least, most) = (axes[0].min(axes[1]).min(axes[2]), axes[0].max(axes[1]).max(axes[2]));
    let radius = prim.number("inputs:radius", time).unwrap_or(0.5);
    let point = prim.bool("treatAsPoint", time) == Some(true) || radius == 0.0;
    if most - least > 1e-3 * most && radius > 0.0 {
        return Err(Error::unsupported(format!("the sphere is scaled by {}, {} and {}", axes[0], axes[1], axes[2]))
            .hint("give it one scale: ellipsoids are not simulated"));
    }
    let centre = map.w_axis.truncate();
    let radius = radius * most;
    let normalized = is_normalized(prim, time);
    if point {
        // L π r², and of a normalized sphere I / (4 π r²) π r² whatever its radius.
        let intensity = if normalized { 0.25 * radiance } else { radiance * PI * radius * radius };
        return Ok(Light::Point { position: centre, intensity: intensity.as_vec3() });
    }
    let radiance = if normalized { radiance / (4.0 * PI * radius * radius) } else { radiance };
    Ok(Light::Sphere { centre, radius, radiance: radiance.as_vec3() })
}

/// Returns the cone that a light is shaped by. Light leaves along the prim's -Z.
///
/// # Errors
/// If its angle or softness cannot be used.
fn cone(stage: &Stage, prim: &Prim, time: f64, map: DMat4) -> Result<Option<Cone>> {
    let Some(angle) = prim.number("inputs:shaping:cone:angle", time) else { return Ok(None) };
    // Without the schema, the fallback counts as none.
    let applied = prim.schemas.iter().any(|schema| schema == "ShapingAPI");
    if angle >= if applied { 180.0 } else { 90.0 } {
        return Ok(None);
    }
    let angle = angle.to_radians();
    let softness = prim.number("inputs:shaping:cone:softness", time).unwrap_or(0.0);
    let blend = if is_of_blender(stage, prim) { softness } else { blend(angle, softness) };
    Cone::new(map.transform_vector3(DVec3::NEG_Z), angle, blend).map(Some)
}

/// Returns the blend of a cone whose falloff takes a part of its angle.
fn blend(angle: f64, softness: f64) -> f64 {
    let (start, rim) = ((angle * (1.0 - softness)).cos(), angle.cos());
    // Rounding must not make a little more than all of it.
    if (0.0..=1.0).contains(&softness) { ((start - rim) / (1.0 - rim)).clamp(0.0, 1.0) } else { softness }
}

/// Returns the part of a cone's angle that its falloff takes: the inverse of [`blend`].
pub(super) fn softness(angle: f64, blend: f64) -> f64 {
    let start = angle.cos() + blend * (1.0 - angle.cos());
    1.0 - start.clamp(-1.0, 1.0).acos() / angle
}

/// Returns a point or sphere with soft falloff.
fn softened(light: Light, soft: bool) -> Light {
    match light {
        Light::Sphere { centre, radius, radiance } if soft => Light::Disc { centre, radius, radiance },
        light => light,
    }
}

/// Returns a point or sphere whose light leaves in a cone.
fn spot(light: Light, soft: bool, cone: Cone) -> Light {
    match light {
        Light::Point { position, intensity } => Light::Spot { position, radius: 0.0, soft, intensity, cone },
        Light::Sphere { centre, radius, radiance } => {
            let intensity = radiance * (PI * radius * radius) as f32;
            Light::Spot { position: centre, radius, soft, intensity, cone }
        }
        light => light,
    }
}

/// Returns a rectangle in the prim's plane of X and Y, whose light leaves towards -Z.
fn rectangle(prim: &Prim, time: f64, map: DMat4, radiance: DVec3) -> Light {
    let side = |name: &str| prim.number(name, time).unwrap_or(1.0);
    let (x, y) = (
        map.transform_vector3(DVec3::X * side("inputs:width")),
        map.transform_vector3(DVec3::Y * side("inputs:height")),
    );
    let corner = map.w_axis.truncate() - 0.5 * (x + y);
    // A map that mirrors would turn the front to the back.
    let edges = if x.cross(y).dot(map.transform_vector3(DVec3::Z)) > 0.0 { [y, x] } else { [x, y] };
    let area = x.cross(y).length();
    let radiance = if is_normalized(prim, time) && area > 0.0 { radiance / area } else { radiance };
    Light::Rectangle { corner, edges, radiance: radiance.as_vec3() }
}

/// Place and light of a dome.
struct Dome {
    map: DMat4,
    radiance: DVec3,
    limits: Limits,
}

/// Adds light from all around.
fn dome(stage: &Stage, prim: &Prim, time: f64, dome: Dome, all: &mut Lights) -> Result<()> {
    let radiance = dome.radiance.as_vec3();
    if !(radiance.is_finite() && radiance.min_element() >= 0.0) {
        return Err(Error::invalid(format!("light of {radiance} must be finite and not negative"))
            .hint("correct its intensity, exposure and color"));
    }
    let asset = prim.value("inputs:texture:file", time).and_then(|v| v.asset().cloned()).filter(|a| has_path(Some(a)));
    let Some(asset) = asset else {
        all.environment.radiance.iter_mut().zip(radiance.to_array()).for_each(|(sum, v)| *sum += v);
        return Ok(());
    };
    let format = prim.text("inputs:texture:format", time).unwrap_or_else(|| "automatic".into());
    if !["automatic", "latlong"].contains(&format.as_str()) {
        let what = format!("light {} is left out: textures of format '{format}' are not understood", prim.path);
        all.remarks.push(what);
        return Ok(());
    }
    if all.environment.map.is_some() {
        return Err(Error::unsupported("a second dome has a texture").hint("add both pictures to one beforehand"));
    }
    let map = match stage.read(&asset, |file| environment_map(file, radiance.to_array(), dome.limits)) {
        Err(e) if e.what() == BLACK => {
            all.remarks.push(format!("light {} is dark: its texture or color is black", prim.path));
            return Ok(());
        }
        map => map?,
    };
    all.environment.map = Some(Arc::new(map.turned(orientation(stage, prim, time, dome.map))));
    all.files.extend(asset.packaged().is_none().then_some(asset.path));
    Ok(())
}

/// Returns the rotation from the axes of environment maps to those of the world.
///
/// The picture's top is towards the dome's pole, its middle towards +Z and its left towards +X of the dome, for a pole
/// along +Y. Environment maps have their top towards +Z, their middle towards +X and their left towards +Y.
fn orientation(stage: &Stage, prim: &Prim, time: f64, map: DMat4) -> DMat3 {
    let pole = match (prim.type_name.as_str(), prim.text("poleAxis", time).as_deref()) {
        ("DomeLight", _) | (_, Some("Y")) => UpAxis::Y,
        (_, Some("Z")) => UpAxis::Z,
        _ => stage.up_axis(),
    };
    let placed = match pole {
        UpAxis::Y => DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y),
        // The dome of +Y, turned by 90 degrees about X.
        UpAxis::Z => DMat3::from_cols(DVec3::NEG_Y, DVec3::X, DVec3::Z),
    };
    let axes = DMat3::from_mat4(map);
    let unit = |axis: DVec3| axis.normalize_or_zero();
    DMat3::from_cols(unit(axes.x_axis), unit(axes.y_axis), unit(axes.z_axis)) * placed
}
