//! Cameras as prims of UsdGeom.
//!
//! Focal length and apertures are in tenths of the stage's unit. Perspective cameras get a lens of 50 mm. An aperture
//! that light passes is a disc to USD, which has f-stops. Motion while a shutter is open is not written.

use super::light::matrix;
use super::text::{Content, Literal, PrimText, Property};
use crate::scene::camera::{Camera, Projection};

/// Focal length of perspective cameras in meters.
const LENS: f64 = 0.05;

/// A camera, or the same camera at several time codes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct CameraPrim {
    /// Name of the prim.
    pub name: String,
    /// Cameras by time code; one without a time code stands for all times.
    pub samples: Vec<(Option<u32>, Camera)>,
}

/// Units in which a stage measures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scale {
    /// Meters to a unit of the stage.
    pub meters_per_unit: f64,
    /// Distance in units beyond which nothing is seen.
    pub far: f64,
}

/// Numbers of a camera prim.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Attributes {
    focal: f64,
    aperture: [f64; 2],
    offset: [f64; 2],
    clipping: [f64; 2],
    /// F-stop, 0 for a point, and distance of focus.
    lens: [f64; 2],
}

impl Attributes {
    fn of(camera: &Camera, scale: Scale) -> Self {
        // In tenths of a unit. For parallel rays, apertures are the extent of the picture itself.
        let focal = 10.0 * LENS / scale.meters_per_unit;
        let to_film = match camera.projection {
            Projection::Perspective => focal,
            Projection::Orthographic => 10.0,
        };
        let [width, height] = [camera.width, camera.height].map(f64::from);
        let [x, y] = [to_film / camera.focal.x, to_film / camera.focal.y];
        Self {
            focal,
            aperture: [width * x, height * y],
            // The principal point is where the axis meets the picture; the offset moves the picture against the axis.
            offset: [(0.5 * width - camera.centre.x) * x, (camera.centre.y - 0.5 * height) * y],
            lens: camera.blur.aperture.map_or([0.0; 2], |disc| [0.05 * focal / disc.radius, disc.focus]),
            clipping: [if camera.near > 0.0 { camera.near } else { 1e-5 * scale.far }, scale.far],
        }
    }
}

/// Returns the prim of a camera.
pub(crate) fn prim(camera: &CameraPrim, scale: Scale) -> PrimText {
    let mut prim = PrimText::new("Camera", camera.name.clone());
    let optics: Vec<Attributes> = camera.samples.iter().map(|(_, camera)| Attributes::of(camera, scale)).collect();
    let varying = |declaration: &'static str, name: &str, values: Vec<Literal>| {
        let times = camera.samples.iter().map(|(time, _)| *time);
        let first = values.first().cloned().unwrap_or(Literal::Blocked);
        let samples: Option<Vec<(f64, Literal)>> =
            times.zip(&values).map(|(time, value)| Some((f64::from(time?), value.clone()))).collect();
        let content = match samples {
            Some(samples) if samples.iter().any(|(_, value)| *value != first) => Content::Samples(first, samples),
            _ => Content::Default(first),
        };
        Property { declaration, name: name.into(), content }
    };
    let numbers = |name: &str, of: &dyn Fn(&Attributes) -> f64| {
        varying("float", name, optics.iter().map(|o| Literal::Single(of(o) as f32)).collect())
    };
    let projection = match camera.samples.first().map(|(_, camera)| camera.projection) {
        Some(Projection::Orthographic) => "orthographic",
        _ => "perspective",
    };
    prim.set("token", "projection", Literal::text(projection));
    prim.properties.extend([
        numbers("focalLength", &|o| o.focal),
        numbers("horizontalAperture", &|o| o.aperture[0]),
        numbers("verticalAperture", &|o| o.aperture[1]),
        numbers("horizontalApertureOffset", &|o| o.offset[0]),
        numbers("verticalApertureOffset", &|o| o.offset[1]),
        varying(
            "float2",
            "clippingRange",
            optics.iter().map(|o| Literal::floats(o.clipping.map(|v| v as f32))).collect(),
        ),
    ]);
    if optics.iter().any(|o| o.lens[0] > 0.0) {
        prim.properties.extend([numbers("fStop", &|o| o.lens[0]), numbers("focusDistance", &|o| o.lens[1])]);
    }
    let size = |(_, camera): &(Option<u32>, Camera)| {
        Literal::Tuple(vec![Literal::Int(camera.width.into()), Literal::Int(camera.height.into())])
    };
    prim.properties.push(varying("custom int2", "cumulo:resolution", camera.samples.iter().map(size).collect()));
    // A pixel of focal lengths x and y is 1 / x wide and 1 / y high.
    let aspects: Vec<f64> = camera.samples.iter().map(|(_, camera)| camera.focal.y / camera.focal.x).collect();
    if aspects.iter().any(|aspect| *aspect != 1.0) {
        let aspects = aspects.into_iter().map(Literal::Number).collect();
        prim.properties.push(varying("custom double", "cumulo:pixelAspectRatio", aspects));
    }
    let maps = camera.samples.iter().map(|(_, camera)| matrix(camera.camera_to_world)).collect();
    prim.properties.push(varying("matrix4d", "xformOp:transform", maps));
    let order = Literal::Array(vec![Literal::text("xformOp:transform")]);
    prim.properties.push(Property::new("uniform token[]", "xformOpOrder", order));
    prim
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::blur::{Aperture, Blur};
    use glam::{DMat4, DVec2};

    #[test]
    fn apertures_give_the_pixels_rays() {
        let camera = Camera {
            camera_to_world: DMat4::IDENTITY,
            projection: Projection::Perspective,
            focal: DVec2::new(100.0, 80.0),
            centre: DVec2::new(30.0, 26.0),
            width: 64,
            height: 48,
            near: 0.0,
            blur: Blur::default(),
        };
        let scale = Scale { meters_per_unit: 0.01, far: 1000.0 };
        let optics = Attributes::of(&camera, scale);
        // 5 cm in tenths of a centimeter.
        assert_eq!(optics.focal, 50.0);
        // The picture's left edge is seen at x / z = -30 / 100, its right at 34 / 100; top 26 / 80, bottom -22 / 80.
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        near((optics.offset[0] - 0.5 * optics.aperture[0]) / optics.focal, -0.30);
        near((optics.offset[0] + 0.5 * optics.aperture[0]) / optics.focal, 0.34);
        near((optics.offset[1] + 0.5 * optics.aperture[1]) / optics.focal, 0.325);
        near((optics.offset[1] - 0.5 * optics.aperture[1]) / optics.focal, -0.275);
        assert_eq!(optics.clipping, [0.01, 1000.0]);
        // A lens of 5 cm is four times as long as 1.25 cm are wide.
        let open = Blur { aperture: Some(Aperture::disc(0.625, 3.0)), shutter: None };
        let lens = Attributes::of(&Camera { blur: open, ..camera }, scale).lens;
        assert_eq!((optics.lens, lens), ([0.0; 2], [4.0, 3.0]));
        // Parallel rays: 100 pixels to a unit show 0.64 units, which are 6.4 tenths.
        let parallel = Attributes::of(&Camera { projection: Projection::Orthographic, ..camera }, scale);
        near(parallel.aperture[0], 6.4);
    }
}
