//! COLMAP's text files: one line a camera, two lines an image.

use super::Image;
use super::model::{self, Calibration};
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};

/// Longest line in bytes, that of an image's points.
const MAX_LINE: u64 = 1 << 28;

/// Reads the file of the cameras.
///
/// # Errors
/// If a line cannot be read, or a camera cannot be used; the error names the line.
pub(super) fn cameras(file: File, limits: Limits) -> Result<BTreeMap<u32, Calibration>> {
    let mut lines = Lines::new(file, limits);
    let mut cameras = BTreeMap::new();
    while let Some(line) = lines.record()? {
        let (id, camera) = camera(&line).map_err(|e| e.part(lines.place()))?;
        cameras.insert(id, camera);
    }
    Ok(cameras)
}

fn camera(line: &str) -> Result<(u32, Calibration)> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let [id, name, width, height, parameters @ ..] = &words[..] else {
        return Err(expected("CAMERA_ID MODEL WIDTH HEIGHT PARAMS", line));
    };
    let (model, count) = model::by_name(name)?;
    if parameters.len() != count {
        return Err(Error::invalid(format!("{model} has {count} parameters, {} are there", parameters.len()))
            .hint("export the model again"));
    }
    let number = |word: &str| word.parse::<f64>().map_err(|_| expected("a number", word));
    let parameters = parameters.iter().map(|word| number(word)).collect::<Result<Vec<_>>>()?;
    let side = |word: &str| word.parse::<u64>().map_err(|_| expected("a size in pixels", word));
    let id = id.parse().map_err(|_| expected("a number of a camera", id))?;
    Ok((id, Calibration::new(model, [side(width)?, side(height)?], &parameters)?))
}

/// Reads the file of the images; the lines of their points are skipped.
///
/// # Errors
/// If a line cannot be read; the error names it.
pub(super) fn images(file: File, limits: Limits) -> Result<Vec<Image>> {
    let mut lines = Lines::new(file, limits);
    let mut images = Vec::new();
    while let Some(line) = lines.record()? {
        images.push(image(&line).map_err(|e| e.part(lines.place()))?);
        // The points, which may be none.
        lines.next()?;
    }
    Ok(images)
}

fn image(line: &str) -> Result<Image> {
    let mut rest = line.trim();
    let mut word = || {
        let (word, left) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
        rest = left.trim_start();
        word
    };
    let _id = word();
    let mut numbers = [0.0; 7];
    for number in &mut numbers {
        let word = word();
        *number = word.parse().map_err(|_| expected("IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME", line))?;
    }
    let camera = word();
    let camera = camera.parse().map_err(|_| expected("a number of a camera", camera))?;
    // A name may have blanks.
    if rest.is_empty() {
        return Err(expected("a name of a picture at the end", line));
    }
    let [w, x, y, z, t @ ..] = numbers;
    Ok(Image { rotation: DQuat::from_xyzw(x, y, z, w), translation: DVec3::from_array(t), camera, name: rest.into() })
}

fn expected(what: &str, found: &str) -> Error {
    let found: String = found.chars().take(60).collect();
    Error::invalid(format!("'{found}'; {what} is expected"))
        .hint("this is no text model of COLMAP, or a damaged one: export it again")
}

/// Lines of a file with their numbers.
struct Lines {
    file: BufReader<File>,
    number: usize,
    /// Bytes that the records may have together.
    left: u64,
}

impl Lines {
    fn new(file: File, limits: Limits) -> Self {
        // A record in memory takes less than four times its bytes in the file.
        Self { file: BufReader::new(file), number: 0, left: limits.max_memory / 4 }
    }

    /// Reads the next line that is neither empty nor a comment.
    fn record(&mut self) -> Result<Option<String>> {
        while let Some(line) = self.next()? {
            if line.trim().is_empty() || line.starts_with('#') {
                continue;
            }
            self.left = self.left.checked_sub(line.len() as u64).ok_or_else(|| {
                Error::unsupported("the model does not fit into memory")
                    .coded(Code::MemoryLimit)
                    .hint("raise ⟨max_memory⟩ if the file is to be trusted")
            })?;
            return Ok(Some(line));
        }
        Ok(None)
    }

    fn next(&mut self) -> Result<Option<String>> {
        let mut line = Vec::new();
        let most = MAX_LINE.min(self.left);
        (&mut self.file).take(most + 1).read_until(b'\n', &mut line).map_err(Error::system)?;
        self.number += 1;
        if line.len() as u64 > most {
            return Err(Error::invalid(format!("line {} has more than {most} bytes", self.number))
                .hint("this is no text model of COLMAP"));
        }
        if line.is_empty() {
            return Ok(None);
        }
        let line = String::from_utf8(line);
        line.map(Some).map_err(|_| {
            Error::invalid(format!("line {} is not UTF-8", self.number)).hint("this is no text model of COLMAP")
        })
    }

    fn place(&self) -> String {
        format!("line {}", self.number)
    }
}
