//! Faults of stages that show volumes: what a program that opens one would not see, or would see elsewhere.

mod cache;
mod extent;
mod field;
pub(crate) mod finding;
pub(crate) mod fix;
mod metadata;
mod paths;
mod volume;

use crate::formats::limits::Limits;
use crate::formats::usd::{Attribute, Prim, Stage};
use cache::Files;
use finding::Finding;

/// Finds the faults of a stage, those of the stage itself first, then those of its volumes and fields in their order.
///
/// Files of fields are read one after another; each must fit into `limits`.
pub(crate) fn findings(stage: &Stage, limits: Limits) -> Vec<Finding> {
    let mut findings: Vec<Finding> = stage
        .faults
        .iter()
        .map(|fault| {
            let layer = fault.layer.as_ref().map(|layer| format!("layer {}: ", layer.display())).unwrap_or_default();
            Finding::problem("composition", fault.prim.as_deref(), format!("{layer}{}", fault.what), &fault.remedy)
        })
        .collect();
    metadata::check(stage, &mut findings);
    if stage.volumes().next().is_none() {
        let what = "the stage has no prim of type Volume";
        findings.push(Finding::note("no-volume", None, what, "nothing needs to be done if none is meant"));
    }
    volume::check(stage, &mut findings);
    let mut files = Files::new(limits);
    for prim in stage.of_type("OpenVDBAsset") {
        field::check(stage, prim, &mut files, &mut findings);
    }
    paths::others(stage, &mut findings);
    for prim in stage.volumes() {
        extent::check(stage, prim, &mut files, &mut findings);
    }
    for finding in &mut findings {
        // Within an instance, opinions of a layer over the stage have no effect.
        if finding.prim.as_deref().and_then(|path| stage.prim(path)).is_some_and(|prim| prim.instanced) {
            finding.fix = None;
        }
    }
    findings
}

/// Returns the attributes that name the files of fields over time.
fn sampled(stage: &Stage) -> impl Iterator<Item = (&Prim, &Attribute)> {
    let files = |prim: &'_ Prim| prim.attributes.contains_key("filePath");
    let fields = stage.prims().filter(move |prim| files(prim));
    let named = fields.filter_map(|prim| Some((prim, prim.attribute("filePath")?)));
    named.filter(|(_, attribute)| !attribute.samples.is_empty())
}
