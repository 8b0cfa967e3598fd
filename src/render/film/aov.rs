//! Planes that a picture has beside its RGBA (arbitrary output variables).

use super::pixel::{Motion, Pixel};
use glam::{DVec3, Vec3};

/// An additional plane of a picture, or a layer of planes (arbitrary output variable).
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Aov {
    /// Variance of the mean over a pixel's rays, as planes `variance.R`, `.G`, `.B` and `.A`; infinite for one ray. For
    /// paths it rests on two halves of them that are independent, pooled over the pixels around.
    Variance,
    /// Optical depth, the mean over a pixel's rays and the channels, as plane `optical_depth.V`.
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
    /// Mean motion in the picture of first collisions, or of surfaces where more is seen of them, in pixels to the
    /// right and upwards, as planes `Vector.X` and `.Y` (their place in the frame before, minus that now) and `.Z` and
    /// `.W` (their place now, minus that in the frame after), as Blender's pass of that name; 0 where no frame is or
    /// nothing is met. Surfaces and volumes without velocities count as at rest: the camera moves.
    Motion,
    /// Mean motion in the picture from the frame before, as planes `Denoising Backward Motion.X`, `.Y` and `.Z`: the
    /// first two are those of [`Motion`](Self::Motion), the third is the length along the viewing axis in the frame
    /// before minus that now. Cycles 5.2 hands this to the denoiser.
    BackwardMotion,
    /// Number of paths, as plane `Debug Sample Count.X`.
    Samples,
    /// Radiance of two halves of the paths, whose random numbers are independent, as planes `half_a.R`, `.G`, `.B` and
    /// `half_b.R`, `.G`, `.B`: those of camera rays of even and of odd number.
    Halves,
    /// Sums over independent replicates, as 31 planes of the layer `replicates`, by which pictures of a wanted error or
    /// time are joined.
    Replicates,
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
            Self::BackwardMotion => "backward-motion",
            Self::Samples => "samples",
            Self::Halves => "halves",
            Self::Replicates => "replicates",
        }
    }

    /// True if a compression may lose digits of channels named R, G, B and Y.
    pub fn survives_loss(self) -> bool {
        use Aov::{Albedo, Depth, Direct, Indirect, OpticalDepth, Samples};
        matches!(self, OpticalDepth | Direct | Indirect | Albedo | Depth | Samples)
    }

    /// True if the plane tells of other frames.
    pub fn of_frames(self) -> bool {
        matches!(self, Self::Motion | Self::BackwardMotion)
    }

    /// True if the plane comes from scattered paths: direct volume rendering has no such thing.
    pub fn of_paths(self) -> bool {
        !matches!(self, Self::Variance | Self::OpticalDepth)
    }

    /// Returns the layers of the plane that pixels have one by one, named as Blender's passes where it has them.
    pub(super) fn layers(self) -> Vec<Layer> {
        const RGB: &[&str] = &["R", "G", "B"];
        const XYZ: &[&str] = &["X", "Y", "Z"];
        fn of(v: Vec3) -> [f32; 4] {
            v.extend(0.0).to_array()
        }
        fn mean(sum: DVec3, samples: u32) -> [f32; 4] {
            of((sum / f64::from(samples.max(1))).as_vec3())
        }
        match self {
            // Of pixels together.
            Aov::Variance | Aov::Replicates => Vec::new(),
            Aov::OpticalDepth => {
                vec![Layer::new("optical_depth", &["V"], |p, n| {
                    [(p.optical_depth / f64::from(n)) as f32, 0.0, 0.0, 0.0]
                })]
            }
            Aov::Direct => vec![Layer::new("Volume Direct", RGB, |p, n| mean(p.direct, n))],
            Aov::Indirect => vec![Layer::new("Volume Indirect", RGB, |p, n| mean(p.indirect, n))],
            Aov::Albedo => vec![Layer::new("Denoising Albedo", RGB, |p, n| mean(p.albedo, n))],
            Aov::Normal => vec![Layer::new("Denoising Normal", XYZ, |p, _| of(p.mean(p.normal)))],
            Aov::Position => vec![Layer::new("Position", XYZ, |p, _| of(p.mean(p.position)))],
            Aov::Depth => vec![Layer::new("Depth", &["Z"], |p, _| {
                let depth = if p.collided > 0.0 { (p.depth / p.collided) as f32 } else { NOWHERE };
                [depth, 0.0, 0.0, 0.0]
            })],
            Aov::Motion => vec![Layer::new("Vector", &["X", "Y", "Z", "W"], |p, _| {
                let Motion { before, after, .. } = p.mean_motion();
                [before.x, before.y, after.x, after.y].map(|v| v as f32)
            })],
            Aov::BackwardMotion => vec![Layer::new("Denoising Backward Motion", XYZ, |p, _| {
                let Motion { before, depth_before, .. } = p.mean_motion();
                [before.x, before.y, depth_before, 0.0].map(|v| v as f32)
            })],
            Aov::Samples => vec![Layer::new("Debug Sample Count", &["X"], |_, n| [n as f32, 0.0, 0.0, 0.0])],
            Aov::Halves => vec![
                Layer::new("half_a", RGB, |p, _| p.halves[0].mean().as_vec4().to_array()),
                Layer::new("half_b", RGB, |p, _| p.halves[1].mean().as_vec4().to_array()),
            ],
        }
    }
}

/// Length along the viewing axis where nothing is met, as Blender writes it.
const NOWHERE: f32 = 1e10;

/// A layer of planes.
pub(super) struct Layer {
    /// Name.
    pub name: &'static str,
    /// Names of its channels.
    pub channels: &'static [&'static str],
    /// Returns the channels' values of a pixel, which is the mean of a number of estimates.
    pub value: fn(&Pixel, u32) -> [f32; 4],
}

impl Layer {
    fn new(name: &'static str, channels: &'static [&'static str], value: fn(&Pixel, u32) -> [f32; 4]) -> Self {
        Self { name, channels, value }
    }
}
