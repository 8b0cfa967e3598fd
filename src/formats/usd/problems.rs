//! Problems of stages, for `validate`.

use super::stage::Stage;
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::problem::Problem;
use std::collections::BTreeSet;
use std::path::Path;

/// Problems of a stage: faults of its composition, transforms that cannot be used, and files of its volumes that are
/// missing. Empty if there are none.
///
/// # Errors
/// If the operating system does not let the stage be read. A stage that cannot be opened is a problem.
pub fn problems(path: &Path, limits: Limits) -> Result<Vec<Problem>> {
    let stage = match Stage::open(path, limits) {
        Ok(stage) => stage,
        Err(error) => return Ok(vec![Problem::of(error)?]),
    };
    let layers = "correct the layer that states it, or write the stage again where it was made";
    let mut found: Vec<Problem> = stage.faults.iter().map(|fault| Problem::new(fault, layers)).collect();
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
            let missing = assets.into_iter().filter(|asset| seen.insert(&asset.path) && !stage.exists(asset));
            found.extend(missing.map(|asset| {
                let what = format!("its file {} is missing", asset.authored);
                Problem::new(what, "correct 'filePath', or copy the file there").part(place.clone())
            }));
        }
    }
    Ok(found)
}
