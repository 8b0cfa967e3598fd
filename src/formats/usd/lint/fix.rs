//! A layer over a stage that removes its faults: the stage itself stays as it is, and nothing of it is lost.

use super::finding::{Finding, Fix};
use crate::error::Result;
use crate::formats::usd::Stage;
use crate::formats::usd::write::places::relative;
use crate::formats::usd::write::text::{Content, Literal, PrimText, Property, quoted};
use std::collections::BTreeMap;
use std::path::Path;

/// Returns the text of a layer at `place` over a stage, with the fixes of findings.
///
/// The metadata of a stage are those of its root layer, so that the new layer states all of them again.
///
/// # Errors
/// If a path cannot be written relative to the layer.
pub(crate) fn layer(stage: &Stage, findings: &[Finding], place: &Path) -> Result<String> {
    let mut metadata = stated(stage);
    let mut root = PrimText::default();
    for fix in findings.iter().filter_map(|finding| finding.fix.as_ref()) {
        match fix {
            Fix::Metadata(name, value) => drop(metadata.insert(name, value.clone())),
            Fix::Property(path, property) => add(&mut root, path, property.clone()),
            Fix::Files(path, files) => add(&mut root, path, asset(files, place)?),
        }
    }
    let mut text = "#usda 1.0\n(\n".to_owned();
    metadata.iter().for_each(|(name, value)| text += &format!("    {name} = {value}\n"));
    text += &format!("    subLayers = [\n        {}\n    ]\n)\n", Literal::Asset(relative(&stage.path, place)?));
    for prim in &root.children {
        text.push('\n');
        prim.write(&mut text, 0);
    }
    Ok(text)
}

/// Returns the metadata that a stage states.
fn stated(stage: &Stage) -> BTreeMap<&'static str, String> {
    let m = &stage.metadata;
    let number = |value: Option<f64>| value.map(|v| v.to_string());
    let all = [
        ("defaultPrim", m.default_prim.as_ref().map(|path| quoted(path.trim_start_matches('/')))),
        ("upAxis", m.up_axis.map(|axis| quoted(&format!("{axis:?}")))),
        ("metersPerUnit", number(m.meters_per_unit)),
        ("timeCodesPerSecond", number(m.time_codes_per_second)),
        ("framesPerSecond", number(m.frames_per_second)),
        ("startTimeCode", number(m.start)),
        ("endTimeCode", number(m.end)),
    ];
    all.into_iter().filter_map(|(name, value)| Some((name, value?))).collect()
}

/// Adds a property to a prim beneath `root`, with the prims above it.
fn add(root: &mut PrimText, path: &str, property: Property) {
    let mut prim = root;
    for name in path.trim_start_matches('/').split('/') {
        let place = prim.children.iter().position(|child| child.name == name).unwrap_or_else(|| {
            prim.children.push(PrimText::new("", name));
            prim.children.len() - 1
        });
        prim = &mut prim.children[place];
    }
    prim.properties.retain(|known| known.name != property.name);
    prim.properties.push(property);
}

/// Returns the paths of files from the layer's folder.
fn asset(files: &[(Option<f64>, Option<std::path::PathBuf>)], place: &Path) -> Result<Property> {
    let mut samples = Vec::new();
    let mut default = Literal::Blocked;
    for (time, path) in files {
        let value = match path {
            Some(path) => Literal::Asset(relative(path, place)?),
            None => Literal::Blocked,
        };
        match time {
            Some(time) => samples.push((*time, value)),
            None => default = value,
        }
    }
    let content = if samples.is_empty() { Content::Default(default) } else { Content::Samples(default, samples) };
    Ok(Property { declaration: "asset", name: "filePath".into(), content })
}
