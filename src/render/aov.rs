//! Planes that a picture has beside its RGBA (arbitrary output variables).

use super::composited::Composited;
use super::integrator::Integrator;
use super::tiles::{self, Subpixels, Watch};
use crate::scene::camera::Camera;
use crate::scene::film::{Film, Moments, Plane};

/// An additional plane of a picture, or a layer of planes (arbitrary output variable).
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Aov {
    /// Variance of the mean over a pixel's rays, as planes `variance.R`, `.G`, `.B` and `.A`; infinite for one ray. For
    /// paths it rests on two halves of them that are independent, pooled over the pixels around.
    Variance,
    /// Optical depth, the mean over a pixel's rays, as plane `optical_depth.V`.
    OpticalDepth,
    /// Radiance of lights that was scattered once, as planes `Volume Direct.R`, `.G` and `.B`.
    Direct,
    /// Radiance that was scattered more often, as planes `Volume Indirect.R`, `.G` and `.B`.
    Indirect,
    /// Albedo at first collisions times their share of the paths, as planes `Denoising Albedo.R`, `.G` and `.B`.
    Albedo,
    /// Mean over first collisions of the direction in which the density falls, in world space, as planes
    /// `Denoising Normal.X`, `.Y` and `.Z`; 0 without any.
    Normal,
    /// Mean position of first collisions in world space, as planes `Position.X`, `.Y` and `.Z`; 0 without any.
    Position,
    /// Mean length along the viewing axis to first collisions, as plane `Depth.Z`; 1e10 without any.
    Depth,
    /// Mean motion of first collisions in the picture, in pixels to the right and upwards, as planes `Vector.X` and
    /// `.Y` (their place in the frame before, minus that now) and `.Z` and `.W` (their place now, minus that in the
    /// frame after), as Blender's pass of that name; 0 where no frame is or nothing is met. The volume counts as at
    /// rest: the camera moves.
    Motion,
    /// Number of paths, as plane `Debug Sample Count.X`.
    Samples,
    /// Radiance of two halves of the paths, whose random numbers are independent, as planes `half_a.R`, `.G`, `.B` and
    /// `half_b.R`, `.G`, `.B`: those of camera rays of even and of odd number.
    Halves,
}

impl Aov {
    /// Name of the plane in settings, such as `optical-depth`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Variance => "variance",
            Self::OpticalDepth => "optical-depth",
            Self::Direct => "direct",
            Self::Indirect => "indirect",
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Position => "position",
            Self::Depth => "depth",
            Self::Motion => "motion",
            Self::Samples => "samples",
            Self::Halves => "halves",
        }
    }

    /// True if the plane comes from scattered paths: direct volume rendering has no such thing.
    pub(crate) fn of_paths(self) -> bool {
        !matches!(self, Self::Variance | Self::OpticalDepth)
    }
}

/// Bytes of memory per pixel while a picture with additional planes is rendered.
pub(crate) const PIXEL_BYTES: u64 = size_of::<Pixel>() as u64;

#[derive(Debug, Clone, Default)]
struct Pixel {
    rgba: [f32; 4],
    variance: [f32; 4],
    depth: f32,
}

/// Renders a picture as [`picture`](super::picture()) does, and the requested planes beside RGBA, but
/// for those of scattered paths (`Aov::of_paths`). Returns `None` if the watch stopped it.
pub fn picture_with<'w, I: Integrator<Real = f32>>(
    renderer: &Composited<I>,
    camera: &Camera,
    rays_per_edge: usize,
    aovs: &[Aov],
    watch: impl Into<Watch<'w>>,
) -> Option<Film> {
    let (size, rays) = ([camera.width as usize, camera.height as usize], Subpixels::new(rays_per_edge));
    let share = 1.0 / rays.count() as f32;
    let pixel = |scratch: &mut I::Scratch, at| {
        let (mut mean, mut moments, mut depth) = ([0.0; 4], [Moments::default(); 4], 0.0);
        for [x, y] in rays.positions(at) {
            let light = renderer.pixel_on(&camera.ray(x, y), scratch);
            depth += light.depth / rays.count() as f64;
            for (c, v) in light.rgba().into_iter().enumerate() {
                mean[c] += share * v;
                moments[c].add(v.into());
            }
        }
        Pixel { rgba: mean, variance: moments.map(|m| m.variance_of_mean() as f32), depth: depth as f32 }
    };
    let pixels = tiles::pixels(size, Some(watch.into()), I::Scratch::default, pixel)?;
    let plane = |name: String, of: &dyn Fn(&Pixel) -> f32| Plane { name, samples: pixels.iter().map(of).collect() };
    let mut film = Film::of(size[0], size[1], pixels.iter().map(|p| p.rgba).collect());
    film.samples = rays.count() as u32;
    for aov in aovs {
        match aov {
            Aov::Variance => {
                let channels = ["R", "G", "B", "A"].into_iter().enumerate();
                film.planes.extend(channels.map(|(c, name)| plane(format!("variance.{name}"), &|p| p.variance[c])));
            }
            Aov::OpticalDepth => film.planes.push(plane("optical_depth.V".into(), &|p| p.depth)),
            of_paths => debug_assert!(of_paths.of_paths(), "{of_paths:?}"),
        }
    }
    Some(film)
}
