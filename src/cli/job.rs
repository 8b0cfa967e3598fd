//! `--openjd`: a job that does the work of a command on several hosts.

use super::output::Output;
use super::parse;
use super::run::{Run, told};
use crate::app::UseCase;
use crate::app::job::{Argument, CommandLine, Divisible, JobReport, JobSettings, Piece, Value};
use crate::error::{Error, Result};
use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};
use std::any::TypeId;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

// No doc comment: it would be the description of each command that has these options.
#[derive(Debug, clap::Args)]
struct JobArgs {
    /// Write a job bundle of Open Job Description, which AWS Deadline Cloud and `openjd run` run, in place of the work:
    /// its tasks do parts of it, each with --resume. --overwrite replaces another bundle
    #[arg(long, value_name = "DIR")]
    openjd: Option<PathBuf>,
    /// Frames, views or replicates of a task at first (default: as many as the planner expects to take
    /// --openjd-seconds)
    #[arg(
        long,
        value_name = "N",
        requires = "openjd",
        value_parser = clap::value_parser!(u32).range(1..=100_000),
    )]
    openjd_chunk: Option<u32>,
    /// Seconds that a task is to take: a scheduler may change the size of the chunks by it
    #[arg(
        long,
        value_name = "S",
        requires = "openjd",
        default_value_t = JobSettings::default().seconds,
        value_parser = clap::value_parser!(u32).range(1..=1_000_000),
    )]
    openjd_seconds: u32,
    /// Compare what the job makes with this picture, sequence or folder of pictures, by a last step that fails if they
    /// differ
    #[arg(long, value_name = "B", requires = "openjd")]
    openjd_reference: Option<PathBuf>,
    /// Largest absolute difference from --openjd-reference that still counts as agreement
    #[arg(
        long,
        value_name = "T",
        requires = "openjd_reference",
        default_value_t = JobSettings::default().tolerance,
        value_parser = parse::not_negative,
    )]
    openjd_tolerance: f64,
}

/// Use case, and the job that is to do its work if one is asked for.
#[derive(Debug)]
pub(crate) struct OrJob<S> {
    settings: S,
    job: Option<Job>,
}

/// Job that was asked for.
#[derive(Debug)]
struct Job {
    settings: JobSettings,
    arguments: Vec<Argument>,
}

/// Report of a use case, or of a job.
#[derive(schemars::JsonSchema)]
#[serde(untagged)]
#[allow(dead_code, reason = "it describes documents, and none is made of it")]
pub(super) enum Told<R> {
    Report(R),
    Job(JobReport),
}

impl<S: UseCase + Divisible> Run for OrJob<S> {
    fn max_memory(&self) -> Result<u64> {
        self.settings.max_memory()
    }

    /// A job is no work that would need it.
    fn widen(&mut self, room: u64) {
        if self.job.is_none() {
            self.settings.widen(room);
        }
    }

    fn run(&self, output: &Output) -> Result<u8> {
        let Some(Job { settings, arguments }) = &self.job else { return Run::run(&self.settings, output) };
        let line = CommandLine { command: output.command().to_owned(), arguments: arguments.clone() };
        told(&settings.run(&line, &self.settings, output)?, output)
    }
}

