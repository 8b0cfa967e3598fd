//! Motion of an object while the shutter of a camera is open.

use crate::error::{Error, Result};
use glam::DMat4;

/// Object that moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Object {
    /// A volume, by its number.
    Volume(usize),
    /// A mesh, by its number.
    Mesh(usize),
}

/// Motion of an object: maps from its space to the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Object that moves.
    pub object: Object,
    /// Maps as the shutter opens, halfway, and as it closes.
    pub maps: [DMat4; 3],
}

impl Motion {
    /// Returns the motion if its maps can be used.
    ///
    /// # Errors
    /// If one is not finite or cannot be inverted.
    pub fn checked(self) -> Result<Self> {
        let sound = |map: &DMat4| map.is_finite() && map.determinant().abs() > 0.0 && map.inverse().is_finite();
        if self.maps.iter().all(sound) {
            return Ok(self);
        }
        Err(Error::invalid("a matrix of its motion cannot be inverted")
            .hint("correct 'transform_start' and 'transform_end'"))
    }

    /// Returns the map that takes world points of the object, halfway, to where they are at a time from 0, as the
    /// shutter opens, to 1, as it closes. Places and scales change evenly before the middle and after it, and axes turn
    /// evenly.
    pub(crate) fn at(&self, time: f64) -> DMat4 {
        let [start, middle, end] = self.maps;
        let map = if time < 0.5 { between(start, middle, 2.0 * time) } else { between(middle, end, 2.0 * time - 1.0) };
        map * middle.inverse()
    }
}

/// Returns the map on the way from one to another.
fn between(from: DMat4, to: DMat4, share: f64) -> DMat4 {
    let parts = [from, to].map(|map| map.to_scale_rotation_translation());
    let [a, b] = parts.map(|(scale, turn, place)| DMat4::from_scale_rotation_translation(scale, turn, place));
    let is_plain = |parts: DMat4, whole: DMat4| {
        parts.abs_diff_eq(whole, 1e-9 * whole.to_cols_array().map(f64::abs).into_iter().fold(0.0, f64::max))
    };
    if !(is_plain(a, from) && is_plain(b, to)) {
        // Shears have no axes that turn.
        return from + (to - from) * share;
    }
    let [(scale, turn, place), (other_scale, other_turn, other_place)] = parts;
    DMat4::from_scale_rotation_translation(
        scale.lerp(other_scale, share),
        turn.slerp(other_turn, share),
        place.lerp(other_place, share),
    )
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn objects_turn_about_themselves() {
        let map = |turn: f64, x: f64| {
            DMat4::from_scale_rotation_translation(
                DVec3::new(2.0, 1.0, 1.0),
                DQuat::from_rotation_z(turn),
                DVec3::new(10.0 + x, 0.0, 0.0),
            )
        };
        let motion = Motion { object: Object::Mesh(0), maps: [map(-0.4, -1.0), map(0.0, 0.0), map(0.8, 1.0)] };
        let motion = motion.checked().unwrap();
        assert!(motion.at(0.5).abs_diff_eq(DMat4::IDENTITY, 1e-12));
        for (time, turn, x) in [(0.0, -0.4, -1.0), (0.25, -0.2, -0.5), (0.75, 0.4, 0.5), (1.0, 0.8, 1.0)] {
            assert!((motion.at(time) * map(0.0, 0.0)).abs_diff_eq(map(turn, x), 1e-12), "{time}");
        }
        let flat = DMat4::from_scale(DVec3::new(1.0, 0.0, 1.0));
        assert!(Motion { maps: [map(0.0, 0.0), flat, flat], ..motion }.checked().is_err());
    }
}
