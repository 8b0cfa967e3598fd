//! Extents of volumes against the boxes of their grids, and their size in the world.

use super::cache::Files;
use super::field;
use super::finding::{Finding, Fix};
use crate::formats::usd::write::text::{Content, Literal, Property};
use crate::formats::usd::write::volume::extent;
use crate::formats::usd::{Prim, Stage, Value};
use crate::math::Aabb;

/// Sizes of volumes in meters that are plausible: from a grain to a storm.
const PLAUSIBLE: [f64; 2] = [1e-4, 1e6];

/// Longest edges of voxels by which an extent may exceed the voxels: Blender states the box of the grids' blocks of 8³,
/// which lies askew where the grid is turned.
const BLOCK: f64 = 8.0 * 1.732_050_8;

/// Box around a volume's grids at a time code, and the longest edge of their voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Boxed {
    time: Option<f64>,
    bounds: Aabb,
    voxel: f64,
}

/// Checks the extent of a volume.
pub(super) fn check(stage: &Stage, volume: &Prim, files: &mut Files, findings: &mut Vec<Finding>) {
    let boxes = boxes(stage, volume, files);
    let Some(first) = boxes.first() else { return };
    let all = boxes.iter().fold(Aabb::EMPTY, |all, b| all.union(b.bounds));
    size(stage, volume, all, first.time, findings);
    let at = Some(volume.path.as_str());
    let fix = || Some(Fix::Property(volume.path.clone(), property(&boxes)));
    let Some(attribute) = volume.attribute("extent").filter(|a| a.values().next().is_some()) else {
        let what = "no extent is stated: programs that do not read the files cannot frame or cull the volume";
        findings.push(Finding::note("no-extent", at, what, "state the extent of its grids").fixed_by(fix()));
        return;
    };
    // An extent that holds at all times must be that of all frames.
    let moving = attribute.is_animated();
    let whole = Boxed { bounds: all, ..*first };
    let expected: Vec<Boxed> = if moving { boxes.clone() } else { vec![whole] };
    for Boxed { time, bounds, voxel } in expected {
        let stated = attribute.at(time.unwrap_or_default()).as_ref().and_then(corners);
        let rounding = 1e-5 * (bounds.max.abs().max(bounds.min.abs())).max_element();
        let (inside, outside) = (voxel + rounding, BLOCK * voxel + rounding);
        let fits = stated.is_some_and(|stated| {
            let (low, high) = (bounds.min - stated.min, stated.max - bounds.max);
            low.min(high).min_element() >= -inside && low.max(high).max_element() <= outside
        });
        if fits {
            continue;
        }
        let when = time.filter(|_| moving).map_or(String::new(), |time| format!(" at time code {time}"));
        let stated = stated.map_or("no box".to_owned(), box_text);
        let what = format!("the extent{when} is {stated}, but the grids reach {}", box_text(bounds));
        let remedy = "state the box of the grids' active voxels in the volume's own space";
        findings.push(Finding::problem("extent", at, what, remedy).fixed_by(fix()));
        return;
    }
}

fn box_text(bounds: Aabb) -> String {
    format!("{:?} to {:?}", bounds.min.to_array().map(|v| v as f32), bounds.max.to_array().map(|v| v as f32))
}

/// Returns the box of an extent; `None` if it is none.
fn corners(value: &Value) -> Option<Aabb> {
    let [min, max] = value.list()? else { return None };
    Some(Aabb { min: min.tuple::<3>()?.into(), max: max.tuple::<3>()?.into() })
}

/// Returns the boxes around a volume's grids at the times of their files.
fn boxes(stage: &Stage, volume: &Prim, files: &mut Files) -> Vec<Boxed> {
    let targets = volume.relationships.iter().filter(|(name, _)| name.starts_with("field:")).flat_map(|(_, t)| t);
    let fields: Vec<&Prim> = targets.filter_map(|target| stage.prim(target)).collect();
    let mut boxes: Vec<Boxed> = Vec::new();
    for prim in fields {
        let held = |attribute: &str| prim.attribute(attribute)?.held_at(stage.first_time());
        let name = held("fieldName").and_then(|name| name.text().map(str::to_owned)).unwrap_or_default();
        let index = held("fieldIndex").and_then(|index| usize::try_from(index.int()?).ok()).unwrap_or_default();
        for (time, asset) in field::assets(prim).iter().filter(|(_, asset)| stage.exists(asset)) {
            let Ok(path) = stage.file(asset) else { continue };
            let Ok(grids) = files.fields(&path) else { continue };
            let Some(grid) = grids.iter().find(|grid| grid.name == name && grid.index == index) else { continue };
            let (Some(bounds), Some(voxel)) = (grid.bounds, grid.voxel) else { continue };
            match boxes.iter_mut().find(|b| b.time == *time) {
                Some(known) => {
                    *known = Boxed { time: *time, bounds: known.bounds.union(bounds), voxel: known.voxel.max(voxel) };
                }
                None => boxes.push(Boxed { time: *time, bounds, voxel }),
            }
        }
    }
    boxes.sort_by(|a, b| a.time.unwrap_or(f64::NEG_INFINITY).total_cmp(&b.time.unwrap_or(f64::NEG_INFINITY)));
    boxes
}

/// Returns the extent that a volume should state.
fn property(boxes: &[Boxed]) -> Property {
    let whole = boxes.iter().fold(Aabb::EMPTY, |all, b| all.union(b.bounds));
    let samples: Option<Vec<(f64, Literal)>> = boxes.iter().map(|b| Some((b.time?, extent(b.bounds)))).collect();
    let content = match samples {
        Some(samples) if boxes.iter().any(|b| b.bounds != boxes[0].bounds) => Content::Samples(extent(whole), samples),
        _ => Content::Default(extent(whole)),
    };
    Property { declaration: "float3[]", name: "extent".into(), content }
}

/// Finds volumes that are too small or too large in meters to be meant.
fn size(stage: &Stage, volume: &Prim, bounds: Aabb, time: Option<f64>, findings: &mut Vec<Finding>) {
    let Ok(map) = stage.local_to_world(volume, time.unwrap_or_else(|| stage.first_time())) else { return };
    let corners = bounds.corners().map(|corner| map.transform_point3(corner));
    let world = corners.into_iter().fold(Aabb::EMPTY, Aabb::including);
    let meters = world.size().max_element() * stage.meters_per_unit();
    if !(PLAUSIBLE[0]..=PLAUSIBLE[1]).contains(&meters) {
        findings.push(Finding::problem(
            "implausible-size",
            Some(&volume.path),
            format!("the volume is {meters:e} m long, at {} m to a unit", stage.meters_per_unit()),
            "correct metersPerUnit, or the scale of the volume",
        ));
    }
}
