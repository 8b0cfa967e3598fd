//! What ends processes, limits them or watches them: commands that are killed, interrupted or whose disk fails, long random
//! rounds, and tests of the library that limit or measure the memory of their own process. The latter run
//! [`alone::alone`], so that they neither disturb the other tests nor count their memory.

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

mod alone;
#[cfg(target_os = "linux")]
mod cancel;
#[cfg(target_os = "linux")]
mod damage;
mod exr_damaged;
mod faults;
#[cfg(target_os = "linux")]
mod fuzz;
#[cfg(target_os = "linux")]
mod hard_limit;
mod imaging_damaged;
mod killed;
#[cfg(target_os = "linux")]
mod scratch;
mod soak;
mod writing;
