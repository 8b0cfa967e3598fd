//! A pass over the text of a `.usda` layer before the parser reads it.
//!
//! The parser of the crate `openusd` refuses time samples of type `asset`, which Blender writes for sequences of
//! volumes, leaves escapes in strings as they are, and knows no numbers such as `.5` or `5.`. It also recurses as deep
//! as its input is nested. This pass rewrites the former and bounds the latter.

use crate::error::{Error, Result};

/// Deepest nesting of brackets.
const MOST_DEPTH: usize = 128;

/// Text of a layer for the parser.
#[derive(Debug)]
pub(super) struct Prepared {
    /// Text in which time samples of type `asset` are strings.
    pub text: String,
    /// Numbers of lines of this text, ascending, below which lines have moved down, and by how many.
    moved: Vec<(usize, usize)>,
}

impl Prepared {
    /// Returns the number of the line in the file, from that in the text.
    pub(crate) fn line(&self, line: usize) -> usize {
        line - self.moved.iter().filter(|(after, _)| line > *after).map(|(_, lines)| lines).sum::<usize>()
    }
}

/// Rewrites the text of a layer.
///
/// # Errors
/// If it is nested too deeply; the error names the line.
pub(super) fn prepare(text: &str) -> Result<Prepared> {
    let out = String::with_capacity(text.len() + 16);
    let mut pass = Pass { text, at: 0, out, lines: Lines::default(), open: Vec::new(), moved: Vec::new() };
    while pass.at < text.len() {
        pass.step()?;
    }
    Ok(Prepared { text: pass.out, moved: pass.moved })
}

/// A bracket that is open.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Open {
    /// Braces of time samples.
    Samples,
    Other,
}

/// Counter of the lines of a text that grows: each byte is looked at once.
#[derive(Debug, Default)]
struct Lines {
    /// Line breaks so far.
    breaks: usize,
    /// Bytes of the text that were looked at.
    seen: usize,
}

impl Lines {
    /// Returns the number of line breaks of a text that has only grown since the last call.
    fn breaks(&mut self, text: &str) -> usize {
        self.breaks += text.as_bytes()[self.seen..].iter().filter(|byte| **byte == b'\n').count();
        self.seen = text.len();
        self.breaks
    }
}

struct Pass<'t> {
    text: &'t str,
    /// Offset of the next byte to be read.
    at: usize,
    out: String,
    /// Line breaks of `out`.
    lines: Lines,
    open: Vec<Open>,
    moved: Vec<(usize, usize)>,
}

