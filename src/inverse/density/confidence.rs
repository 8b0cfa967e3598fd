//! Confidence of each voxel: how strongly the pictures determine it.
//!
//! The sum of squared sensitivities `S = Σ (∂L/∂d)²` over pixels and channels bounds one voxel's variance if all others
//! are known: noise of variance ε² leaves `ε² / S`. With a prior of variance p² for the voxel, the pictures' share is
//! `S p² / (S p² + ε²)`: the confidence, 0 where the function is flat or nothing was seen, near 1 where the pictures
//! decide. (Correlation between neighbours is left out: the confidence marks voxels that are undetermined, but not all
//! of those that are determined only in sums.)
//!
//! S is the diagonal of `JᵀJ`, for which random signs r give `E[(Jᵀr)²]` (Hutchinson 1990; Bekas, Kokiopoulou & Saad
//! 2007): one backward walk per probe, with any renderer. A voxel of several numbers has several sums.

use crate::cancel::Cancel;
use crate::differentiate::gradient::pictures::{self, Gradients, Target, Workspace};
use crate::differentiate::study::subject::Subject;
use crate::render::composited::Composited;
use crate::render::differentiable::Adjoint;
use crate::render::differentiable::Differentiable;
use crate::scene::camera::Camera;
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::neighbours::Neighbours;
use rayon::prelude::*;

/// Number of probes times views, the fewest and the most probes, and the edge of the blocks of pixels of which each
/// probe takes one.
const PROBE_VIEWS: usize = 512;
const PROBES: [usize; 2] = [8, 64];
const BLOCK: usize = 4;

/// Pixels whose signs are held at once.
const BATCH: usize = 1 << 24;

/// A view whose pixels determine voxels.
#[derive(Clone, Copy)]
pub struct MeasuredView<'v> {
    /// Camera of the view.
    pub camera: Camera,
    /// Rays along each edge of a pixel, whose value is the mean over the square of that number.
    pub rays_per_edge: usize,
    /// Tells for a pixel's row-major number whether it has measured anything.
    pub measured: &'v (dyn Fn(usize) -> bool + Sync),
}

impl MeasuredView<'_> {
    fn pixels(&self) -> usize {
        self.camera.width as usize * self.camera.height as usize
    }
}

/// Channels of a voxel that share a confidence, and the standard deviation p of the prior on them.
pub type Group<'g> = (&'g [usize], f64);

