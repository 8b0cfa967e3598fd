//! Sums of blocks from frame to frame: they move along with the picture, and are laid out plane after plane.

use super::blocks::{BLOCK, Grid};
use super::frame::Frame;
use super::lanes::{LANES, Lanes};
use super::reprojection::around;
use crate::arch::Arch;
use glam::Vec2;
use rayon::prelude::*;

/// Writes the mean motion of the pixels of each block that have one; not a number where none does. Without motion
/// there are none.
pub(crate) fn mean_motions(frame: &Frame<'_>, grid: Grid, to: &mut Vec<Vec2>) {
    to.clear();
    if let Some(motion) = frame.motion {
        to.resize(grid.rows * grid.columns, Vec2::NAN);
        let rows = to.par_chunks_mut(grid.columns).zip(motion.par_chunks(BLOCK * frame.size[0]));
        rows.with_min_len(8).for_each(|(to, motion)| {
            for (column, to) in to.iter_mut().enumerate() {
                *to = mean_motion(motion, frame.size[0], column);
            }
        });
    }
}

/// Returns the mean motion of the pixels of a block that have one, from the rows of its row of blocks; not a number if
/// none does.
fn mean_motion(motion: &[Vec2], width: usize, column: usize) -> Vec2 {
    let (mut sum, mut count) = (Vec2::ZERO, 0.0);
    for row in motion.chunks(width) {
        for motion in &row[column * BLOCK..(column * BLOCK + BLOCK).min(width)] {
            if motion.is_finite() {
                sum += *motion;
                count += 1.0;
            }
        }
    }
    sum / count
}

/// Moves the sums of a row of blocks along with the motions of blocks; zeros where they come from outside, or where
/// there are none.
#[inline(always)]
pub(crate) fn carry<const N: usize>(
    motions: &[Vec2],
    grid: Grid,
    blocks: &[[f32; N]],
    row: usize,
    moved: &mut [[f32; N]],
) {
    let place = row * grid.columns;
    if blocks.is_empty() {
        moved.fill([0.0; N]);
    } else if motions.is_empty() {
        moved.copy_from_slice(&blocks[place..][..grid.columns]);
    } else {
        for (column, (moved, motion)) in moved.iter_mut().zip(&motions[place..]).enumerate() {
            let place = Vec2::new(column as f32, row as f32) + *motion / BLOCK as f32;
            *moved = around([grid.columns, grid.rows], place).map_or([0.0; N], |found| found.sum(blocks));
        }
    }
}

/// Writes the sums of a row of blocks plane after plane.
#[inline(always)]
pub(crate) fn to_planes<const N: usize>(arch: Arch, blocks: &[[f32; N]], planes: &mut [f32], stride: usize) {
    for (at, blocks) in blocks.chunks(LANES).enumerate() {
        for vector in 0..N / LANES {
            let mut rows = [[0.0; LANES]; LANES];
            for (row, block) in rows.iter_mut().zip(blocks) {
                *row = block.as_chunks().0[vector];
            }
            for (i, values) in arch.transposed(&rows).into_iter().enumerate() {
                Lanes(values).store(planes, (vector * LANES + i) * stride + at * LANES);
            }
        }
    }
}
