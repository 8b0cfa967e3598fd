//! The sheet of a VDB's grid: picture, slices, histogram.

use super::shown::{Content, Volume};
use super::slices::{self, Orientation, Slice};
use super::subject::Subject;
use super::{ViewSettings, camera, name_of};
use crate::app::Context;
use crate::app::statistics::statistics_of;
use crate::error::{Error, Result};
use crate::formats::png::ToneMapping;
use crate::formats::vdb::{File, GridInfo, NativeGrid, Transform};
use crate::report::sheet::{Canvas, Histogram, Range, Sheet, Tile, grey, with_axes};
use crate::report::short;
use crate::scene::up::Up;
use std::path::Path;

/// Longer side of pictures in pixels.
const SIDE: usize = 320;
/// Share of a slice's pixels that may be darker than black, and brighter than white.
const OUTSIDE: f64 = 0.002;

/// Draws the sheet of a VDB.
///
/// # Errors
/// If the file cannot be read, or the grid has no values to show.
pub(super) fn sheet(view: &ViewSettings, path: &Path, context: &Context) -> Result<(Sheet, Content)> {
    let file = view.open(path)?;
    let native = file.read(&name(view, &file)?)?;
    let located = |e: Error| e.at(path);
    let info = native.info().map_err(located)?;
    if info.components == 0 {
        return Err(Error::unsupported(format!("the grid holds {}, which have no values to show", info.value_type))
            .at(path)
            .part(format!("grid '{}'", info.name))
            .hint("choose another grid with ⟨grid⟩; cumulo info lists them"));
    }
    let side = view.side(SIDE, 5).map_err(located)?;
    let statistics = statistics_of(&native).map_err(located)?;
    let map = match &info.transform {
        Transform::Affine(map) => Some(map),
        Transform::Other(_) => None,
    };
    let voxel = map.map(|map| map.voxel_size().to_array());
    let up = view.up_of(&file);
    let orientation = Orientation::of(map, up);
    let slices = slices::central(&native, &info, voxel.unwrap_or([1.0; 3]), orientation, side).map_err(located)?;
    let range = range_of(&info, &slices);
    let Drawn { tile: picture, density_scale, meaning } =
        picture(view, &native, &info, (side, up), context).map_err(located)?;
    let ends = [statistics.min, statistics.max].map(|v| v.map_or(0.0, f64::from));
    let histogram = Histogram { counts: statistics.histogram.clone(), range: ends };
    let edges = histogram.edges();
    let dimensions =
        info.index_box.map_or([0; 3], |(low, high)| [0, 1, 2].map(|a| high[a].abs_diff(low[a]) as u64 + 1));
    let volume = Volume {
        grid: info.name.clone(),
        grids: file.entries().iter().map(|entry| entry.name.clone()).collect(),
        value_type: info.value_type.clone(),
        class: info.class.name(),
        dimensions,
        voxel_size: voxel,
        active_voxels: info.active_voxels,
        density: meaning,
        density_scale,
        exposure: view.exposure.unwrap_or(0.0),
        slices: slices.iter().map(|slice| slice.cut).collect(),
        range,
        statistics,
        edges,
    };
    let mut tiles = vec![picture];
    tiles.extend(slices.iter().map(|slice| tile(slice, range, side)));
    tiles.push(Tile {
        title: "histogram".into(),
        picture: histogram.draw(side, side * 3 / 4),
        caption: vec![
            format!(
                "{} bins, {} wide each",
                volume.edges.len() - 1,
                short((ends[1] - ends[0]) / (volume.edges.len() - 1) as f64)
            ),
            "heights are logarithms of counts".into(),
        ],
    });
    Ok((
        Sheet { title: name_of(path), lines: lines(&volume, &info), lead: None, tiles, columns: 5 },
        Content::Volume(volume.into()),
    ))
}

/// Name of the grid to show.
pub(super) fn name(view: &ViewSettings, file: &File) -> Result<String> {
    if let Some(name) = &view.grid {
        return file.find(name).map(|entry| entry.name.clone());
    }
    match (file.density_name(), file.entries().first()) {
        (Ok(name), _) => Ok(name),
        (Err(_), Some(first)) => Ok(first.name.clone()),
        (Err(e), None) => Err(e),
    }
}

