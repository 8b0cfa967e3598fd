//! The command line: each subcommand loads, works, writes and reports.

mod args;
mod cancel;
mod capture;
mod commands;
mod compare;
mod completions;
mod convert;
mod denoise;
mod diff;
mod document;
pub mod embedded;
mod figure;
mod flags;
mod gradient;
mod help;
mod info;
mod job;
mod log;
mod man;
mod memory;
mod merge;
mod motion;
mod openjd;
mod output;
mod parse;
mod plan;
mod pose;
mod progress;
mod reconstruct;
mod render;
mod report;
mod run;
mod schema;
mod selftest;
mod study;
mod transfer;
mod try_grid;
mod usd;
mod validate;
mod values;
mod version;
mod view;
mod viewpoint;

use crate::error::{Code, Error, Kind, Result};
use crate::formats::vdb::{self, helper};
use crate::process;
use crate::ranks;
use crate::scratch;
use crate::wording::speak_as;
use clap::error::ContextKind;
use clap::{Args, FromArgMatches};
use output::Output;
use run::Run;
use std::ffi::{OsStr, OsString};
use std::io::Write;
use std::path::PathBuf;

/// Words of a command line, read.
pub struct Arguments {
    command: Box<dyn Run>,
    global: Global,
    /// Words of the subcommand, such as `reconstruct density`.
    path: String,
}

/// Options that every subcommand takes.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Global {
    /// Print the result as JSON on standard output
    #[arg(long, global = true)]
    pub json: bool,
    /// Threads to work with, 1 to 1024 (default: RAYON_NUM_THREADS, else all cores); results do not depend on it
    #[arg(long, global = true, value_name = "N")]
    pub threads: Option<usize>,
    /// Folder on a local disk for large arrays that exceed the memory: the pages of them that are in use are in memory
    #[arg(long, global = true, value_name = "DIR")]
    pub scratch: Option<PathBuf>,
    /// No progress on standard error
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Form of the progress on standard error
    #[arg(long, global = true, value_enum, value_name = "FORM", default_value_t, conflicts_with = "quiet")]
    pub progress: progress::Form,
    /// Say on standard error how long each stage took, how many threads work, and what was planned
    #[arg(long, short, global = true, conflicts_with = "quiet")]
    pub verbose: bool,
}

/// Advice to those whose command needs more memory than is allowed.
const SMALLER: &str = "raise --max-memory, or give smaller inputs: fewer or smaller pictures, a volume that was \
                       cropped or resampled";

/// Adds to the advice on work that needs more memory that a scratch folder gives room.
fn larger(error: Error) -> Error {
    let memory = error.code() == Code::MemoryLimit;
    match error
        .remedy()
        .filter(|_| memory)
        .map(|remedy| format!("{remedy}; or let large arrays lie in files: --scratch DIR"))
    {
        Some(remedy) => error.instead(remedy),
        None => error,
    }
}

/// Environment variable of the number of threads, which `--threads` overrides.
const THREADS: &str = "RAYON_NUM_THREADS";
/// Largest number of threads; more are taken for a mistake, as each has a stack and accumulators of its own.
const MOST_THREADS: usize = 1024;

/// Returns the number of threads: that of `--threads`, else that of the environment, else none for all cores.
///
/// # Errors
/// If the option or the variable is no number from 1 to [`MOST_THREADS`].
fn threads(option: Option<usize>, variable: Option<&OsStr>) -> Result<Option<usize>> {
    let bounded = |n: &usize| (1..=MOST_THREADS).contains(n);
    match (option, variable) {
        (Some(n), _) if bounded(&n) => Ok(Some(n)),
        (Some(n), _) => Err(Error::invalid(format!("--threads {n}: a number from 1 to {MOST_THREADS} is expected"))
            .hint("leave it out to work on all cores")),
        (None, None) => Ok(None),
        (None, Some(text)) => {
            let n = text.to_str().and_then(|text| text.parse().ok()).filter(bounded);
            n.map(Some).ok_or_else(|| {
                let text = text.to_string_lossy();
                Error::invalid(format!("{THREADS} is '{text}': a number from 1 to {MOST_THREADS} is expected"))
                    .hint(format!("correct it, or `unset {THREADS}` to work on all cores; --threads outdoes it"))
            })
        }
    }
}

