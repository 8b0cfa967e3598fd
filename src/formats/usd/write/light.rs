//! Lights as prims of UsdLux.
//!
//! A light of UsdLux sends out `intensity · color`: without `normalize` the radiance that leaves it, with it, for a
//! `DistantLight`, the irradiance on a surface that faces it. Spots have the `ShapingAPI`, whose softness is the
//! part of the angle that the falloff takes, and soft falloff has an attribute of its own.

use super::text::{Literal, PrimText, Property};
use crate::error::{Error, Result};
use crate::formats::scene_file::LightEntry;
use crate::formats::usd::light::{SOFT_FALLOFF, softness};
use glam::{DMat4, DQuat, DVec3};

/// Radius in units of the stage of the sphere that stands for a point light, as `treatAsPoint` says.
const POINT_RADIUS: f64 = 0.01;

/// Returns the prim of a light. `texture` is the path of a dome's picture from the stage's folder.
///
/// # Errors
/// If a rectangle's edges are not at right angles, which UsdLux has no light for.
pub(crate) fn prim(light: &LightEntry, name: String, texture: Option<String>) -> Result<PrimText> {
    Ok(match *light {
        LightEntry::DistantLight { direction, irradiance, angle } => {
            let mut prim = emitting("DistantLight", name, irradiance);
            prim.set("bool", "inputs:normalize", Literal::Bool(true));
            prim.set("float", "inputs:angle", Literal::Number(angle));
            placed(prim, turned_towards(DVec3::from_array(direction)))
        }
        LightEntry::PointLight { position, intensity } => {
            let prim = of_intensity(name, intensity, 0.0);
            placed(prim, DMat4::from_translation(DVec3::from_array(position)))
        }
        LightEntry::SphereLight { centre, radius, radiance, soft_falloff } => {
            let mut prim = emitting("SphereLight", name, radiance);
            prim.set("float", "inputs:radius", Literal::Number(radius));
            if soft_falloff {
                prim.set("custom bool", SOFT_FALLOFF, Literal::Bool(true));
            }
            placed(prim, DMat4::from_translation(DVec3::from_array(centre)))
        }
        LightEntry::SpotLight { position, direction, intensity, angle, blend, radius, soft_falloff } => {
            let mut prim = of_intensity(name, intensity, radius);
            prim.metadata.push("prepend apiSchemas = [\"ShapingAPI\"]".into());
            let half = 0.5 * angle;
            prim.set("float", "inputs:shaping:cone:angle", Literal::Number(half));
            prim.set("float", "inputs:shaping:cone:softness", Literal::Number(softness(half.to_radians(), blend)));
            if soft_falloff {
                prim.set("custom bool", SOFT_FALLOFF, Literal::Bool(true));
            }
            let turned = turned_towards(-DVec3::from_array(direction));
            placed(prim, DMat4::from_translation(DVec3::from_array(position)) * turned)
        }
        LightEntry::RectLight { corner, edges, radiance } => {
            let [u, v] = edges.map(DVec3::from_array);
            if u.normalize().dot(v.normalize()).abs() > 1e-6 {
                return Err(Error::unsupported(format!(
                    "a RectLight with edges {u} and {v}, which are not at right angles"
                ))
                .hint("UsdLux has rectangles, no other parallelograms: give edges at right angles"));
            }
            let mut prim = emitting("RectLight", name, radiance);
            prim.set("float", "inputs:width", Literal::Number(u.length()));
            prim.set("float", "inputs:height", Literal::Number(v.length()));
            // Light leaves along -Z, which is to be u × v: -u, v and -(u × v) are right-handed.
            let axes = [-u.normalize(), v.normalize(), -u.cross(v).normalize()];
            let middle = DVec3::from_array(corner) + 0.5 * (u + v);
            placed(
                prim,
                DMat4::from_cols(axes[0].extend(0.0), axes[1].extend(0.0), axes[2].extend(0.0), middle.extend(1.0)),
            )
        }
        LightEntry::DomeLight { radiance, .. } => {
            let mut prim = emitting("DomeLight", name, radiance);
            let Some(texture) = texture else { return Ok(prim) };
            prim.set("asset", "inputs:texture:file", Literal::Asset(texture));
            prim.set("token", "inputs:texture:format", Literal::text("latlong"));
            // In UsdLux the picture's top is +Y, its middle +Z and left of it lies +X; here they are +Z, +X and +Y.
            placed(
                prim,
                DMat4::from_cols(DVec3::Y.extend(0.0), DVec3::Z.extend(0.0), DVec3::X.extend(0.0), glam::DVec4::W),
            )
        }
    })
}