/// Returns the confidence of each voxel (512 a brick), 0..1, for each group; `None` once the work is cancelled. `noise`
/// is the standard deviation of a pixel's error. `tick` is called with the number of probes done and their total.
pub fn confidence<I>(
    renderer: &Composited<I>,
    views: &[MeasuredView<'_>],
    noise: f64,
    groups: &[Group<'_>],
    cancel: &Cancel,
    mut tick: impl FnMut(usize, usize),
) -> Option<Vec<Vec<f32>>>
where
    I: Differentiable<Real = f32, Voxel: Subject>,
{
    let topology = &renderer.medium.field().topology;
    let count = topology.len() * LEAF_VOXELS;
    let mut squares = vec![vec![0.0_f32; count]; groups.len()];
    let mut owned = vec![I::Voxel::default(); count];
    let mut stored = vec![I::Voxel::default(); renderer.medium.field().values.len()];
    let mut accumulators = Workspace::default();
    let linear = |_: &[f32; 4], signs: &[f32; 4]| (0.0, *signs);
    let probes = probes(views.len());
    for probe in 0..probes {
        stored.fill(I::Voxel::default());
        let mut first = 0;
        while first < views.len() {
            let mut pixels = 0;
            let fits = |view: &&MeasuredView<'_>| {
                pixels += view.pixels();
                pixels <= BATCH
            };
            let end = first + views[first..].iter().take_while(fits).count().max(1);
            let signed: Vec<Target> = (first..end).into_par_iter().map(|v| signs(&views[v], v, probe)).collect();
            let signed: Vec<&Target> = signed.iter().collect();
            let mut gradients = Gradients { voxels: Some(&mut stored), cancel: cancel.clone(), ..Gradients::default() };
            pictures::gradient(renderer, &signed, &linear, Adjoint::Tape, &mut accumulators, &mut gradients);
            if cancel.requested() {
                return None;
            }
            first = end;
        }
        topology.gather_apron(&stored, &mut owned);
        for (squares, (channels, _)) in squares.iter_mut().zip(groups) {
            let share = (BLOCK * BLOCK) as f32 / (probes * channels.len()) as f32;
            squares.par_chunks_mut(LEAF_VOXELS).zip(owned.par_chunks(LEAF_VOXELS)).for_each(|(squares, owned)| {
                for channel in *channels {
                    let values = owned.iter().map(|v| v.channel(*channel) as f32);
                    squares.iter_mut().zip(values).for_each(|(s, v)| *s += share * v * v);
                }
            });
        }
        tick(probe + 1, probes);
    }
    let neighbours = Neighbours::new(topology);
    let share = |(squares, (_, deviation)): (&Vec<f32>, &Group<'_>)| {
        let ratio = (deviation / noise.max(f64::MIN_POSITIVE)).powi(2);
        (0..count).into_par_iter().map(|voxel| voxel_confidence(squares, &neighbours, voxel, ratio)).collect()
    };
    Some(squares.iter().zip(groups).map(share).collect())
}

/// Returns the number of probes of so many views.
pub fn probes(views: usize) -> usize {
    (PROBE_VIEWS / views.max(1)).clamp(PROBES[0], PROBES[1])
}

/// Share of the range of the values of a voxel and its neighbours that a voxel may be off by: sharp edges and texture
/// are reconstructed with errors that grow with it. The share is an empirical one, of volumes of blocks, shells and
/// texture.
const UNRESOLVED: f64 = 0.15;

/// Lowers the confidence of voxels (512 a brick) where neighbours differ: what is not resolved is not known either.
/// `deviation` is that of the prior.
pub fn lower_unresolved(values: &[f32], neighbours: &Neighbours, confidence: &mut [f32], deviation: f64) {
    confidence.par_iter_mut().enumerate().for_each(|(voxel, confidence)| {
        // What lies beyond the bricks is empty.
        let near = neighbours.of_voxel(voxel).map(|near| near.map_or(0.0, |near| values[near]));
        let range = |[least, most]: [f32; 2], v: f32| [least.min(v), most.max(v)];
        let [least, most] = near.into_iter().fold([values[voxel]; 2], range);
        let error = UNRESOLVED * f64::from(most - least);
        *confidence = lowered(*confidence, error * error, deviation);
    });
}

/// Returns a confidence with a squared error added to its variance: with variance v it is p² / (p² + v), where
/// `deviation` is p, that of the prior.
pub(crate) fn lowered(confidence: f32, square: f64, deviation: f64) -> f32 {
    if square == 0.0 {
        return confidence;
    }
    (1.0 / (1.0 / f64::from(confidence) + square / (deviation * deviation))) as f32
}

/// Returns a voxel's confidence. A few probes give a rough estimate, so it is averaged with the neighbours'; `ratio` is
/// (p / ε)².
fn voxel_confidence(squares: &[f32], neighbours: &Neighbours, voxel: usize, ratio: f64) -> f32 {
    if squares[voxel] == 0.0 {
        return 0.0;
    }
    let near = neighbours.of_voxel(voxel).into_iter().flatten().map(|v| squares[v]).filter(|s| *s > 0.0);
    let (sum, count) = near.fold((2.0 * squares[voxel], 2.0_f32), |(sum, count), s| (sum + s, count + 1.0));
    let data_to_prior = ratio * f64::from(sum / count);
    if data_to_prior.is_finite() { (data_to_prior / (1.0 + data_to_prior)) as f32 } else { 1.0 }
}

/// Returns a target of random signs in place of colors, for the pixels of this probe; the others are NaN.
fn signs(view: &MeasuredView<'_>, number: usize, probe: usize) -> Target {
    let width = view.camera.width as usize;
    let pixel = |i: usize| {
        let turn = (i / width % BLOCK * BLOCK + i % width % BLOCK + 5 * probe) % (BLOCK * BLOCK);
        if turn != 0 || !(view.measured)(i) {
            return [f32::NAN; 4];
        }
        let bits = scrambled(((number << 8 | probe) as u64) << 40 | i as u64);
        [20, 21, 22, 23].map(|bit| if bits >> bit & 1 == 1 { 1.0 } else { -1.0 })
    };
    let rgba = (0..view.pixels()).map(pixel).collect();
    Target { camera: view.camera, rgba, rays_per_edge: view.rays_per_edge }
}

/// Hashes 64 bits bijectively; each bit of the result depends on all bits of the argument (Stafford's variant 13 of
/// MurmurHash3's finaliser).
fn scrambled(mut v: u64) -> u64 {
    v = (v ^ (v >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    v = (v ^ (v >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    v ^ (v >> 31)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::scene::bricks::Topology;
    use glam::IVec3;

    /// A step of the whole range costs the voxels beside it their confidence, and the others keep theirs; beyond the
    /// bricks lies nothing.
    #[test]
    fn what_is_not_resolved_is_not_known() {
        let neighbours = Neighbours::new(&Topology::new([IVec3::ZERO]).unwrap());
        let step: Vec<f32> = (0..LEAF_VOXELS).map(|v| if v >> 6 < 4 { 0.0 } else { 1.0 }).collect();
        let mut confidence = vec![0.9_f32; LEAF_VOXELS];
        lower_unresolved(&step, &neighbours, &mut confidence, 0.1);
        // p² / (p² + v): 0.9 is a variance of a ninth of p², to which 0.15² of the step is added.
        let beside = 1.0 / (1.0 / 0.9 + (0.15_f32 / 0.1).powi(2));
        for (voxel, confidence) in confidence.into_iter().enumerate() {
            let [x, y, z] = [voxel >> 6, voxel >> 3 & 7, voxel & 7];
            let outermost = [x, y, z].iter().any(|at| [0, 7].contains(at)) && step[voxel] > 0.0;
            let expected = if [3, 4].contains(&x) || outermost { beside } else { 0.9 };
            assert!((confidence - expected).abs() < 1e-6, "{x} {y} {z}: {confidence} {expected}");
        }
        // Without a range there is nothing to be off by.
        let mut none = vec![0.0; LEAF_VOXELS];
        lower_unresolved(&vec![0.0; LEAF_VOXELS], &neighbours, &mut none, 0.0);
        assert!(none.iter().all(|c| *c == 0.0));
    }
}
