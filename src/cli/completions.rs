//! `cumulo completions`: scripts by which shells complete the program's commands and options.

use super::output::Output;
use super::run::Run;
use crate::error::Result;
use clap_complete::Shell;

/// Print the script by which a shell completes commands and options
#[derive(Debug, clap::Args)]
pub(crate) struct Completions {
    /// Shell that will read the script
    #[arg(value_enum)]
    shell: Shell,
}

impl Run for Completions {
    fn run(&self, output: &Output) -> Result<u8> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut super::command(), "cumulo", &mut script);
        output.plain(&String::from_utf8_lossy(&script))?;
        Ok(0)
    }
}
