//! Settings of figures.

use super::orientation::Orientation;
use crate::app::ranges;
use crate::app::transfer::TransferSettings;
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Settings of a figure.
///
/// ```
/// use cumulo::app::figure::ScaleBarLength;
/// use cumulo::prelude::*;
///
/// # let folder = tempfile::tempdir().unwrap();
/// # let picture = folder.path().join("plume.exr");
/// # let output = folder.path().join("figure.svg");
/// let pictures = PictureSettings {
///     input: "fixtures/plume.vdb".into(),
///     views: Some(1),
///     size: Some([64, 64]),
///     ..PictureSettings::default()
/// };
/// RenderSettings { pictures, output: picture.clone(), ..RenderSettings::default() }.run(&Context::default())?;
/// let figure = FigureSettings {
///     inputs: vec![picture],
///     output: output.clone(),
///     title: Some("Plume".into()),
///     scale_bar: Some(ScaleBarLength::Auto),
///     ..FigureSettings::default()
/// };
/// figure.run(&Context::default())?;
/// assert!(std::fs::read_to_string(output).unwrap().contains("Plume"));
/// # Ok::<(), cumulo::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FigureSettings {
    /// Pictures of the panels, row by row.
    #[serde(with = "crate::app::paths")]
    pub inputs: Vec<PathBuf>,
    /// Figure: SVG, PDF or PNG, by the ending of its name.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// Title above the panels.
    pub title: Option<String>,
    /// Labels of the panels, in their order.
    pub label: Vec<String>,
    /// Number of panels in a row; none for up to three.
    pub columns: Option<u32>,
    /// Width of the figure; none for at least 60 mm a panel, up to 180 mm.
    pub width: Option<Width>,
    /// Size of the font in points of 1/72 inch.
    pub font_size: f64,
    /// Exposure of the pictures and of the legend in stops.
    pub exposure: f64,
    /// Background of the page, which also takes the place of what is behind the volumes; none for a white page with
    /// pictures as they are.
    pub background: Option<Background>,
    /// True to draw the legend of a transfer function: that of `tf`, else that of the capture of `camera`.
    pub legend: bool,
    /// Transfer function of the legend.
    #[serde(flatten)]
    pub transfer: TransferSettings,
    /// Name of the quantity that the legend shows.
    pub legend_label: Option<String>,
    /// Unit of that quantity.
    pub unit: Option<String>,
    /// Scale bar of each panel; none for no bar.
    pub scale_bar: Option<ScaleBarLength>,
    /// Unit of world lengths, for the scale bar and the legend.
    pub length_unit: Option<String>,
    /// Distance in world units along the viewing axis at which the scale bar of perspective pictures is true; none for
    /// the one that pictures state.
    pub distance: Option<f64>,
    /// Mark of the axes of the world in each panel; none for no mark.
    pub orientation: Option<Orientation>,
    /// Cameras of the panels, in their order, or one for all; none for those that the pictures state.
    pub camera: Vec<CameraOf>,
    /// True to replace a figure that other settings made.
    pub overwrite: bool,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

/// Width of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Width {
    /// Millimetres.
    Millimetres(f64),
    /// Pixels at 300 to an inch.
    Pixels(u32),
}

/// Length of scale bars.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ScaleBarLength {
    /// A round length that fits each panel.
    Auto,
    /// World units.
    Given(f64),
}

/// Background of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Background {
    /// White.
    White,
    /// Black, with white letters.
    Black,
    /// None.
    Transparent,
}

/// Camera of a panel: a view of a capture.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CameraOf {
    /// A transforms.json, its folder, or a model of COLMAP.
    #[serde(with = "crate::app::paths")]
    pub capture: PathBuf,
    /// Number of the view, from 0; none for the one whose picture has the panel's name, or the only one.
    pub view: Option<u32>,
}

/// Pixels to an inch of figures in pixels.
pub(super) const PER_INCH: f64 = 300.0;
/// Points to a millimetre.
pub(super) const POINTS: f64 = 72.0 / 25.4;

impl Default for FigureSettings {
    fn default() -> Self {
        Self {
            inputs: Vec::new(),
            output: PathBuf::new(),
            title: None,
            label: Vec::new(),
            columns: None,
            width: None,
            font_size: 8.0,
            exposure: 0.0,
            background: None,
            legend: false,
            transfer: TransferSettings::default(),
            legend_label: None,
            unit: None,
            scale_bar: None,
            length_unit: None,
            distance: None,
            orientation: None,
            camera: Vec::new(),
            overwrite: false,
            limits: Limits::default(),
        }
    }
}

impl FigureSettings {
    /// Refuses values out of their ranges, and settings that contradict each other.
    ///
    /// # Errors
    /// If there is one.
    pub(super) fn check(&self) -> Result<()> {
        let refused = |what: String, remedy: &str| Err(Error::invalid(what).coded(Code::Usage).hint(remedy));
        if self.inputs.is_empty() {
            return refused("no picture is given".into(), "give pictures in OpenEXR, PNG or JPEG, one or more");
        }
        let panels = self.inputs.len();
        if !self.label.is_empty() && self.label.len() != panels {
            let labels = self.label.len();
            return refused(
                format!("⟨label⟩: {labels} labels for {panels} pictures"),
                "give one label for each picture",
            );
        }
        if self.camera.len() > 1 && self.camera.len() != panels {
            let cameras = self.camera.len();
            return refused(
                format!("⟨camera⟩: {cameras} cameras for {panels} pictures"),
                "give one for each picture, or one for all",
            );
        }
        ranges::within("columns", self.columns, [1, 100])?;
        let size = self.font_size;
        ranges::require("font_size", size, (1.0..=200.0).contains(&size), "a size from 1 to 200 points")?;
        let exposure = self.exposure;
        ranges::require("exposure", exposure, exposure.abs() <= 60.0, "a number from -60 to 60")?;
        ranges::positive("distance", self.distance)?;
        if let Some(ScaleBarLength::Given(length)) = self.scale_bar {
            ranges::positive("scale_bar", length)?;
        }
        match self.width {
            Some(Width::Millimetres(width)) => {
                ranges::require("width", width, (1.0..=5000.0).contains(&width), "a width from 1 to 5000 mm")
            }
            Some(Width::Pixels(width)) => ranges::within("width", width, [16, 65_536]),
            None => Ok(()),
        }
    }

    /// Files that the figure is made from.
    pub(super) fn files(&self) -> Vec<&Path> {
        let cameras = self.camera.iter().map(|camera| camera.capture.as_path());
        self.inputs.iter().map(PathBuf::as_path).chain(cameras).chain(self.transfer.file()).collect()
    }

    /// Width of the figure in points, whose rows have this many panels.
    pub(super) fn points(&self, columns: usize, widest: usize) -> f64 {
        match self.width {
            Some(Width::Millimetres(width)) => width * POINTS,
            Some(Width::Pixels(width)) => f64::from(width) * 72.0 / PER_INCH,
            None => {
                let native = widest as f64 * 72.0 / PER_INCH;
                (columns as f64 * native.max(60.0 * POINTS)).min(180.0 * POINTS)
            }
        }
    }
}
