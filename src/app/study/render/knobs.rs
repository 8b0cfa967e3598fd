//! The settings of pictures that are varied.

use super::subject::Subject;
use crate::app::pictures::PictureSettings;
use crate::error::{Error, Result};
use crate::render::quadrature::Quadrature;
use crate::text::listed;
use serde::{Deserialize, Serialize};

/// Setting of pictures that a study varies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Knob {
    /// Integration along straight rays.
    Quadrature,
    /// Step of the quadratures that have one, in voxels.
    Step,
    /// Transmittance at which straight rays end.
    EarlyStop,
    /// Straight rays along each edge of a pixel.
    Supersample,
    /// Paths per pixel.
    Samples,
    /// Most scatterings along a path.
    MaxBounces,
    /// Most radiance that is scattered to a path.
    Clamp,
}

/// Steps in voxels, and the one where steps are not varied.
const STEPS: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];
const STEP: f64 = 0.5;
/// Largest errors of pre-integration, in units of the brightest color.
const TOLERANCES: [f64; 3] = [1e-1, 1e-2, 1e-3];
/// Transmittances at which rays end.
const EARLY_STOPS: [f64; 3] = [1e-6, 1e-4, 1e-2];
/// Rays along each edge of a pixel.
const EDGES: [u32; 3] = [1, 2, 4];
/// Paths per pixel.
pub(super) const SAMPLES: [u32; 5] = [1, 4, 16, 64, 256];
/// Most scatterings along a path; none for any number.
const BOUNCES: [Option<u32>; 4] = [None, Some(16), Some(4), Some(1)];
/// Most radiance that is scattered to a path; none for any.
const CLAMPS: [Option<f64>; 3] = [None, Some(10.0), Some(1.0)];

impl Knob {
    /// Name of the setting.
    fn name(self) -> &'static str {
        match self {
            Self::Quadrature => "quadrature",
            Self::Step => "step",
            Self::EarlyStop => "early-stop",
            Self::Supersample => "supersample",
            Self::Samples => "samples",
            Self::MaxBounces => "max-bounces",
            Self::Clamp => "clamp",
        }
    }

    /// Returns the settings that pictures of a subject have, those that are varied by default first, and their number.
    fn of(subject: &Subject) -> (&'static [Self], usize) {
        match (subject.paths, subject.scatters, subject.pre_shaded) {
            // Rays of light that depends on the optical depth alone do not end early.
            _ if subject.by_depth => (&[Self::Quadrature, Self::Step, Self::Supersample, Self::EarlyStop], 3),
            (true, true, _) => (&[Self::Samples, Self::MaxBounces, Self::Clamp], 2),
            (true, false, _) => (&[Self::Samples], 1),
            (false, _, true) => (&[Self::EarlyStop, Self::Supersample], 2),
            (false, _, false) => (&[Self::Quadrature, Self::Step, Self::EarlyStop, Self::Supersample], 4),
        }
    }
}

/// Returns the settings that are varied: those that are asked for, or the usual ones of the subject.
///
/// # Errors
/// If one is asked for that pictures of the subject do not have.
pub(super) fn selected(asked: &[Knob], subject: &Subject) -> Result<Vec<Knob>> {
    let (known, usual) = Knob::of(subject);
    if asked.is_empty() {
        return Ok(known[..usual].to_vec());
    }
    match asked.iter().find(|knob| !known.contains(knob)) {
        Some(knob) => {
            let way = if subject.paths { "paths" } else { "straight rays" };
            let names: Vec<&str> = known.iter().map(|knob| knob.name()).collect();
            Err(Error::invalid(format!("⟨knobs={}⟩: pictures of these {way} do not depend on it", knob.name()))
                .hint(format!("vary some of {}", listed(&names, "and"))))
        }
        None => Ok(known.iter().copied().filter(|knob| asked.contains(knob)).collect()),
    }
}

/// A setting of pictures that is compared with others.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Variant {
    pub pictures: PictureSettings,
    /// Group of variants that it is one of.
    pub group: String,
}

