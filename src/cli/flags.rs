//! Settings as the options of the command line that they are.

use crate::wording::Mention;
use clap::Command;
use std::sync::OnceLock;

/// Returns the option that a setting is: `density_scale` is `--density-scale`, and `convert.crop` is `cumulo convert
/// --crop` in backticks; none for what is no option of any command.
pub(super) fn option(mention: Mention<'_>) -> Option<String> {
    static PROGRAM: OnceLock<Command> = OnceLock::new();
    let program = PROGRAM.get_or_init(|| {
        let mut program = super::command();
        // The options of all commands are those of subcommands, too.
        program.build();
        program
    });
    let long = mention.setting.replace('_', "-");
    let (command, words) = match mention.use_case {
        None => (None, String::new()),
        Some(case) => {
            let mut names = case.split('.').map(|name| name.replace('_', "-"));
            let command = names.try_fold(program, |at, name| at.find_subcommand(name))?;
            (Some(command), format!("cumulo {} ", case.replace('.', " ").replace('_', "-")))
        }
    };
    let arg = match command {
        Some(command) => own(command, &long)?,
        None => any(program, &long)?,
    };
    // A value such as -1024,3071 would look like an option.
    let joined = |value: &str| if arg.is_require_equals_set() || value.starts_with('-') { '=' } else { ' ' };
    let value = mention.value.map_or(String::new(), |value| format!("{}{value}", joined(value)));
    let text = format!("{words}--{long}{value}");
    Some(if words.is_empty() { text } else { format!("`{text}`") })
}

fn own<'c>(command: &'c Command, long: &str) -> Option<&'c clap::Arg> {
    command.get_arguments().find(|arg| arg.get_long() == Some(long))
}

/// Returns an option of a command or of one below it.
fn any<'c>(command: &'c Command, long: &str) -> Option<&'c clap::Arg> {
    own(command, long).or_else(|| command.get_subcommands().find_map(|below| any(below, long)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_options() {
        let option = |use_case, setting, value| option(Mention { use_case, setting, value });
        assert_eq!(option(None, "max_memory", None).as_deref(), Some("--max-memory"));
        assert_eq!(option(None, "background", Some("1,1,1")).as_deref(), Some("--background 1,1,1"));
        let map = option(Some("convert"), "map", Some("-1024,3071"));
        assert_eq!(map.as_deref(), Some("`cumulo convert --map=-1024,3071`"));
        assert_eq!(option(Some("convert"), "crop", None).as_deref(), Some("`cumulo convert --crop`"));
        assert_eq!(
            option(Some("convert"), "repair", Some("density")).as_deref(),
            Some("`cumulo convert --repair=density`")
        );
        let density = option(Some("reconstruct.density"), "held_out", Some("2"));
        assert_eq!(density.as_deref(), Some("`cumulo reconstruct density --held-out 2`"));
        assert_eq!([option(None, "nothing", None), option(Some("nothing"), "crop", None)], [None, None]);
    }

    /// Source files name settings in brackets of their own: each must be an option.
    #[test]
    fn every_setting_that_a_text_names_is_an_option() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
        let (mut unknown, mut known) = (Vec::new(), 0);
        for path in sources(&root).into_iter().filter(|path| !path.ends_with("wording.rs") && !path.ends_with(file!()))
        {
            let text = std::fs::read_to_string(&path).unwrap_or_default();
            // Inner products stand between such brackets, too.
            let named =
                |name: &&str| name.starts_with(|c: char| c.is_ascii_lowercase()) && !name.contains([' ', '"', '(']);
            for name in text.split('⟨').skip(1).filter_map(|rest| rest.split('⟩').next()).filter(named) {
                let (name, _) = name.split_once('=').unwrap_or((name, ""));
                let (use_case, setting) = name.rsplit_once('.').map_or((None, name), |(case, name)| (Some(case), name));
                match option(Mention { use_case, setting, value: None }) {
                    Some(_) => known += 1,
                    None => unknown.push(format!("{}: {name}", path.display())),
                }
            }
        }
        assert_eq!(unknown, Vec::<String>::new());
        assert!(known > 200, "{known}");
    }

    fn sources(folder: &std::path::Path) -> Vec<std::path::PathBuf> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let (folders, files): (Vec<_>, Vec<_>) = entries.partition(|path| path.is_dir());
        let rust = files.into_iter().filter(|path| path.extension().is_some_and(|e| e == "rs"));
        rust.chain(folders.iter().flat_map(|folder| sources(folder))).collect()
    }
}
