//! Prims and their properties as text in the form of `.usda` files.
//!
//! The syntax is that of "Usda File Format" in the OpenUSD documentation, restricted to what stages here need: prims
//! with metadata, variant sets, attributes with defaults and time samples, relationships and connections.

pub(crate) use super::literal::{Literal, quoted};
use std::fmt;

/// Content of a property.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Content {
    /// No value: the property is only declared.
    Declared,
    /// A value at all times.
    Default(Literal),
    /// A value at times without samples, and values by time code in ascending order.
    Samples(Literal, Vec<(f64, Literal)>),
    /// Path of the property to which an attribute is connected.
    Connection(String),
    /// Path of the prim that a relationship targets.
    Target(String),
}

/// A property of a prim.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Property {
    /// Words before the name: `custom double`, `uniform token`, `rel`.
    pub declaration: &'static str,
    /// Name with its namespaces.
    pub name: String,
    /// Content.
    pub content: Content,
}

impl Property {
    /// Creates an attribute with one value.
    pub(crate) fn new(declaration: &'static str, name: impl Into<String>, value: Literal) -> Self {
        Self { declaration, name: name.into(), content: Content::Default(value) }
    }

    /// Creates an output that is only declared.
    pub(crate) fn output(declaration: &'static str, name: impl Into<String>) -> Self {
        Self { declaration, name: name.into(), content: Content::Declared }
    }

    /// Creates an attribute that is connected to another one.
    pub(crate) fn connected(declaration: &'static str, name: impl Into<String>, to: impl Into<String>) -> Self {
        Self { declaration, name: name.into(), content: Content::Connection(to.into()) }
    }

    /// Creates a relationship to one prim.
    pub(crate) fn relationship(declaration: &'static str, name: impl Into<String>, target: impl Into<String>) -> Self {
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
                if *default != Literal::Blocked {
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
pub(crate) struct VariantSet {
    /// Name of the set.
    pub name: &'static str,
    /// Name of the variant that is selected.
    pub selected: &'static str,
    /// Variants in the order in which they are written.
    pub variants: Vec<Variant>,
}

/// A variant: properties and prims that it adds to a prim.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Variant {
    /// Name of the variant.
    pub name: &'static str,
    /// Properties.
    pub properties: Vec<Property>,
    /// Prims beneath.
    pub children: Vec<PrimText>,
}

/// A prim with what lies beneath it.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct PrimText {
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
    pub children: Vec<PrimText>,
}

impl PrimText {
    /// Creates a prim without properties.
    pub(crate) fn new(kind: &'static str, name: impl Into<String>) -> Self {
        Self { kind, name: name.into(), ..Self::default() }
    }

    /// Adds an attribute with one value.
    pub(crate) fn set(&mut self, declaration: &'static str, name: impl Into<String>, value: Literal) -> &mut Self {
        self.properties.push(Property::new(declaration, name, value));
        self
    }

    /// Writes the prim as lines of text, indented by so many blanks.
    pub(crate) fn write(&self, out: &mut String, indent: usize) {
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
    fn prims_are_nested() {
        let mut prim = PrimText::new("Xform", "World");
        prim.set("custom double", "cumulo:densityScale", Literal::Number(2.0));
        let samples = vec![(1.0, Literal::Int(1)), (4.0, Literal::Blocked)];
        prim.properties.push(Property {
            declaration: "int",
            name: "a".into(),
            content: Content::Samples(Literal::Int(1), samples),
        });
        prim.children.push(PrimText::new("Scope", "inner"));
        prim.variants.push(VariantSet {
            name: "r",
            selected: "x",
            variants: vec![Variant { name: "x", ..Variant::default() }],
        });
        let mut text = String::new();
        prim.write(&mut text, 0);
        let expected = "def Xform \"World\" (\n    variants = {\n        string r = \"x\"\n    }\n    \
                        prepend variantSets = [\"r\"]\n)\n{\n    custom double cumulo:densityScale = 2\n    \
                        int a = 1\n    int a.timeSamples = {\n        1: 1,\n        4: None,\n    }\n    \
                        variantSet \"r\" = {\n        \"x\" {\n        }\n    }\n\n    \
                        def Scope \"inner\"\n    {\n    }\n}\n";
        assert_eq!(text, expected);
    }
}
