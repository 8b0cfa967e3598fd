//! Command lines whose words a job fills in.

use crate::formats::sequence::Pattern;
use std::path::{Path, PathBuf};

/// Command line of the program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct CommandLine {
    /// Words of the command, such as `reconstruct density`.
    pub command: String,
    /// Arguments as they were given: those without a name first.
    pub arguments: Vec<Argument>,
}

/// Argument of a command line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Argument {
    /// Name of the setting that it states, such as `density_scale`.
    pub setting: String,
    /// Long option, such as `density-scale`; none for an argument that its place tells.
    pub option: Option<String>,
    /// Values; none for an option that has none. Those of an option are one word, separated by commas.
    pub values: Vec<Value>,
}

/// Value of an argument: pieces of text and paths.
pub(crate) type Value = Vec<Piece>;

/// Piece of a value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Piece {
    Text(String),
    /// Reference to a parameter of the job or of a task.
    Reference(String),
    /// Path of a file, of a folder, or of the files of a sequence, that is read.
    Input(PathBuf),
    /// One that is written.
    Output(PathBuf),
}

impl Argument {
    /// Returns an option whose value is a reference.
    pub(super) fn option(option: &str, reference: &str) -> Self {
        let values = vec![vec![Piece::Reference(reference.into())]];
        Self { setting: option.replace('-', "_"), option: Some(option.into()), values }
    }

    /// Returns an option that has no value.
    pub(super) fn flag(option: &str) -> Self {
        Self { setting: option.replace('-', "_"), option: Some(option.into()), values: Vec::new() }
    }
}

impl CommandLine {
    /// Returns the command line without these settings.
    #[must_use]
    pub(super) fn without(mut self, settings: &[&str]) -> Self {
        self.arguments.retain(|argument| !settings.contains(&argument.setting.as_str()));
        self
    }

    /// Returns the command line with an argument in place of another one for the same setting.
    #[must_use]
    pub(super) fn with(self, argument: Argument) -> Self {
        let mut command = self.without(&[&argument.setting]);
        command.arguments.push(argument);
        command
    }

    /// Returns the path that is written as a setting.
    pub(super) fn output(&self) -> Option<&Path> {
        let argument = self.arguments.iter().find(|argument| argument.setting == "output")?;
        argument.values.iter().flatten().find_map(|piece| match piece {
            Piece::Output(path) => Some(path.as_path()),
            _ => None,
        })
    }

    /// True if one picture is written, by its name, and no sequence or folder of pictures.
    pub(super) fn writes_one_picture(&self) -> bool {
        self.output().is_some_and(|path| is_exr(path) && Pattern::parse(path).is_none())
    }

    /// Returns the command line with its output at a reference.
    #[must_use]
    pub(super) fn writing(self, reference: &str) -> Self {
        self.with(Argument::option("output", reference))
    }
}

/// True if the name of a file is that of an OpenEXR picture.
pub(super) fn is_exr(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("exr"))
}
