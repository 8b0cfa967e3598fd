//! Error against time of derivatives: adjoints, precisions, quadratures and steps against double precision.

mod knobs;

pub use knobs::GradientKnob;

use super::candidate::Candidate;
use super::errors::Errors;
use super::options::StudyOptions;
use super::reference::Reference;
use super::report::StudyReport;
use super::rounds::USUAL_ROUNDS;
use super::run::Run;
use super::session::Session;
use super::words;
use crate::app::Context;
use crate::app::gradient::scene::in_double;
use crate::app::gradient::{GradientSettings, Wrt};
use crate::app::inputs;
use crate::app::use_case::use_case;
use crate::app::volume;
use crate::cancel::Cancel;
use crate::differentiate::study::subject::Subject;
use crate::differentiate::study::{Study, StudyGradient};
use crate::error::{Error, Result};
use crate::formats::captures;
use crate::render::differentiable::Adjoint;
use crate::render::quadrature::Quadrature;
use crate::scene::volume::Grids;
use crate::text::shell_quoted;
use knobs::Variant;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

/// Settings of a study of derivatives.
///
/// Derivatives of one kind are compared with those of exact quadrature in double precision without early stop.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct GradientStudySettings {
    /// Settings that all studies have.
    #[serde(flatten)]
    pub study: StudyOptions,
    /// Settings that are varied; none for all.
    pub knobs: Vec<GradientKnob>,
    /// Width and height in pixels of the pictures of cameras that are placed; none for 64 x 64, or less where the time
    /// asks for it.
    pub size: Option<[u32; 2]>,
    /// Scene, loss and parameters of one kind; its size and where its outputs go are not used.
    pub gradient: GradientSettings,
}

use_case!(GradientStudySettings => StudyReport, gradient.limits);

/// Share of the time that the usual rounds of runs are planned to take.
const PLANNED: f64 = 0.6;
/// Times that a run in double precision takes, in those of single precision.
const DOUBLE: f64 = 4.0;
/// Smallest relative uncertainty that is stated of double precision, whose pieces of cells err by 1e-11.
const ROUNDING: f64 = 1e-9;

impl GradientStudySettings {
    /// Reads, differentiates, measures and writes the page.
    ///
    /// # Errors
    /// If the scene cannot be used, the derivatives are zero, or the page cannot be written.
    pub fn run(&self, context: &Context) -> Result<StudyReport> {
        let _inputs = inputs::protect(self.gradient.inputs(), self.gradient.limits);
        if self.gradient.wrt.contains(&Wrt::Albedo) {
            return Err(Error::unsupported("⟨wrt=albedo⟩ is estimated with standard errors, and has no study")
                .hint("`cumulo gradient` states them; choose another ⟨wrt⟩"));
        }
        let [_] = &self.gradient.wrt[..] else {
            return Err(Error::invalid("⟨wrt⟩: derivatives of one kind have errors in one unit")
                .hint("give one kind: ⟨wrt=density⟩"));
        };
        let mut base = self.gradient.clone();
        base.size = self.size.unwrap_or(base.size);
        if base.target.is_none() {
            base.views.get_or_insert(1);
        }
        base.fits_together()?;
        let mut session = Session::begin("gradient", &self.gradient.input, &self.study, self, context)?;
        let (grids, setup) = {
            let _stage = context.stage("reading the volume");
            base.scene()?
        };
        setup.up.iter().for_each(|up| context.note(up));
        let target = base.target.as_deref().map(captures::file);
        let files = volume::files(&base.input, &base.scan, base.limits);
        let others = [target.as_deref(), base.transfer.file()].into_iter().flatten();
        session.provenance.files(files.iter().map(PathBuf::as_path).chain(others))?;
        session.check_inputs()?;
        match grids {
            Grids::Density(field) => self.measure(base.study(field, setup, context)?.0, &base, false, session, context),
            Grids::EmissionExtinction(field) => {
                self.measure(base.study(field, setup, context)?.0, &base, true, session, context)
            }
        }
    }

    fn measure<V: Subject>(
        &self,
        mut study: Study<V>,
        base: &GradientSettings,
        shaded: bool,
        session: Session<'_>,
        context: &Context,
    ) -> Result<StudyReport> {
        let variants = knobs::variants(base, &self.knobs, shaded);
        let round = self.resize(&mut study, base, &variants, &session)?;
        let size = study.setting.cameras.first().map(|camera| [camera.width, camera.height]);
        let cancel = context.cancel();
        let double = in_double(study.clone());
        let stage = context.stage("reference");
        let begun = Instant::now();
        let exact = |adjoint| {
            let quadrature = if shaded { base.quadrature } else { Quadrature::Exact };
            let settings = GradientSettings { quadrature, adjoint: Some(adjoint), ..base.clone() };
            derivatives(&settings, &double).map(|(all, _)| all)
        };
        let (truth, other) = (exact(Adjoint::Tape)?, exact(Adjoint::Replay)?);
        drop(stage);
        if cancel.requested() {
            return Err(Error::cancelled());
        }
        let scale = (truth.iter().map(|d| d * d).sum::<f64>() / truth.len().max(1) as f64).sqrt();
        if scale == 0.0 || !scale.is_finite() {
            return Err(Error::invalid("the derivatives are zero: errors have no scale")
                .at(&base.input)
                .hint("choose another ⟨wrt⟩ or ⟨loss⟩, or check ⟨density_scale⟩"));
        }
        let quadrature = words::option("quadrature", &json!(if shaded { base.quadrature } else { Quadrature::Exact }));
        let reference = Reference {
            options: format!("{}, double precision without early stop", quadrature.unwrap_or_default()),
            method: "difference of tape and replay, and the 1e-11 allowed to each piece of a cell".into(),
            uncertainty: errors(&other, &truth, scale).rms.max(ROUNDING),
            random: false,
            seconds: begun.elapsed().as_secs_f64(),
        };
        let candidates: Vec<_> = variants.iter().map(|v| self.candidate(v, &study, &double, (&truth, scale))).collect();
        let report = session.measure(&candidates, reference, size, round)?;
        drop(candidates);
        session.finish(report, None)
    }

