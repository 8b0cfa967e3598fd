//! Options that stand alone and that several commands have.

use std::path::PathBuf;

/// Defines a group of one option, which becomes the option's value.
macro_rules! single {
    ($group:ident, $field:ident: $value:ty, $(#[$attribute:meta])+) => {
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

single!(HeldOut, held_out: Option<usize>,
    /// Number of views of the capture to hold out: these are not fitted, but decide when to stop (default: one of 8 or
    /// more)
    #[arg(long, value_name = "K")]
);

single!(Layer, layer: Option<String>,
    /// Layer of the capture's pictures (default: the beauty)
    #[arg(long, value_name = "NAME")]
);

single!(ScalarGrid, grid: Option<String>,
    /// Grid of the volume (default: density, else the only scalar one)
    #[arg(long, value_name = "NAME")]
);

single!(PageFolder, report: Option<PathBuf>,
    /// Write an HTML page that shows the work and its result to this folder
    #[arg(long, value_name = "DIR")]
);

single!(Resume, resume: bool,
    /// Go on from the output, if the same command has left one, however far it went
    #[arg(long, conflicts_with = "init")]
);
