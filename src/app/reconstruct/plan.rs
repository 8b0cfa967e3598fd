//! What a reconstruction of densities will take: unknowns, memory, time by stage, and time on several machines.

use super::density::{Choice, DensitySettings, Search, channels};
use super::forecast::{ExpectedSearch, ExpectedStage, around, placed};
use super::region::{Placed, RegionSettings};
use super::sample::{Measured, Sample};
use crate::app::photos;
use crate::app::ranges;
use crate::app::run::Solver;
use crate::app::task::Task;
use crate::app::{Context, Report, inputs};
use crate::error::Result;
use crate::inverse::cost::effort::coarser_bricks;
use crate::inverse::cost::scaling::{Cluster, Pass, Scaled};
use crate::inverse::cost::{Cost, Duration, Method, PictureSizes};
use crate::inverse::density::Request;
use crate::inverse::region::hull::Survey;
use crate::scene::capture::Capture;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;

/// Settings of machines that share a reconstruction by `cumulo-mpi`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ScalingSettings {
    /// Numbers of machines, each 1 to 65536, to tell the time of; empty for 1, 2, 4 to 1024.
    pub machines: Vec<u32>,
    /// Bandwidth of a machine's connection, in Gbit/s.
    pub bandwidth: f64,
    /// Latency of a message, in µs.
    pub latency: f64,
    /// Part of a machine's time between two exchanges that varies at random, 0 to 1.
    pub delay: f64,
}

impl Default for ScalingSettings {
    fn default() -> Self {
        Self { machines: Vec::new(), bandwidth: 25.0, latency: 20.0, delay: 0.02 }
    }
}

impl ScalingSettings {
    fn check(&self) -> Result<()> {
        self.machines
            .iter()
            .try_for_each(|machines| ranges::within("machines", Some(*machines), [1, MOST_MACHINES]))?;
        ranges::positive("bandwidth", Some(self.bandwidth))?;
        let (latency, delay) = (self.latency, self.delay);
        ranges::require("latency", latency, latency.is_finite() && latency >= 0.0, "0 or more microseconds")?;
        ranges::require("delay", delay, (0.0..=1.0).contains(&delay), "a number from 0 to 1")
    }

    /// Returns machines like this one, with the network between them.
    fn cluster(&self) -> Cluster {
        Cluster {
            threads: rayon::current_num_threads(),
            bandwidth: self.bandwidth * 1e9 / 8.0,
            latency: self.latency * 1e-6,
            delay: self.delay,
        }
    }

    fn numbers(&self) -> Vec<u32> {
        if self.machines.is_empty() { (0..=10).map(|n| 1 << n).collect() } else { self.machines.clone() }
    }
}

/// Largest number of machines.
const MOST_MACHINES: u32 = 1 << 16;

/// Report of the plan of a reconstruction.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct CapturePlan {
    /// Path of the pictures' transforms.json.
    #[serde(serialize_with = "crate::app::paths::text")]
    capture: PathBuf,
    /// Solver that the reconstruction uses.
    solver: Solver,
    /// Number of pictures.
    views: usize,
    /// Number of pictures whose pixels were read; of the others only headers were.
    read: usize,
    /// Numbers of the held-out views.
    held_out: Vec<usize>,
    /// Edge lengths of the voxels in world units.
    voxel_size: [f64; 3],
    /// Unknowns, pixels, memory and expected time of the whole run.
    expected: Cost,
    /// Least and longest time in seconds: held-out views decide when the search ends. Without a range the time is right
    /// within a factor of a few only.
    seconds_range: Option<[f64; 2]>,
    /// Fewest, expected and most iterations over all levels; none where the solver counts otherwise.
    iterations: Option<[f64; 3]>,
    /// Threads that the times hold for.
    threads: usize,
    /// Level that was timed on this machine, 0 the finest; none where times are those of a usual machine.
    timed_level: Option<u32>,
    /// Expected stages in the order of the work.
    stages: Vec<PlannedStage>,
    /// Memory beside what a machine has.
    memory: MemoryPlan,
    /// Time on several machines; none for solvers without a model of it.
    scaling: Option<ScalingPlan>,
}

