//! A self-contained HTML page that shows the result of a command.
//!
//! A [`Page`] is made of sections, in the order in which they are added. Pictures, style and plots are inside the file;
//! it loads nothing, runs one script of its own that moves sliders, and says so to the browser. Without
//! scripts it shows the same pictures at rest. Every text is escaped, because names come from files.

mod browse;
mod error_maps;
mod histogram;
pub(crate) mod number;
mod picture;
mod plot;
mod scatter;
mod script;
pub(crate) mod sheet;
mod slices;
mod sphere;
mod stages;
mod strip;
mod thumbnails;
mod views;
mod wipe;

pub use browse::{CompanionVolume, MOST_SLICES};
pub(crate) use error_maps::ErrorMaps;
pub(crate) use number::short;
pub use plot::{Plot, Series};
pub(crate) use scatter::{Cloud, Dot, Scatter};
pub(crate) use sphere::{SphereMap, Walk};
pub(crate) use strip::StripFrame;
pub(crate) use thumbnails::MOST_THUMBNAILS;
pub use thumbnails::Thumbnail;
pub(crate) use views::MOST_VIEWS;
pub use views::{ViewRow, choose};

use crate::error::{Error, Result};
use crate::formats::atomic;
use crate::scene::bricks::Bricks;
use crate::scene::film::Film;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use std::path::{Path, PathBuf};

/// File name of the page in the report's folder.
pub(crate) const FILE_NAME: &str = "index.html";

/// A report under construction.
#[derive(Debug, Clone)]
pub struct Page {
    title: String,
    summary: String,
    /// Warnings, above all sections.
    banner: Option<Markup>,
    sections: Vec<Markup>,
}

impl Page {
    /// A page with a title and a sentence beneath it that says what was done and with what result.
    pub fn new(title: impl Into<String>, summary: impl Into<String>) -> Self {
        Self { title: title.into(), summary: summary.into(), banner: None, sections: Vec::new() }
    }

    /// Adds the key figures in large print, each as label and value with its unit.
    pub fn figures(&mut self, figures: &[(impl AsRef<str>, impl AsRef<str>)]) -> &mut Self {
        self.sections.push(html! {
            section.figures aria-label="Figures" {
                dl {
                    @for (label, value) in figures {
                        div { dt { (label.as_ref()) } dd { (value.as_ref()) } }
                    }
                }
            }
        });
        self
    }

    /// Puts warnings, each with its remedy, in a banner at the top of the page; no banner if there are none. Warnings
    /// of an earlier call are replaced.
    pub fn warnings(&mut self, warnings: &[(impl AsRef<str>, impl AsRef<str>)]) -> &mut Self {
        let banner = html! {
            aside id="warnings" class="banner" aria-label="Warnings" {
                h2 { @if warnings.len() == 1 { "A warning" } @else { (warnings.len()) " warnings" } }
                ul {
                    @for (what, remedy) in warnings { li { strong { (what.as_ref()) } " " (remedy.as_ref()) } }
                }
            }
        };
        self.banner = (!warnings.is_empty()).then_some(banner);
        self
    }

