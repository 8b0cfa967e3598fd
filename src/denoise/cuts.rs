//! Cuts between the frames of a sequence, by thumbnails of them.

use glam::Vec3;

/// Number of blocks of a thumbnail along its sides.
const THUMBNAIL: usize = 16;

/// Mean colors of parts of a picture.
type Thumbnail = Vec<Vec3>;

/// Rows and columns of which one is looked at for a thumbnail.
const LOOK: usize = 2;

/// Returns the mean colors of the finite pixels of parts of a picture.
fn thumbnail(color: &[Vec3], [width, height]: [usize; 2]) -> Thumbnail {
    let mut sums = vec![(Vec3::ZERO, 0.0_f32); THUMBNAIL * THUMBNAIL];
    let bins: Vec<usize> = (0..width).map(|x| x * THUMBNAIL / width).collect();
    for (y, row) in color.chunks(width.max(1)).take(height).enumerate().step_by(LOOK) {
        let sums = &mut sums[y * THUMBNAIL / height * THUMBNAIL..][..THUMBNAIL];
        for (color, bin) in row.iter().zip(&bins).step_by(LOOK).filter(|(color, _)| color.is_finite()) {
            let (sum, count) = &mut sums[*bin];
            *sum += color.abs();
            *count += 1.0;
        }
    }
    sums.into_iter().map(|(sum, count)| sum / count.max(1.0)).collect()
}

/// Change above which a cut lies between two pictures, if it is so many times the change before: very few paths change
/// as much from frame to frame.
const CUT: [f32; 2] = [0.5, 1.5];
/// Change above which a cut lies between two pictures at rest, if it is so many times the change before, which must be
/// known.
const JUMP: [f32; 2] = [0.12, 4.0];

/// Returns the share of the light of two pictures that lies elsewhere in the other.
fn change(a: &Thumbnail, b: &Thumbnail) -> f32 {
    let pairs = || a.iter().zip(b);
    let apart: f32 = pairs().map(|(a, b)| (*a - *b).abs().element_sum()).sum();
    let all: f32 = pairs().map(|(a, b)| (*a + *b).element_sum()).sum();
    apart / all.max(f32::MIN_POSITIVE)
}

/// True if two pictures of this change show different shots. `before` is the change between the two before, and
/// `at_rest` tells whether both would be the same picture but for the noise.
fn is_cut(change: f32, before: Option<f32>, at_rest: impl Fn() -> bool) -> bool {
    let is_beyond = |[least, times]: [f32; 2]| change > least && change > times * before.unwrap_or(0.0);
    is_beyond(CUT) || before.is_some() && is_beyond(JUMP) && at_rest()
}

/// Finds where the shots of a sequence begin, whose frames come one after the other, forwards or backwards.
#[derive(Debug, Clone, Default)]
pub struct CutDetector {
    last: Option<Thumbnail>,
    /// Change between the two frames before.
    change: Option<f32>,
}

impl CutDetector {
    /// Takes the next frame, of `size` columns and rows of linear colors, row by row from the top. Returns true if a
    /// cut lies between it and the frame before. `at_rest` tells whether both would be the same picture but for their
    /// noise: then a light that jumps begins a shot, too.
    pub fn begins_shot(&mut self, color: &[Vec3], size: [usize; 2], at_rest: impl Fn() -> bool) -> bool {
        let small = thumbnail(color, size);
        let change = self.last.as_ref().map(|last| change(last, &small));
        let before = std::mem::replace(&mut self.change, change);
        self.last = Some(small);
        change.is_some_and(|change| is_cut(change, before, at_rest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cuts_are_told_from_motion_and_noise() {
        let picture = |at: f32, bright: f32, noise: u32| -> Thumbnail {
            let color = |i: usize| {
                let (x, y) = ((i % 64) as f32, (i / 64) as f32);
                let lit = bright * (-((x - at).powi(2) + (y - 30.0).powi(2)) / 200.0).exp();
                let random = (i as u32).wrapping_mul(0x9E37_79B9).wrapping_add(noise.wrapping_mul(0x85EB_CA6B));
                let random = (random ^ (random >> 15)).wrapping_mul(0x2C1B_3C6D) >> 24;
                Vec3::splat(lit * (0.75 + random as f32 / 512.0))
            };
            thumbnail(&(0..64 * 60).map(color).collect::<Vec<_>>(), [64, 60])
        };
        let first = picture(20.0, 1.0, 1);
        let noise = change(&first, &picture(20.0, 1.0, 2));
        let cut = |to: &Thumbnail, before, at_rest| is_cut(change(&first, to), Some(before), || at_rest);
        assert!(!cut(&picture(20.0, 1.0, 3), noise, true));
        assert!(!cut(&picture(22.0, 1.0, 3), noise, true));
        assert!(cut(&picture(55.0, 1.0, 3), noise, false));
        // Sparse paths differ as much in each frame.
        assert!(!is_cut(0.7, Some(0.65), || true) && is_cut(0.7, None, || false));
        assert_eq!(change(&vec![Vec3::ZERO; 256], &vec![Vec3::ZERO; 256]), 0.0);
        // A light that is halved, and a mirrored shot, jump out of what changes by noise; not so where that is as much,
        // and where a motion may explain it.
        for other in [picture(20.0, 0.5, 3), picture(40.0, 1.0, 3)] {
            let found = change(&first, &other);
            assert!(cut(&other, noise, true) && found > JUMP[1] * noise, "{found} {noise}");
            assert!(found > CUT[0] || !cut(&other, found, true) && !cut(&other, noise, false));
        }
    }

    /// Of the frames of a sequence the first begins no shot, and those behind a cut do.
    #[test]
    fn shots_begin_behind_cuts() {
        let mut cuts = CutDetector::default();
        let picture =
            |at: usize| -> Vec<Vec3> { (0..64).map(|i| Vec3::splat(if i / 8 == at { 1.0 } else { 0.1 })).collect() };
        let found = [1, 1, 6, 6].map(|at| cuts.begins_shot(&picture(at), [8, 8], || false));
        assert_eq!(found, [false, false, true, false]);
        // Pictures without pixels, or with more than their size, are no other shots.
        assert_eq!(
            [[0, 0], [8, 2]].map(|size| CutDetector::default().begins_shot(&picture(1), size, || true)),
            [false; 2]
        );
    }
}
