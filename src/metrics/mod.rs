//! How far apart two pictures or two volumes are.

pub mod volume;
