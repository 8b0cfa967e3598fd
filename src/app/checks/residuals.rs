//! What is left between pictures and a reconstruction, and what that says about the model.
//!
//! Noise differs from pixel to pixel and has no mean. Residuals that agree with their neighbours, lie on one side, or
//! stand in the alpha while the colors fit, come from a model that is wrong: background, emission, cameras, or a region
//! that is too small.

use crate::app::checks::Warning;
use crate::app::checks::excerpt::{Excerpt, pairs};
use crate::cancel::Cancel;
use crate::render::composited::Composited;
use crate::render::differentiable::Differentiable;
use crate::render::film::Subpixels;
use crate::render::tiles;

/// Views that are looked at.
const VIEWS: usize = 16;

/// Sums over pixels of the views that were used.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Residuals {
    count: f64,
    /// Of the mean of red, green and blue, picture less render.
    sum: f64,
    square: f64,
    /// Products of neighbours.
    product: f64,
    /// Largest color of the pictures.
    peak: f64,
    /// Of alpha, picture less render.
    alpha_square: f64,
    /// Optical depths by alpha, where the picture is not opaque.
    target_depth: f64,
    rendered_depth: f64,
    /// Residuals at the border of the pictures.
    border: f64,
    border_count: f64,
    /// True if some alpha is not 1.
    has_alpha: bool,
}

/// Alphas up to this tell an optical depth.
const OPAQUE: f32 = 0.98;

impl Residuals {
    /// Compares pairs of neighbouring pixels of the used views with their renders; none once the work is to stop, or
    /// where there are none.
    pub(crate) fn new<I: Differentiable<Real = f32>>(
        renderer: &Composited<I>,
        excerpts: &[Excerpt],
        held_out: &[usize],
        rays_per_edge: usize,
        cancel: &Cancel,
    ) -> Option<Self> {
        let used: Vec<&Excerpt> =
            excerpts.iter().enumerate().filter(|(i, _)| !held_out.contains(i)).map(|(_, excerpt)| excerpt).collect();
        let step = used.len().div_ceil(VIEWS).max(1);
        let chosen: Vec<&Excerpt> = used.into_iter().step_by(step).collect();
        let rays = Subpixels::new(rays_per_edge);
        let of_view = |tape: &mut I::Scratch, excerpt: &&Excerpt| Self::of_view(renderer, excerpt, rays, cancel, tape);
        let all = tiles::map(&chosen, cancel, I::Scratch::default, of_view)?;
        let total = all.into_iter().reduce(Self::plus)?;
        (total.count > 0.0 && !cancel.requested()).then_some(total)
    }

    fn of_view<I: Differentiable<Real = f32>>(
        renderer: &Composited<I>,
        excerpt: &Excerpt,
        rays: Subpixels,
        cancel: &Cancel,
        tape: &mut I::Scratch,
    ) -> Self {
        let camera = &excerpt.camera;
        let [w, h] = [camera.width, camera.height].map(|n| n as usize);
        let mut render_pixel = |x: usize, y: usize| renderer.mean(camera, rays, [x, y], tape);
        let mut own = Self::default();
        let mean = |p: &[f32; 4]| f64::from(p[0] + p[1] + p[2]) / 3.0;
        for first in pairs(w, h) {
            if cancel.requested() {
                break;
            }
            let (x, y) = (first % w, first / w);
            let target = [excerpt.pixel(first), excerpt.pixel(first + 1)];
            if target.iter().flatten().any(|v| !v.is_finite()) {
                continue;
            }
            let rendered = [render_pixel(x, y), render_pixel(x + 1, y)];
            let residual: [f64; 2] = std::array::from_fn(|k| mean(&target[k]) - mean(&rendered[k]));
            own.product += 2.0 * residual[0] * residual[1];
            for k in 0..2 {
                own.count += 1.0;
                own.sum += residual[k];
                own.square += residual[k] * residual[k];
                own.peak = own.peak.max(mean(&target[k]).abs());
                own.alpha_square += f64::from(target[k][3] - rendered[k][3]).powi(2);
                own.has_alpha |= target[k][3] != 1.0;
                if target[k][3].max(rendered[k][3]) < OPAQUE {
                    own.target_depth -= f64::from(1.0 - target[k][3].max(0.0)).ln();
                    own.rendered_depth -= f64::from(1.0 - rendered[k][3].max(0.0)).ln();
                }
            }
            if x == 0 || x + 2 >= w || y == 0 || y == h - 1 {
                own.border += residual[0] + residual[1];
                own.border_count += 2.0;
            }
        }
        own
    }

