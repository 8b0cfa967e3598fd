//! Figures for papers: pictures with labels, scale bars, marks of the axes, and the legend of a transfer function.

mod bar;
mod drawing;
mod font;
mod layout;
mod legend;
mod orientation;
mod panel;
mod pdf;
mod raster;
mod report;
mod scale_bar;
mod settings;
mod svg;
mod swatches;
mod ticks;

pub use orientation::Orientation;
pub use report::FigureReport;
pub use settings::{Background, CameraOf, FigureSettings, ScaleBarLength, Width};

use super::Context;
use super::earlier::{self, Keys, Policy};
use super::inputs;
use super::outputs::{self, Content};
use super::provenance::Provenance;
use super::use_case::{Report, use_case};
use crate::error::{Code, Error, Result};
use crate::formats::png::ToneMapping;
use crate::formats::{atomic, captures, png, protected};
use crate::scene::camera::Projection;
use crate::scene::transfer::Transfer;
use crate::wording::all_worded;
use drawing::Drawing;
use font::Font;
use layout::Marks;
use legend::Legend;
use panel::Panel;
use report::{PanelCamera, PanelReport};
use scale_bar::ScaleBar;
use settings::{PER_INCH, POINTS};
use std::path::Path;
use std::time::Instant;

/// Settings on which the figure does not depend.
const MANNER: [&str; 2] = ["overwrite", "max_memory"];

use_case!(FigureSettings => FigureReport, limits);

impl Report for FigureReport {}

impl FigureSettings {
    /// Reads the pictures, arranges and writes.
    ///
    /// # Errors
    /// If a picture or a function cannot be read, a camera that a mark needs is not known, the figure has no room, or
    /// the output cannot be written.
    pub fn run(&self, context: &Context) -> Result<FigureReport> {
        let begun = Instant::now();
        self.check()?;
        let _inputs = inputs::protect(self.files(), self.limits);
        let content = Content::of_figure(&self.output)?;
        outputs::file(&self.output, content)?;
        protected::check(&self.output)?;
        let mut provenance = Provenance::begin(context).of("figure", self, &MANNER);
        self.refuse_overwrite(content, &provenance)?;
        provenance.files(self.inputs.iter().map(|path| path.as_path()))?;
        let panels = self.panels(context)?;
        let marks = Marks { bars: self.bars(&panels)?, legend: self.legend()? };
        if let Some(panel) = panels.iter().find(|panel| self.orientation.is_some() && panel.camera.is_none()) {
            return Err(without_camera(panel, "⟨orientation⟩"));
        }
        let drawing = self.arrange(&panels, &marks)?;
        let font = Font::new()?;
        let mut remarks: Vec<String> = panels.iter().filter_map(|panel| panel.remark.clone()).collect();
        let missing: String = font.missing(drawing.texts()).into_iter().collect();
        if !missing.is_empty() && content != Content::Svg {
            remarks.push(format!("the font has no '{missing}'; an SVG shows them by the fonts of its reader"));
        }
        let pixels = self.write(&drawing, &font, content, &provenance)?;
        Ok(FigureReport {
            output: self.output.clone(),
            millimetres: drawing.size.map(|side| side / POINTS),
            pixels,
            columns: self.in_row(panels.len()),
            panels: panels.iter().enumerate().map(|(i, panel)| self.described(i, panel, &marks)).collect(),
            length_unit: self.length_unit.clone(),
            legend: marks.legend.as_ref().map(Legend::report),
            remarks: all_worded(remarks),
            seconds: begun.elapsed().as_secs_f64(),
        })
    }

    /// Makes sure that the figure replaces nothing but what the same settings made, or what may be replaced.
    fn refuse_overwrite(&self, content: Content, provenance: &Provenance) -> Result<()> {
        if content == Content::Png {
            let policy = Policy { own: provenance, keys: Keys::RENDERED, overwrite: self.overwrite, resume: false };
            return policy.check(&self.output);
        }
        earlier::spare_document(&self.output, provenance, self.overwrite)
    }

    fn panels(&self, context: &Context) -> Result<Vec<Panel>> {
        let cancel = context.cancel();
        let steps = context.steps(self.inputs.len() as u64, "figure");
        let panel = |(i, path): (usize, &std::path::PathBuf)| {
            if cancel.requested() {
                return Err(Error::cancelled());
            }
            steps.inc(1);
            self.panel(path, self.camera.get(i.min(self.camera.len().saturating_sub(1))))
        };
        self.inputs.iter().enumerate().map(panel).collect()
    }

