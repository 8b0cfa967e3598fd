//! Meshes of simple shapes, as files.

use glam::DVec3;
use std::fmt::Write;
use std::path::Path;

/// Triangles by their corners.
pub type Triangles = Vec<[DVec3; 3]>;

/// A parallelogram of two triangles.
pub fn quad(corner: DVec3, u: DVec3, v: DVec3) -> Triangles {
    let [a, b, c, d] = [corner, corner + u, corner + u + v, corner + v];
    vec![[a, b, c], [a, c, d]]
}

/// The walls of a box.
pub fn walls(low: DVec3, high: DVec3) -> Triangles {
    let [x, y, z] = DVec3::AXES.map(|axis| axis * (high - low));
    let walls = [(low, x, y), (low, x, z), (low, y, z), (high, -x, -y), (high, -x, -z), (high, -y, -z)];
    walls.into_iter().flat_map(|(corner, u, v)| quad(corner, u, v)).collect()
}

/// A sphere of triangles, `rows` from pole to pole.
pub fn ball(centre: DVec3, radius: f64, rows: u32) -> Triangles {
    let at = |row: u32, column: u32| {
        let (sine, cosine) = (std::f64::consts::PI * f64::from(row) / f64::from(rows)).sin_cos();
        let (y, x) = (std::f64::consts::PI * f64::from(column) / f64::from(rows)).sin_cos();
        centre + radius * DVec3::new(sine * x, sine * y, cosine)
    };
    let pair = |(row, column): (u32, u32)| {
        let [a, b, c, d] = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[i, j]| at(row + i, column + j));
        [[a, b, c], [a, c, d]]
    };
    (0..rows).flat_map(|row| (0..2 * rows).map(move |column| (row, column))).flat_map(pair).collect()
}

/// Writes triangles as PLY in text.
pub fn write_ply(path: &Path, triangles: &Triangles) {
    let count = triangles.len();
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", 3 * count);
    for axis in ["x", "y", "z"] {
        let _ = writeln!(text, "property double {axis}");
    }
    let _ = writeln!(text, "element face {count}\nproperty list uchar int vertex_indices\nend_header");
    for DVec3 { x, y, z } in triangles.iter().flatten() {
        let _ = writeln!(text, "{x} {y} {z}");
    }
    for i in 0..count {
        let _ = writeln!(text, "3 {} {} {}", 3 * i, 3 * i + 1, 3 * i + 2);
    }
    std::fs::write(path, text).unwrap();
}

/// A scene in glTF: a box of triangles without indices, moved by its node, and within that node a tetrahedron of a strip
/// and a fan with indices of 8 and 16 bits, turned and scaled. `uri` says where the buffer lies: [`None`] for the file
/// itself, in binary form.
pub fn gltf(uri: Option<&str>) -> (Vec<u8>, Vec<u8>) {
    let mut triangles = walls(DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0));
    // All face outwards.
    (0..12).filter(|i| i / 2 % 2 == 0).for_each(|i| triangles[i].swap(1, 2));
    let mut buffer: Vec<u8> = Vec::new();
    let mut put = |bytes: &[u8]| {
        let start = buffer.len();
        buffer.extend_from_slice(bytes);
        buffer.resize(buffer.len().next_multiple_of(4), 0);
        serde_json::json!({"buffer": 0, "byteOffset": start, "byteLength": bytes.len()})
    };
    let floats = |corners: &mut dyn Iterator<Item = DVec3>| -> Vec<u8> {
        corners.flat_map(|at| at.as_vec3().to_array()).flat_map(f32::to_le_bytes).collect()
    };
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let views = [
        put(&floats(&mut triangles.iter().flatten().copied())),
        put(&floats(&mut corners.into_iter())),
        // The strip has two faces, and the fan about the last corner the others.
        put(&[0, 2, 1, 3]),
        put(&[3_u16, 2, 0, 0, 1, 1].map(u16::to_le_bytes).concat()),
    ];
    let accessor = |view: usize, kind: u32, shape: &str, count: usize| {
        serde_json::json!({"bufferView": view, "componentType": kind, "type": shape, "count": count,
            "min": [0.0, 0.0, 0.0], "max": [3.0, 3.0, 3.0]})
    };
    let accessors = [
        accessor(0, 5126, "VEC3", 3 * triangles.len()),
        accessor(1, 5126, "VEC3", 4),
        accessor(2, 5121, "SCALAR", 4),
        accessor(3, 5123, "SCALAR", 6),
    ];
    let mut document = serde_json::json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": [10, 0, 0], "children": [1]},
            {"mesh": 1, "matrix": [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 0, 20, 0, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]},
            {"primitives": [{"attributes": {"POSITION": 1}, "indices": 2, "mode": 5},
                {"attributes": {"POSITION": 1}, "indices": 3, "mode": 6}, {"attributes": {"POSITION": 1}, "mode": 1}]}],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": buffer.len()}]
    });
    if let Some(uri) = uri {
        document["buffers"][0]["uri"] = uri.into();
        return (document.to_string().into_bytes(), buffer);
    }
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let word = |number: usize| (number as u32).to_le_bytes();
    let head = [&b"glTF"[..], &word(2), &word(28 + json.len() + buffer.len())].concat();
    let chunks = [&word(json.len())[..], b"JSON", &json, &word(buffer.len()), b"BIN\0", &buffer].concat();
    ([head, chunks].concat(), buffer)
}