    fn plus(self, other: Self) -> Self {
        Self {
            count: self.count + other.count,
            sum: self.sum + other.sum,
            square: self.square + other.square,
            product: self.product + other.product,
            peak: self.peak.max(other.peak),
            alpha_square: self.alpha_square + other.alpha_square,
            target_depth: self.target_depth + other.target_depth,
            rendered_depth: self.rendered_depth + other.rendered_depth,
            border: self.border + other.border,
            border_count: self.border_count + other.border_count,
            has_alpha: self.has_alpha || other.has_alpha,
        }
    }

    /// Returns a warning for each way in which the residuals contradict the model.
    pub(crate) fn warnings(&self) -> Vec<Warning> {
        let mut warnings = Vec::new();
        let scale = self.peak.max(f64::MIN_POSITIVE);
        let rms = (self.square / self.count).sqrt() / scale;
        let alpha = (self.alpha_square / self.count).sqrt();
        if self.has_alpha && alpha > 0.05 && alpha > 2.0 * rms {
            let ratio = self.target_depth / self.rendered_depth.max(1e-9);
            warnings.push(Warning::new(
                format!(
                    "the pictures' alpha contradicts the densities found: it is off by {alpha:.2} (RMS), and tells \
                     optical depths {ratio:.3} times as large"
                ),
                "check \"emission\", \"background\" and \"model\" in transforms.json: densities follow from them. If \
                 alpha is a mask and not 1 - transmittance, leave it out of the pictures",
            ));
        }
        let border = self.border / self.border_count.max(1.0) / scale;
        if border.abs() > 0.02 {
            warnings.push(Warning::new(
                format!(
                    "the borders of the pictures are {:.1} % {} than the reconstruction's",
                    100.0 * border.abs(),
                    side(border)
                ),
                "check \"background\" in transforms.json, and that ⟨bounds⟩, if given, holds all of the volume",
            ));
        }
        let (correlation, bias) = (self.product / self.square.max(f64::MIN_POSITIVE), self.sum / self.count / scale);
        if rms > 0.02 && correlation > 0.5 {
            warnings.push(Warning::new(
                format!(
                    "the residuals are no noise: {:.1} % of the peak (RMS), neighbouring pixels agree to {:.0} %, and \
                     the pictures are {:.1} % {} on average",
                    100.0 * rms,
                    100.0 * correlation,
                    100.0 * bias.abs(),
                    side(bias)
                ),
                "check model, background, emission and cameras in transforms.json; if these are right, allow finer \
                 voxels with ⟨voxel_size⟩ or more ⟨iterations⟩",
            ));
        }
        warnings
    }
}

fn side(value: f64) -> &'static str {
    if value > 0.0 { "brighter" } else { "darker" }
}

/// PSNR that held-out views may lie below the used ones, and beyond which they are good whatever the others are.
const BELOW: f64 = 10.0;
const GOOD: f64 = 36.0;

/// A warning if held-out views are explained far worse than those that were used.
pub(crate) fn held_out(train_psnr_db: f64, held_out_psnr_db: Option<f64>) -> Option<Warning> {
    let held_out = held_out_psnr_db?;
    (held_out < GOOD && held_out < train_psnr_db - BELOW).then(|| {
        Warning::new(
            format!(
                "held-out views have {held_out:.1} dB, those that were used {train_psnr_db:.1} dB: the volume explains \
                 the pictures, not the scene"
            ),
            "add views, choose larger voxels with ⟨voxel_size⟩ or more ⟨smoothing⟩, and check the held-out cameras",
        )
    })
}

/// PSNR below which pictures are not explained.
const POOR: f64 = 20.0;

/// A warning if not even the views that were used are explained.
pub(crate) fn unexplained(train_psnr_db: f64) -> Option<Warning> {
    (train_psnr_db < POOR).then(|| {
        Warning::new(
            format!("the views that were used are only met to {train_psnr_db:.1} dB: the result does not explain them"),
            "check model, background, emission and cameras in transforms.json",
        )
    })
}
