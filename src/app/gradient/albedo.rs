//! Derivatives of pictures of scattered light by the albedo, estimated along paths.
//!
//! Medium and lights are those that the target records, which `render` made with an albedo.

use super::report::{GradientReport, Row};
use super::{GradientSettings, LossName, Wrt};
use crate::app::pictures::colors::Colors;
use crate::app::pictures::scattering::ScatteringSettings;
use crate::app::{Context, photos, volume};
use crate::differentiate::albedo::{AlbedoGradient, Estimate, Paths, REPLICATES, by_albedo};
use crate::differentiate::loss::{Loss, Rgba};
use crate::differentiate::study::ad_mode::Mode;
use crate::error::{Code, Error, Result};
use crate::formats::captures;
use crate::formats::transfer::Function;
use crate::formats::transforms;
use crate::inverse::observation::photo::Photo;
use crate::render::film::{self, Sampling};
use crate::render::labels::not_differentiated;
use crate::render::path::PathTracer;
use crate::render::quadrature::Quadrature;
use crate::scene::capture::{Capture, EmissionModel};
use crate::scene::medium::{Medium, Source};
use crate::scene::scene::Scene;
use crate::scene::volume::Volume;

/// Paths of a pixel unless stated.
const SAMPLES: u32 = 64;
/// Bytes of a pixel: its target, the derivatives of the loss by each replicate's color, and these pictures.
const BYTES: u64 = photos::WHOLE + REPLICATES as u64 * (24 + 48);
/// Channels, as names have them.
const CHANNELS: [&str; 3] = ["red", "green", "blue"];

/// A scene of scattered light that pictures are compared with.
struct Lit {
    scene: Scene,
    capture: Capture,
    scattering: ScatteringSettings,
}

impl GradientSettings {
    /// True if derivatives by the albedo are asked for.
    pub(super) fn is_by_albedo(&self) -> bool {
        self.wrt.contains(&Wrt::Albedo)
    }

    /// Refuses settings that do not go with derivatives by the albedo.
    pub(super) fn check_albedo(&self) -> Result<()> {
        let refused = |what: &str, remedy: &str| Err(Error::invalid(what).hint(remedy));
        match () {
            () if !self.is_by_albedo() => match self.samples.is_some() || self.seed.is_some() {
                true => {
                    refused("⟨samples⟩ and ⟨seed⟩ are those of paths, which only ⟨wrt=albedo⟩ traces", "leave them out")
                }
                false => Ok(()),
            },
            () if self.wrt.iter().any(|wrt| *wrt != Wrt::Albedo) => refused(
                "⟨wrt=albedo⟩ is estimated along paths, and the others along straight rays",
                "ask for one kind at a time",
            ),
            () if !matches!(self.loss, LossName::L2 | LossName::Mean) => refused(
                "of noisy pictures only the losses l2 and mean have derivatives without bias",
                "choose ⟨loss=l2⟩ or mean",
            ),
            () if self.target.is_none() => refused(
                "⟨wrt=albedo⟩ takes albedo and lights of the pictures of ⟨target⟩, and there is none",
                "render a capture with an albedo, and give it as ⟨target⟩",
            ),
            () if self.check => refused(
                "⟨check⟩: derivatives by the albedo are estimates, and have standard errors",
                "leave it out; more ⟨samples⟩ make the errors smaller",
            ),
            () if self.report.is_some() || !self.prior.is_empty() => {
                refused("⟨wrt=albedo⟩ has neither a page nor priors", "leave out ⟨report⟩ and ⟨prior⟩")
            }
            () if self.model.is_some()
                || self.quadrature != Quadrature::Exact
                || self.mode != Mode::Auto
                || self.adjoint.is_some() =>
            {
                refused(
                    "⟨model⟩, ⟨quadrature⟩, ⟨mode⟩ and ⟨adjoint⟩ are of straight rays, ⟨wrt=albedo⟩ of paths",
                    "leave them out",
                )
            }
            () => Ok(()),
        }
    }

