//! The command line: each subcommand loads, works, writes and reports.

pub mod cancel;
pub mod capture;
pub mod compare;
pub mod convert;
pub mod denoise;
pub mod diff;
mod failed;
pub mod gradient;
pub mod info;
pub mod memory;
pub mod motion;
pub mod output;
pub mod outputs;
pub mod parse;
pub mod paths;
pub mod photos;
pub mod plan;
pub mod pose;
pub mod provenance;
pub mod reconstruct;
pub mod render;
pub mod report;
pub mod run;
pub mod schema;
pub mod task;
pub mod transfer;
pub mod try_grid;
pub mod usd;
pub mod validate;
mod values;
pub mod view;
pub mod viewpoint;
pub mod volume;

use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::vdb::{self, helper};
use crate::process;
use clap::{Parser, Subcommand};
use output::Output;
use std::ffi::OsStr;
use std::process::ExitCode;

/// Volumes between OpenVDB, Blender, USD and EXR: inspect, render, compare and reconstruct.
#[derive(Debug, Parser)]
#[command(name = "cumulo", version, arg_required_else_help = true, propagate_version = true)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    global: Global,
}

/// Options that every subcommand takes.
#[derive(Debug, Clone, clap::Args)]
pub struct Global {
    /// Print the result as JSON on standard output
    #[arg(long, global = true)]
    pub json: bool,
    /// Threads to work with, 1 to 1024 (default: RAYON_NUM_THREADS, else all cores); results do not depend on it
    #[arg(long, global = true, value_name = "N")]
    pub threads: Option<usize>,
    /// No progress on standard error
    #[arg(long, short, global = true)]
    pub quiet: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    #[command(subcommand)]
    Capture(capture::CaptureCommand),
    Compare(compare::Arguments),
    Info(info::Info),
    Motion(motion::MotionCommand),
    Plan(plan::PlanCommand),
    Validate(validate::Validate),
    Convert(convert::Convert),
    Denoise(denoise::Denoise),
    Diff(diff::Diff),
    Pose(pose::Pose),
    Gradient(gradient::GradientCommand),
    Render(render::Render),
    #[command(subcommand)]
    Reconstruct(reconstruct::Reconstruct),
    Report(report::Report),
    Schema(schema::Schema),
    Transfer(transfer::TransferCommand),
    #[command(name = crate::formats::vdb::helper::SUBCOMMAND, hide = true)]
    TryGrid(try_grid::TryGrid),
    #[command(subcommand)]
    Usd(usd::UsdCommand),
    View(view::View),
    Viewpoint(viewpoint::Viewpoint),
}

impl Command {
    /// Memory in bytes that the whole process may take.
    fn max_memory(&self) -> u64 {
        let memory = match self {
            Self::Capture(c) => c.memory(),
            Self::Compare(c) => c.memory,
            Self::Info(c) => c.memory,
            Self::Motion(c) => c.memory,
            Self::Validate(c) => c.memory,
            Self::Convert(c) => c.memory,
            Self::Denoise(c) => c.memory,
            Self::Diff(c) => c.memory,
            Self::Pose(c) => c.memory,
            Self::Gradient(c) => c.memory,
            Self::Plan(c) => c.pictures.memory,
            Self::Render(c) => c.pictures.memory,
            Self::Reconstruct(c) => c.memory(),
            Self::Report(c) => c.memory,
            Self::Schema(_) => return Limits::default().max_memory,
            Self::Transfer(c) => c.memory,
            Self::TryGrid(c) => return c.max_memory,
            Self::Usd(c) => c.memory(),
            Self::View(c) => c.memory,
            Self::Viewpoint(c) => c.memory,
        };
        memory.limits().max_memory
    }
}

/// Environment variable of the number of threads, which `--threads` overrides.
const THREADS: &str = "RAYON_NUM_THREADS";
/// Largest number of threads; more are taken for a mistake, as each has a stack and accumulators of its own.
const MOST_THREADS: usize = 1024;

