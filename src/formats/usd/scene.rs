//! Scenes of stages: volumes with their media, lights and light from all around, at a time code.

use super::fault::Fault;
use super::light;
use super::medium::{self, Overrides, StatedMedium};
use super::mesh;
use super::prim::Prim;
use super::stage::Stage;
use super::value::Asset;
use super::volume::{Field, Role};
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::scene_file::{self, LoadedScene, MediumEntry, SceneVolume};
use crate::formats::transfer::{self, Function, Loaded};
use crate::formats::vdb::{self, File};
use crate::math::Affine;
use crate::scene::emission::Emission;
use crate::scene::grid::Grid;
use crate::scene::velocity::Velocity;
use glam::{DMat4, Vec3};
use std::path::{Path, PathBuf};

/// Reads the scene of a stage at a time code, with properties of media that hold in place of those that it states.
///
/// What the stage states and pictures do not show is told by the scene's remarks.
///
/// # Errors
/// If the stage lacks a layer that it names or has no volume that is visible, or a file, a light or a transform cannot
/// be used. The error names the file and the prim.
pub fn load(stage: &Stage, time: f64, limits: Limits, overrides: &Overrides) -> Result<LoadedScene> {
    stage.whole()?;
    let mut scene = LoadedScene { files: stage.layers.clone(), ..LoadedScene::default() };
    scene.remarks.extend(stage.faults.iter().map(Fault::to_string));
    scene.remarks.extend(blender(stage));
    scene.remarks.extend(prototypes(stage));
    for prim in stage.volumes().filter(|prim| stage.is_rendered(prim, time)) {
        let read = Reader { stage, prim, time, limits }.volume(overrides, &mut scene)?;
        scene.volumes.push(read);
    }
    if scene.volumes.is_empty() {
        let hidden = stage.volumes().count();
        let what = match hidden {
            0 => "the stage has no prim of type Volume".to_owned(),
            hidden => format!("none of the stage's {hidden} volumes is visible at time code {time}"),
        };
        return Err(Error::invalid(what)
            .at(&stage.path)
            .hint("export a volume with the stage, or give the VDB itself; `cumulo info` lists what a stage holds"));
    }
    let means = overrides.scattering.is_some_and(|scattering| scattering.tf_color.is_some());
    if means && scene.volumes.iter().all(|volume| volume.transfer.is_none()) {
        return Err(Error::invalid("⟨tf_color⟩: no volume of the stage has a transfer function")
            .at(&stage.path)
            .hint("give ⟨tf⟩, or leave ⟨tf_color⟩ out"));
    }
    let light::Lights { lights, environment, files, remarks } = light::lights(stage, time, limits)?;
    scene.files.extend(files);
    scene.remarks.extend(remarks);
    mesh::meshes(stage, time, limits, &mut scene)?;
    scene.remarks.extend(other_surfaces(stage, time));
    scene.lights = lights;
    scene.environment = environment;
    scene.moving = moves(stage);
    Ok(scene)
}

/// Says how lights of Blender are read, where there are suns among them.
fn blender(stage: &Stage) -> Option<String> {
    let documentation = stage.metadata.documentation.as_deref().filter(|doc| doc.starts_with("Blender v"))?;
    let sun = stage.of_type("DistantLight").next()?;
    Some(format!(
        "light {} and other suns are read as Blender writes them ({documentation}): a quarter of the strength, half of \
         the angle",
        sun.path
    ))
}

/// Tells how many surfaces there are that no picture shows: all that are not meshes.
pub(super) fn other_surfaces(stage: &Stage, time: f64) -> Option<String> {
    const SHAPES: [&str; 11] = [
        "Points",
        "BasisCurves",
        "NurbsCurves",
        "NurbsPatch",
        "Cube",
        "Sphere",
        "Cylinder",
        "Cone",
        "Capsule",
        "Plane",
        "PointInstancer",
    ];
    let shape = |prim: &&Prim| SHAPES.contains(&prim.type_name.as_str()) && stage.is_rendered(prim, time);
    let count = stage.prims().filter(shape).count();
    (count > 0).then(|| format!("meshes alone are rendered of surfaces: {count} prim(s) of other types are left out"))
}

