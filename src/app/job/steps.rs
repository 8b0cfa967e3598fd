//! Steps of a job: the tasks of a command's work, and what is done when all of them are done.

use super::command::{Argument, CommandLine, Piece};
use super::parameters::Parameters;
use super::template::{
    Action, Actions, Cancelation, Chunks, DataFlow, Dependency, HostRequirements, ParameterSpace, RangeConstraint,
    Script, Step, TaskParameter,
};
use super::work::{Work, range_of};
use crate::error::{Error, Result};
use crate::formats::sequence::Frames;
use std::path::Path;

/// Seconds between the signal that stops a task and its end by force.
const NOTICE: u32 = 60;
/// Most values of a task parameter that are listed.
const MOST_LISTED: usize = 1024;

/// How tasks are made.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tasks {
    /// Frames, views or replicates of a task at first.
    pub count: u32,
    /// Seconds that a task is to take.
    pub seconds: u32,
    /// Bytes of memory that a host needs; none where it is not known.
    pub memory: Option<u64>,
    /// True if the work goes on from what it has left when it was stopped.
    pub resume: bool,
}

/// Steps of a job as they are made.
pub(super) struct Builder<'b> {
    pub parameters: &'b mut Parameters,
    pub tasks: Tasks,
}

impl Builder<'_> {
    /// Returns the steps that do the work of a command, in their order.
    ///
    /// # Errors
    /// If a word cannot stand in a template, or there are too many parts.
    pub(super) fn steps(&mut self, command: &CommandLine, work: &Work) -> Result<Vec<Step>> {
        let name = step_name(&command.command);
        let resumed = match self.tasks.resume {
            true => command.clone().with(Argument::flag("resume")),
            false => command.clone(),
        };
        Ok(match work {
            Work::Whole => vec![self.step(&name, &resumed, None)?],
            Work::Frames(numbers) => vec![self.chunked(&name, resumed, ("frames", "Frame", "Frames"), numbers)?],
            Work::Views(numbers) => vec![self.chunked(&name, resumed, ("view", "View", "Views"), numbers)?],
            Work::Denoised { numbers, planes } => self.denoised(&resumed, numbers, planes)?,
            Work::Ranges(ranges) => vec![self.ranged(&name, resumed, ranges)?],
            Work::Replicates { numbers, picture } => self.replicates(command, *numbers, picture)?,
        })
    }

    /// Returns a step whose tasks have some of the numbers each.
    fn chunked(
        &mut self,
        name: &str,
        command: CommandLine,
        (option, each, all): (&str, &str, &str),
        numbers: &[u32],
    ) -> Result<Step> {
        let tasks = self.chunks(each, all, range_of(numbers))?;
        let one = command.with(Argument::option(option, &format!("{{{{Task.Param.{each}}}}}")));
        self.step(name, &one, Some(tasks))
    }

    /// Returns a step whose tasks have a range of frames each.
    fn ranged(&mut self, name: &str, command: CommandLine, ranges: &[Frames]) -> Result<Step> {
        if ranges.len() > MOST_LISTED {
            return Err(Error::invalid(format!("{} chunks are more than a job has tasks", ranges.len()))
                .hint("give a larger ⟨chunk⟩"));
        }
        let range = ranges.iter().map(ToString::to_string).collect();
        let tasks = TaskParameter::Texts { name: "Frames".into(), range };
        let one = command.with(Argument::option("frames", "{{Task.Param.Frames}}"));
        self.step(name, &one, Some(tasks))
    }

    /// Returns the task parameter `each` of chunks of numbers, which the job's parameter `all` states.
    fn chunks(&mut self, each: &str, all: &str, range: String) -> Result<TaskParameter> {
        if range.len() > MOST_LISTED {
            return Err(Error::unsupported("the numbers are too irregular for the range of a job")
                .hint("give ⟨frames⟩ A-B or A-BxSTEP, or make a job for each range"));
        }
        let Tasks { count, .. } = self.tasks;
        let describe = |what: &str| format!("{all} {what}");
        let range = self.parameters.text_of(all, &describe("to work on, such as 1-24 or 1-99:2."), range);
        let count = self.parameters.number_of("ChunkSize", &describe("of a task at first."), count);
        let seconds = "Seconds that a task is to take, by which a scheduler may change the size of chunks.";
        let target_runtime_seconds = self.parameters.number_of("ChunkSeconds", seconds, self.tasks.seconds);
        let range_constraint = RangeConstraint::Contiguous;
        let chunks = Chunks { default_task_count: count, target_runtime_seconds, range_constraint };
        Ok(TaskParameter::Chunks { name: each.into(), range, chunks })
    }

    /// Returns the steps that render frames and denoise them. The second one is the command itself, which finds the
    /// noisy frames where it would have put them.
    fn denoised(&mut self, command: &CommandLine, numbers: &[u32], planes: &str) -> Result<Vec<Step>> {
        let output = self.output(command)?;
        let mut noisy = command.clone().without(&["denoise", "png", "exposure"]).writing(&format!("{output}/noisy"));
        let asked = noisy.arguments.iter().find(|argument| argument.setting == "aov");
        let mut values = asked.map_or_else(Vec::new, |argument| argument.values.clone());
        values.extend(
            planes.split(',').filter(|plane| !plane.is_empty()).map(|plane| vec![Piece::Text(plane.to_owned())]),
        );
        noisy = noisy.with(Argument { setting: "aov".into(), option: Some("aov".into()), values });
        let render = self.chunked("Render", noisy, ("frames", "Frame", "Frames"), numbers)?;
        let mut denoise = self.step("Denoise", command, None)?;
        denoise.dependencies.push(Dependency { depends_on: render.name.clone() });
        Ok(vec![render, denoise])
    }

    /// Returns the steps that render the replicates of a picture and merge them.
    fn replicates(&mut self, command: &CommandLine, [first, last]: [u32; 2], picture: &Path) -> Result<Vec<Step>> {
        let numbers: Vec<u32> = (first..=last).collect();
        let parts = self.parameters.path("parts", &picture.with_extension("parts"), DataFlow::Out)?;
        let part = format!("{parts}/{{{{Task.Param.Replicate}}}}.exr");
        let one = command.clone().with(Argument::flag("resume")).writing(&part);
        let mut render = self.chunked("Render", one, ("replicates", "Replicate", "Replicates"), &numbers)?;
        // The folder of a picture must exist.
        let run = &mut render.script.actions.on_run;
        let program = std::mem::replace(&mut run.command, "sh".into());
        let words = ["-c", "mkdir -p \"$0\" && exec \"$@\"", &parts, &program].map(str::to_owned);
        run.args.splice(..0, words);
        let output = self.parameters.path("output", picture, DataFlow::Out)?;
        let program = self.program();
        // The names of the parts follow the chunks, which the scheduler makes.
        let mut merge = self.step("Merge", &CommandLine { command: "merge".into(), arguments: Vec::new() }, None)?;
        merge.script.actions.on_run.command = "sh".into();
        merge.script.actions.on_run.args =
            ["-c", "exec \"$0\" merge \"$1\"/*.exr --overwrite -o \"$2\" --progress openjd"]
                .map(str::to_owned)
                .into_iter()
                .chain([program, parts, output])
                .collect();
        merge.dependencies.push(Dependency { depends_on: render.name.clone() });
        Ok(vec![render, merge])
    }

    /// Returns the step that compares what a command has written with reference pictures: in tasks of the numbers that
    /// the work has, since the reference may have more. It depends on no step yet.
    ///
    /// # Errors
    /// If a path cannot stand in a template, or the command writes nothing.
    pub(super) fn compare(
        &mut self,
        command: &CommandLine,
        work: &Work,
        reference: &Path,
        tolerance: f64,
    ) -> Result<Step> {
        let placed =
            |setting: &str, piece| Argument { setting: setting.into(), option: None, values: vec![vec![piece]] };
        let mut arguments = vec![
            placed("output", Piece::Reference(self.output(command)?)),
            placed("reference", Piece::Input(reference.to_owned())),
            Argument::option("tolerance", &tolerance.to_string()),
        ];
        // One task that makes a sequence states its frames as the command does.
        if *work == Work::Whole && !command.writes_one_picture() {
            arguments.extend(command.arguments.iter().filter(|argument| argument.setting == "frames").cloned());
        }
        let (name, compare) = ("Compare", CommandLine { command: "compare".into(), arguments });
        match work {
            Work::Whole | Work::Replicates { .. } => self.step(name, &compare, None),
            Work::Frames(numbers) | Work::Denoised { numbers, .. } => {
                self.chunked(name, compare, ("frames", "Frame", "Frames"), numbers)
            }
            // The numbers of views are those of their pictures.
            Work::Views(numbers) => self.chunked(name, compare, ("frames", "View", "Views"), numbers),
            Work::Ranges(ranges) => self.ranged(name, compare, ranges),
        }
    }

    /// Returns the reference to the output of a command.
    fn output(&mut self, command: &CommandLine) -> Result<String> {
        let output = command.output().ok_or_else(|| Error::invalid("the command writes nothing"))?;
        self.parameters.path("output", output, DataFlow::Out)
    }

    /// Returns the reference to the program.
    fn program(&mut self) -> String {
        let description = "Program on the hosts, by its name or its path.";
        self.parameters.text_of("Cumulo", description, "cumulo".into())
    }

    /// Returns a step that runs a command line, once for each value of a task parameter.
    fn step(&mut self, name: &str, command: &CommandLine, tasks: Option<TaskParameter>) -> Result<Step> {
        let mut args = self.parameters.words(command)?;
        args.extend(["--progress", "openjd"].map(str::to_owned));
        let cancelation = Cancelation::NotifyThenTerminate { notify_period_in_seconds: NOTICE };
        let on_run = Action { command: self.program(), args, cancelation };
        Ok(Step {
            name: name.into(),
            dependencies: Vec::new(),
            parameter_space: tasks.map(|tasks| ParameterSpace { task_parameter_definitions: vec![tasks] }),
            host_requirements: self.tasks.memory.map(HostRequirements::memory),
            script: Script { actions: Actions { on_run } },
        })
    }
}

/// Returns the name of the step of a command: its first word with a capital letter.
fn step_name(command: &str) -> String {
    let word = command.split(' ').next().unwrap_or_default();
    let mut letters = word.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
