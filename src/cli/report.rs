//! `cumulo report`: the page of a reconstruction, made again with more beside it.

use super::args::read_as;
use super::memory::Memory;
use crate::app::report::{OtherRenders, PageSettings};
use std::path::PathBuf;

/// Make the page of a reconstruction again, with what is true or other renders beside it
#[derive(Debug, clap::Args)]
struct PageArgs {
    /// Folder that `reconstruct --report` wrote
    folder: PathBuf,
    /// Volume, or transfer function, to compare with
    #[arg(long, value_name = "IN.vdb|TF")]
    reference: Option<PathBuf>,
    /// Renders of the result from the same cameras, shown beside the program's own: a name for them and their capture
    #[arg(long, value_name = "NAME=CAPTURE", value_parser = named)]
    beside: Option<OtherRenders>,
    #[command(flatten)]
    memory: Memory,
}

fn named(text: &str) -> Result<OtherRenders, String> {
    match text.split_once('=') {
        Some((name, path)) if !name.is_empty() && !path.is_empty() => {
            Ok(OtherRenders { name: name.into(), capture: path.into() })
        }
        _ => Err(format!("'{text}' is not NAME=CAPTURE")),
    }
}

impl From<PageArgs> for PageSettings {
    fn from(args: PageArgs) -> Self {
        Self { folder: args.folder, reference: args.reference, beside: args.beside, limits: args.memory.limits() }
    }
}

read_as!(PageSettings, PageArgs);
