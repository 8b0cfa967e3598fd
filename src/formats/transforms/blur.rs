//! Aperture and motion of a view's camera.

use super::keys::{Keys, missing, rows};
use crate::error::{Error, Result};
use crate::scene::blur::{Aperture, Blur, Shutter};
use serde_json::{Map, Value, json};

/// Keys of the motions as the shutter opens and closes.
const MOTIONS: [&str; 2] = ["transform_matrix_start", "transform_matrix_end"];

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
        (Some(start), Some(end)) => Ok(Some(Shutter { start, end })),
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
    let motions = blur.shutter.map(|Shutter { start, end }| [start, end]);
    let entry = |(key, motion): (&str, _)| (key.to_owned(), rows(motion));
    motions.into_iter().flat_map(|motions| MOTIONS.into_iter().zip(motions).map(entry)).collect()
}
