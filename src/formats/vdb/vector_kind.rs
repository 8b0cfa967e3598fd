//! The kind of the vectors of a grid: whether they turn with the world.

/// Meaning of a grid's vectors, as far as a turn of the world is concerned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum VectorKind {
    /// The values are directions, lengths or positions in world space, and turn with it.
    World,
    /// The values are the same however the world lies: colors, or components with respect to the grid's own axes.
    Fixed,
    /// Nothing states their kind, and the name is none of those that are known.
    Unstated,
}

/// Names of grids that hold vectors of world space by habit, in lower case.
const WORLD_NAMES: [&str; 12] = [
    "v",
    "vel",
    "velocity",
    "velocities",
    "accel",
    "acceleration",
    "force",
    "n",
    "normal",
    "gradient",
    "displacement",
    "rest",
];
/// Names of grids that hold colors by habit, in lower case.
const COLOR_NAMES: [&str; 7] = ["cd", "color", "colour", "rgb", "emission", "albedo", "scatter"];

/// Returns what a turn of the world means for the vectors of a grid: by its metadata `is_local_space` and `vector_type`
/// as OpenVDB defines them (`openvdb::VecType`), else by its name.
pub(crate) fn of(name: &str, local: bool, vector_type: Option<&str>) -> VectorKind {
    let name = name.to_ascii_lowercase();
    let base = name.split('[').next().unwrap_or_default();
    match vector_type {
        _ if local => VectorKind::Fixed,
        Some("invariant") => VectorKind::Fixed,
        Some(kind) if kind.starts_with("covariant") || kind.starts_with("contravariant") => VectorKind::World,
        _ if WORLD_NAMES.contains(&base) => VectorKind::World,
        _ if COLOR_NAMES.contains(&base) => VectorKind::Fixed,
        _ => VectorKind::Unstated,
    }
}

/// True if a grid's name is by habit that of vectors of world space, such as velocities.
pub(crate) fn is_world_name(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    name.split('[').next().is_some_and(|base| WORLD_NAMES.contains(&base))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metadata_comes_before_names() {
        for (name, local, kind, expected) in [
            ("vel", false, None, VectorKind::World),
            ("v[1]", false, None, VectorKind::World),
            ("Cd", false, None, VectorKind::Fixed),
            ("stuff", false, None, VectorKind::Unstated),
            ("vel", false, Some("invariant"), VectorKind::Fixed),
            ("Cd", false, Some("contravariant relative"), VectorKind::World),
            ("stuff", false, Some("covariant normalize"), VectorKind::World),
            ("vel", true, Some("contravariant relative"), VectorKind::Fixed),
            ("vel", false, Some("nonsense"), VectorKind::World),
        ] {
            assert_eq!(of(name, local, kind), expected, "{name} {kind:?}");
        }
    }
}
