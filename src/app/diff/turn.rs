//! Volumes that agree but for a quarter turn about x, as files with Y up and with Z up do.

use super::loaded::Loaded;
use crate::error::Result;
use crate::formats::vdb::{GridInfo, Transform};
use crate::math::{Aabb, Affine};
use crate::metrics::volume::{Difference, Effort, compare_within};
use crate::scene::up::Up;
use crate::wording::worded;
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt;

/// A turn of the second volume about x, and how far it is then from the first.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Turned {
    /// Up axis of the second volume if this is a matter of up axes; the first has the other one.
    second_up: Up,
    /// Angle of the turn about x in degrees, 90 or -90.
    degrees: i32,
    /// RMS of the difference after the turn.
    rms: f64,
    /// Largest difference after the turn.
    max_abs: f64,
}

impl fmt::Display for Turned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { second_up, degrees, rms, .. } = self;
        let (second, first) = (second_up.name(), second_up.other().name());
        let axis = first.to_ascii_lowercase();
        write!(
            f,
            "equal but for a turn of the second by {degrees} degrees about x (rms {rms:.4e} then): {first}-up against \
             {second}-up; {} turns it",
            worded(&format!("cumulo convert ⟨up={axis}⟩"))
        )
    }
}

/// Share of the RMS as the volumes lie that a turn may leave for them to count as equal but for the turn.
const LEFT_BY_TURN: f64 = 0.01;

/// Finds the quarter turn about x after which `b` agrees with `a`, of grids of scalars that differ. Volumes whose boxes
/// are not brought together by it, within a voxel, are not compared.
pub(super) fn turned(a: &Loaded, b: &Loaded, difference: &Difference, effort: Effort) -> Result<Option<Turned>> {
    if a.raw.components != 1 || difference.rms == 0.0 {
        return Ok(None);
    }
    let (Some(box_a), map) = (a.info.world_box(), b.info.affine()?) else { return Ok(None) };
    let room = a.info.affine()?.voxel_size().max(map.voxel_size()).max_element();
    for (second_up, degrees) in [(Up::Y, 90), (Up::Z, -90)] {
        let map = map.then(&Affine::new(second_up.turn_map(second_up.other()))?)?;
        let info = GridInfo { transform: Transform::Affine(map), ..b.info.clone() };
        let near = |box_b: Aabb| (box_a.min - box_b.min).abs().max((box_a.max - box_b.max).abs()).max_element() <= room;
        if !info.world_box().is_some_and(near) {
            continue;
        }
        let Difference { rms, max_abs, .. } = compare_within(&a.field()?, &b.field_at(map), effort, &|_, _| {})?;
        if rms <= LEFT_BY_TURN * difference.rms {
            return Ok(Some(Turned { second_up, degrees, rms, max_abs }));
        }
    }
    Ok(None)
}
