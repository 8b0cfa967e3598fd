//! What pictures differ in beside their samples, and the conversion that makes their colors comparable.

use crate::error::Result;
use crate::formats::exr::{self, Header, Picture, deep};
use crate::formats::limits::Limits;
use crate::metrics::Comparison;
use crate::scene::film::Film;
use crate::scene::primaries::Primaries;
use crate::wording::worded;
use glam::DMat3;
use std::path::Path;

/// Advice that stands behind a conversion.
const ROUNDED: &str = "the conversion rounds to 32-bit floats: give a ⟨tolerance⟩";

/// A picture that was read to be compared with a reference.
#[derive(Debug)]
pub(super) struct Matched {
    pub film: Film,
    /// Name of the layer that was read.
    pub layer: String,
    /// Differences from the reference beside its samples, in words.
    pub differences: Vec<String>,
    /// Conversion of its colors, in words; none if they have the reference's primaries.
    pub converted: Option<String>,
}

impl Matched {
    /// Reads a layer of a picture, or a deep picture composited. Colors of other primaries are converted to those of
    /// the reference.
    ///
    /// # Errors
    /// If the picture cannot be read.
    pub(crate) fn read(path: &Path, reference: &Header, layer: Option<&str>, limits: Limits) -> Result<Self> {
        let header = exr::header(path)?;
        let mut picture = deep::picture_or_flattened(path, layer, limits)?;
        let mut differences = of_headers(&header, reference);
        let mut converted = None;
        let [from, to] = [header.primaries(), reference.primaries()];
        match conversion(from, to, &picture) {
            Conversion::None => {}
            Conversion::Matrix(matrix) => {
                picture.film.convert(matrix);
                converted = Some(format!("from primaries {from} to {to}; {}", worded(ROUNDED)));
            }
            Conversion::Unknown => {
                differences.push(format!("primaries that cannot be converted into each other: {from} and {to}"));
            }
        }
        let Picture { film, layer, .. } = picture;
        Ok(Self { film, layer, differences, converted })
    }
}

/// Conversion of colors that lets them be compared.
enum Conversion {
    /// The primaries are the same, or the layer holds no colors.
    None,
    Matrix(DMat3),
    /// The primaries of one picture span no space.
    Unknown,
}

fn conversion(from: Primaries, to: Primaries, picture: &Picture) -> Conversion {
    if !picture.is_color() || from.is_same(&to) {
        return Conversion::None;
    }
    from.matrix_to(to).map_or(Conversion::Unknown, Conversion::Matrix)
}

/// Returns what two pictures differ in by their headers. Sizes are left to the comparison, which refuses other ones.
pub(crate) fn of_headers(a: &Header, b: &Header) -> Vec<String> {
    let mut differences = Vec::new();
    if a.pixel_aspect != b.pixel_aspect {
        differences.push(format!("pixel aspect {} and {}", a.pixel_aspect, b.pixel_aspect));
    }
    if a.display_window != b.display_window && a.display_window.size == b.display_window.size {
        differences.push(format!("display window {} and {}", a.display_window, b.display_window));
    }
    differences
}

/// Returns what the samples of two pictures differ in by more than a tolerance.
pub(crate) fn of_samples(c: &Comparison, tolerance: f64) -> Vec<String> {
    let mut differences = Vec::new();
    for (what, most) in [("colors", c.max_abs), ("alpha", c.alpha_max_abs)] {
        if most > tolerance {
            differences.push(format!("{what} by up to {most:.3e}"));
        }
    }
    if c.non_finite_differences > 0 {
        differences.push(format!("{} pixels that are NaN or infinite", c.non_finite_differences));
    }
    differences
}

/// Writes a verdict: that two things agree, or what they differ in.
pub(crate) fn verdict(things: &str, differences: &[String]) -> String {
    match differences {
        [] => format!("the {things} agree"),
        all => format!("the {things} differ: {}", all.join("; ")),
    }
}
