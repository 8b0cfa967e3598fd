//! Job templates of Open Job Description, specification `jobtemplate-2023-09`, as far as jobs of this program use them.

use serde::Serialize;

/// Job template.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Template {
    pub specification_version: Specification,
    /// Extensions of the specification that the template uses.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub extensions: Vec<Extension>,
    /// Name of the job.
    pub name: String,
    pub description: String,
    pub parameter_definitions: Vec<Parameter>,
    pub steps: Vec<Step>,
}

/// Version of the specification.
#[derive(Debug, Serialize)]
pub(super) enum Specification {
    #[serde(rename = "jobtemplate-2023-09")]
    JobTemplate202309,
}

/// Extension of the specification.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(super) enum Extension {
    /// Tasks in chunks, whose size the scheduler may choose.
    #[serde(rename = "TASK_CHUNKING")]
    TaskChunking,
}

/// Parameter of a job, which may be changed when the job is submitted.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "type", rename_all = "SCREAMING_SNAKE_CASE")]
pub(super) enum Parameter {
    /// Path, which is mapped where hosts have other paths to the same file.
    #[serde(rename_all = "camelCase")]
    Path { name: String, description: String, object_type: ObjectType, data_flow: DataFlow },
    /// Integer.
    #[serde(rename_all = "camelCase")]
    Int { name: String, description: String, min_value: u32, default: u32 },
    /// Text.
    String { name: String, description: String, default: String },
}

impl Parameter {
    /// Returns the name by which words refer to the parameter.
    pub(super) fn name(&self) -> &str {
        match self {
            Self::Path { name, .. } | Self::Int { name, .. } | Self::String { name, .. } => name,
        }
    }
}

/// Kind of what lies at a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub(super) enum ObjectType {
    File,
    Directory,
}

/// Direction in which data goes between a path and the job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub(super) enum DataFlow {
    In,
    Out,
}

/// Step of a job: an action, once for each value of its task parameter.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Step {
    pub name: String,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub dependencies: Vec<Dependency>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parameter_space: Option<ParameterSpace>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub host_requirements: Option<HostRequirements>,
    pub script: Script,
}

/// Step that must be done before.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Dependency {
    pub depends_on: String,
}

/// Tasks of a step.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct ParameterSpace {
    pub task_parameter_definitions: Vec<TaskParameter>,
}

/// Parameter whose values are the tasks of a step.
#[derive(Debug, Serialize)]
#[serde(tag = "type")]
pub(super) enum TaskParameter {
    /// Whole numbers, of which each task has several.
    #[serde(rename = "CHUNK[INT]")]
    Chunks { name: String, range: String, chunks: Chunks },
    /// Texts, one for each task.
    #[serde(rename = "STRING")]
    Texts { name: String, range: Vec<String> },
}

/// How the values of a task parameter are dealt out to tasks.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Chunks {
    /// Values of a task at first, as a number or the parameter that states it.
    pub default_task_count: String,
    /// Seconds that a task is to take, by which the scheduler changes the number of its values.
    pub target_runtime_seconds: String,
    pub range_constraint: RangeConstraint,
}

/// Which values a task may have.
#[derive(Debug, Serialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub(super) enum RangeConstraint {
    /// All values from a first to a last one.
    Contiguous,
}

/// Amounts of resources that a host must have.
#[derive(Debug, Serialize)]
pub(super) struct HostRequirements {
    pub amounts: Vec<Amount>,
}

/// Amount that a host must have.
#[derive(Debug, Serialize)]
pub(super) struct Amount {
    pub name: &'static str,
    pub min: u64,
}

impl HostRequirements {
    /// Returns the requirement of so many bytes of memory.
    pub(super) fn memory(bytes: u64) -> Self {
        Self { amounts: vec![Amount { name: "amount.worker.memory", min: bytes.div_ceil(1 << 20) }] }
    }
}

/// Actions that a task runs.
#[derive(Debug, Serialize)]
pub(super) struct Script {
    pub actions: Actions,
}

/// Actions of a task.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Actions {
    pub on_run: Action,
}

/// Command line of a task.
#[derive(Debug, Serialize)]
pub(super) struct Action {
    pub command: String,
    pub args: Vec<String>,
    pub cancelation: Cancelation,
}

/// How a task is stopped.
#[derive(Debug, Serialize)]
#[serde(tag = "mode", rename_all = "SCREAMING_SNAKE_CASE")]
pub(super) enum Cancelation {
    /// A signal, upon which the program writes what it has, and an end by force some time later.
    #[serde(rename_all = "camelCase")]
    NotifyThenTerminate { notify_period_in_seconds: u32 },
}
