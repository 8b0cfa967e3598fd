//! The sheet of a capture: its views, and where its cameras stand.

use super::shown::{Capture as ShownCapture, Content};
use super::{ViewSettings, exposure, name_of};
use crate::error::{Error, Result};
use crate::formats::captures;
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::picture::{self, Options};
use crate::formats::png::ToneMapping;
use crate::report::sheet::{Canvas, Sheet, Stand, Tile, fitted, plan};
use crate::scene::camera::{Camera, Projection};
use crate::scene::capture::{Capture, Frame};
use crate::scene::color_space::ColorSpace;
use crate::scene::film::Film;
use crate::scene::up::Up;
use glam::DVec3;
use rayon::prelude::*;
use std::path::Path;

/// Longer side of a view in pixels, and of the plan.
const SIDE: usize = 160;
const PLAN: usize = 360;
/// Most views of a sheet.
const MOST: usize = 100;
/// Most cameras that have their numbers on the plan.
const NUMBERED: usize = 60;

/// Draws the sheet of a capture.
///
/// # Errors
/// If the capture cannot be read, or has no views. Pictures that cannot be read are shown as missing.
pub(super) fn sheet(view: &ViewSettings, path: &Path) -> Result<(Sheet, Content)> {
    let capture = captures::stated_within(path, view.limits)?.capture;
    let count = capture.frames.len();
    if count == 0 {
        return Err(Error::invalid("the capture has no views").at(path).hint("check the list 'frames' of its file"));
    }
    let shown = evenly(count, MOST);
    let side = view.side(SIDE, shown.len()).map_err(|e| e.at(path))?;
    // One picture on each thread, and its brightest channel in order.
    let each = Limits { max_memory: view.limits.max_memory / 2 / rayon::current_num_threads().max(1) as u64 };
    let pictures: Vec<Result<Thumbnail>> =
        shown.par_iter().map(|i| thumbnail(&capture, &capture.frames[*i], side, each)).collect();
    let white = pictures.iter().flatten().filter(|t| t.linear).map(|t| t.white).fold(0.0, f64::max);
    let exposure = view.exposure.unwrap_or_else(|| exposure::making_white(white));
    let missing = shown.iter().zip(&pictures).filter(|(_, p)| p.is_err()).map(|(i, _)| *i).collect();
    let lead = Some(plan_of(&capture, side.max(PLAN), view.up.stated().unwrap_or_default()));
    let views = shown.iter().zip(&pictures).map(|(i, picture)| {
        let frame = &capture.frames[*i];
        let (picture, caption) = match picture {
            Ok(Thumbnail { film, .. }) => {
                let rgb = ToneMapping { exposure }.rgb8(film);
                (Canvas::of(film.width, film.height, rgb), name_of(&frame.picture))
            }
            Err(e) => {
                let height = side * frame.camera.height as usize / frame.camera.width.max(1) as usize;
                let words = format!("{}: {}", name_of(&frame.picture), e.what());
                (Canvas::new(side, height.clamp(16, side), [232, 232, 230]), words)
            }
        };
        Tile { title: format!("view {i}"), picture, caption: vec![caption] }
    });
    let tiles: Vec<Tile> = views.collect();
    let title = name_of(&std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf()));
    let columns = Sheet::columns_of(tiles.len());
    let sheet = Sheet { title, lines: lines(&capture, shown.len(), exposure), lead, tiles, columns };
    Ok((sheet, Content::Capture(ShownCapture { views: count, shown, missing, exposure })))
}

/// Numbers from 0 to `count`, at most `most` of them, evenly.
pub(super) fn evenly(count: usize, most: usize) -> Vec<usize> {
    if count <= most || most < 2 {
        return (0..count.min(most)).collect();
    }
    (0..most).map(|i| i * (count - 1) / (most - 1)).collect()
}

struct Thumbnail {
    film: Film,
    /// Radiance that 99 % of the pixels stay below.
    white: f64,
    /// True for pictures of floating-point samples, which have no white of their own.
    linear: bool,
}

fn thumbnail(capture: &Capture, frame: &Frame, side: usize, limits: Limits) -> Result<Thumbnail> {
    let format = picture::format(&frame.picture)?;
    let color_space = capture.color_space.or(Some(ColorSpace::Srgb));
    let options = Options { color_space, background: capture.background, limits, ..Options::default() };
    let film = picture::read_or_flattened(&frame.picture, &options)?.film;
    Ok(Thumbnail {
        white: exposure::white_of(&film),
        linear: matches!(format.kind, FileKind::Exr | FileKind::DeepExr),
        film: fitted(&film, side),
    })
}

