//! Surfaces of grids as meshes, and meshes as level sets or fog volumes.

use super::form::Form;
use super::grid_edit::Budget;
use super::nano::placed;
use super::report::GridPlace;
use super::{ConvertSettings, FileReport, half};
use crate::app::Context;
use crate::app::outputs::{self, Content};
use crate::error::{Code, Error, Result};
use crate::formats::atomic;
use crate::formats::format::Format;
use crate::formats::limits::Limits;
use crate::formats::mesh::topology::{CORNER_BYTES, Enclosure, VERTEX_BYTES};
use crate::formats::mesh::{Mesh, MeshFormat};
use crate::formats::vdb::{File, GridInfo, HALF_WIDTH, NativeGrid, writable, write_native};
use crate::math::Affine;
use crate::scene::grid::GridClass;
use crate::text::{bytes as human, printable};
use crate::wording::all_worded;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

/// How surfaces become meshes, and meshes volumes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MeshSettings {
    /// Width of the narrow band of a mesh's level set to each side in voxels, from 1 to 1000; none for 3.
    pub half_width: Option<f64>,
    /// How much flat parts of a surface are merged, from 0 to 1; none for 0.
    pub adaptivity: Option<f64>,
}

impl MeshSettings {
    /// Returns the width of the narrow band to each side in voxels.
    ///
    /// # Errors
    /// If it is out of range.
    fn half_width(&self) -> Result<f64> {
        let width = self.half_width.unwrap_or(f64::from(HALF_WIDTH));
        let valid = (1.0..=1000.0).contains(&width);
        valid.then_some(width).ok_or_else(|| {
            Error::invalid(format!("⟨half_width={width}⟩ voxels")).hint("give a ⟨half_width⟩ from 1 to 1000 voxels")
        })
    }

    /// Returns how much flat parts of a surface are merged.
    ///
    /// # Errors
    /// If it is out of range.
    fn adaptivity(&self) -> Result<f64> {
        let adaptivity = self.adaptivity.unwrap_or(0.0);
        let valid = (0.0..=1.0).contains(&adaptivity);
        valid.then_some(adaptivity).ok_or_else(|| {
            Error::invalid(format!("⟨adaptivity={adaptivity}⟩")).hint("give an ⟨adaptivity⟩ from 0 to 1")
        })
    }
}

/// Report of a conversion from or to a mesh.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct MeshReport {
    /// Path that was read.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub input: PathBuf,
    /// Path that was written.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub output: PathBuf,
    /// Length of what was written.
    pub bytes: u64,
    /// Format of the mesh.
    pub format: &'static str,
    /// The mesh that was read or written.
    pub mesh: MeshSummary,
    /// The grid that was read or written.
    pub grid: GridPlace,
    /// Value of the grid on the surface that became a mesh; none from a mesh.
    pub iso: Option<f64>,
    /// Width of the narrow band to each side in voxels, in which a mesh became distances; none to a mesh.
    pub half_width: Option<f64>,
    /// Sentences on what may have been meant otherwise.
    pub notes: Vec<String>,
}

/// Numbers of a mesh.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct MeshSummary {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of polygons.
    pub polygons: usize,
    /// Lower and upper corner of the box around the vertices in world units.
    pub bounds: [[f64; 3]; 2],
    /// Open edges, area and volume of the mesh.
    #[serde(flatten)]
    pub enclosure: Enclosure,
}

impl MeshSummary {
    fn new(mesh: &Mesh) -> Self {
        let bounds = mesh.bounds();
        Self {
            vertices: mesh.vertices.len(),
            polygons: mesh.ends.len(),
            bounds: [bounds.min.to_array(), bounds.max.to_array()],
            enclosure: mesh.enclosure(),
        }
    }
}

impl fmt::Display for MeshReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let MeshSummary { vertices, polygons, enclosure, .. } = &self.mesh;
        writeln!(f, "{}: {}", self.output.display(), human(self.bytes))?;
        writeln!(f, "  mesh: {vertices} vertices, {polygons} polygons, area {}", enclosure.area)?;
        if enclosure.open_edges == 0 {
            writeln!(f, "  closed, shells {}, volume {}", enclosure.shells, enclosure.volume)?;
        }
        if let Some(iso) = self.iso {
            writeln!(f, "  surface of the value {iso}")?;
        }
        let GridPlace { name, class, value_type, active_voxels, .. } = &self.grid;
        writeln!(f, "  grid '{}', {class}, {value_type}, {active_voxels} active voxels", printable(name))
    }
}

/// Bytes that counting the edges of a mesh takes, which are enough for its copy in voxels' units as well.
fn edge_bytes(mesh: &Mesh) -> u64 {
    CORNER_BYTES * mesh.corners.len() as u64 + VERTEX_BYTES * mesh.vertices.len() as u64
}

