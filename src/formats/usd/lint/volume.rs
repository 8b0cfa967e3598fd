//! Relationships of volumes to their fields, and of both to what else they name.

use super::finding::Finding;
use crate::formats::usd::{Prim, Stage};
use std::collections::BTreeMap;

/// Types of prims that are fields.
const FIELDS: [&str; 2] = ["OpenVDBAsset", "Field3DAsset"];

/// Finds relationships that lead nowhere, and fields that are related more than once or by none.
pub(super) fn check(stage: &Stage, findings: &mut Vec<Finding>) {
    let mut related = Vec::new();
    for prim in stage.prims() {
        targets(stage, prim, findings);
    }
    for volume in stage.volumes() {
        let fields = fields(volume);
        if fields.is_empty() {
            findings.push(Finding::problem(
                "no-field",
                Some(&volume.path),
                "the volume has no relationship 'field:…'",
                "relate its OpenVDBAsset prims, such as rel field:density = </World/smoke/density>",
            ));
        }
        for what in stage.unclear_fields(volume) {
            let remedy = "leave one target, the prim that names the file";
            findings.push(Finding::problem("field-type", Some(&volume.path), what, remedy));
        }
        for (name, target) in &fields {
            let Some(prim) = stage.prim(target) else { continue };
            if !FIELDS.contains(&prim.type_name.as_str()) {
                findings.push(Finding::problem(
                    "field-type",
                    Some(&volume.path),
                    format!("field:{name} leads to {target} of type '{}', not to an OpenVDBAsset", prim.type_name),
                    "relate the prim that names the file",
                ));
            }
        }
        duplicates(stage, volume, &fields, findings);
        related.extend(fields.into_iter().map(|(_, target)| target));
    }
    for prim in stage.of_type(FIELDS[0]).filter(|prim| !related.contains(&prim.path)) {
        findings.push(Finding::note(
            "unused-field",
            Some(&prim.path),
            "no volume is related to this field: it is not seen",
            "relate it as field:… of a volume, or remove it",
        ));
    }
}

/// Returns the fields of a volume: the names of relationships without `field:`, and each of their targets.
fn fields(volume: &Prim) -> Vec<(String, String)> {
    let named = volume.relationships.iter().filter_map(|(name, targets)| Some((name.strip_prefix("field:")?, targets)));
    named.flat_map(|(name, targets)| targets.iter().map(|target| (name.to_owned(), target.clone()))).collect()
}

/// Finds targets that do not exist, of the relationships that matter to volumes.
fn targets(stage: &Stage, prim: &Prim, findings: &mut Vec<Finding>) {
    let matters = |name: &str| name.starts_with("field:") || name.starts_with("material:binding");
    for (name, targets) in prim.relationships.iter().filter(|(name, _)| matters(name)) {
        for target in targets.iter().filter(|target| stage.prim(target).is_none()) {
            findings.push(Finding::problem(
                "unresolved-target",
                Some(&prim.path),
                format!("{name} leads to {target}, which does not exist"),
                "correct the path, or remove the relationship",
            ));
        }
    }
}

/// Finds grids that a volume has twice.
fn duplicates(stage: &Stage, volume: &Prim, fields: &[(String, String)], findings: &mut Vec<Finding>) {
    let time = stage.first_time();
    let mut seen: BTreeMap<(String, String, i64), &str> = BTreeMap::new();
    for (name, target) in fields {
        let Some(prim) = stage.prim(target) else { continue };
        let held = |attribute: &str| prim.attribute(attribute)?.held_at(time);
        let file = held("filePath").and_then(|v| v.asset().map(|a| a.path.to_string_lossy().into_owned()));
        let grid = held("fieldName").and_then(|v| v.text().map(str::to_owned));
        let index = held("fieldIndex").and_then(|v| v.int()).unwrap_or_default();
        let (Some(file), Some(grid)) = (file, grid) else { continue };
        let what = format!("grid '{grid}' (fieldIndex {index})");
        if let Some(before) = seen.insert((file, grid, index), name) {
            findings.push(Finding::problem(
                "duplicate-field",
                Some(&volume.path),
                format!("field:{before} and field:{name} are both {what} of one file"),
                "name another grid, or give fields of one name different fieldIndex; remove one of them otherwise",
            ));
        }
    }
}
