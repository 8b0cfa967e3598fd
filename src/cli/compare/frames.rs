//! Comparison of two sequences.

use super::Arguments;
use super::figures::{Gauge, Report};
use super::page::Gallery;
use crate::cli::output::Output;
use crate::cli::provenance::Provenance;
use crate::cli::report;
use crate::error::{Error, Result};
use crate::formats::exr;
use crate::formats::sequence::Pattern;
use crate::scene::film::Film;
use std::path::PathBuf;
use std::process::ExitCode;

/// Compares two sequences frame by frame.
///
/// # Errors
/// If they have no frame in common, a frame cannot be read or compared, or the report cannot be written.
pub fn run(arguments: &Arguments, [a, b]: [&Pattern; 2], output: &Output) -> Result<ExitCode> {
    if arguments.heatmap.is_some() {
        return Err(Error::invalid("--heatmap: a sequence has many differences")
            .hint("compare one frame of it, or show them all with --report"));
    }
    let provenance = Provenance::begin();
    let beside = arguments.beside.as_ref().map(|path| {
        Pattern::parse(path).ok_or_else(|| {
            Error::invalid("--beside: this names no sequence").at(path).hint("give a name such as 'noisy.####.exr'")
        })
    });
    let beside = beside.transpose()?;
    let patterns: Vec<&Pattern> = beside.iter().chain([a, b]).collect();
    let numbers = patterns.iter().map(|pattern| pattern.numbers()).collect::<Result<Vec<_>>>()?;
    let mut union: Vec<u32> = numbers.concat();
    union.sort_unstable();
    union.dedup();
    let (both, left_out): (Vec<u32>, Vec<u32>) =
        union.into_iter().partition(|number| numbers.iter().all(|list| list.binary_search(number).is_ok()));
    if both.is_empty() {
        return Err(Error::invalid("the sequences have no frame in common")
            .at(&arguments.a)
            .hint("frames are matched by their numbers"));
    }
    if let Some(dir) = &arguments.report {
        report::prepare(dir)?;
    }
    let bar = output.progress(both.len() as u64, "compare");
    let gauge = || Gauge::new(arguments.space(), arguments.flip);
    let (mut first, mut other, mut gallery) = (gauge(), gauge(), Gallery::new(both.len()));
    let mut differ = false;
    for (at, number) in both.into_iter().enumerate() {
        let paths: Vec<PathBuf> = patterns.iter().map(|pattern| pattern.path(number)).collect();
        let films = films(arguments, &paths)?;
        let films: Vec<&Film> = films.iter().collect();
        let reference = films.len() - 1;
        let add = |gauge: &mut Gauge, which: usize| {
            let named = |e: Error| e.part(format!("{} and {}", paths[which].display(), paths[reference].display()));
            gauge.add(number, [films[which], films[reference]]).map_err(named)
        };
        if reference == 2 {
            add(&mut other, 0)?;
        }
        let c = add(&mut first, reference - 1)?;
        differ |= !c.within(arguments.tolerance);
        if arguments.report.is_some() {
            gallery.add(at, number, &films, c.psnr_db);
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let beside = beside.map(|_| other.closed());
    let mut report = Report { all: first.closed(), beside, left_out, differ, report: None };
    if let Some(dir) = &arguments.report {
        let mut page =
            gallery.page([&arguments.a, &arguments.b], arguments.beside.as_deref(), arguments.space(), &report)?;
        page.provenance(&provenance.rows());
        report.report = Some(page.write(dir)?);
    }
    output.report(&report)?;
    Ok(if differ { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

/// Reads the pictures of a frame, of which the last is the reference.
fn films(arguments: &Arguments, paths: &[PathBuf]) -> Result<Vec<Film>> {
    let limits = arguments.memory.limits();
    let [.., reference] = paths else { return Ok(Vec::new()) };
    for path in &paths[..paths.len() - 1] {
        arguments.check_memory([path, reference], limits)?;
    }
    let layer = arguments.layer.as_deref();
    paths.iter().map(|path| Ok(exr::picture_within(path, layer, limits)?.film)).collect()
}
