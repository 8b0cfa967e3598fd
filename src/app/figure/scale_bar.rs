//! The scale bar of a picture: a length in the world at the distance of what the camera looks at.

use super::drawing::{Anchor, BLACK, Color, Drawing, Point, Style, WHITE};
use super::ticks::{below, number};
use crate::error::{Error, Result};
use crate::scene::camera::{Camera, Projection};
use serde::Serialize;

/// Largest share of a picture's width that a bar takes whose length is not stated.
const SHARE: f64 = 0.3;

/// A scale bar.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub(super) struct ScaleBar {
    /// Length in world units.
    pub length: f64,
    /// Length in pixels of the picture.
    pub pixels: f64,
    /// Distance along the viewing axis in world units at which the bar is true; null for parallel rays, where it is
    /// true everywhere.
    pub distance: Option<f64>,
}

impl ScaleBar {
    /// Returns the bar of a picture; `length` is the one that is stated, and `distance` that of the plane on which it
    /// is measured.
    ///
    /// # Errors
    /// If the distance is not known, or the bar is longer than the picture or shorter than a pixel.
    pub(super) fn new(camera: &Camera, length: Option<f64>, distance: Option<f64>) -> Result<Self> {
        let distance = match camera.projection {
            Projection::Orthographic => None,
            Projection::Perspective => Some(distance.ok_or_else(|| {
                Error::invalid("the scale bar needs the distance to what the perspective camera looks at")
                    .hint("give ⟨distance⟩ in world units, or leave ⟨scale_bar⟩ out")
            })?),
        };
        let per_unit = camera.focal.x / distance.unwrap_or(1.0);
        let width = f64::from(camera.width);
        let length = length.unwrap_or_else(|| below(SHARE * width / per_unit));
        let pixels = length * per_unit;
        if pixels > 0.9 * width {
            let fits = number(below(0.5 * width / per_unit));
            return Err(Error::invalid(format!(
                "a scale bar of {length} is {pixels:.0} pixels long, and the picture {width} wide"
            ))
            .hint(format!("give a shorter one, such as {fits}, or none for one that fits")));
        }
        if pixels < 1.0 {
            return Err(Error::invalid(format!("a scale bar of {length} is {pixels:.2} pixels long"))
                .hint("give a longer one, or none for one that fits"));
        }
        Ok(Self { length, pixels, distance })
    }

    /// Text at the bar.
    pub(super) fn label(&self, unit: Option<&str>) -> String {
        let number = number(self.length);
        unit.map_or(number.clone(), |unit| format!("{number} {unit}"))
    }

    /// Draws the bar in the lower right corner of a picture that lies at a rectangle. `scale` is the number of points
    /// of a pixel.
    pub(super) fn draw(
        &self,
        drawing: &mut Drawing,
        ([x, y], [w, h]): (Point, Point),
        scale: f64,
        (unit, size): (Option<&str>, f64),
        color: Color,
    ) {
        let (inset, thickness, length) = (0.8 * size, 0.25 * size, self.pixels * scale);
        let label = self.label(unit);
        // A text that is wider than the bar stays within the picture.
        let half = (0.5 * length).max(0.32 * size * label.chars().count() as f64);
        let middle = x + w - inset - half;
        let top = y + h - inset - thickness;
        drawing.rectangle([middle - 0.5 * length, top], [length, thickness], color);
        drawing.text(label, [middle, top - 0.4 * size], Anchor::Middle, Style { size, bold: false, color });
    }
}

/// Color that stands out from what lies behind it, whose mean display level is known.
pub(super) fn contrasting(level: f64) -> Color {
    if level < 140.0 { WHITE } else { BLACK }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::scene::blur::Blur;
    use glam::{DMat4, DVec2, DVec3};

    fn camera(projection: Projection, focal: f64) -> Camera {
        Camera {
            camera_to_world: DMat4::from_translation(DVec3::new(0.0, 0.0, 8.0)),
            projection,
            focal: DVec2::splat(focal),
            centre: DVec2::new(100.0, 75.0),
            width: 200,
            height: 150,
            near: 0.0,
            blur: Blur::default(),
        }
    }

    #[test]
    fn lengths_follow_from_the_camera() {
        // 400 pixels of focal length at a distance of 8: 50 pixels a unit.
        let perspective = camera(Projection::Perspective, 400.0);
        let bar = ScaleBar::new(&perspective, None, Some(8.0)).unwrap();
        assert_eq!(bar, ScaleBar { length: 1.0, pixels: 50.0, distance: Some(8.0) });
        let near = ScaleBar::new(&perspective, None, Some(4.0)).unwrap();
        assert_eq!(near, ScaleBar { length: 0.5, pixels: 50.0, distance: Some(4.0) });
        assert!(ScaleBar::new(&perspective, None, None).unwrap_err().to_string().contains("distance"));
        let parallel = camera(Projection::Orthographic, 2.5);
        let bar = ScaleBar::new(&parallel, None, None).unwrap();
        assert_eq!(bar, ScaleBar { length: 20.0, pixels: 50.0, distance: None });
        assert_eq!(ScaleBar::new(&parallel, Some(30.0), None).unwrap().pixels, 75.0);
        assert!(ScaleBar::new(&parallel, Some(90.0), None).unwrap_err().to_string().contains("225 pixels"));
        assert!(ScaleBar::new(&parallel, Some(0.1), None).is_err());
        assert_eq!(bar.label(Some("mm")), "20 mm");
    }
}
