//! A slider through the slices of a volume along each index axis, with the slices of a reference, the differences and
//! the confidence at the same places beside them.
//!
//! Slices are 8-bit PNGs with one byte a pixel: at most [`MOST_SLICES`] an axis of [`MOST_PIXELS`] squared, so that
//! four panes along three axes are at most 9.5 MB of a page, and about a tenth of that for smoke.

use super::number;
use super::picture;
use super::slices::{CUTS, Plane, Slice, difference, grey, largest, support};
use crate::error::Result;
use crate::formats::png;
use crate::metrics::heatmap;
use crate::scene::bricks::Bricks;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::DVec3;
use maud::{Markup, html};

/// Largest number of slices along an axis.
pub const MOST_SLICES: usize = 64;
/// Longest side of a slice in pixels.
const MOST_PIXELS: usize = 96;

/// A quantity that is shown beside the volume, at the same places.
#[derive(Debug, Clone, Copy)]
pub struct CompanionVolume<'b> {
    /// Name of the quantity.
    pub label: &'b str,
    /// Values, on any lattice.
    pub volume: &'b Bricks<f32>,
    /// Value that is white; `None` for the largest in the slices.
    pub top: Option<f64>,
}

/// Slices of one pane along one axis, and how they are painted.
struct Pane {
    label: String,
    slices: Vec<Slice>,
    top: f64,
    heat: bool,
}

/// Sliders along the three axes. `quantity` names the values; the difference from `reference` is shown if there is one.
///
/// # Errors
/// If a slice cannot be encoded.
pub(crate) fn sliders(
    quantity: &str,
    volume: &Bricks<f32>,
    reference: Option<&Bricks<f32>>,
    beside: &[CompanionVolume<'_>],
) -> Result<Markup> {
    let Some((voxels, centre)) = support(volume) else {
        return Ok(html! { p { "Zero everywhere." } });
    };
    let axis = |cut: usize| {
        let (normal, right, up, axes) = CUTS[cut];
        let (low, high) = (voxels.min[normal], voxels.max[normal]);
        let count = ((high - low) as usize + 1).min(MOST_SLICES);
        let place = |i: usize| match count {
            1 => low,
            _ => (low + (high - low) * i as f64 / (count - 1) as f64).round(),
        };
        let plane = |i: usize| {
            let mut through = centre;
            through[normal] = place(i);
            Plane::within((normal, right, up), voxels, through, MOST_PIXELS)
        };
        let planes: Vec<Plane> = (0..count).map(plane).collect();
        let of = |field: &Bricks<f32>| -> Vec<Slice> {
            let index = |i: DVec3| field.transform.to_index(volume.transform.to_world(i));
            planes.iter().map(|plane| plane.sample(|at| f64::from(field.sample(index(at))))).collect()
        };
        let first =
            (0..count).min_by(|a, b| (place(*a) - centre[normal]).abs().total_cmp(&(place(*b) - centre[normal]).abs()));
        let size = volume.transform.voxel_size();
        let extent = |axis: usize| (voxels.max[axis] - voxels.min[axis] + 1.0) * size[axis];
        draw(&Along {
            axis: ["x", "y", "z"][normal],
            axes,
            places: (0..count).map(place).collect(),
            first: first.unwrap_or(0),
            shape: extent(right) / extent(up),
            panes: panes(quantity, of(volume), reference.map(of), beside.iter().map(|b| (b, of(b.volume))).collect()),
        })
    };
    let rows = [axis(0)?, axis(1)?, axis(2)?];
    Ok(html! {
        p { "Along the index axes of the volume, up to " (MOST_SLICES) " slices each, at the voxels' centres." }
        @for row in &rows { (row) }
    })
}

fn panes(
    quantity: &str,
    own: Vec<Slice>,
    reference: Option<Vec<Slice>>,
    beside: Vec<(&CompanionVolume<'_>, Vec<Slice>)>,
) -> Vec<Pane> {
    let top = largest(own.iter().chain(reference.iter().flatten()));
    let apart: Option<Vec<Slice>> =
        reference.as_ref().map(|other| own.iter().zip(other).map(|(a, b)| difference(a, b)).collect());
    let mut panes = vec![Pane { label: quantity.to_owned(), slices: own, top, heat: false }];
    panes.extend(reference.map(|slices| Pane { label: "reference".into(), slices, top, heat: false }));
    panes.extend(apart.map(|slices| {
        let top = largest(slices.iter());
        Pane { label: "difference".into(), slices, top, heat: true }
    }));
    panes.extend(beside.into_iter().map(|(beside, slices)| {
        let top = beside.top.unwrap_or_else(|| largest(slices.iter()));
        Pane { label: beside.label.to_owned(), slices, top, heat: false }
    }));
    panes
}

/// Slices along one axis, ready to be drawn.
struct Along {
    axis: &'static str,
    /// Description of the axes to the right and upwards.
    axes: &'static str,
    /// Index coordinates of the slices.
    places: Vec<f64>,
    /// Number of the slice that is shown at first.
    first: usize,
    /// Width over height.
    shape: f64,
    panes: Vec<Pane>,
}

fn draw(along: &Along) -> Result<Markup> {
    let Along { axis, axes, places, first, shape, panes } = along;
    let panes = panes.iter().map(|pane| draw_pane(pane, along)).collect::<Result<Vec<_>>>()?;
    let place = |i: usize| format!("{axis} = {:.0}", places[i]);
    Ok(html! {
        div.browse id=(format!("browse-{axis}")) data-slices=(places.len()) {
            h3 { "Along " (axis) span.caption { (axes) } }
            div.panes { @for pane in &panes { (pane) } }
            label.control hidden {
                output { (place(*first)) }
                input type="range" min="0" max=(places.len() - 1) value=(first) style=(format!("--shape:{shape:.4}"))
                    aria-label=(format!("slice along {axis}"));
            }
        }
    })
}

fn draw_pane(pane: &Pane, along: &Along) -> Result<Markup> {
    let draw = |(i, slice): (usize, &Slice)| {
        let levels: Vec<u8> = grey(&slice.values, pane.top).into_iter().step_by(3).collect();
        let bytes = if pane.heat {
            let ramp: Vec<f64> = (0..256).map(|i| f64::from(i) / 255.0).collect();
            png::encode_palette8(slice.width, slice.height, &levels, &heatmap::shade_rgb8(&ramp, 1.0))?
        } else {
            png::encode_grey8(slice.width, slice.height, &levels)?
        };
        let address = format!("data:image/png;base64,{}", STANDARD.encode(bytes));
        let place = format!("{} = {:.0}", along.axis, along.places[i]);
        let alt = format!("{}, slice at {place}", pane.label);
        let style = format!("aspect-ratio:{:.4}", along.shape);
        Ok(html! {
            img.slice.coarse hidden[i != along.first] data-slice=(i) data-place=(place) src=(address)
                width=(slice.width) height=(slice.height) style=(style) alt=(alt);
        })
    };
    let images = pane.slices.iter().enumerate().map(draw).collect::<Result<Vec<_>>>()?;
    let bar = match pane.heat {
        true => picture::bar(|t| heatmap::shade_rgb8(t, 1.0), "0", &number::short(pane.top))?,
        false => picture::bar(|t| grey(t, 1.0), "0", &number::short(pane.top))?,
    };
    Ok(html! {
        figure {
            figcaption { (pane.label) " " (bar) }
            @for image in &images { (image) }
        }
    })
}
