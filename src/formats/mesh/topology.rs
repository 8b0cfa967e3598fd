//! What a mesh encloses: its edges, its area and its volume.

use super::Mesh;
use crate::math::Aabb;
use earcut::utils3d::project3d_to_2d;
use earcut::{Earcut, deviation};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};

/// Bytes for each corner of a polygon, its edge, and for each vertex, its place in a table, while edges are counted.
pub(crate) const CORNER_BYTES: u64 = 16;
pub(crate) const VERTEX_BYTES: u64 = 120;

/// Largest difference of the area of triangles from that of the polygon that they fill, as a share of it.
const MOST_DEVIATION: f64 = 1e-6;

/// Measures of the surface of a mesh, and of what it encloses.
#[derive(Debug, Clone, Copy, serde::Serialize, schemars::JsonSchema)]
pub struct Enclosure {
    /// Number of edges at which the surface ends: those of an odd number of polygons.
    pub open_edges: usize,
    /// Number of edges that two polygons pass in one direction, so that one of them faces inwards.
    pub turned_edges: usize,
    /// Number of shells: parts of the surface that share no vertex with others.
    pub shells: usize,
    /// Number of shells whose polygons face inwards, as those of cavities do.
    pub inward_shells: usize,
    /// Area of the polygons in square world units.
    pub area: f64,
    /// Volume in cubic world units, positive if the polygons face outwards.
    pub volume: f64,
}

/// A part of the surface that shares no vertex with others.
#[derive(Debug, Default)]
struct Shell {
    area: f64,
    volume: f64,
}

/// Trees of vertices that polygons join, by the parent of each vertex; that of a root is the root itself.
struct Forest(Vec<u32>);

impl Forest {
    /// Returns the root of a vertex' tree, and shortens the way to it.
    fn root(&mut self, mut vertex: u32) -> u32 {
        loop {
            let parent = self.0[vertex as usize];
            if parent == vertex {
                return vertex;
            }
            self.0[vertex as usize] = self.0[parent as usize];
            vertex = parent;
        }
    }

    fn join(&mut self, a: u32, b: u32) {
        let [a, b] = [self.root(a), self.root(b)];
        self.0[a.max(b) as usize] = a.min(b);
    }
}

impl Mesh {
    /// Numbers of the vertices, equal for those of equal positions: programs part vertices along seams.
    fn welded(&self) -> Vec<u32> {
        let mut first = HashMap::with_capacity(self.vertices.len());
        let key = |v: &DVec3| (*v + 0.0).to_array().map(f64::to_bits);
        self.vertices.iter().enumerate().map(|(i, v)| *first.entry(key(v)).or_insert(i as u32)).collect()
    }

    /// Box around the vertices.
    pub(crate) fn bounds(&self) -> Aabb {
        self.vertices.iter().fold(Aabb::EMPTY, |b, v| b.including(*v))
    }

    /// Returns what the mesh encloses. Vertices of equal positions count as one.
    pub(crate) fn enclosure(&self) -> Enclosure {
        let welded = self.welded();
        let mut edges = Vec::with_capacity(self.corners.len());
        for polygon in self.polygons() {
            for (i, corner) in polygon.iter().enumerate() {
                let [a, b] = [*corner, polygon[(i + 1) % polygon.len()]].map(|c| welded[c as usize]);
                if a != b {
                    // The edge, then the direction in which it is passed.
                    edges.push((u64::from(a.min(b)) << 32 | u64::from(a.max(b)), a < b));
                }
            }
        }
        edges.par_sort_unstable();
        let (mut open_edges, mut turned_edges) = (0, 0);
        for uses in edges.chunk_by(|a, b| a.0 == b.0) {
            let ascending = uses.iter().filter(|(_, ascending)| *ascending).count();
            open_edges += uses.len() % 2;
            turned_edges += usize::from(uses.len() % 2 == 0 && 2 * ascending != uses.len());
        }
        let shells = self.shells(welded);
        // Rounding gives flat shells a volume of either sign.
        let least = 1e-9 * self.extent();
        Enclosure {
            open_edges,
            turned_edges,
            shells: shells.len(),
            inward_shells: shells.iter().filter(|shell| shell.volume < -least * shell.area).count(),
            area: shells.iter().map(|shell| shell.area).sum(),
            volume: shells.iter().map(|shell| shell.volume).sum(),
        }
    }

    fn extent(&self) -> f64 {
        let bounds = self.bounds();
        if bounds.is_empty() { 0.0 } else { bounds.size().max_element() }
    }

