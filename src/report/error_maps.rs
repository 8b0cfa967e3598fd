//! Pictures beside their differences from a reference.

use super::{number, picture};
use crate::error::Result;
use crate::metrics::heatmap;
use crate::scene::film::Film;
use maud::{Markup, html};

/// Pictures of one size and what they are to be.
#[derive(Debug)]
pub(crate) struct ErrorMaps<'f> {
    /// True picture.
    pub reference: &'f Film,
    /// Pictures, each with its name and a remark.
    pub rows: Vec<((String, String), &'f Film)>,
}

impl ErrorMaps<'_> {
    /// Table of the pictures, the reference first; the differences of each have a scale of their own.
    ///
    /// # Errors
    /// If a picture has no pixels.
    pub(super) fn draw(&self) -> Result<Markup> {
        let reference = picture::film(self.reference, "reference")?;
        let bar = picture::bar(|t| heatmap::shade_rgb8(t, 1.0), "0", "largest of the row")?;
        let rows = self.rows.iter().map(|((name, note), film)| self.row(name, note, film));
        let rows = rows.collect::<Result<Vec<_>>>()?;
        Ok(html! {
            p {
                "Differences are the largest of the three colors, scene-linear; each row has a scale of its own."
            }
            p { (bar) }
            div.wide {
                table.pictures {
                    thead {
                        tr { th scope="col" { "Setting" } th scope="col" { "Picture" } th scope="col" { "Difference" } }
                    }
                    tbody {
                        tr { th scope="row" { "Reference" } td data-label="Picture" { (reference) } td {} }
                        @for row in &rows { (row) }
                    }
                }
            }
        })
    }

    fn row(&self, name: &str, note: &str, film: &Film) -> Result<Markup> {
        let shown = picture::film(film, &format!("picture of {name}"))?;
        let differences = heatmap::differences(film, self.reference);
        let largest = differences.iter().copied().filter(|d| d.is_finite()).fold(0.0, f64::max);
        let alt = format!("difference of {name} from the reference");
        let map = picture::differences(film.width, film.height, &differences, largest, &alt)?;
        Ok(html! {
            tr {
                th scope="row" { (super::code(name)) span.caption { (note) } }
                td data-label="Picture" { (shown) }
                td data-label="Difference" { (map) span.caption { "largest " (number::short(largest)) } }
            }
        })
    }
}
