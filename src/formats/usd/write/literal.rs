//! Values as text in the form of `.usda` files.

use std::fmt::{self, Write};

/// A value of an attribute or of metadata.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Literal {
    /// `bool`.
    Bool(bool),
    /// `int`.
    Int(i64),
    /// `float`, `double` or `half`. It must be finite.
    Number(f64),
    /// `float`, whose shortest text that reads back the same is written.
    Single(f32),
    /// `token` or `string`.
    Text(String),
    /// `asset`: a path of a file.
    Asset(String),
    /// A tuple, such as `float3`, `color3f` or a row of `matrix4d`.
    Tuple(Vec<Literal>),
    /// An array.
    Array(Vec<Literal>),
    /// No value from this time on.
    Blocked,
}

impl Literal {
    /// Creates a tuple of doubles.
    pub(crate) fn doubles<const N: usize>(values: [f64; N]) -> Self {
        Self::Tuple(values.map(Self::Number).to_vec())
    }

    /// Creates a tuple of floats.
    pub(crate) fn floats<const N: usize>(values: [f32; N]) -> Self {
        Self::Tuple(values.map(Self::Single).to_vec())
    }

    /// Creates a token or a string.
    pub(crate) fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }
}

impl fmt::Display for Literal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |f: &mut fmt::Formatter<'_>, values: &[Self], [open, close]: [char; 2]| {
            f.write_char(open)?;
            for (i, value) in values.iter().enumerate() {
                write!(f, "{}{value}", if i > 0 { ", " } else { "" })?;
            }
            f.write_char(close)
        };
        match self {
            Self::Bool(v) => f.write_str(if *v { "1" } else { "0" }),
            Self::Int(v) => write!(f, "{v}"),
            Self::Number(v) => write!(f, "{v}"),
            Self::Single(v) => write!(f, "{v}"),
            Self::Text(v) => f.write_str(&quoted(v)),
            // Three signs delimit paths that have one themselves.
            Self::Asset(v) if v.contains('@') => write!(f, "@@@{v}@@@"),
            Self::Asset(v) => write!(f, "@{v}@"),
            Self::Tuple(values) => list(f, values, ['(', ')']),
            Self::Array(values) => list(f, values, ['[', ']']),
            Self::Blocked => f.write_str("None"),
        }
    }
}

/// Returns text in quotes, as `.usda` files have it: quotes, backslashes and control characters are escaped.
pub(crate) fn quoted(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 2);
    out.push('"');
    for c in text.chars() {
        match c {
            '"' => out.push_str("\\\""),
            '\\' => out.push_str("\\\\"),
            '\n' => out.push_str("\\n"),
            '\r' => out.push_str("\\r"),
            '\t' => out.push_str("\\t"),
            c if c.is_ascii_control() => out.push_str(&format!("\\x{:02x}", u32::from(c))),
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_written_as_usda_has_them() {
        let shown = |value: Literal| value.to_string();
        assert_eq!(shown(Literal::floats([0.1, 1.0, -2.5])), "(0.1, 1, -2.5)");
        assert_eq!(shown(Literal::Array(vec![Literal::doubles([0.1]), Literal::Bool(true)])), "[(0.1), 1]");
        assert_eq!(shown(Literal::text("a \"b\" \\ \n\u{1}é")), "\"a \\\"b\\\" \\\\ \\n\\x01é\"");
        assert_eq!(shown(Literal::Asset("./a.vdb".into())), "@./a.vdb@");
        assert_eq!(shown(Literal::Asset("./a@b.vdb".into())), "@@@./a@b.vdb@@@");
    }
}
