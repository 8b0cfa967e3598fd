//! One command on one damaged input, and what is expected of it whatever the damage.

use super::corpus::Sample;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::os::unix::fs::FileExt;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use wait4::Wait4;

/// `--max-memory` of every command.
const CAP_MIB: u64 = 512;
/// Peak of the resident memory: the cap and a quarter.
const PEAK_KIB: u64 = CAP_MIB * 1024 * 5 / 4;
/// Processor time. Wall time would count what else the machine has to do.
const SECONDS: f64 = 20.0;
/// Wall time of a process that waits instead of working.
const PATIENCE: Duration = Duration::from_secs(300);
/// What is kept of the output, against a program that never stops writing.
const MOST_OUTPUT: u64 = 1 << 20;

/// Something that must not happen.
#[derive(Debug, Clone)]
pub struct Fault {
    /// Which expectation was not met.
    pub what: &'static str,
    /// What was seen instead.
    pub seen: String,
}

/// How a command ended.
pub struct Trial {
    /// Exit code; none after a signal.
    pub code: Option<i32>,
    pub faults: Vec<Fault>,
    pub peak_kib: u64,
    pub seconds: f64,
}

struct Ended {
    status: ExitStatus,
    stdout: String,
    stderr: String,
    peak_kib: u64,
    seconds: f64,
    wall: Duration,
    stopped: bool,
}

/// A folder with one damaged input in it.
pub struct Case<'a> {
    pub folder: PathBuf,
    pub sample: &'a Sample,
    pub content: &'a [u8],
    pub sound: &'a Path,
    /// Whether `compare` takes `--max-memory`.
    pub compare_has_cap: bool,
}

