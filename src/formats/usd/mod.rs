//! Stages of Universal Scene Description (USD): `.usda`, `.usdc`, `.usd` and `.usdz`.
//!
//! The crate `openusd` parses layers and composes sublayers, references, payloads, inherits and variants;
//! [`Stage`] holds what they compose to. World space is the stage's: its units and axes as authored. Cameras, lights and
//! volumes come from the same stage, so that nothing is turned or scaled.
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

mod attribute;
mod camera;
mod convert;
pub mod fields;
mod light;
pub mod lint;
mod medium;
mod prim;
mod read;
mod resolver;
pub mod scene;
mod stage;
mod text;
mod value;
mod volume;
pub mod write;
mod xform;

pub use attribute::Attribute;
pub use prim::Prim;
pub use stage::{Stage, StageMetadata, UpAxis};
pub use value::{Asset, MOST_ELEMENTS, Value};
pub use volume::{Field, Role};