    /// Areas of the shells, and volumes by the theorem of Gauss, which holds for closed surfaces. `welded` has a number
    /// for each vertex, equal for those that count as one.
    fn shells(&self, welded: Vec<u32>) -> Vec<Shell> {
        let mut forest = Forest(welded);
        for polygon in self.polygons() {
            polygon.iter().for_each(|corner| forest.join(polygon[0], *corner));
        }
        // Near the mesh, or digits of large coordinates would cancel.
        let bounds = self.bounds();
        let centre = if bounds.is_empty() { DVec3::ZERO } else { bounds.centre() };
        let mut shells: BTreeMap<u32, Shell> = BTreeMap::new();
        for corners in self.triangles() {
            let shell = shells.entry(forest.root(corners[0])).or_default();
            let [a, b, c] = corners.map(|corner| self.vertices[corner as usize] - centre);
            shell.area += 0.5 * (b - a).cross(c - a).length();
            shell.volume += a.dot(b.cross(c)) / 6.0;
        }
        shells.into_values().collect()
    }

    /// Triangles of the polygons, each polygon a fan about its first corner.
    pub(crate) fn triangles(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.polygons().flat_map(|polygon| (1..polygon.len() - 1).map(|i| [polygon[0], polygon[i], polygon[i + 1]]))
    }

    /// Triangles and quads of the polygons; those of more corners are fans about their first one. The fourth corner of
    /// a triangle is [`u32::MAX`].
    pub(crate) fn at_most_quads(&self) -> Vec<[u32; 4]> {
        let mut quads = Vec::with_capacity(self.ends.len());
        for polygon in self.polygons() {
            match *polygon {
                [a, b, c, d] => quads.push([a, b, c, d]),
                _ => quads.extend((1..polygon.len() - 1).map(|i| [polygon[0], polygon[i], polygon[i + 1], u32::MAX])),
            }
        }
        quads
    }

    /// Number of polygons that their fans of triangles do not fill: corners that point inwards.
    pub(crate) fn not_convex(&self) -> usize {
        self.polygons().filter(|polygon| !self.is_fan(polygon)).count()
    }

    /// True if the fan of triangles about its first corner fills a polygon.
    fn is_fan(&self, polygon: &[u32]) -> bool {
        let at = |i: usize| self.vertices[polygon[i] as usize];
        let normal = |i: usize| (at(i) - at(0)).cross(at(i + 1) - at(0));
        let sum: DVec3 = (1..polygon.len() - 1).map(normal).sum();
        let inner = 1..polygon.len() - 1;
        let crossed = sum == DVec3::ZERO && inner.clone().any(|i| normal(i) != DVec3::ZERO);
        polygon.len() == 3 || !crossed && inner.into_iter().all(|i| normal(i).dot(sum) >= 0.0)
    }

