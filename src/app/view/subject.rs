//! The density that a picture of a grid shows.

use super::ViewSettings;
use super::slices::magnitude;
use crate::app::Context;
use crate::app::checks::values;
use crate::app::pictures::DensityScale;
use crate::app::volume;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::transfer;
use crate::formats::vdb::{GridInfo, NativeGrid};
use crate::render::direct::DirectRenderer;
use crate::render::dvr::Dvr;
use crate::render::emission_absorption::EmissionAbsorption;
use crate::render::film::Sampling;
use crate::render::labels::Labels;
use crate::render::quadrature::Quadrature;
use crate::render::{scale, tiles};
use crate::scene::bricks::{Bricks, too_large};
use crate::scene::camera::Camera;
use crate::scene::environment::Environment;
use crate::scene::film::Film;
use crate::scene::grid::{Grid, GridClass, Leaf, MOST_DENSITY, Tile};
use crate::scene::medium::{Medium, Source};
use crate::scene::scene::Scene;
use crate::scene::volume::Volume;
use glam::DVec2;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Transmittance at which rays end: half a level of a display.
const EARLY_STOP: f64 = 2e-3;
/// Rays along each edge of a pixel.
const RAYS: usize = 2;
/// Rays along each edge of a picture, to find what can be seen of it; and the share of the largest optical depth above
/// which something is.
const PROBES: usize = 96;
const VISIBLE: f64 = 0.01;

/// A density, and the light that it sends.
pub(super) struct Subject {
    pub field: Bricks<f32>,
    source: Source,
    /// Meaning of the density in terms of the grid's values, in words.
    pub meaning: &'static str,
}

impl Subject {
    /// Arranges a grid: by the transfer function of the settings, or of the grid; without one as an absorber.
    ///
    /// # Errors
    /// If the grid does not fit in memory, has no affine transform, or a transfer function cannot be used with it.
    pub(crate) fn of(view: &ViewSettings, native: &NativeGrid, info: &GridInfo, context: &Context) -> Result<Self> {
        let limits = view.limits;
        let requested = view.transfer.load(limits)?;
        let carried = transfer::from_metadata(&native.metadata()?).unwrap_or_default();
        if let Some(transfer) = requested.or(carried.filter(|_| info.components == 1)) {
            let grid = native.to_grid_within(limits.max_memory)?;
            crate::formats::vdb::require_fog(&grid)?;
            let limits = Limits { max_memory: limits.max_memory.saturating_sub(info.memory) };
            let field = volume::arrange(&grid, Some(&transfer), limits)?;
            context.warn(values::unmet(&field, &transfer, view.transfer.unit()).as_slice());
            let source = Source::Transfer(Arc::new(transfer.table()?));
            return Ok(Self { field, source, meaning: "values by the transfer function" });
        }
        let (grid, meaning) = density(native, info, limits)?;
        // The grid as the file has it is still there.
        let limits = Limits { max_memory: limits.max_memory.saturating_sub(info.memory) };
        let field = volume::arrange(&grid, None, limits)?;
        Ok(Self { field, source: Source::Grey([0.0; 3]), meaning })
    }

    /// Returns how the density is shown, in words.
    pub(crate) fn light(&self) -> &'static str {
        match self.source {
            Source::Transfer(_) => "by transfer function",
            _ => "absorption",
        }
    }

    /// Returns a camera that shows no more than what can be seen of the subject: the outline of its boxes is wider than
    /// a cloud whose edges are thin. The longer side of the picture has `side` pixels.
    pub(crate) fn framed(&self, camera: &Camera, side: usize) -> Camera {
        let Some(depths) = self.depths(camera) else { return *camera };
        let most = depths.iter().copied().fold(0.0, f64::max);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for (i, _) in depths.iter().enumerate().filter(|(_, depth)| **depth > VISIBLE * most) {
            for (axis, place) in [i % PROBES, i / PROBES].into_iter().enumerate() {
                low[axis] = low[axis].min(place as f64 - 1.0);
                high[axis] = high[axis].max(place as f64 + 2.0);
            }
        }
        if most <= 0.0 {
            return *camera;
        }
        let size = [camera.width, camera.height].map(f64::from);
        let window = |axis: usize| {
            let [low, high] = [low, high].map(|end| (end[axis] / PROBES as f64).clamp(0.0, 1.0) * size[axis]);
            (low, high - low)
        };
        let [(x, width), (y, height)] = [window(0), window(1)];
        let factor = side as f64 / width.max(height);
        let pixels = |v: f64| ((factor * v).round() as u32).clamp(side as u32 / 3, side as u32);
        let (w, h) = (pixels(width), pixels(height));
        let middle = DVec2::new(x + 0.5 * width, y + 0.5 * height);
        let centre = factor * (camera.centre - middle) + 0.5 * DVec2::new(f64::from(w), f64::from(h));
        Camera { focal: factor * camera.focal, centre, width: w, height: h, ..*camera }
    }

    /// Optical depths at unit density scale of [`PROBES`] x [`PROBES`] rays over a picture, row by row.
    fn depths(&self, camera: &Camera) -> Option<Vec<f64>> {
        let medium = Medium::new(1.0, self.source.clone());
        match medium.labels() {
            Some(_) => depths(&Labels::new(&self.field, &medium).ok()?.early_stop(0.0), camera),
            None => depths(&Dvr::new(&self.field, medium).ok()?.early_stop(0.0), camera),
        }
    }

    /// Returns the extinction per unit of density for a camera: that of the settings, or the one at which the picture
    /// neither vanishes nor goes black; `None` if nothing is in view.
    pub(crate) fn scale(&self, view: &ViewSettings, camera: &Camera) -> Option<f64> {
        match view.density_scale {
            DensityScale::Given(scale) => Some(scale),
            DensityScale::Auto => scale::density_scale(&self.field, &self.source, &[*camera]),
        }
    }

    /// Renders the picture: an absorber before white, or what a transfer function makes shine before black.
    ///
    /// # Errors
    /// If the medium cannot be rendered, or the user stopped the work.
    pub(crate) fn picture(self, camera: &Camera, scale: f64, cancel: &Cancel) -> Result<Film> {
        let shines = matches!(self.source, Source::Transfer(_));
        let quadrature = Quadrature::usual(&self.source);
        let scene = Scene {
            volumes: vec![Volume::Density(self.field, Medium::new(scale, self.source))],
            environment: Environment::constant(if shines { [0.0; 3] } else { [1.0; 3] }),
            ..Scene::default()
        };
        let renderer = DirectRenderer::new(&scene, quadrature)?.early_stop(EARLY_STOP);
        let rendered = renderer.render(camera, Sampling::grid(RAYS), &[], cancel);
        Ok(rendered.ok_or_else(Error::cancelled)?.film)
    }
}

