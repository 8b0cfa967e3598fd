//! Slices of a series that hold their values in other ways than the rest of it.

use super::file::{File, Pixels};
use super::placement::{Plane, name};
use crate::error::{Error, Result};

/// Makes sure that slices hold values of one meaning, and notes what only looks as if they did not: each slice is
/// decoded and rescaled as its own file says.
///
/// # Errors
/// If low values are shown bright in some slices and dark in others, so that one of them may be inverted.
pub(crate) fn check(files: &[File], planes: &[Plane], notes: &mut Vec<String>) -> Result<()> {
    if let Some((odd, usual)) = odd(planes, |plane| files[plane.file].inverted) {
        let shown = |plane: Plane| if files[plane.file].inverted { "MONOCHROME1" } else { "MONOCHROME2" };
        return Err(Error::invalid(format!(
            "the slice {} is of {}, where others, such as {}, are of {}: its values may be inverted",
            name(files, odd),
            shown(odd),
            name(files, usual),
            shown(usual)
        ))
        .at(&files[odd.file].path)
        .hint("export the series again, or move the slice out of the folder if it is none of the series"));
    }
    if let Some((odd, usual)) = odd(planes, |plane| files[plane.file].pixels) {
        notes.push(format!(
            "{} holds {}, and other slices, such as {}, {}; each is read as its own header says, and one that differs \
             from its neighbors is to be exported again",
            name(files, odd),
            described(files[odd.file].pixels),
            name(files, usual),
            described(files[usual.file].pixels)
        ));
    }
    let rescaled = |plane: &Plane| files[plane.file].frame(plane.frame).rescaled;
    let stated = [0, 1].map(|which| planes.iter().any(|plane| rescaled(plane)[which]));
    let without: Vec<Plane> = planes.iter().filter(|plane| rescaled(plane) != stated).copied().collect();
    if let Some(first) = without.first() {
        notes.push(format!(
            "{} of {} slices, the first of them {}, lack a rescale slope or intercept that others state; a slope of 1 \
             and an intercept of 0 are taken for what is missing",
            without.len(),
            planes.len(),
            name(files, *first)
        ));
    }
    Ok(())
}

/// A slice of which something is another than of most, and one of these; none if all are alike.
fn odd<T: PartialEq>(planes: &[Plane], of: impl Fn(&Plane) -> T) -> Option<(Plane, Plane)> {
    let first = planes.first()?;
    let other = planes.iter().find(|plane| of(plane) != of(first))?;
    let like_first = planes.iter().filter(|plane| of(plane) == of(first)).count();
    Some(if 2 * like_first < planes.len() { (*first, *other) } else { (*other, *first) })
}

/// Numbers of a pixel, in words.
fn described(pixels: Pixels) -> String {
    match pixels {
        Pixels::Integer { allocated, stored, shift, signed } => {
            let sign = if signed { "signed" } else { "unsigned" };
            let last = shift + stored - 1;
            format!("{sign} integers of {stored} bits up to bit {last} of {allocated}")
        }
        Pixels::Float => "32-bit floats".into(),
        Pixels::Double => "64-bit floats".into(),
    }
}
