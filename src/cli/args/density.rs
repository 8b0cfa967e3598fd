//! Options of the reconstruction of densities that decide its cost.

use super::single::HeldOut;
use crate::app::reconstruct::density::Choice;

/// Options of the search for densities that decide what it costs.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct DensityCost {
    /// How the densities are found: auto is cg where the pictures depend on the optical depth alone, colors first
    /// where there is a transfer function, else weiss2021
    #[arg(long, value_enum, default_value_t = Choice::Auto)]
    pub solver: Choice,
    #[command(flatten)]
    pub held_out: HeldOut,
    /// Iterations on the finest level, at most (default: 24, or 40 where the pictures have noise; with a transfer
    /// function, or weiss2021: 50 epochs)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub iterations: Option<u32>,
    /// Blur passes of the smoothness prior (default: as many as suit the held-out views, without these 1; where the
    /// pictures have noise, differences of neighbours are penalised instead, as suits these views)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=64))]
    pub smoothing: Option<u32>,
}
