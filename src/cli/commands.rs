//! The commands, one row each. A new command is a use case, a module that reads its settings from a command line, and a
//! row here: it is then read, run, described in help and manual, and its documents have a schema.

use super::completions::Completions;
use super::document;
use super::job::{OrJob, Told};
use super::man::{self, ManCommand};
use super::run::Run;
use super::schema::Schema;
use super::try_grid::TryGrid;
use super::view::View;
use crate::app::UseCase;
use crate::app::capture::{CaptureSettings, NewCaptureSettings};
use crate::app::compare::CompareSettings;
use crate::app::convert::ConvertSettings;
use crate::app::denoise::DenoiseSettings;
use crate::app::diff::DiffSettings;
use crate::app::figure::FigureSettings;
use crate::app::function::FunctionSettings;
use crate::app::gradient::GradientSettings;
use crate::app::info::InfoSettings;
use crate::app::job::Divisible;
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
use crate::app::view::ViewReport;
use crate::app::viewpoint::ViewpointSettings;
use crate::formats::vdb::helper::SUBCOMMAND;
use clap::{ArgMatches, Args, Command};
use schemars::{JsonSchema, Schema as DocumentSchema};

/// Words of commands, such as `reconstruct density`, and examples of them.
type Texts = &'static [&'static str];

/// A command, or a group of commands.
pub(super) struct Row {
    /// Words of the command, such as `reconstruct density`.
    pub words: &'static str,
    /// Another spelling of its last word.
    alias: Option<&'static str>,
    /// Examples at the end of its help.
    pub examples: Texts,
    /// Schema of its documents, by their title; none if what it prints has a form of its own.
    pub schema: Option<fn(&str) -> DocumentSchema>,
    /// Adds its description, arguments and options.
    described: fn(Command) -> Command,
    /// Short and long description of a group.
    about: Option<[&'static str; 2]>,
    /// Reads what there is to run.
    read: fn(&mut ArgMatches) -> Result<Box<dyn Run>, clap::Error>,
}

impl Row {
    /// A command that prints a text.
    const fn plain<C: Args + Run + 'static>(words: &'static str, examples: Texts) -> Self {
        let read = |matches: &mut ArgMatches| Ok(Box::new(C::from_arg_matches_mut(matches)?) as Box<dyn Run>);
        Self { words, alias: None, examples, schema: None, described: C::augment_args, about: None, read }
    }

    /// A command that prints a report.
    const fn reports<C: Args + Run + 'static, R: JsonSchema>(words: &'static str, examples: Texts) -> Self {
        Self { schema: Some(document::schema::<R>), ..Self::plain::<C>(words, examples) }
    }

    /// A use case.
    const fn use_case<S: Args + UseCase + 'static>(words: &'static str, examples: Texts) -> Self {
        Self::reports::<S, S::Report>(words, examples)
    }

    /// A use case whose work a job may do.
    const fn or_job<S: Args + UseCase + Divisible + 'static>(words: &'static str, examples: Texts) -> Self {
        Self::reports::<OrJob<S>, Told<S::Report>>(words, examples)
    }

    /// A group of commands, which is nothing to run.
    const fn group(words: &'static str, about: [&'static str; 2]) -> Self {
        let read = |_: &mut ArgMatches| Err(clap::Error::new(clap::error::ErrorKind::MissingSubcommand));
        Self { words, alias: None, examples: &[], schema: None, described: |command| command, about: Some(about), read }
    }

    /// Returns the command, with those of its group.
    fn command(&self) -> Command {
        let name = self.words.rsplit(' ').next().unwrap_or_default();
        let command = (self.described)(Command::new(name)).hide(name == SUBCOMMAND).aliases(self.alias);
        let Some([short, long]) = self.about else { return command };
        let command = command.about(short).subcommand_required(true).arg_required_else_help(true);
        let command = if long.is_empty() { command } else { command.long_about(format!("{short}\n\n{long}")) };
        command.subcommands(below(&format!("{} ", self.words)))
    }
}

