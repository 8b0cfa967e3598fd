//! Aperture and motion of a view's camera.

use super::keys::{Keys, missing, rows};
use crate::error::{Error, Result};
use crate::scene::blur::{Aperture, Blur, Shutter};
use serde_json::{Map, Value, json};

/// Keys of the motions as the shutter opens and closes.
const MOTIONS: [&str; 2] = ["transform_matrix_start", "transform_matrix_end"];
/// Keys of the times at which it does, in frames after that of the view.
const TIMES: [&str; 2] = ["shutter_open", "shutter_close"];

/// Returns what blurs a view.
///
/// # Errors
/// If a key cannot be used, or one is missing without which another has no meaning.
pub(super) fn blur(keys: &Keys) -> Result<Blur> {
    Ok(Blur { aperture: aperture(keys)?, shutter: shutter(keys)? })
}

fn aperture(keys: &Keys) -> Result<Option<Aperture>> {
    let Some(radius) = keys.number("aperture_radius")?.filter(|radius| *radius != 0.0) else { return Ok(None) };
    let focus = keys
        .number("focus_distance")?
        .ok_or_else(|| missing("focus_distance", "the distance along the viewing axis to what is sharp"))?;
    let blades = match keys.number("aperture_blades")?.unwrap_or(0.0) {
        blades if (0.0..=1000.0).contains(&blades) && blades.fract() == 0.0 => blades as u32,
        blades => {
            return Err(Error::invalid(format!("'aperture_blades' is {blades}; a whole number is expected"))
                .hint("give 3 or more corners of a polygon, or leave 'aperture_blades' out for a disc"));
        }
    };
    Ok(Some(Aperture {
        blades,
        rotation: keys.number("aperture_rotation")?.unwrap_or(0.0),
        ratio: keys.number("aperture_ratio")?.unwrap_or(1.0),
        ..Aperture::disc(radius, focus)
    }))
}

fn shutter(keys: &Keys) -> Result<Option<Shutter>> {
    let own = Keys { own: keys.own, shared: None };
    let [start, end] = MOTIONS.map(|key| own.matrix(key));
    match (start?, end?) {
        (None, None) => Ok(None),
        (Some(start), Some(end)) => {
            let [open, close] = TIMES.map(|key| own.number(key));
            let open = match (open?, close?) {
                (Some(open), Some(close)) if close > open => Some([open, close]),
                (Some(open), Some(close)) => {
                    return Err(Error::invalid(format!("a shutter that opens at {open} and closes at {close}"))
                        .hint("give times in frames after that of the view, the later one as 'shutter_close'"));
                }
                _ => None,
            };
            Ok(Some(Shutter { start, end, open }))
        }
        (start, _) => Err(missing(
            if start.is_some() { MOTIONS[1] } else { MOTIONS[0] },
            "the camera-to-world matrix at the other end of the time in which the shutter is open",
        )),
    }
}

/// Returns the keys of an aperture, which views may share.
pub(super) fn shared_keys(blur: &Blur) -> Map<String, Value> {
    let Some(Aperture { radius, focus, blades, rotation, ratio }) = blur.aperture else { return Map::new() };
    let disc = Aperture::disc(radius, focus);
    let entries = [
        ("aperture_radius", json!(radius), true),
        ("focus_distance", json!(focus), true),
        ("aperture_blades", json!(blades), blades != disc.blades),
        ("aperture_rotation", json!(rotation), rotation != disc.rotation),
        ("aperture_ratio", json!(ratio), ratio != disc.ratio),
    ];
    entries.into_iter().filter(|(.., written)| *written).map(|(key, value, _)| (key.to_owned(), value)).collect()
}

/// Returns the keys of a motion, which are a view's own.
pub(super) fn own_keys(blur: &Blur) -> Map<String, Value> {
    let Some(Shutter { start, end, open }) = blur.shutter else { return Map::new() };
    let motions = MOTIONS.into_iter().zip([start, end].map(rows));
    let times = open.into_iter().flat_map(|open| TIMES.into_iter().zip(open.map(|time| json!(time))));
    motions.chain(times).map(|(key, value)| (key.to_owned(), value)).collect()
}
