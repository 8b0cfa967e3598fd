//! Confidence grids: how much the pictures constrain each voxel, beside the prior.

use crate::app::checks::Warning;
use crate::app::checks::displacement::{self, displacements};
use crate::app::checks::excerpt::Excerpt;
use crate::app::checks::residuals::Residuals;
use crate::differentiate::study::subject::Subject;
use crate::error::Result;
use crate::formats::vdb::{CONFIDENCE, shaded};
use crate::inverse::density::Request;
use crate::inverse::density::confidence::{Group, MeasuredView, confidence, lower_unresolved};
use crate::inverse::density::descent::ForwardModel;
use crate::inverse::pose::colors::Colors;
use crate::inverse::through_transfer::alternatives::Alternatives;
use crate::render::composited::Composited;
use crate::render::differentiable::Differentiable;
use crate::render::dvr::Dvr;
use crate::render::preshaded::Preshaded;
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::{Bricks, Voxel};
use crate::scene::grid::{Grid, GridClass};
use crate::scene::medium::Source;
use crate::scene::neighbours::Neighbours;
use glam::Vec4;

/// Standard deviation of a pixel's error, at least, relative to the peak of 1: half a step of eight bits.
const LEAST_NOISE: f64 = 1.0 / 512.0;
/// Standard deviation of the prior on a voxel, relative to the range of values.
const PRIOR_DEVIATION: f64 = 0.1;
/// Share of the voxels that the pictures show which may have alternatives without a warning.
const AMBIGUOUS: f64 = 0.02;
/// Percentage of the positive values that lie below what counts as their range, where no transfer function says it.
const RANGE_PERCENTILE: usize = 99;

/// The pictures that a volume was reconstructed from, and how well it explains them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit<'f> {
    /// Excerpts of all pictures of the capture; the held-out ones among them have no say in the confidence.
    pub excerpts: &'f [Excerpt],
    /// The reconstruction's request.
    pub request: &'f Request,
    /// PSNR of the training views in dB, peak 1; NaN if it was not measured.
    pub train_psnr_db: f64,
}

/// Measures the confidence of densities, as a grid beside the one called `name`; no grid once the work is to stop. The
/// warnings are those of the residuals.
///
/// # Errors
/// If the medium cannot be used.
pub(crate) fn of_densities(
    field: &Bricks<f32>,
    name: &str,
    fit: Fit<'_>,
    tick: impl FnMut(usize, usize),
) -> Result<(Vec<Grid>, Vec<Warning>)> {
    let request = fit.request;
    let quadrature = Quadrature::usual(&request.medium.source);
    let model = ForwardModel { medium: &request.medium, background: request.background, quadrature };
    let renderer = model.renderer(field)?;
    let deviation = PRIOR_DEVIATION * range(field, &request.medium.source);
    let (mut by_group, mut warnings) = fit.confidences(&renderer, &[(&[0], deviation)], tick);
    if let (Source::Transfer(table), Some(confidence)) = (&request.medium.source, by_group.first_mut()) {
        warnings.extend(shown_alike(Alternatives::new(table).lower(field, confidence, deviation)));
    }
    let neighbours = Neighbours::new(&field.topology);
    by_group.iter_mut().for_each(|confidence| lower_unresolved(&field.owned(), &neighbours, confidence, deviation));
    Ok((by_group.iter().map(|confidence| as_grid(field, confidence, name)).collect(), warnings))
}

/// Warns if the transfer function shows the densities of more than a small share of the voxels like others.
fn shown_alike(share: f64) -> Option<Warning> {
    (share > AMBIGUOUS).then(|| {
        Warning::new(
            format!(
                "{:.0} % of the voxels that the pictures show have a density that the transfer function shows like \
                 another one, a tenth of its range away or more: they may be wrong however well the pictures agree",
                100.0 * share
            ),
            "look at density_confidence, which is low there; take the pictures with a function whose densities have \
             colors of their own",
        )
    })
}

/// Warns of cameras that do not suit the densities that were found with them.
///
/// # Errors
/// If the medium cannot be used.
pub(crate) fn of_cameras(field: &Bricks<f32>, fit: Fit<'_>) -> Result<Option<Warning>> {
    let Request { medium, background, bounds, rays_per_edge, cancel, .. } = fit.request;
    let renderer = Dvr::new(field, medium.clone())?.over(*background);
    let (colors, points) = (Colors::from_medium(medium, *background), bounds.inner_corners());
    let displacements = displacements(&renderer, fit.excerpts, &colors, &points, *rays_per_edge, cancel);
    Ok(if cancel.requested() { None } else { displacement::warning(&displacements, fit.excerpts) })
}

