//! Error against time of pictures: quadratures, steps, early stops and rays, or paths and scatterings.

mod cost;
mod knobs;
mod reference;
mod subject;

pub use knobs::Knob;

use super::candidate::Candidate;
use super::errors::Errors;
use super::options::StudyOptions;
use super::page::{self, Gallery};
use super::report::StudyReport;
use super::run::Run;
use super::session::Session;
use super::words;
use crate::app::Context;
use crate::app::inputs;
use crate::app::pictures::PictureSettings;
use crate::app::use_case::use_case;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::formats::exr;
use crate::scene::camera::Camera;
use cost::Cost;
use knobs::Variant;
use reference::Pictures;
use serde::{Deserialize, Serialize};
use serde_json::json;
use subject::Prepared;

/// Settings of a study of pictures.
///
/// All combinations of the settings that are varied are rendered, of one frame. The reference is exact quadrature
/// without early stop and with many rays a pixel, or many paths by independent seeds.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RenderStudySettings {
    /// Settings that all studies have.
    #[serde(flatten)]
    pub study: StudyOptions,
    /// Settings that are varied; none for the usual ones: quadrature, step, early stop and supersampling of straight
    /// rays, samples and bounces of paths.
    pub knobs: Vec<Knob>,
    /// Frame of a sequence; none for the first.
    pub frame: Option<u32>,
    /// Subject, cameras, media and light of the pictures. Without a size, pictures are as large as the time allows, 256
    /// pixels wide at most.
    #[serde(flatten)]
    pub pictures: PictureSettings,
}

use_case!(RenderStudySettings => StudyReport, pictures.limits);

impl RenderStudySettings {
    /// Reads, renders the reference, measures and writes the page.
    ///
    /// # Errors
    /// If the scene cannot be used, a setting is to be varied that its pictures do not have, or the page cannot be
    /// written.
    pub fn run(&self, context: &Context) -> Result<StudyReport> {
        let _inputs = inputs::protect(self.pictures.inputs(), self.pictures.limits);
        self.pictures.check()?;
        let cancel = context.cancel();
        let mut session = Session::begin("render", &self.pictures.input, &self.study, self, context)?;
        let prepared = self.prepare(&mut session.provenance, context)?;
        session.check_inputs()?;
        let knobs = knobs::selected(&self.knobs, &prepared.subject)?;
        let variants = knobs::variants(&prepared.pictures, &knobs, &prepared.subject);
        let cost = match session.is_complete() {
            true => Cost::default(),
            false => {
                let _stage = context.stage("timing small pictures");
                Cost::find(&prepared, &variants, &knobs, &cancel)?.ok_or_else(Error::cancelled)?
            }
        };
        let cameras = self.cameras(&prepared, cost, &session);
        let pixels = cost::pixels(&cameras);
        let reference = {
            if session.earlier.is_none() {
                context.note(format!("reference: about {:.0} s", (cost.reference * pixels).ceil()));
            }
            let _stage = context.stage("reference");
            self.reference(&prepared, &knobs, &cameras, &session, &cancel)?.ok_or_else(Error::cancelled)?
        };
        let candidates: Vec<_> =
            variants.iter().map(|variant| self.candidate(variant, &knobs, &prepared, &cameras, &reference)).collect();
        let size = cameras.first().map(|camera| [camera.width, camera.height]);
        let report = session.measure(&candidates, reference.reference.clone(), size, cost.round * pixels)?;
        drop(candidates);
        let gallery = self.gallery(&report, &variants, &prepared, &cameras, reference, &context.closing())?;
        session.finish(report, gallery.as_ref())
    }

    /// Returns the cameras of the pictures that are measured: those of an earlier run, of the size that is stated, or
    /// of one that the time allows.
    fn cameras(&self, prepared: &Prepared, cost: Cost, session: &Session<'_>) -> Vec<Camera> {
        let all = &prepared.scene.cameras;
        let earlier = session.earlier.as_ref().and_then(|earlier| earlier.size).zip(all.first());
        match earlier {
            Some(([width, _], first)) => prepared.cameras(f64::from(width) / f64::from(first.width)),
            None if self.pictures.size.is_some() => all.clone(),
            None => prepared.cameras(cost.share(self.study.budget, all)),
        }
    }

