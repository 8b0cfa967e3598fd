//! Files of packages, written to a temporary folder so that their readers can open them.

use super::resolver;
use super::value::Asset;
use crate::error::{Error, Result};
use crate::formats::reading::KnownAs;
use crate::formats::temporary::TemporaryFolder;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Files that were taken out of packages; they are removed on drop.
#[derive(Debug, Default)]
pub(super) struct Unpacked {
    folder: Option<TemporaryFolder>,
    /// Places of the files by their paths in packages, by which messages name them.
    files: BTreeMap<PathBuf, (PathBuf, KnownAs)>,
}

impl Unpacked {
    /// Returns the place of a file of a package, which is written on the first call; messages name it `shown`.
    ///
    /// # Errors
    /// If the file cannot be read, has more than `most` bytes, or cannot be written.
    pub(super) fn file(&mut self, asset: &Asset, shown: &Path, most: u64) -> Result<PathBuf> {
        if let Some((place, _)) = self.files.get(&asset.path) {
            return Ok(place.clone());
        }
        let Some((package, inner)) = asset.packaged() else { return Ok(asset.path.clone()) };
        let bytes = resolver::entry(package, inner, most).map_err(|e| e.at(shown))?;
        let folder = match &self.folder {
            Some(folder) => folder.path(),
            None => self.folder.insert(TemporaryFolder::new(&std::env::temp_dir())?).path(),
        };
        // Each file has a folder of its own: two of one name, in different folders of a package, stay apart.
        let folder = folder.join(self.files.len().to_string());
        let place = folder.join(Path::new(inner).file_name().unwrap_or(inner.as_ref()));
        // Not with the folders above: that which was removed at the end of the program must not come back.
        std::fs::create_dir(&folder).map_err(|e| Error::io(&folder, e))?;
        std::fs::write(&place, bytes).map_err(|e| Error::io(&place, e))?;
        self.files.insert(asset.path.clone(), (place.clone(), KnownAs::begin(&place, shown)));
        Ok(place)
    }
}
