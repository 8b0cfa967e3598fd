//! Settings of commands whose settings are not plain yet, by the words of their command line.

use super::output::Output;
use crate::app::provenance::Provenance;

/// Options that say how to work, on which results do not depend.
const MANNER: [&str; 7] = ["--resume", "--overwrite", "--quiet", "-q", "--verbose", "-v", "--json"];

/// Returns the words of a command without the program's name and without those that choose frames or say how to work.
fn settings(command: &str) -> Vec<&str> {
    words(command, &MANNER, &["--frames", "--threads", "--max-memory", "--progress"])
}

/// Returns the words of a command without the program's name, without `flags`, and without options and their `values`.
fn words<'c>(command: &'c str, flags: &[&str], values: &[&str]) -> Vec<&'c str> {
    let mut words = command.split(' ').skip(1);
    let mut kept = Vec::new();
    while let Some(word) = words.next() {
        let (name, value) = word.split_once('=').map_or((word, None), |(name, value)| (name, Some(value)));
        if values.contains(&name) {
            if value.is_none() {
                words.next();
            }
        } else if !flags.contains(&word) {
            kept.push(word);
        }
    }
    kept
}

/// Begins the provenance of a use case whose settings are the words of its command line.
pub(super) fn provenance(use_case: &str, output: &Output) -> Provenance {
    let provenance = Provenance::begin(output);
    let settings = settings(&provenance.command).iter().map(|word| (*word).to_owned()).collect::<Vec<_>>();
    provenance.of(use_case, &settings, &[])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_and_threads_are_no_settings() {
        let a = settings("cumulo render a.vdb --frames 1-3 --threads 2 --resume -o b");
        assert_eq!(a, settings("/bin/cumulo render a.vdb --frames=4 -o b --json"));
        assert_ne!(a, settings("cumulo render a.vdb -o c"));
        assert_eq!(a, settings("cumulo render a.vdb -o b -v --max-memory 2GiB --progress json"));
    }
}
