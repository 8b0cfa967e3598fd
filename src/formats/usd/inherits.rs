//! Classes that prims inherit or specialize, followed before the crate `openusd` follows them.
//!
//! The crate composes what a prim inherits, and what that inherits in turn, by calls within calls that neither end in a
//! circle nor remember where they have been. They take paths of every arc above a prim for possible places of a class,
//! so that circles arise in stages that have none: where `</World/m>` inherits `</World/class>` and references
//! `@file@</World>`, the class is sought at `</World/m/class>` as well, which is a child of the prim that inherits it.

use crate::error::{Error, Result};
use openusd::pcp::{self, ArcType};
use openusd::sdf;
use openusd::usd;
use std::collections::{BTreeMap, HashMap};

/// Greatest number of classes each of which inherits the next.
const MOST_DEPTH: usize = 200;
/// Largest number of classes that the crate composes for a prim, those that it meets again counted again.
const MOST_CALLS: usize = 100_000;
/// Advice where the crate cannot follow what a stage inherits.
const FLATTEN: &str = "let the prim inherit a class that lies outside it, at the stage's root for instance, or flatten \
                       the stage with a tool for USD";

/// Classes of a stage's prims that were followed so far.
#[derive(Default)]
pub(super) struct Inherits {
    /// Calls by the path of a prim that was followed to its end; `None` while it is followed.
    calls: HashMap<sdf::Path, Option<usize>>,
    /// Classes that lie deep beneath a prim that was followed when they were met, by which they are followed
    /// afterwards.
    deep: BTreeMap<sdf::Path, bool>,
}

impl Inherits {
    /// Follows what a prim and its parent inherit. Prims above it were followed before, or are now.
    ///
    /// # Errors
    /// If it leads in a circle, or further than the crate can follow. The error names a class, and the caller the prim.
    pub(super) fn follow(&mut self, stage: &usd::Stage, path: &sdf::Path) -> Result<()> {
        self.calls(stage, path, 0).map_err(|e| e.hint(FLATTEN))?;
        while let Some((class, followed)) = self.deep.iter_mut().find(|(_, followed)| !**followed) {
            *followed = true;
            let class = class.clone();
            // What leads to it was followed without it.
            self.calls.clear();
            self.calls(stage, &class, 0).map_err(|e| e.hint(FLATTEN))?;
        }
        Ok(())
    }

    /// Returns the number of calls by which the crate composes what a prim inherits.
    fn calls(&mut self, stage: &usd::Stage, path: &sdf::Path, depth: usize) -> Result<usize> {
        match self.calls.get(path) {
            Some(Some(calls)) => return Ok(*calls),
            Some(None) => return Err(refused(path, "leads in a circle by way of")),
            None if depth > MOST_DEPTH => return Err(refused(path, "goes through too many classes, such as")),
            None => {}
        }
        let Some(parent) = path.parent() else { return Ok(0) };
        self.calls(stage, &parent, depth + 1)?;
        self.calls.insert(path.clone(), None);
        let mut calls = 1_usize;
        for class in classes(stage, &parent, path) {
            // The crate leaves for later what lies beneath a prim that it composes. A child of that prim takes what the
            // prim inherits for its own, and so leads back.
            let open = |path: &sdf::Path| matches!(self.calls.get(path), Some(None));
            let above = class.strict_ancestors().position(|above| open(&above));
            match above {
                Some(0) => return Err(refused(&class, "leads in a circle by way of")),
                Some(_) => {
                    self.deep.entry(class).or_insert(false);
                }
                None => calls += self.calls(stage, &class, depth + 1)?,
            }
            if calls > MOST_CALLS {
                return Err(refused(path, "multiplies through classes that inherit several others, such as"));
            }
        }
        self.calls.insert(path.clone(), Some(calls));
        Ok(calls)
    }
}

fn refused(class: &sdf::Path, how: &str) -> Error {
    Error::unsupported(format!("what it inherits {how} <{class}>, as far as the reader of stages can tell"))
}

/// Returns the paths at which the crate looks for classes before it composes a prim whose parent is composed.
fn classes(stage: &usd::Stage, parent: &sdf::Path, path: &sdf::Path) -> Vec<sdf::Path> {
    let Ok(index) = stage.prim_index(parent.clone()).graph() else { return Vec::new() };
    let mut found: Vec<sdf::Path> = Vec::new();
    let mut add = |class: sdf::Path| {
        if !found.contains(&class) {
            found.push(class);
        }
    };
    let mut arcs: Option<Vec<pcp::MapFunction>> = None;
    for node in index.nodes() {
        let child = path.name().and_then(|name| node.path().append_path(name).ok());
        for (layer, _) in stage.node_layer_stack(node) {
            let Some(layer) = stage.layer_identifier(layer) else { continue };
            let Some(layer) = stage.layer(&layer) else { continue };
            for site in [Some(node.path()), child.as_ref()].into_iter().flatten() {
                for class in stated(&layer, site) {
                    let arcs = arcs.get_or_insert_with(|| above(stage, parent));
                    arcs.iter().filter_map(|map| map.map_source_to_target(&class)).for_each(&mut add);
                    add(class);
                }
            }
        }
    }
    found
}

/// Returns the classes that a layer states at a prim.
fn stated(layer: &sdf::Layer, site: &sdf::Path) -> Vec<sdf::Path> {
    let fields = [sdf::FieldKey::InheritPaths, sdf::FieldKey::Specializes];
    let lists =
        fields.into_iter().filter_map(|field| match layer.data().get_field(site, field.as_str()).ok()?.into_owned() {
            sdf::Value::PathListOp(list) => Some(list.flatten()),
            _ => None,
        });
    lists.flatten().map(|class| site.make_absolute(&class)).collect()
}

/// Returns the maps of all arcs of a prim and of those above it.
fn above(stage: &usd::Stage, path: &sdf::Path) -> Vec<pcp::MapFunction> {
    let indices = path.ancestors_below_root().filter_map(|path| stage.prim_index(path).graph().ok());
    indices
        .flat_map(|index| {
            let nodes = index.all_nodes().filter(|node| node.arc() != ArcType::Root);
            nodes.map(|node| node.map_to_root().clone()).collect::<Vec<_>>()
        })
        .collect()
}
