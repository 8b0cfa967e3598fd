//! Damaged inputs of every kind through every command that reads them: no crash, no hang, memory below its cap, and a
//! message that names the file and says what to do. Inputs of every option that are outputs, too: none is replaced.
//!
//! Then files of some kinds change while they are read.
//!
//! `make test` runs a short round, `make fuzz` the long one. Environment variables: `FUZZ_INPUTS` is the number of
//! damaged inputs, `FUZZ_FROM` the first one's number, so that a long round can be run in parts, `FUZZ_SEED` the seed,
//! `FUZZ_CASE` runs one case alone, `FUZZ_PROGRAM` names another build of the program, `FUZZ_KEEP` the folder for the inputs
//! that fail.

use crate::alone::alone;
use crate::common::replaced;
use crate::damage::Dice;
use crate::damage::corpus::{Corpus, Sample};
use crate::damage::mutate;
use crate::damage::references::{self, Arcs};
use crate::damage::trial::{Case, Fault, program};
use rlimit::Resource;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Damaged inputs of the short round.
const INPUTS: u64 = 320;
const SEED: u64 = 20_261_122;
/// Stages of references to each of which [`INPUTS`] has this many damaged inputs.
const INPUTS_PER_STAGE: u64 = 8;
/// Memory that the system grants a process before its allocations fail. A machine survives a few of that size, and the
/// peaks that the test looks for are smaller.
const DATA: u64 = 2 << 30;
/// Kinds of inputs of which files change while they are read, and parts of the names of those that do.
const CHANGING: [(&str, &str); 7] = [
    ("scalar volumes", "plain.vdb"),
    ("scalar volumes", "plume.vdb"),
    ("other volumes", "points.vdb"),
    ("NanoVDB", "cube.nvdb"),
    ("pictures", "picture zip.exr"),
    ("OME-Zarr", "zarr.json"),
    ("images", ""),
];
/// Longest time that the round of changing files takes, which ends then.
const CHANGING_SECONDS: f64 = 60.0;
/// Inputs after which the round says how far it is.
const SAYS: u64 = 500;
/// Inputs that are kept of each fault.
const EXAMPLES: usize = 3;

/// What a round shares between its workers.
struct Round<'a> {
    seed: u64,
    keep: PathBuf,
    compare_has_cap: bool,
    corpus: &'a Corpus,
    tally: Mutex<Tally>,
}

/// What happened, by kind of input and by fault.
#[derive(Default)]
struct Tally {
    kinds: BTreeMap<&'static str, Kind>,
    /// By expectation, and what was seen without its numbers: how often, and the first examples.
    faults: BTreeMap<(&'static str, String), (u64, Vec<String>)>,
    peak_kib: u64,
    slowest: f64,
}

#[derive(Default)]
struct Kind {
    inputs: u64,
    runs: u64,
    faults: u64,
    codes: BTreeMap<i32, u64>,
}

impl Tally {
    fn runs(&self) -> u64 {
        self.kinds.values().map(|k| k.runs).sum()
    }

    fn refused(&self) -> u64 {
        self.kinds.values().filter_map(|k| k.codes.get(&2)).sum()
    }

