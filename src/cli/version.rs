//! Version of the program, with the commit that it was built from where the build knew it.

use std::sync::OnceLock;

/// Version as `--version` states it.
static TEXT: OnceLock<String> = OnceLock::new();

/// States the commit that the program was built from; without one, or with an empty one, the version stands alone.
pub(crate) fn of_commit(commit: Option<&str>) {
    let _ = TEXT.set(with(commit));
}

/// Returns the version, and the commit behind it.
pub(crate) fn text() -> &'static str {
    TEXT.get_or_init(|| with(None))
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
        assert_eq!(with(Some("0123abc\n")), format!("{version} (commit 0123abc)"));
        assert_eq!([with(None), with(Some(""))], [version, version]);
    }
}
