//! Meshes as prims of UsdGeom, with Cumulo's own attributes for what they do with light, and colors for others.

use super::light::placed;
use super::text::{Content, Literal, PrimText, Property};
use super::volume::extent;
use crate::formats::mesh::Mesh;
use crate::formats::usd::own::{ALBEDO, EMISSION, HOLDOUT};
use crate::math::Aabb;
use crate::scene::meshes::Material;
use glam::DMat4;

/// A mesh to be written.
#[derive(Debug, Clone)]
pub(crate) struct MeshPrim {
    /// Name of the prim.
    pub name: String,
    /// Polygons by time code; a single one without for a mesh at rest.
    pub frames: Vec<(Option<u32>, Mesh)>,
    /// Map from the space of the polygons to the stage's.
    pub placement: Option<DMat4>,
    /// Material of the surface.
    pub material: Material,
}

impl MeshPrim {
    /// Returns the prim.
    pub(crate) fn prim(&self) -> PrimText {
        let mut prim = PrimText::new("Mesh", self.name.clone());
        prim.set("uniform token", "subdivisionScheme", Literal::text("none"));
        prim.set("uniform bool", "doubleSided", Literal::Bool(true));
        let bounds = |mesh: &Mesh| mesh.vertices.iter().fold(Aabb::EMPTY, |bounds, at| bounds.including(*at));
        let integers =
            |values: &mut dyn Iterator<Item = u32>| Literal::Array(values.map(|v| Literal::Int(v.into())).collect());
        self.set(&mut prim, "float3[]", "extent", |mesh| extent(bounds(mesh)));
        self.set(&mut prim, "point3f[]", "points", |mesh| {
            Literal::Array(mesh.vertices.iter().map(|at| Literal::floats(at.as_vec3().to_array())).collect())
        });
        self.set(&mut prim, "int[]", "faceVertexCounts", |mesh| {
            integers(&mut mesh.polygons().map(|polygon| polygon.len() as u32))
        });
        self.set(&mut prim, "int[]", "faceVertexIndices", |mesh| integers(&mut mesh.corners.iter().copied()));
        let Material { albedo, emission, holdout } = self.material;
        prim.set("color3f[]", "primvars:displayColor", Literal::Array(vec![Literal::floats(albedo.to_array())]));
        prim.set("custom color3f", ALBEDO, Literal::floats(albedo.to_array()));
        prim.set("custom color3f", EMISSION, Literal::floats(emission.to_array()));
        prim.set("custom bool", HOLDOUT, Literal::Bool(holdout));
        match self.placement {
            Some(map) => placed(prim, map),
            None => prim,
        }
    }

    /// Sets an attribute to its value in each frame.
    fn set(&self, prim: &mut PrimText, declaration: &'static str, name: &str, value: impl Fn(&Mesh) -> Literal) {
        let Some((_, first)) = self.frames.first() else { return };
        let samples: Vec<_> =
            self.frames.iter().filter_map(|(time, mesh)| Some((f64::from((*time)?), value(mesh)))).collect();
        let first = value(first);
        let content = if samples.is_empty() { Content::Default(first) } else { Content::Samples(first, samples) };
        prim.properties.push(Property { declaration, name: name.to_owned(), content });
    }
}
