//! Options that stand alone and that several commands have.

use crate::cli::parse;
use crate::render::quadrature::{Quadrature, rules};
use std::path::PathBuf;

/// Defines a group of one option, which becomes the option's value.
macro_rules! single {
    ($(#[$attribute:meta])+ $group:ident { $field:ident: $value:ty }) => {
        #[derive(Debug, clap::Args)]
        pub(in crate::cli) struct $group {
            $(#[$attribute])+
            $field: $value,
        }

        impl From<$group> for $value {
            fn from(group: $group) -> Self {
                group.$field
            }
        }
    };
}

single! {
    /// Number of views of the capture to hold out: these are not fitted, but decide when to stop (default: one of 8 or
    /// more)
    #[arg(long, value_name = "K")]
    HeldOut { held_out: Option<usize> }
}

single! {
    /// Layer of the capture's pictures (default: the beauty)
    #[arg(long, value_name = "NAME")]
    Layer { layer: Option<String> }
}

single! {
    /// Grid of the volume (default: density, else the only scalar one)
    #[arg(long, value_name = "NAME")]
    ScalarGrid { grid: Option<String> }
}

single! {
    #[arg(
        long,
        value_name = "Q",
        help = concat!(
            "Integration along rays: ",
            rules!(),
            "; by default exact, and preintegrated through functions of more than 32 points",
        )
    )]
    Integration { quadrature: Option<Quadrature> }
}

single! {
    /// Probability with which the truth is within the stated error of a block
    #[arg(long = "confidence", value_name = "C", default_value_t = 0.95, value_parser = parse::probability)]
    Confidence { confidence_level: f64 }
}

single! {
    /// Write an HTML page that shows the work and its result to this folder
    #[arg(long, value_name = "DIR")]
    PageFolder { report: Option<PathBuf> }
}

single! {
    /// Go on from the output, if the same command has left one, however far it went
    #[arg(long, conflicts_with = "init")]
    Resume { resume: bool }
}

single! {
    /// Replace an output that is there, whatever made it; without this option at most one that the same settings made
    /// is replaced
    #[arg(long)]
    Overwrite { overwrite: bool }
}