impl ConvertSettings {
    /// Writes the surface of a value of a grid as a mesh.
    pub(super) fn grid_to_mesh(&self, format: &Format, writer: &MeshFormat, context: &Context) -> Result<FileReport> {
        let limits = self.limits;
        let adaptivity = self.meshes.adaptivity()?;
        atomic::probe(&self.output)?;
        let stage = context.stage("converting");
        let file = File::open(&self.input, limits)?;
        let name = self.one_grid(&file)?;
        let place = |e: Error| e.part(format!("grid '{name}'")).at(&self.input);
        let native = file.read(&name)?;
        let info = native.info().map_err(place)?;
        info.affine().map_err(place)?;
        let iso = surface_value(&native, &info, self.edits.iso).map_err(place)?;
        let needed = info.memory.saturating_add(native.isosurface_bytes(iso).map_err(place)?);
        let hint = "raise ⟨max_memory⟩, or make larger voxels first, or a part: ⟨convert.resample⟩, ⟨convert.crop⟩";
        Budget { held: 0, limit: limits.max_memory }.room(needed, "the surface", hint).map_err(place)?;
        let distances = info.class == GridClass::LevelSet;
        let mesh = native.isosurface(iso, adaptivity, distances).map_err(|e| e.at(&self.input))?;
        let grid = placed(&native)?;
        drop(native);
        if mesh.ends.is_empty() {
            return Err(place(
                Error::invalid(format!("no surface lies where values pass {iso}"))
                    .hint("give another ⟨iso⟩; cumulo info shows the range of the values"),
            ));
        }
        writer.write(&self.output, &mesh)?;
        let summary = MeshSummary::new(&mesh);
        drop(stage);
        let mut notes = Vec::new();
        let open = summary.enclosure.open_edges;
        if open > 0 {
            notes.push(format!(
                "the surface is open at {open} edges, where OpenVDB merged polygons or values are missing"
            ));
        }
        self.report_mesh(context, format.name, (summary, grid), (Some(iso), None), notes)
    }

    /// Writes a mesh as a level set, or as a fog volume.
    pub(super) fn mesh_to_grid(&self, format: &Format, reader: &MeshFormat, context: &Context) -> Result<FileReport> {
        let half_width = self.meshes.half_width()?;
        outputs::file(&self.output, Content::Vdb)?;
        let form = self.edits.to.unwrap_or(Form::LevelSet);
        let name = match (&self.grid[..], form) {
            ([name], _) => name.clone(),
            ([], Form::Fog) => "density".to_owned(),
            ([], Form::LevelSet) => "surface".to_owned(),
            _ => return Err(Error::invalid("a mesh becomes one grid").hint("give one name with ⟨grid⟩")),
        };
        let stage = context.stage("converting");
        let mesh = reader.read(&self.input, self.limits)?;
        let place = |e: Error| e.at(&self.input);
        let voxel = self.voxel_of(&mesh, half_width).map_err(place)?;
        let left = self.room_beside(&mesh).map_err(place)?;
        let summary = MeshSummary::new(&mesh);
        closed(&summary.enclosure).map_err(place)?;
        let mut native =
            NativeGrid::from_mesh(&mesh, voxel, half_width as f32, &name, left.max_memory).map_err(place)?;
        let inside = native.inside(voxel)?;
        if inside.voxels == 0.0 {
            return Err(place(
                Error::invalid(format!("the mesh encloses no centre of a voxel of edge {voxel}"))
                    .coded(Code::EmptyGrid)
                    .hint("choose a smaller ⟨voxel_size⟩; a mesh of no thickness has no inside"),
            ));
        }
        let mut notes = remarks(&mesh, &summary.enclosure, inside.volume, voxel);
        drop(mesh);
        if form == Form::Fog {
            native.make_fog()?;
        }
        if self.half {
            notes.extend(half::store(&mut native)?);
        }
        write_native(&self.output, &[&native], None, &BTreeMap::new(), self.codec)?;
        drop(stage);
        let grid = placed(&native)?;
        self.report_mesh(context, format.name, (summary, grid), (None, Some(half_width)), notes)
    }

    /// Returns the edge of the voxels.
    fn voxel_of(&self, mesh: &Mesh, half_width: f64) -> Result<f64> {
        let voxel = self.images.scan.voxel_size.ok_or_else(|| {
            let [x, y, z] = mesh.bounds().size().to_array();
            let error = Error::invalid(format!(
                "the mesh measures {x} x {y} x {z} world units, and the size of voxels is not stated"
            ));
            let edge = x.max(y).max(z) / 100.0;
            if edge == 0.0 {
                return error.hint("export a mesh that encloses something, and give the edge of a voxel: ⟨voxel_size⟩");
            }
            // Two digits are enough of a proposal.
            let edge: f64 = format!("{edge:.1e}").parse().unwrap_or(edge);
            error
                .hint(format!("give the edge of a voxel, such as a hundredth of the longest side: ⟨voxel_size={edge}⟩"))
        })?;
        writable(&Affine::uniform(voxel, DVec3::ZERO)?)?;
        let fits = |distance: f64| (distance as f32).is_normal();
        if !fits(voxel) || !fits(voxel * half_width) {
            return Err(Error::unsupported(format!(
                "32-bit floats hold no distances of {half_width} voxels of {voxel:e}"
            ))
            .hint("scale the mesh where it was made, and choose another ⟨voxel_size⟩"));
        }
        Ok(voxel)
    }

