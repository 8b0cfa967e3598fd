//! Stages of Universal Scene Description (USD): `.usda`, `.usdc`, `.usd` and `.usdz`.
//!
//! The crate `openusd` parses layers and composes sublayers, references, payloads, inherits and variants;
//! [`Stage`] holds what they compose to. World space is the stage's: its units and axes as authored. Cameras, lights
//! and volumes come from the same stage, so that nothing is turned or scaled.
//!
//! ```no_run
//! # fn main() -> cumulo::error::Result<()> {
//! use cumulo::formats::{limits::Limits, usd::Stage};
//! let stage = Stage::open("smoke.usda".as_ref(), Limits::default())?;
//! for volume in stage.of_type("Volume") {
//!     println!("{} at {}", volume.path, stage.local_to_world(volume, stage.first_time())?);
//! }
//! # Ok(())
//! # }
//! ```

mod arcs;
mod attribute;
mod binary;
mod camera;
mod capture;
mod convert;
mod copy;
mod fault;
pub(crate) mod fields;
mod inherits;
mod light;
pub(crate) mod lint;
mod medium;
mod mesh;
mod metadata;
mod own;
mod prim;
mod problems;
mod read;
mod resolver;
pub mod scene;
mod stage;
mod summary;
mod targets;
mod text;
mod unpacked;
mod value;
mod volume;
pub(crate) mod write;
mod xform;

pub(crate) use attribute::Attribute;
pub use capture::Views;
pub use fault::Fault;
pub use medium::{Overrides, ScatteringOverride};
pub use metadata::UpAxis;
pub(crate) use prim::Prim;
pub(crate) use problems::problems;
pub use stage::Stage;
pub(crate) use summary::{StageSummary, summary};
pub(crate) use value::Asset;
pub use value::Value;
pub use volume::{Field, Role};
