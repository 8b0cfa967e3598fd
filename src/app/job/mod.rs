//! Job bundles of Open Job Description, by which render farms such as AWS Deadline Cloud run a command: the template of
//! the job, the values of its parameters, and the files that its inputs lead to.
//!
//! Tasks run the command line itself, each on a part of the work, with `--resume`: one that was killed and runs again
//! does what is missing.

mod command;
mod parameters;
mod steps;
mod template;
mod work;

pub(crate) use command::{Argument, CommandLine, Piece, Value};
pub(crate) use work::{Divisible, Work};

use super::{inputs, sequence};
use crate::app::Context;
use crate::app::use_case::Report;
use crate::error::{Code, Error, Result};
use crate::formats::atomic::Batch;
use crate::formats::limits::Limits;
use crate::formats::protected;
use crate::text::shell_quoted;
use command::is_exr;
use parameters::Parameters;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fmt;
use std::path::{Path, PathBuf};
use steps::{Builder, Tasks};
use template::{Dependency, Extension, Specification, Step, TaskParameter, Template};

/// Settings of a job bundle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct JobSettings {
    /// Folder of the bundle.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// True to replace another bundle in the folder.
    pub overwrite: bool,
    /// Frames, views or replicates of a task at first; none for as many as the planner expects to take `seconds`.
    pub chunk: Option<u32>,
    /// Seconds that a task is to take.
    pub seconds: u32,
    /// Picture, sequence or folder of pictures that a last step compares the result with; none for no such step.
    #[serde(with = "crate::app::paths")]
    pub reference: Option<PathBuf>,
    /// Largest absolute difference from the reference that still counts as agreement.
    pub tolerance: f64,
}

impl Default for JobSettings {
    fn default() -> Self {
        Self { output: PathBuf::new(), overwrite: false, chunk: None, seconds: 600, reference: None, tolerance: 0.0 }
    }
}

/// Report of a job bundle.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct JobReport {
    /// Folder of the bundle.
    #[serde(serialize_with = "crate::app::paths::text")]
    bundle: PathBuf,
    /// Name of the job.
    name: String,
    steps: Vec<StepReport>,
    /// Seconds that a frame or a view is expected to take on this machine; null where that is not known.
    seconds_each: Option<f64>,
}

/// Step of a job.
#[derive(Debug, Serialize, schemars::JsonSchema)]
struct StepReport {
    name: String,
    /// Numbers or frames that its tasks share; null where one task does all.
    over: Option<String>,
    /// Frames, views or replicates of a task at first; null where chunks are fixed, or one task does all.
    chunk: Option<u32>,
    /// Steps that must be done before.
    after: Vec<String>,
}

impl StepReport {
    fn of(step: &Step, parameters: &Parameters, count: u32) -> Self {
        let tasks = step.parameter_space.as_ref().and_then(|space| space.task_parameter_definitions.first());
        let (over, chunk) = match tasks {
            Some(TaskParameter::Chunks { range, .. }) => (parameters.default_of(range), Some(count)),
            Some(TaskParameter::Texts { range, .. }) => (Some(range.join(", ")), None),
            None => (None, None),
        };
        let after = step.dependencies.iter().map(|dependency| dependency.depends_on.clone()).collect();
        Self { name: step.name.clone(), over, chunk, after }
    }
}

impl fmt::Display for JobReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { bundle, name, steps, seconds_each } = self;
        write!(f, "{}: job '{name}'", bundle.display())?;
        for StepReport { name, over, chunk, after } in steps {
            write!(f, "\n  {name}: ")?;
            match (over, chunk) {
                (Some(over), Some(chunk)) => write!(f, "{over}, in chunks of {chunk} at first")?,
                (Some(over), None) => write!(f, "{over}")?,
                (None, _) => write!(f, "one task")?,
            }
            if !after.is_empty() {
                write!(f, ", after {}", after.join(", "))?;
            }
        }
        seconds_each.iter().try_for_each(|seconds| write!(f, "\n  each is expected to take {seconds:.2} s here"))?;
        let quoted = |name: &str| shell_quoted(&bundle.join(name).to_string_lossy()).into_owned();
        let last = steps.last().map_or("", |step| step.name.as_str());
        let (template, values) = (quoted(TEMPLATE), quoted(VALUES));
        write!(f, "\n  openjd run {template} -p file://{values} --step {last} --run-dependencies")
    }
}