/// Returns the commands whose words begin so, and have one word more.
fn below(start: &str) -> impl Iterator<Item = Command> {
    COMMANDS
        .iter()
        .filter(move |row| row.words.strip_prefix(start).is_some_and(|rest| !rest.contains(' ')))
        .map(Row::command)
}

/// Returns all commands, those of groups within these.
pub(super) fn all() -> impl Iterator<Item = Command> {
    below("")
}

/// Reads the command that was given, and returns its words, too.
///
/// # Errors
/// If its values do not fit.
pub(super) fn read(matches: &mut ArgMatches) -> Result<(String, Box<dyn Run>), clap::Error> {
    let (mut words, mut at) = (String::new(), matches.remove_subcommand());
    let missing = || clap::Error::new(clap::error::ErrorKind::MissingSubcommand);
    loop {
        let (name, mut matches) = at.ok_or_else(missing)?;
        words = format!("{words} {name}").trim_start().to_owned();
        match matches.remove_subcommand() {
            Some(below) => at = Some(below),
            None => {
                let row = COMMANDS.iter().find(|row| row.words == words).ok_or_else(missing)?;
                return Ok((words, (row.read)(&mut matches)?));
            }
        }
    }
}

/// Examples of the program.
pub(super) const EXAMPLES: Texts = &[
    "cumulo info smoke.vdb                                  # what is in a file",
    "cumulo render smoke.vdb --views 16 --density-scale auto -o shots",
    "cumulo reconstruct density shots -o found.vdb          # a volume from pictures",
    "cumulo diff smoke.vdb found.vdb                        # exit code 1 if they differ",
];