fn lines(capture: &Capture, shown: usize, exposure: f64) -> Vec<String> {
    let count = capture.frames.len();
    let s = if count == 1 { "" } else { "s" };
    let mut lines = vec![format!("{count} view{s}, exposure {exposure:+.1} EV, clipped, sRGB")];
    if shown < count {
        lines.push(format!("{shown} of them are shown, evenly chosen"));
    }
    let mut sizes: Vec<[u32; 2]> = capture.frames.iter().map(|f| [f.camera.width, f.camera.height]).collect();
    sizes.sort_unstable();
    sizes.dedup();
    match sizes[..] {
        [[w, h]] => lines.push(format!("{w} x {h} pixels each")),
        _ => lines.push(format!("pictures of {} sizes", sizes.len())),
    }
    lines
}

/// The plan of a capture's cameras.
fn plan_of(capture: &Capture, side: usize, up: Up) -> Tile {
    let numbered = capture.frames.len() <= NUMBERED;
    let stand = |(i, frame): (usize, &Frame)| Stand {
        label: numbered.then(|| i.to_string()),
        position: frame.camera.position(),
        forward: frame.camera.forward(),
        half_angle: half_angle(&frame.camera),
    };
    let stands: Vec<Stand> = capture.frames.iter().enumerate().map(stand).collect();
    let target: Vec<DVec3> = target(&stands).into_iter().collect();
    let (picture, bar) = plan(&stands, &target, side, up);
    let mut caption = vec![format!("bar: {} world units", crate::report::short(bar))];
    caption.push("orange cameras are above the middle height, blue ones below".into());
    if let [target] = target[..] {
        let [x, y, z] = target.to_array().map(crate::report::short);
        caption.push(format!("grey: where they look, ({x}, {y}, {z})"));
    }
    let title = format!("cameras from above (along -{})", up.name().to_ascii_lowercase());
    Tile { title, picture, caption }
}

/// Half of the angle of view across, in radians; 0 for parallel rays.
fn half_angle(camera: &Camera) -> f64 {
    match camera.projection {
        Projection::Perspective => (0.5 * f64::from(camera.width) / camera.focal.x).atan(),
        Projection::Orthographic => 0.0,
    }
}

/// The point nearest to all lines of sight, by least squares; none if they are parallel, or it lies behind most
/// cameras.
fn target(stands: &[Stand]) -> Option<DVec3> {
    let (mut matrix, mut right) = (glam::DMat3::ZERO, DVec3::ZERO);
    for stand in stands {
        let d = stand.forward;
        let across = glam::DMat3::IDENTITY - glam::DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        matrix += across;
        right += across * stand.position;
    }
    // Parallel lines leave the point undetermined along their direction.
    let scale = stands.len() as f64;
    let point = (matrix.determinant() > 1e-6 * scale.powi(3)).then(|| matrix.inverse() * right)?;
    let ahead = stands.iter().filter(|s| (point - s.position).dot(s.forward) > 0.0).count();
    (point.is_finite() && 2 * ahead > stands.len()).then_some(point)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    #[test]
    fn lines_of_sight_meet_where_cameras_look() {
        let looking = |at: DVec3, from: DVec3| Stand {
            label: None,
            position: from,
            forward: (at - from).normalize(),
            half_angle: 0.3,
        };
        let at = DVec3::new(1.0, 2.0, 3.0);
        let ring: Vec<Stand> =
            (0..5).map(|i| looking(at, at + (4.0 * DVec2::from_angle(f64::from(i))).extend(1.0))).collect();
        assert!((target(&ring).unwrap_or(DVec3::NAN) - at).length() < 1e-9);
        let parallel = [DVec3::X, DVec3::Y].map(|p| Stand { forward: DVec3::Z, ..looking(at, p) });
        assert_eq!(target(&parallel), None);
    }

    #[test]
    fn views_are_chosen_evenly() {
        assert_eq!(evenly(3, 10), [0, 1, 2]);
        assert_eq!(evenly(101, 5), [0, 25, 50, 75, 100]);
        assert_eq!(evenly(2, 1), [0]);
    }
}
