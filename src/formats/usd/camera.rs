//! Cameras of stages.
//!
//! Apertures and focal lengths are in tenths of a stage unit, of which perspective cameras need the ratios alone. The
//! window on the image plane is centred at the aperture's offsets. Pixels are square: pictures keep the horizontal
//! aperture where it is the larger one, else the vertical one, as in Blender's import, and show more or less along the
//! other edge if the picture has other proportions. Cameras of captures whose pixels are not square have
//! `cumulo:pixelAspectRatio`, the width of a pixel over its height, as settings of UsdRender do.
//!
//! A camera with an f-stop has an aperture, a disc whose diameter is the focal length over the f-stop. One whose
//! shutter is open for some time moves in it as its transforms do.

use super::prim::Prim;
use super::stage::Stage;
use crate::error::{Error, Result};
use crate::scene::blur::{Aperture, Blur, Shutter};
use crate::scene::camera::{Camera, Projection};
use glam::{DMat3, DMat4, DVec2};

/// Stage units for a unit of the aperture.
const APERTURE_UNIT: f64 = 0.1;

/// Optics of a camera at a time code, in the units of the stage.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Film {
    projection: Projection,
    focal_length: f64,
    aperture: DVec2,
    offset: DVec2,
    near: f64,
    lens: Option<Aperture>,
}

/// Reads the optics; attributes that are not stated have the schema's fallbacks.
fn film(prim: &Prim, time: f64) -> Result<Film> {
    let number = |name: &str, fallback: f64| prim.number(name, time).unwrap_or(fallback);
    let projection = match prim.text("projection", time).as_deref() {
        None | Some("perspective") => Projection::Perspective,
        Some("orthographic") => Projection::Orthographic,
        Some(other) => {
            return Err(Error::unsupported(format!("the projection '{other}' is unknown"))
                .hint("perspective and orthographic cameras are understood"));
        }
    };
    let film = Film {
        projection,
        focal_length: number("focalLength", 50.0),
        aperture: DVec2::new(number("horizontalAperture", 20.955), number("verticalAperture", 15.2908)),
        offset: DVec2::new(number("horizontalApertureOffset", 0.0), number("verticalApertureOffset", 0.0)),
        near: prim.tuple::<2>("clippingRange", time).unwrap_or([1.0, 1e6])[0],
        lens: None,
    };
    let bad = |what: String| Err(Error::invalid(what).hint("correct the camera in the stage"));
    if !(film.aperture.is_finite() && film.aperture.min_element() > 0.0) {
        return bad(format!("apertures {} x {} must be positive and finite", film.aperture.x, film.aperture.y));
    }
    if !(film.focal_length > 0.0 && film.focal_length.is_finite()) && projection == Projection::Perspective {
        return bad(format!("focal length {} must be positive and finite", film.focal_length));
    }
    let [f_stop, focus] = ["fStop", "focusDistance"].map(|name| number(name, 0.0));
    let radius = 0.5 * APERTURE_UNIT * film.focal_length / f_stop;
    let lens = (f_stop > 0.0 && focus > 0.0).then(|| Aperture::disc(radius, focus));
    Ok(Film { lens, ..film })
}

/// Returns a motion with axes that are orthogonal and of unit length, of which the viewing axis is kept.
fn straightened(motion: DMat4) -> DMat4 {
    let [x, y, z] = [motion.x_axis, motion.y_axis, motion.z_axis].map(|axis| axis.truncate());
    let back = z.normalize_or_zero();
    let right = x.reject_from_normalized(back).normalize_or_zero();
    let up = back.cross(right) * back.cross(right).dot(y).signum();
    DMat4::from_mat3_translation(DMat3::from_cols(right, up, back), motion.w_axis.truncate())
}

/// Returns the times as the shutter opens and closes, relative to that of a frame; none where it is never open.
fn exposed(camera: &Prim, time: f64) -> Option<[f64; 2]> {
    let relative = |name: &str| camera.number(name, time).unwrap_or_default();
    let [open, close] = [relative("shutter:open"), relative("shutter:close")];
    (close > open && open.is_finite() && close.is_finite()).then_some([open, close])
}

/// Returns the width of a pixel over its height.
///
/// # Errors
/// If it is not positive and finite.
fn pixel_aspect(camera: &Prim, time: f64) -> Result<f64> {
    let aspect = camera.number("cumulo:pixelAspectRatio", time).unwrap_or(1.0);
    if aspect > 0.0 && aspect.is_finite() {
        return Ok(aspect);
    }
    Err(Error::invalid(format!("'cumulo:pixelAspectRatio' of {aspect} must be positive and finite"))
        .hint("correct it, or remove it for square pixels"))
}

impl Stage {
    /// True if a volume has velocities by the name of its field.
    fn is_blown(&self) -> bool {
        let names = |volume: &Prim| volume.relationships.keys().any(|name| super::volume::is_velocity(name));
        self.volumes().any(names)
    }

    /// Returns the cameras, in their order.
    pub(crate) fn cameras(&self) -> impl Iterator<Item = &Prim> {
        self.of_type("Camera")
    }

