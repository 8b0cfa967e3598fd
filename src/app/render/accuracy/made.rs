//! A picture as its replicates: what it is joined with others by, and goes on from.

use super::Streams;
use crate::error::{Error, Result};
use crate::formats::exr::{self, Attributes, Placement, deep};
use crate::formats::limits::Limits;
use crate::render::film::{Aov, PixelSums, Replicates};
use crate::scene::film::Film;
use std::path::Path;

/// Attribute of the hash of what a picture shows: pictures of the same one have the same expected values.
pub(in crate::app::render) const SCENE: &str = "cumulo:scene";
/// Attribute of the numbers of a picture's replicates.
pub(in crate::app::render) const REPLICATES: &str = "cumulo:replicates";
/// Attribute of the paths per pixel of a picture that is one replicate.
pub(in crate::app::render) const SAMPLES: &str = "cumulo:samples";
/// Attribute of a picture that was stopped before it was done.
pub(in crate::app::render) const STOPPED: &str = "cumulo:stopped";

/// A picture as its replicates.
pub(in crate::app::render) struct Made {
    pub replicates: Replicates,
    pub streams: Streams,
}

/// A picture that was read.
pub(in crate::app::render) struct Read {
    pub made: Made,
    pub attributes: Attributes,
    pub placement: Placement,
}

/// True if a picture is what its sums over replicates make it.
fn agree(film: &Film, sums: &[PixelSums]) -> bool {
    let colors = film.rgba.iter().zip(sums).all(|(rgba, sums)| *rgba == sums.mean().map(|v| v as f32));
    let counts = film.plane("Debug Sample Count.X");
    colors && counts.is_none_or(|counts| counts.iter().zip(sums).all(|(count, sums)| *count == sums.paths as f32))
}

/// Error that a picture is not as it was rendered.
fn edited(why: &str) -> Error {
    Error::invalid(format!("another program has changed this picture: {why}"))
        .hint("give pictures as `cumulo render` or `cumulo merge` wrote them")
}

impl Made {
    /// Begins a picture of this width and height with planes beside RGBA.
    pub(in crate::app::render) fn new(size: [usize; 2], aovs: &[Aov]) -> Self {
        Self { replicates: Replicates::new(size, aovs), streams: Streams::default() }
    }

    /// Reads a picture that keeps its sums over replicates, or is one replicate.
    ///
    /// # Errors
    /// If the file cannot be read, or is no such picture.
    pub(in crate::app::render) fn read(path: &Path, limits: Limits) -> Result<Read> {
        deep::refuse(path)?;
        let header = exr::header(path)?;
        let attributes = header.attributes();
        let Some(stated) = attributes.get(REPLICATES) else {
            return Err(Error::invalid("this picture states no replicates: `cumulo render` did not make it by paths")
                .at(path)
                .hint("give pictures that `cumulo render` or `cumulo merge` wrote as OpenEXR"));
        };
        let streams: Streams = stated.parse().map_err(|e: String| Error::invalid(e).at(path))?;
        let (mut film, placement) = exr::read_part_within(path, limits)?;
        let sums = PixelSums::take(&mut film).map_err(|e| e.at(path))?;
        let samples = attributes.get(SAMPLES).and_then(|samples| samples.parse().ok());
        let sums = match (sums, samples) {
            (Some(sums), _) => {
                if !agree(&film, &sums) {
                    return Err(edited("its colors or its numbers of paths are not those of its sums").at(path));
                }
                sums
            }
            (None, Some(samples)) => {
                if !header.is_of_floats() || film.rgba.iter().flatten().any(|v| !v.is_finite()) {
                    return Err(edited("its R, G, B and A are not all finite numbers of 32 bits").at(path));
                }
                film.rgba.iter().map(|rgba| PixelSums::of(samples, *rgba)).collect()
            }
            (None, None) => {
                return Err(Error::invalid("this picture does not keep the sums over its replicates")
                    .at(path)
                    .hint("render it with ⟨replicates⟩, or with ⟨aov=replicates⟩"));
            }
        };
        let count = streams.count();
        if let Some(sums) = sums.iter().find(|sums| sums.replicates > count) {
            let found = sums.replicates;
            return Err(Error::invalid(format!("a pixel has {found} replicates, and the picture states {count}"))
                .at(path)
                .hint("render the picture again"));
        }
        let variance = film.plane("variance.R").is_some();
        let aovs: &[Aov] = if variance { &[Aov::Variance] } else { &[] };
        let replicates = Replicates::of_sums([film.width, film.height], aovs, sums, count).map_err(|e| e.at(path))?;
        Ok(Read { made: Self { replicates, streams }, attributes, placement })
    }

    /// Adds the replicates of another picture.
    ///
    /// # Errors
    /// If its size is another, or it has a replicate that this one has.
    pub(in crate::app::render) fn merge(&mut self, other: &Self) -> Result<()> {
        self.streams.add(&other.streams)?;
        self.replicates.merge(&other.replicates)
    }
}
