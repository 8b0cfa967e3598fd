//! Images of several resolutions, as NGFF describes them.

use super::array::{Array, text};
use super::axes::Axes;
use super::document::{Document, wrong};
use super::{VOXEL_BYTES, image};
use crate::error::{Error, Result};
use crate::formats::imaging::image::Image;
use crate::formats::imaging::options::Options;
use crate::formats::imaging::placement;
use crate::formats::imaging::text::excerpt;
use crate::formats::input;
use crate::formats::limits::Limits;
use glam::DVec3;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Most resolutions of an image.
const MOST_LEVELS: usize = 64;

/// A resolution of the image.
struct Level {
    folder: PathBuf,
    array: Array,
    axes: Axes,
    names: Vec<String>,
    size: [usize; 3],
}

/// Folder of an array that the metadata names, which must lie inside the image's.
fn inside(folder: &Path, name: &str) -> Result<PathBuf> {
    let found = input::below(folder, name).filter(|_| !name.is_empty());
    found.ok_or_else(|| wrong(format!("the array '{}' does not lie in the image's folder", excerpt(name))))
}

fn level(folder: &Path, multiscale: &Value, dataset: &Value, limits: Limits) -> Result<Level> {
    let name = text(dataset, "path").ok_or_else(|| wrong("a dataset without a 'path'"))?;
    let folder = inside(folder, name)?;
    let place = |e: Error| e.at(&folder);
    let document = Document::read(&folder, limits)?;
    if !document.is_array() {
        return Err(Error::invalid("no array is there, neither zarr.json nor .zarray")
            .at(&folder)
            .hint("copy the image again with all of its folders"));
    }
    let array = Array::parse(&document).map_err(place)?;
    let (axes, names) = Axes::of_image(multiscale.get("axes"), &array).map_err(place)?;
    let size = axes.size(&array).map_err(place)?;
    Ok(Level { folder, array, axes, names, size })
}

/// Applies a list of NGFF's transformations to `scale` and `translation`, which have an entry for each axis.
fn transform(list: Option<&Value>, scale: &mut [f64], translation: &mut [f64]) -> Result<()> {
    let Some(list) = list else { return Ok(()) };
    for step in list.as_array().ok_or_else(|| wrong("'coordinateTransformations' is no list"))? {
        let kind = text(step, "type").unwrap_or("unknown");
        if kind == "identity" {
            continue;
        }
        if !matches!(kind, "scale" | "translation") {
            return Err(Error::unsupported(format!("the transformation '{kind}' is not read"))
                .hint("scale, translation and identity are; give these in the image's metadata"));
        }
        let numbers = step.get(kind).and_then(Value::as_array);
        let numbers: Option<Vec<f64>> = numbers.and_then(|list| list.iter().map(Value::as_f64).collect());
        let numbers = numbers.filter(|n| n.len() == scale.len()).ok_or_else(|| {
            wrong(format!("the transformation '{kind}' has not one number for each of the {} axes", scale.len()))
        })?;
        for (axis, number) in numbers.into_iter().enumerate() {
            if kind == "scale" {
                scale[axis] *= number;
                translation[axis] *= number;
            } else {
                translation[axis] += number;
            }
        }
    }
    Ok(())
}

/// Map from the indices of a level's voxels to the world.
fn placed(level: &Level, multiscale: &Value, dataset: &Value, notes: &mut Vec<String>) -> Result<crate::math::Affine> {
    let count = level.names.len();
    let (mut scale, mut translation) = (vec![1.0; count], vec![0.0; count]);
    let own = dataset.get("coordinateTransformations");
    let states_scale = |list: &Vec<Value>| list.iter().any(|step| text(step, "type") == Some("scale"));
    if own.is_none_or(|own| own.as_array().is_some_and(|list| !states_scale(list))) {
        notes.push("the image does not say how large its voxels are; 1 is taken".to_owned());
    }
    transform(own, &mut scale, &mut translation)?;
    transform(multiscale.get("coordinateTransformations"), &mut scale, &mut translation)?;
    let along = |axis: Option<usize>| axis.map_or((1.0, 0.0), |axis| (scale[axis], translation[axis]));
    let [x, y, z] = level.axes.space.map(along);
    if level.axes.space[2].is_none() {
        notes.push("the image is flat; its one slice is 1 thick".to_owned());
    }
    placement::affine([DVec3::X * x.0, DVec3::Y * y.0, DVec3::Z * z.0], DVec3::new(x.1, y.1, z.1))
}

