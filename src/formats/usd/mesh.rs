//! Meshes of stages, after UsdGeom, and what their materials say of diffuse light.
//!
//! The diffuse and the emissive color of the `UsdPreviewSurface` that is bound to the mesh, or to subsets of its faces,
//! count, and without one the `displayColor` of the mesh or of a prim above it. The attributes `cumulo:albedo`,
//! `cumulo:emission` and `cumulo:holdout` of a mesh, those of scene files, go before them. Reflections, textures and
//! transparency are left out. Meshes are rendered as their polygons, whatever subdivision they ask for.

use super::medium::bound_shaders;
use super::own::{ALBEDO, EMISSION, HOLDOUT};
use super::prim::Prim;
use super::stage::Stage;
use super::value::Value;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::mesh::Mesh;
use crate::formats::scene_file::LoadedScene;
use crate::scene::meshes::Material;
use glam::{DVec3, Vec3};
use std::collections::{BTreeMap, BTreeSet};

/// Reads the meshes of a stage at a time code into a scene.
///
/// # Errors
/// If faces and points contradict each other, a number of a material cannot be used, or all meshes do not fit into the
/// limits. The error names the prim.
pub(super) fn meshes(stage: &Stage, time: f64, limits: Limits, scene: &mut LoadedScene) -> Result<()> {
    let mut remarks = BTreeSet::new();
    for prim in stage.of_type("Mesh").filter(|prim| stage.is_rendered(prim, time)) {
        let blame = |e: Error| stage.blame(e, prim);
        let Some(mut mesh) = polygons(prim, time).map_err(blame)? else {
            remarks.insert(format!("mesh {} has no faces", prim.path));
            continue;
        };
        let map = stage.local_to_world(prim, time)?;
        mesh.vertices.iter_mut().for_each(|at| *at = map.transform_point3(*at));
        if prim.text("subdivisionScheme", time).is_none_or(|scheme| scheme != "none") {
            remarks.insert(format!("mesh {} is rendered as its polygons: surfaces are not subdivided", prim.path));
        }
        let faces = subsets(stage, prim, (mesh.ends.len(), time), &mut remarks);
        let mut parts = BTreeMap::<usize, Vec<_>>::new();
        for (polygon, triangle) in mesh.surface(limits).map_err(blame)? {
            parts.entry(faces.of_face[polygon]).or_default().push(triangle);
        }
        for (bound, triangles) in parts {
            let bound = faces.prims.get(bound).copied().unwrap_or(prim);
            let stated = stated(stage, (prim, bound), time, &mut remarks);
            let material = own(prim, time, stated).map_err(blame)?;
            scene.push_mesh(triangles, material.checked().map_err(blame)?, limits).map_err(blame)?;
        }
    }
    scene.remarks.extend(remarks);
    Ok(())
}

/// Reads the polygons of a mesh; `None` if it has none.
fn polygons(prim: &Prim, time: f64) -> Result<Option<Mesh>> {
    let long = |name: &str| prim.attribute(name).and_then(|attribute| attribute.at(time));
    let [points, counts, indices] = ["points", "faceVertexCounts", "faceVertexIndices"].map(long);
    let (Some(points), Some(counts), Some(indices)) = (points, counts, indices) else { return Ok(None) };
    let other = |name: &str, kind: &str| {
        Error::invalid(format!("'{name}' is no array of {kind}")).hint("export the mesh again where it was made")
    };
    let vertices = points.points().ok_or_else(|| other("points", "points"))?;
    let counts = counts.integers().ok_or_else(|| other("faceVertexCounts", "integers"))?;
    let indices = indices.integers().ok_or_else(|| other("faceVertexIndices", "integers"))?;
    if counts.is_empty() {
        return Ok(None);
    }
    let bad = |what: String| Error::invalid(what).hint("export the mesh again where it was made");
    if vertices.iter().any(|at| !at.is_finite()) {
        return Err(bad("a point is not finite".into()));
    }
    if let Some(few) = counts.iter().find(|count| **count < 3) {
        return Err(bad(format!("a face has {few} corners; 3 or more are expected")));
    }
    let sum = counts.iter().fold(0_i64, |sum, count| sum.saturating_add(*count));
    if sum != indices.len() as i64 || sum > i64::from(u32::MAX) {
        return Err(bad(format!("faces of {sum} corners in all have {} indices of points", indices.len())));
    }
    let corner = |index: &i64| u32::try_from(*index).ok().filter(|index| (*index as usize) < vertices.len());
    let Some(corners) = indices.iter().map(corner).collect::<Option<Vec<u32>>>() else {
        return Err(bad(format!("a face names a point that is not among the {}", vertices.len())));
    };
    let ends = counts.iter().scan(0, |end, count| {
        *end += *count as u32;
        Some(*end)
    });
    let ends = ends.collect();
    Ok(Some(Mesh { vertices, corners, ends }))
}

