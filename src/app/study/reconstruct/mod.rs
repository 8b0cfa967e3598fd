//! Error against time of reconstructions of densities: views, resolutions, solvers, iterations and noise.

mod captures;
mod knobs;

pub use knobs::ReconstructKnob;

use super::candidate::Candidate;
use super::errors::{Errors, scale};
use super::noise;
use super::options::StudyOptions;
use super::page::{self, Gallery};
use super::reference::Reference;
use super::report::StudyReport;
use super::run::Run;
use super::session::Session;
use super::words;
use crate::app::Context;
use crate::app::inputs;
use crate::app::pictures::PictureSettings;
use crate::app::reconstruct::{DensitySettings, RegionSettings};
use crate::app::render::RenderSettings;
use crate::app::run::rays_per_edge;
use crate::app::use_case::use_case;
use crate::cancel::Cancel;
use crate::error::{Error, Kind, Result};
use crate::formats::limits::Limits;
use crate::formats::transforms::{self, FILE_NAME};
use crate::formats::{captures as files, exr};
use crate::render::quadrature::Quadrature;
use crate::scene::capture::Frame;
use crate::scene::film::Film;
use crate::text::shell_quoted;
use captures::Views;
use knobs::{RESOLUTIONS, Variant};
use serde::{Deserialize, Serialize};
use serde_json::{Map, json};
use std::path::PathBuf;
use std::time::Instant;

/// Settings of a study of reconstructions of densities.
///
/// Some views are kept apart, one of eight or more of few: errors are those of their pictures beside renders of the
/// volume that the others tell.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ReconstructStudySettings {
    /// Settings that all studies have.
    #[serde(flatten)]
    pub study: StudyOptions,
    /// transforms.json of the pictures, a model of COLMAP, or the folder of either.
    #[serde(with = "crate::app::paths")]
    pub capture: PathBuf,
    /// Settings that are varied; none for views, resolution and iterations.
    pub knobs: Vec<ReconstructKnob>,
    /// Voxels along the longest edge of the region where the resolution is not varied; none for the most of a ladder
    /// that the time allows.
    pub resolution: Option<u32>,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

use_case!(ReconstructStudySettings => StudyReport, limits);

/// Share of the time that one round of runs is planned to take.
const PLANNED: f64 = 0.4;
/// Share of the time that fewer iterations than the usual ones take.
const FEWER: f64 = 0.5;

/// Reconstructs and renders in a folder of its own.
struct Workshop<'w> {
    folder: tempfile::TempDir,
    views: &'w Views,
    context: &'w Context,
}

impl ReconstructStudySettings {
    /// Reads, reconstructs, measures and writes the page.
    ///
    /// # Errors
    /// If the pictures cannot be read or used, or the page cannot be written.
    pub fn run(&self, context: &Context) -> Result<StudyReport> {
        let _inputs = inputs::protect([self.capture.as_path()], self.limits);
        let mut session = Session::begin("reconstruct", &self.capture, &self.study, self, context)?;
        let views = {
            let _stage = context.stage("reading pictures");
            Views::read(&self.capture, &self.study.output, self.limits)?
        };
        let pictures = views.tests.frames.iter().chain(&views.fitted.frames).map(|frame| frame.picture.clone());
        let all: Vec<PathBuf> = files::files(&files::file(&self.capture)).into_iter().chain(pictures).collect();
        session.provenance.files(all.iter().map(PathBuf::as_path))?;
        session.check_inputs()?;
        let folder = tempfile::tempdir().map_err(|e| Error::io(std::env::temp_dir(), e))?;
        let workshop = Workshop { folder, views: &views, context };
        let region = RegionSettings { resolution: self.resolution, ..RegionSettings::default() };
        let base = DensitySettings { region, limits: self.limits, ..DensitySettings::default() };
        let (finest, round) = self.affordable(&base, &workshop, &session)?;
        let variants = knobs::variants(&base, &self.knobs, views.fitted.frames.len(), finest);
        views.write(&variants)?;
        let (reference, scale) = reference(&views)?;
        let candidates: Vec<_> = variants.iter().map(|v| candidate(v, &workshop, scale)).collect();
        let size = views.films.first().map(|film| [film.width as u32, film.height as u32]);
        let report = session.measure(&candidates, reference, size, round)?;
        drop(candidates);
        let gallery = gallery(&report, &variants, &workshop)?;
        session.finish(report, Some(&gallery))
    }

    /// Returns the highest resolution that the time allows, with the seconds that a round of runs takes: by a
    /// reconstruction of the lowest one, whose time grows about with the square of the edge. An earlier run has chosen
    /// already.
    fn affordable(&self, base: &DensitySettings, workshop: &Workshop<'_>, session: &Session<'_>) -> Result<(u32, f64)> {
        let most = workshop.views.fitted.frames.len();
        if let Some(earlier) = &session.earlier {
            let reached = |resolution: &u32| {
                let variants = knobs::variants(base, &self.knobs, most, *resolution);
                variants.len() == earlier.measurements.len()
                    && variants.iter().all(|v| earlier.measurements.iter().any(|m| m.options == options(v)))
            };
            return Ok((RESOLUTIONS.into_iter().rev().find(reached).unwrap_or(RESOLUTIONS[0]), 0.0));
        }
        let _stage = workshop.context.stage("timing a coarse reconstruction");
        let pilot = knobs::variants(base, &[], most, RESOLUTIONS[0]).swap_remove(0);
        workshop.views.write(std::slice::from_ref(&pilot))?;
        let begun = Instant::now();
        workshop.films(&pilot)?;
        let each = begun.elapsed().as_secs_f64();
        let seconds = |finest: u32| -> f64 {
            let of = |v: &Variant| {
                let share = v.views as f64 / most as f64 * if v.settings.iterations.is_some() { FEWER } else { 1.0 };
                let edge = f64::from(v.settings.region.resolution.unwrap_or(finest)) / f64::from(RESOLUTIONS[0]);
                share * each * edge.powi(2).max(1.0)
            };
            knobs::variants(base, &self.knobs, most, finest).iter().map(of).sum()
        };
        let budget = PLANNED * self.study.budget;
        let finest = RESOLUTIONS.into_iter().rev().find(|resolution| seconds(*resolution) <= budget);
        let finest = finest.unwrap_or(RESOLUTIONS[0]);
        Ok((finest, seconds(finest)))
    }
}

