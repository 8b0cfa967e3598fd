//! Reading of scene files. Every fault names the volume or light, and the key.

use super::{LightEntry, MediumEntry, MeshEntry, SceneFile, VelocityEntry, VolumeEntry, motion};
use crate::error::{Code, Error, Result};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use crate::formats::sequence::Pattern;
use crate::formats::transfer::{Function, Loaded};
use crate::formats::vdb::{self, File};
use crate::formats::{exr, input, registry, transfer};
use crate::scene::albedo::TransferColor;
use crate::scene::emission::Emission;
use crate::scene::environment::{Environment, EnvironmentMap};
use crate::scene::grid::Grid;
use crate::scene::light::Light;
use crate::scene::medium::{Medium, Source};
use crate::scene::meshes::Material;
use crate::scene::motion::{Motion, Object};
use crate::scene::surfaces::TRIANGLE_BYTES;
use crate::scene::transfer::Transfer;
use crate::scene::velocity::Velocity;
use glam::{DMat4, DVec3};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Largest coordinate of meshes.
const LARGEST: f64 = 1e100;
/// Largest size of a file in bytes.
const MAX_BYTES: u64 = 1 << 24;

/// A volume of a scene file, read.
#[derive(Debug, Clone)]
pub struct SceneVolume {
    /// VDB file.
    pub path: PathBuf,
    /// Densities.
    pub grid: Grid,
    /// Transfer function, where the medium has one.
    pub transfer: Option<Transfer>,
    /// Medium.
    pub medium: Medium,
    /// Grids that emit beside the medium, on the lattice of the densities, and how.
    pub emissions: Vec<(Grid, Emission)>,
    /// Velocities.
    pub velocity: Option<Velocity>,
}

/// A scene file with all that it names, read.
#[derive(Debug, Clone, Default)]
pub struct LoadedScene {
    /// Volumes.
    pub volumes: Vec<SceneVolume>,
    /// Lights.
    pub lights: Vec<Light>,
    /// Light from all around.
    pub environment: Environment,
    /// Triangles of the meshes in world space, with what they are made of.
    pub meshes: Vec<(Vec<[DVec3; 3]>, Material)>,
    /// Motions of volumes and meshes while the shutter is open.
    pub motions: Vec<Motion>,
    /// Files that were read beside the scene file.
    pub files: Vec<PathBuf>,
    /// True if a volume or a mesh is a sequence.
    pub moving: bool,
    /// Remarks on statements that have no effect, and on what is assumed.
    pub remarks: Vec<String>,
}

/// Reads a scene file alone, without the files that it names.
///
/// # Errors
/// If the file cannot be read, a key is missing or unknown, there is no volume, or the values do not fit into `limits`.
pub fn read(path: &Path, limits: Limits) -> Result<SceneFile> {
    let text = input::bytes(path, MAX_BYTES, "a scene")?;
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text);
    input::check_json_memory(text, limits).map_err(|e| e.at(path))?;
    let file: SceneFile = serde_json::from_slice(text).map_err(|e| {
        Error::invalid(format!("no scene: {e}"))
            .at(path)
            .hint("`cumulo schema scene` prints what a scene file may hold")
    })?;
    if file.volumes.is_empty() {
        return Err(Error::invalid("'volumes' is empty; at least one is needed")
            .at(path)
            .hint("list the volumes: {\"volumes\": [{\"file\": \"smoke.vdb\"}]}"));
    }
    Ok(file)
}

