//! Values of attributes and metadata.

use glam::{DMat4, DVec3};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A value of an attribute or of metadata.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// A truth value.
    Bool(bool),
    /// An integer of any width; those beyond the range are held at its ends.
    Int(i64),
    /// A floating-point number of any width, or a time code.
    Number(f64),
    /// A string or a token.
    Text(String),
    /// The path of a file.
    Asset(Asset),
    /// A vector of 2 to 4 numbers, a quaternion with its real part first, or a matrix of 2x2 or 3x3 row by row.
    Tuple(Vec<f64>),
    /// A 4x4 matrix, as a map of column vectors: the transpose of what the stage holds.
    Matrix(DMat4),
    /// An array.
    List(Vec<Value>),
    /// A long array of vectors in single precision, such as the points of a mesh.
    Points(Arc<Vec<[f32; 3]>>),
    /// A long array of integers, such as the corners of a mesh.
    Integers(Arc<Vec<i32>>),
    /// A dictionary.
    Dictionary(BTreeMap<String, Value>),
    /// A value that is not read, by the name of its kind: another array of more than `MOST_ELEMENTS` elements, or a
    /// kind that no attribute has.
    Other(&'static str),
}

/// Largest number of elements of a [`Value::List`].
pub(crate) const MOST_ELEMENTS: usize = 4096;

/// The path of a file, as a layer states it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Asset {
    /// Path as the layer states it, such as `./smoke.0001.vdb`.
    pub authored: String,
    /// Path from the folder of the layer that states it, absolute; `PACKAGE.usdz[PATH]` within a package. Empty where
    /// the stated path is empty or is a variable expression.
    pub path: PathBuf,
}

impl Asset {
    /// Splits a path within a package into that of the package and that within it.
    pub(crate) fn packaged(&self) -> Option<(&Path, &str)> {
        let text = self.path.to_str()?.strip_suffix(']')?;
        let at = text.to_ascii_lowercase().find(".usdz[")?;
        Some((Path::new(&text[..at + 5]), &text[at + 6..]))
    }
}

impl Value {
    /// Returns a number, from an integer too.
    pub(crate) fn number(&self) -> Option<f64> {
        match self {
            Self::Number(v) => Some(*v),
            Self::Int(v) => Some(*v as f64),
            _ => None,
        }
    }

    /// Returns a truth value, from an integer too.
    pub(crate) fn bool(&self) -> Option<bool> {
        match self {
            Self::Bool(v) => Some(*v),
            Self::Int(v) => Some(*v != 0),
            _ => None,
        }
    }

    /// Returns an integer.
    pub(crate) fn int(&self) -> Option<i64> {
        if let Self::Int(v) = self { Some(*v) } else { None }
    }

    /// Returns a string or token.
    pub fn text(&self) -> Option<&str> {
        if let Self::Text(v) = self { Some(v) } else { None }
    }

    /// Returns the path of a file.
    pub fn asset(&self) -> Option<&Asset> {
        if let Self::Asset(v) = self { Some(v) } else { None }
    }

    /// Returns the `N` numbers of a tuple.
    pub fn tuple<const N: usize>(&self) -> Option<[f64; N]> {
        if let Self::Tuple(v) = self { v.as_slice().try_into().ok() } else { None }
    }

    /// Returns a 4x4 matrix.
    pub(crate) fn matrix(&self) -> Option<DMat4> {
        if let Self::Matrix(v) = self { Some(*v) } else { None }
    }

    /// Returns the elements of an array.
    pub fn list(&self) -> Option<&[Self]> {
        if let Self::List(v) = self { Some(v) } else { None }
    }

    /// Returns the vectors of an array of any length; `None` for other values.
    pub(crate) fn points(&self) -> Option<Vec<DVec3>> {
        match self {
            Self::Points(points) => Some(points.iter().map(|at| DVec3::from_array(at.map(f64::from))).collect()),
            Self::List(points) => points.iter().map(|at| at.tuple().map(DVec3::from_array)).collect(),
            _ => None,
        }
    }

    /// Returns the integers of an array of any length; `None` for other values.
    pub(crate) fn integers(&self) -> Option<Vec<i64>> {
        match self {
            Self::Integers(all) => Some(all.iter().copied().map(i64::from).collect()),
            Self::List(all) => all.iter().map(Self::int).collect(),
            _ => None,
        }
    }