/// Returns the program's command: options that all commands take, and the commands.
pub fn parser() -> clap::Command {
    Global::augment_args(clap::Command::new("cumulo"))
        .about("Volumes between OpenVDB, Blender, USD and EXR: inspect, render, compare and reconstruct")
        .long_about(None)
        .subcommand_required(true)
        .arg_required_else_help(true)
        .propagate_version(true)
        .subcommands(commands::all())
}

/// Returns the words of the commands that print documents, and the schemas of these by their titles.
fn documents() -> impl Iterator<Item = (&'static str, fn(&str) -> schemars::Schema)> {
    commands::COMMANDS.iter().filter_map(|row| Some((row.words, row.schema?)))
}

/// Returns the program's command with its help arranged. Of an option that is given twice the last one counts, but for
/// lists.
fn command() -> clap::Command {
    help::arranged(parser()).version(version::text()).args_override_self(true)
}

impl Arguments {
    /// Reads the words of a command line, the program's name first.
    ///
    /// # Errors
    /// If they are none of the program's, or ask for its help or version.
    pub fn read(words: impl IntoIterator<Item = OsString>) -> Result<Self, clap::Error> {
        // Manual pages, which are made of the command as well, state no machine.
        let mut matches = command().long_version(version::long()).try_get_matches_from(words)?;
        let global = Global::from_arg_matches_mut(&mut matches)?;
        let (path, command) = commands::read(&mut matches)?;
        Ok(Self { command, global, path })
    }
}

/// Runs the program on the words of a command line, its own name first, and returns its exit code: 0 success, 1 a check
/// found something, 2 an error, and 128 with a signal's number, such as 130 of Ctrl-C, for work that was stopped.
/// Errors are printed, as JSON too with `--json`. `commit` is the one that the program was built from, and its date,
/// if the build knew them.
pub fn main(words: Vec<OsString>, commit: Option<&str>) -> u8 {
    version::of_commit(commit);
    speak_as(flags::option);
    let json = words.iter().take_while(|word| *word != "--").any(|word| word == "--json");
    let arguments = match Arguments::read(words.clone()) {
        Ok(arguments) => arguments,
        Err(usage) => return refused(usage, json.then(|| named_by(&words))),
    };
    match run(arguments) {
        Ok(code) => code,
        Err(error) => {
            document::error(&error);
            progress::tell(&error);
            if error.kind() == Kind::Cancelled { cancel::code() } else { 2 }
        }
    }
}

/// Returns the words of the subcommand that a command line names, as far as it names one. Options may stand before it.
fn named_by(words: &[OsString]) -> String {
    let (mut at, mut names) = (command(), Vec::new());
    // The options of all commands are those of subcommands, too.
    at.build();
    let mut words = words.iter().skip(1).filter_map(|word| word.to_str());
    while let Some(word) = words.next() {
        if word.starts_with('-') {
            if takes_value(&at, word) {
                words.next();
            }
            continue;
        }
        let Some(sub) = at.find_subcommand(word).cloned() else { break };
        names.push(sub.get_name().to_owned());
        at = sub;
    }
    names.join(" ")
}

/// Returns true if a word is an option of a command whose value is the next word.
fn takes_value(command: &clap::Command, word: &str) -> bool {
    let named = |arg: &&clap::Arg| word.strip_prefix("--").is_some_and(|long| arg.get_long() == Some(long));
    command.get_arguments().find(named).is_some_and(|arg| arg.get_action().takes_values())
}

