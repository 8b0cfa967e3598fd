//! Version of the program: in a line with the commit that it was built from, where the build knew it, and with what the
//! program is made of.

use crate::arch::Arch;
use crate::formats::vdb;
use std::sync::OnceLock;

/// Version as `-V` states it.
static TEXT: OnceLock<String> = OnceLock::new();
/// Version as `--version` states it.
static LONG: OnceLock<String> = OnceLock::new();

/// States the commit that the program was built from, and its date; without one, or with an empty one, the version
/// stands alone.
pub(crate) fn of_commit(commit: Option<&str>) {
    let _ = TEXT.set(with(commit));
}

/// Returns the version, and the commit behind it, in a line.
pub(crate) fn text() -> &'static str {
    TEXT.get_or_init(|| with(None))
}

/// Returns the version, that of OpenVDB, the instruction set of inner loops on this machine, the target and the
/// compiler, each in a line, as `--version` states them.
pub(super) fn long() -> &'static str {
    LONG.get_or_init(|| {
        let (openvdb, instructions) = (vdb::version(), Arch::default().name());
        let (target, compiler) = (env!("CUMULO_TARGET"), env!("CUMULO_COMPILER"));
        let version = text();
        format!("{version}\nOpenVDB: {openvdb}\nInstructions: {instructions}\nTarget: {target}\nCompiler: {compiler}")
    })
}

fn with(commit: Option<&str>) -> String {
    let version = env!("CARGO_PKG_VERSION");
    match commit.map(str::trim).filter(|commit| !commit.is_empty()) {
        Some(commit) => format!("{version} (commit {commit})"),
        None => version.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_commit_stands_behind_the_version() {
        let version = env!("CARGO_PKG_VERSION");
        assert_eq!(with(Some("0123abc, 2026-01-31\n")), format!("{version} (commit 0123abc, 2026-01-31)"));
        assert_eq!([with(None), with(Some(""))], [version, version]);
    }
}