/// Subsets of a mesh's faces to which materials are bound.
struct Subsets<'s> {
    prims: Vec<&'s Prim>,
    /// Number of the subset of each face; `prims.len()` for faces of none.
    of_face: Vec<usize>,
}

/// Returns the subsets of a mesh's faces to which materials are bound. A face belongs to the first that names it.
fn subsets<'s>(
    stage: &'s Stage,
    mesh: &'s Prim,
    (faces, time): (usize, f64),
    remarks: &mut BTreeSet<String>,
) -> Subsets<'s> {
    let binds = |prim: &&Prim| prim.relationships.keys().any(|name| name.starts_with("material:binding"));
    let prims: Vec<&Prim> = stage.children(mesh).filter(|prim| prim.type_name == "GeomSubset").filter(binds).collect();
    let mut of_face = vec![prims.len(); faces];
    for (number, prim) in prims.iter().enumerate() {
        let of_faces = prim.text("elementType", time).is_none_or(|kind| kind == "face");
        let indices = prim.value("indices", time).filter(|_| of_faces).and_then(|value| value.integers());
        for face in indices.into_iter().flatten() {
            match usize::try_from(face).ok().and_then(|face| of_face.get_mut(face)) {
                Some(of) if *of == prims.len() => *of = number,
                Some(_) => {}
                None => {
                    remarks.insert(format!("subset {} names the face {face}, which is not there", prim.path));
                }
            }
        }
    }
    Subsets { prims, of_face }
}

/// Returns what the attributes of the namespace `cumulo` state, in place of what else is stated.
///
/// # Errors
/// If one has a value of another kind.
fn own(prim: &Prim, time: f64, stated: Material) -> Result<Material> {
    let [albedo, emission, holdout] = [ALBEDO, EMISSION, HOLDOUT].map(|name| prim.value(name, time));
    let wrong = |name: &str, expected: &str| {
        Error::invalid(format!("the attribute '{name}' is not {expected}"))
            .hint("correct its type and value, or remove it")
    };
    let color = |name: &str, value: &Value| {
        let color = value.tuple::<3>().map(|color| Vec3::from_array(color.map(|v| v as f32)));
        color.ok_or_else(|| wrong(name, "three numbers such as (0.5, 0.5, 0.5)"))
    };
    Ok(Material {
        albedo: albedo.map_or(Ok(stated.albedo), |value| color(ALBEDO, &value))?,
        emission: emission.map_or(Ok(stated.emission), |value| color(EMISSION, &value))?,
        holdout: holdout.map_or(Ok(false), |value| value.bool().ok_or_else(|| wrong(HOLDOUT, "a truth value")))?,
    })
}

/// Returns the diffuse part of the material that is bound to a subset of a mesh, or to the mesh, else its display
/// color.
fn stated(stage: &Stage, (mesh, bound): (&Prim, &Prim), time: f64, remarks: &mut BTreeSet<String>) -> Material {
    let mut found = None;
    if let Some(path) = bound.targets("material:binding").first().filter(|path| stage.prim(path).is_none()) {
        remarks.insert(format!("mesh {}: the material {path} that is bound to it is not there", mesh.path));
    }
    for shader in bound_shaders(stage, bound, "surface") {
        match shader.text("info:id", time).as_deref() {
            Some("UsdPreviewSurface") => {
                found = Some(preview((stage, shader), time, remarks));
                break;
            }
            id => {
                let id = id.unwrap_or("no info:id");
                remarks.insert(format!("the surface shader {} ({id}) is not understood", shader.path));
            }
        }
    }
    found.unwrap_or_else(|| {
        let albedo = display_color(stage, mesh, time, remarks).unwrap_or(Material::default().albedo);
        Material { albedo, ..Material::default() }
    })
}

