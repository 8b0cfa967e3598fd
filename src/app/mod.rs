//! The use cases: what the program does, whoever asks for it.
//!
//! Each one has plain settings with a method `run(&self, &Context) -> Result<Report>`. The [`Context`] tells who
//! watches the work and what stops it. A use case knows no command line: the face that runs it makes the settings,
//! shows the progress and words the report and the errors. A process has one face, as it has one language:
//!
//! ```standalone_crate
//! use cumulo::prelude::*;
//! use cumulo::wording::{Mention, speak_as};
//!
//! speak_as(|Mention { setting, .. }| Some(format!("'{}'", setting.replace('_', " "))));
//! let error = PoseSettings { iterations: 0, ..PoseSettings::default() }.run(&Context::default()).unwrap_err();
//! assert!(error.to_string().starts_with("'iterations' is 0"), "{error}");
//! ```

pub mod arrays;
pub mod capture;
pub mod checks;
pub mod compare;
pub mod context;
pub mod convert;
pub mod denoise;
pub(crate) mod depths;
pub mod diff;
pub(crate) mod earlier;
pub mod failed;
pub mod failure;
pub mod figure;
pub(crate) mod frame_loop;
pub mod function;
pub mod gradient;
pub mod info;
pub mod inputs;
pub mod job;
pub mod motion;
pub mod outputs;
pub mod paths;
pub mod photos;
pub(crate) mod pictured;
pub mod pictures;
pub mod plan;
pub mod pose;
pub mod progress;
pub mod provenance;
mod ranges;
pub mod reconstruct;
pub mod render;
pub mod renewed;
pub mod report;
pub mod run;
pub mod scan;
pub mod selftest;
pub mod sequence;
pub mod statistics;
pub mod study;
pub(crate) mod suggestion;
pub(crate) mod task;
pub mod transfer;
pub mod up;
pub mod usd;
mod use_case;
pub mod validate;
pub mod view;
pub mod viewpoint;
pub mod volume;

pub use context::Context;
pub use use_case::{Report, Status, UseCase};
