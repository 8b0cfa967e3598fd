//! Entry point of the program.

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: cumulo::process::Allocator = cumulo::process::Allocator;

fn main() -> ExitCode {
    // The build states it and its date, `make build` for one. Read here, it costs the linking of the program when it
    // changes, and no more.
    ExitCode::from(cumulo::cli::main(std::env::args_os().collect(), option_env!("CUMULO_COMMIT")))
}