    fn summary(&self, seed: u64, seconds: f64, keep: &Path) -> String {
        let inputs: u64 = self.kinds.values().map(|k| k.inputs).sum();
        let mut text = format!(
            "{inputs} damaged inputs, {} runs in {seconds:.0} s, seed {seed}; largest peak {} MiB, longest run {:.1} s\n",
            self.runs(),
            self.peak_kib >> 10,
            self.slowest
        );
        for (name, kind) in &self.kinds {
            let code = |c: i32| kind.codes.get(&c).copied().unwrap_or(0);
            let (inputs, runs, faults) = (kind.inputs, kind.runs, kind.faults);
            let _ = writeln!(
                text,
                "  {name:<20}{inputs:>6} inputs{runs:>7} runs: done {:>6}, found something {:>5}, refused {:>6}; faults {faults}",
                code(0),
                code(1),
                code(2)
            );
        }
        for ((what, seen), (count, examples)) in &self.faults {
            let _ = writeln!(text, "FAULT {count:>5}: not so: {what}\n  seen: {seen}");
            for example in examples {
                let _ = writeln!(text, "  {example}");
            }
        }
        if !self.faults.is_empty() {
            let _ = writeln!(text, "kept in {}", keep.display());
        }
        text
    }
}

impl Round<'_> {
    /// Nothing is wrong with the undamaged inputs, and their first command ends well: what the round finds is due to
    /// the damage.
    fn sound_inputs(&self, folder: &Path) {
        for sample in self.corpus.kinds.iter().flat_map(|(_, samples)| samples) {
            let content = &sample.files[&sample.damaged];
            let case = self.of(sample, content, folder.to_path_buf());
            let trial = case.run(sample.commands[0]);
            // This is no picture for the program: its compression is one of OpenEXR 3.4.
            let foreign = sample.name.ends_with("htj2k32.exr");
            assert!(foreign || trial.code == Some(0), "{}: {:?}", sample.name, trial.faults);
            assert!(trial.faults.is_empty(), "{}: {:?}", sample.name, trial.faults);
        }
    }

    fn of<'a>(&'a self, sample: &'a Sample, content: &'a [u8], folder: PathBuf) -> Case<'a> {
        Case { folder, sample, content, sound: &self.corpus.sound, compare_has_cap: self.compare_has_cap }
    }

    /// Damages an input and runs every command that reads it.
    fn case(&self, number: u64, folder: &Path) {
        let mut dice = Dice::new(self.seed, number);
        let (kind, samples) = dice.choose(&self.corpus.kinds);
        let sample = dice.choose(samples);
        let (content, how) = mutate::damage(&sample.files[&sample.damaged], sample.syntax, &mut dice);
        let case = self.of(sample, &content, folder.to_path_buf());
        let trials: Vec<_> = sample.commands.iter().map(|command| (*command, case.run(command))).collect();
        let mut tally = self.tally.lock().unwrap();
        let counts = tally.kinds.entry(kind).or_default();
        counts.inputs += 1;
        for (_, trial) in &trials {
            counts.runs += 1;
            counts.faults += trial.faults.len() as u64;
            *counts.codes.entry(trial.code.unwrap_or(-1)).or_default() += 1;
        }
        for (command, trial) in &trials {
            tally.peak_kib = tally.peak_kib.max(trial.peak_kib);
            tally.slowest = tally.slowest.max(trial.seconds);
            for fault in &trial.faults {
                let key = (fault.what, shape(&fault.seen));
                let entry = tally.faults.entry(key).or_default();
                entry.0 += 1;
                if entry.1.len() < EXAMPLES {
                    let kept = self.keep(number, &case, command, &how, fault);
                    entry.1.push(format!(
                        "case {number}, {}, {how}\n    {command}\n    {}",
                        sample.name,
                        kept.display()
                    ));
                }
            }
        }
    }

    /// Runs every command that reads a file while it changes, and counts how many ended with each code.
    fn changing(&self, folder: &Path) {
        let begun = Instant::now();
        let mut dice = Dice::new(self.seed, u64::MAX);
        let of_kind = |(kind, name): &(&str, &str)| {
            let (_, samples) = self.corpus.kinds.iter().find(|(found, _)| found == kind).unwrap();
            let wanted: Vec<&Sample> = samples.iter().filter(|s| s.name.contains(name)).collect();
            assert!(!wanted.is_empty(), "{kind}: {name}");
            wanted
        };
        for sample in CHANGING.iter().flat_map(of_kind) {
            let whole = &sample.files[&sample.damaged];
            let others: Vec<Vec<u8>> = (0..8).map(|_| mutate::damage(whole, sample.syntax, &mut dice).0).collect();
            let case = self.of(sample, whole, folder.to_path_buf());
            for command in &sample.commands {
                if begun.elapsed().as_secs_f64() > CHANGING_SECONDS {
                    return;
                }
                let trial = case.run_changing(command, &others);
                let mut tally = self.tally.lock().unwrap();
                let counts = tally.kinds.entry("changing files").or_default();
                counts.inputs += 1;
                counts.runs += 1;
                counts.faults += trial.faults.len() as u64;
                *counts.codes.entry(trial.code.unwrap_or(-1)).or_default() += 1;
                for fault in &trial.faults {
                    let entry = tally.faults.entry((fault.what, shape(&fault.seen))).or_default();
                    entry.0 += 1;
                    entry.1.push(format!("{} that changes: {command}", sample.name));
                }
            }
        }
    }

    /// Keeps the input with the command that shows the fault.
    fn keep(&self, number: u64, case: &Case, command: &str, how: &str, fault: &Fault) -> PathBuf {
        let folder = self.keep.join(format!("case-{number}"));
        for (name, bytes) in &case.sample.files {
            let path = folder.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, if *name == case.sample.damaged { case.content } else { bytes }).unwrap();
        }
        let (words, _) = case.words(command);
        let text = format!(
            "{}\n{how}\ncumulo {}\nnot so: {}\n{}\nFUZZ_SEED={} FUZZ_CASE={number} repeats it.\n\n",
            case.sample.name,
            words.join(" "),
            fault.what,
            fault.seen,
            self.seed
        );
        let notes = folder.join("fault.txt");
        let before = std::fs::read_to_string(&notes).unwrap_or_default();
        std::fs::write(notes, before + &text).unwrap();
        folder
    }
}