    /// Returns the strings or tokens of an array; elements of other kinds are left out.
    pub(crate) fn texts(&self) -> Vec<&str> {
        self.list().unwrap_or_default().iter().filter_map(Self::text).collect()
    }

    /// Returns an entry of a dictionary, and of dictionaries within it where the key has colons: `a:b` is `b` in `a`.
    pub fn entry(&self, key: &str) -> Option<&Self> {
        let Self::Dictionary(entries) = self else { return None };
        entries.get(key).or_else(|| {
            let (outer, inner) = key.split_once(':')?;
            entries.get(outer)?.entry(inner)
        })
    }

    /// Returns the value between two, at a share of the way from the first; `None` for kinds that are held.
    /// `turns` is true for quaternions, which turn at a constant rate.
    pub(super) fn between(&self, other: &Self, share: f64, turns: bool) -> Option<Self> {
        let mix = |a: f64, b: f64| a + share * (b - a);
        Some(match (self, other) {
            (Self::Number(a), Self::Number(b)) => Self::Number(mix(*a, *b)),
            (Self::Tuple(a), Self::Tuple(b)) if turns && a.len() == 4 && b.len() == 4 => {
                let quaternion = |v: &[f64]| glam::DQuat::from_xyzw(v[1], v[2], v[3], v[0]);
                let q = quaternion(a).slerp(quaternion(b), share);
                Self::Tuple(vec![q.w, q.x, q.y, q.z])
            }
            (Self::Tuple(a), Self::Tuple(b)) if a.len() == b.len() => {
                Self::Tuple(a.iter().zip(b).map(|(a, b)| mix(*a, *b)).collect())
            }
            (Self::Matrix(a), Self::Matrix(b)) => Self::Matrix(*a + (*b - *a) * share),
            (Self::List(a), Self::List(b)) if a.len() == b.len() => {
                Self::List(a.iter().zip(b).map(|(a, b)| a.between(b, share, turns)).collect::<Option<_>>()?)
            }
            (Self::Points(a), Self::Points(b)) if a.len() == b.len() => {
                let mixed = a
                    .iter()
                    .zip(b.iter())
                    .map(|(a, b)| [0, 1, 2].map(|axis| mix(a[axis].into(), b[axis].into()) as f32));
                Self::Points(Arc::new(mixed.collect()))
            }
            _ => return None,
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn paths_in_packages_are_split() {
        let asset = |path: &str| Asset { authored: String::new(), path: path.into() };
        assert_eq!(asset("/a/b.usdz[c/d.vdb]").packaged(), Some((Path::new("/a/b.usdz"), "c/d.vdb")));
        assert_eq!(asset("/a/B.USDZ[C.vdb]").packaged(), Some((Path::new("/a/B.USDZ"), "C.vdb")));
        assert_eq!(asset("/a/b[1].vdb").packaged(), None);
        assert_eq!(asset("/a/b.vdb").packaged(), None);
    }

    #[test]
    fn keys_reach_into_dictionaries() {
        let inner = Value::Dictionary(BTreeMap::from([("scale".into(), Value::Number(2.0))]));
        let outer = Value::Dictionary(BTreeMap::from([("cumulo".into(), inner), ("a:b".into(), Value::Int(1))]));
        assert_eq!(outer.entry("cumulo:scale").unwrap().number(), Some(2.0));
        assert_eq!(outer.entry("a:b").unwrap().number(), Some(1.0));
        assert_eq!(outer.entry("cumulo:other"), None);
    }

    #[test]
    fn quaternions_turn_at_a_constant_rate() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let (start, end) = (Value::Tuple(vec![1.0, 0.0, 0.0, 0.0]), Value::Tuple(vec![half, half, 0.0, 0.0]));
        let [w, x, ..] = start.between(&end, 1.0 / 3.0, true).unwrap().tuple::<4>().unwrap();
        // A third of a quarter turn is 30 degrees, half of which the quaternion has.
        assert!((2.0 * x.atan2(w) - 30_f64.to_radians()).abs() < 1e-12);
    }
}