/// Reads a scene file with its volumes and transfer functions, sequences of volumes at a frame.
///
/// # Errors
/// If a file cannot be read, a key is missing, unknown or cannot be used, or the values do not fit into `limits`. The
/// error names the file, and the volume, mesh or light.
pub(crate) fn load_within(path: &Path, frame: Option<u32>, limits: Limits) -> Result<LoadedScene> {
    let _reading = Reading::begin(path);
    let part = |part: String| move |e: Error| e.part(part.clone()).at(path);
    let file = read(path, limits)?;
    let Some(folder) = path.parent() else { return Err(Error::invalid("no file").at(path)) };
    let mut scene = LoadedScene::default();
    let mut volume = |(i, entry): (usize, &VolumeEntry)| {
        // What lies in another file is blamed on that file.
        let named = part(format!("volume {i}"));
        let vdb = scene.at_frame(&folder.join(&entry.file), frame).map_err(&named)?;
        scene.files.extend(entry.medium.transfer.as_ref().map(|tf| folder.join(tf)));
        let opened = File::open(&vdb, limits)?;
        let mut grid = opened.read_fog(entry.grid.as_deref())?;
        let load = |tf: &PathBuf| {
            let options = transfer::Options { limits, ..transfer::Options::default() };
            transfer::load(&folder.join(tf), &options).map(Loaded::function)
        };
        let function = entry.medium.transfer.as_ref().map(load).transpose()?;
        let medium = medium(&entry.medium, function.as_ref()).map_err(&named)?;
        let transfer = function.map(|function| function.transfer);
        let emission = |(name, emission): (&str, Emission)| {
            let emission = emission.checked().map_err(&named)?;
            Ok((emitting(&opened, name, &grid)?, emission))
        };
        let mut emissions = entry.medium.emissions().map(emission).collect::<Result<Vec<_>>>()?;
        let velocity = |of: &VelocityEntry| vdb::velocity::read(&opened, &of.grid, of.fps, limits.max_memory);
        let mut velocity = entry.velocity.as_ref().map(velocity).transpose()?;
        if let Some(placement) = entry.placement().map_err(&named)? {
            for grid in emissions.iter_mut().map(|(grid, _)| grid).chain([&mut grid]) {
                grid.transform = grid.transform.then(&placement).map_err(&named)?;
            }
            velocity = velocity.map(|velocity| velocity.placed(placement.matrix())).transpose().map_err(&named)?;
        }
        Ok(SceneVolume { path: vdb, grid, transfer, medium, emissions, velocity })
    };
    scene.volumes = file.volumes.iter().enumerate().map(&mut volume).collect::<Result<Vec<_>>>()?;
    for (i, entry) in file.volumes.iter().enumerate() {
        let maps = [entry.transform_start, entry.transform, entry.transform_end];
        scene.motions.extend(motion(Object::Volume(i), maps).map_err(part(format!("volume {i}")))?);
    }
    for (i, entry) in file.meshes.iter().enumerate() {
        let maps = [entry.transform_start, entry.transform, entry.transform_end];
        scene.motions.extend(motion(Object::Mesh(i), maps).map_err(part(format!("mesh {i}")))?);
        scene.mesh(entry, (folder, frame), limits).map_err(|e| match e.path() {
            Some(_) => e,
            None => part(format!("mesh {i}"))(e),
        })?;
    }
    for (i, entry) in file.lights.iter().enumerate() {
        let named = part(format!("light {i}"));
        match entry {
            LightEntry::DomeLight { radiance, texture } => {
                let texture = texture.as_ref().map(|texture| folder.join(texture));
                scene.files.extend(texture.clone());
                dome(&mut scene.environment, *radiance, texture, limits, named)?;
            }
            entry => scene.lights.extend(entry.light().map_err(named)?),
        }
    }
    let without = |what: &String| format!("left out where the scene was written: {what}");
    scene.remarks.extend(file.left_out.iter().map(without));
    Ok(scene)
}

impl LoadedScene {
    /// Records a file that is read, and returns its path: of a sequence, that of a frame.
    fn at_frame(&mut self, path: &Path, frame: Option<u32>) -> Result<PathBuf> {
        let path = match Pattern::parse(path) {
            Some(pattern) => {
                let Some(number) = frame else {
                    let name = path.file_name().unwrap_or_default().display();
                    return Err(Error::invalid(format!("{name} is a sequence, and no frame is chosen"))
                        .hint("choose frames with ⟨frames⟩, or for `cumulo plan` one with ⟨frame⟩"));
                };
                self.moving = true;
                pattern.path(number)
            }
            None => path.to_path_buf(),
        };
        self.files.push(path.clone());
        Ok(path)
    }

    /// Reads a mesh. An error names the file where it lies there.
    fn mesh(&mut self, entry: &MeshEntry, (folder, frame): (&Path, Option<u32>), limits: Limits) -> Result<()> {
        let material = entry.material()?;
        let path = self.at_frame(&folder.join(&entry.file), frame)?;
        let format = registry::by_name(&path).and_then(|format| match format.kind {
            FileKind::Mesh(format) => Some(format),
            _ => None,
        });
        let Some(format) = format else {
            return Err(Error::unsupported(format!("{} is no mesh by its name", entry.file.display()))
                .hint("give a PLY, OBJ or glTF file"));
        };
        let mut triangles = format.triangles(&path, limits)?;
        if let Some(rows) = entry.transform {
            let placement = DMat4::from_cols_array_2d(&rows).transpose();
            if rows[3] != [0.0, 0.0, 0.0, 1.0] || placement.determinant() == 0.0 || !placement.is_finite() {
                return Err(Error::invalid("its 'transform' is no map of space that can be inverted")
                    .hint("give a finite matrix, row by row, whose last row is 0, 0, 0, 1"));
            }
            triangles.iter_mut().flatten().for_each(|corner| *corner = placement.transform_point3(*corner));
        }
        self.push_mesh(triangles, material, limits).map_err(|e| e.at(&path))
    }

