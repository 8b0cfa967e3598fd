//! Fields against the grids of their files.

use super::cache::Files;
use super::finding::{Finding, Fix};
use super::paths;
use crate::error::Error;
use crate::formats::usd::fields::GridField;
use crate::formats::usd::write::text::{Literal, Property};
use crate::formats::usd::{Asset, Prim, Stage};
use std::collections::BTreeSet;
use std::path::Path;

/// Checks a field's paths and files, and what it states of the grids in them.
pub(super) fn check(stage: &Stage, prim: &Prim, files: &mut Files, findings: &mut Vec<Finding>) {
    let assets = assets(prim);
    if assets.is_empty() {
        findings.push(Finding::problem(
            "no-file-path",
            Some(&prim.path),
            "the field names no file",
            "give it a filePath; time samples of type asset are lost by programs that do not know them",
        ));
        return;
    }
    paths::check(stage, prim, &assets, findings);
    let mut found: Vec<Finding> = Vec::new();
    for (time, asset) in assets.iter().filter(|(_, asset)| stage.exists(asset)) {
        let shown = stage.display_path(asset);
        let path = match stage.file(asset) {
            Ok(path) => path,
            Err(error) => {
                found.push(unreadable(prim, &shown, &error));
                continue;
            }
        };
        match grid(prim, *time, [&path, &shown], files) {
            Ok(field) => found.extend(stated(prim, time.unwrap_or_default(), &field)),
            Err(finding) => found.push(*finding),
        }
    }
    // One frame says enough of a fault that all have.
    let mut told = BTreeSet::new();
    findings.extend(found.into_iter().filter(|finding| told.insert(finding.id)));
}

/// Returns the files of a field by time code; one that holds at all times has none.
pub(super) fn assets(prim: &Prim) -> Vec<(Option<f64>, Asset)> {
    let Some(attribute) = prim.attribute("filePath") else { return Vec::new() };
    let stated = |value: &crate::formats::usd::Value| value.asset().filter(|a| !a.authored.is_empty()).cloned();
    if attribute.samples.is_empty() {
        return attribute.default.as_ref().and_then(stated).map(|asset| (None, asset)).into_iter().collect();
    }
    let samples = attribute.samples.iter();
    samples.filter_map(|(time, value)| Some((Some(*time), stated(value.as_ref()?)?))).collect()
}

/// Returns the finding about a file, named `shown`, that cannot be read.
fn unreadable(prim: &Prim, shown: &Path, error: &Error) -> Finding {
    let part = error.place().map(|place| format!("{place}: ")).unwrap_or_default();
    let what = format!("{} cannot be read: {part}{}", shown.display(), error.what());
    Finding::problem("unreadable-file", Some(&prim.path), what, error.remedy().unwrap_or("write the file again".into()))
}

/// Returns the grid that a field names in a file, given by its place and by its name in messages.
fn grid(
    prim: &Prim,
    time: Option<f64>,
    [path, shown]: [&Path; 2],
    files: &mut Files,
) -> Result<GridField, Box<Finding>> {
    let at = Some(prim.path.as_str());
    let time = time.unwrap_or_default();
    let held = |name: &str| prim.attribute(name)?.held_at(time);
    let problem = |id, what: String, remedy: &str| Err(Box::new(Finding::problem(id, at, what, remedy)));
    let fields = match files.fields(path) {
        Ok(fields) => fields,
        Err(error) => return Err(Box::new(unreadable(prim, shown, error))),
    };
    let shown = shown.display();
    let Some(name) = held("fieldName").and_then(|v| v.text().map(str::to_owned)).filter(|name| !name.is_empty()) else {
        return problem("no-field-name", "no fieldName is stated".into(), "name the grid as fieldName");
    };
    let same: Vec<&GridField> = fields.iter().filter(|field| field.name == name).collect();
    if same.is_empty() {
        let listed = fields.iter().map(|field| format!("'{}'", field.name)).collect::<Vec<_>>().join(", ");
        let what = format!("fieldName is '{name}', but {shown} has {listed}");
        return problem("unknown-grid", what, "correct fieldName, or block the file at times that have no such grid");
    }
    let index = held("fieldIndex").and_then(|v| v.int()).unwrap_or_default();
    match usize::try_from(index).ok().and_then(|index| same.get(index)) {
        Some(field) => Ok((*field).clone()),
        None => {
            let what = format!("fieldIndex is {index}, but {shown} has {} grid(s) '{name}'", same.len());
            // With one grid of the name there is no choice.
            let zero = Property::new("int", "fieldIndex", Literal::Int(0));
            let fix = (same.len() == 1).then(|| Fix::Property(prim.path.clone(), zero));
            let remedy = format!("give the grid's place among those of its name, 0 to {}", same.len() - 1);
            Err(Box::new(Finding::problem("grid-index", at, what, remedy).fixed_by(fix)))
        }
    }
}

/// Finds types and classes that are not those of the grid.
fn stated(prim: &Prim, time: f64, field: &GridField) -> Vec<Finding> {
    let text = |name: &str| prim.attribute(name)?.held_at(time)?.text().map(str::to_owned);
    let fix = |name: &str, value: &str| {
        Some(Fix::Property(prim.path.clone(), Property::new("token", name, Literal::text(value))))
    };
    let mut found = Vec::new();
    if let (Some(stated), Some(expected)) = (text("fieldDataType"), field.data_type)
        && stated != expected
        && !(field.half && stated == "half" && expected == "float")
    {
        let what = format!("fieldDataType is '{stated}', but grid '{}' has values of type {expected}", field.name);
        let remedy = format!("state fieldDataType = \"{expected}\"");
        let finding = Finding::problem("data-type", Some(&prim.path), what, remedy);
        found.push(finding.fixed_by(fix("fieldDataType", expected)));
    }
    // Many programs write grids without a class, which may be called anything.
    if let Some(stated) = text("fieldClass")
        && stated != field.class
        && field.class != "unknown"
    {
        let what = format!("fieldClass is '{stated}', but grid '{}' is of class {}", field.name, field.class);
        let remedy = format!("state fieldClass = \"{}\"", field.class);
        let finding = Finding::problem("grid-class", Some(&prim.path), what, remedy);
        found.push(finding.fixed_by(fix("fieldClass", field.class)));
    }
    found
}