    /// Adds sliders through the slices of `volume` along its index axes, with those of a reference, the differences and
    /// other quantities at the same places. `quantity` names the values. See [`MOST_SLICES`] for how many there are.
    ///
    /// # Errors
    /// If a slice cannot be encoded.
    pub fn browse(
        &mut self,
        heading: &str,
        quantity: &str,
        volume: &Bricks<f32>,
        reference: Option<&Bricks<f32>>,
        beside: &[CompanionVolume<'_>],
    ) -> Result<&mut Self> {
        let body = browse::sliders(quantity, volume, reference, beside)?;
        Ok(self.section(heading, body))
    }

    /// Adds a histogram of the values of a volume that are not zero, with that of a reference dashed; no section if
    /// there are none.
    ///
    /// # Errors
    /// If the plot cannot be drawn.
    pub fn histogram(
        &mut self,
        heading: &str,
        quantity: &str,
        volume: &Bricks<f32>,
        reference: Option<&Bricks<f32>>,
    ) -> Result<&mut Self> {
        match histogram::plot(quantity, volume, reference) {
            Some(plot) => {
                let body = plot.draw_with(false)?;
                Ok(self.section(heading, body))
            }
            None => Ok(self),
        }
    }

    /// Adds small pictures of the cameras, at most `MOST_THUMBNAILS`; `total` is the number of all views.
    ///
    /// # Errors
    /// If a picture has no pixels.
    pub fn thumbnails(&mut self, heading: &str, all: &[Thumbnail], total: usize) -> Result<&mut Self> {
        if all.is_empty() {
            return Ok(self);
        }
        let body = thumbnails::grid(all, total)?;
        Ok(self.section(heading, body))
    }

    /// Adds a wipe between two pictures of one size: a slider moves the edge between them.
    ///
    /// # Errors
    /// If a picture has no pixels.
    pub fn wipe(&mut self, heading: &str, labels: [&str; 2], films: [&Film; 2]) -> Result<&mut Self> {
        let body = wipe::of(labels, films)?;
        Ok(self.section(heading, body))
    }

    /// Adds a table of views beside their re-renders and the differences, all differences in one scale.
    /// At most `MOST_VIEWS` rows are shown, selected by [`choose`]. `total` is the number of all views, of which
    /// `rows` may be a part.
    ///
    /// # Errors
    /// If a view's pictures are empty, or its picture and render differ in size; the error names the view.
    pub fn views(&mut self, heading: &str, rows: &[ViewRow], total: usize) -> Result<&mut Self> {
        let body = views::table(rows, total)?;
        Ok(self.section(heading, body))
    }

    /// Adds slices along the index axes of `volume` through its centre of mass, with those of `reference` and the
    /// differences if there is one. `quantity` names the values, with their unit if they have one.
    ///
    /// # Errors
    /// If a slice cannot be encoded.
    pub fn slices(
        &mut self,
        heading: &str,
        quantity: &str,
        volume: &Bricks<f32>,
        reference: Option<&Bricks<f32>>,
    ) -> Result<&mut Self> {
        let body = slices::table(quantity, volume, reference)?;
        Ok(self.section(heading, body))
    }

    /// Adds a plot of lines over a common pair of axes.
    ///
    /// # Errors
    /// If the plot cannot be drawn.
    pub fn plot(&mut self, heading: &str, plot: &Plot) -> Result<&mut Self> {
        let body = plot.draw()?;
        Ok(self.section(heading, body))
    }

    /// Adds a plot of points with intervals over logarithmic axes.
    ///
    /// # Errors
    /// If the plot cannot be drawn.
    pub(crate) fn scatter(&mut self, heading: &str, scatter: &Scatter) -> Result<&mut Self> {
        let body = scatter.draw()?;
        Ok(self.section(heading, body))
    }

    /// Adds pictures beside their differences from a reference.
    ///
    /// # Errors
    /// If a picture has no pixels.
    pub(crate) fn error_maps(&mut self, heading: &str, maps: &ErrorMaps<'_>) -> Result<&mut Self> {
        let body = maps.draw()?;
        Ok(self.section(heading, body))
    }

    /// Adds lines to be copied, each with what it is for; no section if there are none.
    pub(crate) fn commands(&mut self, heading: &str, lines: &[(impl AsRef<str>, impl AsRef<str>)]) -> &mut Self {
        match lines.is_empty() {
            true => self,
            false => self.section(heading, html! { div.commands { (code_table(lines)) } }),
        }
    }

    /// Adds a map of paths over a sphere of directions.
    ///
    /// # Errors
    /// If the map cannot be drawn.
    pub fn sphere(&mut self, heading: &str, map: &SphereMap) -> Result<&mut Self> {
        let body = map.draw()?;
        Ok(self.section(heading, body))
    }

    /// Adds a picture with a caption.
    ///
    /// # Errors
    /// If the picture has no pixels.
    pub fn picture(&mut self, heading: &str, film: &Film, caption: &str) -> Result<&mut Self> {
        let picture = picture::film(film, caption)?;
        Ok(self.section(heading, html! { figure.picture { (picture) figcaption.caption { (caption) } } }))
    }

    /// Adds frames of several sequences side by side, with the differences, as a moving picture of `rate` frames a
    /// second.
    ///
    /// # Errors
    /// If there is no frame, or a picture has no pixels.
    pub(crate) fn strip(
        &mut self,
        heading: &str,
        labels: &[&str],
        frames: &[StripFrame],
        rate: u16,
    ) -> Result<&mut Self> {
        let body = strip::draw(labels, frames, rate)?;
        Ok(self.section(heading, body))
    }

    /// Adds a table of figures. `columns` are the headings; each row begins with its name.
    pub fn table(&mut self, heading: &str, columns: &[&str], rows: &[Vec<String>]) -> &mut Self {
        let body = figures("figures", columns, rows);
        self.section(heading, body)
    }

    /// Adds a table of figures as [`Self::table`] does, whose cells are not broken into lines.
    pub(crate) fn wide_table(&mut self, heading: &str, columns: &[&str], rows: &[Vec<String>]) -> &mut Self {
        let body = figures("figures unbroken", columns, rows);
        self.section(heading, body)
    }

    /// Adds a table of texts, each row with its name.
    pub(crate) fn texts(&mut self, heading: &str, rows: &[Vec<String>]) -> &mut Self {
        let body = figures("texts", &[], rows);
        self.section(heading, body)
    }

    /// Adds the stages in the order in which they ran, with the seconds that each took.
    pub fn stages(&mut self, stages: &[(impl AsRef<str>, f64)]) -> &mut Self {
        let body = stages::bar_and_table(stages);
        self.section("Time by stage", body)
    }

    /// Adds the origin of the result: version, command line, inputs and their hashes, settings.
    pub fn provenance(&mut self, entries: &[(impl AsRef<str>, impl AsRef<str>)]) -> &mut Self {
        self.section("Provenance", code_table(entries))
    }

    fn section(&mut self, heading: &str, body: Markup) -> &mut Self {
        self.sections.push(html! { section { h2 { (heading) } (body) } });
        self
    }

    /// HTML text of the page.
    pub fn html(&self) -> String {
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta name="color-scheme" content="light dark";
                    meta http-equiv="Content-Security-Policy" content=(script::policy());
                    // Keeps browsers from asking the server for a favicon.
                    link rel="icon" href="data:,";
                    title { (self.title) }
                    style { (PreEscaped(include_str!("style.css"))) (PreEscaped(plot::style())) }
                }
                body {
                    main {
                        header { h1 { (self.title) } p { (self.summary) } }
                        @if let Some(banner) = &self.banner { (banner) }
                        @for section in &self.sections { (section) }
                    }
                    footer {
                        "Pictures show radiance clipped to 0..1, in sRGB. Written by cumulo \
                         " (env!("CARGO_PKG_VERSION"))
                    }
                    script { (PreEscaped(script::SCRIPT)) }
                }
            }
        };
        page.into_string()
    }

    /// Writes the page as `dir/index.html`, creates the folder if need be, and returns the file's path.
    ///
    /// # Errors
    /// If the folder or the file cannot be written; the error names the path.
    pub fn write(&self, dir: &Path) -> Result<PathBuf> {
        std::fs::create_dir_all(dir)
            .map_err(|e| Error::io(dir, e).hint("the report needs a folder that can be written to"))?;
        let path = dir.join(FILE_NAME);
        atomic::write_bytes(&path, self.html().as_bytes())?;
        Ok(path)
    }
}

/// Table of figures; each row begins with its name.
fn figures(class: &str, columns: &[&str], rows: &[Vec<String>]) -> Markup {
    html! {
        div.wide {
            table class=(class) {
                thead { tr { @for column in columns { th scope="col" { (column) } } } }
                tbody {
                    @for row in rows {
                        tr {
                            @for (i, cell) in row.iter().enumerate() {
                                @if i == 0 { th scope="row" { (options(cell)) } } @else { td { (cell) } }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Table of values to be copied, each with its name.
fn code_table(entries: &[(impl AsRef<str>, impl AsRef<str>)]) -> Markup {
    html! {
        table.provenance {
            tbody {
                @for (key, value) in entries {
                    tr { th scope="row" { (key.as_ref()) } td { (code(value.as_ref())) } }
                }
            }
        }
    }
}

/// Text to be copied.
fn code(text: &str) -> Markup {
    html! { code { (options(text)) } }
}

/// Text that is broken into lines between the options of a command line, if it is one.
fn options(text: &str) -> Markup {
    if !text.contains(" --") {
        return html! { (text) };
    }
    html! {
        @for (i, option) in text.split(" --").enumerate() {
            @if i > 0 { " " span { "--" (option) } } @else { span { (option) } }
        }
    }
}
