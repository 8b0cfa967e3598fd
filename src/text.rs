//! Text on its way to a terminal.
//!
//! Names, metadata and paths come from files, and files come from anywhere: an escape sequence in a grid's name would
//! move the cursor, set the window's title or recolor what follows. All printed text passes through this module; stored
//! and computed data stay as they are.

use std::borrow::Cow;
use std::fmt::Write;

/// Has a type serialised as the text that its `Display` writes and its `FromStr` reads.
#[macro_export]
#[doc(hidden)]
macro_rules! serde_as_text {
    ($kind:ty) => {
        impl serde::Serialize for $kind {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_str(self)
            }
        }

        impl<'de> serde::Deserialize<'de> for $kind {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let text = <std::borrow::Cow<'de, str> as serde::Deserialize>::deserialize(deserializer)?;
                text.parse().map_err(serde::de::Error::custom)
            }
        }
    };
}
pub use serde_as_text;

/// Formats a number of bytes in B, KiB, MiB or GiB.
pub fn bytes(count: u64) -> String {
    let mut size = count as f64;
    for unit in ["B", "KiB", "MiB"] {
        if size < 1024.0 {
            return if unit == "B" { format!("{count} B") } else { format!("{size:.1} {unit}") };
        }
        size /= 1024.0;
    }
    format!("{size:.2} GiB")
}

/// Quotes a word of a command line for a shell, if it needs quotes.
pub fn shell_quoted(word: &str) -> Cow<'_, str> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+%@".contains(c);
    match !word.is_empty() && word.chars().all(plain) {
        true => Cow::Borrowed(word),
        false => Cow::Owned(format!("'{}'", word.replace('\'', r"'\''"))),
    }
}

/// True for characters that act on a terminal or reorder the text around them instead of being shown: control
/// characters (C0, DEL and C1), Unicode's bidirectional marks, embeddings, overrides and isolates, its line and
/// paragraph separators, and its invisible tags.
pub fn acts(c: char) -> bool {
    c.is_control()
        || matches!(c,
            '\u{061c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
            | '\u{feff}' | '\u{e0000}'..='\u{e007f}')
}

/// Escapes every character that [`acts`] as Rust does, such as `\u{1b}` or `\n`, so that the text stays on one line. A
/// name with a line feed therefore cannot pass for a line of its own.
pub fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, acts)
}

/// Escapes every character that [`acts`], except line feeds and tabs.
pub fn printable_lines(text: &str) -> Cow<'_, str> {
    escaped(text, |c| acts(c) && c != '\n' && c != '\t')
}

/// Escapes every character of a JSON document that [`acts`], except line feeds, as JSON does (`\u009b`). The document's
/// value does not change.
pub fn printable_json(json: &str) -> Cow<'_, str> {
    let escaped = |c: char| acts(c) && c != '\n';
    if !json.contains(escaped) {
        return Cow::Borrowed(json);
    }
    let mut out = String::with_capacity(json.len() + 16);
    for c in json.chars() {
        if escaped(c) {
            for unit in c.encode_utf16(&mut [0; 2]) {
                // Writing to a string cannot fail.
                let _ = write!(out, "\\u{unit:04x}");
            }
        } else {
            out.push(c);
        }
    }
    Cow::Owned(out)
}

fn escaped(text: &str, bad: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&bad) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if bad(c) { out.extend(c.escape_default()) } else { out.push(c) }
    }
    Cow::Owned(out)
}

/// Writes ascending numbers with runs as ranges: `1-3, 7`.
pub fn ranges(numbers: impl IntoIterator<Item = u32>) -> String {
    let mut runs: Vec<(u32, u32)> = Vec::new();
    for number in numbers {
        match runs.last_mut().filter(|(_, last)| last.checked_add(1) == Some(number)) {
            Some((_, last)) => *last = number,
            None => runs.push((number, number)),
        }
    }
    let run = |(first, last): &(u32, u32)| if first == last { first.to_string() } else { format!("{first}-{last}") };
    runs.iter().map(run).collect::<Vec<_>>().join(", ")
}

/// Lists words as a sentence does: `a, b and c` with `and` before the last.
pub fn listed<W: AsRef<str>>(words: &[W], before_last: &str) -> String {
    let joined = |words: &[W]| words.iter().map(AsRef::as_ref).collect::<Vec<_>>().join(", ");
    match words {
        [first @ .., last] if !first.is_empty() => format!("{} {before_last} {}", joined(first), last.as_ref()),
        _ => joined(words),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// Text with a color, a window title, DEL, a C1 control sequence introducer, a right-to-left override and a tag.
    const HOSTILE: &str = "a\u{1b}[31mb\u{1b}]0;t\u{7}c\u{7f}\u{9b}2J\u{202e}\u{2066}\u{e0041}\u{2028}\r\nz";

    #[test]
    fn nothing_that_acts_on_a_terminal_is_left() {
        let line = printable(HOSTILE);
        assert!(!line.contains(acts), "{line}");
        assert!(line.starts_with(r"a\u{1b}[31mb\u{1b}]0;t\u{7}c\u{7f}\u{9b}2J\u{202e}"), "{line}");
        assert!(line.ends_with(r"\u{2028}\r\nz"), "{line}");
        assert_eq!(printable(&line), line, "a second time changes nothing");
        let lines = printable_lines(HOSTILE);
        assert_eq!(lines.chars().filter(|c| acts(*c)).collect::<String>(), "\n");
    }

    #[test]
    fn what_people_write_stays() {
        for text in ["density", "Dichte für α", "煙", "🌫", "e\u{301}", r"C:\new"] {
            assert_eq!(printable(text), text);
        }
        assert_eq!(printable_lines("a\n\tb"), "a\n\tb");
    }

    #[test]
    fn json_says_the_same() {
        let value = serde_json::json!({ HOSTILE: [HOSTILE, 1.5] });
        let plain = serde_json::to_string_pretty(&value).unwrap();
        assert!(plain.contains('\u{9b}'), "serde leaves C1 controls as they are");
        let safe = printable_json(&plain);
        assert_eq!(safe.chars().filter(|c| acts(*c) && *c != '\n').count(), 0);
        assert_eq!(serde_json::from_str::<serde_json::Value>(&safe).unwrap(), value);
    }

    #[test]
    fn runs_are_ranges() {
        assert_eq!(ranges([1, 2, 3, 7, 9, 10]), "1-3, 7, 9-10");
        assert_eq!(ranges([]), "");
    }

    #[test]
    fn lists_read_as_sentences() {
        assert_eq!([listed(&["a", "b", "c"], "or"), listed(&["a"], "or")], ["a, b or c", "a"]);
        assert_eq!(listed::<&str>(&[], "and"), "");
    }

    #[test]
    fn words_survive_a_shell() {
        assert_eq!(shell_quoted("a/b.vdb"), "a/b.vdb");
        assert_eq!(shell_quoted("a b"), "'a b'");
        assert_eq!(shell_quoted("it's"), r"'it'\''s'");
        assert_eq!(shell_quoted(""), "''");
    }
}