impl<'t> Pass<'t> {
    fn rest(&self) -> &'t str {
        &self.text[self.at..]
    }

    /// Copies the next bytes, which end at a boundary of characters.
    fn copy(&mut self, bytes: usize) {
        self.out.push_str(&self.rest()[..bytes]);
        self.at += bytes;
    }

    /// Reads one token, comment or character.
    fn step(&mut self) -> Result<()> {
        let rest = self.rest();
        let Some(next) = rest.chars().next() else { return Ok(()) };
        match next {
            '#' => self.copy(rest.find(['\n', '\r']).unwrap_or(rest.len())),
            '/' if rest.starts_with("//") => self.at += rest.find(['\n', '\r']).unwrap_or(rest.len()),
            '/' if rest.starts_with("/*") => self.copy(rest[2..].find("*/").map_or(rest.len(), |end| end + 4)),
            '"' | '\'' => self.string(next),
            '@' => self.asset(),
            '<' => self.copy(rest.find(['>', '\n']).map_or(rest.len(), |end| end + 1)),
            '{' | '[' | '(' => self.bracket(next)?,
            '}' | ']' | ')' => {
                self.open.pop();
                self.copy(1);
            }
            '.' | '0'..='9' => self.number(),
            _ if next == '_' || next.is_alphabetic() => {
                let inside = |c: char| c == '_' || c == ':' || c.is_alphanumeric();
                self.copy(rest.find(|c| !inside(c)).unwrap_or(rest.len()));
            }
            _ => self.copy(next.len_utf8()),
        }
        Ok(())
    }

    fn bracket(&mut self, bracket: char) -> Result<()> {
        if self.open.len() == MOST_DEPTH {
            let line = 1 + self.text[..self.at].matches('\n').count();
            return Err(Error::unsupported(format!("line {line}: more than {MOST_DEPTH} brackets are nested"))
                .hint("the file may be damaged; write it again where it was made"));
        }
        let before = self.out.trim_end().strip_suffix('=').map(str::trim_end);
        let samples = bracket == '{' && before.is_some_and(|before| before.ends_with(".timeSamples"));
        self.open.push(if samples { Open::Samples } else { Open::Other });
        self.copy(1);
        Ok(())
    }

    /// Reads a path of a file; one that is a time sample becomes a string.
    fn asset(&mut self) {
        let rest = self.rest();
        let quote = if rest.starts_with("@@@") { "@@@" } else { "@" };
        let Some(end) = rest[quote.len()..].find(quote) else {
            self.copy(rest.len());
            return;
        };
        let content = &rest[quote.len()..quote.len() + end];
        match (self.open.last(), raw(content)) {
            (Some(Open::Samples), Some(string)) => {
                self.out.push_str(&string);
                self.at += end + 2 * quote.len();
            }
            _ => self.copy(end + 2 * quote.len()),
        }
    }

    /// Reads a string; one with escapes becomes one without.
    fn string(&mut self, quote: char) {
        let rest = self.rest();
        let three = quote.to_string().repeat(3);
        let quotes = if rest.starts_with(&three) { 3 } else { 1 };
        let mut end = None;
        let mut characters = rest[quotes..].char_indices();
        while let Some((at, c)) = characters.next() {
            if c == '\\' {
                characters.next();
            } else if rest[quotes + at..].starts_with(&three[..quotes]) {
                end = Some(at);
                break;
            }
        }
        let Some(end) = end else {
            self.copy(rest.len());
            return;
        };
        let content = &rest[quotes..quotes + end];
        match content.contains('\\').then(|| raw(&unescaped(content))).flatten() {
            Some(string) => {
                let lines = string.matches('\n').count().saturating_sub(content.matches('\n').count());
                self.out.push_str(&string);
                self.at += end + 2 * quotes;
                if lines > 0 {
                    self.moved.push((1 + self.lines.breaks(&self.out) - lines, lines));
                }
            }
            None => self.copy(end + 2 * quotes),
        }
    }

    /// Reads a number; one without digits on either side of its point gets a zero there.
    fn number(&mut self) {
        let rest = self.rest();
        let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
        let whole = digits(rest);
        let Some(fraction) = rest[whole..].strip_prefix('.') else {
            self.copy(whole);
            return;
        };
        let after = digits(fraction);
        // A property's name is separated by a point too.
        let property = self.out.ends_with(|c: char| c == '_' || c.is_alphanumeric());
        if whole + after == 0 || (whole == 0 && property) {
            self.copy(1);
            return;
        }
        self.out.push_str(if whole == 0 { "0" } else { &rest[..whole] });
        self.out.push('.');
        self.out.push_str(if after == 0 { "0" } else { &fraction[..after] });
        self.at += whole + 1 + after;
    }
}

/// Returns a string literal whose characters stand for themselves; `None` if there is no such literal.
fn raw(content: &str) -> Option<String> {
    let fits = |quotes: &&str| !content.contains(*quotes) && !content.ends_with(&quotes[..1]);
    ["\"\"\"", "'''"].iter().find(|quotes| fits(quotes)).map(|quotes| format!("{quotes}{content}{quotes}"))
}

/// Replaces the escapes of a string by what they stand for.
fn unescaped(content: &str) -> String {
    let mut out = String::with_capacity(content.len());
    let mut characters = content.chars();
    while let Some(c) = characters.next() {
        match (c, characters.clone().next()) {
            ('\\', Some(escaped)) => {
                characters.next();
                out.push(match escaped {
                    'n' => '\n',
                    't' => '\t',
                    'r' => '\r',
                    'a' => '\x07',
                    'b' => '\x08',
                    'f' => '\x0c',
                    'v' => '\x0b',
                    'x' => code(&mut characters, 0, 16, 2),
                    '0'..='7' => code(&mut characters, escaped.to_digit(8).unwrap_or_default(), 8, 2),
                    other => other,
                });
            }
            _ => out.push(c),
        }
    }
    out
}

