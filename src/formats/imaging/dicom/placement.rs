//! Order and places of the slices of a series.

use super::element::damaged;
use super::file::File;
use crate::error::{Error, Result};
use crate::formats::imaging::options::Options;
use crate::formats::imaging::placement;
use crate::math::Affine;
use glam::DVec3;

/// Largest difference of a direction cosine that counts as rounding: exporters write six digits or fewer.
const COSINE: f64 = 1e-3;
/// Largest difference of two gaps that counts as rounding, relative to them.
const GAP: f64 = 0.01;
/// Largest difference of two positions that counts as rounding, in millimetres: exporters write three digits or more.
const ROUNDING: f64 = 2e-3;

/// A slice: a frame of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plane {
    /// Number of the file.
    pub file: usize,
    /// Number of the frame in the file.
    pub frame: usize,
}

/// Slices in ascending order, and the map from their indices to the world.
pub struct Stack {
    /// The slices.
    pub planes: Vec<Plane>,
    /// Map from column, row and number of slice to the world.
    pub index_to_world: Affine,
}

fn name(files: &[File], plane: Plane) -> String {
    let file = &files[plane.file];
    let name = file.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if file.frames > 1 { format!("frame {} of {name}", plane.frame + 1) } else { name }
}

/// Arranges the frames of a series.
///
/// # Errors
/// If slices differ in size or orientation, lie unevenly, are missing or doubled, or do not say how large their pixels are.
pub fn stack(files: &[File], options: &Options, notes: &mut Vec<String>) -> Result<Stack> {
    let planes: Vec<Plane> =
        files.iter().enumerate().flat_map(|(file, f)| (0..f.frames).map(move |frame| Plane { file, frame })).collect();
    let Some((first, of)) = planes.first().map(|plane| (*plane, &files[plane.file])) else {
        return Err(damaged("the series has no slices"));
    };
    if let Some(other) = files.iter().find(|f| (f.rows, f.columns) != (of.rows, of.columns)) {
        let (rows, columns) = (other.rows, other.columns);
        let what = format!("a slice of {columns} x {rows} pixels in a series of {} x {}", of.columns, of.rows);
        return Err(Error::invalid(what).at(&other.path).hint("move slices of another size out of the folder"));
    }
    let placed = |plane: &Plane| {
        let frame = files[plane.file].frame(plane.frame);
        frame.position.zip(frame.orientation)
    };
    let places: Option<Vec<(DVec3, [DVec3; 2])>> = planes.iter().map(placed).collect();
    let spacing = spacing(files, first, options)?;
    let Some(places) = places else { return unplaced(files, planes, spacing, options, notes) };
    let [row, column] = directions(files, &planes, &places)?;
    let normal = row.cross(column);
    let mut sorted: Vec<(f64, DVec3, Plane)> =
        planes.iter().zip(&places).map(|(plane, (position, _))| (position.dot(normal), *position, *plane)).collect();
    sorted.sort_by(|a, b| {
        let order = |p: &Plane| (files[p.file].number, p.file, p.frame);
        let close = (a.0 - b.0).abs() < ROUNDING;
        if close { order(&a.2).cmp(&order(&b.2)) } else { a.0.total_cmp(&b.0) }
    });
    let sorted = one_volume(files, sorted, options, notes)?;
    let step = step(files, &sorted, normal, notes)?;
    let columns = [row * spacing[1], column * spacing[0], step];
    let map = placement::affine(columns, sorted[0].1)?.matrix();
    let index_to_world = placement::checked(placement::swap_lps_ras(map))?;
    Ok(Stack { planes: sorted.into_iter().map(|(_, _, plane)| plane).collect(), index_to_world })
}

/// Distances of rows and of columns.
fn spacing(files: &[File], first: Plane, options: &Options) -> Result<[f64; 2]> {
    let stated = files[first.file].frame(first.frame).spacing;
    let spacing = stated.or(options.spacing.map(|s| [s.y, s.x])).filter(|s| s.iter().all(|d| *d > 0.0));
    spacing.ok_or_else(|| {
        Error::invalid("the series does not say how large its pixels are").hint("give --spacing X,Y,Z in millimetres")
    })
}

/// Directions in which columns and rows are counted, which all slices share.
fn directions(files: &[File], planes: &[Plane], places: &[(DVec3, [DVec3; 2])]) -> Result<[DVec3; 2]> {
    let [row, column] = places[0].1;
    let unit = |v: DVec3| (v.length() - 1.0).abs() < COSINE;
    if !(unit(row) && unit(column) && row.dot(column).abs() < COSINE) {
        return Err(damaged(format!("rows along {row} and columns along {column} are no directions at right angles")));
    }
    let other = places.iter().position(|(_, [r, c])| (*r - row).length() > COSINE || (*c - column).length() > COSINE);
    if let Some(other) = other {
        let plane = planes[other];
        return Err(Error::invalid(format!("{} has another orientation than the slices before", name(files, plane)))
            .at(&files[plane.file].path)
            .hint("move slices of another orientation, such as localizers, out of the folder"));
    }
    Ok([row.normalize(), column.normalize()])
}

