//! Light on its way through the scene.

pub mod dvr;
pub mod film;
pub mod march;
pub mod quadrature;
