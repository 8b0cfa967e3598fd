//! The report of a figure.

use super::scale_bar::ScaleBar;
use super::ticks::number;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// Report of a figure.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct FigureReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    pub(super) output: PathBuf,
    /// Width and height in millimetres.
    pub(super) millimetres: [f64; 2],
    /// Width and height in pixels, of a PNG.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) pixels: Option<[u32; 2]>,
    /// Panels, row by row.
    pub(super) panels: Vec<PanelReport>,
    /// Number of panels in a row.
    pub(super) columns: usize,
    /// Unit of world lengths, if it is stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) length_unit: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) legend: Option<LegendReport>,
    /// Remarks on what is not shown as it is stated.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) remarks: Vec<String>,
    pub(super) seconds: f64,
}

/// A panel.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct PanelReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    pub picture: PathBuf,
    /// Width and height of the picture in pixels.
    pub size: [usize; 2],
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
    /// Camera of the picture, if it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<PanelCamera>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale_bar: Option<ScaleBar>,
}

/// Camera of a panel.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct PanelCamera {
    /// `perspective` or `orthographic`.
    pub projection: &'static str,
    /// Position in the world.
    pub position: [f64; 3],
    /// Unit viewing direction in the world.
    pub direction: [f64; 3],
    /// Distance along the viewing axis to what the camera looks at in world units, if it is known.
    pub distance: Option<f64>,
}

/// The legend.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct LegendReport {
    /// Densities at the ends of the bar; the first and the last label of a function of labels.
    pub range: [f64; 2],
    /// Densities of the ticks; none of labels.
    pub ticks: Vec<f64>,
    /// Largest extinction per world unit.
    pub largest_extinction: f64,
    /// Number of the classes of a function of labels that are not clear; none of another function.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub classes: Option<usize>,
}

impl fmt::Display for FigureReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { output, millimetres: [width, height], pixels, panels, columns, legend, remarks, .. } = self;
        let s = if panels.len() == 1 { "" } else { "s" };
        write!(f, "{}: {} panel{s}, {columns} in a row, {width:.1} x {height:.1} mm", output.display(), panels.len())?;
        if let Some([width, height]) = pixels {
            write!(f, ", {width}x{height} pixels")?;
        }
        let unit = self.length_unit.as_deref().unwrap_or("world units");
        for PanelReport { picture, scale_bar, .. } in panels {
            if let Some(ScaleBar { length, distance, .. }) = scale_bar {
                write!(f, "\n  {}: scale bar of {} {unit}", picture.display(), number(*length))?;
                if let Some(distance) = distance {
                    write!(f, ", true at the center, at a distance of {} {unit} from the camera", number(*distance))?;
                }
            }
        }
        if let Some(LegendReport { range, ticks, classes, .. }) = legend {
            let [low, high] = range.map(number);
            match classes {
                Some(classes) => write!(f, "\n  legend of {classes} labels from {low} to {high}")?,
                None => write!(f, "\n  legend from {low} to {high}, {} ticks", ticks.len())?,
            }
        }
        remarks.iter().try_for_each(|remark| write!(f, "\n  remark: {remark}"))
    }
}
