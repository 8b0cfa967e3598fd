//! Files of regular grids, each written whole or not at all, slice by slice.

mod meta_image;
mod nifti;
mod npy;
mod nrrd;
mod vti;

use super::options::Axes;
use super::source::Source;
use crate::error::{Error, Result};
use crate::formats::atomic::Draft;
use std::ffi::OsStr;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A format that can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// NIfTI-1, or NIfTI-2 where an axis has more than 32767 voxels.
    Nifti,
    /// NIfTI packed by gzip.
    NiftiGz,
    /// NRRD with packed values.
    Nrrd,
    /// Array of NumPy.
    Npy,
    /// MetaImage with its values.
    MetaImage,
    /// Header of MetaImage, with its values in a file of the same name that ends in `.raw`.
    MetaHeader,
    /// VTK's image data in XML.
    Vti,
}

impl Target {
    /// All formats.
    pub const ALL: [Self; 7] =
        [Self::Nifti, Self::NiftiGz, Self::Nrrd, Self::Npy, Self::MetaImage, Self::MetaHeader, Self::Vti];

    /// Format that the ending of a path asks for.
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name().and_then(OsStr::to_str)?.to_ascii_lowercase();
        Self::ALL.into_iter().find(|t| name.ends_with(&format!(".{}", t.ending())))
    }

    /// Ending of the names of such files, without the dot.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Nifti => "nii",
            Self::NiftiGz => "nii.gz",
            Self::Nrrd => "nrrd",
            Self::Npy => "npy",
            Self::MetaImage => "mha",
            Self::MetaHeader => "mhd",
            Self::Vti => "vti",
        }
    }

    /// Other files that are written with one of this path.
    pub(crate) fn companion(self, path: &Path) -> Option<PathBuf> {
        (self == Self::MetaHeader).then(|| path.with_extension("raw"))
    }
}

/// Writes a grid, and returns what the format could not hold, one sentence each.
///
/// # Errors
/// If the format cannot hold the grid's placement or size, or the operating system reports an error. Nothing is left
/// behind.
pub fn write(path: &Path, target: Target, source: &Source, name: &str, axes: Axes) -> Result<Vec<String>> {
    match target {
        Target::Nifti => nifti::write(path, source, false),
        Target::NiftiGz => nifti::write(path, source, true),
        Target::Nrrd => nrrd::write(path, source),
        Target::Npy => npy::write(path, source, axes),
        Target::MetaImage => meta_image::write(path, source),
        Target::MetaHeader => meta_image::write_apart(path, source),
        Target::Vti => vti::write(path, source, name),
    }
    .map_err(|e| e.at(path))
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
    fn endings_name_formats() {
        assert_eq!(Target::of(Path::new("a/b.NII.gz")), Some(Target::NiftiGz));
        assert_eq!(Target::of(Path::new("b.nii")), Some(Target::Nifti));
        assert_eq!(
            Target::of(Path::new("b.mhd")).and_then(|t| t.companion(Path::new("x/b.mhd"))),
            Some("x/b.raw".into())
        );
        assert_eq!(Target::of(Path::new("b.gz")), None);
        assert_eq!(numbers([1.0, -0.0, 1e-300, 0.1]), "1.0 0.0 1e-300 0.1");
    }
}
