//! Files of regular grids, each written whole or not at all, slice by slice.

pub(crate) mod meta_image;
pub(crate) mod mitsuba;
pub(crate) mod nifti;
pub(crate) mod npy;
pub(crate) mod nrrd;
pub(crate) mod vti;

use super::options::Axes;
use super::source::Source;
use crate::error::{Error, Result};
use crate::formats::atomic::Draft;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A form in which files are written: a format, by the ending of a name.
#[derive(Debug)]
pub struct Target {
    /// Ending of the names of such files, without the dot.
    pub ending: &'static str,
    /// Writes a grid, by its name and with the axes of an array, and returns what the format could not hold.
    pub(crate) file: fn(&Path, &Source, &str, Axes) -> Result<Vec<String>>,
    /// Extension of another file that is written beside it.
    pub(crate) beside: Option<&'static str>,
}

impl Target {
    /// Other file that is written with one of this path.
    pub(crate) fn companion(&self, path: &Path) -> Option<PathBuf> {
        self.beside.map(|extension| path.with_extension(extension))
    }

    /// Writes a grid, and returns what the format could not hold, one sentence each.
    ///
    /// # Errors
    /// If the format cannot hold the grid's placement or size, or the operating system reports an error. Nothing is
    /// left behind.
    pub fn write(&self, path: &Path, source: &Source, name: &str, axes: Axes) -> Result<Vec<String>> {
        (self.file)(path, source, name, axes).map_err(|e| e.at(path))
    }
}

/// Writes all values, x fastest, the components of a voxel together.
fn values(source: &Source, mut put: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
    let (mut slice, mut bytes) = (Vec::new(), Vec::new());
    for z in 0..source.size[2] {
        source.slice(z, &mut slice)?;
        for part in slice.chunks(1 << 16) {
            bytes.clear();
            source.sample.encode(part, &mut bytes);
            put(&bytes)?;
        }
    }
    Ok(())
}

/// A draft as a stream of bytes, for packers.
struct Stream<'d> {
    draft: &'d mut Draft,
    written: u64,
}

impl Write for Stream<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let n = self.draft.file().write(bytes)?;
        self.written += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.draft.file().flush()
    }
}

/// Writes what `fill` gives through gzip.
fn packed(draft: &mut Draft, fill: impl FnOnce(&mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()>) -> Result<()> {
    let mut encoder = flate2::write::GzEncoder::new(Stream { draft, written: 0 }, flate2::Compression::default());
    let mut failed = None;
    let filled = fill(&mut |bytes| {
        encoder.write_all(bytes).map_err(|e| {
            failed = Some(());
            Error::system(e)
        })
    });
    let written = encoder.get_ref().written;
    match (filled, failed) {
        (Ok(()), _) => encoder.finish().map(drop).map_err(|e| draft.unwritten(e, written)),
        (Err(error), Some(())) => match error.os_error() {
            Some(number) => {
                drop(encoder);
                Err(draft.unwritten(std::io::Error::from_raw_os_error(number), written))
            }
            None => Err(error),
        },
        (Err(error), None) => Err(error),
    }
}

/// A number as text that reads back to the same number.
fn number(v: f64) -> String {
    format!("{:?}", v + 0.0)
}

/// Numbers as text, between blanks.
fn numbers(values: impl IntoIterator<Item = f64>) -> String {
    values.into_iter().map(number).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_back() {
        assert_eq!(numbers([1.0, -0.0, 1e-300, 0.1]), "1.0 0.0 1e-300 0.1");
    }
}
