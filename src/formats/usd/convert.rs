//! Values of the crate `openusd` as this program's.

use super::value::{Asset, MOST_ELEMENTS, Value};
use glam::DMat4;
use openusd::ar::{DefaultResolver, ResolvedPath, Resolver};
use openusd::sdf;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Returns the path of an asset from the layer that states it.
pub(super) fn asset(authored: &str, layer: &Path) -> Asset {
    // A path in backticks is an expression of variables.
    let unknown = authored.is_empty() || authored.starts_with('`');
    let anchored = || DefaultResolver::new().create_identifier(authored, Some(&ResolvedPath::new(layer)));
    let path = if unknown { PathBuf::new() } else { PathBuf::from(anchored()) };
    Asset { authored: authored.to_owned(), path }
}

/// Returns a value; paths of files are found from `layer`. `None` if it is blocked.
pub(super) fn value(value: sdf::Value, layer: &Path) -> Option<Value> {
    use sdf::Value as V;
    let numbers = |v: Vec<f64>| Value::Tuple(v);
    Some(match value {
        V::None | V::ValueBlock | V::Value => return None,
        V::Bool(v) => Value::Bool(v),
        V::Uchar(v) => Value::Int(v.into()),
        V::Int(v) => Value::Int(v.into()),
        V::Uint(v) => Value::Int(v.into()),
        V::Int64(v) => Value::Int(v),
        V::Uint64(v) => Value::Int(v.try_into().unwrap_or(i64::MAX)),
        V::Half(v) => Value::Number(v.to_f64()),
        V::Float(v) => Value::Number(v.into()),
        V::Double(v) => Value::Number(v),
        V::TimeCode(v) => Value::Number(v.0),
        V::String(v) | V::PathExpression(v) => Value::Text(v),
        V::Token(v) => Value::Text(v.as_str().to_owned()),
        V::AssetPath(v) => Value::Asset(asset(v.as_str(), layer)),
        V::Quath(q) => numbers([q.w, q.x, q.y, q.z].map(|v| v.to_f64()).to_vec()),
        V::Quatf(q) => numbers([q.w, q.x, q.y, q.z].map(f64::from).to_vec()),
        V::Quatd(q) => numbers(vec![q.w, q.x, q.y, q.z]),
        V::Vec2h(v) => numbers([v.x, v.y].map(|v| v.to_f64()).to_vec()),
        V::Vec2f(v) => numbers([v.x, v.y].map(f64::from).to_vec()),
        V::Vec2d(v) => numbers(vec![v.x, v.y]),
        V::Vec2i(v) => numbers([v.x, v.y].map(f64::from).to_vec()),
        V::Vec3h(v) => numbers([v.x, v.y, v.z].map(|v| v.to_f64()).to_vec()),
        V::Vec3f(v) => numbers([v.x, v.y, v.z].map(f64::from).to_vec()),
        V::Vec3d(v) => numbers(vec![v.x, v.y, v.z]),
        V::Vec3i(v) => numbers([v.x, v.y, v.z].map(f64::from).to_vec()),
        V::Vec4h(v) => numbers([v.x, v.y, v.z, v.w].map(|v| v.to_f64()).to_vec()),
        V::Vec4f(v) => numbers([v.x, v.y, v.z, v.w].map(f64::from).to_vec()),
        V::Vec4d(v) => numbers(vec![v.x, v.y, v.z, v.w]),
        V::Vec4i(v) => numbers([v.x, v.y, v.z, v.w].map(f64::from).to_vec()),
        V::Matrix2d(m) => numbers(m.0.to_vec()),
        V::Matrix3d(m) => numbers(m.0.to_vec()),
        // Rows of a map of row vectors are the columns of one of column vectors.
        V::Matrix4d(m) => Value::Matrix(DMat4::from_cols_array(&m.0)),
        V::Dictionary(entries) => {
            Value::Dictionary(entries.into_iter().filter_map(|(key, v)| Some((key, self::value(v, layer)?))).collect())
        }
        other => return Some(list(other, layer)),
    })
}

/// Returns an array.
fn list(array: sdf::Value, layer: &Path) -> Value {
    use sdf::Value as V;
    fn each<T>(items: Vec<T>, of: impl Fn(T) -> V, layer: &Path) -> Value {
        if items.len() > MOST_ELEMENTS {
            return Value::Other("a long array");
        }
        Value::List(items.into_iter().filter_map(|item| value(of(item), layer)).collect())
    }
    match array {
        V::Vec3fVec(v) if v.len() > MOST_ELEMENTS => {
            Value::Points(Arc::new(v.into_iter().map(|v| [v.x, v.y, v.z]).collect()))
        }
        V::IntVec(v) if v.len() > MOST_ELEMENTS => Value::Integers(Arc::new(v)),
        V::BoolVec(v) => each(v, V::Bool, layer),
        V::UcharVec(v) => each(v, V::Uchar, layer),
        V::IntVec(v) => each(v, V::Int, layer),
        V::UintVec(v) => each(v, V::Uint, layer),
        V::Int64Vec(v) => each(v, V::Int64, layer),
        V::Uint64Vec(v) => each(v, V::Uint64, layer),
        V::HalfVec(v) => each(v, V::Half, layer),
        V::FloatVec(v) => each(v, V::Float, layer),
        V::DoubleVec(v) => each(v, V::Double, layer),
        V::TimeCodeVec(v) => each(v, V::TimeCode, layer),
        V::StringVec(v) => each(v, V::String, layer),
        V::TokenVec(v) => each(v, V::Token, layer),
        V::AssetPathVec(v) => each(v, V::AssetPath, layer),
        V::QuathVec(v) => each(v, V::Quath, layer),
        V::QuatfVec(v) => each(v, V::Quatf, layer),
        V::QuatdVec(v) => each(v, V::Quatd, layer),
        V::Vec2hVec(v) => each(v, V::Vec2h, layer),
        V::Vec2fVec(v) => each(v, V::Vec2f, layer),
        V::Vec2dVec(v) => each(v, V::Vec2d, layer),
        V::Vec2iVec(v) => each(v, V::Vec2i, layer),
        V::Vec3hVec(v) => each(v, V::Vec3h, layer),
        V::Vec3fVec(v) => each(v, V::Vec3f, layer),
        V::Vec3dVec(v) => each(v, V::Vec3d, layer),
        V::Vec3iVec(v) => each(v, V::Vec3i, layer),
        V::Vec4hVec(v) => each(v, V::Vec4h, layer),
        V::Vec4fVec(v) => each(v, V::Vec4f, layer),
        V::Vec4dVec(v) => each(v, V::Vec4d, layer),
        V::Vec4iVec(v) => each(v, V::Vec4i, layer),
        V::Matrix4dVec(v) => each(v, V::Matrix4d, layer),
        V::ValueVec(v) => each(v, |v| v, layer),
        other => Value::Other((&other).into()),
    }
}

/// Returns a value as its attribute's type has it: text has whole numbers where numbers are meant, and the paths of
/// files among time samples reach the parser as strings.
pub(super) fn typed(value: Value, type_name: &str, layer: &Path) -> Value {
    let base = type_name.strip_suffix("[]").unwrap_or(type_name);
    match value {
        Value::Int(v) if ["half", "float", "double", "timecode"].contains(&base) => Value::Number(v as f64),
        Value::Text(v) if base == "asset" => Value::Asset(asset(&v, layer)),
        Value::List(items) => Value::List(items.into_iter().map(|item| typed(item, base, layer)).collect()),
        value => value,
    }
}
