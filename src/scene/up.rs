//! The axis of a world that points upwards.

use glam::{DMat3, DMat4, DVec3};

/// Axis that points upwards: Houdini and Maya work Y-up, Blender and this program's orbits by default Z-up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, schemars::JsonSchema)]
pub enum Up {
    /// +Y is up.
    Y,
    /// +Z is up.
    #[default]
    Z,
}

impl Up {
    /// Unit vector that points upwards.
    pub fn vector(self) -> DVec3 {
        match self {
            Self::Y => DVec3::Y,
            Self::Z => DVec3::Z,
        }
    }

    /// Name of the axis.
    pub fn name(self) -> &'static str {
        match self {
            Self::Y => "Y",
            Self::Z => "Z",
        }
    }

    /// Returns Z for Y, and Y for Z.
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::Y => Self::Z,
            Self::Z => Self::Y,
        }
    }

    /// Rotation that takes a world with this axis upwards to one with `to` upwards: the quarter turn about x of
    /// (x, y, z) to (x, -z, y) from Y to Z, its inverse from Z to Y, and the identity between equal axes. Entries are
    /// 0, 1 and -1, so that products with them are exact.
    pub fn turn(self, to: Self) -> DMat3 {
        match (self, to) {
            (Self::Y, Self::Z) => DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
            (Self::Z, Self::Y) => DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y),
            (Self::Y, Self::Y) | (Self::Z, Self::Z) => DMat3::IDENTITY,
        }
    }

    /// The rotation of [`Up::turn`] as a map of positions.
    pub fn turn_map(self, to: Self) -> DMat4 {
        DMat4::from_mat3(self.turn(to))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_take_up_to_up_and_undo_each_other() {
        let v = DVec3::new(1.0, 2.0, 3.0);
        assert_eq!(Up::Y.turn(Up::Z) * v, DVec3::new(1.0, -3.0, 2.0));
        assert_eq!(Up::Z.turn(Up::Y) * v, DVec3::new(1.0, 3.0, -2.0));
        for (from, to) in [(Up::Y, Up::Z), (Up::Z, Up::Y), (Up::Y, Up::Y), (Up::Z, Up::Z)] {
            let turn = from.turn(to);
            assert_eq!(turn * from.vector(), to.vector());
            assert_eq!(to.turn(from) * turn, DMat3::IDENTITY);
            assert_eq!(turn.determinant(), 1.0);
        }
    }
}