impl Report for JobReport {}

/// Name of the template in a bundle.
const TEMPLATE: &str = "template.json";
/// Names of the values of parameters, as the program `openjd` and as Deadline Cloud reads them.
const VALUES: &str = "parameters.json";
const SUBMITTED_VALUES: &str = "parameter_values.json";
/// Name of the list of files that Deadline Cloud sends along.
const ASSETS: &str = "asset_references.json";
/// Most characters of the name of a job.
const LONGEST_NAME: usize = 128;

impl JobSettings {
    /// Writes the bundle of the job that does the work of a command line, whose settings are `case`.
    ///
    /// # Errors
    /// If the work cannot be cut into tasks, another bundle lies in the folder, or it cannot be written.
    pub(crate) fn run(&self, line: &CommandLine, case: &impl Divisible, context: &Context) -> Result<JobReport> {
        let read: Vec<&Path> = case.inputs().into_iter().chain(self.reference.as_deref()).collect();
        let _inputs = inputs::protect(read.iter().copied(), case.limits());
        self.check_reference(line, case.limits())?;
        let all = [TEMPLATE, VALUES, SUBMITTED_VALUES, ASSETS].map(|name| self.output.join(name));
        all.iter().try_for_each(|path| protected::check(path))?;
        let work = case.work(context)?;
        let seconds_each = match (&work, self.chunk) {
            (Work::Frames(_) | Work::Views(_), None) => case.seconds(context),
            _ => None,
        };
        let fitting = |each: f64| (f64::from(self.seconds) / each.max(1e-3)).floor().max(1.0);
        let most = match &work {
            Work::Frames(numbers) | Work::Views(numbers) | Work::Denoised { numbers, .. } => numbers.len(),
            Work::Replicates { numbers: [first, last], .. } => (last - first) as usize + 1,
            Work::Whole | Work::Ranges(_) => 1,
        };
        let count =
            self.chunk.or(seconds_each.map(|each| fitting(each) as u32)).unwrap_or(1).clamp(1, most.max(1) as u32);
        let mut parameters = Parameters::default();
        let tasks = Tasks { count, seconds: self.seconds, memory: case.memory(), resume: case.resumes() };
        let mut builder = Builder { parameters: &mut parameters, tasks };
        let mut steps = builder.steps(line, &work)?;
        if let Some(reference) = &self.reference {
            let mut compare = builder.compare(line, &work, reference, self.tolerance)?;
            compare.dependencies.extend(steps.last().map(|last| Dependency { depends_on: last.name.clone() }));
            steps.push(compare);
        }
        let name = name_of(line);
        let reports = steps.iter().map(|step| StepReport::of(step, &parameters, count)).collect();
        let chunked = |step: &Step| {
            let tasks = step.parameter_space.iter().flat_map(|space| &space.task_parameter_definitions);
            tasks.into_iter().any(|tasks| matches!(tasks, TaskParameter::Chunks { .. }))
        };
        let extensions = if steps.iter().any(chunked) { vec![Extension::TaskChunking] } else { Vec::new() };
        let template = Template {
            specification_version: Specification::JobTemplate202309,
            extensions,
            name: name.clone(),
            description: format!("cumulo {}, one command line on several hosts.", line.command),
            parameter_definitions: parameters.definitions,
            steps,
        };
        let files = read.into_iter().flat_map(|path| inputs::files(path, case.limits())).collect();
        self.write(&template, &parameters.paths, files)?;
        Ok(JobReport { bundle: self.output.clone(), name, steps: reports, seconds_each })
    }

