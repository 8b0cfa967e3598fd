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