/// Compares excerpts of pictures with what a renderer makes of the densities, for the time that it takes.
pub(crate) fn compared<I: Differentiable<Real = f32>>(renderer: &Composited<I>, fit: Fit<'_>) {
    fit.residual_warnings(renderer);
}

/// Measures the confidences of a pre-shaded volume, as a grid beside that of the extinctions and one beside that of the
/// emissions, whose three colors share theirs; no grids once the work is to stop. The warnings are those of the
/// residuals.
pub(crate) fn of_pre_shaded(
    volume: &Bricks<Vec4>,
    fit: Fit<'_>,
    tick: impl FnMut(usize, usize),
) -> (Vec<Grid>, Vec<Warning>) {
    let deviation = |c: usize| PRIOR_DEVIATION * top(volume.owned().into_iter().map(|v| v[c]));
    let emission = (0..3).map(deviation).fold(0.0, f64::max);
    let renderer = Preshaded::new(volume).over(fit.request.background);
    let groups: [Group<'_>; 2] = [(&[3], deviation(3)), (&[0, 1, 2], emission)];
    let (mut by_group, warnings) = fit.confidences(&renderer, &groups, tick);
    let (owned, neighbours) = (volume.owned(), Neighbours::new(&volume.topology));
    for (confidence, (channels, deviation)) in by_group.iter_mut().zip(groups) {
        let mean = |v: &Vec4| channels.iter().map(|c| v[*c]).sum::<f32>() / channels.len() as f32;
        lower_unresolved(&owned.iter().map(mean).collect::<Vec<f32>>(), &neighbours, confidence, deviation);
    }
    let grids = by_group.iter().zip([shaded::EXTINCTION, shaded::EMISSION]);
    (grids.map(|(confidence, name)| as_grid(volume, confidence, name)).collect(), warnings)
}

impl Fit<'_> {
    /// Measures the confidence of each group of channels; none once the work is to stop. The warnings are those of the
    /// residuals.
    fn confidences<I>(
        self,
        renderer: &Composited<I>,
        groups: &[Group<'_>],
        tick: impl FnMut(usize, usize),
    ) -> (Vec<Vec<f32>>, Vec<Warning>)
    where
        I: Differentiable<Real = f32, Voxel: Subject>,
    {
        let warnings = self.residual_warnings(renderer);
        let Request { held_out, rays_per_edge, .. } = self.request;
        let training =
            self.excerpts.iter().enumerate().filter(|(i, _)| !held_out.contains(i)).map(|(_, excerpt)| excerpt);
        let measured: Vec<_> = training.map(|excerpt| (excerpt.camera, |i: usize| excerpt.is_finite(i))).collect();
        let views: Vec<MeasuredView<'_>> = measured
            .iter()
            .map(|(camera, measured)| MeasuredView { camera: *camera, rays_per_edge: *rays_per_edge, measured })
            .collect();
        let by_group = confidence(renderer, &views, self.noise(), groups, &self.request.cancel, tick);
        (by_group.unwrap_or_default(), warnings)
    }

    fn residual_warnings<I: Differentiable<Real = f32>>(self, renderer: &Composited<I>) -> Vec<Warning> {
        let Request { held_out, rays_per_edge, cancel, .. } = self.request;
        let residuals = Residuals::new(renderer, self.excerpts, held_out, *rays_per_edge, cancel);
        residuals.map(|r| r.warnings()).unwrap_or_default()
    }

    /// Returns the standard deviation of a pixel's error; the least where the PSNR was not measured, as after a stop.
    fn noise(self) -> f64 {
        LEAST_NOISE.max(10.0_f64.powf(-self.train_psnr_db / 20.0))
    }
}

fn as_grid<V: Voxel>(field: &Bricks<V>, confidence: &[f32], name: &str) -> Grid {
    let mut own = Bricks::zeros(field.topology.clone(), field.transform);
    own.topology.fill_apron(confidence, &mut own.values);
    Grid { class: GridClass::Unknown, ..own.to_grid(&format!("{name}{CONFIDENCE}")) }
}

fn range(field: &Bricks<f32>, source: &Source) -> f64 {
    match source {
        Source::Transfer(table) => table.knots()[table.knots().len() - 1].max(0.0),
        Source::Grey(_) | Source::Linear(_) => top(field.owned().into_iter()),
    }
}

/// Returns the value that [`RANGE_PERCENTILE`] percent of the positive values lie below; 0 if none is positive.
fn top(values: impl Iterator<Item = f32>) -> f64 {
    let mut positive: Vec<f32> = values.filter(|v| *v > 0.0).collect();
    if positive.is_empty() {
        return 0.0;
    }
    let at = (positive.len() - 1) * RANGE_PERCENTILE / 100;
    let (_, top, _) = positive.select_nth_unstable_by(at, f32::total_cmp);
    f64::from(*top)
}