    /// Returns the scale bar of each panel; none if there are to be none.
    fn bars(&self, panels: &[Panel]) -> Result<Vec<ScaleBar>> {
        let length = match self.scale_bar {
            None => return Ok(Vec::new()),
            Some(ScaleBarLength::Auto) => None,
            Some(ScaleBarLength::Given(length)) => Some(length),
        };
        let bar = |panel: &Panel| {
            let camera = panel.camera.as_ref().ok_or_else(|| without_camera(panel, "⟨scale_bar⟩"))?;
            ScaleBar::new(camera, length, panel.distance).map_err(|e| e.at(&panel.picture))
        };
        panels.iter().map(bar).collect()
    }

    /// Returns the legend, if there is to be one.
    fn legend(&self) -> Result<Option<Legend>> {
        let Some(transfer) = self.function()? else { return Ok(None) };
        let caption = match (&self.legend_label, &self.unit) {
            (Some(label), Some(unit)) => Some(format!("{label} ({unit})")),
            (label, unit) => label.clone().or(unit.clone()),
        };
        let tone = ToneMapping { exposure: self.exposure };
        Legend::new(&transfer, tone, caption, self.length_unit.as_deref()).map(Some)
    }

    /// Returns the function of the legend, if there is to be one.
    fn function(&self) -> Result<Option<Transfer>> {
        if let Some(transfer) = self.transfer.load(self.limits)? {
            return Ok(Some(transfer));
        }
        if !self.legend {
            return match self.legend_label.as_ref().or(self.unit.as_ref()) {
                None => Ok(None),
                Some(_) => Err(Error::invalid("⟨legend_label⟩ and ⟨unit⟩ without a legend")
                    .coded(Code::Usage)
                    .hint("give the transfer function with ⟨tf⟩, or leave them out")),
            };
        }
        let stated =
            self.camera.first().map(|camera| captures::load_within(&camera.capture, self.limits)).transpose()?;
        stated.and_then(|capture| capture.transfer).map(Some).ok_or_else(|| {
            Error::invalid("⟨legend⟩: no transfer function is stated")
                .hint("give it with ⟨tf⟩, or a capture that has one with ⟨camera⟩")
        })
    }

    /// Writes the figure, and returns its size in pixels if it has any.
    fn write(
        &self,
        drawing: &Drawing,
        font: &Font,
        content: Content,
        provenance: &Provenance,
    ) -> Result<Option<[u32; 2]>> {
        let attributes = provenance.attributes();
        let lines: Vec<String> = attributes.iter().map(|(name, text)| format!("{name}={text}")).collect();
        let title = self.title.as_deref().unwrap_or("Figure");
        if content != Content::Png {
            let bytes = match content {
                Content::Svg => svg::write(drawing, title, &lines),
                _ => pdf::write(drawing, font, title, &lines),
            };
            atomic::write_bytes(&self.output, &bytes.map_err(|e| e.at(&self.output))?)?;
            return Ok(None);
        }
        let per_point = PER_INCH / 72.0;
        let raster = raster::draw(drawing, font, per_point, self.limits.max_memory)?;
        let texts: Vec<(String, String)> = attributes.into_iter().collect();
        let bytes = png::encode_rgba8(raster.size, &raster.rgba, Some(PER_INCH), &texts);
        atomic::write_bytes(&self.output, &bytes.map_err(|e| e.at(&self.output))?)?;
        Ok(Some(raster::size(drawing, per_point)))
    }

    fn described(&self, i: usize, panel: &Panel, marks: &Marks) -> PanelReport {
        let camera = panel.camera.as_ref().map(|camera| PanelCamera {
            projection: match camera.projection {
                Projection::Perspective => "perspective",
                Projection::Orthographic => "orthographic",
            },
            position: camera.position().to_array(),
            direction: camera.forward().to_array(),
            distance: panel.distance,
        });
        PanelReport {
            picture: panel.picture.clone(),
            size: panel.raster.size,
            label: self.label.get(i).cloned(),
            camera,
            scale_bar: marks.bars.get(i).copied(),
        }
    }
}

/// Error that a mark needs a camera that the picture does not state.
fn without_camera(panel: &Panel, mark: &str) -> Error {
    Error::invalid(format!("{mark}: the picture does not state its camera"))
        .at(&panel.picture)
        .hint(format!("give it with ⟨camera=CAPTURE#VIEW⟩, or leave {mark} out"))
}

impl Content {
    /// Returns what a figure's name says that it holds.
    ///
    /// # Errors
    /// If the name has none of the endings of figures.
    fn of_figure(path: &Path) -> Result<Self> {
        let kinds = [Self::Svg, Self::Pdf, Self::Png];
        kinds.into_iter().find(|kind| kind.has_name(path)).ok_or_else(|| {
            Error::unsupported("a figure is an SVG, a PDF or a PNG, as its name says")
                .coded(Code::OutputName)
                .at(path)
                .hint("let the name end in .svg, .pdf or .png")
        })
    }
}
