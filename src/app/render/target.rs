//! Where pictures go: a folder with the capture that they make, or one file.

use super::RenderSettings;
use crate::app::outputs;
use crate::app::pictures::PictureSettings;
use crate::app::pictures::SIZE;
use crate::error::{Error, Result};
use crate::formats::exr::{self, Attributes, Half, Packing, Placement, Storage};
use crate::formats::png::{self, ToneMapping};
use crate::formats::registry::EXR;
use crate::formats::transforms::FILE_NAME;
use crate::scene::capture::Frame;
use crate::scene::film::{Film, Plane};
use std::path::{Path, PathBuf};

/// Where pictures go.
#[derive(Debug, Clone, Copy)]
pub(super) enum Target<'p> {
    /// Folder for transforms.json and any number of pictures.
    Folder(&'p Path),
    /// File of the one picture: OpenEXR, or PNG.
    File(&'p Path),
}

impl<'p> Target<'p> {
    /// Returns what a path stands for: a file if it ends as pictures do, unless it is a folder.
    ///
    /// # Errors
    /// If the path cannot be what its name says, or cannot be written.
    pub(crate) fn of(path: &'p Path) -> Result<Self> {
        Ok(match outputs::pictures(path)? {
            Some(_) => Self::File(path),
            None => Self::Folder(path),
        })
    }

    /// Refuses several pictures for one file. `what` are views or frames, and `option` chooses one.
    ///
    /// # Errors
    /// If there is not one picture for a file.
    pub(crate) fn holds(self, count: usize, what: &str, option: &str) -> Result<()> {
        match self {
            Self::File(path) if count != 1 => {
                Err(Error::invalid(format!("{count} {what} are to be rendered, and this is the name of one picture"))
                    .at(path)
                    .hint(format!("give the name of a folder, or choose one with {option}")))
            }
            _ => Ok(()),
        }
    }

    /// Returns the path of the picture that would have this name in a folder.
    pub(crate) fn picture(self, name: &str) -> PathBuf {
        match self {
            Self::Folder(folder) => folder.join(name),
            Self::File(path) => path.to_path_buf(),
        }
    }

    /// Returns the path of the capture, which a file does not have.
    pub(crate) fn json(self) -> Option<PathBuf> {
        match self {
            Self::Folder(folder) => Some(folder.join(FILE_NAME)),
            Self::File(_) => None,
        }
    }
}

impl PictureSettings {
    /// Returns the size of the whole picture that a part goes to a file of; `None` in a folder, whose capture's cameras
    /// are those of the part. `stated` is the view as `cameras` states it.
    pub(super) fn whole(&self, target: Target<'_>, stated: Option<&Frame>) -> Option<[usize; 2]> {
        matches!(target, Target::File(_)).then(|| self.whole_size(stated).map(|side| side as usize))
    }

    /// Returns the size of the whole picture of a view, which `cameras` may state.
    pub(super) fn whole_size(&self, stated: Option<&Frame>) -> [u32; 2] {
        stated.map_or(self.size.unwrap_or(SIZE), |f| [f.camera.width, f.camera.height])
    }
}

/// Values of a picture's colors, and of its planes that are named as colors are.
fn all_colors(film: &Film) -> impl Iterator<Item = f32> + '_ {
    let named = |plane: &&Plane| ["R", "G", "B"].contains(&plane.name.rsplit('.').next().unwrap_or_default());
    let planes = film.planes.iter().filter(named).flat_map(|plane| plane.samples.iter().copied());
    film.rgba.iter().flat_map(|rgba| rgba[..3].iter().copied()).chain(planes)
}

/// Largest number of 16 bits.
const MOST_HALF: f32 = 65504.0;

impl RenderSettings {
    /// Returns the files of a picture: itself, and the PNG beside it if PNGs are asked for.
    pub(super) fn files_of(&self, picture: &Path) -> Vec<PathBuf> {
        let beside = (self.png && EXR.has_name(picture)).then(|| picture.with_extension("png"));
        std::iter::once(picture.to_path_buf()).chain(beside).collect()
    }

    /// Returns how pictures become PNGs.
    pub(super) fn tone_mapping(&self) -> ToneMapping {
        ToneMapping { exposure: self.exposure.unwrap_or(0.0) }
    }

    /// Returns how pictures become PNGs, if any do.
    pub(super) fn tone_mapping_used(&self) -> Option<ToneMapping> {
        let file = matches!(Target::of(&self.output), Ok(Target::File(path)) if !EXR.has_name(path));
        (self.png || file).then(|| self.tone_mapping())
    }

    /// Writes a picture as its name says. `whole` is the size of the picture that a part given by `crop` belongs to,
    /// for a file's display window.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn write_picture(
        &self,
        path: &Path,
        film: &Film,
        attributes: &Attributes,
        whole: Option<[usize; 2]>,
    ) -> Result<()> {
        if !EXR.has_name(path) {
            return png::write_film(path, film, self.tone_mapping(), attributes);
        }
        let fits = || film.rgba.iter().flatten().all(|v| v.abs() <= MOST_HALF || !v.is_finite());
        let half = if self.half && fits() { Half::Colors } else { Half::None };
        // DWA makes half floats of what it takes for colors.
        let packing = if all_colors(film).all(|v| v.abs() <= MOST_HALF) { self.compression } else { Packing::Zip };
        let storage = Storage { half, packing };
        match (whole, self.pictures.crop) {
            (Some(display), Some(part)) => {
                let origin = part.origin.map(|v| v as usize);
                exr::write_part(path, film, attributes, storage, Placement { display, origin })
            }
            _ => exr::write_picture(path, film, attributes, storage),
        }
    }
}
