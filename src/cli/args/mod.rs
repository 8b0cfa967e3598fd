//! Groups of options that several commands share, each as the settings of the use cases that it becomes.

pub(crate) mod accuracy;
pub(crate) mod aim;
pub(crate) mod blur;
pub(crate) mod density;
pub(crate) mod frames;
pub(crate) mod holdout;
pub(crate) mod lights;
pub(crate) mod pictures;
pub(crate) mod refinement;
pub(crate) mod region;
pub(crate) mod scan;
pub(crate) mod scattering;
pub(crate) mod single;
pub(crate) mod subject;
pub(crate) mod transfer;
pub(crate) mod velocity;

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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use crate::app::capture::{CaptureSettings, NewCaptureSettings};
    use crate::app::compare::CompareSettings;
    use crate::app::convert::ConvertSettings;
    use crate::app::denoise::DenoiseSettings;
    use crate::app::diff::DiffSettings;
    use crate::app::figure::FigureSettings;
    use crate::app::function::FunctionSettings;
    use crate::app::gradient::GradientSettings;
    use crate::app::info::InfoSettings;
    use crate::app::motion::MotionSettings;
    use crate::app::plan::PlanSettings;
    use crate::app::pose::PoseSettings;
    use crate::app::reconstruct::{ColorSettings, DensitySettings, TransferFunctionSettings};
    use crate::app::render::{MergeSettings, RenderSettings};
    use crate::app::report::PageSettings;
    use crate::app::selftest::SelftestSettings;
    use crate::app::study::denoise::DenoiseStudySettings;
    use crate::app::study::gradient::GradientStudySettings;
    use crate::app::study::reconstruct::ReconstructStudySettings;
    use crate::app::study::render::RenderStudySettings;
    use crate::app::usd::author::AuthorSettings;
    use crate::app::usd::lint::LintSettings;
    use crate::app::validate::ValidateSettings;
    use crate::app::viewpoint::ViewpointSettings;
    use serde::Serialize;
    use serde_json::Value;

    /// Returns the settings, of those in groups with the group's name, whose values are not the same.
    fn differing(a: &Value, b: &Value) -> Vec<String> {
        let (Value::Object(a), Value::Object(b)) = (a, b) else { return Vec::new() };
        let names = a.keys().chain(b.keys().filter(|name| !a.contains_key(*name)));
        let within = |name: &String| match (a.get(name), b.get(name)) {
            (Some(a), Some(b)) if a == b => Vec::new(),
            (Some(a @ Value::Object(_)), Some(b @ Value::Object(_))) => {
                differing(a, b).iter().map(|below| format!("{name}.{below}")).collect()
            }
            _ => vec![name.clone()],
        };
        names.flat_map(within).collect()
    }

    /// Returns the settings whose values are not the defaults after these words.
    fn changed<S: clap::Args + Default + Serialize>(words: &str) -> String {
        let command = S::augment_args(clap::Command::new("cumulo"));
        let matches = command.try_get_matches_from(["cumulo"].into_iter().chain(words.split(' '))).unwrap();
        let read = serde_json::to_value(S::from_arg_matches(&matches).unwrap()).unwrap();
        let mut names = differing(&read, &serde_json::to_value(S::default()).unwrap());
        names.sort();
        names.join(" ")
    }

    /// Defaults stand in the options and in the settings: a program that leaves one out gets that of the command line.
    #[test]
    fn options_and_settings_have_the_same_defaults() {
        let all = [
            (changed::<AuthorSettings>("a.vdb -o b.usda"), "input output"),
            (changed::<CaptureSettings>("a -o b"), "input output"),
            (changed::<ColorSettings>("a -o b.vdb"), "capture output"),
            (changed::<CompareSettings>("a.exr b.exr"), "a b"),
            (changed::<ConvertSettings>("a.vdb b.vdb"), "input output"),
            (changed::<DenoiseSettings>("a.exr -o b.exr"), "input output"),
            (changed::<DenoiseStudySettings>("a.exr --reference b.exr -o c"), "inputs output reference"),
            (changed::<DensitySettings>("a -o b.vdb"), "capture output"),
            (changed::<DiffSettings>("a.vdb b.vdb"), "a b"),
            (changed::<FigureSettings>("a.exr -o b.svg"), "inputs output"),
            (changed::<FunctionSettings>("viridis"), "input"),
            (changed::<GradientSettings>("a.vdb --wrt density --loss l2 --views 1"), "input views wrt"),
            // The command line starts a study of the mean, for which no target is needed.
            (changed::<GradientStudySettings>("a.vdb -o b"), "gradient.input gradient.loss gradient.wrt output"),
            (changed::<InfoSettings>("a.vdb"), "files"),
            (changed::<LintSettings>("a.usda"), "stages"),
            (changed::<MergeSettings>("a.exr -o b.exr"), "inputs output"),
            (changed::<MotionSettings>("a.vdb --cameras b -o c.exr"), "cameras input output"),
            (changed::<NewCaptureSettings>("a.vdb -o b.json"), "input output"),
            (changed::<PageSettings>("a"), "folder"),
            (changed::<PlanSettings>("a.vdb"), "input"),
            (changed::<PoseSettings>("a --volume b.vdb -o c.json"), "capture output volume"),
            (changed::<ReconstructStudySettings>("a -o b"), "capture output"),
            (changed::<RenderSettings>("a.vdb -o b"), "input output"),
            (changed::<RenderStudySettings>("a.vdb -o b"), "input output"),
            (changed::<SelftestSettings>("dvr"), "cases"),
            (changed::<TransferFunctionSettings>("a --volume b.vdb -o c.tf.json"), "capture output volume"),
            (changed::<ValidateSettings>("a.vdb"), "files"),
            (changed::<ViewpointSettings>("a.vdb -o b.json"), "input output"),
        ];
        let wrong: Vec<_> = all.iter().filter(|(changed, given)| changed != given).collect();
        assert!(wrong.is_empty(), "{wrong:#?}");
    }
}
