//! A limit on memory that the process cannot lift ends it with a word, and leaves nothing waiting.

use crate::common::work::{cumulo, fixture};
use std::process::Command;

/// What says that memory has run out takes memory itself: denied, it must not wait for its own end.
#[test]
fn a_limit_from_outside_ends_the_work() {
    let program = cumulo().get_program().to_owned();
    for mib in (36_u64..=60).step_by(3).cycle().take(27) {
        let limit = format!("--data={}", mib << 20);
        let mut command = Command::new("timeout");
        command.args(["30", "prlimit", &limit]).arg(&program).arg("diff");
        command.args([fixture("tiles.vdb"), fixture("tiles.vdb")]).args(["--json", "--threads", "1"]);
        let out = command.env("RAYON_NUM_THREADS", "1").output().unwrap();
        assert_ne!(out.status.code(), Some(124), "{mib} MiB: {}", String::from_utf8_lossy(&out.stderr));
        assert_ne!(out.status.code(), Some(1), "{mib} MiB: a lack of memory is no difference");
    }
}
