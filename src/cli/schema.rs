//! `cumulo schema`: JSON schemas of the files that Cumulo reads, and of the documents that it writes.

use super::job::Told;
use super::output::Output;
use super::run::Run;
use super::{document, man};
use crate::app;
use crate::error::{Error, Result};
use crate::formats::scene_file;
use schemars::Schema as JsonSchema;

/// Print the JSON schema of a kind of file, or of what a command writes with --json
///
/// A document holds the report of the command or, if it failed, its error; `error` is the schema of such documents
/// alone.
#[derive(Debug, clap::Args)]
pub(crate) struct Schema {
    /// Kind of file, or command with dashes between its words
    #[arg(value_enum)]
    kind: Kind,
}

/// Declares [`Kind`] with a variant for each command, and the schema of each.
macro_rules! kinds {
    ($($variant:ident: $command:literal => $report:ty;)*) => {
        #[derive(Debug, Clone, Copy, clap::ValueEnum)]
        enum Kind {
            /// Scene files of `cumulo render`
            Scene,
            /// Documents of commands that failed
            Error,
            $(#[doc = concat!("Documents of `cumulo ", $command, " --json`")] $variant,)*
        }

        impl Kind {
            fn schema(self) -> JsonSchema {
                match self {
                    Self::Scene => scene_file::schema(),
                    Self::Error => document::schema_of_failures("cumulo --json, failed"),
                    $(Self::$variant => document::schema::<$report>(concat!("cumulo ", $command, " --json")),)*
                }
            }
        }

        /// Words of the commands that have a schema.
        #[cfg(test)]
        const COMMANDS: &[&str] = &[$($command),*];
    };
}

kinds! {
    CaptureConvert: "capture convert" => app::capture::CaptureReport;
    CaptureNew: "capture new" => app::capture::NewCaptureReport;
    Compare: "compare" => app::compare::CompareReport;
    Convert: "convert" => app::convert::ConvertReport;
    Denoise: "denoise" => Told<app::denoise::DenoiseReport>;
    Diff: "diff" => app::diff::DiffReport;
    Figure: "figure" => app::figure::FigureReport;
    Gradient: "gradient" => app::gradient::GradientReport;
    Info: "info" => app::info::InfoReport;
    Man: "man" => man::Report;
    Merge: "merge" => app::render::MergeReport;
    Motion: "motion" => app::motion::MotionReport;
    Plan: "plan" => app::plan::PlanReport;
    Pose: "pose" => app::pose::PoseReport;
    ReconstructColor: "reconstruct color" => Told<app::run::Run>;
    ReconstructDensity: "reconstruct density" => Told<app::run::Run>;
    ReconstructTf: "reconstruct tf" => Told<app::reconstruct::TransferRun>;
    Render: "render" => Told<app::render::RenderReport>;
    Report: "report" => app::report::PageReport;
    Selftest: "selftest" => app::selftest::SelftestReport;
    StudyDenoise: "study denoise" => app::study::StudyReport;
    StudyGradient: "study gradient" => app::study::StudyReport;
    StudyReconstruct: "study reconstruct" => app::study::StudyReport;
    StudyRender: "study render" => app::study::StudyReport;
    Transfer: "transfer" => app::function::FunctionReport;
    UsdAuthor: "usd author" => app::usd::author::AuthorReport;
    UsdLint: "usd lint" => app::usd::lint::LintReport;
    Validate: "validate" => app::validate::ValidateReport;
    View: "view" => app::view::ViewReport;
    Viewpoint: "viewpoint" => app::viewpoint::ViewpointReport;
}

impl Run for Schema {
    fn run(&self, output: &Output) -> Result<u8> {
        let text = serde_json::to_string_pretty(&self.kind.schema()).map_err(|e| Error::invalid(e.to_string()))?;
        output.plain(&text)?;
        Ok(0)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use clap::{CommandFactory, ValueEnum};

    /// A command that reports has a schema, under its words with dashes between them.
    #[test]
    fn every_command_with_a_report_has_a_schema() {
        let mut found = Vec::new();
        let mut left = vec![(String::new(), crate::cli::Arguments::command())];
        while let Some((path, command)) = left.pop() {
            let subs = command.get_subcommands().filter(|sub| !sub.is_hide_set() && sub.get_name() != "help");
            let below: Vec<_> =
                subs.map(|sub| (format!("{path} {}", sub.get_name()).trim().to_owned(), sub.clone())).collect();
            match below.is_empty() {
                true => found.push(path),
                false => left.extend(below),
            }
        }
        // What these print has a form of its own.
        found.retain(|path| !["completions", "schema"].contains(&path.as_str()));
        found.sort();
        assert_eq!(found, COMMANDS);
        for (kind, command) in Kind::value_variants()[2..].iter().zip(COMMANDS) {
            assert_eq!(kind.to_possible_value().unwrap().get_name(), command.replace(' ', "-"));
        }
    }
}
