//! Pictures as linear equations of optical depths and of emissions.

pub mod depths;
pub mod emission;
pub mod observation;
pub mod plane;
pub mod projector;
pub mod silhouette;
