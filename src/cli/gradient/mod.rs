//! `cumulo gradient`: derivatives of a loss on pictures, parameter by parameter, for checking and teaching.

mod page;
mod report;
mod scene;
mod voxels;

use super::memory::Memory;
use super::output::Output;
use super::parse;
use crate::app::checks::Warning;
use crate::app::outputs::{self, Content};
use crate::app::provenance::Provenance;
use crate::app::transfer::TransferSettings;
use crate::app::up::UpChoice;
use crate::differentiate::loss::Loss;
use crate::differentiate::loss::prior::{Prior, Weighted};
use crate::differentiate::study::ad_mode::{AdMode, Choice, Mode, Task};
use crate::differentiate::study::difference::Quotient;
use crate::differentiate::study::parameter::{CAMERA, Parameter};
use crate::differentiate::study::subject::{Subject, depth_channel};
use crate::differentiate::study::{Study, StudyGradient};
use crate::error::{Error, Result};
use crate::formats::captures;
use crate::formats::limits::Limits;
use crate::formats::vdb::{Codec, write_grids};
use crate::render::differentiable::Adjoint;
use crate::render::quadrature::{Quadrature, rules};
use crate::report::Page;
use crate::scene::capture::{EmissionModel, Model};
use crate::scene::grid::Grid;
use crate::scene::volume::Grids;
pub(in crate::cli) use report::Report;
use report::Row;
use scene::in_double;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// Differentiate a loss on pictures of a volume, and check the derivatives
///
/// Pictures are those of --views cameras on a sphere, or are compared with a --target capture. --check sets a
/// difference quotient in double precision beside each derivative: exit code 1 if any is off by more than --tolerance.
/// Where rounding leaves a quotient fewer than four digits, the error is relative to what would have them.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("from").required(true).args(["target", "views"]))]
pub struct GradientCommand {
    /// VDB to differentiate at
    input: PathBuf,
    /// Parameters to differentiate by, one kind or more
    #[arg(long, value_enum, value_delimiter = ',', required = true, value_name = "WHAT,...")]
    wrt: Vec<Wrt>,
    /// Loss, a mean over pixels and views
    #[arg(long, value_enum)]
    loss: LossName,
    /// Difference from which on huber grows no faster
    #[arg(long, value_name = "D", default_value_t = 0.1, value_parser = parse::positive)]
    huber_delta: f64,
    /// Transmittance below which log-transmittance asks for nothing
    #[arg(long, value_name = "T", default_value_t = 1e-4, value_parser = parse::positive)]
    transmittance_floor: f64,
    /// Added to the loss: smooth=W and tv=W (total variation) of the volume, tf=W and tf-rgb=W (smoothness) of the
    /// transfer function; W is the weight, in units of the largest density or extinction
    #[arg(long, value_name = "NAME=W")]
    prior: Vec<Weighted<Prior>>,
    /// transforms.json of the pictures to compare with, or its folder; cameras and light model are taken from it
    #[arg(long, value_name = "CAPTURE")]
    target: Option<PathBuf>,
    /// Place this many cameras around the volume
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    views: Option<u32>,
    /// Axis that points upwards, about which --views are placed
    #[arg(long, value_enum, value_name = "AXIS", default_value_t = UpChoice::Auto, conflicts_with = "target")]
    up: UpChoice,
    /// Model of the pictures (default: that of --target, emission-absorption with a transfer function or --emission,
    /// else absorption)
    #[arg(long, value_enum, conflicts_with = "tf")]
    model: Option<Model>,
    /// Size of the pictures of --views in pixels
    #[arg(long, value_name = "WxH", default_value = "64x64", value_parser = parse::size, conflicts_with = "target")]
    size: [u32; 2],
    /// Extinction per world unit at a density of 1 (default: that of --target, else 1)
    #[arg(long, value_name = "S", value_parser = parse::positive)]
    density_scale: Option<f64>,
    /// Radiance behind the volume, r,g,b (default: that of --target, else white for absorption, black for
    /// emission-absorption)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color)]
    background: Option<[f32; 3]>,
    /// Radiance of the source, r,g,b (default: that of --target, else none)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color, conflicts_with = "tf")]
    emission: Option<[f32; 3]>,
    /// How that radiance follows the density (default: that of --target, else grey: not at all)
    #[arg(long, value_enum, conflicts_with = "tf", requires = "emission")]
    emission_model: Option<EmissionModel>,
    #[command(flatten)]
    transfer: TransferSettings,
    #[arg(
        long,
        value_name = "Q",
        default_value = "exact",
        help = concat!(
            "Integration along rays: ",
            rules!(),
            "; pre-shaded volumes have one of their own",
        )
    )]
    quadrature: Quadrature,
    /// Forward or backward; auto goes by the number of parameters and the loss
    #[arg(long, value_enum, default_value_t = Mode::Auto)]
    mode: Mode,
    /// How the backward pass gets at its samples (default: tape, or replay for losses of whole pictures)
    #[arg(long, value_enum)]
    adjoint: Option<AdjointName>,
    /// Set a difference quotient beside each derivative, both in double precision
    #[arg(long)]
    check: bool,
    /// Largest relative error that --check lets pass
    #[arg(long, value_name = "T", default_value_t = 1e-4, value_parser = parse::not_negative, requires = "check")]
    tolerance: f64,
    /// Let --check check every parameter that is listed, not only a sample of 24 of each kind
    #[arg(long, requires = "check")]
    all: bool,
    /// How many voxels to list, those of the largest derivatives
    #[arg(long, value_name = "K", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    largest: u32,
    /// Write the derivatives by voxel as a VDB (with --wrt density or emission)
    #[arg(long, short, value_name = "OUT.vdb")]
    output: Option<PathBuf>,
    /// Make a page of pictures, slices and all that is listed, in this folder
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Grid to differentiate at (default: density, else the only scalar one)
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