/// Returns what is known of the pictures that are kept apart, and their root mean square.
fn reference(views: &Views) -> Result<(Reference, f64)> {
    let scale = scale(&views.films)?;
    let limits = Limits::default();
    let exact = |frame: &Frame| exr::read_film_within(&frame.picture, None, limits).ok();
    let variances: Vec<f64> =
        views.tests.frames.iter().filter_map(exact).filter_map(|film| noise::variance(&film)).collect();
    let known = variances.len() == views.films.len();
    let mean = variances.iter().sum::<f64>() / variances.len().max(1) as f64;
    let reference = Reference {
        options: format!("{} views that no reconstruction is fitted to", views.films.len()),
        method: match known {
            true => "noise of these pictures by their own layers".to_owned(),
            false => "the pictures have no layer of their variance".to_owned(),
        },
        uncertainty: if known { mean.sqrt() / scale } else { 0.0 },
        random: known,
        seconds: 0.0,
    };
    Ok((reference, scale))
}

impl Workshop<'_> {
    /// Reconstructs a volume, and returns renders of it by the cameras of the views that are kept apart, with the
    /// seconds that the reconstruction took.
    ///
    /// # Errors
    /// Those of the reconstruction and of rendering.
    fn films(&self, variant: &Variant) -> Result<(Vec<Film>, f64)> {
        let silent = self.context.silent();
        // Files that were read are protected: none may take their place.
        let folder = tempfile::tempdir_in(self.folder.path()).map_err(|e| Error::io(self.folder.path(), e))?;
        let [volume, tests] = ["found.vdb", FILE_NAME].map(|name| folder.path().join(name));
        let (capture, output) = (self.views.path(variant), volume.clone());
        let begun = Instant::now();
        let run = DensitySettings { capture, output, ..variant.settings.clone() }.run(&silent)?;
        let seconds = begun.elapsed().as_secs_f64();
        if run.stopped {
            return Err(Error::cancelled());
        }
        transforms::save(&tests, &self.views.tests, &Map::new())?;
        let output = folder.path().join("renders");
        let pictures = PictureSettings {
            input: volume,
            cameras: Some(tests),
            quadrature: Some(Quadrature::Exact),
            supersample: rays_per_edge(self.views.tests.pixel_filter) as u32,
            limits: variant.settings.limits,
            ..PictureSettings::default()
        };
        RenderSettings { output: output.clone(), pictures, ..RenderSettings::default() }.run(&silent)?;
        let film = |view: usize| {
            let path = output.join(format!("view_{view:03}.exr"));
            exr::read_picture_within(&path, None, variant.settings.limits)
        };
        Ok(((0..self.views.films.len()).map(film).collect::<Result<Vec<_>>>()?, seconds))
    }
}

/// Returns the options of a variant, with the capture that it is found from.
fn options(variant: &Variant) -> String {
    let settings = &variant.settings;
    let words = [
        Some(variant.capture()),
        words::option("resolution", &json!(settings.region.resolution)),
        words::option("solver", &json!(settings.solver))
            .filter(|_| settings.solver != DensitySettings::default().solver),
        words::option("iterations", &json!(settings.iterations)),
    ];
    words.into_iter().flatten().collect::<Vec<_>>().join(" ")
}

/// Returns a variant as a candidate.
fn candidate<'w>(variant: &'w Variant, workshop: &'w Workshop<'_>, scale: f64) -> Candidate<'w> {
    let run = move |_: u32, _: &Cancel| match workshop.films(variant) {
        Ok((films, seconds)) => {
            Ok(Some(Run { seconds, errors: Errors::of_films(&films, &workshop.views.films, scale) }))
        }
        Err(error) if error.kind() == Kind::Cancelled => Ok(None),
        Err(error) => Err(error),
    };
    let capture = workshop.views.path(variant);
    let mut command =
        vec!["cumulo reconstruct density".to_owned(), shell_quoted(&capture.to_string_lossy()).into_owned()];
    command.extend(words::stated(&variant.settings, &DensitySettings::default(), &[]));
    command.extend(words::option("output", &json!("found.vdb")));
    let noise = if variant.noise > 0.0 { format!(", noise {}", variant.noise) } else { String::new() };
    Candidate {
        options: options(variant),
        group: format!("{} views{noise}", variant.views),
        command: command.join(" "),
        random: false,
        run: Box::new(run),
    }
}

/// Renders the pictures that the page shows, of the first view that is kept apart; fewer of them if it was stopped.
fn gallery(report: &StudyReport, variants: &[Variant], workshop: &Workshop<'_>) -> Result<Gallery> {
    let mut films = Vec::new();
    for number in page::pictured(report).into_iter().filter(|_| report.complete) {
        match workshop.films(&variants[number]) {
            Ok((mut all, _)) => films.push((number, all.swap_remove(0))),
            Err(error) if error.kind() == Kind::Cancelled => break,
            Err(error) => return Err(error),
        }
    }
    Ok(Gallery { reference: workshop.views.films[0].clone(), films })
}