impl Case<'_> {
    /// Writes all files anew: a command may have changed them.
    fn prepare(&self) {
        if self.folder.exists() {
            std::fs::remove_dir_all(&self.folder).unwrap();
        }
        for (name, bytes) in &self.sample.files {
            let path = self.folder.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, if *name == self.sample.damaged { self.content } else { bytes }).unwrap();
        }
    }

    /// The words of a command line, and the files among them that it writes.
    pub fn words(&self, command: &str) -> (Vec<String>, Vec<PathBuf>) {
        let damaged = self.sample.damaged.to_str().unwrap();
        let mut outputs = Vec::new();
        let mut words = Vec::new();
        for word in command.split_whitespace() {
            let word = word.replace("{}", damaged);
            let sound = |name: &str| self.sound.join(name).to_str().unwrap().to_owned();
            words.push(match (word.strip_prefix('>'), word.split_once('@')) {
                (Some(output), _) => {
                    outputs.push(PathBuf::from(output));
                    output.to_owned()
                }
                (None, Some((option, name))) => format!("{option}{}", sound(name)),
                (None, None) => word,
            });
        }
        words.extend(["--threads", "1"].map(str::to_owned));
        if !command.starts_with("compare") || self.compare_has_cap {
            words.extend(["--max-memory".to_owned(), format!("{CAP_MIB}M")]);
        }
        (words, outputs)
    }

    /// Runs a command and says what was not as it must be.
    pub fn run(&self, command: &str) -> Trial {
        self.prepare();
        let (words, outputs) = self.words(command);
        let before: BTreeMap<&PathBuf, Vec<u8>> =
            outputs.iter().filter_map(|o| Some((o, std::fs::read(self.folder.join(o)).ok()?))).collect();
        let ended = self.start(&words);
        let mut faults = self.judge(&ended, command);
        // Code 1 is a finding, or a run that was stopped: outputs may be there, and are sound then.
        let failed = !matches!(ended.status.code(), Some(0 | 1));
        for output in &outputs {
            let path = self.folder.join(output);
            if ended.status.code() == Some(1) && !path.exists() {
                continue;
            }
            match (failed, before.get(output)) {
                (true, Some(old)) => {
                    if std::fs::read(&path).ok().as_ref() != Some(old) {
                        faults.push(Fault { what: "the old output stands", seen: output.display().to_string() });
                    }
                }
                (true, None) => faults.extend(self.remains(&path)),
                (false, _) => faults.extend(self.sound_output(&path)),
            }
        }
        for (name, bytes) in &self.sample.files {
            let whole = if *name == self.sample.damaged { self.content } else { bytes };
            // A report that is made again writes its page and record again.
            let rewritten = outputs.contains(name) || command.starts_with("report") && !failed;
            if !rewritten && std::fs::read(self.folder.join(name)).ok().as_deref() != Some(whole) {
                faults.push(Fault { what: "inputs are left as they were", seen: name.display().to_string() });
            }
        }
        faults.extend(self.leftovers());
        Trial { code: ended.status.code(), faults, peak_kib: ended.peak_kib, seconds: ended.seconds }
    }

    /// Runs a command while the damaged file changes in place all the time, between what it was, `others` and parts of them,
    /// and says what was not as it must be.
    pub fn run_changing(&self, command: &str, others: &[Vec<u8>]) -> Trial {
        self.prepare();
        let (words, outputs) = self.words(command);
        let whole = &self.sample.files[&self.sample.damaged];
        let file = OpenOptions::new().write(true).open(self.folder.join(&self.sample.damaged)).unwrap();
        let ending = AtomicBool::new(false);
        let ended = std::thread::scope(|scope| {
            scope.spawn(|| {
                for other in others.iter().cycle() {
                    for bytes in [other, whole, &whole[..whole.len() / 2].to_vec(), whole] {
                        file.set_len(bytes.len() as u64).unwrap();
                        file.write_all_at(bytes, 0).unwrap();
                        std::thread::sleep(Duration::from_micros(300));
                    }
                    if ending.load(Ordering::Relaxed) {
                        break;
                    }
                }
            });
            let ended = self.start(&words);
            ending.store(true, Ordering::Relaxed);
            ended
        });
        let mut faults = self.judge(&ended, command);
        for output in &outputs {
            let path = self.folder.join(output);
            // Where a file changes after the result was written, its report fails: a whole result may stay.
            let whole = path.exists().then(|| self.sound_output(&path)).flatten();
            let succeeded = ended.status.code() == Some(0);
            faults.extend(if succeeded { self.sound_output(&path) } else { whole.and(self.remains(&path)) });
        }
        faults.extend(self.leftovers());
        Trial { code: ended.status.code(), faults, peak_kib: ended.peak_kib, seconds: ended.seconds }
    }

    fn start(&self, words: &[String]) -> Ended {
        let (out, err) = (self.folder.join("stdout.log"), self.folder.join("stderr.log"));
        let file = |path: &Path| OpenOptions::new().create(true).write(true).truncate(true).open(path).unwrap();
        let begun = Instant::now();
        let mut child = Command::new(program())
            .args(words)
            .current_dir(&self.folder)
            .stdin(Stdio::null())
            .stdout(file(&out))
            .stderr(file(&err))
            .env("RUST_BACKTRACE", "0")
            .spawn()
            .unwrap();
        let mut stopped = false;
        let mut pause = Duration::from_micros(500);
        // A process that has ended keeps its number until it is waited for, which is done below.
        while let Some(seconds) = processor_seconds(child.id()) {
            std::thread::sleep(pause);
            pause = (2 * pause).min(Duration::from_millis(10));
            let flooded = || [&out, &err].iter().any(|p| p.metadata().is_ok_and(|m| m.len() > MOST_OUTPUT));
            if !stopped && (begun.elapsed() > PATIENCE || seconds > SECONDS || flooded()) {
                stopped = true;
                child.kill().unwrap();
            }
        }
        let wall = begun.elapsed();
        let used = child.wait4().unwrap();
        let read = |path: &Path| {
            let text = String::from_utf8_lossy(&std::fs::read(path).unwrap()).into_owned();
            std::fs::remove_file(path).unwrap();
            text
        };
        Ended {
            status: used.status,
            stdout: read(&out),
            stderr: read(&err),
            // Bytes on every platform.
            peak_kib: used.rusage.maxrss >> 10,
            seconds: (used.rusage.utime + used.rusage.stime).as_secs_f64(),
            wall,
            stopped,
        }
    }

    fn judge(&self, ended: &Ended, command: &str) -> Vec<Fault> {
        let mut faults = Vec::new();
        let mut expect = |holds: bool, what: &'static str, seen: String| {
            if !holds {
                faults.push(Fault { what, seen });
            }
        };
        let first = || last_message(&ended.stderr).map_or_else(String::new, |m| m.0.to_owned());
        if ended.stopped {
            expect(false, "the command ends in time", format!("{:.0} s, {:.0?}", ended.seconds, ended.wall));
        } else if let Some(signal) = ended.status.signal() {
            expect(false, "no signal ends the command", format!("signal {signal}: {}", tail(&ended.stderr)));
        } else {
            let code = ended.status.code().unwrap();
            expect((0..=2).contains(&code), "the exit code is 0, 1 or 2", format!("{code}: {}", tail(&ended.stderr)));
        }
        for word in ["panicked", "memory allocation of", "bad_alloc", "std::"] {
            expect(!ended.stderr.contains(word), "the program keeps control of itself", tail(&ended.stderr));
        }
        let peak = format!("{} MiB", ended.peak_kib >> 10);
        expect(ended.peak_kib <= PEAK_KIB, "memory stays below the cap", peak);
        for text in [&ended.stdout, &ended.stderr] {
            let control = text.chars().find(|c| c.is_control() && !"\n\t".contains(*c));
            expect(control.is_none(), "no control character reaches the terminal", format!("{control:?}"));
        }
        if !ended.stopped && ended.status.code() == Some(2) {
            expect(self.is_named(&ended.stderr), "the message names the file", first());
            let remedy = last_message(&ended.stderr).and_then(|m| m.1);
            let said = remedy.is_some_and(|line| line.starts_with("  ") && line.trim().len() > 10);
            expect(said, "the message has a remedy", first());
        }
        if command.starts_with("validate") && ended.status.code() == Some(1) {
            let lines: Vec<&str> = ended.stdout.lines().collect();
            expect(self.is_named(&ended.stdout), "the message names the file", ended.stdout.clone());
            for (i, line) in lines.iter().enumerate().filter(|(_, l)| l.starts_with("  problem: ")) {
                let said = lines.get(i + 1).is_some_and(|l| l.starts_with("    "));
                expect(said, "the message has a remedy", (*line).to_owned());
            }
        }
        faults
    }

    /// A message names the damaged file or its folder, or one that the damaged file leads to.
    fn is_named(&self, text: &str) -> bool {
        let mut names = vec![self.sample.damaged.to_str().unwrap().to_owned()];
        if let Some(folder) = self.sample.damaged.parent().filter(|p| *p != Path::new("")) {
            names.push(folder.to_str().unwrap().to_owned());
        }
        if let Ok(root) = serde_json::from_slice::<Value>(self.content) {
            paths(&root, &mut names);
        }
        // Paths may be shortened, and their control characters are replaced.
        let head = |name: &str| name.chars().take_while(|c| !c.is_control()).take(40).collect::<String>();
        names.iter().map(|n| head(n)).any(|name| !name.is_empty() && text.contains(&name))
    }

    /// Nothing stays of an output that was not made; a folder may, if nothing is in it.
    fn remains(&self, path: &Path) -> Option<Fault> {
        let empty = path.is_dir() && std::fs::read_dir(path).unwrap().next().is_none();
        (path.exists() && !empty).then(|| Fault {
            what: "a failure leaves no output",
            seen: path.file_name().unwrap().display().to_string(),
        })
    }

    fn sound_output(&self, path: &Path) -> Option<Fault> {
        let fault = |seen: String| {
            let name = path.file_name().unwrap().display();
            Some(Fault { what: "outputs are sound", seen: format!("{name}: {seen}") })
        };
        if !path.exists() {
            return fault("it was not written".into());
        }
        match path.extension().and_then(|e| e.to_str()) {
            Some("json") => match serde_json::from_slice::<Value>(&std::fs::read(path).unwrap()) {
                Ok(_) => None,
                Err(e) => fault(e.to_string()),
            },
            Some("png") => {
                let whole = std::fs::read(path).unwrap();
                if whole.ends_with(b"IEND\xaeB`\x82") { None } else { fault("no end".into()) }
            }
            _ => {
                let words = ["info", path.to_str().unwrap(), "--threads", "1"].map(str::to_owned);
                let ended = self.start(&words);
                if ended.status.code() == Some(0) { None } else { fault(tail(&ended.stderr)) }
            }
        }
    }

    fn leftovers(&self) -> Option<Fault> {
        let mut left = vec![self.folder.clone()];
        while let Some(folder) = left.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    left.push(path.clone());
                }
                let name = path.file_name().unwrap().to_string_lossy().into_owned();
                if name.starts_with(".cumulo-") {
                    return Some(Fault { what: "no temporary file stays", seen: name });
                }
            }
        }
        None
    }
}

