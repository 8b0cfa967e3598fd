//! Light from infinitely far away.

/// Radiance that arrives from infinitely far away, the same from all directions.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Environment {
    /// Radiance in red, green and blue.
    pub radiance: [f32; 3],
}
