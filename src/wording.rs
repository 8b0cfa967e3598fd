//! Names of settings in texts for people.
//!
//! Errors, warnings and remarks name a setting as the library does, between brackets that nothing else is written in:
//! `⟨density_scale⟩`, with a value `⟨background=1,1,1⟩`, of another use case `⟨convert.crop⟩`. Each face of the program
//! says them in words of its own: the command line says `--density-scale`, and without a face they stand in backticks.
//! A process has one face, as it has one language, which [`speak_as`] tells.

use std::borrow::Cow;
use std::sync::OnceLock;

/// A setting that a text names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mention<'t> {
    /// Use case whose setting it is, such as `convert`; none for the one that is running.
    pub use_case: Option<&'t str>,
    /// Name of the setting, in snake case.
    pub setting: &'t str,
    /// Value that is proposed for it.
    pub value: Option<&'t str>,
}

/// Words of a face for a setting; none for what is no setting, whose text stays as it is.
pub type Face = fn(Mention<'_>) -> Option<String>;

static FACE: OnceLock<Face> = OnceLock::new();

/// Has settings named by a face's words from now on. The first face of a process stays.
pub fn speak_as(face: Face) {
    let _ = FACE.set(face);
}

/// Brackets around the mention of a setting.
const BRACKETS: [char; 2] = ['⟨', '⟩'];

/// Returns a text with its settings named by the words of this process's face.
pub fn worded(text: &str) -> Cow<'_, str> {
    worded_by(text, FACE.get().copied().unwrap_or(|_| None))
}

/// Returns texts with their settings named by the words of this process's face.
pub fn all_worded(texts: Vec<String>) -> Vec<String> {
    texts.into_iter().map(|text| worded(&text).into_owned()).collect()
}

fn worded_by(text: &str, face: Face) -> Cow<'_, str> {
    let [open, close] = BRACKETS;
    let mut out = String::new();
    let mut rest = text;
    while let Some((before, name, after)) = rest
        .split_once(open)
        .and_then(|(before, rest)| rest.split_once(close).map(|(name, after)| (before, name, after)))
    {
        out.push_str(before);
        out += &mention(name).and_then(face).unwrap_or_else(|| format!("`{name}`"));
        rest = after;
    }
    if out.is_empty() { Cow::Borrowed(text) } else { Cow::Owned(out + rest) }
}

/// Reads words in brackets as the mention of a setting.
fn mention(words: &str) -> Option<Mention<'_>> {
    let (name, value) = words.split_once('=').map_or((words, None), |(name, value)| (name, Some(value)));
    let (use_case, setting) = name.rsplit_once('.').map_or((None, name), |(case, setting)| (Some(case), setting));
    let plain = |name: &str| name.starts_with(|c: char| c.is_ascii_lowercase()) && !name.contains(|c| !snake(c));
    let plain_case = use_case.is_none_or(|case| case.split('.').all(plain));
    (plain(setting) && plain_case).then_some(Mention { use_case, setting, value })
}

fn snake(c: char) -> bool {
    c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_'
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Words of a face that knows the settings whose names have no `q`.
    fn shout(mention: Mention<'_>) -> Option<String> {
        let Mention { use_case, setting, value } = mention;
        let case = use_case.map_or(String::new(), |case| format!("{case}:"));
        let value = value.map_or(String::new(), |value| format!(" {value}"));
        (!setting.contains('q')).then(|| format!("{case}{}{value}", setting.to_uppercase()))
    }

    #[test]
    fn settings_are_named_by_the_face_and_all_else_stays() {
        for (text, expected) in [
            ("raise ⟨max_memory⟩, or", "raise MAX_MEMORY, or"),
            ("⟨background=1,1,1⟩ shows it", "BACKGROUND 1,1,1 shows it"),
            ("crop it with ⟨convert.crop⟩", "crop it with convert:CROP"),
            ("⟨reconstruct.density.views⟩ and ⟨a⟩", "reconstruct.density:VIEWS and A"),
            ("⟨q⟩, and a lone ⟨ stays", "`q`, and a lone ⟨ stays"),
            ("`cumulo info` lists `views`, unknown field `grid`", "`cumulo info` lists `views`, unknown field `grid`"),
            ("", ""),
        ] {
            assert_eq!(worded_by(text, shout), expected);
        }
        assert_eq!(worded("⟨max_memory⟩"), "`max_memory`", "the library's own words");
    }
}