/// Returns all combinations of the settings that are varied.
pub(super) fn variants(base: &PictureSettings, knobs: &[Knob], subject: &Subject) -> Vec<Variant> {
    let has = |knob| knobs.contains(&knob);
    let mut all = vec![base.clone()];
    if has(Knob::Quadrature) || has(Knob::Step) {
        let rules = quadratures(base, [has(Knob::Quadrature), has(Knob::Step)], subject.by_function);
        all = each(all, &rules, |pictures, rule| pictures.quadrature = Some(*rule));
    }
    if has(Knob::EarlyStop) {
        all = each(all, &EARLY_STOPS, |pictures, stop| pictures.early_stop = *stop);
    }
    if has(Knob::Supersample) {
        all = each(all, &EDGES, |pictures, edge| pictures.supersample = *edge);
    }
    if has(Knob::Samples) {
        all = each(all, &SAMPLES, |pictures, samples| pictures.scattering.samples = Some(*samples));
    }
    if has(Knob::MaxBounces) {
        all = each(all, &BOUNCES, |pictures, most| pictures.scattering.max_bounces = *most);
    }
    if has(Knob::Clamp) {
        all = each(all, &CLAMPS, |pictures, most| pictures.scattering.clamp = *most);
    }
    let group = |pictures: &PictureSettings| match (subject.paths, pictures.quadrature) {
        (true, _) => match pictures.scattering.max_bounces {
            Some(1) => "1 scattering at most".to_owned(),
            Some(most) => format!("{most} scatterings at most"),
            None => "any number of scatterings".to_owned(),
        },
        (false, Some(rule)) => rule.to_string().split(':').next().unwrap_or_default().to_owned(),
        (false, None) => "straight rays".to_owned(),
    };
    all.into_iter().map(|pictures| Variant { group: group(&pictures), pictures }).collect()
}

/// Returns the settings with each of the values in turn.
fn each<T>(all: Vec<PictureSettings>, values: &[T], set: impl Fn(&mut PictureSettings, &T)) -> Vec<PictureSettings> {
    let with = |pictures: &PictureSettings| {
        let one = |value: &T| {
            let mut pictures = pictures.clone();
            set(&mut pictures, value);
            pictures
        };
        values.iter().map(one).collect::<Vec<_>>()
    };
    all.iter().flat_map(with).collect()
}

/// Returns the quadratures of a study of rules, of steps, or of both. Without a transfer function pre-integration is
/// exact quadrature.
fn quadratures(base: &PictureSettings, [rules, steps]: [bool; 2], by_function: bool) -> Vec<Quadrature> {
    let steps = if steps { &STEPS[..] } else { &[STEP] };
    let of = |rule: fn(f64) -> Quadrature| steps.iter().map(move |step| rule(*step));
    if !rules {
        return match base.quadrature {
            Some(Quadrature::Riemann(_)) => of(Quadrature::Riemann).collect(),
            _ => of(Quadrature::Midpoint).collect(),
        };
    }
    let preintegrated = TOLERANCES.into_iter().filter(|_| by_function).map(Quadrature::Preintegrated);
    let exact = [Quadrature::Exact].into_iter().chain(preintegrated);
    exact.chain(of(Quadrature::Midpoint)).chain(of(Quadrature::Riemann)).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    const STRAIGHT: Subject =
        Subject { paths: false, scatters: false, pre_shaded: false, by_function: false, by_depth: false };

    #[test]
    fn all_combinations_are_there() {
        let base = PictureSettings::default();
        let knobs = selected(&[], &STRAIGHT).unwrap();
        // Exact, and two rules of five steps, each with three transmittances and three supersamplings.
        assert_eq!(variants(&base, &knobs, &STRAIGHT).len(), (1 + 2 * 5) * 3 * 3);
        let grey = Subject { by_depth: true, ..STRAIGHT };
        assert_eq!(variants(&base, &selected(&[], &grey).unwrap(), &grey).len(), (1 + 2 * 5) * 3);
        let groups = variants(&base, &[Knob::Quadrature], &Subject { by_function: true, ..STRAIGHT });
        let names: Vec<&str> = groups.iter().map(|v| v.group.as_str()).collect();
        assert_eq!(names, ["exact", "preintegrated", "preintegrated", "preintegrated", "midpoint", "riemann"]);
        assert_eq!(variants(&base, &[Knob::Step], &STRAIGHT).len(), 5);
    }

    #[test]
    fn settings_that_have_no_effect_are_refused() {
        let error = selected(&[Knob::Samples], &STRAIGHT).unwrap_err().to_string();
        assert!(error.contains("knobs=samples") && error.contains("early-stop"), "{error}");
        let paths = Subject { paths: true, scatters: true, ..STRAIGHT };
        assert_eq!(selected(&[], &paths).unwrap(), [Knob::Samples, Knob::MaxBounces]);
        assert!(selected(&[Knob::Quadrature], &paths).is_err());
    }
}