/// Notes the unit of the axes, if they state one.
fn unit(multiscale: &Value, level: &Level, notes: &mut Vec<String>) {
    let axes = multiscale.get("axes").and_then(Value::as_array);
    let unit = |axis: &Option<usize>| text(axes?.get((*axis)?)?, "unit").map(str::to_owned);
    let mut units: Vec<String> = level.axes.space.iter().filter_map(unit).collect();
    units.dedup();
    match &units[..] {
        [] => {}
        [one] => notes.push(format!("a unit of length is one {one}")),
        several => {
            notes.push(format!("the axes have different units ({}), which are not converted", several.join(", ")))
        }
    }
}

/// Opens one resolution of an image: that of the options, else the finest whose voxels fit into the limits.
///
/// # Errors
/// If the metadata contradicts the specification, there is no such level, or [`super::open`] names another condition.
pub(super) fn open(folder: &Path, multiscales: &[Value], options: &Options, limits: Limits) -> Result<Image> {
    let place = |e: Error| e.at(folder);
    let multiscale = &multiscales[0];
    let mut notes = Vec::new();
    if multiscales.len() > 1 {
        notes.push(format!("the first of {} images was read", multiscales.len()));
    }
    let datasets = multiscale.get("datasets").and_then(Value::as_array).filter(|d| !d.is_empty());
    let datasets = datasets.ok_or_else(|| place(wrong("the image has no 'datasets'")))?;
    if datasets.len() > MOST_LEVELS {
        return Err(place(wrong(format!("{} resolutions, at most {MOST_LEVELS} are expected", datasets.len()))));
    }
    let levels = datasets.iter().map(|dataset| level(folder, multiscale, dataset, limits));
    let levels = levels.collect::<Result<Vec<_>>>().map_err(place)?;
    let fits = |level: &Level| {
        let voxels = level.size.iter().try_fold(VOXEL_BYTES, |product, n| product.checked_mul(*n as u64));
        voxels.is_some_and(|bytes| bytes <= limits.max_memory)
    };
    let number = match options.level {
        Some(n) if n < levels.len() => n,
        Some(n) => {
            let what = format!("there is no level {n}; the image has {}", levels.len());
            return Err(place(Error::invalid(what).hint(format!("give ⟨level=0⟩ to {}", levels.len() - 1))));
        }
        None => levels.iter().position(fits).unwrap_or(levels.len() - 1),
    };
    if options.level.is_none() && levels.len() > 1 {
        let size =
            |(n, level): (usize, &Level)| format!("{n}: {} x {} x {}", level.size[0], level.size[1], level.size[2]);
        let all: Vec<String> = levels.iter().enumerate().map(size).collect();
        notes.push(format!("level {number} was read, the finest that fits; ⟨level⟩ chooses among {}", all.join(", ")));
    }
    let Some(level) = levels.into_iter().nth(number) else { return Err(place(wrong("the image has no levels"))) };
    let index_to_world = match options.placement().map_err(place)? {
        Some(map) => map,
        None => {
            let stated = placed(&level, multiscale, &datasets[number], &mut notes).map_err(place)?;
            options.moved(&stated).map_err(place)?
        }
    };
    unit(multiscale, &level, &mut notes);
    let name = text(multiscale, "name").filter(|n| !n.is_empty() && *n != "/").map(str::to_owned);
    image(&level.folder, level.array, level.axes, (name, index_to_world, notes), options, limits)
}
