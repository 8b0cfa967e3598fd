//! Grids of scans and of NanoVDBs, made as a conversion to a VDB makes them.

use super::ScanSettings;
use crate::error::{Code, Error, Result};
use crate::formats::format::Format;
use crate::formats::imaging::ImageFormat;
use crate::formats::imaging::image::{Header, Image};
use crate::formats::imaging::options::{Options, ReadOption};
use crate::formats::imaging::values::Mapping;
use crate::formats::imaging::volume::{self, GridType, Settings};
use crate::formats::limits::Limits;
use crate::formats::nanovdb;
use crate::formats::vdb::made::Grids;
use crate::formats::vdb::{NativeGrid, ValueKind};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Name of a grid whose quantity the file does not name.
const NAME: &str = "density";

/// Returns the name of the grid that an image becomes unless another one is asked for.
pub(crate) fn name_of(header: &Header) -> String {
    header.name.clone().filter(|name| !name.contains('\0')).unwrap_or_else(|| NAME.into())
}

/// A scan whose headers were read.
#[derive(Debug)]
pub(crate) struct Scan {
    path: PathBuf,
    reader: &'static ImageFormat,
    options: Options,
    grid_type: GridType,
    limits: Limits,
    list: Vec<(String, ValueKind)>,
    /// Images that were opened and not read yet, by their place.
    opened: RefCell<Vec<Option<Image>>>,
    texts: BTreeMap<String, String>,
}

impl Scan {
    /// Reads the headers of a scan. Where the file holds several points in time or channels, one must be chosen.
    ///
    /// # Errors
    /// If the file cannot be read, is damaged, leaves open what the settings do not state, or its images cannot become
    /// grids of the type that is asked for.
    pub(crate) fn open(
        path: &Path,
        (format, reader): (&Format, &'static ImageFormat),
        scan: &ScanSettings,
        limits: Limits,
    ) -> Result<Self> {
        let options = Options { unambiguous: true, ..scan.reading()? };
        let grid_type = scan.grid_type(format.kind.heeds(ReadOption::Axes));
        let images = reader.open(path, &options, limits)?;
        let entry = |image: &Image| {
            let name = name_of(&image.header);
            let kind = settings(&name, grid_type, limits).kind(&image.header);
            kind.map(|kind| (name.clone(), kind)).map_err(|e| e.part(format!("grid '{name}'")).at(path))
        };
        let list = images.iter().map(entry).collect::<Result<_>>()?;
        let opened = RefCell::new(images.into_iter().map(Some).collect());
        let (path, texts) = (path.to_path_buf(), BTreeMap::new());
        Ok(Self { path, reader, options, grid_type, limits, list, opened, texts })
    }

    /// Returns an image, opened anew if it was read before.
    fn image(&self, index: usize) -> Result<Image> {
        if let Some(image) = self.opened.borrow_mut().get_mut(index).and_then(Option::take) {
            return Ok(image);
        }
        let images = self.reader.open(&self.path, &self.options, self.limits)?;
        images.into_iter().nth(index).ok_or_else(|| {
            Error::invalid("the file changed while it was read: an array is gone")
                .hint("wait until the program that writes it is done, then try again")
        })
    }
}

/// Settings by which an image becomes a grid whose values are those of the file.
fn settings(name: &str, grid_type: GridType, limits: Limits) -> Settings<'_> {
    Settings { name, grid_type, mapping: Mapping::default(), limits }
}

impl Grids for Scan {
    fn list(&self) -> Vec<(String, ValueKind)> {
        self.list.clone()
    }

    fn texts(&self) -> &BTreeMap<String, String> {
        &self.texts
    }

    fn read(&self, index: usize, limits: Limits) -> Result<NativeGrid> {
        let name = self.list.get(index).map_or(NAME, |(name, _)| name);
        let mut image = self.image(index)?;
        let built = volume::build(&mut image, &settings(name, self.grid_type, limits), |_, _| {});
        built.map(|(native, _)| native).map_err(|e| match e.code() {
            Code::MemoryLimit => e.instead(
                "raise ⟨max_memory⟩, or make a VDB in which more is background with ⟨convert.threshold⟩ or \
                 ⟨convert.map⟩",
            ),
            _ => e,
        })
    }
}

/// A NanoVDB whose directory was read.
#[derive(Debug)]
pub(crate) struct Nano {
    file: RefCell<nanovdb::File>,
    list: Vec<(String, ValueKind)>,
    texts: BTreeMap<String, String>,
}

impl Nano {
    /// Reads the directory of a NanoVDB, and what it states beside its grids.
    ///
    /// # Errors
    /// If the file cannot be read, or its directory is damaged.
    pub(crate) fn open(path: &Path, limits: Limits) -> Result<Self> {
        let mut file = nanovdb::File::open(path, limits)?;
        let list: Vec<_> = file.entries().iter().map(|entry| (entry.name.clone(), entry.value_kind())).collect();
        let mut texts = BTreeMap::new();
        for index in 0..list.len() {
            for (name, text) in file.texts(index) {
                texts.entry(name).or_insert(text);
            }
        }
        Ok(Self { file: RefCell::new(file), list, texts })
    }
}

impl Grids for Nano {
    fn list(&self) -> Vec<(String, ValueKind)> {
        self.list.clone()
    }

    fn texts(&self) -> &BTreeMap<String, String> {
        &self.texts
    }

    fn read(&self, index: usize, _: Limits) -> Result<NativeGrid> {
        let volume = self.file.borrow_mut().read(index)?;
        volume.into_native().map(|(native, _)| native)
    }
}
