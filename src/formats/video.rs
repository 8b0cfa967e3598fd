//! Frames of videos, decoded by the program `ffmpeg` where it is installed.

use crate::error::{Error, Result};
use crate::formats::input;
use std::io::{ErrorKind, Read};
use std::path::Path;
use std::process::{Command, Stdio};

/// Bytes by which the containers begin: MXF, Matroska and WebM.
const STARTS: [&[u8]; 2] = [&[0x06, 0x0e, 0x2b, 0x34], &[0x1a, 0x45, 0xdf, 0xa3]];
/// Names of the first box of MP4 and QuickTime, four bytes into the file.
const BOXES: [&[u8]; 5] = [b"ftyp", b"moov", b"mdat", b"wide", b"free"];

/// Returns true for a video, by its first bytes: MP4, QuickTime, Matroska, WebM, AVI or MXF.
///
/// # Errors
/// If the file cannot be read.
pub(crate) fn is_video(path: &Path) -> Result<bool> {
    let mut start = Vec::with_capacity(12);
    input::open(path)?.take(12).read_to_end(&mut start).map_err(|e| Error::io(path, e))?;
    let at = |from: usize, what: &[u8]| start.get(from..from + what.len()) == Some(what);
    Ok(STARTS.iter().any(|known| at(0, known))
        || BOXES.iter().any(|known| at(4, known))
        || (at(0, b"RIFF") && at(8, b"AVI ")))
}

/// Writes a frame of a video as a PNG of 16 bits a sample. Frames are counted from 0.
///
/// # Errors
/// If `ffmpeg` is not installed or cannot decode the video, or the video has no such frame.
pub(crate) fn write_frame(video: &Path, frame: u32, png: &Path) -> Result<()> {
    let mut source = std::ffi::OsString::from("file:");
    source.push(video);
    let done = Command::new("ffmpeg")
        // What a playlist names may lie in files, and nowhere else.
        .args(["-nostdin", "-v", "error", "-y", "-protocol_whitelist", "file", "-i"])
        .arg(source)
        .args(["-an", "-sn", "-dn", "-vf"])
        .arg(format!("select=eq(n\\,{frame})"))
        .args(["-frames:v", "1", "-pix_fmt", "rgb48be", "-f", "image2", "-c:v", "png", "-update", "1"])
        .arg(png)
        .stdin(Stdio::null())
        .output();
    let output = done.map_err(|e| match e.kind() {
        ErrorKind::NotFound => {
            Error::unsupported("the file is a video, and ffmpeg, which decodes them, is not installed")
                .at(video)
                .hint("install it (Debian: apt install ffmpeg), or give the frames as PNG or EXR pictures")
        }
        _ => Error::system(e).at(video).hint("ffmpeg could not be started"),
    })?;
    let words = String::from_utf8_lossy(&output.stderr);
    let words = words.lines().next().unwrap_or("ffmpeg does not say why").trim();
    if !output.status.success() {
        return Err(Error::invalid(format!("the video cannot be decoded: {words}"))
            .at(video)
            .hint("check with a player that it is whole; ffmpeg must know its codec"));
    }
    if !png.exists() {
        return Err(Error::invalid(format!("the video has no frame {frame}, counted from 0"))
            .at(video)
            .hint("give an earlier frame; `ffprobe -count_frames` tells how many there are"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_bytes_tell_a_video() -> Result<()> {
        let folder = tempfile::tempdir().map_err(Error::system)?;
        let path = folder.path().join("file");
        let cases: [(&[u8], bool); 6] = [
            (b"\0\0\0\x20ftypisom", true),
            (b"\x1a\x45\xdf\xa3....", true),
            (b"RIFF\0\0\0\0AVI LIST", true),
            (b"RIFF\0\0\0\0WAVEfmt ", false),
            (b"\x89PNG\r\n\x1a\n", false),
            (b"", false),
        ];
        for (bytes, expected) in cases {
            std::fs::write(&path, bytes).map_err(Error::system)?;
            assert_eq!(is_video(&path)?, expected, "{bytes:?}");
        }
        Ok(())
    }
}
