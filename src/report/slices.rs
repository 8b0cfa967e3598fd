//! Slices through a volume along its index axes.

use super::picture::MOST_PIXELS;
use super::{number, picture};
use crate::error::Result;
use crate::math::Aabb;
use crate::metrics::heatmap;
use crate::scene::bricks::{BRICK, Bricks, CELLS, slot};
use glam::DVec3;
use maud::{Markup, html};

/// Slices of the table: normal, axis to the right, axis up, and the description of both.
pub(super) const CUTS: [(usize, usize, usize, &str); 3] =
    [(2, 0, 1, "x to the right, y up"), (1, 0, 2, "x to the right, z up"), (0, 1, 2, "y to the right, z up")];

/// Headings of the columns; without a reference only the first is shown.
const COLUMNS: [&str; 3] = ["Volume", "Reference", "Difference"];

/// A slice of a volume: values row-major from the top left.
pub(super) struct Slice {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) values: Vec<f64>,
}

/// Position and sampling of a slice.
pub(super) struct Plane {
    normal: usize,
    right: usize,
    up: usize,
    /// Index coordinates of the voxel at the lower left.
    origin: DVec3,
    width: usize,
    height: usize,
    /// Distance between neighbouring pixels in voxels.
    step: f64,
}

impl Plane {
    /// A plane through `centre` across `voxels` (a box of voxel centres), with one pixel per voxel unless a side would
    /// exceed `most` pixels.
    pub(super) fn within((normal, right, up): (usize, usize, usize), voxels: Aabb, centre: DVec3, most: usize) -> Self {
        let extent = |axis: usize| voxels.max[axis] - voxels.min[axis] + 1.0;
        let step = (extent(right).max(extent(up)) / most as f64).max(1.0);
        let count = |axis: usize| (extent(axis) / step).round().max(1.0) as usize;
        let mut origin = voxels.min;
        origin[normal] = centre[normal];
        Self { normal, right, up, origin, width: count(right), height: count(up), step }
    }

    pub(super) fn sample(&self, value: impl Fn(DVec3) -> f64) -> Slice {
        let at = |x: usize, y: usize| {
            let mut index = self.origin;
            // The middle of the pixel; at a step of 1 that is a voxel's centre.
            index[self.right] += (x as f64 + 0.5) * self.step - 0.5;
            index[self.up] += ((self.height - 1 - y) as f64 + 0.5) * self.step - 0.5;
            value(index)
        };
        let values = (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y))).map(|(x, y)| at(x, y));
        Slice { width: self.width, height: self.height, values: values.collect() }
    }
}

