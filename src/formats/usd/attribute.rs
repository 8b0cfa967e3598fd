//! Attributes of prims, and their values over time.

use super::value::Value;
use std::path::PathBuf;

/// An attribute of a prim.
#[derive(Debug, Clone, PartialEq)]
pub struct Attribute {
    /// Name with its namespaces, such as `inputs:intensity`.
    pub name: String,
    /// Name of its type, such as `float3` or `asset`.
    pub type_name: String,
    /// Value that holds where there are no samples.
    pub default: Option<Value>,
    /// Time codes, ascending, and values; `None` where the value is blocked.
    pub samples: Vec<(f64, Option<Value>)>,
    /// Paths of the attributes that it is connected to.
    pub connections: Vec<String>,
    /// File of the strongest layer with an opinion on an attribute of type `asset` or `asset[]`; empty for others.
    pub layer: PathBuf,
}

impl Attribute {
    /// Returns the value at a time code, as OpenUSD does: floating-point numbers, vectors and matrices are linear
    /// between samples, quaternions turn at a constant rate, everything else is held from one sample to the next.
    /// Before the first sample its value holds, and after the last one the last.
    pub fn at(&self, time: f64) -> Option<Value> {
        let Some((first, value)) = self.samples.first() else { return self.default.clone() };
        let next = self.samples.partition_point(|(at, _)| *at <= time);
        if next == 0 || time.is_nan() || time <= *first {
            return value.clone();
        }
        let (before, value) = &self.samples[next - 1];
        let Some((after, other)) = self.samples.get(next) else { return value.clone() };
        let share = (time - before) / (after - before);
        let turns = self.type_name.starts_with("quat");
        let held = self.type_name.starts_with("int");
        match (value, other) {
            (Some(value), Some(other)) if share > 0.0 && !held => {
                value.between(other, share, turns).or_else(|| Some(value.clone()))
            }
            (value, _) => value.clone(),
        }
    }

    /// Returns the value that holds at a time code: that of the last sample at or before it, whatever its kind.
    pub fn held_at(&self, time: f64) -> Option<Value> {
        let Some((_, first)) = self.samples.first() else { return self.default.clone() };
        let next = self.samples.partition_point(|(at, _)| *at <= time);
        next.checked_sub(1).map_or(first, |last| &self.samples[last].1).clone()
    }

    /// True if the value may change over time.
    pub(crate) fn is_animated(&self) -> bool {
        self.samples.len() > 1
    }

    /// Returns the time codes of the samples.
    pub fn times(&self) -> impl Iterator<Item = f64> + '_ {
        self.samples.iter().map(|(time, _)| *time)
    }

    /// Returns all values that the attribute takes at some time: those of its samples, else the default.
    pub(crate) fn values(&self) -> impl Iterator<Item = &Value> + '_ {
        let default = self.default.as_ref().filter(|_| self.samples.is_empty());
        self.samples.iter().filter_map(|(_, value)| value.as_ref()).chain(default)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    fn sampled(samples: Vec<(f64, Option<Value>)>) -> Attribute {
        Attribute {
            name: "a".into(),
            type_name: "double".into(),
            default: Some(Value::Number(-1.0)),
            samples,
            connections: Vec::new(),
            layer: PathBuf::new(),
        }
    }

    #[test]
    fn numbers_are_linear_and_others_held() {
        let number = |v: f64| Some(Value::Number(v));
        let a = sampled(vec![(1.0, number(10.0)), (3.0, number(20.0)), (4.0, None), (5.0, number(7.0))]);
        let at = |time| a.at(time).and_then(|v| v.number());
        assert_eq!([at(-5.0), at(1.0), at(1.5), at(3.0)], [Some(10.0), Some(10.0), Some(12.5), Some(20.0)]);
        // Next to a blocked sample the value is held, and is none from there on.
        assert_eq!([at(3.5), at(4.0), at(4.5), at(5.0), at(99.0)], [Some(20.0), None, None, Some(7.0), Some(7.0)]);
        let text = |v: &str| Some(Value::Text(v.into()));
        let a = sampled(vec![(1.0, text("x")), (2.0, text("y"))]);
        assert_eq!(
            ["x", "x", "x", "y", "y"],
            [0.0, 1.0, 1.9, 2.0, 3.0].map(|t| a.at(t).unwrap().text().unwrap().to_owned())
        );
        assert_eq!(sampled(Vec::new()).at(7.0).unwrap().number(), Some(-1.0));
    }
}
