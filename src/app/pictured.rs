//! What a rendered picture states of the camera that it was taken with and of the light behind the volume: OpenEXR's
//! standard matrices for other programs, and all numbers in double precision for this one.

use crate::app::outputs::Content;
use crate::error::{Error, Result};
use crate::formats::exr::{self, Attributes};
use crate::formats::png;
use crate::scene::aim;
use crate::scene::blur::Blur;
use crate::scene::camera::{Camera, Projection};
use crate::scene::scene::Scene;
use crate::scene::volume::Volume;
use glam::{DMat4, DVec2, DVec3, DVec4};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Attribute of the camera as JSON.
const CAMERA: &str = "cumulo:camera";
/// Attribute of the radiance behind the volume: red, green and blue.
pub(crate) const BACKGROUND: &str = "cumulo:background";
/// Attribute of the matrix from the world to the camera's axes: right, up, forward. Row vectors are multiplied by it.
const WORLD_TO_CAMERA: &str = "worldToCamera";
/// Attribute of the matrix from the world to the picture: (0, 0) is its upper left corner, (1, 1) its lower right one.
const WORLD_TO_NDC: &str = "worldToNDC";

/// Camera of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct PictureCamera {
    /// `perspective` or `orthographic`.
    projection: Rays,
    /// Width and height of the picture in pixels.
    size: [u32; 2],
    /// Focal length along x and y: pixels, or pixels per world unit of an orthographic camera.
    focal: [f64; 2],
    /// Principal point in pixels from the top left corner.
    principal_point: [f64; 2],
    /// Distance along the viewing axis to the near plane in world units.
    near: f64,
    /// Rows of the matrix from the camera's axes, right, up and backwards, to the world.
    camera_to_world: [[f64; 4]; 4],
    /// Distance along the viewing axis to what the camera looks at, the middle of the volumes unless stated, in world
    /// units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) distance: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Rays {
    Perspective,
    Orthographic,
}

impl PictureCamera {
    /// Describes a camera that looks at `focus`.
    pub(crate) fn new(camera: &Camera, focus: Option<DVec3>) -> Self {
        let rows = camera.camera_to_world.transpose();
        let depth = focus.map(|focus| (focus - camera.position()).dot(camera.forward()));
        Self {
            projection: match camera.projection {
                Projection::Perspective => Rays::Perspective,
                Projection::Orthographic => Rays::Orthographic,
            },
            size: [camera.width, camera.height],
            focal: camera.focal.to_array(),
            principal_point: camera.centre.to_array(),
            near: camera.near,
            camera_to_world: [rows.x_axis, rows.y_axis, rows.z_axis, rows.w_axis].map(DVec4::into),
            distance: depth.filter(|depth| *depth > 0.0),
        }
    }

    /// Returns the camera.
    ///
    /// # Errors
    /// If a number cannot be used.
    pub(crate) fn camera(&self) -> Result<Camera> {
        let [x, y, z, w] = self.camera_to_world.map(DVec4::from);
        Camera {
            camera_to_world: DMat4::from_cols(x, y, z, w).transpose(),
            projection: match self.projection {
                Rays::Perspective => Projection::Perspective,
                Rays::Orthographic => Projection::Orthographic,
            },
            focal: self.focal.into(),
            centre: self.principal_point.into(),
            width: self.size[0],
            height: self.size[1],
            near: self.near,
            blur: Blur::default(),
        }
        .checked()
    }

    /// Returns the camera of the whole picture of which this is a part that begins at a pixel.
    #[must_use]
    pub(crate) fn within(self, size: [usize; 2], origin: [u32; 2]) -> Self {
        let principal_point = [0, 1].map(|a| self.principal_point[a] + f64::from(origin[a]));
        Self { size: size.map(|side| side as u32), principal_point, ..self }
    }

    /// Adds the camera to the attributes of a picture.
    pub(crate) fn describe(&self, attributes: &mut Attributes) {
        attributes.extend(serde_json::to_string(self).ok().map(|json| (CAMERA.to_owned(), json)));
        if let Ok(camera) = self.camera() {
            let (to_camera, to_ndc) = matrices(&camera);
            attributes.insert(WORLD_TO_CAMERA.into(), text(to_camera));
            attributes.insert(WORLD_TO_NDC.into(), text(to_ndc));
        }
    }
}

/// Returns the matrices from the world to a camera's axes, right, up and forward, and to the picture, as ones by which
/// column vectors are multiplied.
fn matrices(camera: &Camera) -> (DMat4, DMat4) {
    let to_camera = DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0)) * camera.camera_to_world.inverse();
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let (focal, centre) = (camera.focal / size, camera.centre / size);
    let rows = match camera.projection {
        // The third coordinate has no meaning, but the matrix has an inverse.
        Projection::Perspective => [
            DVec4::new(focal.x, 0.0, centre.x, 0.0),
            DVec4::new(0.0, -focal.y, centre.y, 0.0),
            DVec4::new(0.0, 0.0, 1.0, -1.0),
            DVec4::new(0.0, 0.0, 1.0, 0.0),
        ],
        Projection::Orthographic => [
            DVec4::new(focal.x, 0.0, 0.0, centre.x),
            DVec4::new(0.0, -focal.y, 0.0, centre.y),
            DVec4::new(0.0, 0.0, 1.0, 0.0),
            DVec4::new(0.0, 0.0, 0.0, 1.0),
        ],
    };
    let [x, y, z, w] = rows;
    (to_camera, DMat4::from_cols(x, y, z, w).transpose() * to_camera)
}

