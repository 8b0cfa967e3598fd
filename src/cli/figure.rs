//! `cumulo figure`: pictures with labels, scale bars, marks of the axes and a legend.

use super::args::read_as;
use super::args::single::Overwrite;
use super::memory::Memory;
use super::parse;
use super::values::choice;
use crate::app::figure::{Background, CameraOf, FigureSettings, Orientation, ScaleBarLength, Width};
use crate::app::transfer::TransferSettings;
use std::path::PathBuf;

/// Compose a figure for a paper from pictures: labels, scale bars, orientation and the legend of a transfer function
///
/// SVG keeps texts and lines and embeds the pictures; PDF embeds the font, too; PNG has 300 pixels to an inch. Scale
/// bars and orientation are those of the camera that `render` writes into its pictures, or of --camera.
#[derive(Debug, clap::Args)]
struct FigureArgs {
    /// Pictures of the panels, row by row: OpenEXR, PNG or JPEG
    #[arg(value_name = "PICTURE", required = true)]
    inputs: Vec<PathBuf>,
    /// Figure: .svg, .pdf or .png
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    /// Title above the panels
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,
    /// Labels of the panels, such as A,B,C
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    label: Vec<String>,
    /// Panels in a row (default: three of up to three, else about as many as rows)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    columns: Option<u32>,
    /// Width of the figure in millimetres, 85mm, or in pixels of which 300 make an inch, 1200px (default: at least 60
    /// mm for each panel of a row, up to 180 mm)
    #[arg(long, value_name = "MM|PX", value_parser = width)]
    width: Option<Width>,
    /// Size of the font in points of 1/72 inch
    #[arg(long, value_name = "PT", default_value_t = 8.0, value_parser = parse::positive)]
    font_size: f64,
    /// Exposure of pictures and legend in stops
    #[arg(
        long,
        value_name = "EV",
        default_value_t = 0.0,
        value_parser = parse::exposure,
        allow_negative_numbers = true,
    )]
    exposure: f64,
    /// Background of the page, which also takes the place of what is behind the volumes of pictures with an alpha
    /// (default: a white page, pictures as they are)
    #[arg(long, value_name = "PAGE", value_parser = choice::<Background>())]
    background: Option<Background>,
    /// Draw the legend of a transfer function, its colors and extinctions: that of --tf, which needs no --legend, else
    /// that of the capture of --camera
    #[arg(long)]
    legend: bool,
    #[command(flatten)]
    transfer: TransferSettings,
    /// Name of the quantity that the legend shows
    #[arg(long, value_name = "TEXT")]
    legend_label: Option<String>,
    /// Unit of the quantity that the legend shows, such as HU
    #[arg(long, value_name = "UNIT")]
    unit: Option<String>,
    /// Draw a scale bar of this length in world units (default: a round length that fits); with perspective it is true
    /// at the distance of what the camera looks at
    #[arg(
        long,
        value_name = "LENGTH",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "auto",
        value_parser = length,
    )]
    scale_bar: Option<ScaleBarLength>,
    /// Unit of world lengths, such as mm, for the scale bar and the legend's extinctions
    #[arg(long, value_name = "UNIT")]
    length_unit: Option<String>,
    /// Distance from the camera in world units at which the scale bar of perspective pictures is true (default: that of
    /// the volume's middle or the camera's target, as pictures state it)
    #[arg(long, value_name = "D", value_parser = parse::positive, requires = "scale_bar")]
    distance: Option<f64>,
    /// Show how the axes of the world lie in each panel
    #[arg(long, value_name = "MARK", value_parser = choice::<Orientation>())]
    orientation: Option<Orientation>,
    /// Camera of each panel, or of all: a view of a capture, such as shots#3, counted from 0; without a number the one
    /// of the picture's name (default: the camera that the picture states)
    #[arg(long, value_name = "CAPTURE[#VIEW],...", value_delimiter = ',', value_parser = camera)]
    camera: Vec<CameraOf>,
    #[command(flatten)]
    overwrite: Overwrite,
    #[command(flatten)]
    memory: Memory,
}

fn width(text: &str) -> Result<Width, String> {
    match (text.strip_suffix("mm"), text.strip_suffix("px")) {
        (Some(millimetres), _) => parse::positive(millimetres).map(Width::Millimetres),
        (None, Some(pixels)) => {
            pixels.trim().parse().map(Width::Pixels).map_err(|_| format!("'{text}' is no number of pixels"))
        }
        _ => Err(format!("'{text}' is no width; give millimetres such as 85mm, or pixels such as 1200px")),
    }
}

fn length(text: &str) -> Result<ScaleBarLength, String> {
    if text == "auto" { Ok(ScaleBarLength::Auto) } else { parse::positive(text).map(ScaleBarLength::Given) }
}

fn camera(text: &str) -> Result<CameraOf, String> {
    let view = text.rsplit_once('#').and_then(|(capture, view)| Some((capture, view.parse().ok()?)));
    let (capture, view) = view.map_or((text, None), |(capture, view)| (capture, Some(view)));
    Ok(CameraOf { capture: capture.into(), view })
}

impl From<FigureArgs> for FigureSettings {
    fn from(args: FigureArgs) -> Self {
        Self {
            inputs: args.inputs,
            output: args.output,
            title: args.title,
            label: args.label,
            columns: args.columns,
            width: args.width,
            font_size: args.font_size,
            exposure: args.exposure,
            background: args.background,
            legend: args.legend,
            transfer: args.transfer,
            legend_label: args.legend_label,
            unit: args.unit,
            scale_bar: args.scale_bar,
            length_unit: args.length_unit,
            distance: args.distance,
            orientation: args.orientation,
            camera: args.camera,
            overwrite: args.overwrite.into(),
            limits: args.memory.limits(),
        }
    }
}

read_as!(FigureSettings, FigureArgs);
