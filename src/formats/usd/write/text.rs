//! Prims and their properties as text in the form of `.usda` files.
//!
//! The syntax is that of "Usda File Format" in the OpenUSD documentation, restricted to what stages here need: prims with
//! metadata, variant sets, attributes with defaults and time samples, relationships and connections.

use std::fmt::{self, Write};

/// A value of an attribute or of metadata.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
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
    Tuple(Vec<Value>),
    /// An array.
    Array(Vec<Value>),
    /// No value from this time on.
    Blocked,
}

impl Value {
    /// Creates a tuple of doubles.
    pub fn doubles<const N: usize>(values: [f64; N]) -> Self {
        Self::Tuple(values.map(Self::Number).to_vec())
    }

    /// Creates a tuple of floats.
    pub fn floats<const N: usize>(values: [f32; N]) -> Self {
        Self::Tuple(values.map(Self::Single).to_vec())
    }

    /// Creates a token or a string.
    pub fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }
}

impl fmt::Display for Value {
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
pub fn quoted(text: &str) -> String {
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

/// What a property holds.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// No value: the property is only declared.
    Declared,
    /// A value at all times.
    Default(Value),
    /// A value at times without samples, and values by time code in ascending order.
    Samples(Value, Vec<(f64, Value)>),
    /// Path of the property to which an attribute is connected.
    Connection(String),
    /// Path of the prim that a relationship targets.
    Target(String),
}

/// A property of a prim.
#[derive(Debug, Clone, PartialEq)]
pub struct Property {
    /// Words before the name: `custom double`, `uniform token`, `rel`.
    pub declaration: &'static str,
    /// Name with its namespaces.
    pub name: String,
    /// Content.
    pub content: Content,
}

impl Property {
    /// Creates an attribute with one value.
    pub fn new(declaration: &'static str, name: impl Into<String>, value: Value) -> Self {
        Self { declaration, name: name.into(), content: Content::Default(value) }
    }

    /// Creates an output that is only declared.
    pub fn output(declaration: &'static str, name: impl Into<String>) -> Self {
        Self { declaration, name: name.into(), content: Content::Declared }
    }

    /// Creates an attribute that is connected to another one.
    pub fn connected(declaration: &'static str, name: impl Into<String>, to: impl Into<String>) -> Self {
        Self { declaration, name: name.into(), content: Content::Connection(to.into()) }
    }

    /// Creates a relationship to one prim.
    pub fn relationship(declaration: &'static str, name: impl Into<String>, target: impl Into<String>) -> Self {
        Self { declaration, name: name.into(), content: Content::Target(target.into()) }
    }

    fn write(&self, out: &mut String, indent: usize) {
        let Self { declaration, name, content } = self;
        let space = " ".repeat(indent);
        let line = |value: &dyn fmt::Display| format!("{space}{declaration} {name} = {value}\n");
        match content {
            Content::Declared => *out += &format!("{space}{declaration} {name}\n"),
            Content::Default(value) => *out += &line(value),
            Content::Samples(default, samples) => {
                if *default != Value::Blocked {
                    *out += &line(default);
                }
                *out += &format!("{space}{declaration} {name}.timeSamples = {{\n");
                samples.iter().for_each(|(time, value)| *out += &format!("{space}    {time}: {value},\n"));
                *out += &format!("{space}}}\n");
            }
            Content::Connection(to) => *out += &format!("{space}{declaration} {name}.connect = <{to}>\n"),
            Content::Target(to) => *out += &format!("{space}{declaration} {name} = <{to}>\n"),
        }
    }
}

/// A set of variants of a prim: one of them is selected.
#[derive(Debug, Clone, PartialEq)]
pub struct VariantSet {
    /// Name of the set.
    pub name: &'static str,
    /// Name of the variant that is selected.
    pub selected: &'static str,
    /// Variants in the order in which they are written.
    pub variants: Vec<Variant>,
}

/// What a variant adds to a prim.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Variant {
    /// Name of the variant.
    pub name: &'static str,
    /// Properties.
    pub properties: Vec<Property>,
    /// Prims beneath.
    pub children: Vec<Prim>,
}

