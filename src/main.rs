//! Entry point of the program.

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: cumulo::process::Allocator = cumulo::process::Allocator;

fn main() -> ExitCode {
    cumulo::cli::main()
}
