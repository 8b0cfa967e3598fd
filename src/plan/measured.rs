//! Measurements of a scene.

use super::depth;
use crate::error::Result;
use crate::render::scale;
use crate::scene::bricks::BRICK;
use crate::scene::camera::Camera;
use crate::scene::medium::{Medium, Source};
use crate::scene::scene::Scene;
use crate::scene::table::Table;
use crate::scene::volume::Volume;
use rayon::prelude::*;
use serde::Serialize;

/// Measurements of a scene.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct Measured {
    /// Number of volumes.
    pub volumes: usize,
    /// Least and greatest albedo over channels and volumes.
    pub albedo: [f32; 2],
    /// True if any color of a medium differs between channels.
    pub colored: bool,
    /// True if the extinction of a medium differs between channels.
    pub chromatic: bool,
    /// Optical depth along rays, in the channel of most extinction.
    pub optical_depth: Depth,
    /// Share of the bricks of 8³ voxels in which the density does not change.
    pub constant_bricks: f64,
    /// True if extinction never falls with the density; none without a transfer function.
    pub monotonic: Option<bool>,
}

/// Optical depth along rays.
#[derive(Debug, Clone, Copy, Serialize, schemars::JsonSchema)]
pub struct Depth {
    /// Camera rays among those sampled that meet a medium.
    pub rays: usize,
    /// Median over these rays.
    pub median: f64,
    /// 99th percentile over these rays.
    pub percentile_99: f64,
    /// Greatest along one of these rays.
    pub largest: f64,
    /// Upper bound along any ray at all.
    pub bound: f64,
}

impl Measured {
    /// Measures a scene as its cameras see it.
    ///
    /// # Errors
    /// If a medium cannot be used.
    pub(crate) fn new(scene: &Scene, cameras: &[Camera]) -> Result<Self> {
        let densities: Vec<_> = scene.volumes.iter().filter_map(Volume::density).collect();
        let (mut depths, mut bound) = (Vec::new(), 0.0);
        for (field, medium) in &densities {
            bound += depth::largest(field, medium);
            depths.push(scale::depths(field, medium.densest_channel(), cameras)?);
        }
        // Where several volumes are, the deepest tells more than a sum of percentiles of different rays would.
        let last = |depths: &Vec<f64>| depths.last().copied().unwrap_or_default();
        let depths = depths.into_iter().max_by(|a, b| last(a).total_cmp(&last(b))).unwrap_or_default();
        let at = |share: f64| depths.get((depths.len().saturating_sub(1) as f64 * share).round() as usize).copied();
        let media = || densities.iter().map(|(_, medium)| *medium);
        let albedos = || media().flat_map(Medium::albedo_bounds);
        let most = albedos().flatten().fold(0.0, f32::max);
        let constant = |values: &[f32]| values.iter().all(|v| *v == values[0]);
        let fields = || densities.iter().map(|(field, _)| &field.values);
        let same: usize = fields().map(|v| v.par_chunks(BRICK).filter(|values| constant(values)).count()).sum();
        let bricks: usize = fields().map(|v| v.len() / BRICK).sum();
        Ok(Self {
            volumes: scene.volumes.len(),
            albedo: [albedos().flatten().fold(most, f32::min), most],
            colored: albedos().any(|albedo| uneven(&albedo)) || media().any(colored),
            chromatic: media().any(Medium::is_chromatic),
            optical_depth: Depth {
                rays: depths.len(),
                median: at(0.5).unwrap_or_default(),
                percentile_99: at(0.99).unwrap_or_default(),
                largest: at(1.0).unwrap_or_default(),
                bound,
            },
            constant_bricks: same as f64 / bricks.max(1) as f64,
            monotonic: media().filter_map(rises).reduce(|a, b| a && b),
        })
    }
}

fn uneven(color: &[f32; 3]) -> bool {
    color.iter().any(|v| *v != color[0])
}

/// True if the source's color, or that of the albedo, differs between channels.
fn colored(medium: &Medium) -> bool {
    let uneven_value = |v: &[f64; 4]| v[..3].iter().any(|c| *c != v[0]);
    if medium.albedo_function.as_ref().is_some_and(|function| function.table().values().iter().any(uneven_value)) {
        return true;
    }
    match &medium.source {
        Source::Grey(color) | Source::Linear(color) => uneven(color),
        Source::Transfer(table) => table.values().iter().any(uneven_value),
    }
}

/// Returns whether the extinction never falls with the density; `None` without a transfer function.
fn rises(medium: &Medium) -> Option<bool> {
    let rises = |table: &Table| table.values().windows(2).all(|pair| pair[0][3] <= pair[1][3]);
    match &medium.source {
        Source::Transfer(table) => Some(rises(table)),
        _ => None,
    }
}
