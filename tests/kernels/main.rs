//! The library's rendering, gradients, reconstruction, transfer functions, denoiser, metrics and plan: that their figures
//! are right, stay right in hard cases, and are the same bits on every machine.
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

mod accuracy;
mod albedo_function;
mod analytic;
mod denoise;
mod determinism;
mod examples;
mod gradients;
#[cfg(all(target_arch = "x86_64", target_env = "gnu"))]
mod hashes;
mod loss;
mod meshes;
mod near_lights;
mod optimise;
mod own_units;
mod path_tracing;
mod plan;
mod plan_measured;
mod preshaded;
mod preshaded_ways;
mod specular;
mod spots;
mod stability;
mod statistical;
mod tangent;
mod transfer;