    /// Reads the reference that an earlier run has left, or renders it and writes it; `None` if it was stopped.
    fn reference(
        &self,
        prepared: &Prepared,
        knobs: &[Knob],
        cameras: &[Camera],
        session: &Session<'_>,
        cancel: &Cancel,
    ) -> Result<Option<Pictures>> {
        let paths = (0..cameras.len()).map(|view| session.reference(view));
        if let Some(earlier) = &session.earlier {
            let films = paths.map(|path| exr::read_film_within(&path, None, self.pictures.limits));
            let films = films.collect::<Result<Vec<_>>>()?;
            return reference::resumed(films, earlier.reference.clone(), cameras).map(Some);
        }
        let rendered = reference::render(prepared, knobs, cameras, cancel)?;
        if let Some(pictures) = &rendered {
            for (film, path) in pictures.films.iter().zip(paths) {
                exr::write_picture(&path, film, &session.provenance.attributes(), exr::Half::None)?;
            }
        }
        Ok(rendered)
    }

    /// Returns a variant as a candidate.
    fn candidate<'w>(
        &self,
        variant: &'w Variant,
        knobs: &[Knob],
        prepared: &'w Prepared,
        cameras: &'w [Camera],
        reference: &'w Pictures,
    ) -> Candidate<'w> {
        let Variant { pictures, group } = variant;
        let first = pictures.scattering.seed.unwrap_or(0);
        let run = move |repeat: u32, cancel: &Cancel| {
            let mut own = pictures.clone();
            if prepared.subject.scatters {
                own.scattering.seed = Some(first.wrapping_add(repeat.into()));
            }
            let films = prepared.films(&own, cameras, None, cancel)?;
            let run = |(films, seconds): (Vec<_>, f64)| Run {
                seconds,
                errors: Errors::of_films(&films, &reference.films, reference.scale),
            };
            Ok(films.map(run))
        };
        Candidate {
            options: options(pictures, knobs),
            group: group.clone(),
            command: self.command(pictures, prepared),
            random: prepared.subject.scatters,
            run: Box::new(run),
        }
    }

    /// Returns the command that renders the pictures by these settings, of the size that was asked for.
    fn command(&self, pictures: &PictureSettings, prepared: &Prepared) -> String {
        let input = self.pictures.input.to_string_lossy();
        let mut words = vec!["cumulo render".to_owned(), crate::text::shell_quoted(&input).into_owned()];
        words.extend(words::stated(pictures, &PictureSettings::default(), &["input"]));
        words.extend(pictures.frame.and_then(|frame| words::option("frames", &json!(frame.to_string()))));
        let output = if prepared.numbers.len() == 1 { "picture.exr" } else { "pictures" };
        words.extend(words::option("output", &json!(output)));
        words.join(" ")
    }

    /// Renders the pictures that the page shows, of the first view; none if it was stopped.
    fn gallery(
        &self,
        report: &StudyReport,
        variants: &[Variant],
        prepared: &Prepared,
        cameras: &[Camera],
        mut reference: Pictures,
        cancel: &Cancel,
    ) -> Result<Option<Gallery>> {
        let mut films = Vec::new();
        for number in page::pictured(report) {
            let Some((all, _)) = prepared.films(&variants[number].pictures, &cameras[..1], None, cancel)? else {
                break;
            };
            films.extend(all.into_iter().next().map(|film| (number, film)));
        }
        Ok(Some(Gallery { reference: reference.films.swap_remove(0), films }))
    }
}

/// Returns the options of a variant, those that are not varied left out.
fn options(pictures: &PictureSettings, knobs: &[Knob]) -> String {
    let scattering = &pictures.scattering;
    let of = |knob: &Knob| match knob {
        Knob::Quadrature => words::option("quadrature", &json!(pictures.quadrature)),
        Knob::Step if !knobs.contains(&Knob::Quadrature) => words::option("quadrature", &json!(pictures.quadrature)),
        Knob::Step => None,
        Knob::EarlyStop => words::option("early_stop", &json!(pictures.early_stop)),
        Knob::Supersample => words::option("supersample", &json!(pictures.supersample)),
        Knob::Samples => words::option("samples", &json!(scattering.samples)),
        Knob::MaxBounces => words::option("max_bounces", &json!(scattering.max_bounces)),
        Knob::Clamp => words::option("clamp", &json!(scattering.clamp)),
    };
    knobs.iter().filter_map(of).collect::<Vec<_>>().join(" ")
}