/// Prints what a command line that could not be read is told: its mistake, or the help that it asked for. The mistake
/// is a document of `command`, too, if there is one.
fn refused(mut usage: clap::Error, command: Option<String>) -> u8 {
    // The list has commands that are hidden from people.
    usage.remove(ContextKind::ValidSubcommand);
    let printed = usage.print();
    if !usage.use_stderr() {
        return match printed {
            Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
                let _ = writeln!(std::io::stderr(), "cumulo: {}", Error::io("standard output", error));
                2
            }
            _ => 0,
        };
    }
    if let Some(command) = command {
        document::begin(&command);
        let mistake = Error::invalid(mistake(&usage.render().to_string())).coded(Code::Usage);
        document::error(&mistake.hint(SEE_HELP));
    }
    2
}

/// Advice to those whose command line could not be read.
const SEE_HELP: &str = "cumulo --help, or --help behind a command, lists what can be given";

/// Returns the mistake that a usage message names, in a line: its first paragraph, which lists what is missing or
/// possible.
fn mistake(text: &str) -> String {
    let lines: Vec<&str> = text.lines().map(str::trim).take_while(|line| !line.is_empty()).collect();
    lines.join(" ").trim_start_matches("error: ").to_owned()
}

/// Returns the path by which this program is started once more. Where a loader runs it with the libraries beside it,
/// the file of the process is the loader, and the launcher's absolute path is the program's own word; so it is where
/// `/proc` is missing.
fn own_program(process: Option<PathBuf>, word: Option<OsString>) -> Option<PathBuf> {
    let loader = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("ld-"));
    let launcher = word.map(PathBuf::from).filter(|path| path.is_absolute());
    process.filter(|path| !loader(path)).or(launcher)
}

