//! glTF 2.0, binary (`.glb`) and JSON (`.gltf`): the triangles of the scene that it shows, with the placement of their
//! nodes. Normals, materials and animations are passed over.

use super::Mesh;
use super::builder::Builder;
use crate::error::{Code, Error, Result};
use crate::formats::input;
use crate::formats::limits::Limits;
use crate::text::printable;
use ::gltf::accessor::{DataType, Dimensions};
use ::gltf::buffer::Source;
use ::gltf::mesh::Mode;
use ::gltf::{Accessor, Gltf, Node, Primitive, Semantic};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DMat4, DVec3, Mat4};
use percent_encoding::percent_decode_str;
use std::borrow::Cow;
use std::path::Path;

/// Greatest depth of nodes.
const MOST_DEPTH: u32 = 256;
const REMEDY: &str = "export the mesh again where it was made";

/// Reads the meshes of the default scene, else of the first one, as one mesh in the coordinates of the scene: +Y is up.
///
/// # Errors
/// If the file, or one of its buffers, cannot be read, contradicts the format, needs an extension that packs meshes,
/// has a skin or is too large.
pub(crate) fn read(path: &Path, limits: Limits) -> Result<Mesh> {
    let bytes = input::bytes(path, limits.max_memory / 2, "a glTF file")?;
    let Gltf { document, blob } = Gltf::from_slice(&bytes).map_err(|e| {
        Error::invalid(format!("no valid glTF: {e}"))
            .hint("export it again, without compression and other extensions that a reader must know")
    })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut left = limits.max_memory / 2;
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        let data = match buffer.source() {
            Source::Bin => Cow::Borrowed(blob.as_deref().unwrap_or_default()),
            Source::Uri(uri) => Cow::Owned(external(uri, folder, left)?),
        };
        left = left.saturating_sub(data.len() as u64);
        buffers.push(data);
    }
    let mut reader = Reader { buffers, builder: Builder::new(limits), nodes: 0 };
    match document.default_scene().or(document.scenes().next()) {
        Some(scene) => scene.nodes().try_for_each(|node| reader.node(&node, DMat4::IDENTITY, 0))?,
        None => {
            for mesh in document.meshes() {
                mesh.primitives().try_for_each(|primitive| reader.primitive(&primitive, DMat4::IDENTITY))?;
            }
        }
    }
    reader.builder.finish()
}

/// Reads a buffer outside of the file, or one in its text, of `most` bytes.
fn external(uri: &str, folder: &Path, most: u64) -> Result<Vec<u8>> {
    if let Some((_, data)) = uri.strip_prefix("data:").and_then(|data| data.split_once(";base64,")) {
        return STANDARD.decode(data).map_err(|e| Error::invalid(format!("a buffer in base64: {e}")).hint(REMEDY));
    }
    if uri.contains(':') {
        let shown: String = uri.chars().take(60).collect();
        return Err(Error::unsupported(format!("a buffer lies at '{shown}', which is no file beside this one"))
            .hint("export the mesh as one file, .glb"));
    }
    let name = percent_decode_str(uri).decode_utf8_lossy();
    let place = input::below(folder, &name).filter(|place| place.exists()).ok_or_else(|| {
        Error::invalid(format!("its buffer '{}' does not lie beside it", printable(&name)))
            .coded(Code::NotFound)
            .hint("put the buffer into the file's folder, or export the mesh as one file, .glb")
    })?;
    input::bytes(&place, most, "a buffer of a glTF file")
}

/// A mesh in the course of its reading.
struct Reader<'b> {
    buffers: Vec<Cow<'b, [u8]>>,
    builder: Builder,
    nodes: u32,
}