    /// Checks that pictures are made where a step is to compare them, and that there are as many to compare with: one,
    /// or several.
    ///
    /// # Errors
    /// If not.
    fn check_reference(&self, line: &CommandLine, limits: Limits) -> Result<()> {
        let Some(reference) = &self.reference else { return Ok(()) };
        let ending = line.output().and_then(Path::extension).and_then(OsStr::to_str).unwrap_or_default();
        if ["vdb", "nvdb", "json"].contains(&ending) {
            return Err(Error::unsupported(format!("a job compares pictures, and this one makes a .{ending}"))
                .hint("leave out ⟨openjd_reference⟩, and compare volumes by `cumulo diff` when the job is done"));
        }
        let is_one = sequence::pattern(reference).is_none() && !reference.is_dir();
        let (found, expected) = match (is_one, line.writes_one_picture()) {
            _ if !inputs::files(reference, limits).iter().any(|path| path.is_file() && is_exr(path)) => {
                ("there are no OpenEXR pictures to compare with", "give those of an earlier run")
            }
            (true, false) => ("this is one picture, and the job makes several", "give a sequence or a folder of them"),
            (false, true) => ("these are several pictures, and the job makes one", "give one picture"),
            _ => return Ok(()),
        };
        Err(Error::invalid(found).at(reference).hint(expected))
    }

    /// Writes the files of a bundle, all or none.
    fn write(&self, template: &Template, paths: &[(String, PathBuf)], files: Vec<PathBuf>) -> Result<()> {
        let failed = |e: serde_json::Error| Error::invalid(e.to_string());
        let text = |json: &Json| serde_json::to_string_pretty(json).map_err(failed);
        let template = serde_json::to_string_pretty(template).map_err(failed)?;
        let place = self.output.join(TEMPLATE);
        if !self.overwrite && std::fs::read_to_string(&place).is_ok_and(|standing| standing.trim() != template) {
            return Err(Error::invalid("a job of another command lies here, and would be replaced")
                .coded(Code::OutputExists)
                .at(&place)
                .hint("give another folder, or ⟨overwrite⟩ to replace it"));
        }
        let values: serde_json::Map<String, Json> =
            paths.iter().map(|(name, path)| (name.clone(), json!(path.to_string_lossy()))).collect();
        let submitted: Vec<Json> = values.iter().map(|(name, value)| json!({"name": name, "value": value})).collect();
        let absolute = |path: &PathBuf| std::path::absolute(path).ok()?.to_str().map(str::to_owned);
        let files: BTreeSet<String> = files.iter().filter(|path| path.is_file()).filter_map(absolute).collect();
        let assets = json!({"assetReferences": {
            "inputs": {"filenames": files, "directories": []},
            "outputs": {"directories": []},
            "referencedPaths": [],
        }});
        let mut batch = Batch::new();
        batch.make_folder(&self.output)?;
        let all = [
            (TEMPLATE, template),
            (VALUES, text(&json!(values))?),
            (SUBMITTED_VALUES, text(&json!({"parameterValues": submitted}))?),
            (ASSETS, text(&assets)?),
        ];
        for (name, text) in all {
            let waiting = batch.add(&self.output.join(name))?;
            std::fs::write(&waiting, text + "\n").map_err(|e| Error::io(&waiting, e))?;
        }
        batch.commit()
    }
}

/// Returns the name of a job: the command, and the name of what it writes.
fn name_of(line: &CommandLine) -> String {
    let output = line.output().and_then(Path::file_name).map(|name| name.to_string_lossy().into_owned());
    let name = [Some(line.command.clone()), output].into_iter().flatten().collect::<Vec<_>>().join(" ");
    let plain = name.replace("{{", "").chars().filter(|c| !c.is_control()).take(LONGEST_NAME).collect::<String>();
    plain.trim().to_owned()
}