/// Runs the command line.
///
/// # Errors
/// Those of the subcommand; the caller prints them and exits with 2.
fn run(mut arguments: Arguments) -> Result<u8> {
    if arguments.global.json {
        document::begin(&arguments.path);
        process::on_end(document::error);
    }
    // Processes that wait for one another end together: none stops by itself.
    if ranks::is_alone() {
        cancel::install()?;
    }
    // 0 stands for all cores. Threads, libraries and the helper's name come before the limit of memory, which holds for
    // what the command does.
    let count = threads(arguments.global.threads, std::env::var_os(THREADS).as_deref())?.unwrap_or(0);
    rayon::ThreadPoolBuilder::new().num_threads(count).build_global().map_err(|e| {
        Error::invalid(format!("the threads cannot be started: {e}"))
            .hint("give fewer to --threads, or raise the limit on processes (ulimit -u)")
    })?;
    if let Some(program) = own_program(std::env::current_exe().ok(), std::env::args_os().next()) {
        helper::set_program(program);
    }
    vdb::on_terminate(process::abandon);
    let command = &mut arguments.command;
    let memory = command.max_memory()?;
    process::limit_memory(memory, SMALLER);
    let output = Output::new(&arguments.global, &arguments.path);
    let (version, threads) = (version::text(), rayon::current_num_threads());
    output.detail(format!("cumulo {version}: {threads} threads, {} of memory at most", crate::text::bytes(memory)));
    let Some(folder) = &arguments.global.scratch else {
        let first = arguments.path.split(' ').next().unwrap_or_default();
        // What others need is in trees of OpenVDB and in pictures, which no scratch folder holds.
        let helps = ["render", "reconstruct"].contains(&first);
        return command.run(&output).map_err(|error| if helps { larger(error) } else { error });
    };
    let room = scratch::begin(folder, memory)?;
    output.detail(format!("room for {} of arrays in {}", crate::text::bytes(room), folder.display()));
    command.widen(room);
    command.run(&output)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_named_whatever_stands_before_them() {
        let named = |line: &str| named_by(&line.split(' ').map(OsString::from).collect::<Vec<_>>());
        assert_eq!(named("cumulo info --bad"), "info");
        assert_eq!(named("cumulo --threads 4 --json reconstruct -q density --bad"), "reconstruct density");
        assert_eq!(named("cumulo --threads=4 info"), "info");
        assert_eq!((named("cumulo --json"), named("cumulo nonsense info")), (String::new(), String::new()));
    }

    #[test]
    fn a_program_behind_a_loader_is_started_by_its_launcher() {
        let own = |process: Option<&str>, word: &str| own_program(process.map(PathBuf::from), Some(word.into()));
        assert_eq!(own(Some("/usr/bin/cumulo"), "cumulo"), Some("/usr/bin/cumulo".into()));
        let launcher = Some("/opt/cumulo/bin/cumulo".into());
        assert_eq!(own(Some("/opt/lib/ld-linux-x86-64.so.2"), "/opt/cumulo/bin/cumulo"), launcher);
        assert_eq!(own(None, "/opt/cumulo/bin/cumulo"), launcher);
        assert_eq!(own(None, "cumulo"), None);
    }

    /// Words of a script's defaults are often followed by those that its user gives.
    #[test]
    fn of_an_option_given_twice_the_last_one_counts() {
        fn check(command: &clap::Command, path: &[&str], seen: &mut usize) {
            for arg in command.get_arguments().filter(|arg| !matches!(arg.get_action(), clap::ArgAction::Append)) {
                let Some(long) = arg.get_long().filter(|long| !["help", "version"].contains(long)) else { continue };
                let word = if arg.get_action().takes_values() { format!("--{long}=1") } else { format!("--{long}") };
                let words = path.iter().copied().chain([word.as_str(), word.as_str()]);
                // Values are texts here: what they may be is not what is asked.
                let error = texts(super::command()).try_get_matches_from(words).err().map(|e| e.to_string());
                let twice = error.filter(|error| error.contains("multiple times"));
                assert_eq!(twice, None, "{path:?} --{long}");
                *seen += 1;
            }
            for sub in command.get_subcommands().filter(|sub| sub.get_name() != "help") {
                check(sub, &[path, &[sub.get_name()]].concat(), seen);
            }
        }
        /// Lets every option take any text.
        fn texts(command: clap::Command) -> clap::Command {
            let plain = |arg: clap::Arg| match arg.get_action().takes_values() {
                true => arg.value_parser(clap::builder::ValueParser::os_string()),
                false => arg,
            };
            command.mut_args(plain).mut_subcommands(texts)
        }
        let (mut all, mut seen) = (command(), 0);
        all.build();
        check(&all, &["cumulo"], &mut seen);
        assert!(seen > 300, "{seen} options");
        let words =
            "cumulo --threads 1 info a.vdb --threads 3 --threads 2 --json --json".split(' ').map(OsString::from);
        let global = Arguments::read(words).unwrap().global;
        assert_eq!((global.threads, global.json), (Some(2), true));
    }

    /// A script reads the document, and not the lines below the first one.
    #[test]
    fn mistakes_name_what_is_missing() {
        let told = |words: &[&str]| {
            let words = words.iter().map(OsString::from);
            mistake(&Arguments::read(words).err().unwrap().render().to_string())
        };
        let missing = told(&["cumulo", "reconstruct", "density"]);
        assert!(missing.contains("required") && missing.contains("--output <OUT.vdb> <CAPTURE>"), "{missing}");
        let wrong = told(&["cumulo", "view", "a.vdb", "--up", "w"]);
        assert!(wrong.starts_with("invalid value 'w'") && wrong.contains("possible values: auto, y, z"), "{wrong}");
    }

    #[test]
    fn threads_are_bounded_and_the_variable_is_not_ignored() {
        let env = |text: &'static str| threads(None, Some(OsStr::new(text)));
        assert_eq!(threads(Some(3), Some(OsStr::new("nonsense"))).unwrap(), Some(3));
        assert_eq!((threads(None, None).unwrap(), env("8").unwrap()), (None, Some(8)));
        for n in [0, 1025, usize::MAX] {
            let error = threads(Some(n), None).unwrap_err();
            assert!(error.what().contains("1 to 1024") && error.remedy().is_some(), "{error}");
        }
        for text in ["", "0", "-1", "abc", "2000", " 4", "1e2"] {
            let error = env(text).unwrap_err();
            assert!(error.what().contains("RAYON_NUM_THREADS") && error.remedy().is_some(), "{error}");
        }
    }
}
