//! Tests in processes of their own.

use std::io::{BufRead, BufReader};
use std::process::Command;

/// Runs a test, by its full name, in a process of its own. True in that process, which goes on with the test; false where
/// the test has passed there.
///
/// # Panics
/// If it has not.
#[must_use]
pub fn alone(name: &str) -> bool {
    const WITHIN: &str = "CUMULO_TEST_ALONE";
    if std::env::var_os(WITHIN).is_some() {
        return true;
    }
    let (read, write) = std::io::pipe().unwrap();
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", name, "--nocapture"]).env(WITHIN, name);
    command.stdout(write.try_clone().unwrap()).stderr(write);
    let mut child = command.spawn().unwrap();
    // The command holds the pipe open.
    drop(command);
    let mut passed = false;
    for line in BufReader::new(read).lines() {
        let line = line.unwrap();
        println!("{line}");
        passed |= line.starts_with("test result: ok. 1 passed");
    }
    let status = child.wait().unwrap();
    assert!(status.success() && passed, "{name}, in a process of its own: {status}");
    false
}
