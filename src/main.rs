//! Entry point of the program.

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: cumulo::process::Allocator = cumulo::process::Allocator;

fn main() -> ExitCode {
    // The build states it, `make build` for one. Read here, it costs the linking of the program when it changes, and no
    // more.
    cumulo::cli::main(option_env!("CUMULO_COMMIT"))
}
