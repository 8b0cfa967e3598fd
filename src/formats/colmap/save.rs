//! Writing of COLMAP's text models.

use super::world_to_camera;
use crate::error::{Error, Result};
use crate::scene::camera::Projection;
use crate::scene::capture::Capture;
use std::fmt::Write;
use std::path::Path;

/// Texts of a model's three files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Texts {
    /// Content of `cameras.txt`: a PINHOLE camera for each image.
    pub cameras: String,
    /// Content of `images.txt`, with identifiers from 1 on.
    pub images: String,
    /// Content of `points3D.txt`, which has no point.
    pub points: String,
}

/// Returns the text model of a capture, whose pictures' names are relative to the folder `pictures`. What COLMAP cannot
/// state (light model, background, near planes) is left out.
///
/// # Errors
/// If a camera is orthographic, or the path of a picture is not Unicode or has a line break.
pub fn save(capture: &Capture, pictures: &Path) -> Result<Texts> {
    let mut cameras = String::from("# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
    let mut images = String::from("# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[]\n");
    for (i, frame) in capture.frames.iter().enumerate() {
        let camera = &frame.camera;
        let named = |e: Error| e.part(format!("frame {i}"));
        if camera.projection == Projection::Orthographic {
            return Err(named(
                Error::unsupported("an orthographic camera, which COLMAP does not know")
                    .hint("write a transforms.json instead: leave ⟨to=colmap⟩ out"),
            ));
        }
        let name = frame.picture.strip_prefix(pictures).unwrap_or(&frame.picture).to_str();
        let name = name.filter(|name| !name.contains(['\n', '\r'])).ok_or_else(|| {
            named(Error::invalid("the path of the picture is not plain text").hint("rename the picture"))
        })?;
        let (q, t) = world_to_camera(camera);
        let id = i + 1;
        // `{:?}` writes the shortest digits that are read back to the same bits.
        let [fx, fy, cx, cy] = [camera.focal.x, camera.focal.y, camera.centre.x, camera.centre.y];
        let _ = writeln!(cameras, "{id} PINHOLE {} {} {fx:?} {fy:?} {cx:?} {cy:?}", camera.width, camera.height);
        let pose = [q.w, q.x, q.y, q.z, t.x, t.y, t.z].map(|v| format!("{v:?}")).join(" ");
        let _ = writeln!(images, "{id} {pose} {id} {name}\n");
    }
    let points = "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n".to_owned();
    Ok(Texts { cameras, images, points })
}
