//! Options of what may be left out of pictures.

use crate::cli::parse;
use crate::plan::Effect;

/// Options of what may be left out of pictures.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Planning")]
pub(in crate::cli) struct PlanningOptions {
    /// Leave out effects as long as no channel of a pixel misses more radiance than this: a radiance, whatever the
    /// brightness of the pictures
    #[arg(long, value_name = "E", default_value_t = 0.0, value_parser = parse::not_negative)]
    pub max_omitted: f64,
    /// Keep effects whatever they add: emission, scattering, multiple-scattering, environment or light-N
    #[arg(long, value_name = "EFFECT,...", value_delimiter = ',')]
    pub force: Vec<Effect>,
}