/// A stage of a plan.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct PlannedStage {
    /// Name that the report of the run gives the stage.
    name: String,
    /// Expected wall time in seconds.
    seconds: f64,
    /// Least and longest time in seconds.
    range: [f64; 2],
}

/// Memory of a plan.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct MemoryPlan {
    /// Memory that each machine needs, in MB (2²⁰ bytes): every process holds all pictures and all voxels.
    needed_mb: f64,
    /// Memory that `max_memory` allows, in MB.
    allowed_mb: f64,
    /// True if the reconstruction fits.
    fits: bool,
    /// Smallest edge of voxels that fits, in world units; none where the pictures alone do not.
    smallest_voxel_size: Option<f64>,
}

/// Time of a plan on several machines.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct ScalingPlan {
    /// Partitions of the rays of the finest level: no more threads work on a pass, whatever the number of machines.
    partitions: usize,
    /// Number of machines beyond which none has a partition of its own left to do.
    useful_machines: u32,
    /// Bandwidth in Gbit/s.
    bandwidth: f64,
    /// Latency in µs.
    latency: f64,
    /// Part of the time between two exchanges that varies.
    delay: f64,
    /// Seconds of one machine that more machines do not shorten.
    alone_seconds: f64,
    /// Time and efficiency by the number of machines.
    machines: Vec<Scaled>,
}

impl Report for CapturePlan {}

impl DensitySettings {
    /// Plans the reconstruction by the headers of all pictures and the pixels of a few: a short search with these, on
    /// this machine, tells how long the parts of the work take.
    ///
    /// # Errors
    /// If the capture or a header cannot be used, or the pictures that were read bound no region.
    pub fn plan(&self, scaling: &ScalingSettings, context: &Context) -> Result<CapturePlan> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        self.check()?;
        scaling.check()?;
        let input = self.input(self.limits)?;
        let (json, solver) = (input.json.clone(), self.solver(&input.capture)?);
        let views = input.capture.frames.len();
        let held_out = photos::held_out(self.held_out, views, 8).map_err(|e| e.at(&self.capture))?;
        photos::headers(&input.capture, self.layer.as_deref())?;
        let channels = channels(&input.capture)?;
        let sample = {
            let _stage = context.stage("reading pictures");
            Sample::read(&input.capture, self.layer.as_deref(), channels, self.limits, context)
        };
        let sample = sample.map_err(|e| e.at(&json))?;
        let (placed, placing) = placed(&self.region, &input.capture, &sample).map_err(|e| e.at(&json))?;
        let task = Task::planned(self.limits, context);
        let observation = &sample.observation;
        let chosen = Search { solver, held_out, init: self.initial_densities(&task)? };
        let request = self.request((&task, &input.capture), observation, &placed, &chosen)?;
        let measured = {
            let _stage = context.stage("timing");
            solver.measured(&sample, &input.capture, &placed, &request).map_err(|e| e.at(&json))?
        };
        let cost = solver.cost(observation, &placed, &request, &input.capture, measured.as_ref());
        let draft = Draft { capture: &input.capture, placed: &placed, request: &request, cost };
        let (stages, search) = draft.stages(&sample, placing, measured.as_ref());
        let total = |i: usize| stages.iter().map(|stage| stage.seconds[i]).sum::<f64>();
        let (seconds, range) = (total(1), [total(0), total(2)]);
        let expected = Cost { seconds, ..cost };
        Ok(CapturePlan {
            capture: json,
            solver: solver.into(),
            views,
            read: observation.maps.len(),
            voxel_size: placed.lattice.voxel_size().to_array(),
            seconds_range: measured.as_ref().map(|_| range),
            iterations: search.as_ref().map(ExpectedSearch::iterations),
            threads: rayon::current_num_threads(),
            timed_level: measured.as_ref().map(|measured| measured.level),
            memory: draft.memory(solver.method()),
            scaling: search.zip(measured).map(|(search, measured)| draft.scaled(scaling, seconds, &search, &measured)),
            expected,
            held_out: request.held_out,
            stages: stages.into_iter().map(PlannedStage::from).collect(),
        })
    }
}

