//! Groups of options that several commands share, each as the settings of the use cases that it becomes.

pub(crate) mod accuracy;
pub(crate) mod aim;
pub(crate) mod blur;
pub(crate) mod density;
pub(crate) mod frames;
pub(crate) mod holdout;
pub(crate) mod pictures;
pub(crate) mod refinement;
pub(crate) mod region;
pub(crate) mod scan;
pub(crate) mod scattering;
pub(crate) mod single;
pub(crate) mod subject;
pub(crate) mod transfer;

/// Has settings read from the command line as `$args` are, which they are made from.
macro_rules! read_as {
    ($settings:ty, $args:ty) => {
        impl clap::FromArgMatches for $settings {
            fn from_arg_matches(matches: &clap::ArgMatches) -> Result<Self, clap::Error> {
                <$args as clap::FromArgMatches>::from_arg_matches(matches).map(Into::into)
            }

            fn from_arg_matches_mut(matches: &mut clap::ArgMatches) -> Result<Self, clap::Error> {
                <$args as clap::FromArgMatches>::from_arg_matches_mut(matches).map(Into::into)
            }

            fn update_from_arg_matches(&mut self, matches: &clap::ArgMatches) -> Result<(), clap::Error> {
                *self = <Self as clap::FromArgMatches>::from_arg_matches(matches)?;
                Ok(())
            }
        }

        impl clap::Args for $settings {
            fn augment_args(command: clap::Command) -> clap::Command {
                <$args as clap::Args>::augment_args(command)
            }

            fn augment_args_for_update(command: clap::Command) -> clap::Command {
                <$args as clap::Args>::augment_args_for_update(command)
            }
        }
    };
}
pub(in crate::cli) use read_as;
