//! Captures as files state them: views whose pictures a lens may distort or a mask may cover.

use crate::error::{Error, Result};
use crate::scene::capture::Capture;
use crate::scene::lens::Lens;
use std::path::PathBuf;

/// Lens and mask between a view's pinhole camera and its picture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LensAndMask {
    /// Lens distortion.
    pub lens: Lens,
    /// Radius in pixels around the principal point beyond which the picture holds nothing.
    pub crop_radius: Option<f64>,
    /// Picture that is black where the view is not to be used.
    pub mask: Option<PathBuf>,
}

impl LensAndMask {
    /// Checks that pictures can be used as they are.
    ///
    /// # Errors
    /// If the lens distorts, or there is a mask.
    pub fn direct(&self) -> Result<()> {
        if self.lens != Lens::Pinhole {
            return Err(Error::unsupported(format!("lens distortion ({})", described(&self.lens)))
                .hint("undistort the pictures first: `cumulo capture convert IN -o OUT`"));
        }
        if let Some(mask) = &self.mask {
            return Err(Error::unsupported(format!("a mask ('mask_path' is {})", mask.display())).hint(
                "⟨capture.convert.masked=background⟩ puts the background behind it; leave \
                 'mask_path' out to use all pixels",
            ));
        }
        Ok(())
    }
}

/// A capture whose cameras are pinholes, and what lies before its pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct StatedCapture {
    /// Cameras without their lenses, pictures, and the model.
    pub capture: Capture,
    /// Lens and mask of each view.
    pub optics: Vec<LensAndMask>,
}

impl StatedCapture {
    /// Returns the capture, whose pictures are those of its pinhole cameras.
    ///
    /// # Errors
    /// If a picture is distorted or masked; the error names the first such frame.
    pub fn direct(self) -> Result<Capture> {
        let fault = |(i, optics): (usize, &LensAndMask)| optics.direct().map_err(|e| e.part(format!("frame {i}")));
        self.optics.iter().enumerate().try_for_each(fault)?;
        Ok(self.capture)
    }
}

/// First coefficient of a lens that is not 0, as files name it.
fn described(lens: &Lens) -> String {
    let first = |values: &[(&str, f64)]| {
        let found = values.iter().find(|(_, value)| *value != 0.0);
        found.map_or_else(String::new, |(key, value)| format!("'{key}' is {value}"))
    };
    match lens {
        Lens::Pinhole => String::new(),
        Lens::Brown { radial: [k1, k2, k3, k4, k5, k6], tangential: [p1, p2] } => first(&[
            ("k1", *k1),
            ("k2", *k2),
            ("k3", *k3),
            ("k4", *k4),
            ("k5", *k5),
            ("k6", *k6),
            ("p1", *p1),
            ("p2", *p2),
        ]),
        Lens::Fisheye { .. } => "the camera model is OPENCV_FISHEYE".into(),
    }
}