    /// Makes pictures smaller where the time asks for it, or as large as in an earlier run, and returns the seconds
    /// that a round of runs takes.
    fn resize<V: Subject>(
        &self,
        study: &mut Study<V>,
        base: &GradientSettings,
        variants: &[Variant],
        session: &Session<'_>,
    ) -> Result<f64> {
        if let Some([width, _]) = session.earlier.as_ref().and_then(|earlier| earlier.size) {
            if base.target.is_none() {
                let share = f64::from(width) / f64::from(base.size[0]);
                resized(study, share);
            }
            return Ok(0.0);
        }
        // The first run may find caches cold.
        derivatives(base, study)?;
        let (_, each) = derivatives(base, study)?;
        let round: f64 = variants.iter().map(|variant| if variant.double { DOUBLE * each } else { each }).sum();
        let share = (PLANNED * self.study.budget / (f64::from(USUAL_ROUNDS) * round)).sqrt().min(1.0);
        if self.size.is_some() || base.target.is_some() || share == 1.0 {
            return Ok(round);
        }
        resized(study, share);
        Ok(share * share * round)
    }

    /// Returns a variant as a candidate.
    fn candidate<'w, V: Subject>(
        &self,
        variant: &'w Variant,
        single: &'w Study<V>,
        double: &'w Study<V::Double>,
        (truth, scale): (&'w [f64], f64),
    ) -> Candidate<'w> {
        let Variant { settings, double: is_double } = variant;
        let run = move |_: u32, _: &Cancel| {
            let (found, seconds) = match is_double {
                true => derivatives(settings, double)?,
                false => derivatives(settings, single)?,
            };
            Ok(Some(Run { seconds, errors: errors(&found, truth, scale) }))
        };
        let own = [("quadrature", json!(settings.quadrature)), ("adjoint", json!(settings.adjoint))];
        let own = own.iter().filter_map(|(name, value)| words::option(name, value)).collect::<Vec<_>>().join(" ");
        // Double precision is that of the check.
        let check = is_double.then(|| words::option("check", &json!(true))).flatten();
        let input = self.gradient.input.to_string_lossy();
        let mut command = vec!["cumulo gradient".to_owned(), shell_quoted(&input).into_owned()];
        command.extend(words::stated(settings, &GradientSettings::default(), &["input"]));
        command.extend(check.clone());
        if matches!(settings.wrt[..], [Wrt::Density | Wrt::Emission]) {
            command.extend(words::option("output", &json!("derivatives.vdb")));
        }
        let rule = settings.quadrature.to_string();
        let precision = if *is_double { "double" } else { "single" };
        Candidate {
            options: [Some(own), check].into_iter().flatten().collect::<Vec<_>>().join(" "),
            group: format!("{}, {precision}", rule.split(':').next().unwrap_or_default()),
            command: command.join(" "),
            random: false,
            run: Box::new(run),
        }
    }
}

/// Multiplies the edges of the pictures of a study.
fn resized<V: Subject>(study: &mut Study<V>, share: f64) {
    for camera in &mut study.setting.cameras {
        *camera = camera.resized([camera.width, camera.height].map(|n| (f64::from(n) * share).round().max(8.0) as u32));
    }
}

/// Returns the derivatives by these settings, and the seconds that they took.
fn derivatives<V: Subject>(settings: &GradientSettings, study: &Study<V>) -> Result<(Vec<f64>, f64)> {
    let mut study = study.clone();
    study.setting.quadrature = settings.quadrature;
    let begun = Instant::now();
    let StudyGradient { derivatives, by_voxel, .. } = settings.gradient(&study)?;
    let seconds = begun.elapsed().as_secs_f64();
    Ok((derivatives.into_iter().chain(by_voxel).collect(), seconds))
}

/// Returns the errors of derivatives in units of their root mean square.
fn errors(found: &[f64], truth: &[f64], scale: f64) -> Errors {
    let apart: Vec<f64> = found.iter().zip(truth).map(|(a, b)| (a - b).abs() / scale).collect();
    Errors::of(apart.iter().map(|d| d * d).sum(), apart.len(), apart)
}
