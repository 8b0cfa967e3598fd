//! Summary of a capture, for `info`.

use super::stated_within;
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::picture;
use crate::formats::views::StatedCapture;
use crate::math::Aabb;
use crate::scene::camera::Projection;
use crate::scene::capture::{EmissionModel, Model, PixelFilter};
use crate::scene::color_space::ColorSpace;
use crate::scene::lens::Lens;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// Number of views, their sizes and positions, and the light model of a capture.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct CaptureSummary {
    /// Number of views.
    pub frames: usize,
    /// Number of views of each size, `WxH`.
    pub sizes: BTreeMap<String, usize>,
    /// Number of orthographic views; the others are perspective.
    pub orthographic: usize,
    /// Lowest corner of the box around the cameras' positions, in world units.
    pub cameras_min: [f64; 3],
    /// Highest corner of the box around the cameras' positions, in world units.
    pub cameras_max: [f64; 3],
    /// Light model of the pictures.
    pub model: Model,
    /// Radiance behind the volume.
    pub background: [f32; 3],
    /// Radiance of the source per color channel; `None` where the model has no source or a transfer function replaces
    /// it.
    pub emission: Option<[f32; 3]>,
    /// Dependence of `emission` on the density; `None` where `emission` is.
    pub emission_model: Option<EmissionModel>,
    /// True if colors and extinction follow a transfer function.
    pub transfer: bool,
    /// Pixel filter of the pictures.
    pub pixel_filter: PixelFilter,
    /// Extinction per unit of density and world length.
    pub density_scale: f64,
    /// Voxel size along each axis of the volume's lattice, in world units, if the capture states the lattice.
    pub lattice_voxel_size: Option<[f64; 3]>,
    /// Number of views that a lens distorts; they are undistorted by `cumulo capture convert`.
    pub distorted: usize,
    /// Number of views with a mask.
    pub masked: usize,
    /// Number of pictures of each format; those that cannot be read are left out.
    pub formats: BTreeMap<&'static str, usize>,
    /// Color space of integer pictures, if the capture states it.
    pub color_space: Option<ColorSpace>,
    /// Remarks on what the file states and has no effect here.
    pub remarks: Vec<String>,
}

/// Reads a capture and summarises it. Pictures are not decoded.
///
/// # Errors
/// The conditions are those of [`load`](super::load()).
pub fn summary(path: &Path) -> Result<CaptureSummary> {
    summary_within(path, Limits::default())
}

/// Reads a capture and summarises it as [`summary`] does; the values of its JSON must fit into `limits`.
///
/// # Errors
/// The conditions are those of `load_within`.
pub fn summary_within(path: &Path, limits: Limits) -> Result<CaptureSummary> {
    let StatedCapture { capture, optics } = stated_within(path, limits)?;
    let mut sizes = BTreeMap::new();
    for frame in &capture.frames {
        *sizes.entry(format!("{}x{}", frame.camera.width, frame.camera.height)).or_default() += 1;
    }
    let cameras = capture.frames.iter().fold(Aabb::EMPTY, |b, frame| b.including(frame.camera.position()));
    let emits = capture.model == Model::EmissionAbsorption;
    let transfer = emits && capture.transfer.is_some();
    let own = emits && !transfer;
    let mut formats = BTreeMap::new();
    for format in capture.frames.iter().filter_map(|frame| picture::format(&frame.picture).ok()) {
        *formats.entry(format.name).or_default() += 1;
    }
    Ok(CaptureSummary {
        distorted: optics.iter().filter(|o| o.lens != Lens::Pinhole).count(),
        masked: optics.iter().filter(|o| o.mask.is_some()).count(),
        formats,
        color_space: capture.color_space,
        remarks: capture.remarks,
        frames: capture.frames.len(),
        sizes,
        orthographic: capture.frames.iter().filter(|f| f.camera.projection == Projection::Orthographic).count(),
        cameras_min: cameras.min.to_array(),
        cameras_max: cameras.max.to_array(),
        model: capture.model,
        background: capture.background,
        emission: own.then_some(capture.emission),
        emission_model: own.then_some(capture.emission_model),
        transfer,
        pixel_filter: capture.pixel_filter,
        density_scale: capture.density_scale,
        lattice_voxel_size: capture
            .lattice
            .map(|m| [m.x_axis, m.y_axis, m.z_axis].map(|column| column.truncate().length())),
    })
}

impl fmt::Display for CaptureSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "capture of {} view(s)", self.frames)?;
        let sizes: Vec<String> = self.sizes.iter().map(|(size, n)| format!("{n} of {size}")).collect();
        writeln!(f, "pictures: {}", sizes.join(", "))?;
        write!(f, "cameras: {} perspective, {} orthographic, ", self.frames - self.orthographic, self.orthographic)?;
        writeln!(f, "positions from {:?} to {:?}", self.cameras_min, self.cameras_max)?;
        match (self.emission, self.emission_model) {
            (Some(color), Some(EmissionModel::Grey)) => {
                writeln!(f, "model: emission-absorption, emission {color:?} everywhere")?;
            }
            (Some(color), Some(EmissionModel::Linear)) => {
                writeln!(f, "model: emission-absorption, emission {color:?} times the density")?;
            }
            _ if self.transfer => writeln!(f, "model: emission-absorption, by a transfer function")?,
            _ if self.model == Model::Scattering => writeln!(f, "model: scattering")?,
            _ if self.model == Model::PreShaded => writeln!(f, "model: pre-shaded")?,
            _ => writeln!(f, "model: absorption")?,
        }
        writeln!(f, "background: {:?}", self.background)?;
        let pixels = match self.pixel_filter {
            PixelFilter::Point => "radiance at the pixel's centre",
            PixelFilter::Box => "mean radiance over the pixel's square",
        };
        writeln!(f, "pixels: {pixels}")?;
        writeln!(f, "density scale: {}", self.density_scale)?;
        if !self.formats.is_empty() {
            let formats: Vec<String> = self.formats.iter().map(|(format, n)| format!("{n} {format}")).collect();
            write!(f, "files: {}", formats.join(", "))?;
            let space = self.color_space.map(|space| format!(", integer samples in {space}"));
            writeln!(f, "{}", space.unwrap_or_default())?;
        }
        if self.distorted > 0 {
            writeln!(f, "lens distortion: {} view(s); `cumulo capture convert` undistorts them", self.distorted)?;
        }
        if self.masked > 0 {
            writeln!(f, "masks: {} view(s)", self.masked)?;
        }
        self.remarks.iter().try_for_each(|remark| writeln!(f, "remark: {remark}"))?;
        if let Some([x, y, z]) = self.lattice_voxel_size {
            writeln!(f, "lattice: voxel size {x} x {y} x {z}")?;
        }
        Ok(())
    }
}
