//! Parameters of a job, and the words of its tasks that refer to them.

use super::command::{Argument, CommandLine, Piece, Value};
use super::template::{DataFlow, ObjectType, Parameter};
use crate::error::{Error, Result};
use crate::formats::sequence::Pattern;
use std::path::{Path, PathBuf};

/// Parameters of a job with the values that they have for this command.
#[derive(Debug, Default)]
pub(super) struct Parameters {
    pub definitions: Vec<Parameter>,
    /// Paths by the names of their parameters, which a template cannot hold: those outside its folder.
    pub paths: Vec<(String, PathBuf)>,
}

/// Endings of files that name others which lie beside them or below their folder.
const NAMES_OTHERS: [&str; 6] = ["json", "usd", "usda", "usdc", "txt", "bin"];
/// Endings of the files that commands write.
const WRITTEN: [&str; 5] = ["exr", "png", "vdb", "json", "html"];
/// Longest text of a parameter.
const LONGEST: usize = 1024;

impl Parameters {
    /// Returns the words of a command line behind the program's name.
    ///
    /// # Errors
    /// If a word cannot stand in a template.
    pub(super) fn words(&mut self, line: &CommandLine) -> Result<Vec<String>> {
        let mut words: Vec<String> = line.command.split(' ').map(str::to_owned).collect();
        for Argument { setting, option, values } in &line.arguments {
            let mut texts = Vec::new();
            for value in values {
                texts.push(self.text(setting, value)?);
            }
            match option {
                None => words.extend(texts),
                Some(option) if texts.is_empty() => words.push(format!("--{option}")),
                Some(option) => words.push(format!("--{option}={}", texts.join(","))),
            }
        }
        Ok(words)
    }

    /// Returns the text of a value, in which parameters stand for paths.
    fn text(&mut self, setting: &str, value: &Value) -> Result<String> {
        let mut text = String::new();
        for piece in value {
            match piece {
                Piece::Text(plain) if plain.contains("{{") => {
                    return Err(Error::unsupported(format!("'{plain}' would be a reference in a job"))
                        .hint("a job cannot hold words with '{{'"));
                }
                Piece::Text(plain) | Piece::Reference(plain) => text += plain,
                Piece::Input(path) => text += &self.path(setting, path, DataFlow::In)?,
                Piece::Output(path) => text += &self.path(setting, path, DataFlow::Out)?,
            }
        }
        Ok(text)
    }

    /// Returns the reference to a path: that to the file or the folder itself, or of the files of a sequence and of one
    /// that names others beside it that to their folder, with the name behind.
    ///
    /// # Errors
    /// If the path is not Unicode, or holds braces that a template takes for a reference.
    pub(super) fn path(&mut self, setting: &str, path: &Path, data_flow: DataFlow) -> Result<String> {
        let absolute = std::path::absolute(path).map_err(|e| Error::io(path, e))?;
        let ending = |endings: &[&str]| {
            absolute.extension().and_then(|e| e.to_str()).is_some_and(|e| endings.contains(&e.to_lowercase().as_str()))
        };
        let is_written = data_flow == DataFlow::Out;
        let beside = Pattern::parse(path).is_some() || (!is_written && absolute.is_file() && ending(&NAMES_OTHERS));
        let name = absolute.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_owned();
        let (place, object_type, behind) = match absolute.parent().filter(|_| beside) {
            Some(folder) => (folder.to_owned(), ObjectType::Directory, format!("/{name}")),
            None if absolute.is_dir() => (absolute, ObjectType::Directory, String::new()),
            None if is_written && !ending(&WRITTEN) => (absolute, ObjectType::Directory, String::new()),
            None => (absolute, ObjectType::File, String::new()),
        };
        match place.to_str() {
            Some(text) if !name.contains("{{") && text.len() <= LONGEST => {}
            _ => {
                return Err(Error::unsupported("a job cannot hold this path")
                    .at(path)
                    .hint("give a path of Unicode characters, of 1024 bytes at most and without '{{'"));
            }
        }
        let name = self.name_of(setting, &place);
        if !self.paths.iter().any(|(known, _)| *known == name) {
            let verb = if is_written { "written" } else { "read" };
            let description = format!("Path that is {verb}: {}.", setting.replace('_', " "));
            self.definitions.push(Parameter::Path { name: name.clone(), description, object_type, data_flow });
            self.paths.push((name.clone(), place));
        }
        Ok(format!("{{{{Param.{name}}}}}{behind}"))
    }

    /// Returns the name of the parameter of a path: that of the setting, with a number behind for the second one.
    fn name_of(&self, setting: &str, place: &Path) -> String {
        let name = capitalised(setting);
        let numbered = (1..).map(|n| if n == 1 { name.clone() } else { format!("{name}{n}") });
        let mut free = numbered.filter(|name| {
            let standing = self.paths.iter().find(|(known, _)| known == name);
            standing.is_none_or(|(_, path)| path == place)
        });
        free.next().unwrap_or(name)
    }

    /// Adds a parameter of text, and returns the reference to it.
    pub(super) fn text_of(&mut self, name: &str, description: &str, default: String) -> String {
        self.add(Parameter::String { name: name.into(), description: description.into(), default })
    }

    /// Adds a parameter that is a whole number from 1 up, and returns the reference to it.
    pub(super) fn number_of(&mut self, name: &str, description: &str, default: u32) -> String {
        self.add(Parameter::Int { name: name.into(), description: description.into(), min_value: 1, default })
    }

    /// Returns the default of the parameter of text that a reference names.
    pub(super) fn default_of(&self, reference: &str) -> Option<String> {
        self.definitions.iter().find_map(|definition| match definition {
            Parameter::String { name, default, .. } if reference == format!("{{{{Param.{name}}}}}") => {
                Some(default.clone())
            }
            _ => None,
        })
    }

    fn add(&mut self, parameter: Parameter) -> String {
        let reference = format!("{{{{Param.{}}}}}", parameter.name());
        if !self.definitions.iter().any(|known| known.name() == parameter.name()) {
            self.definitions.push(parameter);
        }
        reference
    }
}

/// Returns a setting as the name of a parameter: `density_scale` as `DensityScale`.
fn capitalised(setting: &str) -> String {
    let word = |word: &str| word[..1].to_uppercase() + &word[1..];
    setting.split('_').filter(|part| !part.is_empty()).map(word).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_become_parameters() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("transforms.json"), "{}").unwrap();
        std::fs::write(at("a.vdb"), "").unwrap();
        let mut parameters = Parameters::default();
        let mut of = |setting, name: &str, flow| parameters.path(setting, &at(name), flow).unwrap();
        assert_eq!(of("input", "a.vdb", DataFlow::In), "{{Param.Input}}");
        assert_eq!(of("input", "s.####.vdb", DataFlow::In), "{{Param.Input2}}/s.####.vdb");
        assert_eq!(of("cameras", "transforms.json", DataFlow::In), "{{Param.Cameras}}/transforms.json");
        assert_eq!(of("output", "shots.v2", DataFlow::Out), "{{Param.Output}}");
        assert_eq!(of("output", "shots.v2", DataFlow::Out), "{{Param.Output}}");
        let kind = |definition: &Parameter| match definition {
            Parameter::Path { object_type, .. } => Some(*object_type),
            _ => None,
        };
        let kinds: Vec<ObjectType> = parameters.definitions.iter().filter_map(kind).collect();
        use ObjectType::{Directory, File};
        assert_eq!(kinds, [File, Directory, Directory, Directory]);
        assert!(parameters.path("input", Path::new("a{{b}}.vdb"), DataFlow::In).is_err());
    }
}