    /// Triangles that fill the polygons, each with the number of its polygon: by fans, or by cutting off ears of those
    /// that are not convex. `None` if the edges of a polygon cross each other.
    pub(crate) fn filled(&self) -> Option<Vec<(usize, [u32; 3])>> {
        let mut triangles = Vec::with_capacity(self.corners.len().saturating_sub(2 * self.ends.len()));
        let (mut earcut, mut flat, mut ears) = (Earcut::new(), Vec::new(), Vec::<u32>::new());
        for (number, polygon) in self.polygons().enumerate() {
            if self.is_fan(polygon) {
                triangles.extend((1..polygon.len() - 1).map(|i| (number, [polygon[0], polygon[i], polygon[i + 1]])));
                continue;
            }
            // About the origin and of size 1, no digit is lost and no length is too small.
            let first = self.vertices[polygon[0] as usize];
            let offsets: Vec<DVec3> = polygon.iter().map(|corner| self.vertices[*corner as usize] - first).collect();
            let size = offsets.iter().map(|offset| offset.abs().max_element()).fold(0.0, f64::max);
            let corners: Vec<[f64; 3]> = offsets.iter().map(|offset| (*offset / size).to_array()).collect();
            if !project3d_to_2d(&corners, corners.len(), &mut flat) {
                return None;
            }
            earcut.earcut_slice(&flat, &[], &mut ears);
            if deviation(flat.iter().copied(), &[] as &[u32], &ears) > MOST_DEVIATION {
                return None;
            }
            triangles.extend(ears.chunks_exact(3).map(|of| (number, [0, 1, 2].map(|i| polygon[of[i] as usize]))));
        }
        Some(triangles)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube of edge 2 about a place, without the polygons behind `count`.
    fn cube(centre: DVec3, count: u32) -> Mesh {
        let at = |i: u32| centre + DVec3::new(f64::from(i >> 2), f64::from(i >> 1 & 1), f64::from(i & 1)) * 2.0 - 1.0;
        let faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
        let corners = faces.iter().take(count as usize).flatten().copied().collect();
        Mesh { vertices: (0..8).map(at).collect(), corners, ends: (1..=count).map(|i| 4 * i).collect() }
    }

    #[test]
    fn a_cube_encloses_its_volume() {
        // Digits of large coordinates do not cancel.
        for centre in [DVec3::ZERO, DVec3::splat(1e6)] {
            let whole = cube(centre, 6).enclosure();
            assert_eq!((whole.open_edges, whole.turned_edges, whole.area, whole.volume), (0, 0, 24.0, 8.0));
            assert_eq!(cube(centre, 5).enclosure().open_edges, 4);
        }
    }

    #[test]
    fn seams_are_closed_and_turned_polygons_counted() {
        let whole = cube(DVec3::ZERO, 6);
        let vertices = whole.corners.iter().map(|c| whole.vertices[*c as usize]).collect();
        let mut parted = Mesh { vertices, corners: (0..24).collect(), ends: whole.ends.clone() };
        assert_eq!(parted.enclosure().open_edges, 0, "each polygon has vertices of its own");
        // 0 of either sign is one place.
        parted.vertices.iter_mut().for_each(|v| *v += 1.0);
        parted.vertices.iter_mut().skip(4).for_each(|v| v.x = if v.x == 0.0 { -0.0 } else { v.x });
        assert_eq!(parted.enclosure().open_edges, 0);
        parted.corners[..4].reverse();
        let turned = parted.enclosure();
        assert_eq!((turned.open_edges, turned.turned_edges), (0, 4));
    }

    #[test]
    fn shells_that_face_inwards_are_counted() {
        let mut mesh = cube(DVec3::ZERO, 6);
        let add = |mesh: &mut Mesh, centre: f64, edge: f64, inwards: bool| {
            let mut part = cube(DVec3::ZERO, 6);
            if inwards {
                part.corners.reverse();
            }
            let (vertices, corners) = (mesh.vertices.len() as u32, mesh.corners.len() as u32);
            mesh.vertices.extend(part.vertices.iter().map(|v| *v * 0.5 * edge + centre));
            mesh.corners.extend(part.corners.iter().map(|c| c + vertices));
            mesh.ends.extend(part.ends.iter().map(|end| end + corners));
        };
        add(&mut mesh, 0.1, 1.0, true);
        add(&mut mesh, 5.0, 2.0, false);
        let found = mesh.enclosure();
        assert_eq!((found.shells, found.inward_shells, found.open_edges, found.turned_edges), (3, 1, 0, 0));
        assert!((found.volume - (8.0 - 1.0 + 8.0)).abs() < 1e-12, "{found:?}");
        // They touch at a vertex.
        add(&mut mesh, 7.0, 2.0, false);
        assert_eq!(mesh.enclosure().shells, 3);
    }

    #[test]
    fn corners_that_point_inwards_are_told() {
        let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let arrow = vec![at(0.0, 0.0), at(2.0, -1.0), at(0.5, 0.0), at(2.0, 1.0)];
        let mesh = |corners: [u32; 4]| Mesh { vertices: arrow.clone(), corners: corners.to_vec(), ends: vec![4] };
        assert_eq!(mesh([1, 2, 3, 0]).not_convex(), 1, "the diagonal lies outside");
        assert_eq!(mesh([0, 1, 2, 3]).not_convex(), 0, "the diagonal parts the arrow");
        assert_eq!(cube(DVec3::ZERO, 6).not_convex(), 0);
    }

    /// Ears are cut off a star; edges that cross each other are told.
    #[test]
    fn polygons_that_are_not_convex_are_filled() {
        let corner = |i: u32| {
            let (sine, cosine) = (std::f64::consts::TAU * f64::from(i) / 10.0).sin_cos();
            let radius = if i.is_multiple_of(2) { 2.0 } else { 0.7 };
            DVec3::new(1e4 + radius * cosine, 7.0 + 0.5 * radius * sine, radius * sine)
        };
        let star = Mesh { vertices: (0..10).map(corner).collect(), corners: (0..10).collect(), ends: vec![10] };
        let filled = star.filled().unwrap_or_default();
        assert_eq!((star.not_convex(), filled.len()), (1, 8));
        let normal = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a);
        let at = |(_, triangle): &(usize, [u32; 3])| normal(triangle.map(|corner| star.vertices[corner as usize]));
        let area: f64 = filled.iter().map(|triangle| at(triangle).length()).sum();
        let expected = 10.0 * 0.5 * 2.0 * 0.7 * (std::f64::consts::PI / 5.0).sin() * 1.25_f64.sqrt();
        assert!((area / expected - 1.0).abs() < 1e-9, "{area} {expected}");
        // All of them face the same way.
        assert!(filled.iter().all(|triangle| at(triangle).dot(at(&filled[0])) > 0.0));
        for crossing in
            [[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]], [[0.0, 0.0], [3.0, 1.0], [3.0, 0.0], [0.0, 0.5]]]
        {
            let vertices = crossing.map(|[x, y]| DVec3::new(x, y, 1.0)).to_vec();
            let bow = Mesh { vertices, corners: vec![0, 1, 2, 3], ends: vec![4] };
            assert_eq!(bow.filled(), None, "{crossing:?}");
        }
    }
}
