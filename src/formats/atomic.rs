//! Atomic output files: written beside their place under a temporary name, synced, then renamed. Whatever stood there
//! stays until the new file is complete.
//!
//! A symbolic link is followed, and stays; the mode of a file that is replaced is kept. Devices, pipes and sockets are
//! refused: a rename would put a regular file in their place. So are the [inputs](super::protected) of the command.

use super::protected;
use super::temporary::{self, TemporaryFile, TemporaryFolder};
use crate::error::{Error, Result};
use crate::ranks;
use std::collections::BTreeMap;
use std::fs::{File, Metadata};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Largest number of links followed on the way to a file, as in Linux.
const MOST_LINKS: usize = 40;

/// Waits until no other process holds the lock of a folder, and holds it until the result is dropped. What is read and
/// then written again under the lock loses nothing that another process writes meanwhile. File systems without locks
/// let everybody pass.
#[must_use]
pub(crate) fn lock_folder(path: &Path) -> Option<File> {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    let folder = File::open(path).ok()?;
    rustix::fs::flock(&folder, rustix::fs::FlockOperation::LockExclusive).ok()?;
    Some(folder)
}

/// An output file that is not yet in its place.
#[derive(Debug)]
pub(crate) struct Draft {
    temporary: TemporaryFile,
    /// Path as the user named it, for error messages.
    named: PathBuf,
    /// Path of the finished file, with links followed.
    place: PathBuf,
}

impl Draft {
    /// Begins a file that is to stand at `path`.
    ///
    /// # Errors
    /// If a folder, a device, a pipe, a socket or an input of the command stands there, or the folder does not exist or
    /// cannot be written to.
    pub(crate) fn begin(path: &Path) -> Result<Self> {
        let place = followed(path)?;
        let standing = standing(path, &place)?;
        let extension = place.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
        let mut temporary = TemporaryFile::new(folder(&place), &extension).map_err(|e| {
            Error::io(path, e).hint("the output's folder must exist, be writable, and have room for a file beside it")
        })?;
        if let Some(old) = standing {
            temporary.file().set_permissions(old.permissions()).map_err(|e| unwritten(path, e))?;
        }
        Ok(Self { temporary, named: path.to_path_buf(), place })
    }

    /// The open file, empty at first.
    pub(crate) fn file(&mut self) -> &mut File {
        self.temporary.file()
    }

    /// Temporary path, at which the file stands until it is complete.
    pub(crate) fn path(&self) -> &Path {
        self.temporary.path()
    }

    /// Appends bytes to the file.
    ///
    /// # Errors
    /// If the operating system reports an error; where space is short, the error says how much is needed.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> Result<()> {
        let written = self.temporary.file().write_all(bytes);
        written.map_err(|e| self.unwritten(e, bytes.len() as u64))
    }

    /// Describes a failed write of the file. Where space is short, the error says how many bytes are `needed` in all
    /// and how many are free without this file.
    pub(crate) fn unwritten(&mut self, error: std::io::Error, needed: u64) -> Error {
        let mut what = format!("{error}: {needed} bytes are needed");
        if let (ErrorKind::StorageFull, Ok(free)) = (error.kind(), rustix::fs::statvfs(folder(&self.place))) {
            let own = self.temporary.file().metadata().map_or(0, |m| 512 * std::os::unix::fs::MetadataExt::blocks(&m));
            what += &format!(", {} are free", free.f_bavail.saturating_mul(free.f_frsize).saturating_add(own));
        }
        unwritten(&self.named, error).saying(what)
    }

    /// Syncs the file and renames it into place.
    ///
    /// # Errors
    /// If the file cannot be synced or renamed, in which case the old file stays, or if its folder cannot be synced
    /// afterwards.
    pub(crate) fn commit(self) -> Result<()> {
        let Self { mut temporary, named, place } = self;
        if !ranks::is_first() {
            return Ok(());
        }
        temporary.file().sync_all().map_err(|e| unwritten(&named, e))?;
        // What is there now need not be what was there at the beginning.
        standing(&named, &place)?;
        temporary.rename(&place).map_err(|e| unwritten(&named, e))?;
        sync_folder(folder(&place)).map_err(|e| unsynced(&named, e))
    }
}

