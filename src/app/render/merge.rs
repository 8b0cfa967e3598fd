//! Pictures of the same scene joined: replicates that were rendered apart, as if one machine had rendered all, and the
//! samples of deep pictures.

use super::accuracy::{AccuracyReport, AccuracySettings, Known, Made, Measured, Read, SCENE};
use crate::app::Context;
use crate::app::earlier::{Keys, Policy};
use crate::app::inputs;
use crate::app::outputs::{self, Content};
use crate::app::pictured;
use crate::app::provenance::Provenance;
use crate::app::ranges;
use crate::app::use_case::{Report, Status, use_case};
use crate::error::{Error, Result};
use crate::formats::exr::{self, Placement, deep};
use crate::formats::limits::Limits;
use crate::formats::protected;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Settings of the joining of pictures.
///
/// Pictures are parts of one another: of the same scene, view and size, path-traced, with random numbers of their own.
/// They are parts that [`AccuracySettings::replicates`] asked for, pictures of a wanted error or time with the plane
/// [`Aov::Replicates`](crate::render::film::Aov::Replicates), pictures of different seeds, or such ones joined.
///
/// Deep pictures become one with the samples of all: parts of a picture, or several elements of a shot.
///
/// ```
/// use cumulo::prelude::*;
/// # let folder = tempfile::tempdir()?;
/// let part = |first, last| -> Result<std::path::PathBuf> {
///     let output = folder.path().join(format!("{first}.exr"));
///     let scattering = ScatteringSettings { albedo: Some([0.9; 3]), samples: Some(1), ..Default::default() };
///     let pictures = PictureSettings {
///         input: "fixtures/plume.vdb".into(),
///         views: Some(1),
///         size: Some([16, 16]),
///         scattering,
///         ..PictureSettings::default()
///     };
///     let accuracy = AccuracySettings { replicates: Some([first, last]), ..AccuracySettings::default() };
///     let settings = RenderSettings { output: output.clone(), accuracy, pictures, ..RenderSettings::default() };
///     settings.run(&Context::default())?;
///     Ok(output)
/// };
/// let output = folder.path().join("joined.exr");
/// let settings = MergeSettings { inputs: vec![part(0, 7)?, part(8, 15)?], output, ..MergeSettings::default() };
/// println!("{}", settings.run(&Context::default())?);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MergeSettings {
    /// Pictures, OpenEXR.
    #[serde(with = "crate::app::paths")]
    pub inputs: Vec<PathBuf>,
    /// OpenEXR of the joined picture.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// True to replace the output, whoever made it.
    pub overwrite: bool,
    /// Largest error of a block that the picture is to have, above 0: the report says how many replicates are missing.
    pub target_error: Option<f64>,
    /// Probability with which a stated interval holds the truth, between 0 and 1.
    pub confidence: f64,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

impl Default for MergeSettings {
    fn default() -> Self {
        Self {
            inputs: Vec::new(),
            output: PathBuf::new(),
            overwrite: false,
            target_error: None,
            confidence: AccuracySettings::default().confidence,
            limits: Limits::default(),
        }
    }
}

/// Report of a joined picture.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct MergeReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    /// Pictures that were joined.
    pictures: usize,
    /// Numbers of the joined replicates, by the seed of their random numbers; null for deep pictures.
    replicates: Option<String>,
    /// Number of samples of a deep picture; null for flat ones.
    samples: Option<u64>,
    accuracy: Option<AccuracyReport>,
    /// Numbers of further replicates that the wanted error is expected to take, by the seed of their random numbers;
    /// null where it is reached, or none is wanted.
    missing: Option<String>,
    seconds: f64,
}

impl fmt::Display for MergeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { output, pictures, replicates, samples, accuracy, missing, seconds } = self;
        let s = if *pictures == 1 { "" } else { "s" };
        write!(f, "{}: {pictures} picture{s} joined in {seconds:.2} s", output.display())?;
        replicates.iter().try_for_each(|replicates| write!(f, ", replicates of {replicates}"))?;
        samples.iter().try_for_each(|samples| write!(f, ", {samples} deep samples"))?;
        accuracy.iter().try_for_each(|accuracy| write!(f, "\n{accuracy}"))?;
        missing
            .iter()
            .try_for_each(|missing| write!(f, "\n  the wanted error is expected to take more replicates, of {missing}"))
    }
}

use_case!(MergeSettings => MergeReport, limits);

