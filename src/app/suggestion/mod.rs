//! Transfer functions that suit a volume, by its histogram and gradients.

mod pictures;
mod report;
mod sheet;

pub(crate) use report::Suggested;

use super::outputs::{self, Content};
use super::provenance::Provenance;
use super::scan::ScanSettings;
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

/// A volume for which functions are wanted, and what becomes of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Request<'r> {
    pub volume: &'r Path,
    /// The .tf.json that a candidate is written to.
    pub output: Option<&'r Path>,
    /// The PNG with pictures of all candidates.
    pub sheet: Option<&'r Path>,
    /// Number of the candidate, from 1; none for the first.
    pub candidate: Option<u32>,
    pub grid: Option<&'r str>,
    pub scan: &'r ScanSettings,
    pub limits: Limits,
}

/// Analyses a volume, writes the function that is asked for and the sheet of all, and reports.
///
/// # Errors
/// If the volume cannot be read or has one value, there is no such candidate, or an output cannot be written.
pub(super) fn run(request: &Request<'_>, context: &Context) -> Result<Suggested> {
    let path = request.volume;
    let mut provenance = Provenance::begin(context);
    if let Some(output) = request.output {
        outputs::file(output, Content::TransferFunction)?;
    }
    if let Some(sheet) = request.sheet {
        outputs::file(sheet, Content::Png)?;
        protected::check(sheet)?;
    }
    let Read { field, grid, up } = read(request)?;
    let named = |e: Error| e.part(format!("grid '{grid}'")).at(path);
    let analysis = {
        let _stage = context.stage("looking");
        Analysis::of(&field).map_err(named)?
    };
    let candidates = analysis.candidates();
    let chosen = place_of(request.candidate, &candidates)?;
    let side = if request.sheet.is_some() { SIDE } else { SMALL };
    let pictures = {
        let stage = context.steps(candidates.len() as u64, "draw");
        let mut subject = Subject::of(field, &candidates, (side, up), request.limits).map_err(named)?;
        let picture = |candidate: &Candidate| {
            let picture = subject.picture(&candidate.transfer, &context.cancel())?;
            stage.inc(1);
            Ok(picture)
        };
        candidates.iter().map(picture).collect::<Result<Vec<_>>>()?
    };
    let candidate = &candidates[chosen];
    if let Some(output) = request.output {
        let files = volume::files(path, request.scan, request.limits);
        provenance.files(files.iter().map(|file| file.as_path()))?;
        provenance.lap();
        let provenance = serde_json::to_value(&provenance)
            .map_err(|e| Error::invalid(e.to_string()).at(output).hint("report this as a bug"))?;
        transfer::save(output, &candidate.transfer, Some(&candidate.name), Some(&provenance))?;
    }
    if let Some(output) = request.sheet {
        let canvas = sheet::draw(&analysis, (path, &grid), &candidates, &pictures);
        png::write_rgb8(output, canvas.width, canvas.height, &canvas.rgb)?;
    }
    let warnings: Vec<_> = pictures[chosen].effect.warning(&candidate.name).into_iter().collect();
    context.warn(&warnings);
    Ok(Suggested {
        suggest: path.to_path_buf(),
        output: request.output.map(Path::to_path_buf),
        sheet: request.sheet.map(Path::to_path_buf),
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

fn read(request: &Request<'_>) -> Result<Read> {
    let Request { volume: path, grid, scan, limits, .. } = *request;
    let file = volume::open(path, scan, limits)?;
    let grid = file.read_fog(grid)?;
    let Limits { max_memory, .. } = limits;
    let mut field = Bricks::instanced_values(&grid, max_memory).map_err(|e| e.at(path))?;
    field.domain = grid.active_box();
    Ok(Read { field, grid: grid.name, up: up::of_file(&file).axis })
}

/// Returns the place of the candidate of a number from 1.
fn place_of(number: Option<u32>, candidates: &[Candidate]) -> Result<usize> {
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
