//! NRRD, versions 1 to 5: `.nrrd` with its values, and `.nhdr` with values in other files.
//!
//! Fields and their defaults follow the format's definition (teem, `nrrd/format`).

mod data;
mod fields;
mod layout;

use super::image::{About, Header, Image, Slices, Values};
use super::options::Options;
use super::placement::{self, swap_lps_ras};
use super::stream::Planar;
use super::text::{self, wrong};
use crate::error::{Error, Result};
use crate::math::Affine;
use data::{Data, Files};
use fields::{AGAIN, Fields, bracketed, directions};
use glam::{DMat4, DVec3};
use layout::Layout;
use std::path::Path;

/// Map from indices to right, anterior, superior where the file names its space, else to the file's own axes.
fn placement(fields: &Fields, layout: &Layout, notes: &mut Vec<String>) -> Result<Affine> {
    let mut columns = [DVec3::X, DVec3::Y, DVec3::Z];
    let mut origin = DVec3::ZERO;
    if let Some(text) = fields.get(&["space directions"]) {
        let found = directions(text)?;
        for (column, axis) in columns.iter_mut().zip(&layout.space) {
            *column = found.get(*axis).copied().flatten().ok_or_else(|| wrong("space directions", text))?;
        }
        if layout.space.len() == 2 {
            columns[2] = columns[0].cross(columns[1]).normalize_or(DVec3::Z);
        }
    } else {
        by_axis(fields, layout, (&mut columns, &mut origin), notes)?;
    }
    if let Some(text) = fields.get(&["space origin"]) {
        origin = bracketed("space origin", text)?.0;
    }
    let map = placement::affine(columns, origin)?;
    let space = fields.get(&["space"]).unwrap_or("").to_ascii_lowercase();
    let mirrored = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    match space.trim_end_matches("-time").trim_end_matches('t') {
        "right-anterior-superior" | "ras" => Ok(map),
        "left-posterior-superior" | "lps" => placement::checked(swap_lps_ras(map.matrix())),
        "left-anterior-superior" | "las" => placement::checked(mirrored * map.matrix()),
        "3d-left-handed" => {
            notes.push("the file's space is left-handed; its x axis was turned round".into());
            placement::checked(mirrored * map.matrix())
        }
        _ => Ok(map),
    }
}

/// Note about the units of length, where they are stated and no millimetres: names in quotes, those of space or of all
/// axes.
fn unit(fields: &Fields, layout: &Layout) -> Option<String> {
    let names = |text: &str| text.split('"').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>();
    let mut units = match (fields.get(&["space units"]), fields.get(&["units"])) {
        (Some(text), _) => names(text),
        (None, Some(text)) => {
            let all = names(text);
            layout.space.iter().filter_map(|axis| all.get(*axis).cloned()).collect()
        }
        (None, None) => return None,
    };
    units.dedup();
    match &units[..] {
        [] => None,
        [one] if one.is_empty() || one == "mm" => None,
        [one] => Some(format!("a unit of length is one {}", text::excerpt(one))),
        several => {
            let all = text::excerpt(&several.join(", "));
            Some(format!("the axes have different units ({all}), which are not converted"))
        }
    }
}

/// True if a space has directions of the body as its axes, which are brought to right, anterior and superior.
fn is_anatomical(space: &str) -> bool {
    let space = space.to_ascii_lowercase();
    is_ras(&space) || ["left-posterior-superior", "lps", "left-anterior-superior", "las"].contains(&space.as_str())
}

/// True if the axes of a space are right, anterior, superior.
fn is_ras(space: &str) -> bool {
    ["right-anterior-superior", "ras"].iter().any(|name| space.eq_ignore_ascii_case(name))
}

/// Placement by spacings and by the ends of the axes, which count from the centres of voxels or from their outer faces.
fn by_axis(
    fields: &Fields,
    layout: &Layout,
    (columns, origin): (&mut [DVec3; 3], &mut DVec3),
    notes: &mut Vec<String>,
) -> Result<()> {
    let list = |names: &[&str]| -> Result<Vec<f64>> {
        let Some(text) = fields.get(names) else { return Ok(Vec::new()) };
        // `nan` stands where nothing is known.
        let number = |w: &str| w.parse().ok().filter(|v: &f64| !v.is_infinite()).ok_or_else(|| wrong(names[0], text));
        text.split_whitespace().map(number).collect()
    };
    let (spacings, low, high) =
        (list(&["spacings"])?, list(&["axis mins", "axismins"])?, list(&["axis maxs", "axismaxs"])?);
    let centerings: Vec<&str> = fields.get(&["centers", "centerings"]).unwrap_or("").split_whitespace().collect();
    let mut unknown = Vec::new();
    for (i, axis) in layout.space.iter().enumerate() {
        let known = |list: &[f64]| list.get(*axis).copied().filter(|v| !v.is_nan());
        let cell = centerings.get(*axis) != Some(&"node");
        let count = layout.sizes[*axis] as f64 - if cell { 0.0 } else { 1.0 };
        let from_ends = known(&high).zip(known(&low)).map(|(h, l)| (h - l) / count.max(1.0));
        let spacing = known(&spacings).or(from_ends);
        if spacing.is_none() {
            unknown.push(["first", "second", "third"][i]);
        }
        let spacing = spacing.unwrap_or(1.0);
        columns[i] *= spacing;
        origin[i] = known(&low).map_or(0.0, |low| if cell { low + 0.5 * spacing } else { low });
    }
    if !unknown.is_empty() {
        let axes = unknown.join(", ");
        notes.push(format!(
            "the file does not say how large its voxels are along the axes in space: {axes}; 1 is taken"
        ));
    }
    Ok(())
}

