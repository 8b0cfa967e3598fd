//! Order and places of the slices of a series.

use super::element::damaged;
use super::file::File;
use super::series::Series;
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
/// Largest difference of two positions that counts as rounding, relative to the edge of a pixel, for voxels of
/// micrometres.
const FINE: f64 = 0.02;

/// A slice: a frame of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Plane {
    /// Number of the file.
    pub file: usize,
    /// Number of the frame in the file.
    pub frame: usize,
}

/// Slices in ascending order, and the map from their indices to the world.
pub(crate) struct Stack {
    /// The slices.
    pub planes: Vec<Plane>,
    /// Map from column, row and number of slice to the world.
    pub index_to_world: Affine,
}

/// A slice with its place.
#[derive(Debug, Clone, Copy)]
struct Located {
    /// Position along the normal of the image plane, in millimetres.
    along: f64,
    /// Position of the centre of its first pixel.
    position: DVec3,
    plane: Plane,
}

/// Name of a slice for people: that of its file, and the number of its frame if there are several.
pub(crate) fn name(files: &[File], plane: Plane) -> String {
    let file = &files[plane.file];
    let name = file.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if file.frames > 1 { format!("frame {} of {name}", plane.frame + 1) } else { name }
}

/// Arranges the frames of a series.
///
/// # Errors
/// If slices differ in size or orientation, lie unevenly, are missing or doubled, or do not say how large their pixels
/// are.
pub(crate) fn stack(series: &Series, options: &Options, notes: &mut Vec<String>) -> Result<Stack> {
    let files = &series.files[..];
    let planes: Vec<Plane> =
        files.iter().enumerate().flat_map(|(file, f)| (0..f.frames).map(move |frame| Plane { file, frame })).collect();
    let Some(of) = planes.first().map(|plane| &files[plane.file]) else {
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
    let places: Vec<(DVec3, [DVec3; 2])> = planes.iter().filter_map(placed).collect();
    if places.is_empty() {
        return unplaced(files, planes, options, notes);
    }
    if let Some(plane) = planes.iter().find(|plane| placed(plane).is_none()) {
        return Err(Error::invalid(format!("{} does not say where it lies, and other slices do", name(files, *plane)))
            .at(&files[plane.file].path)
            .hint("move images that are no slices out of the folder"));
    }
    refuse_placement(options)?;
    let spacing = spacing(files, &planes, options)?;
    let [row, column] = directions(files, &planes, &places)?;
    let normal = row.cross(column);
    let located = |(plane, (position, _)): (&Plane, &(DVec3, [DVec3; 2]))| Located {
        along: position.dot(normal),
        position: *position,
        plane: *plane,
    };
    let mut located: Vec<Located> = planes.iter().zip(&places).map(located).collect();
    located.sort_by(|a, b| a.along.total_cmp(&b.along));
    let rounding = ROUNDING.min(FINE * spacing[0].min(spacing[1]));
    let slices = one_volume(series, located, rounding, options, notes)?;
    let step = step(files, &slices, (normal, rounding), notes)?;
    let columns = [row * spacing[1], column * spacing[0], step];
    let map = placement::affine(columns, slices[0].position)?.matrix();
    let index_to_world = placement::checked(placement::swap_lps_ras(map))?;
    Ok(Stack { planes: slices.into_iter().map(|slice| slice.plane).collect(), index_to_world })
}

/// Refuses options that cannot change where slices lie that say so themselves.
fn refuse_placement(options: &Options) -> Result<()> {
    if options.origin.is_none() && options.transform.is_none() {
        return Ok(());
    }
    Err(Error::invalid("the slices say where they lie, which ⟨origin⟩ and ⟨transform⟩ do not change")
        .hint("leave these options out"))
}

/// Distances of rows and of columns, which all slices share: those that the files state, else those of the options.
fn spacing(files: &[File], planes: &[Plane], options: &Options) -> Result<[f64; 2]> {
    let of = |plane: &Plane| files[plane.file].frame(plane.frame).spacing;
    let stated = planes.first().and_then(of);
    if let (Some([rows, columns]), Some(_)) = (stated, options.spacing) {
        return Err(Error::invalid(format!(
            "the files state pixels of {columns} x {rows} mm, which ⟨spacing⟩ does not change"
        ))
        .hint("leave ⟨spacing⟩ and ⟨voxel_size⟩ out"));
    }
    if let Some([rows, columns]) = stated.filter(|s| s.iter().any(|d| *d <= 0.0)) {
        return Err(damaged(format!(
            "the files state pixels of {columns} x {rows} mm; distances above 0 are expected"
        )));
    }
    let like = |other: Option<[f64; 2]>| match (stated, other) {
        (Some(a), Some(b)) => a.iter().zip(b).all(|(a, b)| (a - b).abs() <= COSINE * a.abs()),
        (a, b) => a == b,
    };
    if let Some(other) = planes.iter().find(|plane| !like(of(plane))) {
        let what = format!("{} has pixels of another size than the slices before", name(files, *other));
        return Err(Error::invalid(what)
            .at(&files[other.file].path)
            .hint("move slices with pixels of another size out of the folder"));
    }
    let spacing = stated.or(options.spacing.map(|s| [s.y, s.x])).filter(|s| s.iter().all(|d| *d > 0.0));
    spacing.ok_or_else(|| {
        Error::invalid("the series does not say how large its pixels are").hint("give ⟨spacing=X,Y,Z⟩ in millimetres")
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

/// Chooses one of the volumes of a series that has as many slices at each position, such as points in time: that of the
/// options, else that of the file that was named. The slices are in ascending order.
fn one_volume(
    series: &Series,
    mut located: Vec<Located>,
    rounding: f64,
    options: &Options,
    notes: &mut Vec<String>,
) -> Result<Vec<Located>> {
    let files = &series.files[..];
    let mut groups: Vec<&mut [Located]> = located.chunk_by_mut(|a, b| b.along - a.along < rounding).collect();
    let order = |slice: &Located| (files[slice.plane.file].number, slice.plane.file, slice.plane.frame);
    groups.iter_mut().for_each(|group| group.sort_by_key(order));
    let most = groups.iter().map(|g| g.len()).max().unwrap_or(1);
    if let Some(uneven) = groups.iter().find(|g| g.len() != most) {
        let many = groups.iter().find(|g| g.len() == most).unwrap_or(uneven);
        return Err(Error::invalid(format!(
            "{most} slices lie at {:.3} mm along the normal ({} and others), but {} at {:.3} mm",
            many[0].along,
            name(files, many[0].plane),
            uneven.len(),
            uneven[0].along
        ))
        .hint("leave one slice at each position in the folder"));
    }
    let is_named = |slice: &Located| Some(slice.plane.file) == series.named && files[slice.plane.file].frames == 1;
    let of_named = groups.iter().find_map(|group| group.iter().position(is_named));
    let time = match (of_named, options.time) {
        (Some(named), None) if most > 1 => {
            notes
                .push(format!("the file that was named is of point {named} of {most} in time, from 0, which was read"));
            named
        }
        (Some(named), Some(time)) if named != time && time < most => {
            return Err(Error::invalid(format!(
                "the file that was named is of point {named} in time, and not of {time}"
            ))
            .hint("name a file of that point in time, or the folder in which the files lie"));
        }
        _ => options.choose_time(most, notes)?,
    };
    Ok(groups.iter().map(|group| group[time]).collect())
}

/// Step from one slice to the next, which all slices share.
fn step(
    files: &[File],
    slices: &[Located],
    (normal, rounding): (DVec3, f64),
    notes: &mut Vec<String>,
) -> Result<DVec3> {
    let (first, last) = (slices[0], slices[slices.len() - 1]);
    if slices.len() == 1 {
        let thickness = files[first.plane.file].frame(first.plane.frame).thickness;
        if thickness.is_none() {
            notes.push("the series has one slice of no stated thickness; 1 mm is taken".into());
        }
        return Ok(normal * thickness.unwrap_or(1.0));
    }
    let mut gaps: Vec<f64> = slices.windows(2).map(|pair| pair[1].along - pair[0].along).collect();
    let at = |i: usize| (name(files, slices[i].plane), name(files, slices[i + 1].plane));
    let unsorted = gaps.clone();
    gaps.sort_by(f64::total_cmp);
    let usual = gaps[gaps.len() / 2];
    if let Some(i) = unsorted.iter().position(|gap| (gap - usual).abs() > (GAP * usual).max(rounding)) {
        let (before, after) = at(i);
        let missing = (unsorted[i] / usual).round();
        let missing = if missing >= 2.0 { format!(", as if {} were missing", missing - 1.0) } else { String::new() };
        return Err(Error::invalid(format!(
            "the slices {before} and {after} are {:.3} mm apart, others {usual:.3} mm{missing}",
            unsorted[i]
        ))
        .hint("add the missing slices, or resample the series to even distances where it was made"));
    }
    refuse_left_out(files, slices, usual, notes)?;
    let step = (last.position - first.position) / (slices.len() - 1) as f64;
    let off = slices.iter().enumerate().find(|(i, slice)| {
        (slice.position - first.position - step * *i as f64).length() > (0.05 * step.length()).max(5.0 * rounding)
    });
    if let Some((_, slice)) = off {
        return Err(Error::invalid(format!(
            "the slice {} does not lie in line with the others",
            name(files, slice.plane)
        ))
        .hint("resample the series to slices in line where it was made"));
    }
    Ok(step)
}

/// Refuses slices in even steps between which others are missing, by their numbers and by the distance that they state.
/// Numbers alone tell little, since programs count as they like, and are noted.
fn refuse_left_out(files: &[File], slices: &[Located], usual: f64, notes: &mut Vec<String>) -> Result<()> {
    let (first, second) = (slices[0], slices[1]);
    let number = |slice: &Located| files[slice.plane.file].number;
    let strides: Vec<u64> = slices.windows(2).map(|pair| number(&pair[0]).abs_diff(number(&pair[1]))).collect();
    let stride = strides[0];
    if stride < 2 || strides.iter().any(|other| *other != stride) || files.iter().any(|file| file.frames > 1) {
        return Ok(());
    }
    let names = [first, second].map(|slice| name(files, slice.plane));
    let counted =
        format!("the slices {} and {} are numbered {} and {}", names[0], names[1], number(&first), number(&second));
    let stated = files[first.plane.file].frame(first.plane.frame).thickness;
    let expected = stated.map(|distance| distance * stride as f64);
    if let Some(expected) = expected.filter(|expected| (usual - expected).abs() <= GAP * usual) {
        let one = expected / stride as f64;
        return Err(Error::invalid(format!(
            "{counted} and {usual:.3} mm apart, where {one:.3} mm are stated, as if {} were missing between them",
            stride - 1
        ))
        .hint("add the missing slices, or resample the series to even distances where it was made"));
    }
    notes.push(format!("{counted}, and so on: files of the series may be missing between them"));
    Ok(())
}

/// Stack of slices without positions, in order of their numbers, at the place that the options state.
fn unplaced(files: &[File], mut planes: Vec<Plane>, options: &Options, notes: &mut Vec<String>) -> Result<Stack> {
    planes.sort_by_key(|plane| (files[plane.file].number, plane.file, plane.frame));
    if let Some(index_to_world) = options.transform {
        notes.push("the slices do not say where they lie; they are taken in order of their numbers".into());
        return Ok(Stack { planes, index_to_world });
    }
    let thickness = files[planes[0].file].frame(planes[0].frame).thickness;
    // The options state what the files do not, be it the distance of slices alone.
    let pixels = Options { spacing: options.spacing.filter(|_| thickness.is_some()), ..options.clone() };
    let stated = files[planes[0].file].frame(planes[0].frame).spacing.is_some();
    let spacing = spacing(files, &planes, if stated { &pixels } else { options })?;
    let thickness = thickness.or(options.spacing.map(|s| s.z)).filter(|t| *t > 0.0);
    let what = if thickness.is_some() { "in even steps of their thickness" } else { "1 mm apart" };
    notes.push(format!("the slices do not say where they lie; they are taken in order of their numbers, {what}"));
    let columns = [DVec3::X * spacing[1], DVec3::Y * spacing[0], DVec3::Z * thickness.unwrap_or(1.0)];
    let map = placement::affine(columns, DVec3::ZERO)?.matrix();
    let index_to_world = options.moved(&placement::checked(placement::swap_lps_ras(map))?)?;
    Ok(Stack { planes, index_to_world })
}
