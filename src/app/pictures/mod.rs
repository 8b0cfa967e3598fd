//! What pictures show, and from where: the subject, its cameras, media and lights, and the renderer that a plan of them
//! calls for.

mod aim;
mod between;
mod capture;
pub(in crate::app) mod colors;
mod placed;
mod remarks;
pub mod renderer;
pub mod scales;
pub mod scattering;
mod settings;
pub(in crate::app) mod settle;
mod stage;
pub(crate) mod subject;

pub use aim::AimSettings;
pub(in crate::app) use between::between;
pub(in crate::app) use capture::Cameras;
pub(in crate::app) use remarks::remarks;
pub(crate) use settings::EARLY_STOP;
pub use settings::{DensityScale, PictureSettings, PlanningSettings};
pub(crate) use stage::SIZE;
