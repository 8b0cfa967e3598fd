//! Error against time on the user's own inputs: which setting reaches an error at the least cost.
//!
//! A study has candidates, each with the options that make it and a closure that runs it, and a reference that is
//! converged here, with its own uncertainty. What is measured, the front of settings that no other one beats, and the
//! page are the same for all studies; each one says which candidates there are and how their errors are found.

mod candidate;
pub mod denoise;
mod errors;
mod folder;
mod front;
pub mod gradient;
mod measurement;
mod noise;
mod options;
mod page;
mod recommendation;
pub mod reconstruct;
mod reference;
pub mod render;
mod report;
mod rounds;
mod run;
mod session;
mod table;
mod words;

pub use errors::Errors;
pub use measurement::Measurement;
pub use options::StudyOptions;
pub use recommendation::Recommendation;
pub use reference::Reference;
pub use report::StudyReport;
pub use run::Run;