/// Returns a matrix in the order of OpenEXR, whose row vectors are multiplied by it: the columns one after the other.
fn text(matrix: DMat4) -> String {
    matrix.to_cols_array().map(|v| (v as f32).to_string()).join(" ")
}

/// Names of the attributes that tell of the camera and the background.
pub(crate) const NAMES: [&str; 4] = [CAMERA, BACKGROUND, WORLD_TO_CAMERA, WORLD_TO_NDC];

/// Adds the radiance that cameras see behind the volumes to the attributes of a picture: the one that is `stated`, else
/// that of the scene, if it is the same in all directions.
pub(crate) fn describe_background(stated: Option<[f32; 3]>, scene: &Scene, attributes: &mut Attributes) {
    let of_scene = || scene.environment.map.is_none().then_some(scene.environment.radiance);
    if let Some(radiance) = stated.or_else(of_scene) {
        attributes.insert(BACKGROUND.into(), radiance.map(|v| v.to_string()).join(" "));
    }
}

/// Returns the middle of all that may be seen of a scene's volumes.
pub(crate) fn middle(scene: &Scene) -> Option<DVec3> {
    let points: Vec<DVec3> = scene.volumes.iter().flat_map(Volume::outline).collect();
    (!points.is_empty()).then(|| aim::middle(&points)).filter(|middle| middle.is_finite())
}

/// Statements of a picture.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Stated {
    /// Camera.
    pub camera: Option<PictureCamera>,
    /// Radiance behind the volume in red, green and blue.
    pub background: Option<[f32; 3]>,
}

impl Stated {
    /// Reads what an OpenEXR or a PNG states; nothing where it is neither.
    ///
    /// # Errors
    /// If the camera that it states cannot be read.
    pub(crate) fn of(path: &Path) -> Result<Self> {
        let attributes = match Content::Png.has_name(path) {
            true => png::texts(path).unwrap_or_default(),
            false => exr::header(path).map(|header| header.attributes()).unwrap_or_default(),
        };
        let camera = attributes.get(CAMERA).map(|json| {
            serde_json::from_str(json).map_err(|e| {
                Error::invalid(format!("the attribute '{CAMERA}' is no camera: {e}"))
                    .at(path)
                    .hint("render the picture again, or give its camera with ⟨camera⟩")
            })
        });
        let numbers = |text: &String| text.split(' ').map(str::parse).collect::<Result<Vec<f32>, _>>().ok();
        let background = attributes.get(BACKGROUND).and_then(numbers).and_then(|v| v.try_into().ok());
        Ok(Self { camera: camera.transpose()?, background })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    fn camera(projection: Projection) -> Camera {
        Camera {
            camera_to_world: Camera::look_at(DVec3::new(3.0, -2.0, 1.5), DVec3::new(0.1, 0.2, 0.3), DVec3::Z),
            projection,
            focal: DVec2::new(90.0, 110.0),
            centre: DVec2::new(33.0, 20.5),
            width: 64,
            height: 48,
            near: 0.25,
            blur: Blur::default(),
        }
    }

    #[test]
    fn cameras_return_from_their_json() {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let mut attributes = Attributes::new();
            let stated = PictureCamera::new(&camera(projection), Some(DVec3::ZERO));
            stated.describe(&mut attributes);
            let read: PictureCamera = serde_json::from_str(&attributes[CAMERA]).unwrap();
            assert_eq!(read, stated);
            let (back, original) = (read.camera().unwrap(), camera(projection).checked().unwrap());
            assert!(back.camera_to_world.abs_diff_eq(original.camera_to_world, 1e-15));
            assert_eq!((back.focal, back.centre, back.near), (original.focal, original.centre, original.near));
        }
    }

    /// As OpenEXR defines them: row vectors are multiplied by the matrix, x runs to the right, z forward, and (0, 0) is
    /// the upper left corner of the picture.
    #[test]
    fn matrices_are_those_of_the_standard() {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let camera = camera(projection);
            let mut attributes = Attributes::new();
            PictureCamera::new(&camera, None).describe(&mut attributes);
            let apply = |name: &str, p: DVec3| {
                let m: Vec<f64> = attributes[name].split(' ').map(|v| v.parse().unwrap()).collect();
                let v = [p.x, p.y, p.z, 1.0];
                let out: Vec<f64> = (0..4).map(|column| (0..4).map(|row| v[row] * m[4 * row + column]).sum()).collect();
                DVec3::new(out[0], out[1], out[2]) / out[3]
            };
            for point in [DVec3::ZERO, DVec3::new(0.4, -0.3, 0.9)] {
                let (pixel, depth) = camera.project(point).unwrap();
                let seen = apply(WORLD_TO_CAMERA, point);
                assert!((seen.z - depth).abs() < 1e-5, "{seen} {depth}");
                let ndc = apply(WORLD_TO_NDC, point);
                let expected = pixel / DVec2::new(64.0, 48.0);
                assert!((ndc.x - expected.x).abs() < 1e-5 && (ndc.y - expected.y).abs() < 1e-5, "{ndc} {expected}");
            }
        }
    }
}
