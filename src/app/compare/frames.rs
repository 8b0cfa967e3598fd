//! Comparison of two sequences.

use super::CompareSettings;
use super::figures::{Gauge, SequencesReport};
use super::page::Gallery;
use super::traits::Matched;
use crate::app::Context;
use crate::app::failed::Failed;
use crate::app::frame_loop::{FrameLoop, parted};
use crate::app::outputs;
use crate::app::provenance::Provenance;
use crate::app::sequence::{Sequence, common};
use crate::error::{Error, Result};
use crate::formats::exr;
use crate::formats::limits::Limits;
use crate::formats::registry::EXR;
use crate::metrics::Comparison;
use crate::scene::film::Film;
use crate::text::ranges;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A comparison of sequences at work.
struct Work<'w> {
    settings: &'w CompareSettings,
    /// Sequences, of which the last is the reference and the one before it is compared; one beside it may precede both.
    sequences: Vec<&'w Sequence>,
    first: Gauge,
    other: Gauge,
    gallery: Gallery,
    /// Frames by what they differ in beside their samples, and whether the samples of any differ.
    apart: BTreeMap<String, Vec<u32>>,
    differ: bool,
}

impl CompareSettings {
    /// Compares two sequences frame by frame. A frame that cannot be read or compared does not stop the others.
    ///
    /// # Errors
    /// If they have no frame in common, none can be compared, or the report cannot be written.
    pub(super) fn sequences(&self, [a, b]: [&Sequence; 2], context: &Context) -> Result<SequencesReport> {
        if self.heatmap.is_some() {
            return Err(Error::invalid("⟨heatmap⟩: a sequence has many differences")
                .hint("compare one frame of it, or show them all with ⟨report⟩"));
        }
        let provenance = Provenance::begin(context);
        let beside = self.beside.as_ref().map(|path| {
            self.frames.sequence(path, EXR.endings)?.ok_or_else(|| {
                Error::invalid("⟨beside⟩: this names no sequence").at(path).hint("give a name such as 'noisy.####.exr'")
            })
        });
        let beside = beside.transpose()?;
        let sequences: Vec<&Sequence> = beside.iter().chain([a, b]).collect();
        let (both, left_out) = common(&sequences);
        if both.is_empty() {
            return Err(Error::invalid("the sequences have no frame in common")
                .at(&self.a)
                .hint("frames are matched by their numbers"));
        }
        if let Some(dir) = &self.report {
            outputs::report_folder(dir)?;
        }
        let gauge = || Gauge::new(self.space(), self.flip);
        let (first, other, gallery) = (gauge(), gauge(), Gallery::new(both.len()));
        let apart = BTreeMap::new();
        let mut work = Work { settings: self, sequences, first, other, gallery, apart, differ: false };
        let failed = work.all(&both, context)?;
        let Work { first, other, gallery, apart, differ, .. } = work;
        let beside = beside.map(|_| other.closed());
        // A frame that one sequence lacks is a difference, as it is for `diff`.
        let differ = differ || !left_out.is_empty() || !apart.is_empty();
        let listed = |(what, frames): (String, Vec<u32>)| format!("frames {}: {what}", ranges(frames));
        let differences = apart.into_iter().map(listed).collect();
        let mut report =
            SequencesReport { all: first.closed(), beside, left_out, failed, differ, differences, report: None };
        if let Some(dir) = self.report.as_ref().filter(|_| !report.all.frames.is_empty()) {
            let mut page = gallery.page([&self.a, &self.b], self.beside.as_deref(), self.space(), &report)?;
            page.provenance(&provenance.rows());
            report.report = Some(page.write(dir)?);
        }
        Ok(report)
    }
}

impl CompareSettings {
    /// Reads the pictures of a frame, the reference last.
    fn read(&self, paths: &[PathBuf], limits: Limits) -> Result<Vec<Matched>> {
        let [others @ .., reference] = paths else { return Ok(Vec::new()) };
        others.iter().try_for_each(|path| self.check_memory([path, reference], limits).map(drop))?;
        let header = exr::header(reference)?;
        paths.iter().map(|path| Matched::read(path, &header, self.layer.as_deref(), limits)).collect()
    }
}

/// Returns the paths of a frame's pictures.
fn paths(sequences: &[&Sequence], number: u32) -> Vec<PathBuf> {
    sequences.iter().map(|sequence| sequence.path(number)).collect()
}

impl Work<'_> {
    /// Reads and compares the frames, and returns those that failed.
    fn all(&mut self, numbers: &[u32], context: &Context) -> Result<Vec<Failed>> {
        let (settings, sequences) = (self.settings, self.sequences.clone());
        let read = |number, limits| settings.read(&paths(&sequences, number), limits);
        let compare = |at, number, pictures: Vec<Matched>| self.frame(at, number, &pictures, context);
        let frames = FrameLoop::steps(numbers, "compare", context).telling();
        Ok(parted(frames.in_order_of(settings.limits, read, compare)?).1)
    }

    /// Compares a frame at its place in the sequence.
    fn frame(&mut self, at: usize, number: u32, pictures: &[Matched], context: &Context) -> Result<()> {
        let paths = paths(&self.sequences, number);
        let films: Vec<&Film> = pictures.iter().map(|picture| &picture.film).collect();
        let reference = films.len() - 1;
        let add = |gauge: &mut Gauge, which: usize| -> Result<Comparison> {
            let named = |e: Error| e.part(format!("{} and {}", paths[which].display(), paths[reference].display()));
            gauge.add(number, [films[which], films[reference]]).map_err(named)
        };
        // A frame counts in both comparisons or in none: one of another size is refused before either.
        let size = |film: &Film| [film.width, film.height];
        if reference == 2 && size(films[0]) == size(films[1]) {
            add(&mut self.other, 0)?;
        } else if reference == 2 {
            let odd = usize::from(size(films[0]) == size(films[2]));
            return add(&mut self.other, odd).map(drop);
        }
        let c = add(&mut self.first, reference - 1)?;
        self.differ |= !c.within(self.settings.tolerance);
        for difference in &pictures[reference - 1].differences {
            self.apart.entry(difference.clone()).or_default().push(number);
        }
        for converted in pictures.iter().filter_map(|picture| picture.converted.as_ref()) {
            context.note(format!("colors are converted {converted}"));
        }
        if self.settings.report.is_some() {
            self.gallery.add(at, number, &films, c.psnr_db);
        }
        Ok(())
    }
}
