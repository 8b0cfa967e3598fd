//! The pictures of a figure, with their cameras.

use super::drawing::Raster;
use super::settings::{Background, CameraOf, FigureSettings};
use crate::app::pictured::Stated;
use crate::error::{Code, Error, Result};
use crate::formats::format::FileKind;
use crate::formats::png::ToneMapping;
use crate::formats::{captures, picture, registry};
use crate::scene::camera::Camera;
use crate::scene::capture::Capture;
use crate::scene::color_space::ColorSpace;
use crate::scene::display;
use crate::scene::film::Film;
use std::path::{Path, PathBuf};

/// A picture for a figure.
pub(super) struct Panel {
    pub picture: PathBuf,
    pub raster: Raster,
    /// Camera, if it is known.
    pub camera: Option<Camera>,
    /// Distance along the viewing axis to what the camera looks at, if it is known.
    pub distance: Option<f64>,
    /// Remark on the background, if it is not known.
    pub remark: Option<String>,
}

impl FigureSettings {
    /// Reads a picture; `camera` is the one that is stated for it.
    ///
    /// # Errors
    /// If the picture or its camera cannot be read.
    pub(super) fn panel(&self, path: &Path, camera: Option<&CameraOf>) -> Result<Panel> {
        let stated = Stated::of(path)?;
        let (color_space, integers) = match picture::format(path)?.kind {
            FileKind::Picture(_) => (picture::header(path)?.color_space.or(Some(ColorSpace::Srgb)), true),
            _ => (None, false),
        };
        let options = picture::Options { color_space, limits: self.limits, ..picture::Options::default() };
        let film = picture::read(path, &options)?.film;
        let size = [film.width as u32, film.height as u32];
        let (camera, distance) = match camera {
            Some(of) => (Some(of.camera(path, self.limits)?), None),
            None => (stated.camera.map(|c| c.camera()).transpose()?, stated.camera.and_then(|c| c.distance)),
        };
        let camera = camera.map(|camera| fitted(camera, size)).transpose().map_err(|e| e.at(path))?;
        let translucent = film.rgba.iter().any(|pixel| pixel[3] < 1.0);
        let unknown = self.background.is_some() && translucent && !integers && stated.background.is_none();
        let remark = unknown.then(|| {
            format!(
                "{}: the picture does not state the radiance behind the volume, which is taken as 0",
                path.display()
            )
        });
        let behind = stated.background.unwrap_or_default();
        let raster = rasterized(&film, ToneMapping { exposure: self.exposure }, self.background, behind);
        let distance = self.distance.or(distance);
        Ok(Panel { picture: path.to_path_buf(), raster, camera, distance, remark })
    }
}

/// Returns a camera with the size of its picture.
fn fitted(camera: Camera, [width, height]: [u32; 2]) -> Result<Camera> {
    let [was_wide, was_high] = [camera.width, camera.height];
    let apart = f64::from(width) * f64::from(was_high) - f64::from(height) * f64::from(was_wide);
    // Sizes that were rounded are one pixel off.
    if apart.abs() > f64::from(was_wide.max(was_high)) {
        return Err(Error::invalid(format!(
            "the picture is {width}x{height} pixels large, and its camera's {was_wide}x{was_high}"
        ))
        .hint("give the capture that the picture belongs to with ⟨camera⟩"));
    }
    Ok(camera.resized([width, height]))
}

/// Returns a film as it is shown. `behind` is the radiance behind the volume, in place of which the page is seen.
fn rasterized(film: &Film, tone: ToneMapping, background: Option<Background>, behind: [f32; 3]) -> Raster {
    let size = [film.width, film.height];
    let factor = tone.exposure.exp2() as f32;
    let Some(background) = background else {
        let rgba = tone.rgb8(film).chunks_exact(3).flat_map(|c| [c[0], c[1], c[2], 255]).collect();
        return Raster { size, rgba };
    };
    // `as` saturates and turns NaN into 0.
    let level = |linear: f32| (255.0 * display::value(linear) + 0.5) as u8;
    let pixel = |p: &[f32; 4]| {
        let alpha = p[3].clamp(0.0, 1.0);
        let own = [0, 1, 2].map(|c| factor * (p[c] - (1.0 - alpha) * behind[c]).max(0.0));
        match background {
            Background::White => [own[0], own[1], own[2], 1.0].map(|v| v + (1.0 - alpha)).map(level),
            Background::Black => [own[0], own[1], own[2], 1.0].map(level),
            Background::Transparent if alpha > 0.0 => {
                let [r, g, b] = own.map(|v| level(v / alpha));
                [r, g, b, (255.0 * alpha + 0.5) as u8]
            }
            Background::Transparent => [0; 4],
        }
    };
    Raster { size, rgba: film.rgba.iter().flat_map(pixel).collect() }
}

impl CameraOf {
    /// Reads the camera of a picture: that of the view that is stated, else the one whose picture has the name, else
    /// the only one.
    ///
    /// # Errors
    /// If the capture cannot be read, or does not tell which camera it is.
    fn camera(&self, picture: &Path, limits: crate::formats::limits::Limits) -> Result<Camera> {
        if !matches!(registry::sniff(&self.capture)?.kind, FileKind::Capture) {
            return Err(Error::unsupported("this is no capture")
                .at(&self.capture)
                .hint("give a transforms.json or its folder with ⟨camera⟩, such as shots/transforms.json#0"));
        }
        let Capture { frames, .. } = captures::load_within(&self.capture, limits)?;
        let named = || frames.iter().find(|frame| frame.picture.file_stem() == picture.file_stem());
        let found = match (self.view, &frames[..]) {
            (Some(view), _) => frames.get(view as usize),
            (None, [only]) => Some(only),
            (None, _) => named(),
        };
        found.map(|frame| frame.camera).ok_or_else(|| {
            let which = match self.view {
                Some(view) => format!("no view {view}"),
                None => format!("none of the pictures is named like '{}'", picture.display()),
            };
            Error::invalid(format!("{which}: there are {} views", frames.len()))
                .coded(Code::Invalid)
                .at(&self.capture)
                .hint("give the number of the view behind the capture, such as ⟨camera=shots#0⟩")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_takes_the_place_of_what_is_behind() {
        // Half of a white background behind a medium that emits 0.2, and a pixel without medium.
        let film = Film::of(2, 1, vec![[0.7, 0.5, 0.5, 0.5], [1.0, 1.0, 1.0, 0.0]]);
        let tone = ToneMapping { exposure: 0.0 };
        let level = |v: f32| (255.0 * display::value(v) + 0.5) as u8;
        let as_is = rasterized(&film, tone, None, [1.0; 3]);
        assert_eq!(as_is.rgba, [level(0.7), level(0.5), level(0.5), 255, 255, 255, 255, 255]);
        let black = rasterized(&film, tone, Some(Background::Black), [1.0; 3]);
        assert_eq!(black.rgba[..4], [level(0.2), 0, 0, 255]);
        assert_eq!(black.rgba[4..], [0, 0, 0, 255]);
        let white = rasterized(&film, tone, Some(Background::White), [1.0; 3]);
        assert_eq!(white.rgba, as_is.rgba);
        let clear = rasterized(&film, tone, Some(Background::Transparent), [1.0; 3]);
        assert_eq!(clear.rgba, [level(0.4), 0, 0, 128, 0, 0, 0, 0]);
    }
}