/// `--wrt`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Wrt {
    /// The quadrature's step, in voxels
    Step,
    /// Position, rotation, focal lengths and principal point of each view
    Camera,
    /// The transfer function's parameters
    Tf,
    /// Every voxel's density, or extinction of a pre-shaded volume
    Density,
    /// Every voxel's emission in red, green and blue, of a pre-shaded volume
    Emission,
    /// Radiance behind the volume
    Background,
    /// Extinction per unit of density
    Extinction,
}

/// `--loss`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum LossName {
    /// |c - c'|
    L1,
    /// (c - c')²
    L2,
    /// Quadratic for small differences, linear for large ones
    Huber,
    /// (ln T - ln T')² of the transmittances
    LogTransmittance,
    /// 1 - SSIM of the colors
    Ssim,
    /// Entropy of the alphas, 1 where all are equal
    OpacityEntropy,
    /// The colors themselves
    Mean,
}

/// `--adjoint`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum AdjointName {
    /// A tape of one ray
    Tape,
    /// Walk the ray twice
    Replay,
    /// Weiss & Westermann's inversion of the blend
    Inversion,
}

/// Results of the command that are written once all is computed.
struct Results {
    report: Report,
    /// Derivatives by voxel, one grid a channel; empty without `--output`.
    grids: Vec<Grid>,
    /// Page of `--report`, still without provenance.
    page: Option<Page>,
}

/// Largest number of directions in forward mode, which walks every ray again for each few of them.
const MOST_DIRECTIONS: usize = 512;

/// Number of parameters of each group that `--check` samples.
const SAMPLE: usize = 24;
/// Number of values of the loss that a difference quotient takes, on average.
const EVALUATIONS: f64 = 6.0;