impl Report for MergeReport {
    /// A picture that has not the wanted error is a finding.
    fn status(&self) -> Result<Status> {
        Ok(Status::of_check(true, self.missing.is_some()))
    }
}

/// Settings of the joining on which the picture does not depend.
const MANNER: [&str; 2] = ["overwrite", "max_memory"];

impl MergeSettings {
    /// Reads, joins and writes.
    ///
    /// # Errors
    /// If a picture cannot be read, keeps no sums over its replicates, or is of another scene or of the same random
    /// numbers as another; or if the output cannot be written.
    pub fn run(&self, context: &Context) -> Result<MergeReport> {
        let begun = Instant::now();
        let _inputs = inputs::protect(self.inputs.iter().map(PathBuf::as_path), self.limits);
        let Self { confidence, target_error, .. } = *self;
        let accuracy = AccuracySettings { confidence, target_error, ..AccuracySettings::default() };
        ranges::probability("confidence", confidence)?;
        ranges::positive("target_error", target_error)?;
        let [first, others @ ..] = &self.inputs[..] else {
            return Err(Error::invalid("no picture is given").hint("give pictures of the same scene, two or more"));
        };
        outputs::file(&self.output, Content::Exr)?;
        protected::check(&self.output)?;
        let mut provenance = Provenance::begin(context).of("merge", self, &MANNER);
        let policy = Policy { own: &provenance, keys: Keys::RENDERED, overwrite: self.overwrite, resume: false };
        policy.check(&self.output)?;
        provenance.files(self.inputs.iter().map(PathBuf::as_path))?;
        let cancel = context.cancel();
        if deep::is_deep(first) {
            let samples = self.join_deep(provenance.attributes(), &cancel)?;
            return Ok(MergeReport {
                output: self.output.clone(),
                pictures: self.inputs.len(),
                replicates: None,
                samples: Some(samples),
                missing: None,
                accuracy: None,
                seconds: begun.elapsed().as_secs_f64(),
            });
        }
        let steps = context.steps(self.inputs.len() as u64, "merge");
        let Read { mut made, attributes, placement } = Made::read(first, self.limits)?;
        let scene = attributes.get(SCENE).cloned();
        for path in others {
            if cancel.requested() {
                return Err(Error::cancelled());
            }
            steps.inc(1);
            let other = Made::read(path, self.limits)?;
            if scene.is_none() || other.attributes.get(SCENE) != scene.as_ref() || other.placement != placement {
                return Err(another(first, path, [&attributes, &other.attributes]));
            }
            made.merge(&other.made).map_err(|e| e.at(path))?;
        }
        drop(steps);
        let known = Known { seconds: begun.elapsed().as_secs_f64(), keeps_sums: true, ..Known::default() };
        let Measured { rendered, error } = Measured::of(&made, &accuracy, known);
        let mut all = provenance.attributes();
        all.extend(scene.map(|scene| (SCENE.to_owned(), scene)));
        let kept = |name: &str| Some((name.to_owned(), attributes.get(name)?.clone()));
        all.extend(pictured::NAMES.into_iter().filter_map(kept));
        error.describe(&accuracy, &mut all);
        let missing = error.missing().map(|count| made.streams.following(count).to_string());
        let Placement { display, .. } = placement;
        match display == [rendered.film.width, rendered.film.height] {
            true => exr::write_picture(&self.output, &rendered.film, &all, exr::Half::None)?,
            false => exr::write_part(&self.output, &rendered.film, &all, exr::Half::None, placement)?,
        }
        Ok(MergeReport {
            output: self.output.clone(),
            pictures: self.inputs.len(),
            replicates: Some(made.streams.to_string()),
            samples: None,
            missing,
            accuracy: AccuracyReport::of(&accuracy, vec![error]),
            seconds: begun.elapsed().as_secs_f64(),
        })
    }
}

/// Error that two pictures are not of the same scene.
fn another(first: &Path, path: &Path, attributes: [&exr::Attributes; 2]) -> Error {
    let [a, b] = attributes.map(|all| all.get("cumulo:command").map_or("an unknown command", String::as_str));
    Error::invalid(format!("this picture shows something else than '{}': '{a}' and '{b}' made them", first.display()))
        .at(path)
        .hint(
            "join pictures of the same scene, view and size, and of the same content of all inputs, whose commands \
             differ in ⟨seed⟩, ⟨samples⟩ and ⟨replicates⟩ alone",
        )
}