/// True if another time code shows another scene: if a volume, a mesh, a light, a field, a material or what stands
/// above one of them changes over time.
fn moves(stage: &Stage) -> bool {
    let changes = |prim: &Prim| prim.attributes.values().any(|a| a.is_animated() && a.name != "extent");
    stage.prims().any(|prim| {
        let shown = matches!(prim.type_name.as_str(), "Volume" | "Mesh") || light::is_light(prim);
        let read = matches!(prim.type_name.as_str(), "OpenVDBAsset" | "Material" | "Shader" | "NodeGraph");
        (read && changes(prim)) || (shown && stage.upwards(prim).any(changes))
    })
}

/// Tells of volumes beneath a `PointInstancer`, whose instances are not shown.
fn prototypes(stage: &Stage) -> impl Iterator<Item = String> {
    stage
        .volumes()
        .filter(|volume| stage.is_prototype(volume))
        .map(|volume| format!("volume {} is left out: instances of a PointInstancer are not rendered", volume.path))
}

/// Reads one volume.
struct Reader<'s> {
    stage: &'s Stage,
    prim: &'s Prim,
    time: f64,
    limits: Limits,
}

impl Reader<'_> {
    fn volume(&self, overrides: &Overrides, scene: &mut LoadedScene) -> Result<SceneVolume> {
        let blame = |e: Error| self.stage.blame(e, self.prim);
        let fields = self.stage.fields(self.prim, self.time);
        let map = self.stage.local_to_world(self.prim, self.time)?;
        let density = self.density(&fields).map_err(blame)?;
        let StatedMedium { mut entry, transfer, remarks } =
            medium::medium(self.stage, self.prim, self.time, overrides).map_err(blame)?;
        scene.remarks.extend(remarks.into_iter().map(|what| format!("volume {}: {what}", self.prim.path)));
        let (path, mut grid) = self.grid(density, scene)?;
        place(&mut grid, map).map_err(blame)?;
        let function = match (&transfer, &entry.transfer) {
            (Some(asset), _) => {
                record(asset, scene);
                Some(self.stage.read(asset, |file| self.transfer(file, transfer::Options::default()))?)
            }
            // What the options state is read as they say.
            (None, Some(file)) => {
                scene.files.extend(transfer::file(file).map(Path::to_path_buf));
                let function = self.transfer(file, overrides.transfer_options.clone())?;
                if entry.albedo != [0.0; 3] && entry.tf_color.is_none() {
                    let color = function.usual_color().map_err(blame)?;
                    scene.remarks.push(format!(
                        "volume {}: the meaning of the transfer function's colors is ⟨tf_color={}⟩ unless another is \
                         stated",
                        self.prim.path,
                        color.name()
                    ));
                    entry.tf_color = Some(color);
                }
                Some(function)
            }
            (None, None) => None,
        };
        let optics = scene_file::medium(&entry, function.as_ref()).map_err(blame)?;
        let transfer = function.map(|function| function.transfer);
        let emissions = self.emissions(&entry, &fields, (&grid, map), scene)?;
        let velocity = playing(&fields, Role::Velocity)
            .and_then(|field| self.velocity(field, map, scene).transpose())
            .transpose()?;
        let unclear = self.stage.unclear_fields(self.prim);
        scene.remarks.extend(unclear.map(|what| format!("volume {}: {what}", self.prim.path)));
        scene.remarks.extend(fields.iter().filter_map(|field| self.placed_field(field)));
        let others = fields.iter().filter(|field| field.role == Role::Other);
        scene
            .remarks
            .extend(others.map(|field| format!("volume {}: the field '{}' has no effect", self.prim.path, field.name)));
        Ok(SceneVolume { path, grid, transfer, medium: optics, emissions, velocity })
    }

    /// Tells of a field that has a transform of its own.
    fn placed_field(&self, field: &Field) -> Option<String> {
        let order = self.stage.prim(&field.prim)?.value("xformOpOrder", self.time)?;
        let has = !order.texts().is_empty();
        has.then(|| format!("field {}: its own transform has no effect, its volume's counts", field.prim))
    }

    /// Returns the field of the density.
    fn density<'f>(&self, fields: &'f [Field]) -> Result<&'f Field> {
        let mut dense = fields.iter().filter(|field| field.role == Role::Density);
        // A field that is related as the density goes before others.
        let named = fields.iter().find(|field| field.name == "density" && field.role == Role::Density);
        match (named, dense.next(), dense.next()) {
            (Some(field), ..) | (None, Some(field), None) => Ok(field),
            (None, Some(first), Some(second)) => {
                Err(Error::invalid(format!("both fields '{}' and '{}' could be the density", first.name, second.name))
                    .hint("relate the one that is meant as field:density"))
            }
            (None, None, _) => {
                let listed = fields.iter().map(|field| format!("'{}'", field.name)).collect::<Vec<_>>().join(", ");
                let listed = if listed.is_empty() { "none".into() } else { listed };
                let unclear: String = self.stage.unclear_fields(self.prim).map(|what| format!("; {what}")).collect();
                Err(Error::invalid(format!("none of its fields is the density; it has {listed}{unclear}"))
                    .hint("relate the grid of densities as field:density"))
            }
        }
    }

    /// Reads the file of a field.
    fn read<T>(&self, field: &Field, scene: &mut LoadedScene, read: impl FnOnce(&File) -> Result<T>) -> Result<T> {
        let place = |e: Error| e.part(format!("prim {}", field.prim)).at(&self.stage.path);
        if field.type_name != "OpenVDBAsset" {
            let what = match field.type_name.as_str() {
                "" => format!("the field '{}' of {} has no prim here", field.name, self.prim.path),
                other => format!("fields of type {other} are not read"),
            };
            return Err(place(Error::unsupported(what).hint("fields of type OpenVDBAsset are read: write VDB files")));
        }
        let Some(asset) = &field.file else {
            return Err(place(
                Error::invalid(format!("no file is stated for time code {}", self.time))
                    .hint("set the attribute 'filePath', or choose another frame with ⟨frames⟩"),
            ));
        };
        let path = self.stage.file(asset)?;
        if !path.exists() {
            return Err(place(
                Error::invalid(format!("the file of time code {} is missing: {}", self.time, path.display()))
                    .hint("correct 'filePath', copy the file there, or choose another frame with ⟨frames⟩"),
            ));
        }
        record(asset, scene);
        let found = self.stage.read(asset, |path| read(&File::open(path, self.limits)?));
        found.map_err(|e| match e.code() {
            // The stage says which grid it is.
            Code::NoSuchGrid => place(
                Error::invalid(format!("{}: {}", e.path().unwrap_or(&path).display(), e.what()))
                    .coded(Code::NoSuchGrid)
                    .hint("correct 'fieldName', or write the grid to the file"),
            ),
            _ => e,
        })
    }

    /// Reads the grid of a scalar field.
    fn grid(&self, field: &Field, scene: &mut LoadedScene) -> Result<(PathBuf, Grid)> {
        let grid = self.read(field, scene, |file| file.read_fog(grid_name(file, field).as_deref()))?;
        Ok((field.file.as_ref().map_or_else(PathBuf::new, |asset| self.stage.display_path(asset)), grid))
    }

    fn transfer(&self, file: &Path, options: transfer::Options) -> Result<Function> {
        let options = transfer::Options { limits: self.limits, ..options };
        transfer::load(file, &options).map(Loaded::function)
    }

    /// Reads the fields that emit, on the lattice of the density.
    fn emissions(
        &self,
        entry: &MediumEntry,
        fields: &[Field],
        (density, map): (&Grid, DMat4),
        scene: &mut LoadedScene,
    ) -> Result<Vec<(Grid, Emission)>> {
        let flame = entry.emission_grid.as_ref().map(|e| Emission::Linear(Vec3::from_array(e.radiance)));
        let hot = entry
            .blackbody
            .as_ref()
            .map(|e| Emission::Blackbody { kelvin: e.kelvin, color: Vec3::from_array(e.tint) * e.intensity as f32 });
        let mut all = Vec::new();
        for (role, emission) in [(Role::Flame, flame), (Role::Temperature, hot)] {
            let blame = |e: Error| self.stage.blame(e, self.prim);
            match (playing(fields, role), emission) {
                (Some(field), Some(emission)) => {
                    let emission = emission.checked().map_err(blame)?;
                    let (path, mut grid) = self.grid(field, scene)?;
                    place(&mut grid, map).map_err(blame)?;
                    if !grid.transform.is_close(&density.transform) {
                        return Err(Error::unsupported("its lattice is not that of the density")
                            .hint("resample one of them with ⟨convert.resample⟩")
                            .part(format!("grid '{}'", grid.name))
                            .at(path));
                    }
                    all.push((grid, emission));
                }
                (Some(field), None) => scene.remarks.push(format!(
                    "volume {}: the field '{}' has no effect, since no emission is stated",
                    self.prim.path, field.name
                )),
                (None, Some(_)) => {
                    let what = "it is to emit by a field of flames or temperatures, and has none";
                    return Err(blame(
                        Error::invalid(what).hint("relate the field as field:flame or field:temperature"),
                    ));
                }
                (None, None) => {}
            }
        }
        Ok(all)
    }

    /// Reads velocities, per second of the stage; `None` with a remark if the grid holds no vectors.
    fn velocity(&self, field: &Field, map: DMat4, scene: &mut LoadedScene) -> Result<Option<Velocity>> {
        let (rate, memory) = (self.stage.time_codes_per_second(), self.limits.max_memory);
        let velocity = self.read(field, scene, |file| {
            let Some(name) = grid_name(file, field) else { return Ok(None) };
            let holds_vectors = file.find(&name)?.grid_type.contains("vec3");
            holds_vectors.then(|| vdb::velocity::read(file, &name, rate, memory)).transpose()
        })?;
        let Some(velocity) = velocity else {
            scene.remarks.push(format!(
                "volume {}: the field '{}' holds no vectors, so that it has no effect",
                self.prim.path, field.name
            ));
            return Ok(None);
        };
        velocity.placed(map).map(Some).map_err(|e| self.stage.blame(e, self.prim))
    }
}

/// Returns the field that plays a part: the one that is related by the part's own name goes before others.
fn playing(fields: &[Field], role: Role) -> Option<&Field> {
    let mut all = fields.iter().filter(|field| field.role == role);
    let named = all.clone().find(|field| field.name == role.name());
    named.or_else(|| all.next())
}

/// Adds a file to those that were read. Packages are among the layers, which are listed already.
fn record(asset: &Asset, scene: &mut LoadedScene) {
    if asset.packaged().is_none() && !scene.files.contains(&asset.path) {
        scene.files.push(asset.path.clone());
    }
}

/// Returns the name of a field's grid in a file; `None` if the field names none.
fn grid_name(file: &File, field: &Field) -> Option<String> {
    if field.grid.is_empty() {
        let number = usize::try_from(field.index?).ok()?;
        return file.entries().get(number).map(|entry| entry.name.clone());
    }
    let [numbered, plain] = field.grid_names();
    let entries = file.entries();
    Some(if entries.iter().any(|entry| entry.name == numbered) { numbered } else { plain })
}

/// Moves a grid from the space of its volume to that of the stage.
fn place(grid: &mut Grid, map: DMat4) -> Result<()> {
    grid.transform = Affine::new(map * grid.transform.matrix())?;
    Ok(())
}
