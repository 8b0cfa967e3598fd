//! The program `cumulo` as its users call it: every command, what it prints and how it ends, and the pages that tell of it.
//!
//! Limits of memory and variables of the environment are those of the commands that the tests start. No test here changes
//! or measures what its own process shares; such tests belong in `process`.

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

mod accuracy;
mod aim;
mod arrays;
mod blur;
mod capture;
mod command_line;
mod compare;
mod contradictions;
mod convert_edits;
mod deep;
mod deep_render;
mod denoise;
mod diff;
mod embedded;
mod farm;
mod figure;
mod gradient;
mod guide;
mod holdout;
mod imaging;
mod info;
mod labels;
mod merge;
mod meshes;
mod nanovdb;
mod outputs;
mod own_units;
mod pictures;
mod plan;
mod pose;
#[cfg(target_os = "linux")]
mod readers_memory;
mod reconstruct;
mod reconstruct_tf;
mod render;
mod report;
mod scans;
mod scattering;
mod schemas;
mod selftest;
mod sequence;
mod sequences;
mod shell;
mod statistical;
mod study;
mod suggestion;
mod surfaces;
mod tf_color;
mod through_transfer;
mod transfer;
mod transfer_names;
mod up;
mod usd;
mod usd_author;
mod usd_lint;
mod vdb;
mod view;
mod viewpoint;
mod volume_memory;
