//! The library's readers and writers: VDB, NanoVDB, USD, OpenEXR, images of scanners and microscopes, captures. What is
//! written is read back, what other programs write is understood, and what is damaged is refused.
//!
//! No test here changes or measures what the whole process shares; such tests belong in `process`.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a panic is how a test fails"
)]

#[allow(dead_code, reason = "each program uses its own part")]
#[path = "../common/mod.rs"]
mod common;

mod captures;
mod deep;
mod dicom;
mod exr;
mod imaging;
mod nanovdb;
mod registry;
mod remedies;
mod transforms;
mod usd;
mod usd_semantics;
mod vdb_damage;
mod vdb_real;
mod vdb_roundtrip;
mod zarr;
