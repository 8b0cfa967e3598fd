//! `cumulo man`: manual pages.

use super::output::Output;
use super::run::Run;
use crate::app::outputs;
use crate::error::{Error, Result};
use crate::formats::atomic::Batch;
use clap::Command;
use clap_mangen::Man;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// Print a manual page, or write those of all commands into a folder
#[derive(Debug, clap::Args)]
pub(crate) struct ManCommand {
    /// Words of the command whose page is printed, such as: reconstruct density (default: the program's)
    #[arg(value_name = "COMMAND")]
    words: Vec<String>,
    /// Write the pages of all commands into this folder, cumulo.1 and one for each: cumulo-render.1
    #[arg(long, short, value_name = "DIR", conflicts_with = "words")]
    output: Option<PathBuf>,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(in crate::cli) struct Report {
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    pages: Vec<String>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} manual pages", self.output.display(), self.pages.len())
    }
}

/// A page: its name without the section, and its text in roff.
type Page = (String, Vec<u8>);

impl Run for ManCommand {
    fn run(&self, output: &Output) -> Result<u8> {
        let mut command = super::command();
        command.build();
        let mut all = Vec::new();
        pages(&command, "cumulo", &mut all)?;
        match &self.output {
            Some(folder) => write(folder, &all, output)?,
            None => {
                let name = std::iter::once("cumulo").chain(self.words.iter().map(String::as_str));
                let name = name.collect::<Vec<_>>().join("-");
                let page = all.iter().find(|(other, _)| *other == name).ok_or_else(|| {
                    Error::invalid(format!("there is no command '{}'", self.words.join(" ")))
                        .hint("cumulo --help lists the commands")
                })?;
                output.plain(&String::from_utf8_lossy(&page.1))?;
            }
        }
        Ok(0)
    }
}

/// Adds the page of a command and those of its subcommands.
fn pages(command: &Command, name: &str, all: &mut Vec<Page>) -> Result<()> {
    let mut text = Vec::new();
    let titled = command.clone().display_name(name.to_owned());
    let source = concat!("cumulo ", env!("CARGO_PKG_VERSION"));
    Man::new(titled).title(name.to_uppercase()).source(source).render(&mut text).map_err(Error::system)?;
    all.push((name.to_owned(), text));
    for sub in command.get_subcommands().filter(|sub| !sub.is_hide_set() && sub.get_name() != "help") {
        pages(sub, &format!("{name}-{}", sub.get_name()), all)?;
    }
    Ok(())
}

fn write(folder: &Path, all: &[Page], output: &Output) -> Result<()> {
    outputs::folder(folder)?;
    let mut batch = Batch::new();
    batch.make_folder(folder)?;
    let mut names = Vec::new();
    for (name, text) in all {
        let name = format!("{name}.1");
        let waiting = batch.add(&folder.join(&name))?;
        std::fs::write(&waiting, text).map_err(|e| Error::io(&waiting, e))?;
        names.push(name);
    }
    batch.commit()?;
    output.report(&Report { output: folder.to_path_buf(), pages: names })
}