/// All commands, in the order of their list.
pub(super) static COMMANDS: &[Row] = &[
    Row::group("capture", ["Take over captures of other programs, or place cameras", ""]),
    Row::use_case::<CaptureSettings>(
        "capture convert",
        &[
            "cumulo capture convert nerfstudio.json -o flat         # without lens distortion",
            "cumulo capture convert flat -o model --to colmap",
            "cumulo capture convert stage.usda --pictures 'shot/view_%03d.exr' -o capture",
        ],
    ),
    Row::use_case::<NewCaptureSettings>(
        "capture new",
        &[
            "cumulo capture new smoke.vdb --views 24 --layout ring -o turn.json",
            "cumulo render smoke.vdb --cameras turn.json --frames 1-24 --camera-offset=-1 -o frames",
        ],
    ),
    Row::use_case::<CompareSettings>(
        "compare",
        &[
            "cumulo compare render.exr reference.exr --tolerance 0.01",
            "cumulo compare render.exr reference.exr --heatmap difference.png --flip",
            "cumulo compare 'a/frame.####.exr' 'b/frame.####.exr' --frames 1-24 --report page",
            "cumulo compare --statistical noisy.exr reference.exr   # does only the noise differ?",
        ],
    ),
    Row::plain::<Completions>(
        "completions",
        &["cumulo completions bash > ~/.local/share/bash-completion/completions/cumulo"],
    ),
    Row::use_case::<InfoSettings>(
        "info",
        &["cumulo info smoke.vdb shots view.exr", "cumulo info 'smoke.####.vdb' --frames 1-24 --json"],
    ),
    Row::reports::<ManCommand, man::Report>("man", &["cumulo man render", "cumulo man -o ~/.local/share/man/man1"]),
    Row::use_case::<MergeSettings>(
        "merge",
        &[
            "cumulo merge part-0.exr part-1.exr -o whole.exr",
            "cumulo merge farm/part-*.exr --confidence 0.99 -o whole.exr",
        ],
    ),
    Row::use_case::<MotionSettings>(
        "motion",
        &["cumulo motion smoke.vdb --cameras path --frames 0-23 -o 'motion/frame.%04d.exr'"],
    ),
    Row::use_case::<PlanSettings>(
        "plan",
        &[
            "cumulo plan smoke.vdb --density-scale auto --albedo 0.9 --sun 1,1,2",
            "cumulo plan smoke.vdb --albedo 0.9 --max-omitted 0.1 --json",
            "cumulo plan shots --resolution 256 --machines 1,4,16",
        ],
    ),
    Row::use_case::<ValidateSettings>(
        "validate",
        &[
            "cumulo validate smoke.vdb view.exr shots",
            "cumulo validate 'smoke.####.vdb' --json                # missing frames and outliers, too",
        ],
    ),
    Row::use_case::<ConvertSettings>(
        "convert",
        &[
            "cumulo convert smoke.vdb small.vdb --half --grid density",
            "cumulo convert 'in.####.vdb' 'out.####.vdb' --frames 1-24 --repair",
            "cumulo convert smoke.vdb heat.vdb both.vdb             # the grids of both files",
            "cumulo convert smoke.vdb smoke.npy                     # array[x, y, z]",
            "cumulo convert smoke.npy smoke.vdb --voxel-size 0.1",
            "cumulo convert head.nii.gz head.vdb --map -1024,3071",
            "cumulo convert maya.vdb blender.vdb --names blender --up z   # Houdini's: Blender's import turns them",
        ],
    ),
    Row::or_job::<DenoiseSettings>(
        "denoise",
        &[
            "cumulo denoise 'noisy/frame.%04d.exr' -o 'quiet/frame.%04d.exr'",
            "cumulo denoise noisy.exr -o quiet.exr",
            "cumulo denoise 'noisy.####.exr' -o 'quiet.####.exr' --motion 'files:motion.####.exr'",
        ],
    ),
    Row::use_case::<DiffSettings>(
        "diff",
        &[
            "cumulo diff smoke.vdb found.vdb --tolerance 1e-4",
            "cumulo diff 'a.####.vdb' 'b.####.vdb' --frames 1-24 --json",
        ],
    ),
    Row::use_case::<FigureSettings>(
        "figure",
        &[
            "cumulo figure bone.png -o figure.svg --title 'Skull' --tf ct-bone --legend-label Density --unit HU",
            "cumulo figure a.exr b.exr c.exr -o figure.pdf --label A,B,C --scale-bar --length-unit mm --width 180mm",
            "cumulo figure head.exr -o head.png --orientation anatomical --scale-bar=50 --width 1200px",
        ],
    ),
    Row::use_case::<PoseSettings>(
        "pose",
        &[
            "cumulo pose shots --volume smoke.vdb -o posed.json",
            "cumulo pose shots --volume smoke.vdb -o refined.json --solve-focal --init posed.json",
        ],
    ),
    Row::use_case::<GradientSettings>(
        "gradient",
        &[
            "cumulo gradient smoke.vdb --wrt density --loss l2 --target shots -o slopes.vdb",
            "cumulo gradient smoke.vdb --wrt camera --loss mean --views 1 --check",
        ],
    ),
    Row::or_job::<RenderSettings>(
        "render",
        &[
            "cumulo render smoke.vdb --views 16 --density-scale auto -o shots",
            "cumulo render smoke.vdb --views 1 --albedo 0.9 --sun 1,1,2 --sky 0.1 --samples 64 -o lit",
            "cumulo render 'smoke.####.vdb' --frames 1-24 --views 1 --density-scale auto -o frames",
            "cumulo render smoke.vdb --frames 0-47 --orbit 48 --density-scale auto -o turntable",
            "cumulo render 'smoke.####.vdb' --frames 1-24 --views 1 -o frames --openjd job       # a job for a farm",
            "cumulo render found.vdb --cameras shots -o again",
            "cumulo render ct.vdb --tf ct-bone --tf-range 0,1 --from anterior,left -o bone",
        ],
    ),
    Row::group("reconstruct", ["Reconstruct from multi-view pictures", ""]),
    Row::or_job::<DensitySettings>(
        "reconstruct density",
        &[
            "cumulo reconstruct density shots -o found.vdb --report page",
            "cumulo reconstruct density scans --tf bone.tf.json -o densities.vdb",
        ],
    ),
    Row {
        alias: Some("colour"),
        ..Row::or_job::<ColorSettings>(
            "reconstruct color",
            &[
                "cumulo reconstruct color scans -o shaded.vdb",
                "cumulo reconstruct color scans -o shaded.vdb --report page",
            ],
        )
    },
    Row::or_job::<TransferFunctionSettings>(
        "reconstruct tf",
        &["cumulo reconstruct tf scans --volume head.vdb -o found.tf.json"],
    ),
    Row::use_case::<PageSettings>("report", &["cumulo report page --reference smoke.vdb"]),
    Row::plain::<Schema>("schema", &["cumulo schema scene", "cumulo schema diff > diff.schema.json"]),
    Row::use_case::<SelftestSettings>(
        "selftest",
        &["cumulo selftest", "cumulo selftest dvr thin-free-paths       # an area and a case"],
    ),
    Row::group(
        "study",
        [
            "Measure the error of settings against their time, on your own inputs, and recommend one",
            "The reference is converged by Cumulo itself and has an uncertainty of its own. The folder of the page \
             gets a table (study.csv), a record (study.json) and the reference, too.",
        ],
    ),
    Row::use_case::<DenoiseStudySettings>(
        "study denoise",
        &[
            "cumulo study denoise 'noisy.####.exr' --reference 'true.####.exr' -o page",
            "cumulo study denoise 'few.####.exr' 'many.####.exr' --reference 'true.####.exr' --knobs method -o page",
        ],
    ),
    Row::use_case::<GradientStudySettings>(
        "study gradient",
        &[
            "cumulo study gradient smoke.vdb --density-scale 4 -o page",
            "cumulo study gradient smoke.vdb --loss l2 --target shots --knobs quadrature,step -o page",
        ],
    ),
    Row::use_case::<ReconstructStudySettings>(
        "study reconstruct",
        &[
            "cumulo study reconstruct shots -o page",
            "cumulo study reconstruct shots --knobs noise,iterations --resolution 32 -o page",
        ],
    ),
    Row::use_case::<RenderStudySettings>(
        "study render",
        &[
            "cumulo study render smoke.vdb --density-scale auto -o page",
            "cumulo study render smoke.vdb --albedo 0.9 --sun 1,1,2 --knobs samples --wanted-error 0.05 -o page",
        ],
    ),
    Row::use_case::<FunctionSettings>(
        "transfer",
        &[
            "cumulo transfer preset.json -o warm.tf.json",
            "cumulo transfer preset.json --range 0,0.5 -o thin.tf.json",
            "cumulo transfer --suggest head.nii.gz --sheet sheet.png -o head.tf.json",
            "cumulo transfer --list                                 # color maps and presets by name",
        ],
    ),
    Row::group("usd", ["Write and check USD stages", ""]),
    Row::use_case::<AuthorSettings>(
        "usd author",
        &[
            "cumulo usd author smoke.vdb -o smoke.usda",
            "cumulo usd author 'smoke.%04d.vdb' --albedo 0.9 --sun=-1,0.6,0.7 -o smoke.usda",
        ],
    ),
    Row::use_case::<LintSettings>(
        "usd lint",
        &["cumulo usd lint smoke.usda", "cumulo usd lint broken.usda --fix fixed.usda"],
    ),
    Row::reports::<View, ViewReport>(
        "view",
        &[
            "cumulo view smoke.vdb                                  # in the terminal",
            "cumulo view 'smoke.####.vdb' -o frames.png",
            "cumulo view shots view.exr -o sheets",
        ],
    ),
    Row::use_case::<ViewpointSettings>("viewpoint", &["cumulo viewpoint smoke.vdb --density-scale auto -o best.json"]),
    Row::plain::<TryGrid>(SUBCOMMAND, &[]),
];

#[cfg(test)]
mod tests {
    use super::*;

    /// A command prints documents, which have a schema, but for those that print a text; and none is there twice.
    #[test]
    fn commands_print_documents() {
        let of = |is: &dyn Fn(&Row) -> bool| -> Vec<&str> {
            COMMANDS.iter().filter(|row| is(row)).map(|row| row.words).collect()
        };
        let texts = of(&|row| row.schema.is_none() && row.about.is_none());
        assert_eq!(texts, ["completions", "schema", SUBCOMMAND]);
        let mut all = of(&|_| true);
        all.sort_unstable();
        assert!(all.is_sorted_by(|a, b| a < b), "{all:?}");
    }
}
