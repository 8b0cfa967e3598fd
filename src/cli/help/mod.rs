//! Help of all commands: options under headings, and examples at the end.
//!
//! Both are kept in one place, since most options are shared by several commands: what an option is about does not
//! depend on the command that has it.

mod headings;

use super::commands::{COMMANDS, EXAMPLES};
use clap::Command;

/// Puts the options of a command and of its subcommands under headings, and examples behind them.
pub(crate) fn arranged(command: Command) -> Command {
    within(command, "")
}

/// Arranges a command that stands below `parent`, whose words end with a blank.
fn within(command: Command, parent: &str) -> Command {
    let heading = |arg: clap::Arg| match headings::of(arg.get_id().as_str()) {
        Some(heading) if !arg.is_positional() => arg.help_heading(heading),
        _ => arg,
    };
    let path = if command.get_name() == "cumulo" { String::new() } else { format!("{parent}{}", command.get_name()) };
    let own = command.get_after_help().map(|text| format!("{text}\n\n")).unwrap_or_default();
    let mut command = command.mut_args(heading);
    let row = COMMANDS.iter().find(|row| row.words == path);
    let lines = if path.is_empty() { EXAMPLES } else { row.map_or(&[][..], |row| row.examples) };
    if !lines.is_empty() {
        let list: String = lines.iter().map(|line| format!("\n  {line}")).collect();
        command = command.after_help(format!("{own}Examples:{list}"));
    }
    let below = if path.is_empty() { String::new() } else { format!("{path} ") };
    command.mut_subcommands(|sub| within(sub, &below))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// Visits all commands that do something, with their words.
    fn leaves(command: &Command, parent: &str, visit: &mut dyn FnMut(&Command, &str)) {
        for sub in command.get_subcommands().filter(|sub| !sub.is_hide_set() && sub.get_name() != "help") {
            let path = format!("{parent}{}", sub.get_name());
            if sub.has_subcommands() {
                leaves(sub, &format!("{path} "), visit);
            } else {
                visit(sub, &path);
            }
        }
    }

    #[test]
    fn every_command_has_examples_and_a_sentence_for_each_option() {
        let all = arranged(crate::cli::parser());
        let mut seen = 0;
        leaves(&all, "", &mut |command, path| {
            seen += 1;
            let after = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(after.contains(&format!("\n  cumulo {path}")), "{path}: no example of it in\n{after}");
            for arg in command.get_arguments().filter(|arg| !arg.is_hide_set()) {
                assert!(arg.get_help().is_some(), "{path}: {} has no help", arg.get_id());
            }
        });
        assert!(seen > 15, "{seen}");
    }

    /// Examples are commands of the program as it is.
    #[test]
    fn examples_can_be_parsed() {
        let all = arranged(crate::cli::parser());
        for line in COMMANDS.iter().flat_map(|row| row.examples).chain(EXAMPLES) {
            // A shell takes comments, quotes and redirections away.
            let line = line.split(" #").next().unwrap().split(" >").next().unwrap().replace('\'', "");
            let words = line.split_whitespace().filter(|word| *word != "\\");
            let parsed = all.clone().try_get_matches_from(words);
            assert!(parsed.is_ok(), "{line}: {}", parsed.unwrap_err());
        }
    }

    /// A long list without headings is not read.
    #[test]
    fn long_lists_of_options_have_headings() {
        let all = arranged(crate::cli::parser());
        leaves(&all, "", &mut |command, path| {
            let options: Vec<_> = command.get_arguments().filter(|arg| !arg.is_positional()).collect();
            let under = options.iter().filter(|arg| arg.get_help_heading().is_some()).count();
            assert!(options.len() < 6 || 5 * under >= 4 * options.len(), "{path}: {under} of {}", options.len());
        });
    }
}
