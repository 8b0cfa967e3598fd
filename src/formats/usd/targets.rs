//! Prims that references and payloads name, and that their layers do not have.
//!
//! The crate `openusd` tells of such payloads alone, and not of those below the root.

use super::convert;
use openusd::pcp::{Node, PrimIndex};
use openusd::sdf;
use openusd::usd;
use std::path::Path;

/// An arc to a prim that is not there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Absent {
    /// Path of the prim that states the arc.
    pub site: String,
    /// Kind of the arc, `reference` or `payload`.
    pub arc: &'static str,
    /// Layer that states the arc.
    pub stated_by: String,
    /// Layer that the arc leads to.
    pub layer: String,
    /// Path of the prim that it lacks.
    pub target: String,
}

/// Returns the arcs of a prim that lead to no prim of layers that were read; `index` is its composition.
pub(super) fn absent(stage: &usd::Stage, path: &sdf::Path, index: &PrimIndex) -> Vec<Absent> {
    let mut found = Vec::new();
    for node in index.nodes().filter(|node| node.has_specs()) {
        for (layer, _) in stage.node_layer_stack(node) {
            let Some(identifier) = stage.layer_identifier(layer) else { continue };
            for (arc, asset, target) in stated(stage, &identifier, node.path()) {
                let leads = index.all_nodes().any(|node| *node.path() == target && is_made(index, node));
                if leads {
                    continue;
                }
                let place = convert::asset(&asset, Path::new(&identifier)).path.to_string_lossy().into_owned();
                let is_there = |known: &String| *known == place || known.starts_with(&format!("{place}["));
                if let Some(layer) = stage.layer_identifiers().into_iter().find(is_there) {
                    let site = path.as_str().to_owned();
                    let target = target.as_str().to_owned();
                    found.push(Absent { site, arc, stated_by: identifier.clone(), layer, target });
                }
            }
        }
    }
    found
}

/// True if a layer states the prim of a node, or arcs of that prim or of those above it lead to one that a layer
/// states.
fn is_made(index: &PrimIndex, node: &Node) -> bool {
    node.has_specs() || node.children().iter().any(|child| is_made(index, index.node(*child)))
}

/// Returns the references and payloads to prims of other layers that a layer states at a prim.
fn stated(stage: &usd::Stage, layer: &str, site: &sdf::Path) -> Vec<(&'static str, String, sdf::Path)> {
    let Some(layer) = stage.layer(layer) else { return Vec::new() };
    let field = |key: sdf::FieldKey| Some(layer.data().get_field(site, key.as_str()).ok()?.into_owned());
    let mut all = Vec::new();
    if let Some(sdf::Value::ReferenceListOp(list)) = field(sdf::FieldKey::References) {
        all.extend(list.flatten().into_iter().map(|to| ("reference", to.asset_path, to.prim_path)));
    }
    match field(sdf::FieldKey::Payload) {
        Some(sdf::Value::PayloadListOp(list)) => {
            all.extend(list.flatten().into_iter().map(|to| ("payload", to.asset_path, to.prim_path)));
        }
        Some(sdf::Value::Payload(to)) => all.push(("payload", to.asset_path, to.prim_path)),
        _ => {}
    }
    all.retain(|(_, asset, target)| !asset.is_empty() && !target.is_empty());
    all
}