/// Returns a sphere of a radiant intensity as seen from far away; one of radius 0 is a point.
fn of_intensity(name: String, intensity: [f32; 3], radius: f64) -> PrimText {
    let size = if radius > 0.0 { radius } else { POINT_RADIUS };
    // A sphere of radiance L has the radiant intensity L π r².
    let area = std::f64::consts::PI * size * size;
    let mut prim = emitting("SphereLight", name, intensity.map(|v| (f64::from(v) / area) as f32));
    prim.set("float", "inputs:radius", Literal::Number(size));
    if radius == 0.0 {
        prim.set("bool", "treatAsPoint", Literal::Bool(true));
    }
    prim
}

/// Returns a light that sends out so much, split into an intensity and a color whose largest channel is 1.
fn emitting(kind: &'static str, name: String, light: [f32; 3]) -> PrimText {
    let most = light.into_iter().fold(0.0, f32::max);
    let color = if most > 0.0 { light.map(|v| v / most) } else { [1.0; 3] };
    let mut prim = PrimText::new(kind, name);
    prim.set("float", "inputs:intensity", Literal::Single(most));
    prim.set("color3f", "inputs:color", Literal::floats(color));
    prim
}

/// Returns a rotation of a light that shines along its -Z so that it comes from a direction.
fn turned_towards(direction: DVec3) -> DMat4 {
    DMat4::from_quat(DQuat::from_rotation_arc(DVec3::Z, direction.normalize()))
}

/// Places a prim by a map that acts on column vectors.
pub(crate) fn placed(mut prim: PrimText, map: DMat4) -> PrimText {
    prim.set("matrix4d", "xformOp:transform", matrix(map));
    let order = Literal::Array(vec![Literal::text("xformOp:transform")]);
    prim.properties.push(Property::new("uniform token[]", "xformOpOrder", order));
    prim
}

/// Returns a map as USD has it: rows, for row vectors.
pub(crate) fn matrix(map: DMat4) -> Literal {
    // The columns of the map for column vectors are the rows of that for row vectors. -0 is no other place than 0.
    Literal::Tuple(map.to_cols_array_2d().map(|column| Literal::doubles(column.map(|v| v + 0.0))).to_vec())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    fn written(light: LightEntry, texture: Option<&str>) -> String {
        let mut text = String::new();
        prim(&light, "light".into(), texture.map(Into::into)).unwrap().write(&mut text, 0);
        text
    }

    #[test]
    fn a_sun_shines_along_its_negative_z() {
        let sun = LightEntry::DistantLight { direction: [0.0, 0.0, 2.0], irradiance: [2.0, 4.0, 1.0], angle: 0.5 };
        let text = written(sun, None);
        assert!(text.contains("inputs:intensity = 4\n") && text.contains("(0.5, 1, 0.25)"), "{text}");
        assert!(text.contains("((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))"), "{text}");
        let dark = LightEntry::DistantLight { direction: [1.0, 0.0, 0.0], irradiance: [0.0; 3], angle: 0.0 };
        let text = written(dark, None);
        assert!(text.contains("inputs:intensity = 0\n") && text.contains("color = (1, 1, 1)"), "{text}");
        for direction in [DVec3::X, DVec3::NEG_Z, DVec3::new(-1.0, 0.6, 0.7)] {
            let map = turned_towards(direction);
            let towards = map.transform_vector3(DVec3::Z);
            assert!(towards.abs_diff_eq(direction.normalize(), 1e-14) && (map.determinant() - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn rectangles_face_along_their_edges_cross_product() {
        let edges = [[2.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
        let text = written(LightEntry::RectLight { corner: [1.0, 1.0, 5.0], edges, radiance: [1.0; 3] }, None);
        assert!(text.contains("inputs:width = 2\n") && text.contains("inputs:height = 3\n"), "{text}");
        // -Z is to be +Z of the world; the middle is at (2, 2.5, 5).
        assert!(text.contains("((-1, 0, 0, 0), (0, 1, 0, 0), (0, 0, -1, 0), (2, 2.5, 5, 1))"), "{text}");
        let edges = [[2.0, 0.0, 0.0], [1.0, 3.0, 0.0]];
        let slanted = LightEntry::RectLight { corner: [0.0; 3], edges, radiance: [1.0; 3] };
        assert!(prim(&slanted, "l".into(), None).unwrap_err().to_string().contains("right angles"));
    }

    #[test]
    fn domes_turn_their_pictures() {
        let dome = LightEntry::DomeLight { radiance: [0.5; 3], texture: None };
        assert!(!written(dome.clone(), None).contains("xformOp"));
        let text = written(dome, Some("./sky.exr"));
        assert!(text.contains("@./sky.exr@"), "{text}");
        assert!(text.contains("((0, 1, 0, 0), (0, 0, 1, 0), (1, 0, 0, 0), (0, 0, 0, 1))"), "{text}");
    }
}
