//! Problems of stages, for `validate`.

use super::fault::Fault;
use super::stage::Stage;
use super::value::Asset;
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::problem::Problem;
use crate::formats::vdb::File;
use std::collections::BTreeSet;
use std::path::Path;

/// Problems of a stage: faults of its composition, transforms that cannot be used, and files of its volumes and lights
/// that are missing or no volumes. Empty if there are none.
///
/// # Errors
/// If the operating system does not let the stage be read. A stage that cannot be opened is a problem.
pub(crate) fn problems(path: &Path, limits: Limits) -> Result<Vec<Problem>> {
    let stage = match Stage::open(path, limits) {
        Ok(stage) => stage,
        Err(error) => return Ok(vec![Problem::of(error)?]),
    };
    let mut found: Vec<Problem> = stage.faults.iter().map(Fault::problem).collect();
    let time = stage.first_time();
    for prim in stage.prims() {
        if let Err(error) = stage.local_to_world(prim, time) {
            let problem = Problem::of(error)?;
            // A fault of a prim is also one of all below it.
            if !found.contains(&problem) {
                found.push(problem);
            }
        }
    }
    if stage.volumes().next().is_none() && stage.cameras().next().is_none() {
        found.push(Problem::new(
            "the stage has neither a volume nor a camera",
            "export it again with what it is to hold",
        ));
    }
    for volume in stage.volumes() {
        let fields = stage.fields(volume, time);
        if fields.is_empty() {
            let problem = Problem::new("the volume has no field", "relate its grids as field:density and the like");
            found.push(problem.part(format!("prim {}", volume.path)));
        }
        for field in fields {
            let attribute = stage.prim(&field.prim).and_then(|prim| prim.attribute("filePath"));
            let assets: Vec<_> = attribute.iter().flat_map(|a| a.values()).filter_map(|v| v.asset()).collect();
            let place = format!("prim {}", field.prim);
            if assets.is_empty() {
                let remedy = "set 'filePath' of a prim of type OpenVDBAsset, and relate that prim";
                found.push(Problem::new(format!("the field '{}' has no file", field.name), remedy).part(place.clone()));
            }
            let mut seen = BTreeSet::new();
            for asset in assets.into_iter().filter(|asset| seen.insert(&asset.path)) {
                found.extend(file(&stage, asset, &place, limits)?);
            }
        }
    }
    for (prim, name, asset) in stage.other_files() {
        if let Some(absence) = stage.absence(asset) {
            let what = format!("the file {} of '{name}' {absence}", asset.authored);
            let problem = Problem::new(what, "correct the path, or copy the file there");
            found.push(problem.part(format!("prim {}", prim.path)));
        }
    }
    Ok(found)
}

/// Returns the problem of a field's file: it is missing, or no VDB.
fn file(stage: &Stage, asset: &Asset, place: &str, limits: Limits) -> Result<Option<Problem>> {
    if let Some(absence) = stage.absence(asset) {
        let what = format!("its file {} {absence}", asset.authored);
        return Ok(Some(Problem::new(what, "correct 'filePath', or copy the file there").part(place)));
    }
    let opened = stage.read(asset, |path| File::open(path, limits).map(drop));
    let Err(error) = opened else { return Ok(None) };
    let Problem { what, remedy, .. } = Problem::of(error)?;
    let what = format!("its file {} cannot be read: {what}", asset.authored);
    Ok(Some(Problem::new(what, remedy).part(place)))
}
