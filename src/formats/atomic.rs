//! Outputs appear whole or not at all: written beside their place under a temporary name, then
//! renamed. Whatever stood there stays until the new file is complete.

use crate::error::{Error, Result};
use std::path::Path;

/// Calls `write` with a temporary path in the folder of `path` (same extension, so that libraries
/// which look at it are content), syncs the file and renames it into place.
///
/// # Errors
/// Whatever `write` returns, or the operating system's error with `path`; the temporary file is gone
/// in either case.
pub fn write(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let temporary = temporary(path)?;
    write(temporary.path()).map_err(|e| e.at(path))?;
    // Reopen by name: a library may have replaced the file that the handle points to.
    std::fs::File::open(temporary.path()).and_then(|f| f.sync_all()).map_err(|e| Error::io(path, e))?;
    set_default_mode(temporary.path()).map_err(|e| Error::io(path, e))?;
    temporary.persist(path).map_err(|e| Error::io(path, e.error))?;
    Ok(())
}

/// Makes sure that `path` can be written, before the work whose result it is to hold.
///
/// # Errors
/// If it is a folder, or its own folder does not exist or cannot be written to.
pub fn probe(path: &Path) -> Result<()> {
    if path.is_dir() {
        return Err(Error::invalid("this is a folder; the name of a file is expected").at(path));
    }
    temporary(path).map(drop)
}

fn temporary(path: &Path) -> Result<tempfile::NamedTempFile> {
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let extension = path.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
    tempfile::Builder::new()
        .prefix(".cumulo-")
        .suffix(&extension)
        .tempfile_in(folder)
        .map_err(|e| Error::io(path, e).hint("the output's folder must exist and be writable"))
}

/// Temporary files are private to their owner; outputs follow the user's umask like any other file.
#[cfg(unix)]
fn set_default_mode(path: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    use std::sync::OnceLock;
    static MODE: OnceLock<u32> = OnceLock::new();
    let mode = *MODE.get_or_init(|| {
        // The only portable way to learn the umask without changing it is to create a file with it.
        let probe = std::env::temp_dir().join(format!(".cumulo-umask-{}", std::process::id()));
        let mode =
            std::fs::File::create(&probe).and_then(|f| f.metadata()).map_or(0o644, |m| m.permissions().mode() & 0o777);
        let _ = std::fs::remove_file(&probe);
        mode
    });
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode))
}

#[cfg(not(unix))]
fn set_default_mode(_: &Path) -> std::io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_litter() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.txt");
        std::fs::write(&path, "old").unwrap();
        let failed = write(&path, |p| {
            std::fs::write(p, "half").unwrap();
            Err(Error::invalid("no"))
        });
        assert!(failed.unwrap_err().to_string().contains("out.txt"));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
        write(&path, |p| std::fs::write(p, "new").map_err(|e| Error::io(p, e))).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "new");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
