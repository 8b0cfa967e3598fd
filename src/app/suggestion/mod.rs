//! Transfer functions that suit a volume, by its histogram and gradients.

mod pictures;
mod report;
mod sheet;

pub use report::Suggested;

use super::function::FunctionSettings;
use super::outputs::{self, Content};
use super::provenance::Provenance;
use super::{Context, up, volume};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::transfer::{Function, TransferSummary};
use crate::formats::{png, protected, transfer};
use crate::metrics::boundaries::{Analysis, Candidate};
use crate::scene::bricks::Bricks;
use crate::scene::up::Up;
use pictures::{Picture, Subject};
use report::{CandidateReport, NumberedBoundary};
use std::path::Path;

/// Longer side in pixels of the pictures of a sheet, and of those that only show whether there is something to see.
const SIDE: usize = 320;
const SMALL: usize = 96;

/// Analyses a volume, writes the function that the settings choose and the sheet of all, and reports.
///
/// # Errors
/// If the volume cannot be read or has one value, there is no such candidate, or an output cannot be written.
pub(super) fn run(settings: &FunctionSettings, path: &Path, context: &Context) -> Result<Suggested> {
    let mut provenance = Provenance::begin(context);
    if let Some(output) = &settings.output {
        outputs::file(output, Content::TransferFunction)?;
    }
    if let Some(sheet) = &settings.sheet {
        outputs::file(sheet, Content::Png)?;
        protected::check(sheet)?;
    }
    let Read { field, grid, up } = read(settings, path)?;
    let named = |e: Error| e.part(format!("grid '{grid}'")).at(path);
    let analysis = {
        let _stage = context.stage("looking");
        Analysis::of(&field).map_err(named)?
    };
    let candidates = analysis.candidates();
    let chosen = chosen(settings.candidate, &candidates)?;
    let side = if settings.sheet.is_some() { SIDE } else { SMALL };
    let pictures = {
        let stage = context.steps(candidates.len() as u64, "draw");
        let mut subject = Subject::of(field, &candidates, (side, up), settings.limits).map_err(named)?;
        let picture = |candidate: &Candidate| {
            let picture = subject.picture(&candidate.transfer, &context.cancel())?;
            stage.inc(1);
            Ok(picture)
        };
        candidates.iter().map(picture).collect::<Result<Vec<_>>>()?
    };
    let candidate = &candidates[chosen];
    if let Some(output) = &settings.output {
        let files = volume::files(path, &settings.scan, settings.limits);
        provenance.files(files.iter().map(|file| file.as_path()))?;
        provenance.lap();
        let provenance = serde_json::to_value(&provenance)
            .map_err(|e| Error::invalid(e.to_string()).at(output).hint("report this as a bug"))?;
        transfer::save(output, &candidate.transfer, Some(&candidate.name), Some(&provenance))?;
    }
    if let Some(output) = &settings.sheet {
        let canvas = sheet::draw(&analysis, (path, &grid), &candidates, &pictures);
        png::write_rgb8(output, canvas.width, canvas.height, &canvas.rgb)?;
    }
    let warnings: Vec<_> = pictures[chosen].effect.warning(&candidate.name).into_iter().collect();
    context.warn(&warnings);
    Ok(Suggested {
        suggest: path.to_path_buf(),
        output: settings.output.clone(),
        sheet: settings.sheet.clone(),
        grid,
        candidate: chosen + 1,
        range: analysis.range,
        background: analysis.background,
        cells: analysis.cells,
        boundaries: analysis.boundaries.iter().enumerate().map(NumberedBoundary::of).collect(),
        candidates: candidate_reports(candidates, &pictures)?,
        materials: analysis.materials,
        warnings,
    })
}

/// A volume that is looked at.
struct Read {
    field: Bricks<f32>,
    /// Name of the grid.
    grid: String,
    up: Up,
}

fn read(settings: &FunctionSettings, path: &Path) -> Result<Read> {
    let FunctionSettings { grid, scan, limits, .. } = settings;
    let file = volume::open(path, scan, *limits)?;
    let grid = file.read_fog(grid.as_deref())?;
    let Limits { max_memory, .. } = *limits;
    let mut field = Bricks::instanced_values(&grid, max_memory).map_err(|e| e.at(path))?;
    field.domain = grid.active_box();
    Ok(Read { field, grid: grid.name, up: up::of_file(&file).axis })
}

/// Returns the place of the candidate of a number from 1.
fn chosen(number: Option<u32>, candidates: &[Candidate]) -> Result<usize> {
    let number = number.unwrap_or(1) as usize;
    let listed = || {
        let all = candidates.iter().enumerate().map(|(i, candidate)| format!("{} ({})", i + 1, candidate.name));
        all.collect::<Vec<_>>().join(", ")
    };
    number.checked_sub(1).filter(|place| *place < candidates.len()).ok_or_else(|| {
        Error::invalid(format!("⟨candidate⟩: there is no candidate {number}")).hint(format!("there are {}", listed()))
    })
}

fn candidate_reports(candidates: Vec<Candidate>, pictures: &[Picture]) -> Result<Vec<CandidateReport>> {
    let of = |(i, (Candidate { name, transfer }, picture)): (usize, (Candidate, &Picture))| {
        Ok(CandidateReport {
            number: i + 1,
            name,
            effect: picture.effect,
            visible: picture.visible,
            summary: TransferSummary::of(&Function::from(transfer))?,
        })
    };
    candidates.into_iter().zip(pictures).enumerate().map(of).collect()
}