/// A prim with what lies beneath it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Prim {
    /// Type: `Volume`, `Xform`; empty for an `over`, which adds opinions to a prim that another layer defines.
    pub kind: &'static str,
    /// Name, an identifier.
    pub name: String,
    /// Lines of metadata.
    pub metadata: Vec<String>,
    /// Properties in the order in which they are written.
    pub properties: Vec<Property>,
    /// Variant sets.
    pub variants: Vec<VariantSet>,
    /// Prims beneath.
    pub children: Vec<Prim>,
}

impl Prim {
    /// Creates a prim without properties.
    pub fn new(kind: &'static str, name: impl Into<String>) -> Self {
        Self { kind, name: name.into(), ..Self::default() }
    }

    /// Adds an attribute with one value.
    pub fn set(&mut self, declaration: &'static str, name: impl Into<String>, value: Value) -> &mut Self {
        self.properties.push(Property::new(declaration, name, value));
        self
    }

    /// Writes the prim as lines of text, indented by so many blanks.
    pub fn write(&self, out: &mut String, indent: usize) {
        let space = " ".repeat(indent);
        *out += &match self.kind {
            "" => format!("{space}over \"{}\"", self.name),
            kind => format!("{space}def {kind} \"{}\"", self.name),
        };
        let mut metadata = self.metadata.clone();
        if !self.variants.is_empty() {
            metadata.push("variants = {".into());
            metadata.extend(self.variants.iter().map(|v| format!("    string {} = {}", v.name, quoted(v.selected))));
            metadata.push("}".into());
            let names: Vec<String> = self.variants.iter().map(|v| quoted(v.name)).collect();
            metadata.push(format!("prepend variantSets = [{}]", names.join(", ")));
        }
        if metadata.is_empty() {
            *out += "\n";
        } else {
            *out += " (\n";
            metadata.iter().for_each(|line| *out += &format!("{space}    {line}\n"));
            *out += &format!("{space})\n");
        }
        *out += &format!("{space}{{\n");
        self.properties.iter().for_each(|property| property.write(out, indent + 4));
        for set in &self.variants {
            *out += &format!("{space}    variantSet {} = {{\n", quoted(set.name));
            for Variant { name, properties, children } in &set.variants {
                *out += &format!("{space}        {} {{\n", quoted(name));
                properties.iter().for_each(|property| property.write(out, indent + 12));
                children.iter().for_each(|child| child.write(out, indent + 12));
                *out += &format!("{space}        }}\n");
            }
            *out += &format!("{space}    }}\n");
        }
        for child in &self.children {
            *out += "\n";
            child.write(out, indent + 4);
        }
        *out += &format!("{space}}}\n");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_written_as_usda_has_them() {
        let shown = |value: Value| value.to_string();
        assert_eq!(shown(Value::floats([0.1, 1.0, -2.5])), "(0.1, 1, -2.5)");
        assert_eq!(shown(Value::Array(vec![Value::doubles([0.1]), Value::Bool(true)])), "[(0.1), 1]");
        assert_eq!(shown(Value::text("a \"b\" \\ \n\u{1}é")), "\"a \\\"b\\\" \\\\ \\n\\x01é\"");
        assert_eq!(shown(Value::Asset("./a.vdb".into())), "@./a.vdb@");
        assert_eq!(shown(Value::Asset("./a@b.vdb".into())), "@@@./a@b.vdb@@@");
    }

    #[test]
    fn prims_are_nested() {
        let mut prim = Prim::new("Xform", "World");
        prim.set("custom double", "cumulo:densityScale", Value::Number(2.0));
        let samples = vec![(1.0, Value::Int(1)), (4.0, Value::Blocked)];
        prim.properties.push(Property {
            declaration: "int",
            name: "a".into(),
            content: Content::Samples(Value::Int(1), samples),
        });
        prim.children.push(Prim::new("Scope", "inner"));
        prim.variants.push(VariantSet {
            name: "r",
            selected: "x",
            variants: vec![Variant { name: "x", ..Variant::default() }],
        });
        let mut text = String::new();
        prim.write(&mut text, 0);
        let expected = "def Xform \"World\" (\n    variants = {\n        string r = \"x\"\n    }\n    prepend variantSets = \
                        [\"r\"]\n)\n{\n    custom double cumulo:densityScale = 2\n    int a = 1\n    int a.timeSamples = \
                        {\n        1: 1,\n        4: None,\n    }\n    variantSet \"r\" = {\n        \"x\" {\n        \
                        }\n    }\n\n    def Scope \"inner\"\n    {\n    }\n}\n";
        assert_eq!(text, expected);
    }
}
