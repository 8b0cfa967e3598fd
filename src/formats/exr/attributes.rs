//! Header attributes as text.

use exr::meta::attribute::{AttributeValue, Text};

/// Names of attributes that describe the storage, not the picture; they have fields of their own.
const STORAGE: [&str; 14] = [
    "channels",
    "compression",
    "dataWindow",
    "displayWindow",
    "lineOrder",
    "tiles",
    "type",
    "name",
    "version",
    "chunkCount",
    "maxSamplesPerPixel",
    "pixelAspectRatio",
    "screenWindowCenter",
    "screenWindowWidth",
];

/// Text of bytes, which OpenEXR 3 defines as UTF-8; invalid bytes become replacement characters.
pub(super) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Attributes of a part that do not describe its storage, as text. Numbers of vectors and matrices (row by row) are
/// separated by blanks.
pub(super) fn all(header: &exr::meta::header::Header) -> impl Iterator<Item = (String, String)> + '_ {
    header
        .all_named_attributes()
        .map(|(name, value)| (text(name), value))
        .filter(|(name, _)| !STORAGE.contains(&name.as_str()))
        .map(|(name, value)| (name, displayed(&value)))
}

fn displayed(value: &AttributeValue) -> String {
    fn joined<T: ToString>(values: &[T]) -> String {
        values.iter().map(T::to_string).collect::<Vec<_>>().join(" ")
    }
    let names = |list: &[Text]| list.iter().map(|t| text(t.as_slice())).collect::<Vec<_>>().join(", ");
    match value {
        AttributeValue::Text(t) => text(t.as_slice()),
        AttributeValue::TextVector(list) => names(list),
        AttributeValue::F32(v) => v.to_string(),
        AttributeValue::F64(v) => v.to_string(),
        AttributeValue::I32(v) => v.to_string(),
        AttributeValue::Rational((a, b)) => format!("{a}/{b}"),
        AttributeValue::IntVec2(v) => joined(&[v.0, v.1]),
        AttributeValue::FloatVec2(v) => joined(&[v.0, v.1]),
        AttributeValue::IntVec3(v) => joined(&[v.0, v.1, v.2]),
        AttributeValue::FloatVec3(v) => joined(&[v.0, v.1, v.2]),
        AttributeValue::Matrix3x3(m) => joined(m),
        AttributeValue::Matrix4x4(m) => joined(m),
        AttributeValue::IntegerBounds(b) => {
            format!("{}x{} at ({}, {})", b.size.0, b.size.1, b.position.0, b.position.1)
        }
        AttributeValue::FloatRect(r) => joined(&[r.min.0, r.min.1, r.max.0, r.max.1]),
        AttributeValue::Chromaticities(c) => {
            joined(&[c.red.0, c.red.1, c.green.0, c.green.1, c.blue.0, c.blue.1, c.white.0, c.white.1])
        }
        AttributeValue::TimeCode(t) => format!("{:02}:{:02}:{:02}:{:02}", t.hours, t.minutes, t.seconds, t.frame),
        AttributeValue::Preview(p) => format!("{}x{} preview", p.size.0, p.size.1),
        AttributeValue::Bytes { type_hint, bytes } => {
            format!("{} bytes of {}", bytes.len(), text(type_hint.as_slice()))
        }
        AttributeValue::Custom { kind, bytes } => format!("{} bytes of {}", bytes.len(), text(kind.as_slice())),
        other => format!("{other:?}"),
    }
}