/// Opens a header with its values.
///
/// # Errors
/// If a field is missing or cannot be understood, the values are of a kind that is not read, or a file is too short.
pub(crate) fn open(path: &Path, options: &Options) -> Result<Vec<Image>> {
    let mut listing = false;
    let (mut lines, length) = text::lines(path, |line| {
        listing |= line.to_ascii_lowercase().replace(' ', "").starts_with("datafile:list");
        // After a list come the names of files, up to the end.
        line.is_empty() && !listing
    })?;
    let split = lines.iter().position(|l| l.to_ascii_lowercase().replace(' ', "").starts_with("datafile:list"));
    let rest = split.map_or_else(Vec::new, |at| lines.split_off(at + 1));
    let fields = Fields::of(&lines)?;
    let data = Data::of(&fields, path, length, &rest)?;
    let layout = Layout::of(&fields)?;
    let mut notes = Vec::new();
    let index_to_world = placement(&fields, &layout, &mut notes)?;
    notes.extend(unit(&fields, &layout));
    let time = options.choose_time(layout.length(layout.list), &mut notes)?;
    let slices = slices(&data, &layout, time)?;
    let values = if data.sample.is_integer() { Values::Integer } else { Values::Real };
    let components = layout.length(layout.components);
    let anatomical = fields.get(&["space"]).is_some_and(is_anatomical);
    let about = About { sample: Some(data.sample), anatomical, ..About::default() };
    if fields.get(&["space"]).is_some_and(|space| !is_ras(space)) {
        notes.extend(placement::unturned(values, components));
    }
    if components == 3 && fields.get(&["measurement frame"]).is_some() {
        notes.push("the measurement frame, in which vectors are stated, is not applied".into());
    }
    Ok(vec![Image {
        header: Header { name: None, size: layout.size(), components, values, index_to_world, about, notes },
        slices,
    }])
}

fn slices(data: &Data, layout: &Layout, time: usize) -> Result<Box<dyn Slices>> {
    let total = layout.sizes.iter().try_fold(data.sample.bytes() as u64, |p, n| p.checked_mul(*n as u64));
    let too_many = || Error::invalid(format!("{:?} values are too many", layout.sizes)).hint(AGAIN);
    let total = total.ok_or_else(too_many)?;
    let list = layout.step(layout.list);
    // What varies faster than space, other than a voxel's components, would have to be left out value by value.
    let before: usize = layout.sizes[..layout.space[0]].iter().product();
    let together =
        if layout.components.is_some_and(|a| a < layout.space[0]) { layout.length(layout.components) } else { 1 };
    if before != together {
        return Err(Error::unsupported("the points in time are the fastest axis")
            .hint("write the file with the axis of time last: unu permute"));
    }
    if data.files.len() > 1 {
        return files(data, layout, total, time);
    }
    let file = data.files.first().ok_or_else(|| wrong("data file", "an empty list"))?;
    volume(data, layout, file, time as u64 * list, total)
}

/// Slices of the volume that begins at number `first` of those of a file of `total` bytes.
fn volume(data: &Data, layout: &Layout, file: &Path, first: u64, total: u64) -> Result<Box<dyn Slices>> {
    let voxels = layout.size().iter().product::<usize>() as u64;
    match layout.components.filter(|a| *a > layout.space[0]) {
        None => data.slices(file, (first, voxels * layout.length(layout.components) as u64), Some(total)),
        Some(axis) => {
            let step = layout.step(Some(axis));
            let part = |c: usize| data.slices(file, (first + c as u64 * step, voxels), Some(total));
            Ok(Box::new(Planar::new((0..layout.sizes[axis]).map(part).collect::<Result<_>>()?)))
        }
    }
}

/// Slices in files of equal shares of the slowest axis, one after the other.
fn files(data: &Data, layout: &Layout, total: u64, time: usize) -> Result<Box<dyn Slices>> {
    let count = data.files.len();
    let slowest = layout.sizes.last().copied().unwrap_or(1);
    let slow = layout.sizes.len() - 1;
    let last = layout.space.last() == Some(&slow);
    if !total.is_multiple_of(count as u64)
        || (last && !slowest.is_multiple_of(count))
        || !last && (layout.list != Some(slow) || slowest != count)
    {
        return Err(Error::unsupported(format!("{count} files for {:?} values", layout.sizes))
            .hint("each file must hold as many slices as every other, or one point in time"));
    }
    let share = total / count as u64;
    if !last {
        return volume(data, layout, &data.files[time], 0, share);
    }
    Ok(Box::new(Files::new(data, share, slowest / count)))
}