    /// Returns the memory that is left beside a mesh and what is made of it.
    fn room_beside(&self, mesh: &Mesh) -> Result<Limits> {
        let allowed = self.limits.max_memory;
        let held = 24 * mesh.vertices.len() as u64 + 4 * (mesh.corners.len() + mesh.ends.len()) as u64;
        let needed = held + edge_bytes(mesh);
        let hint = "raise ⟨max_memory⟩, or decimate the mesh where it was made";
        Budget { held: 0, limit: allowed }.room(needed, "the mesh", hint)?;
        Ok(Limits { max_memory: allowed - needed })
    }

    fn report_mesh(
        &self,
        context: &Context,
        format: &'static str,
        (mesh, grid): (MeshSummary, GridPlace),
        (iso, half_width): (Option<f64>, Option<f64>),
        notes: Vec<String>,
    ) -> Result<FileReport> {
        notes.iter().for_each(|note| context.note(format!("note: {note}")));
        let length = |path: &Path| std::fs::metadata(path).map(|data| data.len()).map_err(|e| Error::io(path, e));
        Ok(FileReport::Mesh(Box::new(MeshReport {
            input: self.input.clone(),
            output: self.output.clone(),
            bytes: length(&self.output)?,
            format,
            mesh,
            grid,
            iso,
            half_width,
            notes: all_worded(notes),
        })))
    }
}

/// Returns the value of the surface of a grid: `iso`, or 0 for distances.
fn surface_value(native: &NativeGrid, info: &GridInfo, iso: Option<f64>) -> Result<f64> {
    if !matches!(info.value_type.as_str(), "float" | "double") {
        return Err(Error::unsupported(format!(
            "the grid holds {} values, and a surface needs reals",
            info.value_type
        ))
        .hint("name a grid of reals with ⟨grid⟩, or convert integers first: ⟨as=float⟩ from VDB to VDB"));
    }
    let (low, high) = native.value_range()?;
    let outside = info.background.first().copied().filter(|v| v.is_finite());
    let (low, high) = outside.map_or((low, high), |v| (low.min(v), high.max(v)));
    let range = format!("values of this {} reach from {low} to {high}", info.class.name());
    let hint = "give the value on the surface, above the lowest and up to the largest: ⟨iso⟩";
    match iso {
        None if info.class == GridClass::LevelSet => Ok(0.0),
        None => Err(Error::invalid(format!("⟨iso⟩ is not stated, and {range}")).hint(hint)),
        Some(iso) if low < iso && iso <= high => Ok(iso),
        Some(iso) => Err(Error::invalid(format!("no surface has ⟨iso={iso}⟩: {range}")).hint(hint)),
    }
}

/// Refuses surfaces that have no inside.
fn closed(enclosure: &Enclosure) -> Result<()> {
    if enclosure.open_edges == 0 {
        return Ok(());
    }
    Err(Error::unsupported(format!(
        "the mesh is open at {} edges, and only a closed surface has an inside",
        enclosure.open_edges
    ))
    .hint(
        "close it where it was made, such as by Fill, Solidify or Remesh in Blender; merge vertices that should be one \
         and lie apart",
    ))
}

/// Sentences on where the inside may be another than that which was meant. `made` is the volume of the level set.
fn remarks(mesh: &Mesh, enclosure: &Enclosure, made: f64, voxel: f64) -> Vec<String> {
    let mut notes = Vec::new();
    let bent = mesh.not_convex();
    if bent > 0 {
        notes.push(format!(
            "{bent} polygons have corners that point inwards, and the triangles of their first corner do not fill \
             them; triangulate the mesh where it was made"
        ));
    }
    let Enclosure { turned_edges, shells, inward_shells, area, .. } = *enclosure;
    if turned_edges > 0 {
        notes.push(format!(
            "at {turned_edges} edges, polygons that meet face to different sides; what is inside follows from the \
             surface alone"
        ));
        // The sides of polygons tell of nothing then.
        return notes;
    }
    if 0 < inward_shells && inward_shells < shells {
        notes.push(format!(
            "{inward_shells} of {shells} shells face inwards, as those of cavities do: cavities are filled"
        ));
    }
    let volume = enclosure.volume.abs();
    if made < 0.95 * volume {
        notes.push(format!(
            "the mesh encloses {volume} cubic world units shell by shell, and the level set {made}: what overlaps \
             counts once, and parts thinner than a voxel are lost"
        ));
    }
    // The mean length of chords through a body, by Cauchy's formula.
    let chord = 4.0 * volume / area;
    if chord < 2.0 * voxel {
        notes.push(format!(
            "chords through the mesh have a mean length of {chord}, and voxels an edge of {voxel}: parts thinner than \
             a voxel are lost; choose a smaller ⟨voxel_size⟩"
        ));
    }
    notes
}
