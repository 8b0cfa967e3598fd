//! Grids of Mitsuba: 32-bit floats in a box along the world's axes.

use crate::error::{Error, Result};
use crate::formats::atomic;
use crate::formats::imaging::mitsuba::{FLOAT, GridBox, HEADER, MAGIC};
use crate::formats::imaging::source::Source;
use crate::formats::imaging::values::Tally;
use crate::formats::sample::Sample;
use glam::DMat3;
use std::path::Path;

/// Sine of the angle to the world's axes from which on voxels count as turned: beyond what directions in single
/// precision leave.
const TURNED: f64 = 1e-6;
/// Edges of a voxel by which the box may differ without a note: beyond what sums of doubles round by.
const EXACT: f64 = 1e-9;

/// Where the voxels of a grid lie.
struct Layout {
    bounds: GridBox,
    /// Axes along which world coordinates descend with the index, so that voxels are written in reverse.
    reversed: [bool; 3],
    /// Largest distance by which single precision moves a voxel, in edges of a voxel.
    moved: f64,
}

impl Layout {
    fn new(source: &Source) -> Result<Self> {
        let map = source.index_to_world.matrix();
        let linear = DMat3::from_mat4(map);
        let off_axis = |axis: usize| {
            let column = linear.col(axis);
            (0..3).any(|row| row != axis && column[row].abs() > TURNED * column.length())
        };
        if (0..3).any(off_axis) {
            return Err(Error::unsupported(
                "the voxels are turned or sheared against the world's axes, which grids of Mitsuba cannot hold",
            )
            .hint(
                "write .nrrd or .nii, which can; or write a .npy with ⟨axes=zyx⟩ for mitsuba.VolumeGrid, and place it \
                 by the plugin's to_world",
            ));
        }
        let (mut min, mut max) = ([0.0; 3], [0.0; 3]);
        let (mut reversed, mut moved) = ([false; 3], 0.0_f64);
        for axis in 0..3 {
            let (step, first) = (linear.col(axis)[axis], map.w_axis[axis]);
            let count = source.size[axis] as f64;
            reversed[axis] = step < 0.0;
            // The centre of the voxel with the smallest coordinate.
            let first = if reversed[axis] { first + step * (count - 1.0) } else { first };
            let edge = step.abs();
            let (low, high) = (first - 0.5 * edge, first - 0.5 * edge + count * edge);
            (min[axis], max[axis]) = (low as f32, high as f32);
            let off = (f64::from(min[axis]) - low).abs().max((f64::from(max[axis]) - high).abs());
            moved = moved.max(off / edge);
        }
        let bounds = GridBox { min, max };
        // Voxels that are small beside their distance from the origin may have none left.
        if bounds.index_to_world(source.size).is_err() {
            return Err(Error::unsupported("the box of the grid does not fit into single precision")
                .hint("write .nrrd or .mha, which can hold it"));
        }
        Ok(Self { bounds, reversed, moved })
    }

    /// Order of the voxels of a slice along ascending world coordinates.
    fn ascending(&self, slice: &[f64], source: &Source, out: &mut Vec<f64>) {
        let [columns, rows, _] = source.size;
        let n = source.components;
        out.clear();
        for row in 0..rows {
            let row = if self.reversed[1] { rows - 1 - row } else { row };
            let row = &slice[row * columns * n..(row + 1) * columns * n];
            if self.reversed[0] {
                row.chunks_exact(n).rev().for_each(|voxel| out.extend_from_slice(voxel));
            } else {
                out.extend_from_slice(row);
            }
        }
    }
}

/// Header of a grid.
fn header(source: &Source, bounds: GridBox) -> Result<Vec<u8>> {
    let mut bytes = Vec::with_capacity(HEADER);
    bytes.extend(MAGIC);
    bytes.extend(FLOAT.to_le_bytes());
    for n in source.size.into_iter().chain([source.components]) {
        let n = i32::try_from(n).map_err(|_| {
            Error::unsupported(format!("{n} voxels along an axis are too many for a grid of Mitsuba"))
                .hint("take a part first: ⟨convert.crop⟩")
        })?;
        bytes.extend(n.to_le_bytes());
    }
    bounds.min.iter().chain(&bounds.max).for_each(|v| bytes.extend(v.to_le_bytes()));
    Ok(bytes)
}

/// Sentences about what the format does not hold of a grid.
fn notes(source: &Source, layout: &Layout, tally: &Tally) -> Vec<String> {
    let mut notes = Vec::new();
    if layout.moved > EXACT {
        notes.push(format!(
            "the box is held in single precision, which moves voxels by up to {:.0e} of their edge; .nrrd, .mha and \
             .vti hold it exactly",
            layout.moved
        ));
    }
    let reversed = ["x", "y", "z"].into_iter().zip(layout.reversed).filter(|(_, reversed)| *reversed);
    notes.extend(reversed.map(|(axis, _)| {
        format!("the voxels are in reverse along {axis}, as world coordinates ascend in grids of Mitsuba")
    }));
    match source.sample {
        Sample::F64 => {
            notes.push("64-bit floats are rounded to 32-bit floats, the only values that Mitsuba reads".into());
        }
        sample if sample.is_integer() => {
            notes.push("integers become 32-bit floats, the only values that Mitsuba reads".into());
        }
        _ => {}
    }
    let losses = [
        (tally.rounded, "whole numbers beyond 16777216 are rounded to 32-bit floats"),
        (tally.overflowed, "values are too large for 32-bit floats and became infinite"),
        (tally.vanished, "values are too small for 32-bit floats and became 0"),
    ];
    notes.extend(losses.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")));
    notes
}

/// Writes a file.
pub(crate) fn write(path: &Path, source: &Source) -> Result<Vec<String>> {
    source.count()?;
    let layout = Layout::new(source)?;
    let head = header(source, layout.bounds)?;
    let mut tally = Tally::default();
    atomic::write(path, |draft| {
        draft.write(&head)?;
        let (mut slice, mut ordered, mut bytes) = (Vec::new(), Vec::new(), Vec::new());
        let slices = source.size[2];
        for z in 0..slices {
            source.slice(if layout.reversed[2] { slices - 1 - z } else { z }, &mut slice)?;
            layout.ascending(&slice, source, &mut ordered);
            tally.count_singles(&ordered);
            for part in ordered.chunks(1 << 16) {
                bytes.clear();
                Sample::F32.encode(part, &mut bytes);
                draft.write(&bytes)?;
            }
        }
        Ok(())
    })?;
    Ok(notes(source, &layout, &tally))
}