    /// Adds a mesh.
    ///
    /// # Errors
    /// If all meshes together do not fit into the limits.
    pub(crate) fn push_mesh(&mut self, triangles: Vec<[DVec3; 3]>, material: Material, limits: Limits) -> Result<()> {
        let sound = |at: &DVec3| at.abs().max_element() < LARGEST;
        if !triangles.iter().flatten().all(sound) {
            return Err(Error::invalid(format!("a point of the mesh is farther than {LARGEST:e} from the origin"))
                .hint("correct the coordinates, or the matrices that place them"));
        }
        self.meshes.push((triangles, material));
        let count: u64 = self.meshes.iter().map(|(triangles, _)| triangles.len() as u64).sum();
        if count.saturating_mul(TRIANGLE_BYTES) > limits.max_memory {
            return Err(Error::unsupported(format!("{count} triangles of all meshes do not fit in memory"))
                .coded(Code::MemoryLimit)
                .hint("simplify the meshes, or raise ⟨max_memory⟩"));
        }
        Ok(())
    }
}

/// Reads a grid that emits beside densities, on their lattice.
fn emitting(file: &File, name: &str, densities: &Grid) -> Result<Grid> {
    let emitting = file.read_fog(Some(name))?;
    if emitting.transform.is_close(&densities.transform) {
        return Ok(emitting);
    }
    Err(Error::unsupported(format!("its lattice is not that of grid '{}'", densities.name))
        .hint("resample one of them with ⟨convert.resample⟩")
        .part(format!("grid '{name}'"))
        .at(file.path()))
}

/// Adds light from all around to an environment.
fn dome(
    environment: &mut Environment,
    radiance: [f32; 3],
    texture: Option<PathBuf>,
    limits: Limits,
    named: impl FnOnce(Error) -> Error,
) -> Result<()> {
    if !radiance.iter().all(|v| v.is_finite() && *v >= 0.0) {
        return Err(named(
            Error::invalid(format!("a DomeLight's radiance {radiance:?} must be finite and not negative"))
                .hint("correct 'radiance'"),
        ));
    }
    let Some(texture) = texture else {
        environment.radiance.iter_mut().zip(radiance).for_each(|(sum, v)| *sum += v);
        return Ok(());
    };
    if environment.map.is_some() {
        return Err(named(
            Error::unsupported("a second DomeLight with a texture").hint("add both pictures to one beforehand"),
        ));
    }
    environment.map = Some(Arc::new(environment_map(&texture, radiance, limits)?));
    Ok(())
}

/// Reads an equirectangular EXR of the radiance from all directions, times `factor`.
///
/// # Errors
/// If the picture cannot be read or used; the error names it.
pub(crate) fn environment_map(path: &Path, factor: [f32; 3], limits: Limits) -> Result<EnvironmentMap> {
    let film = exr::read_picture_within(path, None, limits)?;
    EnvironmentMap::new(&film, factor).map_err(|e| e.at(path))
}

/// Returns the medium that an entry describes, with its transfer function if it names one.
///
/// # Errors
/// If a number cannot be used, or entries contradict each other.
pub fn medium(entry: &MediumEntry, function: Option<&Function>) -> Result<Medium> {
    if function.is_some() && entry.emissions().next().is_some() {
        return Err(Error::unsupported("a medium with a transfer function emits by grids of its own")
            .hint("leave one of 'transfer', and 'emission_grid' and 'blackbody', out"));
    }
    if function.is_some() && entry.emission.is_some() {
        return Err(Error::invalid("'transfer' and 'emission' both tell the source's radiance")
            .hint("leave 'emission' out: a transfer function has colors of its own"));
    }
    if function.is_none() && entry.tf_color.is_some() {
        return Err(Error::invalid("'tf_color' tells what the colors of 'transfer' are, which is not stated")
            .hint("leave 'tf_color' out, or state 'transfer'"));
    }
    let source = Source::Grey(entry.emission.unwrap_or_default());
    let medium = Medium::new(entry.density_scale, source).chromatic(entry.extinction_color)?;
    let medium = match function {
        Some(Function { transfer, albedo }) => {
            let usual = if albedo.is_some() { TransferColor::Both } else { TransferColor::Emission };
            medium.with_function(transfer.table()?, albedo.clone(), entry.tf_color.unwrap_or(usual))?
        }
        None => medium,
    };
    Medium { scattering: Some(entry.scattering()), ..medium }.checked()
}