impl GradientCommand {
    /// Paths that the command reads.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        [&self.input].into_iter().chain(&self.target).chain(&self.transfer.tf).map(PathBuf::as_path).collect()
    }

    /// Reads, plans, differentiates, checks, writes and reports.
    ///
    /// # Errors
    /// If the volume or the pictures cannot be used, or a parameter of `--wrt` does not exist.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        let mut provenance = Provenance::begin(output);
        let limits = self.memory.limits();
        self.fits_together()?;
        if let Some(path) = &self.output {
            outputs::file(path, Content::Vdb)?;
        }
        if let Some(dir) = &self.report {
            outputs::report_folder(dir)?;
        }
        let (volume, setup) = {
            let _stage = output.stage("reading the volume");
            self.scene(limits)?
        };
        let up = setup.up.clone();
        up.iter().for_each(|up| output.note(up));
        let target = self.target.as_deref().map(captures::file);
        for path in [Some(self.input.as_path()), target.as_deref(), self.transfer.file()].into_iter().flatten() {
            provenance.input(path, [path])?;
        }
        let Results { mut report, grids, page } = match volume {
            Grids::Density(field) => self.evaluate(self.study(field, setup, limits, output)?, limits, output)?,
            Grids::EmissionExtinction(volume) => {
                self.evaluate(self.study(volume, setup, limits, output)?, limits, output)?
            }
        };
        if let Some(path) = &self.output {
            provenance.lap();
            let grids: Vec<&Grid> = grids.iter().collect();
            write_grids(path, &grids, &provenance.metadata(), Codec::default(), false)?;
        }
        if let (Some(dir), Some(mut page)) = (&self.report, page) {
            provenance.lap();
            page.provenance(&provenance.rows());
            report.report = Some(page.write(dir)?);
        }
        let wrong = report.worst_relative_error.is_some_and(|worst| worst.is_nan() || worst > self.tolerance);
        output.report(&Report { seconds: provenance.lap(), provenance: Some(provenance), up, ..report })?;
        Ok(if wrong { ExitCode::from(1) } else { ExitCode::SUCCESS })
    }

    /// Differentiates, and checks the derivatives if `--check` is given.
    fn evaluate<V: Subject>(
        &self,
        (study, warnings): (Study<V>, Vec<Warning>),
        limits: Limits,
        output: &Output,
    ) -> Result<Results> {
        if !self.check {
            let (gradient, report) = self.differentiate(&study, limits, output)?;
            return self.results(&study, &gradient, Report { warnings, ..report });
        }
        let mut study = in_double(study);
        let (gradient, report) = self.differentiate(&study, limits, output)?;
        let mut report = Report { warnings, ..report };
        self.compare(&mut study, &mut report, output)?;
        self.results(&study, &gradient, report)
    }

    fn results<V: Subject>(&self, study: &Study<V>, gradient: &StudyGradient, report: Report) -> Result<Results> {
        let page = self.report.as_ref().map(|_| self.page(study, gradient, &report)).transpose()?;
        Ok(Results { grids: self.as_grids(study, gradient), page, report })
    }

    /// Refuses options that contradict each other, before anything is read.
    fn fits_together(&self) -> Result<()> {
        let by = |w: Wrt| self.wrt.contains(&w);
        let inverts = self.adjoint == Some(AdjointName::Inversion);
        if self.quadrature.is_preintegrated() && self.check {
            return Err(Error::invalid(
                "--check: values of pre-integration jump, by less than its tolerance, where segments begin to be \
                 divided",
            )
            .hint("check the derivatives of --quadrature exact, which has difference quotients everywhere"));
        }
        if self.quadrature.is_preintegrated() && inverts {
            return Err(Error::unsupported("pre-integration has no --adjoint inversion")
                .hint("exact is what it approaches: --quadrature exact"));
        }
        if by(Wrt::Step) && self.quadrature.step().is_none() {
            return Err(Error::invalid(format!("--wrt step: the {} quadrature has no step", self.quadrature))
                .hint("choose one that has: --quadrature midpoint:0.5 or riemann:0.5"));
        }
        if self.output.is_some() && !by(Wrt::Density) && !by(Wrt::Emission) {
            return Err(Error::invalid("--output is for derivatives by voxel, which --wrt does not ask for")
                .hint("add density or emission to --wrt, or leave --output out"));
        }
        if self.mode == Mode::Forward && self.adjoint.is_some() {
            return Err(Error::invalid("--mode forward has no backward pass, --adjoint says how to go backward")
                .hint("leave one of them out"));
        }
        if self.loss().compares() && self.target.is_none() {
            return Err(Error::invalid("this loss compares with pictures, and --views has none")
                .hint("give pictures with --target, or use --loss mean or opacity-entropy"));
        }
        Ok(())
    }

    fn loss(&self) -> Loss {
        match self.loss {
            LossName::L1 => Loss::L1,
            LossName::L2 => Loss::L2,
            LossName::Huber => Loss::Huber { delta: self.huber_delta },
            LossName::LogTransmittance => Loss::LogTransmittance { floor: self.transmittance_floor },
            LossName::Ssim => Loss::Dissimilarity { peak: 1.0 },
            LossName::OpacityEntropy => Loss::OpacityEntropy,
            LossName::Mean => Loss::Mean,
        }
    }

    /// Returns the parameters that `--wrt` names, in its order and without voxels.
    fn parameters<V: Subject>(&self, study: &Study<V>) -> Vec<Parameter> {
        let mut all: Vec<Parameter> = Vec::new();
        for (i, wrt) in self.wrt.iter().enumerate() {
            if self.wrt[..i].contains(wrt) {
                continue;
            }
            match wrt {
                Wrt::Step => all.push(Parameter::Step),
                Wrt::Camera => all.extend(
                    (0..study.setting.cameras.len())
                        .flat_map(|view| (0..CAMERA.len()).map(move |part| Parameter::Camera { view, part })),
                ),
                Wrt::Tf => {
                    let count = study.setting.transfer.as_ref().map_or(0, |t| t.parameters().len());
                    all.extend((0..count).map(Parameter::Transfer));
                }
                Wrt::Density | Wrt::Emission => {}
                Wrt::Background => all.extend((0..3).map(Parameter::Background)),
                Wrt::Extinction => all.push(Parameter::Extinction),
            }
        }
        all
    }

    /// Returns the numbers of the voxels' channels that `--wrt` names.
    fn channels<V: Subject>(&self) -> Vec<usize> {
        let last = depth_channel::<V>();
        let named = |channel: &usize| self.wrt.contains(if *channel == last { &Wrt::Density } else { &Wrt::Emission });
        (0..=last).filter(named).collect()
    }

    /// Differentiates by all that `--wrt` names; the report lists the parameters and the largest derivatives by voxel.
    fn differentiate<V: Subject>(
        &self,
        study: &Study<V>,
        limits: Limits,
        output: &Output,
    ) -> Result<(StudyGradient, Report)> {
        let _stage = output.stage("derivatives");
        let (mut parameters, channels) = (self.parameters(study), self.channels::<V>());
        let count = parameters.len() + channels.len() * study.voxels();
        let plan = self.plan(study, count, &channels, limits)?;
        output.detail(format!("plan: {} parameters, {}", count, plan.reason));
        let gradient = study.gradient(plan.mode, &parameters, &channels).map_err(|e| e.at(&self.input))?;
        let mut derivatives = gradient.derivatives.clone();
        for (voxel, derivative) in self.largest_by_voxel(&gradient, &channels) {
            parameters.push(voxel);
            derivatives.push(derivative);
        }
        let (mode, adjoint) = match plan.mode {
            AdMode::Forward => ("forward", None),
            AdMode::Reverse(Adjoint::Tape) => ("reverse", Some("tape")),
            AdMode::Reverse(Adjoint::Replay) => ("reverse", Some("replay")),
            AdMode::Reverse(Adjoint::Inversion) => ("reverse", Some("inversion")),
        };
        let report = Report {
            input: self.input.clone(),
            loss: clap::ValueEnum::to_possible_value(&self.loss).map_or_else(String::new, |v| v.get_name().to_owned()),
            value: gradient.value,
            parameters: count,
            mode,
            adjoint,
            reason: plan.reason,
            precision: if self.check { "f64" } else { "f32" },
            quadrature: V::quadrature(&study.setting),
            views: study.setting.cameras.len(),
            up: None,
            rows: rows(study, parameters, derivatives),
            checked: None,
            worst_relative_error: None,
            warnings: Vec::new(),
            tolerance: self.check.then_some(self.tolerance),
            output: self.output.clone(),
            report: None,
            seconds: 0.0,
            provenance: None,
        };
        Ok((gradient, report))
    }

    /// Chooses the AD mode for `count` parameters, the voxels' `channels` among them.
    ///
    /// # Errors
    /// If forward mode is requested for too many parameters.
    fn plan<V: Subject>(&self, study: &Study<V>, count: usize, channels: &[usize], limits: Limits) -> Result<Choice> {
        let adjoint = self.adjoint.map(|a| match a {
            AdjointName::Tape => Adjoint::Tape,
            AdjointName::Replay => Adjoint::Replay,
            AdjointName::Inversion => Adjoint::Inversion,
        });
        let task = Task { parameters: count, reach: study.loss.reach(), depth_alone: V::depth_alone(&study.setting) };
        // Pre-integration's forward mode takes four reverse passes.
        let mode = match self.mode {
            Mode::Auto if self.quadrature.is_preintegrated() => Mode::Reverse,
            mode => mode,
        };
        let plan = Choice::new(task, mode, adjoint);
        let bytes = if channels.is_empty() { 0 } else { count * study.field.values.len() * size_of::<V>() };
        if plan.mode == AdMode::Forward && (count > MOST_DIRECTIONS || bytes as u64 > limits.max_memory) {
            return Err(Error::unsupported(format!(
                "--mode forward walks every ray again for each few of {count} parameters; it takes {MOST_DIRECTIONS} \
                 at most"
            ))
            .hint("use --mode reverse, which finds all at once"));
        }
        Ok(plan)
    }

    /// Returns the voxels of the largest derivatives and these derivatives, as many as `--largest` lists.
    fn largest_by_voxel(&self, gradient: &StudyGradient, channels: &[usize]) -> Vec<(Parameter, f64)> {
        let mut order: Vec<usize> = (0..gradient.by_voxel.len()).collect();
        // The sort is stable: equal ones stay in their order.
        order.sort_by(|a, b| gradient.by_voxel[*b].abs().total_cmp(&gradient.by_voxel[*a].abs()));
        order.truncate(self.largest as usize);
        let voxel = |i: usize| Parameter::Voxel { voxel: i / channels.len(), channel: channels[i % channels.len()] };
        order.into_iter().map(|i| (voxel(i), gradient.by_voxel[i])).collect()
    }

    /// Returns the numbers of the rows that are checked: all with `--all`, else at most [`SAMPLE`] of each group,
    /// evenly spaced.
    fn sample(&self, rows: &[Row]) -> Vec<usize> {
        if self.all {
            return (0..rows.len()).collect();
        }
        let mut groups: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        rows.iter().enumerate().for_each(|(i, row)| groups.entry(row.group).or_default().push(i));
        let spaced = |all: Vec<usize>| {
            let count = all.len().min(SAMPLE);
            (0..count).map(|k| all[k * all.len() / count]).collect::<Vec<_>>()
        };
        let mut chosen: Vec<usize> = groups.into_values().flat_map(spaced).collect();
        chosen.sort_unstable();
        chosen
    }

    /// Sets difference quotients and relative errors beside the derivatives of the rows that are checked.
    fn compare<V: Subject<Double = V>>(
        &self,
        study: &mut Study<V>,
        report: &mut Report,
        output: &Output,
    ) -> Result<()> {
        let chosen = self.sample(&report.rows);
        let begun = Instant::now();
        study.value().map_err(|e| e.at(&self.input))?;
        // Of two to nine values each.
        let seconds = EVALUATIONS * chosen.len() as f64 * begun.elapsed().as_secs_f64();
        output.note(format!(
            "check: {} of {} parameters, about {:.0} s{}",
            chosen.len(),
            report.parameters,
            seconds.ceil(),
            if chosen.len() < report.rows.len() { "; --all checks all that are listed" } else { "" }
        ));
        report.checked = Some(chosen.len());
        let bar = output.steps(chosen.len() as u64, "check");
        for number in chosen {
            let row = &mut report.rows[number];
            let quotient = study.difference(row.parameter).map_err(|e| e.part(row.name.clone()).at(&self.input))?;
            (row.difference, row.rounding) = (Some(quotient.value), Some(quotient.rounding));
            bar.inc(1);
        }
        drop(bar);
        let mut largest: BTreeMap<&str, f64> = BTreeMap::new();
        for row in &report.rows {
            let most = largest.entry(row.group).or_default();
            *most = most.max(row.gradient.abs()).max(row.difference.map_or(0.0, f64::abs));
        }
        let mut worst = 0.0_f64;
        for row in &mut report.rows {
            let Some((value, rounding)) = row.difference.zip(row.rounding) else { continue };
            let error = Quotient { value, rounding }.error(row.gradient, 1e-6 * largest[row.group]);
            // A NaN must not look like agreement.
            worst = if error.is_nan() || worst.is_nan() { f64::NAN } else { worst.max(error) };
            row.relative_error = Some(error);
        }
        report.worst_relative_error = Some(worst);
        Ok(())
    }
}

/// Returns the rows of the report in the order of the parameters, not yet checked.
fn rows<V: Subject>(study: &Study<V>, parameters: Vec<Parameter>, derivatives: Vec<f64>) -> Vec<Row> {
    let described = study.described(&parameters).into_iter().zip(parameters).zip(derivatives);
    let row = |(((name, group, value), parameter), gradient)| Row {
        name,
        group,
        value,
        gradient,
        difference: None,
        rounding: None,
        relative_error: None,
        parameter,
    };
    described.map(row).collect()
}