/// Writes a file through `write`, which receives the draft; nothing appears if it fails.
///
/// # Errors
/// Errors of `write` and of the operating system, with `path`.
pub(crate) fn write(path: &Path, write: impl FnOnce(&mut Draft) -> Result<()>) -> Result<()> {
    let mut draft = Draft::begin(path)?;
    write(&mut draft).map_err(|e| e.at(path))?;
    draft.commit()
}

/// Writes a file of the given bytes.
///
/// # Errors
/// The conditions are those of [`write()`].
pub(crate) fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    write(path, |draft| draft.write(bytes))
}

/// Checks that `path` can be written, before the work whose result it is to hold.
///
/// # Errors
/// The conditions are those of [`Draft::begin`].
pub(crate) fn probe(path: &Path) -> Result<()> {
    Draft::begin(path).map(drop)
}

/// A batch of files that belong together: all of them appear, or none.
///
/// Each file waits in a temporary folder beside its place. If one cannot be put into place, those before it are removed
/// again, and the files that they had replaced are restored.
#[derive(Debug, Default)]
pub(crate) struct Batch {
    waiting: BTreeMap<PathBuf, TemporaryFolder>,
    /// Folders that were created for the batch, outermost first; empty ones are removed if the batch fails.
    made: Vec<PathBuf>,
    files: Vec<Waiting>,
    committed: bool,
}

#[derive(Debug)]
struct Waiting {
    from: PathBuf,
    place: PathBuf,
    named: PathBuf,
}

impl Batch {
    /// An empty batch.
    pub(crate) fn new() -> Self {
        Self::default()
    }

    /// Creates a folder for files of the batch if there is none; the folder is removed again if the batch fails.
    ///
    /// # Errors
    /// If a folder cannot be created, or a file bears its name; the error names it.
    pub(crate) fn make_folder(&mut self, path: &Path) -> Result<()> {
        let mut missing: Vec<PathBuf> = Vec::new();
        let mut at = Some(path);
        while let Some(folder) = at.filter(|f| !f.as_os_str().is_empty() && !f.exists()) {
            missing.push(folder.to_path_buf());
            at = folder.parent();
        }
        for folder in missing.into_iter().rev() {
            match std::fs::create_dir(&folder) {
                Ok(()) => self.made.push(folder),
                // Another process has created the folder meanwhile.
                Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
                Err(e) => {
                    return Err(
                        Error::io(&folder, e).hint("the output needs a folder that can be created and written to")
                    );
                }
            }
        }
        if path.as_os_str().is_empty() || path.is_dir() {
            return Ok(());
        }
        Err(Error::invalid("this is no folder, and files are to be written into it")
            .at(path)
            .hint("name a folder, or remove the file that bears its name"))
    }

    /// Adds a file that is to stand at `path`, and returns the temporary path at which the caller writes it. The file
    /// must be complete when the batch is committed.
    ///
    /// # Errors
    /// The conditions are those of [`Draft::begin`].
    pub(crate) fn add(&mut self, path: &Path) -> Result<PathBuf> {
        let place = followed(path)?;
        let folder = folder(&place).to_path_buf();
        let number = self.files.len();
        let waiting = match self.waiting.entry(folder.clone()) {
            std::collections::btree_map::Entry::Occupied(entry) => entry.into_mut(),
            std::collections::btree_map::Entry::Vacant(entry) => entry.insert(TemporaryFolder::new(&folder)?),
        };
        let mut name = std::ffi::OsString::from(format!("{number}-"));
        name.push(place.file_name().unwrap_or_default());
        let from = waiting.path().join(name);
        self.files.push(Waiting { from: from.clone(), place, named: path.to_path_buf() });
        Ok(from)
    }

    /// Puts all files into place.
    ///
    /// # Errors
    /// If a file cannot be put into place, in which case all others are restored, or if a folder cannot be synced
    /// afterwards; the error names it.
    pub(crate) fn commit(mut self) -> Result<()> {
        if !ranks::is_first() {
            return Ok(());
        }
        // A signal waits until all files are in their places, or none is.
        temporary::undisturbed(|| self.place_all())?;
        self.committed = true;
        self.waiting.keys().try_for_each(|folder| sync_folder(folder).map_err(|e| unsynced(folder, e)))
    }

