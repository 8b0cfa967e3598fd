//! The command line: each subcommand loads, works, writes and reports.

pub mod cancel;
pub mod compare;
pub mod convert;
pub mod diff;
pub mod gradient;
pub mod info;
pub mod light;
pub mod memory;
pub mod output;
pub mod outputs;
pub mod parse;
pub mod photos;
pub mod pose;
pub mod provenance;
pub mod reconstruct;
pub mod render;
pub mod report;
pub mod run;
pub mod scene;
pub mod task;
pub mod transfer;
pub mod try_grid;
pub mod validate;
pub mod viewpoint;
pub mod volume;

use crate::error::{Error, Result};
use crate::formats::vdb::{self, Limits, helper};
use crate::process;
use clap::{Parser, Subcommand};
use output::Output;
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
    /// Threads to work with (default: RAYON_NUM_THREADS, else all cores); results do not depend on it
    #[arg(long, global = true, value_name = "N")]
    pub threads: Option<usize>,
    /// No progress on standard error
    #[arg(long, short, global = true)]
    pub quiet: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    Compare(compare::Arguments),
    Info(info::Info),
    Validate(validate::Validate),
    Convert(convert::Convert),
    Diff(diff::Diff),
    Pose(pose::Pose),
    Gradient(gradient::GradientCommand),
    Render(render::Render),
    #[command(subcommand)]
    Reconstruct(reconstruct::Reconstruct),
    Report(report::Report),
    Transfer(transfer::TransferCommand),
    #[command(name = crate::formats::vdb::helper::SUBCOMMAND, hide = true)]
    TryGrid(try_grid::TryGrid),
    Viewpoint(viewpoint::Viewpoint),
}

impl Command {
    /// Bytes of memory that the whole process may take.
    fn max_memory(&self) -> u64 {
        let memory = match self {
            Self::Compare(_) => return Limits::default().max_memory,
            Self::Info(c) => c.memory,
            Self::Validate(c) => c.memory,
            Self::Convert(c) => c.memory,
            Self::Diff(c) => c.memory,
            Self::Pose(c) => c.memory,
            Self::Gradient(c) => c.memory,
            Self::Render(c) => c.memory,
            Self::Reconstruct(c) => c.memory(),
            Self::Report(c) => c.memory,
            Self::Transfer(c) => c.memory,
            Self::TryGrid(c) => return c.max_memory,
            Self::Viewpoint(c) => c.memory,
        };
        memory.limits().max_memory
    }
}

/// Runs the command line.
///
/// # Errors
/// Whatever the subcommand met; the caller prints it and exits with 2.
pub fn run(arguments: Arguments) -> Result<ExitCode> {
    if let Some(n) = arguments.global.threads {
        if n == 0 {
            return Err(Error::invalid("--threads 0: at least one thread is needed"));
        }
        rayon::ThreadPoolBuilder::new()
            .num_threads(n)
            .build_global()
            .map_err(|e| Error::invalid(format!("--threads {n}: {e}")))?;
    }
    // Threads, libraries and the helper's name come before the limit, which holds for what the command does.
    cancel::install()?;
    let threads = rayon::current_num_threads();
    debug_assert!(threads > 0);
    if let Ok(program) = std::env::current_exe() {
        helper::set_program(program);
    }
    vdb::on_terminate(process::abandon);
    process::limit_memory(arguments.command.max_memory());
    let output = Output::new(&arguments.global);
    match arguments.command {
        Command::Compare(a) => compare::run(&a, &output),
        Command::Info(c) => c.run(&output),
        Command::Validate(c) => c.run(&output),
        Command::Convert(c) => c.run(&output),
        Command::Diff(c) => c.run(&output),
        Command::Pose(c) => c.run(&output),
        Command::Gradient(c) => c.run(&output),
        Command::Render(c) => c.run(&output),
        Command::Reconstruct(c) => c.run(&output),
        Command::Report(c) => c.run(&output),
        Command::Transfer(c) => c.run(&output),
        Command::TryGrid(c) => Ok(c.run()),
        Command::Viewpoint(c) => c.run(&output),
    }
}