/// A message without what differs from case to case: numbers, and all behind the first line.
fn shape(seen: &str) -> String {
    let line = seen.lines().next().unwrap_or_default();
    let mut shape = String::new();
    for c in line.chars().filter(|c| !c.is_control()).take(160) {
        if !c.is_ascii_digit() {
            shape.push(c);
        } else if !shape.ends_with('#') {
            shape.push('#');
        }
    }
    shape
}

fn takes_max_memory(command: &str) -> bool {
    let out = Command::new(program()).args([command, "--help"]).output().unwrap();
    String::from_utf8_lossy(&out.stdout).contains("--max-memory")
}

fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            all.extend(contents(&path));
        } else {
            all.insert(path.clone(), std::fs::read(&path).unwrap());
        }
    }
    all
}

#[test]
fn damaged_inputs_are_read_or_refused() {
    // The limit of memory is the whole process's, and the commands' that other tests start.
    if !alone("fuzz::damaged_inputs_are_read_or_refused") {
        return;
    }
    let number = |key: &str| std::env::var(key).ok().map(|v| v.parse::<u64>().unwrap_or_else(|e| panic!("{key}: {e}")));
    let (inputs, seed) = (number("FUZZ_INPUTS").unwrap_or(INPUTS), number("FUZZ_SEED").unwrap_or(SEED));
    let (_, most) = Resource::DATA.get().unwrap();
    Resource::DATA.set(DATA.min(most), most).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let sound = folder.path().join("sound");
    std::fs::create_dir(&sound).unwrap();
    let corpus = Corpus::new(&sound);
    let before = contents(&sound);
    let keep = std::env::var_os("FUZZ_KEEP")
        .map_or_else(|| Path::new(env!("CARGO_TARGET_TMPDIR")).join("fuzz"), PathBuf::from);
    let round = Round {
        seed,
        keep: keep.join(format!("seed-{seed}")),
        compare_has_cap: takes_max_memory("compare"),
        corpus: &corpus,
        tally: Mutex::default(),
    };
    let begun = Instant::now();
    round.sound_inputs(&folder.path().join("whole"));
    if let Some(case) = number("FUZZ_CASE") {
        round.case(case, &folder.path().join("case"));
    } else {
        let from = number("FUZZ_FROM").unwrap_or(0);
        let next = AtomicU64::new(from);
        let workers = std::thread::available_parallelism().map_or(1, usize::from);
        std::thread::scope(|scope| {
            for worker in 0..workers {
                let (next, round, folder) = (&next, &round, folder.path().join(format!("case-{worker}")));
                scope.spawn(move || {
                    loop {
                        let case = next.fetch_add(1, Ordering::Relaxed);
                        if case >= from + inputs {
                            break;
                        }
                        round.case(case, &folder);
                        if (case + 1).is_multiple_of(SAYS) {
                            println!("{} inputs after {:.0} s", case + 1, begun.elapsed().as_secs_f64());
                        }
                    }
                });
            }
        });
    }
    if number("FUZZ_CASE").is_none() {
        round.changing(&folder.path().join("changing"));
    }
    let tally = round.tally.into_inner().unwrap();
    let summary = tally.summary(seed, begun.elapsed().as_secs_f64(), &round.keep);
    println!("{summary}");
    assert!(contents(&sound) == before, "a command changed a sound input");
    assert!(tally.faults.is_empty(), "{} kinds of faults, which stand above", tally.faults.len());
    // Damage that nothing notices would test nothing.
    let whole = number("FUZZ_CASE").is_none() && tally.runs() > 100;
    assert!(!whole || tally.refused() * 5 > tally.runs(), "too few inputs are refused: {summary}");
}