    /// Puts all files into place, or none.
    fn place_all(&self) -> Result<()> {
        let mut done = Vec::with_capacity(self.files.len());
        for (number, file) in self.files.iter().enumerate() {
            match self.place(number, file) {
                Ok(old) => done.push((file, old)),
                Err(error) => {
                    // A file that cannot be taken back stays, whole and new.
                    for (file, old) in done.into_iter().rev() {
                        let _ = match old {
                            Some(old) => std::fs::rename(old, &file.place),
                            None => std::fs::remove_file(&file.place),
                        };
                    }
                    return Err(error);
                }
            }
        }
        Ok(())
    }

    /// Puts a file into place, and returns the temporary path of the file that it replaced, if there was one.
    fn place(&self, number: usize, file: &Waiting) -> Result<Option<PathBuf>> {
        let failed = |e| unwritten(&file.named, e);
        let mut old = None;
        if let Some(standing) = standing(&file.named, &file.place)? {
            std::fs::set_permissions(&file.from, standing.permissions()).map_err(failed)?;
            let aside = file.from.with_file_name(format!("{number}.old"));
            // The copy is for filesystems without hard links.
            if std::fs::hard_link(&file.place, &aside).is_err() {
                std::fs::copy(&file.place, &aside).map_err(failed)?;
            }
            old = Some(aside);
        }
        // At every moment either the old file or the new one stands there.
        std::fs::rename(&file.from, &file.place).map_err(failed)?;
        Ok(old)
    }
}

impl Drop for Batch {
    /// Removes the temporary files, and the folders that were created for a batch that failed.
    fn drop(&mut self) {
        self.waiting.clear();
        if !self.committed {
            // A folder that is no longer empty is not removed.
            self.made.iter().rev().for_each(|folder| drop(std::fs::remove_dir(folder)));
        }
    }
}

/// Path at the end of the symbolic links that begin at `path`. The file there need not exist; if it does, it is a
/// regular file.
fn followed(path: &Path) -> Result<PathBuf> {
    // An existing file is found under its canonical path; links like those of /proc are no paths.
    if standing(path, path)?.is_some()
        && let Ok(place) = std::fs::canonicalize(path)
    {
        return Ok(place);
    }
    let mut at = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        match std::fs::symlink_metadata(&at) {
            Ok(m) if m.file_type().is_symlink() => {}
            Err(e) if e.kind() != ErrorKind::NotFound => return Err(Error::io(path, e)),
            _ => return Ok(at),
        }
        let to = std::fs::read_link(&at).map_err(|e| Error::io(path, e))?;
        at = at.parent().map_or_else(|| to.clone(), |folder| folder.join(&to));
    }
    Err(Error::invalid(format!("more than {MOST_LINKS} symbolic links lead on from here"))
        .at(path)
        .hint("the links may form a circle; name the file itself"))
}

/// Metadata of the regular file at `place`; `None` if nothing stands there. Anything but a regular file is an error,
/// and so is an input of the command.
fn standing(named: &Path, place: &Path) -> Result<Option<Metadata>> {
    let found = match std::fs::metadata(place) {
        Ok(m) if m.is_file() => return protected::refuse(named, &m).map(|()| Some(m)),
        Ok(m) if m.is_dir() => "a folder",
        Ok(_) => "a device, a pipe or a socket",
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        // A cycle of links is reported by the caller that follows them.
        Err(e) if e.raw_os_error() == Some(libc::ELOOP) => return Ok(None),
        Err(e) => return Err(Error::io(named, e).hint("the output's folder must exist and be writable")),
    };
    Err(Error::invalid(format!("this is {found}; the name of a regular file is expected"))
        .at(named)
        .hint("outputs are written beside their place and renamed: name a file in a folder that can be written to"))
}

fn folder(place: &Path) -> &Path {
    match place.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    }
}

/// Syncs a folder, so that a rename in it survives a crash. Filesystems that cannot sync folders are tolerated.
fn sync_folder(folder: &Path) -> std::io::Result<()> {
    match File::open(folder).and_then(|f| f.sync_all()) {
        Err(e)
            if matches!(e.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported | ErrorKind::PermissionDenied) =>
        {
            Ok(())
        }
        other => other,
    }
}

/// The error that an output is in place, but that a crash of the machine might still lose it.
fn unsynced(named: &Path, error: std::io::Error) -> Error {
    let what = format!("{error}: the output is there, but its folder could not be synced to the disk");
    Error::io(named, error).saying(what).hint("check the disk; if it is sound, nothing more needs to be done")
}