/// Returns the mean display color of a mesh, which a prim above it may state; `None` without one.
fn display_color(stage: &Stage, mesh: &Prim, time: f64, remarks: &mut BTreeSet<String>) -> Option<Vec3> {
    let of = |prim: &Prim| prim.value("primvars:displayColor", time)?.points().filter(|colors| !colors.is_empty());
    let colors = stage.upwards(mesh).find_map(of)?;
    if colors.iter().any(|color| *color != colors[0]) {
        remarks.insert(format!("mesh {} has the mean of its {} display colors", mesh.path, colors.len()));
    }
    let mean = (colors.iter().sum::<DVec3>() / colors.len() as f64).as_vec3();
    let possible = mean.clamp(Vec3::ZERO, Vec3::ONE);
    if possible != mean {
        remarks.insert(format!("mesh {} has a display color beyond 0 to 1, which no surface has", mesh.path));
    }
    Some(possible)
}

/// Returns the diffuse part of a `UsdPreviewSurface`, and says what of it is left out.
fn preview((stage, shader): (&Stage, &Prim), time: f64, remarks: &mut BTreeSet<String>) -> Material {
    let inputs = PREVIEWED.map(|name| (name, input(stage, shader, name, time)));
    let of = |name: &str| inputs.iter().find(|(own, _)| *own == name).map_or(&Input::Nothing, |(_, input)| input);
    let connected = |name: &&str| matches!(of(name), Input::Connected);
    let color = |name: &str, usual: f32| {
        match of(name) {
            Input::Value(value) => value.tuple::<3>().map(|v| Vec3::from_array(v.map(|v| v as f32))),
            _ => None,
        }
        .unwrap_or(Vec3::splat(usual))
    };
    let number = |name: &str, usual: f64| {
        match of(name) {
            Input::Value(value) => value.number(),
            _ => None,
        }
        .unwrap_or(usual)
    };
    let textures: Vec<&str> = PREVIEWED.into_iter().filter(connected).collect();
    if !textures.is_empty() {
        let what = textures.join(", ");
        remarks.insert(format!("material of shader {}: what is connected to {what} is left out", shader.path));
    }
    if number("opacity", 1.0) < 1.0 {
        remarks.insert(format!("material of shader {}: its transparency is left out", shader.path));
    }
    if number("metallic", 0.0) > 0.0 || number("clearcoat", 0.0) > 0.0 || number("roughness", 0.5) < 0.5 {
        remarks.insert(format!("material of shader {}: its reflections are diffuse", shader.path));
    }
    let diffuse = if connected(&"diffuseColor") { Material::default().albedo } else { color("diffuseColor", 0.18) };
    Material { albedo: diffuse.clamp(Vec3::ZERO, Vec3::ONE), emission: color("emissiveColor", 0.0), holdout: false }
}

/// Inputs of a `UsdPreviewSurface` that change what is seen.
const PREVIEWED: [&str; 8] =
    ["diffuseColor", "emissiveColor", "opacity", "normal", "displacement", "metallic", "clearcoat", "roughness"];

/// An input of a shader.
enum Input {
    /// Nothing is stated.
    Nothing,
    /// A value, its own or that of the material's input that it is connected to.
    Value(Value),
    /// It is connected to another shader.
    Connected,
}

/// Returns an input of a shader.
fn input(stage: &Stage, shader: &Prim, name: &str, time: f64) -> Input {
    let own = format!("inputs:{name}");
    let Some(attribute) = shader.attribute(&own) else { return Input::Nothing };
    let Some(source) = attribute.connections.first() else {
        return attribute.at(time).map_or(Input::Nothing, Input::Value);
    };
    let (prim, name) = source.rsplit_once('.').unwrap_or((source, ""));
    let of = stage.prim(prim).filter(|prim| prim.type_name == "Material").and_then(|prim| prim.attribute(name));
    match of.filter(|attribute| attribute.connections.is_empty()).and_then(|attribute| attribute.at(time)) {
        Some(value) => Input::Value(value),
        None => Input::Connected,
    }
}