/// Table of the slices of a volume, beside those of a reference and the differences if there is one.
pub(crate) fn table(quantity: &str, volume: &Bricks<f32>, reference: Option<&Bricks<f32>>) -> Result<Markup> {
    let Some((voxels, centre)) = support(volume) else {
        return Ok(html! { p { "Zero everywhere." } });
    };
    let planes = CUTS.map(|(normal, right, up, _)| Plane::within((normal, right, up), voxels, centre, MOST_PIXELS));
    let slices = |field: &Bricks<f32>| {
        let index = |i: DVec3| field.transform.to_index(volume.transform.to_world(i));
        [0, 1, 2].map(|i| planes[i].sample(|at| f64::from(field.sample(index(at)))))
    };
    let own = slices(volume);
    let theirs = reference.map(slices);
    let apart = theirs.as_ref().map(|theirs| [0, 1, 2].map(|i| difference(&own[i], &theirs[i])));
    let top = largest(own.iter().chain(theirs.iter().flatten()));
    let top_apart = largest(apart.iter().flatten());
    let size = volume.transform.voxel_size();
    let row = |i: usize| {
        let plane = &planes[i];
        let axis = ["x", "y", "z"][plane.normal];
        let place = format!("{axis} = {:.0}", plane.origin[plane.normal]);
        let shape = (plane.width as f64 * size[plane.right]) / (plane.height as f64 * size[plane.up]);
        let draw = |slice: &Slice, rgb: &[u8], what: &str| {
            picture::rgb8(slice.width, slice.height, rgb, shape, &format!("{what}, slice at {place}"))
        };
        let own = draw(&own[i], &grey(&own[i].values, top), quantity)?;
        let mut cells = vec![own];
        if let (Some(theirs), Some(apart)) = (&theirs, &apart) {
            cells.push(draw(&theirs[i], &grey(&theirs[i].values, top), &format!("reference {quantity}"))?);
            cells.push(draw(&apart[i], &heatmap::shade_rgb8(&apart[i].values, top_apart), "difference")?);
        }
        let span = |axis: usize| voxels.max[axis] - voxels.min[axis] + 1.0;
        let (w, h) = (span(plane.right), span(plane.up));
        Ok(html! {
            tr {
                th scope="row" {
                    (place)
                    span.caption { (CUTS[i].3) }
                    span.caption { (w) " × " (h) " voxels" }
                    span.caption {
                        (number::short(w * size[plane.right])) " × " (number::short(h * size[plane.up])) " world units"
                    }
                }
                @for (cell, label) in cells.iter().zip(COLUMNS) { td data-label=(label) { (cell) } }
            }
        })
    };
    let rows = (0..3).map(row).collect::<Result<Vec<_>>>()?;
    let values = picture::bar(|t| grey(t, 1.0), "0", &format!("{} {quantity}", number::short(top)))?;
    let differences =
        picture::bar(|t| heatmap::shade_rgb8(t, 1.0), "0", &format!("{} difference", number::short(top_apart)))?;
    Ok(html! {
        p { "Through the centre of mass, along the index axes, at the voxels' centres." }
        p { (values) @if reference.is_some() { " " (differences) } }
        div.wide {
            table.pictures {
                thead {
                    tr {
                        th scope="col" { "Slice" }
                        @for label in &COLUMNS[..if reference.is_some() { 3 } else { 1 }] { th scope="col" { (label) } }
                    }
                }
                tbody { @for row in &rows { (row) } }
            }
        }
    })
}

/// Box of the centres of the voxels that are not zero, and the voxel nearest to their centre of mass; `None` if there
/// are none.
pub(super) fn support(volume: &Bricks<f32>) -> Option<(Aabb, DVec3)> {
    let (mut voxels, mut mass, mut moment) = (Aabb::EMPTY, 0.0, DVec3::ZERO);
    for (brick, values) in volume.topology.bricks().iter().zip(volume.values.chunks_exact(BRICK)) {
        for i in 0..CELLS * CELLS * CELLS {
            let [x, y, z] = [i / (CELLS * CELLS), i / CELLS % CELLS, i % CELLS];
            let value = f64::from(values[slot(x, y, z)]);
            if value != 0.0 && value.is_finite() {
                let at = (CELLS as f64) * brick.as_dvec3() + DVec3::new(x as f64, y as f64, z as f64);
                voxels = voxels.including(at);
                mass += value.abs();
                moment += value.abs() * at;
            }
        }
    }
    (mass > 0.0).then(|| (voxels, (moment / mass).round().clamp(voxels.min, voxels.max)))
}

pub(super) fn difference(a: &Slice, b: &Slice) -> Slice {
    let values = a.values.iter().zip(&b.values).map(|(a, b)| (a - b).abs()).collect();
    Slice { width: a.width, height: a.height, values }
}

pub(super) fn largest<'a>(slices: impl Iterator<Item = &'a Slice>) -> f64 {
    slices.flat_map(|s| &s.values).copied().filter(|v| v.is_finite()).fold(0.0, f64::max)
}

/// Grey levels from black for 0 to white for `top`, three bytes per value.
pub(super) fn grey(values: &[f64], top: f64) -> Vec<u8> {
    let top = if top > 0.0 { top } else { 1.0 };
    // `as` saturates and turns NaN into 0.
    values.iter().flat_map(|v| [(255.0 * v / top + 0.5) as u8; 3]).collect()
}