/// The error that an output could not be put into place, with a remedy.
fn unwritten(named: &Path, error: std::io::Error) -> Error {
    let hint = match error.kind() {
        ErrorKind::StorageFull => "nothing was changed; make room there, or name a folder on another disk",
        ErrorKind::QuotaExceeded => "nothing was changed; make room within the quota, or name a folder elsewhere",
        ErrorKind::FileTooLarge => "nothing was changed; raise the limit for the size of files (ulimit -f)",
        ErrorKind::ReadOnlyFilesystem => "nothing was changed; mount it writable, or name a folder elsewhere",
        _ => "nothing was changed; check the disk and the folder's permissions, or name another folder",
    };
    Error::io(named, error).hint(hint)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(path: &Path) -> String {
        std::fs::read_to_string(path).unwrap()
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_litter() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.txt");
        std::fs::write(&path, "old").unwrap();
        let failed = write(&path, |draft| {
            draft.write(b"half").unwrap();
            Err(Error::invalid("no"))
        });
        assert!(failed.unwrap_err().to_string().contains("out.txt"));
        assert_eq!(text(&path), "old");
        write_bytes(&path, b"new").unwrap();
        assert_eq!(text(&path), "new");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    #[cfg(unix)]
    fn links_are_followed_and_modes_kept() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let dir = tempfile::tempdir().unwrap();
        let [file, link, far] = ["file", "link", "far"].map(|n| dir.path().join(n));
        std::fs::write(&file, "old").unwrap();
        std::fs::set_permissions(&file, PermissionsExt::from_mode(0o640)).unwrap();
        symlink("file", &link).unwrap();
        symlink(&link, &far).unwrap();
        write_bytes(&far, b"new").unwrap();
        assert_eq!(text(&file), "new");
        assert!([&link, &far].iter().all(|l| std::fs::symlink_metadata(l).unwrap().is_symlink()));
        assert_eq!(std::fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o640);
        // A link whose target does not exist yet.
        symlink("later", dir.path().join("soon")).unwrap();
        write_bytes(&dir.path().join("soon"), b"there").unwrap();
        assert_eq!(text(&dir.path().join("later")), "there");
        symlink("round", dir.path().join("round")).unwrap();
        assert!(write_bytes(&dir.path().join("round"), b"").unwrap_err().to_string().contains("links"));
    }

    #[test]
    #[cfg(unix)]
    fn what_is_no_regular_file_is_refused() {
        for path in ["/dev/null", "/dev", "/"] {
            assert!(probe(Path::new(path)).unwrap_err().to_string().contains("regular file"), "{path}");
        }
        let error = probe(Path::new("/dev/null/x")).unwrap_err().to_string();
        assert!(error.contains("/dev/null/x"), "{error}");
    }

    #[test]
    fn a_batch_that_fails_in_the_middle_changes_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("deep/er");
        let mut batch = Batch::new();
        batch.make_folder(&folder).unwrap();
        let paths = ["a", "b", "c"].map(|n| folder.join(n));
        std::fs::write(&paths[0], "old").unwrap();
        for (path, present) in paths.iter().zip([true, true, false]) {
            let waits = batch.add(path).unwrap();
            if present {
                std::fs::write(waits, "new").unwrap();
            }
        }
        assert!(batch.commit().unwrap_err().to_string().contains('c'));
        assert_eq!(text(&paths[0]), "old");
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1);

        let mut batch = Batch::new();
        for path in &paths {
            std::fs::write(batch.add(path).unwrap(), "new").unwrap();
        }
        batch.commit().unwrap();
        assert!(paths.iter().all(|p| text(p) == "new"));
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 3);
    }

    #[test]
    fn folders_made_for_nothing_are_taken_back() {
        let dir = tempfile::tempdir().unwrap();
        let mut batch = Batch::new();
        batch.make_folder(&dir.path().join("x/y")).unwrap();
        batch.add(&dir.path().join("x/y/file")).unwrap();
        drop(batch);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
        std::fs::write(dir.path().join("file"), "").unwrap();
        assert!(Batch::new().make_folder(&dir.path().join("file")).unwrap_err().to_string().contains("no folder"));
    }
}
