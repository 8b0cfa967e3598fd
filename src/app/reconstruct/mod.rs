//! Volumes and transfer functions from pictures of many views.

mod capture;
pub mod color;
mod confidence;
pub mod density;
mod density_solver;
mod forecast;
mod job;
pub mod page;
pub mod plan;
pub mod refinement;
pub mod region;
mod sample;
mod stages;
pub mod transfer;
pub mod transfer_run;
mod volume;

pub use color::ColorSettings;
pub use density::DensitySettings;
pub use plan::{CapturePlan, CapturePlanSettings, ScalingSettings};
pub use refinement::RefinementSettings;
pub use region::RegionSettings;
pub use transfer::TransferFunctionSettings;
pub use transfer_run::TransferRun;