/// Arcs of stages that lead to no layer are told of by every command, and none keeps a command from ending.
#[test]
fn references_lead_to_layers_or_are_refused() {
    let number = |key: &str| std::env::var(key).ok().map(|v| v.parse::<u64>().unwrap_or_else(|e| panic!("{key}: {e}")));
    let (inputs, seed) = (number("FUZZ_INPUTS").unwrap_or(INPUTS), number("FUZZ_SEED").unwrap_or(SEED));
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe.usd");
    for name in ["pipe.usd", "pipe.usdz"] {
        assert!(Command::new("mkfifo").arg(folder.path().join(name)).status().unwrap().success());
    }
    let cube = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/cube.vdb")).unwrap();
    let mut counts = BTreeMap::new();
    for case in 0..inputs.div_ceil(INPUTS_PER_STAGE) {
        let (sample, arcs) = references::sample(&mut Dice::new(seed, case), &pipe, &cube);
        *counts.entry(format!("{arcs:?}")).or_insert(0) += 1;
        let content = &sample.files[&sample.damaged];
        let folder_of_case = folder.path().join("case");
        let case =
            Case { folder: folder_of_case, sample: &sample, content, sound: folder.path(), compare_has_cap: true };
        for command in references::COMMANDS {
            let trial = case.run(command);
            assert!(trial.faults.is_empty(), "{command}: {}: {:?}", sample.name, trial.faults);
            let checks = command.starts_with("validate") || command.starts_with("usd lint");
            let fits = match (arcs, trial.code) {
                (Arcs::Whole, Some(code)) => code == 0 || command.starts_with("usd lint"),
                (Arcs::Broken, Some(code)) => code == 2 || (checks && code == 1),
                (Arcs::Circular, Some(code)) => (0..=2).contains(&code),
                (_, None) => false,
            };
            assert!(fits, "{command}: {}: {arcs:?} and exit code {:?}", sample.name, trial.code);
        }
    }
    println!("{counts:?}");
    assert!(inputs < INPUTS || counts.len() == 3, "{counts:?}");
}

/// Inputs of every option against outputs: whatever is paired, the input stays and the command says so.
#[test]
fn inputs_of_every_option_are_spared() {
    let number = |key: &str| std::env::var(key).ok().map(|v| v.parse::<u64>().unwrap_or_else(|e| panic!("{key}: {e}")));
    let (inputs, seed) = (number("FUZZ_INPUTS").unwrap_or(INPUTS), number("FUZZ_SEED").unwrap_or(SEED));
    let work = replaced::prepared();
    let before = work.files("in");
    for trial in 0..inputs / 8 {
        let mut dice = Dice::new(seed, trial);
        let case = dice.choose(&replaced::ALL);
        let (input, output) = (*dice.choose(case.inputs), *dice.choose(case.outputs));
        let spelling = *dice.choose(&[replaced::Spelling::Symbolic, replaced::Spelling::Hard]);
        replaced::refused(&work, case, input, output, spelling);
    }
    assert!(work.files("in") == before, "an input has changed");
}