/// Chooses one of the volumes of a series that has as many slices at each position, such as points in time.
fn one_volume(
    files: &[File],
    sorted: Vec<(f64, DVec3, Plane)>,
    options: &Options,
    notes: &mut Vec<String>,
) -> Result<Vec<(f64, DVec3, Plane)>> {
    let groups: Vec<&[(f64, DVec3, Plane)]> = sorted.chunk_by(|a, b| (a.0 - b.0).abs() < ROUNDING).collect();
    let most = groups.iter().map(|g| g.len()).max().unwrap_or(1);
    if let Some(uneven) = groups.iter().find(|g| g.len() != most) {
        let many = groups.iter().find(|g| g.len() == most).unwrap_or(uneven);
        return Err(Error::invalid(format!(
            "{most} slices lie at {:.3} mm along the normal ({} and others), but {} at {:.3} mm",
            many[0].0,
            name(files, many[0].2),
            uneven.len(),
            uneven[0].0
        ))
        .hint("leave one slice at each position in the folder"));
    }
    let time = options.choose_time(most, notes)?;
    Ok(groups.iter().map(|group| group[time]).collect())
}

/// Step from one slice to the next, which all slices share.
fn step(files: &[File], sorted: &[(f64, DVec3, Plane)], normal: DVec3, notes: &mut Vec<String>) -> Result<DVec3> {
    let (first, last) = (sorted[0], sorted[sorted.len() - 1]);
    if sorted.len() == 1 {
        let thickness = files[first.2.file].frame(first.2.frame).thickness;
        if thickness.is_none() {
            notes.push("the series has one slice of no stated thickness; 1 mm is taken".into());
        }
        return Ok(normal * thickness.unwrap_or(1.0));
    }
    let mut gaps: Vec<f64> = sorted.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
    let at = |i: usize| (name(files, sorted[i].2), name(files, sorted[i + 1].2));
    let unsorted = gaps.clone();
    gaps.sort_by(f64::total_cmp);
    let usual = gaps[gaps.len() / 2];
    if let Some(i) = unsorted.iter().position(|gap| (gap - usual).abs() > (GAP * usual).max(ROUNDING)) {
        let (before, after) = at(i);
        let missing = (unsorted[i] / usual).round();
        let missing = if missing >= 2.0 { format!(", as if {} were missing", missing - 1.0) } else { String::new() };
        return Err(Error::invalid(format!(
            "the slices {before} and {after} are {:.3} mm apart, others {usual:.3} mm{missing}",
            unsorted[i]
        ))
        .hint("add the missing slices, or resample the series to even distances where it was made"));
    }
    let step = (last.1 - first.1) / (sorted.len() - 1) as f64;
    let off = sorted.iter().enumerate().find(|(i, (_, position, _))| {
        (*position - first.1 - step * *i as f64).length() > (0.05 * step.length()).max(5.0 * ROUNDING)
    });
    if let Some((_, (_, _, plane))) = off {
        return Err(Error::invalid(format!("the slice {} does not lie in line with the others", name(files, *plane)))
            .hint("resample the series to slices in line where it was made"));
    }
    Ok(step)
}

/// Stack of slices without positions, in order of their numbers.
fn unplaced(
    files: &[File],
    mut planes: Vec<Plane>,
    spacing: [f64; 2],
    options: &Options,
    notes: &mut Vec<String>,
) -> Result<Stack> {
    planes.sort_by_key(|plane| (files[plane.file].number, plane.file, plane.frame));
    let thickness = files[planes[0].file].frame(planes[0].frame).thickness;
    let thickness = thickness.or(options.spacing.map(|s| s.z)).filter(|t| *t > 0.0);
    let what = if thickness.is_some() { "in even steps of their thickness" } else { "1 mm apart" };
    notes.push(format!("the slices do not say where they lie; they are taken in order of their numbers, {what}"));
    let columns = [DVec3::X * spacing[1], DVec3::Y * spacing[0], DVec3::Z * thickness.unwrap_or(1.0)];
    let map = placement::affine(columns, DVec3::ZERO)?.matrix();
    Ok(Stack { planes, index_to_world: placement::checked(placement::swap_lps_ras(map))? })
}