    /// Estimates the derivatives by the albedo.
    ///
    /// # Errors
    /// If the volume or the target cannot be used, or the target records no albedo.
    pub(super) fn by_albedo(&self, context: &Context) -> Result<GradientReport> {
        let Lit { scene, capture, scattering } = self.lit()?;
        let at = |e: Error| e.at(&self.input);
        let samples = self.samples.unwrap_or(SAMPLES);
        let tracer = PathTracer::new(&scene).map_err(at)?.limits(scattering.limits());
        let tracer = tracer.background(self.background.unwrap_or(capture.background));
        let targets: Vec<Vec<Rgba>> = match self.loss().compares() {
            true => {
                let bar = context.steps(capture.frames.len() as u64, "reading pictures");
                let take = |photo: Photo| photo.film.rgba.iter().map(|p| p.map(f64::from)).collect();
                photos::each(&capture, None, self.limits, photos::WHOLE, &|| bar.inc(1), take)?
            }
            false => Vec::new(),
        };
        let (cancel, views) = (context.cancel(), scene.cameras.len());
        let stage = context.steps(views as u64 + 1, "derivatives");
        let mut value = 0.0;
        let mut by_pixel: [Vec<Vec<[f64; 3]>>; REPLICATES] = Default::default();
        for (view, camera) in scene.cameras.iter().enumerate() {
            // Of random numbers of their own: derivatives times values would be biased otherwise.
            let estimate = |number: u64| {
                let stream = (number + 101).wrapping_mul(0xD1B5_4A32_D192_ED03);
                let seed = self.seed.unwrap_or(0) ^ (view as u64) << 32 ^ stream;
                let sampling = Sampling::random(samples.div_ceil(REPLICATES as u32), seed);
                let film = film::render(&tracer, camera, sampling, &[], &cancel).ok_or_else(Error::cancelled)?.film;
                Ok(film.rgba.iter().map(|p| p.map(f64::from)).collect::<Vec<Rgba>>())
            };
            let pictures = (0..REPLICATES as u64).map(estimate).collect::<Result<Vec<_>>>()?;
            let target = targets.get(view).map(|target| &target[..]);
            let loss = |picture: &[Rgba]| self.loss().picture(picture, target, camera.width as usize);
            value += (loss(&mean(&pictures)).0 - noise(self.loss(), &pictures)) / views as f64;
            for (by_pixel, picture) in by_pixel.iter_mut().zip(&pictures) {
                let derivatives = loss(picture).1;
                by_pixel.push(derivatives.iter().map(|d| [d[0], d[1], d[2]].map(|d| d / views as f64)).collect());
            }
            stage.inc(1);
        }
        let paths = Paths { samples, seed: self.seed.unwrap_or(0), limits: scattering.limits() };
        drop(tracer);
        let values = values(&scene);
        let gradient = by_albedo(scene, &by_pixel, paths, &cancel).map_err(at)?;
        stage.inc(1);
        let rows = rows(values, &gradient);
        Ok(GradientReport {
            input: self.input.clone(),
            loss: self.loss.name().to_owned(),
            value,
            parameters: rows.len(),
            mode: "forward",
            adjoint: None,
            reason: format!("along {samples} paths a pixel, of which the standard errors tell the chance"),
            precision: "f32",
            quadrature: "paths".into(),
            views,
            up: None,
            rows,
            checked: None,
            worst_relative_error: None,
            warnings: Vec::new(),
            tolerance: None,
            output: None,
            report: None,
            seconds: 0.0,
            provenance: None,
        })
    }