    /// Returns the camera of that path or name, or the only one.
    ///
    /// # Errors
    /// If there is none, several and none is named, or none of that name; the error lists those that there are.
    pub fn camera(&self, name: Option<&str>) -> Result<&Prim> {
        let all: Vec<&Prim> = self.cameras().collect();
        let listed = all.iter().take(20).map(|prim| prim.path.as_str()).collect::<Vec<_>>().join(", ");
        let wanted = |prim: &&&Prim| name.is_some_and(|name| prim.path == name || prim.name() == name);
        let found: Vec<&Prim> = if name.is_some() { all.iter().filter(wanted).copied().collect() } else { all.clone() };
        match (&found[..], name) {
            ([only], _) => Ok(*only),
            _ if all.is_empty() => Err(Error::invalid("the stage has no camera")
                .hint("add a camera to the stage, or give cameras with ⟨cameras⟩ or ⟨views⟩")),
            ([], Some(name)) => Err(Error::invalid(format!("no camera is '{name}'; the stage has {listed}"))
                .hint("give the path of one of these")),
            _ => Err(Error::invalid(format!("several cameras could be meant: {listed}"))
                .hint("choose one by its path with ⟨camera⟩")),
        }
        .map_err(|e| e.at(&self.path))
    }

    /// Returns the size of the pictures that a camera takes: the one that Cumulo wrote with it, else `width` pixels by
    /// as many as the apertures' proportions give.
    ///
    /// # Errors
    /// If the camera's apertures cannot be used.
    pub(crate) fn picture_size(&self, camera: &Prim, time: f64, width: u32) -> Result<[u32; 2]> {
        if let Some([w, h]) = camera.tuple::<2>("cumulo:resolution", time) {
            let side = |v: f64| (1.0..=65_536.0).contains(&v).then_some(v as u32);
            if let (Some(w), Some(h)) = (side(w), side(h)) {
                return Ok([w, h]);
            }
        }
        let film = film(camera, time).map_err(|e| self.blame(e, camera))?;
        let height = (f64::from(width) * film.aperture.y / film.aperture.x).round().clamp(1.0, 65_536.0);
        Ok([width, height as u32])
    }

    /// Returns a camera at a time code with pictures of `size`, width and height in pixels.
    ///
    /// # Errors
    /// If its projection is unknown, a number cannot be used, or its axes are sheared; the error names the stage and
    /// the camera.
    pub fn view(&self, camera: &Prim, time: f64, size: [u32; 2]) -> Result<Camera> {
        let blame = |e: Error| self.blame(e, camera);
        let Film { projection, focal_length, aperture, offset, near, lens } = film(camera, time).map_err(blame)?;
        let edges = DVec2::new(f64::from(size[0]), f64::from(size[1]));
        // Pixels per unit of the image plane.
        let aspect = pixel_aspect(camera, time).map_err(blame)?;
        let pixels = match aperture.x >= aperture.y {
            true => edges.x / aperture.x * DVec2::new(1.0, aspect),
            false => edges.y / aperture.y * DVec2::new(1.0 / aspect, 1.0),
        };
        let focal = match projection {
            Projection::Perspective => pixels * focal_length,
            Projection::Orthographic => pixels / APERTURE_UNIT,
        };
        let exposed = exposed(camera, time).filter(|_| self.is_moving(camera) || self.is_blown());
        let at = |shift: f64| self.local_to_world(camera, time + shift);
        // Between keys, matrices are interpolated number by number, which leaves their axes askew.
        let straight = |shift: f64| at(shift).map(straightened);
        let shutter = exposed.map(|[open, close]| {
            let [start, end] = [straight(open)?, straight(close)?];
            Ok::<_, Error>(Shutter { start, end, open: Some([open, close]) })
        });
        let middle = exposed.map_or(0.0, |[open, close]| 0.5 * (open + close));
        let camera_to_world = if middle == 0.0 { at(0.0)? } else { straight(middle)? };
        let view = Camera {
            camera_to_world,
            projection,
            focal,
            centre: 0.5 * edges + pixels * DVec2::new(-offset.x, offset.y),
            width: size[0],
            height: size[1],
            near: near.max(0.0),
            blur: Blur { aperture: lens, shutter: shutter.transpose()? },
        };
        let advised = |e: Error| match e.remedy().is_some() {
            true => e,
            false => e.hint("correct the camera's attributes, and scales of prims above it that shear its axes"),
        };
        view.checked().map_err(|e| blame(advised(e)))
    }

    /// Returns what a camera states and pictures do not show: an f-stop without a focus, an exposure, clipping.
    pub(crate) fn camera_remarks(&self, camera: &Prim, time: f64) -> Vec<String> {
        let number = |name: &str| camera.number(name, time).unwrap_or_default();
        let told = [
            (
                number("fStop") > 0.0 && number("focusDistance") <= 0.0,
                "it has an f-stop and no focusDistance, without which its depth of field is not known: all is sharp",
            ),
            (
                number("exposure") != 0.0 || camera.attributes.keys().any(|name| name.starts_with("exposure:")),
                "its exposure has no effect: pictures are in the scene's radiance",
            ),
            (
                camera.attribute("clippingPlanes").is_some_and(|a| a.values().any(has_elements)),
                "its clipping planes have no effect",
            ),
        ];
        let remark = |(on, what): (bool, &str)| on.then(|| format!("camera {}: {what}", camera.path));
        told.into_iter().filter_map(remark).collect()
    }

    /// Names the stage and a prim in an error.
    pub(super) fn blame(&self, error: Error, prim: &Prim) -> Error {
        error.part(format!("prim {}", prim.path)).at(&self.path)
    }
}

fn has_elements(value: &super::Value) -> bool {
    value.list().is_some_and(|list| !list.is_empty())
}