/// Returns the character whose code `most` further digits to a base state at the most, after digits of the value
/// `code`.
fn code(characters: &mut std::str::Chars<'_>, mut code: u32, base: u32, most: usize) -> char {
    for _ in 0..most {
        let Some(digit) = characters.clone().next().and_then(|c| c.to_digit(base)) else { break };
        characters.next();
        code = code * base + digit;
    }
    char::from_u32(code).unwrap_or(char::REPLACEMENT_CHARACTER)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    fn text(text: &str) -> String {
        prepare(text).unwrap().text
    }

    #[test]
    fn time_samples_of_files_become_strings() {
        assert_eq!(
            text("asset filePath.timeSamples = {\n 1: @./a.vdb@,\n 2: @@@b'@c@@@,\n}"),
            "asset filePath.timeSamples = {\n 1: \"\"\"./a.vdb\"\"\",\n 2: \"\"\"b'@c\"\"\",\n}"
        );
        for same in ["asset a = @x.vdb@", "asset[] a.timeSamples = { 1: [@x@] }", "# {@x@", "references = @a.usda@</B>"]
        {
            assert_eq!(text(same), same);
        }
    }

    #[test]
    fn escapes_and_numbers_are_rewritten() {
        assert_eq!(text(r#"string a = "say \"x\"""#), r#"string a = '''say "x"'''"#);
        assert_eq!(text("(.5, 5., -.25, 1.5, 7, 5.e3)"), "(0.5, 5.0, -0.25, 1.5, 7, 5.0e3)");
        assert_eq!(text("float a1.timeSamples = { 1.5: 2 } // note"), "float a1.timeSamples = { 1.5: 2 } ");
        let prepared = prepare("string a = \"x\\ny\"\nfloat b\n").unwrap();
        assert_eq!([1, 2, 3, 4].map(|line| prepared.line(line)), [1, 1, 2, 3]);
    }

    #[test]
    fn escapes_are_those_of_openusd() {
        assert_eq!(unescaped(r"\x41\x4 \101\7 \a\b\f\v\q\\"), "A\x04 A\x07 \x07\x08\x0c\x0bq\\");
        // Both quotes stand for themselves between three of one kind.
        assert_eq!(text(r#"string a = "it\'s \"x\" too""#), r#"string a = """it's "x" too""""#);
        assert_eq!(text(r#"string a = "'\"""#), r#"string a = ''''"'''"#);
    }

    /// Text of eight times the length takes eight times the work, not 64 times.
    #[test]
    fn escapes_take_linear_work() {
        let text = |count: usize| "string s = \"a\\nb\"\n".repeat(count);
        let (short, long) = (text(5_000), text(40_000));
        let best = |text: &str| {
            let run = || {
                let begun = std::time::Instant::now();
                assert_eq!(prepare(text).unwrap().moved.len(), text.len() / 18);
                begun.elapsed()
            };
            (0..7).map(|_| run()).min().unwrap()
        };
        let ratio = best(&long).as_secs_f64() / best(&short).as_secs_f64();
        assert!(ratio < 24.0, "{ratio}");
    }

    #[test]
    fn deep_nesting_is_refused() {
        let deep = format!("\n{}", "{".repeat(200));
        let error = prepare(&deep).unwrap_err().to_string();
        assert!(error.contains("line 2") && error.contains("128"), "{error}");
    }

    #[test]
    fn unfinished_text_ends() {
        for broken in ["\"abc", "'''a'", "@a", "@@@a@@", "<a", "/* a", "\"\\", ".", "é.5"] {
            assert!(prepare(broken).is_ok(), "{broken}");
        }
    }
}
