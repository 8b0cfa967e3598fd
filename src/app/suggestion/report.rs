//! The report of functions that suit a volume.

use super::pictures::Effect;
use crate::app::checks::Warning;
use crate::formats::transfer::TransferSummary;
use crate::metrics::boundaries::{Boundary, Material};
use crate::report::short;
use crate::text::{printable, shell_quoted};
use crate::wording::worded;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// Transfer functions that suit a volume.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct Suggested {
    /// Volume that was looked at.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub(super) suggest: PathBuf,
    /// Transfer function that was written.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub(super) output: Option<PathBuf>,
    /// Sheet of all candidates that was written.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub(super) sheet: Option<PathBuf>,
    /// Name of the grid.
    pub(super) grid: String,
    /// Number of the candidate that was chosen, from 1.
    pub(super) candidate: usize,
    /// Values between which all but the least and the greatest 0.1 % of the voxels lie.
    pub(super) range: [f64; 2],
    /// Value of most of the border of the volume's box; no function absorbs there.
    pub(super) background: f64,
    /// Number of cells between voxels, in whose middles values and gradients were taken.
    pub(super) cells: usize,
    /// Boundaries between materials, in ascending order of value.
    pub(super) boundaries: Vec<NumberedBoundary>,
    /// Materials between the boundaries, in ascending order of value.
    pub(super) materials: Vec<Material>,
    /// Functions that suit the volume.
    pub(super) candidates: Vec<CandidateReport>,
    /// Remarks on the function that was chosen.
    pub(super) warnings: Vec<Warning>,
}

/// A boundary with its number.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct NumberedBoundary {
    /// Number from 1, as names of candidates have it.
    number: usize,
    #[serde(flatten)]
    boundary: Boundary,
}

impl NumberedBoundary {
    pub(super) fn of((i, boundary): (usize, &Boundary)) -> Self {
        Self { number: i + 1, boundary: *boundary }
    }
}

/// A function that suits the volume.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct CandidateReport {
    /// Number from 1, as `candidate` takes it.
    pub number: usize,
    /// Name by what it shows: `all boundaries`, `boundary 1` and so on, or `ramp`.
    pub name: String,
    /// Effect on the volume.
    pub effect: Effect,
    /// Share of the picture over the volume's box in which something is to be seen.
    pub visible: f64,
    #[serde(flatten)]
    pub summary: TransferSummary,
}

impl Suggested {
    fn hint(&self) -> Option<String> {
        let function = shell_quoted(self.output.as_ref()?.to_str()?).into_owned();
        let volume = shell_quoted(self.suggest.to_str()?).into_owned();
        Some(
            worded(&format!(
                "render it: cumulo render {volume} ⟨tf={function}⟩ ⟨views=1⟩ ⟨size=512x512⟩ -o picture.png"
            ))
            .into(),
        )
    }
}

impl fmt::Display for Suggested {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.range.map(short);
        let count = self.boundaries.len();
        let boundaries = if count == 1 { "boundary" } else { "boundaries" };
        write!(f, "{}: grid '{}', ", printable(&self.suggest.to_string_lossy()), printable(&self.grid))?;
        writeln!(f, "{count} {boundaries} in {} cells of {low} to {high}", self.cells)?;
        writeln!(f, "  background {}", short(self.background))?;
        for NumberedBoundary { number, boundary: Boundary { value, half_width, thickness, share, .. } } in
            &self.boundaries
        {
            let [value, half_width, thickness] = [*value, *half_width, *thickness].map(short);
            write!(f, "  boundary {number}  {value} ± {half_width}, {thickness} voxels thick, ")?;
            writeln!(f, "{:.1} % of the voxels", 100.0 * share)?;
        }
        if count > 0 {
            let of = |m: &Material| format!("{} ({:.1} %)", short(m.value), 100.0 * m.share);
            let materials: Vec<String> = self.materials.iter().map(of).collect();
            writeln!(f, "  materials  {}", materials.join(", "))?;
        }
        for CandidateReport { number, name, effect, .. } in &self.candidates {
            let effect = match effect {
                Effect::Shown => "",
                Effect::Nothing => ", shows nothing",
                Effect::SolidBlock => ", shows one solid block",
            };
            let mark = if *number == self.candidate { " (chosen)" } else { "" };
            writeln!(f, "  candidate {number}  {name}{effect}{mark}")?;
        }
        for path in [&self.sheet, &self.output].into_iter().flatten() {
            writeln!(f, "{}: written", printable(&path.to_string_lossy()))?;
        }
        match self.hint() {
            Some(hint) => writeln!(f, "  {}", printable(&hint)),
            None => Ok(()),
        }
    }
}
