//! Metadata of a stage: default prim, axis, unit, and times against the frames that are there.

use super::finding::{Finding, Fix};
use super::sampled;
use crate::formats::usd::Stage;

/// Finds what the metadata of a stage leave out or get wrong.
pub(super) fn check(stage: &Stage, findings: &mut Vec<Finding>) {
    default_prim(stage, findings);
    let metadata = &stage.metadata;
    if metadata.up_axis.is_none() {
        findings.push(Finding::problem(
            "up-axis",
            None,
            "no upAxis is stated: programs take Y, and volumes of Blender and Houdini's exporters differ in it",
            "state upAxis = \"Y\" or \"Z\" in the stage's metadata",
        ));
    }
    if metadata.meters_per_unit.is_none() {
        findings.push(Finding::problem(
            "meters-per-unit",
            None,
            "no metersPerUnit is stated: programs take centimeters (0.01)",
            "state metersPerUnit in the stage's metadata: 1 for meters, 0.01 for centimeters",
        ));
    }
    if let (Some(codes), Some(frames)) = (metadata.time_codes_per_second, metadata.frames_per_second)
        && codes != frames
        && sampled(stage).next().is_some()
    {
        findings.push(
            Finding::problem(
                "frame-rate",
                None,
                format!("{codes} time codes a second but {frames} frames: frames are not at whole time codes"),
                "state the same number as timeCodesPerSecond and framesPerSecond",
            )
            .fixed_by(Some(Fix::Metadata("framesPerSecond", codes.to_string()))),
        );
    }
    times(stage, findings);
}

fn default_prim(stage: &Stage, findings: &mut Vec<Finding>) {
    let roots: Vec<&str> =
        stage.prims().filter(|prim| prim.parent().is_none()).map(|prim| prim.path.as_str()).collect();
    let what = match &stage.metadata.default_prim {
        Some(path) if stage.prim(path).is_some() => return,
        Some(path) => format!("the default prim {path} does not exist"),
        None => "no defaultPrim is stated: references to this stage lead nowhere".to_owned(),
    };
    // With one root there is no choice.
    let fix = match roots[..] {
        [only] => Some(Fix::Metadata("defaultPrim", format!("\"{}\"", only.trim_start_matches('/')))),
        _ => None,
    };
    let remedy = format!("state defaultPrim as one of {}", roots.join(", "));
    findings.push(Finding::problem("default-prim", None, what, remedy).fixed_by(fix));
}

/// Compares the stage's times with those of the files of its volumes. A shot may be longer than a volume's files, whose
/// first and last hold then.
fn times(stage: &Stage, findings: &mut Vec<Finding>) {
    let times = || sampled(stage).flat_map(|(_, attribute)| attribute.times());
    let (first, last) = (times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max));
    if !first.is_finite() || first == last {
        return;
    }
    let (start, end) = (stage.metadata.start, stage.metadata.end);
    let ends = [
        ("startTimeCode", start, first, start.is_some_and(|start| start <= first)),
        ("endTimeCode", end, last, end.is_some_and(|end| end >= last)),
    ];
    for (name, stated, expected, covers) in ends {
        if covers {
            continue;
        }
        let stated = stated.map_or("not stated".to_owned(), |stated| format!("{stated}"));
        findings.push(
            Finding::problem(
                "time-range",
                None,
                format!("{name} is {stated}, but the volumes' files are at time codes {first} to {last}"),
                format!("state {name} = {expected}"),
            )
            .fixed_by(Some(Fix::Metadata(name, expected.to_string()))),
        );
    }
}
