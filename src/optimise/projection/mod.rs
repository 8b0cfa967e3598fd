//! Pictures as linear equations of optical depths and of emissions.

pub mod depth_map;
pub mod depths;
pub mod emission;
pub mod observation;
pub mod photo;
pub mod plane;
pub mod projector;
pub mod silhouette;
pub mod transmittances;
