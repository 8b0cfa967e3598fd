//! Sums of blocks from frame to frame: they move along with the picture, and are laid out plane after plane.

use super::blocks::{BLOCK, Grid};
use super::frame::Frame;
use super::lanes::{LANES, Lanes};
use super::reprojection::around;
use crate::arch::Arch;
use glam::Vec2;

/// Moves the sums of a row of blocks along with the motion; zeros where they come from outside, or where there are
/// none.
#[inline(always)]
pub fn carry<const N: usize>(frame: &Frame<'_>, grid: Grid, blocks: &[[f32; N]], row: usize, moved: &mut [[f32; N]]) {
    for (column, moved) in moved.iter_mut().enumerate() {
        *moved = [0.0; N];
        if blocks.is_empty() {
            continue;
        }
        let motion = match frame.motion {
            Some(motion) => mean_motion(motion, frame.size, [column, row]),
            None => Some(Vec2::ZERO),
        };
        if let Some(motion) = motion {
            let place = Vec2::new(column as f32, row as f32) + motion / BLOCK as f32;
            if let Some(found) = around([grid.columns, grid.rows], place) {
                *moved = found.sum(blocks);
            }
        }
    }
}

/// Returns the mean motion of the pixels of a block that have one; `None` if none does.
#[inline(always)]
fn mean_motion(motion: &[Vec2], [width, height]: [usize; 2], [column, row]: [usize; 2]) -> Option<Vec2> {
    let (mut sum, mut count) = (Vec2::ZERO, 0.0);
    for y in row * BLOCK..(row * BLOCK + BLOCK).min(height) {
        for motion in &motion[y * width..][column * BLOCK..(column * BLOCK + BLOCK).min(width)] {
            if motion.is_finite() {
                sum += *motion;
                count += 1.0;
            }
        }
    }
    (count > 0.0).then(|| sum / count)
}

/// Writes the sums of a row of blocks plane after plane.
#[inline(always)]
pub fn to_planes<const N: usize>(arch: Arch, blocks: &[[f32; N]], planes: &mut [f32], stride: usize) {
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