/// Returns the optical depths of [`PROBES`] x [`PROBES`] rays over a picture, row by row.
fn depths<I: EmissionAbsorption>(integrator: &I, camera: &Camera) -> Option<Vec<f64>> {
    let place = |i: usize, size: u32| (i as f64 + 0.5) / PROBES as f64 * f64::from(size);
    let rows: Vec<usize> = (0..PROBES).collect();
    let row = |scratch: &mut I::Scratch, y: &usize| {
        let ray = |x: usize| camera.ray(place(x, camera.width), place(*y, camera.height));
        (0..PROBES).map(|x| integrator.integrate(&ray(x), scratch).depth).collect::<Vec<f64>>()
    };
    tiles::map(&rows, &Cancel::NEVER, I::Scratch::default, row).map(|rows| rows.concat())
}

/// Maps the components of a value to a density.
type Density = Box<dyn Fn(&[f32]) -> f32>;

/// Returns a grid of any type as a density: the inside of a level set, else how far values are from the background, and
/// in words what it is.
fn density(native: &NativeGrid, info: &GridInfo, limits: Limits) -> Result<(Grid, &'static str)> {
    let leaf_bytes = size_of::<Leaf>() as u64;
    let bytes = info.memory.saturating_add(info.leaf_count.saturating_mul(leaf_bytes));
    if bytes > limits.max_memory {
        return Err(too_large(bytes, limits.max_memory).part(format!("grid '{}'", info.name)));
    }
    let background: Vec<f32> = info.background.iter().take(info.components).map(|v| *v as f32).collect();
    let (to_density, meaning): (Density, _) = match info.class {
        GridClass::LevelSet => {
            // Distances are clamped at the width of the narrow band, which is the background.
            let band = magnitude(&background).abs().max(f32::MIN_POSITIVE);
            (Box::new(move |v| (-magnitude(v) / band).clamp(0.0, 1.0)), "the inside of the level set")
        }
        _ => {
            let meaning = match (info.components, background.iter().all(|v| *v == 0.0)) {
                (1, true) if info.class == GridClass::FogVolume => "densities",
                (1, true) => "magnitudes",
                (1, false) => "distances from the background",
                _ => "lengths of vectors",
            };
            let apart = move |v: &[f32]| {
                let squares = v.iter().zip(&background).map(|(v, b)| (v - b) * (v - b));
                squares.sum::<f32>().sqrt()
            };
            (Box::new(apart), meaning)
        }
    };
    let usable = |v: &[f32]| Some(to_density(v)).filter(|d| d.is_finite()).map_or(0.0, |d| d.min(MOST_DENSITY));
    let mut leaves = Vec::with_capacity(info.leaf_count as usize);
    native.for_each_leaf(|leaf| {
        let values = std::array::from_fn(|i| usable(&leaf.values[i * info.components..][..info.components]));
        leaves.push(Leaf { origin: leaf.origin, values, active: [u64::MAX; 8] });
        true
    })?;
    let tiles = native.tiles()?.into_iter().map(|t| Tile {
        origin: t.origin,
        dim: t.dim,
        value: usable(&t.value[..info.components]),
        active: true,
    });
    let grid = Grid {
        name: info.name.clone(),
        class: GridClass::FogVolume,
        transform: info.affine()?,
        background: 0.0,
        leaves,
        tiles: tiles.filter(|t| t.value > 0.0).collect(),
        metadata: BTreeMap::new(),
    };
    Ok((grid, meaning))
}