impl From<ExpectedStage> for PlannedStage {
    fn from(stage: ExpectedStage) -> Self {
        let [least, seconds, longest] = stage.seconds;
        Self { name: stage.name, seconds, range: [least, longest] }
    }
}

/// A plan in the making.
struct Draft<'d> {
    capture: &'d Capture,
    placed: &'d Placed,
    request: &'d Request,
    cost: Cost,
}

impl Draft<'_> {
    /// Returns all stages, and the search where it has a model.
    fn stages(
        &self,
        sample: &Sample,
        placing: f64,
        measured: Option<&Measured>,
    ) -> (Vec<ExpectedStage>, Option<ExpectedSearch>) {
        let Self { capture, placed, request, cost } = self;
        let views = capture.frames.len();
        let Some(measured) = measured else {
            let stage = |name: &str, seconds: f64| ExpectedStage { name: name.into(), seconds: [seconds; 3] };
            return (vec![stage("read pictures", sample.reading), stage("search and confidence", cost.seconds)], None);
        };
        let pictures = (views, capture.pixels());
        let search = ExpectedSearch::new(&sample.observation, &placed.survey, request, pictures, Some(measured));
        let [reading, confidence, writing] = around(sample, placing, (&placed.survey, views), measured);
        let stages = std::iter::once(reading).chain(search.stages()).chain([confidence, writing]).collect();
        (stages, Some(search))
    }

    /// Returns the memory beside what is allowed.
    fn memory(&self, method: Method) -> MemoryPlan {
        let allowed = self.request.max_memory;
        let sizes = PictureSizes::of(self.capture);
        let larger = |factor: f64| {
            let Survey { bricks, unknowns, longest } = self.placed.survey;
            let survey = Survey {
                bricks: coarser_bricks(bricks, factor),
                unknowns: unknowns / factor.powi(3),
                longest: longest / factor,
            };
            Cost::new(method, &survey, sizes, 0.0).fits(allowed).is_ok()
        };
        // Bisected: voxels of a 1024th of the size to those of 1024 times the size.
        let (mut fine, mut coarse) = (1.0 / 1024.0, 1024.0_f64);
        let any = larger(coarse);
        for _ in 0..30 {
            let middle = f64::sqrt(fine * coarse);
            if larger(middle) { coarse = middle } else { fine = middle }
        }
        let edge = self.placed.lattice.voxel_size().max_element();
        MemoryPlan {
            needed_mb: self.cost.memory_mb,
            allowed_mb: allowed as f64 / f64::from(1 << 20),
            fits: self.cost.fits(allowed).is_ok(),
            smallest_voxel_size: any.then_some(coarse * edge),
        }
    }

    /// Returns the time on several machines of a run that takes so many seconds on one.
    fn scaled(
        &self,
        settings: &ScalingSettings,
        seconds: f64,
        search: &ExpectedSearch,
        measured: &Measured,
    ) -> ScalingPlan {
        let cluster = settings.cluster();
        let passes: Vec<Pass> = search.passes().into_iter().chain([measured.probes]).collect();
        let still = Cluster { delay: 0.0, ..cluster };
        let shared: f64 = still.scaled(&[1], 0.0, &passes).iter().map(|scaled| scaled.seconds).sum();
        let own: f64 = passes.iter().map(|pass| pass.count * pass.alone).sum();
        let alone = (seconds - shared).max(0.0);
        let finest = search.passes().iter().rev().map(|pass| pass.partitions).next().unwrap_or(1);
        ScalingPlan {
            partitions: finest,
            useful_machines: cluster.useful_machines(&passes),
            bandwidth: settings.bandwidth,
            latency: settings.latency,
            delay: settings.delay,
            alone_seconds: alone + own,
            machines: cluster.scaled(&settings.numbers(), alone, &passes),
        }
    }
}

