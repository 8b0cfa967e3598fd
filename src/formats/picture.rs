//! Pictures of captures: OpenEXR, and formats of integer samples with a stated color space. All become scene-linear and
//! premultiplied.

pub use super::raster::{Header, Options};

use super::format::{FileKind, Format};
use super::{exr, input, registry};
use crate::error::{Code, Error, Result};
use crate::formats::reading::Reading;
use crate::scene::film::Film;
use std::path::Path;

/// A picture that was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Scene-linear, premultiplied pixels.
    pub film: Film,
    /// Number of NaN and infinite samples, which only OpenEXR can hold.
    pub non_finite: usize,
}

/// Detects the format of a picture by its content.
///
/// # Errors
/// If the file cannot be read, or is no picture.
pub fn format(path: &Path) -> Result<&'static Format> {
    input::open(path)?;
    registry::find(path, FileKind::is_picture)?.ok_or_else(|| {
        let names = registry::names(FileKind::is_picture).join(" nor ");
        Error::unsupported(format!("the picture is neither {names}"))
            .hint("write it as a scene-linear EXR; the first bytes of the file tell its format, not its name")
            .at(path)
    })
}

/// Reads the header of a picture.
///
/// # Errors
/// If [`format()`] fails, the header is damaged or states a size that cannot be used, or the picture is deep.
pub fn header(path: &Path) -> Result<Header> {
    match format(path)?.kind {
        FileKind::Picture(reader) => (reader.header)(path).map_err(|e| e.at(path)),
        FileKind::DeepExr => Err(exr::deep::refusal(path)),
        _ => Ok(Header { size: exr::header(path)?.display_window.size, bits: None, color_space: None }),
    }
}

/// Reads a picture as [`read`] does, or a deep one composited.
///
/// # Errors
/// The conditions are those of [`read`], but for deep pictures, of which a layer cannot be chosen.
pub(crate) fn read_or_flattened(path: &Path, options: &Options) -> Result<Picture> {
    if !exr::deep::is_deep(path) {
        return read(path, options);
    }
    let exr::Picture { film, non_finite, .. } = exr::deep::picture_or_flattened(path, options.layer, options.limits)?;
    Ok(Picture { film, non_finite })
}

/// Reads a picture. OpenEXR samples are taken as they are. Integer samples are decoded by their color space; straight
/// alpha is premultiplied, and the color composited over the background, so that pixels hold the radiance that arrives,
/// as in EXRs; alpha stays.
///
/// # Errors
/// If the picture cannot be read, does not fit into the limits, or has integer samples whose color space is not known,
/// or a layer is chosen of a picture that has none.
pub fn read(path: &Path, options: &Options) -> Result<Picture> {
    let _reading = Reading::begin(path);
    let FileKind::Picture(reader) = format(path)?.kind else {
        let exr::Picture { film, non_finite, .. } = exr::picture_within(path, options.layer, options.limits)?;
        return Ok(Picture { film, non_finite });
    };
    let decoded = || {
        if let Some(layer) = options.layer {
            return Err(Error::invalid(format!("layer '{layer}' of a picture that has no layers"))
                .coded(Code::NoSuchLayer)
                .hint("only OpenEXR pictures have layers: leave ⟨layer⟩ out"));
        }
        (reader.read)(path, options)
    };
    let film = decoded().map_err(|e| e.at(path))?;
    Ok(Picture { film, non_finite: 0 })
}
