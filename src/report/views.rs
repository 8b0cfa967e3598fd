//! Views beside their re-renders, as a table of pictures.

use super::{number, picture, wipe};
use crate::error::{Error, Result};
use crate::metrics::heatmap;
use crate::scene::film::Film;
use maud::{Markup, html};

/// Largest number of views that a page shows.
pub(crate) const MOST_VIEWS: usize = 8;

/// Share of the pixels that the scale of the differences covers. A scale for all pixels would let a few bright outliers
/// leave the others black.
const COVERED: f64 = 0.999;

/// A view with its re-render.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewRow {
    /// Name of the view.
    pub name: String,
    /// Given picture of the view.
    pub picture: Film,
    /// Re-render of the view, of the picture's size.
    pub render: Film,
    /// A further render of any size, with its label.
    pub extra: Option<(String, Film)>,
    /// True if the view served only for evaluation.
    pub held_out: bool,
    /// PSNR of the re-render against the given picture, in dB.
    pub psnr_db: Option<f64>,
    /// Remark on the view; may be empty.
    pub note: String,
}

/// Selects at most `most` views: those held out first, the others evenly spaced from the first to the last.
/// Returns view numbers, those held out before the others, each part ascending.
pub fn choose(held_out: &[bool], most: usize) -> Vec<usize> {
    let (held, used): (Vec<usize>, Vec<usize>) = (0..held_out.len()).partition(|i| held_out[*i]);
    let mut chosen = spaced(&held, most);
    let rest = spaced(&used, most - chosen.len());
    chosen.extend(rest);
    chosen
}

/// Selects at most `most` items, evenly spaced from the first to the last.
fn spaced(items: &[usize], most: usize) -> Vec<usize> {
    let n = items.len();
    match most {
        _ if n <= most => items.to_vec(),
        0 => Vec::new(),
        1 => vec![items[0]],
        _ => (0..most).map(|i| items[i * (n - 1) / (most - 1)]).collect(),
    }
}

/// Table of the selected views; `total` is the number of all views.
pub(crate) fn table(rows: &[ViewRow], total: usize) -> Result<Markup> {
    let total = total.max(rows.len());
    let held_out: Vec<bool> = rows.iter().map(|r| r.held_out).collect();
    let shown: Vec<&ViewRow> = choose(&held_out, MOST_VIEWS).into_iter().map(|i| &rows[i]).collect();
    if shown.is_empty() {
        return Ok(html! { p { "No views to show." } });
    }
    let differences = shown.iter().map(|r| difference(r)).collect::<Result<Vec<_>>>()?;
    let (scale, largest) = scale(&differences);
    let names: Vec<&str> = shown.iter().map(|r| r.name.as_str()).collect();
    let extra = shown.iter().any(|r| r.extra.is_some());
    let body = shown.iter().zip(&differences).map(|(r, d)| row(r, d, scale, extra)).collect::<Result<Vec<_>>>()?;
    let high = number::short(scale);
    let bar = picture::bar(|t| heatmap::shade_rgb8(t, 1.0), "0", &format!("{high} and above"))?;
    Ok(html! {
        p {
            @if shown.len() < total {
                (shown.len()) " of " (total) " views, those held out first, the others evenly spaced."
            } @else if total == 1 { "The only view." } @else { "All " (total) " views." }
            " Differences are the largest of the three colors, scene-linear, in one scale for all views; the "
            "largest is " (number::short(largest)) "."
        }
        p { (bar) }
        div.wide {
            table.pictures {
                thead {
                    tr {
                        th scope="col" { "View" }
                        th scope="col" { "Given" }
                        th scope="col" { "Re-rendered" }
                        th scope="col" { "Difference" }
                        @if extra { th scope="col" { "Also rendered" } }
                    }
                }
                tbody { @for row in &body { (row) } }
            }
        }
        (wipe::of_table(["Given", "Re-rendered"], &names))
    })
}

fn difference(row: &ViewRow) -> Result<Vec<f64>> {
    let (a, b) = (&row.picture, &row.render);
    if (a.width, a.height) != (b.width, b.height) {
        return Err(Error::invalid(format!(
            "the picture has {} x {} pixels, its re-render {} x {}; the same size is expected",
            a.width, a.height, b.width, b.height
        ))
        .part(format!("view '{}'", row.name)));
    }
    Ok(heatmap::differences(a, b))
}

fn row(row: &ViewRow, differences: &[f64], scale: f64, extra: bool) -> Result<Markup> {
    let name = &row.name;
    let named = |e: Error| e.part(format!("view '{name}'"));
    let (w, h) = (row.picture.width, row.picture.height);
    let given = picture::film(&row.picture, &format!("given picture of view {name}")).map_err(named)?;
    let render = picture::film(&row.render, &format!("re-render of view {name}")).map_err(named)?;
    let alt = format!("difference of the given picture and the re-render of view {name}");
    let difference = picture::differences(w, h, differences, scale, &alt).map_err(named)?;
    let other = match &row.extra {
        Some((label, film)) => {
            let picture = picture::film(film, &format!("{label}, view {name}")).map_err(named)?;
            Some(html! { (picture) span.caption { (label) } })
        }
        None => None,
    };
    Ok(html! {
        tr {
            th scope="row" {
                bdi { (name) }
                @if row.held_out { " " span.badge { "held out" } }
                @if let Some(psnr) = row.psnr_db { span.number { (decibels(psnr)) } }
                @if !row.note.is_empty() { span.caption { (row.note) } }
            }
            td data-label="Given" { (given) }
            td data-label="Re-rendered" { (render) }
            td data-label="Difference" { (difference) }
            @if extra { td data-label=[row.extra.as_ref().map(|_| "Also")] { @if let Some(other) = other { (other) } } }
        }
    })
}

fn decibels(psnr: f64) -> String {
    if psnr == f64::INFINITY { "identical".into() } else { format!("{psnr:.2} dB") }
}

/// Difference that the brightest color stands for, and the largest finite difference.
fn scale(differences: &[Vec<f64>]) -> (f64, f64) {
    let mut all: Vec<f64> = differences.iter().flatten().copied().filter(|d| d.is_finite()).collect();
    if all.is_empty() {
        return (0.0, 0.0);
    }
    all.sort_unstable_by(f64::total_cmp);
    let largest = all[all.len() - 1];
    let covered = all[((all.len() - 1) as f64 * COVERED) as usize];
    (if covered > 0.0 { covered } else { largest }, largest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn held_out_views_come_first_and_the_rest_is_spread() {
        let mut held_out = vec![false; 64];
        (held_out[7], held_out[40]) = (true, true);
        assert_eq!(choose(&held_out, 8), [7, 40, 0, 13, 25, 37, 50, 63]);
        assert_eq!(choose(&[false, true], 8), [1, 0]);
        assert_eq!(choose(&[true; 20], 3), [0, 9, 19]);
        assert_eq!(choose(&[true, false, false], 2), [0, 1]);
        assert!(choose(&[], 8).is_empty());
    }

    #[test]
    fn outliers_do_not_set_the_scale() {
        let mut values = vec![0.1; 4000];
        values[5] = 9.0;
        values[6] = f64::INFINITY;
        assert_eq!(scale(&[values]), (0.1, 9.0));
        assert_eq!(scale(&[vec![0.0, 0.0, 0.5]]), (0.5, 0.5));
        assert_eq!(scale(&[]), (0.0, 0.0));
    }
}
