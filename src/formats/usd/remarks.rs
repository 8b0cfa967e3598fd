//! What a stage states and pictures do not show, or show otherwise, in words.

use super::prim::Prim;
use super::stage::Stage;

/// Says how lights of Blender are read, where there are suns among them.
pub(super) fn blender(stage: &Stage) -> Option<String> {
    let documentation = stage.metadata.documentation.as_deref().filter(|doc| doc.starts_with("Blender v"))?;
    let sun = stage.of_type("DistantLight").next()?;
    Some(format!(
        "light {} and other suns are read as Blender writes them ({documentation}): a quarter of the strength, half of the \
         angle",
        sun.path
    ))
}

/// Tells how many surfaces there are, which no picture shows.
pub(super) fn surfaces(stage: &Stage, time: f64) -> Option<String> {
    const SHAPES: [&str; 12] = [
        "Mesh",
        "Points",
        "BasisCurves",
        "NurbsCurves",
        "NurbsPatch",
        "Cube",
        "Sphere",
        "Cylinder",
        "Cone",
        "Capsule",
        "Plane",
        "PointInstancer",
    ];
    let shape = |prim: &&Prim| SHAPES.contains(&prim.type_name.as_str()) && stage.is_rendered(prim, time);
    let count = stage.prims().filter(shape).count();
    (count > 0).then(|| format!("surfaces are not rendered: {count} prim(s), such as meshes, are left out"))
}

/// Tells of volumes beneath a `PointInstancer`, whose instances are not shown.
pub(super) fn prototypes(stage: &Stage) -> impl Iterator<Item = String> {
    stage
        .volumes()
        .filter(|volume| stage.is_prototype(volume))
        .map(|volume| format!("volume {} is left out: instances of a PointInstancer are not rendered", volume.path))
}