/// Values that are black and white in all slices: 0 is black where there are no values below it.
fn range_of(info: &GridInfo, slices: &[Slice]) -> Option<Range> {
    let background = slices::background(info);
    let values = || slices.iter().flat_map(|slice| slice.film.rgba.iter().map(|p| p[0]));
    // What is empty says nothing about what is not.
    let full = Range::of(values().filter(|v| *v != background), OUTSIDE).or_else(|| Range::of(values(), 0.0))?;
    Some(if full.low > 0.0 && background == 0.0 { Range { low: 0.0, ..full } } else { full })
}

fn tile(slice: &Slice, range: Option<Range>, side: usize) -> Tile {
    let range = range.unwrap_or(Range { low: 0.0, high: 1.0 });
    let [width, height] = slice.extent;
    let longest = width.max(height).max(f64::MIN_POSITIVE);
    let [w, h] = [width, height].map(|v| ((side as f64 * v / longest).round() as usize).clamp(1, side));
    let picture = grey(&slice.film, range).resampled(w, h);
    Tile {
        title: format!("{} = {}", slice.cut.axis, slice.cut.index),
        picture: with_axes(&picture, slice.cut.right, slice.cut.up),
        caption: vec![
            format!("{} x {} world units", short(width), short(height)),
            format!("black {}, white {}", short(range.low), short(range.high)),
        ],
    }
}

/// The picture of a density.
struct Drawn {
    tile: Tile,
    /// Extinction per unit of density and length; none where there is nothing to see.
    density_scale: Option<f64>,
    /// Meaning of the density, in words.
    meaning: &'static str,
}

/// Draws the picture; where none can be made, a tile says why, since slices can still be shown.
fn picture(
    view: &ViewSettings,
    native: &NativeGrid,
    info: &GridInfo,
    (side, up): (usize, Up),
    context: &Context,
) -> Result<Drawn> {
    let by_setting = view.transfer.tf.is_some();
    let blank = |words: &str, meaning| {
        let picture = Canvas::new(side / 2, side / 2, [232, 232, 230]);
        let tile = Tile { title: "no picture".into(), picture, caption: vec![words.to_owned()] };
        Ok(Drawn { tile, density_scale: None, meaning })
    };
    let subject = match Subject::of(view, native, info, context) {
        Ok(subject) => subject,
        Err(e) if by_setting => return Err(e),
        Err(e) => return blank(&e.what(), "nothing"),
    };
    let (meaning, title) = (subject.meaning, subject.light());
    let outline = subject.field.outline();
    if outline.is_empty() {
        return blank("the grid is empty", meaning);
    }
    let camera = subject.framed(&camera::around(&outline, side, up), side);
    let Some(scale) = subject.scale(view, &camera) else { return blank("nothing absorbs light", meaning) };
    let film = subject.picture(&camera, scale, &context.cancel())?;
    let exposure = view.exposure.unwrap_or(0.0);
    let rgb = ToneMapping { exposure }.rgb8(&film);
    let tile = Tile {
        title: title.into(),
        picture: Canvas::of(film.width, film.height, rgb),
        caption: vec![
            meaning.into(),
            format!("density scale {}", short(scale)),
            format!("{} is up", up.name().to_ascii_lowercase()),
            format!("exposure {:+.1} EV, clipped, sRGB", exposure),
        ],
    };
    Ok(Drawn { tile, density_scale: Some(scale), meaning })
}

fn lines(volume: &Volume, info: &GridInfo) -> Vec<String> {
    let [x, y, z] = volume.dimensions;
    let mut lines = vec![format!("grid '{}': {}, {}", volume.grid, volume.value_type, volume.class)];
    let size = match volume.voxel_size {
        Some([a, b, c]) => format!(" of {} x {} x {} world units", short(a), short(b), short(c)),
        None => format!(" ({})", info.map_type),
    };
    lines.push(format!("{x} x {y} x {z} voxels{size}, {} of them active", volume.active_voxels));
    let statistics = &volume.statistics;
    if let (Some(min), Some(max), Some(mean)) = (statistics.min, statistics.max, statistics.mean) {
        let mut line = format!("min {}, max {}, mean {}", short(min.into()), short(max.into()), short(mean));
        if statistics.nan + statistics.infinite > 0 {
            line += &format!(", {} NaN, {} infinite", statistics.nan, statistics.infinite);
        }
        lines.push(line);
    }
    if volume.grids.len() > 1 {
        lines.push(format!("grids of the file: {}", volume.grids.join(", ")));
    }
    lines
}
