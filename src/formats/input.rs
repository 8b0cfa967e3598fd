//! Bounded input: regular files only, no more bytes than a format can need, and no JSON whose values would outgrow the
//! memory allowed.

use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::protected;
use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

/// Advice on text that is not valid JSON.
pub(crate) const JSON_REMEDY: &str =
    "correct the text at that line and column, or write the file again where it was made";

/// Opens a regular file for reading. Others are refused before they are opened: a FIFO would block until somebody
/// writes to it, and a device may have no end.
///
/// # Errors
/// If the file does not exist, is a folder, a device, a FIFO or a socket, or cannot be opened.
pub(crate) fn open(path: &Path) -> Result<File> {
    let regular = |metadata: std::fs::Metadata| {
        if metadata.is_file() {
            return Ok(());
        }
        Err(if metadata.is_dir() {
            Error::invalid("this is a folder; a file is expected").hint("name the file that lies in it")
        } else {
            Error::invalid(format!("this is {}; a regular file is expected", kind(&metadata)))
                .hint("write what it delivers to a file first, and name that file")
        }
        .at(path))
    };
    regular(std::fs::metadata(path).map_err(|e| Error::io(path, e))?)?;
    let file = File::open(path).map_err(|e| Error::io(path, e))?;
    // The file may have been replaced since the first check.
    let metadata = file.metadata().map_err(|e| Error::io(path, e))?;
    protected::opened(path, &metadata);
    regular(metadata)?;
    Ok(file)
}

#[cfg(unix)]
fn kind(metadata: &std::fs::Metadata) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    let kind = metadata.file_type();
    if kind.is_fifo() {
        "a pipe (FIFO)"
    } else if kind.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

#[cfg(not(unix))]
fn kind(_: &std::fs::Metadata) -> &'static str {
    "a device"
}

/// Reads a regular file of at most `most` bytes. `what` names the expected content, such as `a list of cameras`.
///
/// # Errors
/// If [`open`] fails, the file cannot be read, or it has more than `most` bytes.
pub(crate) fn bytes(path: &Path, most: u64, what: &str) -> Result<Vec<u8>> {
    let file = open(path)?;
    let stated = file.metadata().map_err(|e| Error::io(path, e))?.len();
    let mut bytes = Vec::new();
    // The length that the system states may be 0 (in /proc) or outdated; what is read counts.
    if stated <= most {
        file.take(most + 1).read_to_end(&mut bytes).map_err(|e| Error::io(path, e))?;
    }
    let found = stated.max(bytes.len() as u64);
    if found > most {
        return Err(Error::invalid(format!("more than {most} bytes, too many for {what}"))
            .hint("check that this is the file that was meant")
            .at(path));
    }
    Ok(bytes)
}

/// Refuses JSON whose values would take more memory than `limits` allow.
///
/// # Errors
/// If an upper estimate of the values' memory exceeds the limits.
pub(crate) fn check_json_memory(text: &[u8], limits: Limits) -> Result<()> {
    let needed = json_memory(text);
    if needed <= limits.max_memory {
        return Ok(());
    }
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    Err(Error::unsupported(format!(
        "JSON of {} bytes whose values may take {} MiB, {} MiB are allowed",
        text.len(),
        mib(needed),
        mib(limits.max_memory)
    ))
    .coded(Code::MemoryLimit)
    .hint("raise ⟨max_memory⟩ if the file is to be trusted"))
}

/// Upper estimate, from the punctuation of a JSON text, of the bytes that its values take in memory.
/// A value has 32 bytes, thrice while a list grows. A list begins with room for four. An object is a B-tree whose nodes
/// of 632 bytes are at least half full, and each of its keys is an allocation.
fn json_memory(text: &[u8]) -> u64 {
    let cost = |byte: &u8| match byte {
        b'{' => 656,
        b'[' => 144,
        b':' => 160,
        b',' => 96,
        _ => 2,
    };
    text.iter().map(cost).sum()
}

/// Path of what a file's content names below a folder; none if the name leads out of it. An absolute path that begins
/// with the folder stays in it.
pub(crate) fn below(folder: &Path, name: &str) -> Option<PathBuf> {
    // No file of the system has such a name.
    if name.contains('\0') {
        return None;
    }
    let plain = |path: &Path| path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    let name = Path::new(name);
    if plain(name) {
        return Some(folder.join(name));
    }
    let whole = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let inside = name.strip_prefix(std::path::absolute(whole).ok()?).ok()?;
    plain(inside).then(|| folder.join(inside))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_are_opened() {
        let dir = tempfile::tempdir().unwrap();
        assert!(open(dir.path()).unwrap_err().to_string().contains("folder"));
        #[cfg(unix)]
        {
            assert!(open(Path::new("/dev/zero")).unwrap_err().to_string().contains("a device"));
            let socket = dir.path().join("s");
            let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
            assert!(open(&socket).unwrap_err().to_string().contains("a socket"));
        }
        let file = dir.path().join("f");
        std::fs::write(&file, "12345").unwrap();
        assert_eq!(bytes(&file, 5, "five").unwrap(), b"12345");
        let error = bytes(&file, 4, "a word").unwrap_err().to_string();
        assert!(error.contains("more than 4 bytes") && error.contains("a word"), "{error}");
    }

    #[test]
    fn the_estimate_is_above_what_parsed_json_takes() {
        // Resident memory of a value is hard to measure beside other tests; the sizes it is made of are not.
        assert_eq!(size_of::<serde_json::Value>(), 32);
        let many = |part: &str, n: usize| format!("[{}0]", part.repeat(n));
        // Lists of n values have room for up to 2 n, and both lists at the last growth.
        let n = 1 << 16;
        assert!(json_memory(many("0,", n).as_bytes()) >= 3 * 32 * n as u64);
        // An object of one key has one node of 11 keys and values, and the key's own allocation.
        let node = (11 * (24 + 32) + 16) as u64;
        assert!(json_memory(many(r#"{"":0},"#, n).as_bytes()) >= (node + 3 * 32) * n as u64);
        assert!(check_json_memory(b"[0,0]", Limits { max_memory: 100 }).is_err());
        assert!(check_json_memory(b"[0,0]", Limits { max_memory: 1000 }).is_ok());
    }
}
