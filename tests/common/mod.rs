//! What the tests share.

pub mod fields;
pub mod grids;
pub mod images;
pub mod random;
pub mod refusal;
pub mod replaced;
pub mod scenes;
pub mod shapes;
pub mod stages;
pub mod work;