    /// Reads the volume, and takes medium, lights and cameras of the target, whose pictures must fit in memory.
    fn lit(&self) -> Result<Lit> {
        let json = captures::file(self.target.as_deref().unwrap_or(&self.input));
        let capture = captures::load(&json)?;
        let bytes = capture.pixels().saturating_mul(BYTES);
        if bytes > self.limits.max_memory {
            return Err(Error::unsupported(format!("{} pixels do not fit in memory", capture.pixels()))
                .coded(Code::MemoryLimit)
                .hint("use fewer or smaller pictures, or raise ⟨max_memory⟩"));
        }
        let root = transforms::read_object(&json, self.limits)?;
        let record = match root.get("scattering") {
            Some(record) => ScatteringSettings::of_record(record).map_err(|e| e.at(&json))?,
            None => None,
        };
        let (scattering, own) = record.ok_or_else(|| {
            Error::invalid("the capture records no albedo and no lights of one volume")
                .at(&json)
                .hint("give one that `render` has made of the volume itself with ⟨render.albedo⟩")
        })?;
        if scattering.clamp.is_some() {
            return Err(Error::unsupported("the pictures were clamped, which derivatives do not know of")
                .at(&json)
                .hint("render them without ⟨render.clamp⟩"));
        }
        let from = (&self.scan, &self.transfer);
        let (grid, loaded) = volume::read_with_function(&self.input, self.grid.as_deref(), from, self.limits)?;
        let shown = capture.transfer.clone().map(|transfer| Function { transfer, albedo: own });
        let function = if self.transfer.tf.is_some() { loaded } else { shown.or(loaded) };
        let at = |e: Error| e.at(&self.input);
        let field = volume::arrange(&grid, function.as_ref().map(|f| &f.transfer), self.limits).map_err(at)?;
        let scale = self.density_scale.unwrap_or(capture.density_scale);
        if function.as_ref().is_some_and(|function| function.transfer.is_of_labels()) {
            return Err(not_differentiated().at(&self.input));
        }
        let emission = self.emission.unwrap_or(capture.emission);
        let source = match self.emission_model.unwrap_or(capture.emission_model) {
            EmissionModel::Linear => Source::Linear(emission),
            EmissionModel::Grey => Source::Grey(emission),
        };
        let medium = Medium::new(scale, source).chromatic(scattering.extinction_color())?;
        let medium = match &function {
            Some(function) => {
                let Colors { color, own, .. } = Colors::of(function, scattering.tf_color)?;
                medium.with_function(function.transfer.table()?, own, color)?
            }
            None => medium,
        };
        let medium = Medium { scattering: scattering.scattering(), ..medium };
        let cameras = capture.frames.iter().map(|frame| frame.camera).collect();
        let scene = Scene { volumes: vec![Volume::Density(field, medium)], cameras, ..Scene::default() };
        Ok(Lit { scene: scattering.light(scene, self.limits)?, capture, scattering })
    }
}

/// Returns the mean of pictures.
fn mean(pictures: &[Vec<Rgba>]) -> Vec<Rgba> {
    let share = 1.0 / pictures.len().max(1) as f64;
    let mut mean = vec![[0.0; 4]; pictures.first().map_or(0, Vec::len)];
    for picture in pictures {
        let sums = mean.iter_mut().flatten().zip(picture.iter().flatten());
        sums.for_each(|(sum, v): (&mut f64, &f64)| *sum += share * v);
    }
    mean
}

/// Returns what noise adds to a loss of the mean of independent pictures: the variance of its colors, for their
/// squares.
fn noise(loss: Loss, pictures: &[Vec<Rgba>]) -> f64 {
    if loss != Loss::L2 {
        return 0.0;
    }
    let mean = mean(pictures);
    let n = pictures.len() as f64;
    let square = |(a, b): (&Rgba, &Rgba)| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>();
    let sum: f64 = pictures.iter().flat_map(|picture| picture.iter().zip(&mean).map(square)).sum();
    sum / (n * (n - 1.0)) / (3 * mean.len()).max(1) as f64
}

/// Returns names and values of the albedo of the one volume of a scene, and of its color at each point.
fn values(scene: &Scene) -> Vec<(String, [f64; 3])> {
    let Some((_, medium)) = scene.volumes.first().and_then(Volume::density) else { return Vec::new() };
    let volume = medium.scattering.map_or([0.0; 3], |scattering| scattering.albedo.map(f64::from));
    let points = medium.albedo_function.as_ref().map(|function| function.points()).unwrap_or_default();
    let point = |(i, [_, color @ ..]): (usize, &[f64; 4])| (format!("albedo.point[{i}]"), *color);
    std::iter::once(("albedo".to_owned(), volume)).chain(points.iter().enumerate().map(point)).collect()
}

/// Returns the rows of the report.
fn rows(values: Vec<(String, [f64; 3])>, gradient: &AlbedoGradient) -> Vec<Row> {
    let estimates = std::iter::once(&gradient.medium).chain(&gradient.points);
    let of = |((name, value), estimates): ((String, [f64; 3]), &[Estimate; 3])| {
        [0, 1, 2].map(|c| Row {
            name: format!("{name}.{}", CHANNELS[c]),
            parameter: None,
            group: "albedo",
            value: value[c],
            gradient: estimates[c].value,
            standard_error: Some(estimates[c].error),
            difference: None,
            rounding: None,
            relative_error: None,
        })
    };
    values.into_iter().zip(estimates).flat_map(of).collect()
}
