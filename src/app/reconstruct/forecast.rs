//! What a reconstruction costs, told by a few of its pictures before all are read.

use super::region::{Placed, RegionSettings};
use super::sample::{Measured, Sample, writing};
use crate::app::Context;
use crate::app::checks::Warning;
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::inverse::cost::Cost;
use crate::inverse::cost::effort::{LevelWork, PictureCounts, Rates, levels};
use crate::inverse::cost::scaling::Pass;
use crate::inverse::density::Request;
use crate::inverse::density::multilevel::{MISFITS, expected_steps};
use crate::inverse::observation::Observation;
use crate::inverse::observation::transmittances::Channels;
use crate::inverse::progress::Stage;
use crate::inverse::region::hull::Survey;
use crate::scene::capture::Capture;
use crate::text::bytes as human;
use std::time::Instant;

/// Pixels of a capture from which on reading its pictures takes seconds.
const MANY: u64 = 1 << 24;

/// The pictures of a capture, of which few are read.
#[derive(Debug, Clone, Copy)]
pub(super) struct Forecast<'c> {
    /// Cameras and paths of the pictures.
    pub capture: &'c Capture,
    /// Layer of the pictures; none for the beauty.
    pub layer: Option<&'c str>,
    /// Memory that the work may take.
    pub limits: Limits,
    /// Channels that tell the optical depths.
    pub channels: Channels,
}

impl Forecast<'_> {
    /// Tells what the reconstruction will cost, by `cost` of the unknowns and of a few observed pictures, and warns
    /// if that may not fit in memory. Captures that are read in a moment have no forecast, and neither have those of
    /// which a few pictures bound no region.
    ///
    /// # Errors
    /// If a picture cannot be read.
    pub(crate) fn tell<T>(
        self,
        region: &RegionSettings,
        context: &Context,
        cost: impl FnOnce(&Sample, &Placed) -> Result<(Cost, T)>,
    ) -> Result<Option<T>> {
        let Self { capture, layer, limits, channels } = self;
        if capture.pixels() < MANY || !Sample::is_less_than(capture) {
            return Ok(None);
        }
        let sample = Sample::read(capture, layer, channels, limits, context)?;
        let Ok(placed) = region.place(capture, &sample.observation) else { return Ok(None) };
        let (cost, found) = cost(&sample, &placed)?;
        context.note(format!(
            "expected by {} of the {} pictures: {cost}, and {:.0} s to read the pictures",
            sample.observation.maps.len(),
            capture.frames.len(),
            sample.reading
        ));
        if let Err(error) = cost.fits(limits.max_memory) {
            let allowed = human(limits.max_memory);
            let what = format!("that may not fit in memory, of which {allowed} are allowed");
            context.warn(&[Warning::new(what, error.remedy().unwrap_or_default())]);
        }
        Ok(Some(found))
    }
}

/// A search by conjugate gradients that is to come.
#[derive(Debug)]
pub(super) struct ExpectedSearch {
    levels: Vec<LevelWork>,
    rates: Rates,
}

impl ExpectedSearch {
    /// Prepares the work of all levels for `views` pictures, of which those observed are some or all.
    pub(super) fn new(
        observation: &Observation,
        survey: &Survey,
        request: &Request,
        (views, pixels): (usize, u64),
        measured: Option<&Measured>,
    ) -> Self {
        let held_out = request.held_out.len();
        let blind = if observation.noisy() { (views - held_out).min(MISFITS) } else { 0 };
        let pictures = PictureCounts {
            views,
            predicted: if held_out > 0 { held_out } else { blind },
            pixels: pixels as f64,
            crossing: measured.map_or_else(|| observation.shown_share(), |measured| measured.crossing),
        };
        let levels = levels(survey, request, &pictures, &expected_steps(observation, request));
        Self { levels, rates: measured.map_or(Rates::USUAL, |measured| measured.rates) }
    }

    /// Returns the expected seconds.
    pub(super) fn seconds(&self) -> f64 {
        self.stages().iter().map(|stage| stage.seconds[1]).sum()
    }

    /// Returns the fewest, the usual and the most iterations of all levels.
    pub(super) fn iterations(&self) -> [f64; 3] {
        let add = |sum: [f64; 3], level: &LevelWork| std::array::from_fn(|i| sum[i] + level.iterations()[i]);
        self.levels.iter().fold([0.0; 3], add)
    }

    /// Returns the stages with their least, expected and longest times.
    pub(super) fn stages(&self) -> Vec<ExpectedStage> {
        let of_level = |level: &LevelWork| {
            let [least, usual, most] = level.stages(&self.rates);
            let join = |(least, (usual, most)): (Stage, (Stage, Stage))| ExpectedStage {
                name: usual.name,
                seconds: [least.seconds, usual.seconds, most.seconds],
            };
            least.into_iter().zip(usual.into_iter().zip(most)).map(join).collect::<Vec<_>>()
        };
        self.levels.iter().flat_map(of_level).collect()
    }

    /// Returns the passes that machines share.
    pub(super) fn passes(&self) -> Vec<Pass> {
        self.levels.iter().flat_map(|level| level.passes(&self.rates, level.iterations()[1])).collect()
    }
}

/// A stage that is to come, by the name that a run gives it.
#[derive(Debug, Clone)]
pub(super) struct ExpectedStage {
    pub name: String,
    /// Least, expected and longest time.
    pub seconds: [f64; 3],
}

/// Returns the stages of a reconstruction beside its search, before and after it.
pub(super) fn around(
    sample: &Sample,
    placing: f64,
    (survey, views): (&Survey, usize),
    measured: &Measured,
) -> [ExpectedStage; 3] {
    let stage = |name: &str, seconds: f64| ExpectedStage { name: name.into(), seconds: [seconds; 3] };
    let placing = placing * views as f64 / sample.observation.maps.len() as f64;
    let threads = measured.probes.partitions.min(rayon::current_num_threads()) as f64;
    let confidence = measured.compared + measured.probes.count * measured.probes.rays / threads;
    [
        stage("read pictures", sample.reading + placing),
        stage("confidence", confidence),
        stage("write", writing(survey.bricks)),
    ]
}

/// Returns the place of the unknowns by a few pictures, and the seconds that finding it took.
///
/// # Errors
/// Those of [`RegionSettings::place`].
pub(super) fn placed(region: &RegionSettings, capture: &Capture, sample: &Sample) -> Result<(Placed, f64)> {
    let begun = Instant::now();
    let placed = region.place(capture, &sample.observation)?;
    Ok((placed, begun.elapsed().as_secs_f64()))
}