impl fmt::Display for CapturePlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { capture, views, read, held_out, expected, threads, .. } = self;
        writeln!(
            f,
            "{}: densities from {views} pictures, {} held out; the pixels of {read} were read",
            capture.display(),
            held_out.len()
        )?;
        let Cost { unknowns, measurements, .. } = expected;
        let [x, y, z] = self.voxel_size;
        writeln!(
            f,
            "  unknowns       about {unknowns} from {measurements} pixels, voxels of {x:.5} x {y:.5} x {z:.5}"
        )?;
        writeln!(f, "  {}", self.memory)?;
        write!(f, "  time           {} with {threads} threads", Duration(expected.seconds))?;
        match self.seconds_range {
            Some([least, longest]) => writeln!(f, ", {} to {}", Duration(least), Duration(longest))?,
            None => writeln!(f, ", within a factor of a few: this solver is not timed")?,
        }
        if let Some([fewest, usual, most]) = self.iterations {
            writeln!(f, "  iterations     {usual:.0} on all levels, {fewest:.0} to {most:.0}")?;
        }
        write!(f, "  {:<26}{:>10}{:>10}{:>10}", "stage", "seconds", "least", "longest")?;
        for PlannedStage { name, seconds, range: [least, longest] } in &self.stages {
            write!(f, "\n  {name:<26}{seconds:>10.2}{least:>10.2}{longest:>10.2}")?;
        }
        self.scaling.as_ref().map_or(Ok(()), |scaling| write!(f, "\n{scaling}"))
    }
}

impl fmt::Display for MemoryPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { needed_mb, allowed_mb, fits, smallest_voxel_size } = self;
        write!(f, "memory         {needed_mb:.0} MB, {allowed_mb:.0} MB are allowed: ")?;
        match (fits, smallest_voxel_size) {
            (true, Some(edge)) => write!(f, "it fits, and so do voxels of {edge:.5}"),
            (true, None) => write!(f, "it fits"),
            (false, Some(edge)) => write!(f, "it does not fit; voxels of {edge:.5} do"),
            (false, None) => write!(f, "it does not fit; the pictures alone do not"),
        }
    }
}

impl fmt::Display for ScalingPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { partitions, useful_machines, bandwidth, latency, machines, .. } = self;
        writeln!(
            f,
            "  machines       rays are in {partitions} partitions: up to {useful_machines} machines like this one have \
             work; {bandwidth} Gbit/s, {latency} µs"
        )?;
        write!(f, "  {:>10}{:>12}{:>12}", "machines", "seconds", "efficiency")?;
        for Scaled { machines, seconds, efficiency } in machines {
            write!(f, "\n  {machines:>10}{seconds:>12.2}{:>10.1} %", 100.0 * efficiency)?;
        }
        Ok(())
    }
}

/// Settings of a plan of a reconstruction, beside the capture: those of [`DensitySettings`] that decide its cost.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CapturePlanSettings {
    /// Lattice and bounds of the voxels.
    #[serde(flatten)]
    pub region: RegionSettings,
    /// How the densities are found.
    pub solver: Choice,
    /// Number of views that are not fitted.
    pub held_out: Option<usize>,
    /// Iterations on the finest level, at most.
    pub iterations: Option<u32>,
    /// Blur passes of the smoothness prior.
    pub smoothing: Option<u32>,
    /// Layer of the pictures; none for the beauty.
    pub layer: Option<String>,
    /// Machines that share the work.
    #[serde(flatten)]
    pub scaling: ScalingSettings,
}
