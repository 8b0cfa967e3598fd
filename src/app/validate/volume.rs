//! Faults of an OpenVDB file.

use super::findings::Findings;
use super::traits::{Trait, Traits};
use crate::app::statistics::statistics_of;
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::transfer;
use crate::formats::vdb::{File, GridInfo, NativeGrid, Transform};
use crate::scene::grid::{GridClass, MOST_DENSITY};
use crate::scene::statistics::Statistics;
use crate::scene::topology::table_entries;
use glam::IVec3;
use std::path::Path;

/// Checks all grids of a file and their values, and returns what frames of a sequence are compared by.
///
/// # Errors
/// If the operating system keeps the file from being read.
pub(super) fn check(path: &Path, limits: Limits, findings: &mut Findings) -> Result<Traits> {
    let mut traits = Traits::new();
    let file = match File::open(path, limits) {
        Ok(file) => file,
        Err(error) => {
            findings.refusal(error)?;
            return Ok(traits);
        }
    };
    if file.entries().is_empty() {
        findings.problem(None, "the file has no grids", "check the export settings of the program that made it");
    }
    for entry in file.entries() {
        let name = entry.name.as_str();
        if entry.name != entry.base_name && entry.name.ends_with("[0]") {
            findings.note(
                Some(name),
                "several grids share this name",
                "name them as here, with their number, in ⟨grid⟩",
            );
        }
        let native = match file.read(name) {
            Ok(native) => native,
            Err(error) => {
                findings.refusal(error.part(format!("grid '{name}'")))?;
                continue;
            }
        };
        match native.info() {
            Ok(info) => {
                let statistics = values(&native, &info, findings)?;
                traits.insert(format!("grid '{name}'"), of_grid(&info, statistics.as_ref()));
            }
            Err(error) => findings.refusal(error.part(format!("grid '{name}'")))?,
        }
    }
    Ok(traits)
}

/// Returns what a grid is compared by with that of other frames.
pub(super) fn of_grid(info: &GridInfo, statistics: Option<&Statistics>) -> Trait {
    let place = match &info.transform {
        Transform::Affine(map) => Some(map.matrix()),
        Transform::Other(_) => None,
    };
    let figures = statistics.map(|s| {
        let count = info.active_voxels.saturating_sub(s.nan + s.infinite);
        [f64::from(s.max.unwrap_or_default()), s.mean.unwrap_or_default() * count as f64]
    });
    Trait { kind: info.value_type.clone(), place, figures }
}

/// Checks the values of a grid, and returns their statistics if there are any.
pub(super) fn values(native: &NativeGrid, info: &GridInfo, findings: &mut Findings) -> Result<Option<Statistics>> {
    let name = Some(info.name.as_str());
    if let Transform::Other(kind) = &info.transform {
        findings.problem(name, format!("the transform is a {kind}, not affine"), "resample it onto a linear transform");
    }
    if info.active_voxels == 0 {
        findings.problem(name, "the grid is empty", "check that the simulation or the export reached this frame");
    }
    if info.class == GridClass::LevelSet {
        findings.note(
            name,
            "this is a level set: distances, no density",
            "for rendering as fog, convert it: cumulo convert IN.vdb OUT.vdb ⟨to=fog⟩",
        );
    }
    if info.components == 0 {
        findings.note(
            name,
            format!("{} values are passed through, not looked at", info.value_type),
            "nothing needs to be done",
        );
        return Ok(None);
    }
    let statistics = statistics_of(native)?;
    numbers(info, &statistics, findings);
    // Renderers interpolate between all values, active or not.
    let hidden = if scalar_density(info) { inactive_faults(native)? } else { 0 };
    if hidden > 0 {
        let what = format!("{hidden} inactive values are negative or not finite");
        findings.problem(name, what, "cumulo convert ⟨repair⟩ sets them to 0");
    }
    if !info.background.iter().all(|b| b.is_finite()) {
        findings.problem(
            name,
            format!("the background is {:?}", info.background),
            "cumulo convert ⟨repair⟩ sets it to 0",
        );
    } else if info.class == GridClass::FogVolume && info.background.iter().any(|b| *b != 0.0) {
        findings.problem(
            name,
            format!("a fog volume with background {:?} is infinite", info.background),
            "set the background to 0 where it was made; cropping keeps it",
        );
    }
    if info.components == 1 && info.class != GridClass::LevelSet {
        check_usable(native, info, findings)?;
    }
    Ok(Some(statistics))
}

/// Finds what keeps a density from being rendered, though its values are fine.
fn check_usable(native: &NativeGrid, info: &GridInfo, findings: &mut Findings) -> Result<()> {
    let name = Some(info.name.as_str());
    if let Err(error) = transfer::from_metadata(&native.metadata()?) {
        findings.refusal(error.part(format!("grid '{}'", info.name)))?;
    }
    if let Some((min, max)) = info.index_box {
        // Bricks reach into those below them.
        let [low, high] = [IVec3::from_array(min).map(|c| (c >> 3) - 1), IVec3::from_array(max).map(|c| c >> 3)];
        if let Err(error) = table_entries(low, high) {
            findings.problem(name, error.what(), &error.remedy().unwrap_or_default());
        }
    }
    Ok(())
}

fn numbers(info: &GridInfo, s: &Statistics, findings: &mut Findings) {
    let name = Some(info.name.as_str());
    if s.nan > 0 {
        findings.problem(name, format!("{} values are NaN", s.nan), "cumulo convert ⟨repair⟩ sets them to 0");
    }
    if s.infinite > 0 && info.half {
        let what = format!("{} values are infinite, and the grid is stored as half: they exceeded 65504", s.infinite);
        findings.problem(name, what, "write it again from the source without half, or scaled down");
    } else if s.infinite > 0 {
        findings.problem(name, format!("{} values are infinite", s.infinite), "cumulo convert ⟨repair⟩ sets them to 0");
    }
    if s.above_half > 0 && !info.half {
        let what = format!("{} values are above 65504", s.above_half);
        findings.note(name, what, "do not store this grid as half: they would become infinite");
    }
    if scalar_density(info) && s.max.is_some_and(|max| max > MOST_DENSITY) {
        let what = format!("densities reach {:e}, above {MOST_DENSITY:e}", s.max.unwrap_or_default());
        findings.problem(
            name,
            what,
            "scale them down where they were made: a scale that shows them is too small to be computed with",
        );
    }
    if scalar_density(info) && s.negative > 0 {
        let what = format!("{} densities are negative (down to {})", s.negative, s.min.unwrap_or_default());
        findings.problem(name, what, "cumulo convert ⟨repair⟩ sets them to 0");
    } else if info.components == 1 && info.class == GridClass::Unknown && s.negative > 0 {
        let what = format!("{} values are negative (down to {})", s.negative, s.min.unwrap_or_default());
        findings.note(name, what, "if these are densities, cumulo convert ⟨repair=density⟩ sets them to 0");
    }
}

fn scalar_density(info: &GridInfo) -> bool {
    info.components == 1 && info.class == GridClass::FogVolume
}

/// Counts the inactive voxels and tiles whose values no density may have: negative, infinite or NaN.
fn inactive_faults(native: &NativeGrid) -> Result<usize> {
    let bad = |v: f32| !(v.is_finite() && v >= 0.0);
    let mut count = native.tiles()?.iter().filter(|t| !t.active && bad(t.value[0])).count();
    native.for_each_leaf(|l| {
        count += (0..512).filter(|i| l.active[i >> 6] >> (i & 63) & 1 == 0 && bad(l.values[*i])).count();
        true
    })?;
    Ok(count)
}