impl<S: Args> FromArgMatches for OrJob<S> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        Self::from_arg_matches_mut(&mut matches.clone())
    }

    fn from_arg_matches_mut(matches: &mut ArgMatches) -> Result<Self, clap::Error> {
        let JobArgs { openjd, openjd_chunk, openjd_seconds, openjd_reference, openjd_tolerance } =
            JobArgs::from_arg_matches(matches)?;
        let shown = S::augment_args(Command::new("cumulo"));
        let overwrite = matches.try_get_one::<bool>("overwrite").ok().flatten() == Some(&true);
        let job = openjd.map(|output| {
            let settings = JobSettings {
                output,
                overwrite,
                chunk: openjd_chunk,
                seconds: openjd_seconds,
                reference: openjd_reference,
                tolerance: openjd_tolerance,
            };
            let usage = |e: Error| clap::Error::raw(ErrorKind::InvalidUtf8, format!("{e}\n"));
            arguments(&shown, matches).map(|arguments| Job { settings, arguments }).map_err(usage)
        });
        let job = job.transpose()?;
        Ok(Self { settings: S::from_arg_matches_mut(matches)?, job })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl<S: Args> Args for OrJob<S> {
    fn augment_args(command: Command) -> Command {
        JobArgs::augment_args(S::augment_args(command))
    }

    fn augment_args_for_update(command: Command) -> Command {
        JobArgs::augment_args_for_update(S::augment_args_for_update(command))
    }
}

/// Returns the arguments of a command that were given, but for those that make the job: those without a name first.
fn arguments(command: &Command, matches: &ArgMatches) -> Result<Vec<Argument>> {
    let given = |arg: &&Arg| {
        let id = arg.get_id().as_str();
        id != "overwrite" && matches.value_source(id) == Some(ValueSource::CommandLine)
    };
    let (placed, named): (Vec<&Arg>, Vec<&Arg>) =
        command.get_arguments().filter(given).partition(|arg| arg.is_positional());
    placed.into_iter().chain(named).map(|arg| argument(arg, matches)).collect()
}

fn argument(arg: &Arg, matches: &ArgMatches) -> Result<Argument> {
    let setting = arg.get_id().as_str().to_owned();
    let option = arg.get_long().map(str::to_owned);
    let mut values = Vec::new();
    if arg.get_action().takes_values() {
        for text in matches.get_raw_occurrences(&setting).into_iter().flatten().flatten() {
            values.push(value(arg, text)?);
        }
    }
    Ok(Argument { setting, option, values })
}

/// Returns a value with the paths in it.
fn value(arg: &Arg, text: &OsStr) -> Result<Value> {
    let id = arg.get_id().as_str();
    if arg.get_value_parser().type_id() == TypeId::of::<PathBuf>() {
        // Options that write name their files so.
        let named = arg.get_value_names().is_some_and(|names| names.iter().any(|name| name.contains("OUT.json")));
        let is_output = ["output", "report"].contains(&id) || named;
        let path = PathBuf::from(text);
        return Ok(vec![if is_output { Piece::Output(path) } else { Piece::Input(path) }]);
    }
    let text = text.to_str().ok_or_else(|| Error::invalid("a job holds words of Unicode characters alone"))?;
    let plain = |text: &str| Piece::Text(text.to_owned());
    Ok(match (id, text.split_once(':')) {
        ("motion", Some(("files", path))) => vec![plain("files:"), Piece::Input(path.into())],
        ("motion", Some(("vdb", paths))) => match paths.rsplit_once(',') {
            Some((volume, cameras)) => {
                vec![plain("vdb:"), Piece::Input(volume.into()), plain(","), Piece::Input(cameras.into())]
            }
            None => vec![plain(text)],
        },
        _ if parse::number(text).is_err() && Path::new(text).is_file() => vec![Piece::Input(text.into())],
        _ => vec![plain(text)],
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::app::render::RenderSettings;

    #[test]
    fn arguments_are_those_that_were_given() {
        let words =
            "render smoke.vdb --views 4 -o out --png --aov variance,samples --samples 2 --albedo 0.9 --openjd job";
        let command = OrJob::<RenderSettings>::augment_args(Command::new("render"));
        let matches = command.try_get_matches_from(words.split(' ')).unwrap();
        let job = OrJob::<RenderSettings>::from_arg_matches(&matches).unwrap().job.unwrap();
        let told = |argument: &Argument| format!("{:?} {}", argument.option, argument.values.len());
        let told: Vec<String> = job.arguments.iter().map(told).collect();
        assert_eq!(told[0], "None 1");
        assert!(
            told.contains(&"Some(\"png\") 0".to_owned()) && told.contains(&"Some(\"aov\") 2".to_owned()),
            "{told:?}"
        );
        assert_eq!(job.arguments[0].values, [[Piece::Input("smoke.vdb".into())]]);
        assert!(!told.iter().any(|told| told.contains("openjd")));
    }
}