/// The program under test; `FUZZ_PROGRAM` names another build of it.
pub fn program() -> PathBuf {
    std::env::var_os("FUZZ_PROGRAM").map_or_else(|| env!("CARGO_BIN_EXE_cumulo").into(), PathBuf::from)
}

/// User and system time of a process, none once it has ended.
fn processor_seconds(pid: u32) -> Option<f64> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name, which may hold blanks, ends at the last bracket; times are in hundredths of a second.
    let fields: Vec<&str> = stat.rsplit(')').next()?.split_whitespace().collect();
    let ticks = |i: usize| fields.get(i).and_then(|f| f.parse::<f64>().ok()).unwrap_or(0.0);
    (!matches!(fields.first(), None | Some(&"Z" | &"X"))).then(|| (ticks(11) + ticks(12)) / 100.0)
}

/// The last line that the program signs with its name, and the line after it.
fn last_message(stderr: &str) -> Option<(&str, Option<&str>)> {
    let lines: Vec<&str> = stderr.lines().collect();
    let at = lines.iter().rposition(|l| l.starts_with("cumulo: ") || l.starts_with("error: "))?;
    Some((lines[at], lines.get(at + 1).copied()))
}

fn tail(text: &str) -> String {
    let from = text.char_indices().rev().nth(300).map_or(0, |(i, _)| i);
    text[from..].to_owned()
}

/// Keys of captures, reports and scene files that hold paths.
const PATHS: [&str; 8] = ["file_path", "capture", "output", "volume", "report", "file", "transfer", "texture"];

/// The texts of a tree under keys that hold paths.
fn paths(value: &Value, names: &mut Vec<String>) {
    match value {
        Value::Array(list) => list.iter().for_each(|v| paths(v, names)),
        Value::Object(map) => {
            for (key, value) in map {
                match value {
                    Value::String(text) if PATHS.contains(&&**key) => {
                        names.push(text.clone());
                    }
                    other => paths(other, names),
                }
            }
        }
        _ => {}
    }
}