/// Returns the number of threads: that of `--threads`, else that of the environment, else none for all cores.
///
/// # Errors
/// If the option or the variable is no number from 1 to [`MOST_THREADS`].
fn threads(option: Option<usize>, variable: Option<&OsStr>) -> Result<Option<usize>> {
    let bounded = |n: &usize| (1..=MOST_THREADS).contains(n);
    match (option, variable) {
        (Some(n), _) if bounded(&n) => Ok(Some(n)),
        (Some(n), _) => Err(Error::invalid(format!("--threads {n}: a number from 1 to {MOST_THREADS} is expected"))
            .hint("leave it out to work on all cores")),
        (None, None) => Ok(None),
        (None, Some(text)) => {
            let n = text.to_str().and_then(|text| text.parse().ok()).filter(bounded);
            n.map(Some).ok_or_else(|| {
                let text = text.to_string_lossy();
                Error::invalid(format!("{THREADS} is '{text}': a number from 1 to {MOST_THREADS} is expected"))
                    .hint(format!("correct it, or `unset {THREADS}` to work on all cores; --threads outdoes it"))
            })
        }
    }
}

/// Runs the command line.
///
/// # Errors
/// Those of the subcommand; the caller prints them and exits with 2.
pub fn run(arguments: Arguments) -> Result<ExitCode> {
    // 0 stands for all cores. Threads, libraries and the helper's name come before the limit of memory, which holds for
    // what the command does.
    let count = threads(arguments.global.threads, std::env::var_os(THREADS).as_deref())?.unwrap_or(0);
    rayon::ThreadPoolBuilder::new().num_threads(count).build_global().map_err(|e| {
        Error::invalid(format!("the threads cannot be started: {e}"))
            .hint("give fewer to --threads, or raise the limit on processes (ulimit -u)")
    })?;
    cancel::install()?;
    if let Ok(program) = std::env::current_exe() {
        helper::set_program(program);
    }
    vdb::on_terminate(process::abandon);
    process::limit_memory(arguments.command.max_memory());
    let output = Output::new(&arguments.global);
    match arguments.command {
        Command::Capture(c) => c.run(&output),
        Command::Compare(a) => compare::run(&a, &output),
        Command::Info(c) => c.run(&output),
        Command::Motion(c) => c.run(&output),
        Command::Validate(c) => c.run(&output),
        Command::Convert(c) => c.run(&output),
        Command::Denoise(c) => c.run(&output),
        Command::Diff(c) => c.run(&output),
        Command::Pose(c) => c.run(&output),
        Command::Gradient(c) => c.run(&output),
        Command::Plan(c) => c.run(&output),
        Command::Render(c) => c.run(&output),
        Command::Reconstruct(c) => c.run(&output),
        Command::Report(c) => c.run(&output),
        Command::Schema(c) => c.run(&output),
        Command::Transfer(c) => c.run(&output),
        Command::TryGrid(c) => Ok(c.run()),
        Command::Usd(c) => c.run(&output),
        Command::View(c) => c.run(&output),
        Command::Viewpoint(c) => c.run(&output),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_are_bounded_and_the_variable_is_not_ignored() {
        let env = |text: &'static str| threads(None, Some(OsStr::new(text)));
        assert_eq!(threads(Some(3), Some(OsStr::new("nonsense"))).unwrap(), Some(3));
        assert_eq!((threads(None, None).unwrap(), env("8").unwrap()), (None, Some(8)));
        for n in [0, 1025, usize::MAX] {
            let error = threads(Some(n), None).unwrap_err();
            assert!(error.what().contains("1 to 1024") && error.remedy().is_some(), "{error}");
        }
        for text in ["", "0", "-1", "abc", "2000", " 4", "1e2"] {
            let error = env(text).unwrap_err();
            assert!(error.what().contains("RAYON_NUM_THREADS") && error.remedy().is_some(), "{error}");
        }
    }
}
