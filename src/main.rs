//! Entry point: parses the command line, runs it and returns the exit code: 0 success, 1 a check found something, 2 an
//! error.

use clap::Parser;
use cumulo::cli;
use std::io::Write;
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: cumulo::process::Allocator = cumulo::process::Allocator;

fn main() -> ExitCode {
    match cli::run(cli::Arguments::parse()) {
        Ok(code) => code,
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "cumulo: {error}");
            ExitCode::from(2)
        }
    }
}
