//! Paths in stages.

use crate::error::{Error, Result};
use std::path::{Component, Path, PathBuf};

/// Returns the path of a file from the folder of a stage, to which a leading `./` or `../` anchors it.
///
/// # Errors
/// If a folder does not exist, or the path is not Unicode, which USD's paths have to be.
pub(crate) fn relative(file: &Path, stage: &Path) -> Result<String> {
    let folder = |path: &Path| {
        let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        parent.canonicalize().map_err(|e| Error::io(parent, e))
    };
    let (from, to) = (folder(stage)?, folder(file)?);
    let shared = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let up = from.components().skip(shared).map(|_| Component::ParentDir);
    let path: PathBuf = up.chain(to.components().skip(shared)).collect();
    let path = path.join(file.file_name().unwrap_or_default());
    let Some(text) = path.to_str().filter(|text| !text.contains(char::is_control)) else {
        return Err(Error::unsupported("paths in USD are Unicode without control characters, and this one is not")
            .at(file)
            .hint("rename the file or its folder"));
    };
    Ok(if text.starts_with("../") { text.to_owned() } else { format!("./{text}") })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn paths_are_anchored() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::create_dir_all(at("a/b")).unwrap();
        std::fs::create_dir_all(at("c")).unwrap();
        let shown = |file: &str, stage: &str| relative(&at(file), &at(stage)).unwrap();
        assert_eq!(shown("a/s.vdb", "a/s.usda"), "./s.vdb");
        assert_eq!(shown("a/b/s.vdb", "a/s.usda"), "./b/s.vdb");
        assert_eq!(shown("c/../a/s.vdb", "c/s.usda"), "../a/s.vdb");
        assert_eq!(shown("s.vdb", "a/b/s.usda"), "../../s.vdb");
        assert!(relative(&at("none/s.vdb"), &at("s.usda")).is_err());
        assert!(relative(&at("s\n.vdb"), &at("s.usda")).is_err());
    }
}