impl Reader<'_> {
    fn node(&mut self, node: &Node<'_>, above: DMat4, depth: u32) -> Result<()> {
        let inside = |e: Error| e.part(format!("node {}", node.index()));
        self.nodes += 1;
        // A node has one parent: none is met twice.
        if depth > MOST_DEPTH || self.nodes > 1 << 20 {
            return Err(inside(
                Error::invalid("nodes lie within each other without end, or there are too many").hint(REMEDY),
            ));
        }
        let map = above * Mat4::from_cols_array_2d(&node.transform().matrix()).as_dmat4();
        if let Some(mesh) = node.mesh() {
            if node.skin().is_some() {
                return Err(inside(
                    Error::unsupported("a skin poses the mesh, which is not read")
                        .hint("apply the armature to the mesh, and export it again"),
                ));
            }
            for primitive in mesh.primitives() {
                self.primitive(&primitive, map).map_err(|e| e.part(format!("mesh {}", mesh.index())))?;
            }
        }
        node.children().try_for_each(|child| self.node(&child, map, depth + 1))
    }

    fn primitive(&mut self, primitive: &Primitive<'_>, map: DMat4) -> Result<()> {
        let triangles = match primitive.mode() {
            Mode::Triangles => |i: usize| [3 * i, 3 * i + 1, 3 * i + 2],
            // Every other triangle of a strip runs the other way.
            Mode::TriangleStrip => |i: usize| [i, i + 1 + i % 2, i + 2 - i % 2],
            Mode::TriangleFan => |i: usize| [0, i + 1, i + 2],
            // Points and lines are no surface.
            _ => return Ok(()),
        };
        let Some(positions) = primitive.get(&Semantic::Positions) else { return Ok(()) };
        let first = self.builder.vertices() as u32;
        if (positions.data_type(), positions.dimensions()) != (DataType::F32, Dimensions::Vec3) {
            return Err(Error::unsupported("positions are no vectors of three 32-bit floats").hint(REMEDY));
        }
        let elements = self.elements(&positions)?;
        let single = |bytes: &[u8]| bytes.first_chunk().map_or(0.0, |bytes| f32::from_le_bytes(*bytes));
        let vertices: Vec<DVec3> =
            elements.map(|bytes| DVec3::from_array([0, 4, 8].map(|at| f64::from(single(&bytes[at..]))))).collect();
        let count = vertices.len();
        for vertex in vertices {
            self.builder.vertex(map.transform_point3(vertex))?;
        }
        let corners = match primitive.indices() {
            Some(indices) => self.indices(&indices)?,
            None => (0..count as u32).collect(),
        };
        if let Some(corner) = corners.iter().find(|corner| **corner as usize >= count) {
            return Err(Error::invalid(format!("a triangle names vertex {corner}, and there are {count}")).hint(REMEDY));
        }
        let number = match primitive.mode() {
            Mode::Triangles => corners.len() / 3,
            _ => corners.len().saturating_sub(2),
        };
        // A mirrored node shows the other side of its triangles.
        let mirrored = map.determinant() < 0.0;
        for i in 0..number {
            let [a, b, c] = triangles(i).map(|at| first + corners[at]);
            self.builder.polygon(&if mirrored { [a, c, b] } else { [a, b, c] })?;
        }
        Ok(())
    }

    fn indices(&self, indices: &Accessor<'_>) -> Result<Vec<u32>> {
        let integer = |bytes: &[u8]| bytes.iter().rev().fold(0, |sum, byte| sum << 8 | u32::from(*byte));
        match (indices.data_type(), indices.dimensions()) {
            (DataType::U8 | DataType::U16 | DataType::U32, Dimensions::Scalar) => {
                Ok(self.elements(indices)?.map(integer).collect())
            }
            _ => Err(Error::unsupported("numbers of vertices are no unsigned integers").hint(REMEDY)),
        }
    }

    /// Returns the bytes of the elements of an accessor.
    fn elements(&self, accessor: &Accessor<'_>) -> Result<impl Iterator<Item = &[u8]>> {
        let (size, count) = (accessor.size(), accessor.count());
        let view = accessor.view().filter(|_| accessor.sparse().is_none()).ok_or_else(|| {
            Error::unsupported("values are stored apart from those that they replace")
                .hint("export the mesh again, without sparse accessors and compression")
        })?;
        let stride = view.stride().unwrap_or(size).max(size);
        let within = || {
            let buffer = self.buffers.get(view.buffer().index())?;
            let data = buffer.get(view.offset()..view.offset().checked_add(view.length())?)?;
            let length = if count == 0 { 0 } else { stride.checked_mul(count - 1)?.checked_add(size)? };
            data.get(accessor.offset()..accessor.offset().checked_add(length)?)
        };
        let data = within().ok_or_else(|| {
            Error::invalid(format!("{count} values lie beyond the end of their buffer"))
                .hint("the file is damaged or cut off; export the mesh again where it was made")
        })?;
        Ok(data.chunks(stride).map(move |chunk| &chunk[..size]))
    }
}
