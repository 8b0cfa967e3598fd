//! Prims of a stage.

use super::attribute::Attribute;
use super::value::Value;
use std::collections::BTreeMap;

/// A prim of a stage with its composed opinions.
#[derive(Debug, Clone, PartialEq)]
pub struct Prim {
    /// Absolute path, such as `/World/Smoke`.
    pub path: String,
    /// Type such as `Volume` or `Camera`; empty if none is stated.
    pub type_name: String,
    /// Names of applied API schemas, such as `ShapingAPI`.
    pub schemas: Vec<String>,
    /// Attributes by their names. Of curves and points only the transform and visibility are kept, of meshes the
    /// polygons, too. They are boxed, as a tree has room for eleven values where there is one.
    pub attributes: BTreeMap<String, Box<Attribute>>,
    /// Targets of relationships, as absolute paths, by the relationships' names.
    pub relationships: BTreeMap<String, Vec<String>>,
    /// Custom data: a dictionary, if there is one.
    pub custom_data: Option<Value>,
    /// True if the prim lies in an instance: its opinions are those of the prototype.
    pub instanced: bool,
}

impl Prim {
    /// True if a type is stated. Prims without one have neither a transform, nor a visibility, nor a purpose.
    pub(crate) fn is_typed(&self) -> bool {
        !self.type_name.is_empty()
    }

    /// Returns the last part of the path.
    pub(crate) fn name(&self) -> &str {
        self.path.rsplit('/').next().unwrap_or_default()
    }

    /// Returns the path of the parent; `None` for a root prim.
    pub(crate) fn parent(&self) -> Option<&str> {
        self.path.rsplit_once('/').map(|(parent, _)| parent).filter(|parent| !parent.is_empty())
    }

    /// Returns an attribute by its name.
    pub fn attribute(&self, name: &str) -> Option<&Attribute> {
        self.attributes.get(name).map(Box::as_ref)
    }

    /// Returns the value of an attribute at a time code; `None` if it has none.
    pub fn value(&self, name: &str, time: f64) -> Option<Value> {
        self.attributes.get(name)?.at(time)
    }

    /// Returns a number at a time code.
    pub fn number(&self, name: &str, time: f64) -> Option<f64> {
        self.value(name, time)?.number()
    }

    /// Returns a truth value at a time code.
    pub fn bool(&self, name: &str, time: f64) -> Option<bool> {
        self.value(name, time)?.bool()
    }

    /// Returns a string or token at a time code.
    pub fn text(&self, name: &str, time: f64) -> Option<String> {
        self.value(name, time)?.text().map(str::to_owned)
    }

    /// Returns a tuple of `N` numbers at a time code.
    pub fn tuple<const N: usize>(&self, name: &str, time: f64) -> Option<[f64; N]> {
        self.value(name, time)?.tuple()
    }

    /// Returns the targets of a relationship; none if there is no such relationship.
    pub fn targets(&self, name: &str) -> &[String] {
        self.relationships.get(name).map_or(&[], Vec::as_slice)
    }
}
