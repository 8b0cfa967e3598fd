//! Paths of fields: absolute or not anchored, and files and frames that are missing.

use super::finding::{Finding, Fix};
use crate::formats::sequence::number_of;
use crate::formats::usd::{Asset, Prim, Stage};
use std::cmp::Ordering;
use std::path::Path;

/// Finds textures of domes and transfer functions that are missing.
pub(super) fn others(stage: &Stage, findings: &mut Vec<Finding>) {
    for (prim, name, asset) in stage.other_files() {
        if let Some(absence) = stage.absence(asset) {
            let what = format!("the file @{}@ of {name} {absence}", asset.authored);
            let remedy = "restore the file, or correct the path";
            findings.push(Finding::problem("missing-file", Some(&prim.path), what, remedy));
        }
    }
}

/// Checks the files that a field names, by time code.
pub(super) fn check(stage: &Stage, prim: &Prim, assets: &[(Option<f64>, Asset)], findings: &mut Vec<Finding>) {
    let at = Some(prim.path.as_str());
    let absence = |(time, asset): &'_ (Option<f64>, Asset)| Some((*time, asset.clone(), stage.absence(asset)?));
    let missing: Vec<(Option<f64>, Asset, String)> = assets.iter().filter_map(absence).collect();
    if let Some((time, asset, absence)) = missing.first() {
        let more = match missing.len() {
            1 => String::new(),
            count => format!(", and {} more", count - 1),
        };
        let (id, when) = match time {
            Some(time) => ("missing-frame", format!(" at time code {time}")),
            None => ("missing-file", String::new()),
        };
        let what = format!("the file @{}@{when} {absence}{more}", asset.authored);
        findings.push(Finding::problem(id, at, what, "restore the file, or correct filePath"));
    }
    let absolute = |asset: &Asset| {
        let path = asset.authored.replace('\\', "/");
        path.starts_with('/') || path.contains("://") || path.as_bytes().get(1) == Some(&b':')
    };
    if let Some((_, asset)) = assets.iter().find(|(_, asset)| absolute(asset)) {
        let what = format!("the path @{}@ is absolute: the stage cannot be moved", asset.authored);
        let files = assets.iter().map(|(time, asset)| {
            (asset.packaged().is_none() && stage.exists(asset)).then(|| (*time, Some(asset.path.clone())))
        });
        let samples = prim.attribute("filePath").map(|a| a.samples.as_slice()).unwrap_or_default();
        let blocked = samples.iter().filter(|(_, value)| value.is_none()).map(|(time, _)| Some((Some(*time), None)));
        let mut fix = files.chain(blocked).collect::<Option<Vec<_>>>();
        fix.iter_mut().for_each(|files| files.sort_by(|(a, _), (b, _)| a.partial_cmp(b).unwrap_or(Ordering::Equal)));
        let fix = fix.map(|files| Fix::Files(prim.path.clone(), files));
        let remedy = "write it from the stage's folder, such as ./smoke.vdb";
        findings.push(Finding::problem("absolute-path", at, what, remedy).fixed_by(fix));
    } else if let Some((_, asset)) = assets.iter().find(|(_, asset)| !asset.authored.starts_with('.')) {
        findings.push(Finding::note(
            "unanchored-path",
            at,
            format!("the path @{}@ is looked up in search paths", asset.authored),
            format!("anchor it to the stage's folder: @./{}@", asset.authored),
        ));
    }
    frames(stage, prim, assets, findings);
}

/// Compares the numbers of files with the time codes at which they are shown.
fn frames(stage: &Stage, prim: &Prim, assets: &[(Option<f64>, Asset)], findings: &mut Vec<Finding>) {
    let at = Some(prim.path.as_str());
    // A file that goes on being shown says nothing of the rate; one that is missing has been told.
    let mut shown: Vec<(f64, u32, &Asset)> = Vec::new();
    for (time, asset) in assets {
        let repeated = shown.last().is_some_and(|(_, _, before)| before.path == asset.path);
        if let (Some(time), Some(number), false) = (time, number_of(Path::new(&asset.authored)), repeated) {
            shown.push((*time, number, asset));
        }
    }
    let blocked = |from: f64, to: f64| {
        let samples = prim.attribute("filePath").map(|a| a.samples.as_slice()).unwrap_or_default();
        samples.iter().any(|(time, value)| from < *time && *time < to && value.is_none())
    };
    for pair in shown.windows(2) {
        let [(t0, n0, a0), (t1, n1, a1)] = pair else { continue };
        let (time, number) = (t1 - t0, f64::from(*n1) - f64::from(*n0));
        if !(stage.exists(a0) && stage.exists(a1)) {
            continue;
        }
        if number > 1.0 && time == number && !blocked(*t0, *t1) {
            let there = (n0 + 1..*n1).any(|n| sibling(a0, *n0, n).is_some_and(|path| path.is_file()));
            let (what, remedy) = match there {
                true => ("though their files exist", "add time samples for them"),
                false => ("and their files do not exist: the frame before is shown", "write the missing frames"),
            };
            let what = format!("no file is named for time codes {} to {}, {what}", t0 + 1.0, t1 - 1.0);
            findings.push(Finding::problem("frame-gap", at, what, remedy));
            return;
        }
        if time != number {
            let rate = stage.time_codes_per_second();
            let what = format!(
                "frames {n0} and {n1} (@{}@) are {time} time codes apart: at {rate} time codes a second they are not \
                 shown at their rate",
                a1.authored
            );
            let remedy = "give frame N at time code N, or at a constant distance from it";
            findings.push(Finding::problem("frame-number", at, what, remedy));
            return;
        }
    }
}

/// Returns the path of another frame of a file's sequence.
fn sibling(asset: &Asset, number: u32, other: u32) -> Option<std::path::PathBuf> {
    let name = asset.path.file_name()?.to_str()?;
    let digits = name.rfind(&number.to_string()).map(|end| end + number.to_string().len())?;
    let start = name[..digits].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |i| i + 1);
    let width = digits - start;
    Some(asset.path.with_file_name(format!("{}{other:0width$}{}", &name[..start], &name[digits..])))
}
