//! Stages, composed and read as a whole.

use super::fault::Fault;
use super::metadata::{StageMetadata, UpAxis};
use super::prim::Prim;
use super::resolver;
use super::unpacked::Unpacked;
use super::value::Asset;
use super::{read, xform};
use crate::error::{Error, Result};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::{input, registry};
use glam::DMat4;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// A composed stage.
///
/// Prims are those that are active, loaded, defined and not abstract, parents before their children and siblings in
/// their order; prims within instances are listed as if there were no instancing.
#[derive(Debug)]
pub struct Stage {
    /// File of the root layer, or the package.
    pub path: PathBuf,
    /// Metadata.
    pub metadata: StageMetadata,
    /// Files of all layers that were read, packages among them.
    pub layers: Vec<PathBuf>,
    /// Faults of the composition: layers that are missing or cannot be read, targets that are missing, cycles. What
    /// depends on them is missing from the stage; [`Stage::whole`] refuses it then.
    pub faults: Vec<Fault>,
    prims: Vec<Prim>,
    /// Places of the prims by their paths.
    places: BTreeMap<String, usize>,
    /// Files that were taken out of packages.
    unpacked: Mutex<Unpacked>,
    limits: Limits,
}

impl Stage {
    /// Opens a stage with all that it references: `.usda`, `.usdc`, `.usd` or `.usdz`. Payloads are loaded.
    ///
    /// # Errors
    /// If the root layer cannot be read or parsed, or the stage has no prim at all, more than a million, or references
    /// that multiply them. The error names the file, and the line or the prim where it is known.
    pub fn open(path: &Path, limits: Limits) -> Result<Self> {
        let format = registry::sniff(path)?;
        if !matches!(format.kind, FileKind::Usd | FileKind::Unknown) {
            return Err(Error::unsupported(format!("a USD stage is expected, and this is {}", format.phrase))
                .at(path)
                .hint("give a .usda, .usdc, .usd or .usdz; `cumulo usd author` writes a stage of a VDB"));
        }
        let read::Composed { metadata, layers, faults, prims } = read::stage(path, limits)?;
        let places = prims.iter().enumerate().map(|(place, prim)| (prim.path.clone(), place)).collect();
        Ok(Self {
            path: path.to_path_buf(),
            metadata,
            layers,
            faults,
            prims,
            places,
            unpacked: Mutex::default(),
            limits,
        })
    }

    /// Refuses a stage that lacks layers or prims which it names: what is made of it would lack what they hold.
    ///
    /// # Errors
    /// If there are such faults. The error names the stage and the layer and prim of the first, and tells how many
    /// there are.
    pub fn whole(&self) -> Result<()> {
        let mut missing = self.faults.iter().filter(|fault| fault.incomplete);
        let Some(first) = missing.next() else { return Ok(()) };
        let error = first.error(&self.path);
        Err(match missing.count() {
            0 => error,
            more => {
                let what = format!("{}; {more} more such faults, which `cumulo usd lint` lists", error.what());
                error.saying(what)
            }
        })
    }

    /// Returns the prims, parents before their children.
    pub fn prims(&self) -> impl Iterator<Item = &Prim> {
        self.prims.iter()
    }

    /// Returns the prims of a type.
    pub fn of_type<'s>(&'s self, type_name: &'s str) -> impl Iterator<Item = &'s Prim> {
        self.prims.iter().filter(move |prim| prim.type_name == type_name)
    }

    /// Returns a prim by its absolute path.
    pub fn prim(&self, path: &str) -> Option<&Prim> {
        self.places.get(path).map(|place| &self.prims[*place])
    }

    /// Returns the prims right beneath a prim.
    pub(crate) fn children<'s>(&'s self, prim: &'s Prim) -> impl Iterator<Item = &'s Prim> {
        let first = self.places.get(&prim.path).map_or(self.prims.len(), |place| place + 1);
        let beneath = |other: &&Prim| other.path.strip_prefix(&prim.path).is_some_and(|rest| rest.starts_with('/'));
        let beneath = self.prims[first..].iter().take_while(beneath);
        beneath.filter(|other| other.parent() == Some(&prim.path))
    }

    /// Returns a prim and its ancestors, from the prim upwards.
    pub(crate) fn upwards<'s>(&'s self, prim: &'s Prim) -> impl Iterator<Item = &'s Prim> {
        std::iter::successors(Some(prim), |prim| self.prim(prim.parent()?))
    }

    /// Returns the axis that points upwards: Y unless the stage states Z.
    pub fn up_axis(&self) -> UpAxis {
        self.metadata.up_axis.unwrap_or(UpAxis::Y)
    }

    /// Returns the length of a unit in meters: 0.01 unless the stage states another.
    pub fn meters_per_unit(&self) -> f64 {
        self.metadata.meters_per_unit.unwrap_or(0.01)
    }

    /// Returns the time codes per second: 24 unless the stage states time codes or frames per second.
    pub fn time_codes_per_second(&self) -> f64 {
        let StageMetadata { time_codes_per_second, frames_per_second, .. } = self.metadata;
        time_codes_per_second.or(frames_per_second).unwrap_or(24.0)
    }

    /// Returns the first time code of the stage: the one that it states, else that of its earliest time sample, else 0.
    pub fn first_time(&self) -> f64 {
        self.metadata.start.unwrap_or_else(|| {
            let first = self.sample_times().fold(f64::INFINITY, f64::min);
            if first.is_finite() { first } else { 0.0 }
        })
    }

    /// Returns the last time code of the stage: the one that it states, else that of its latest time sample, else 0.
    pub fn last_time(&self) -> f64 {
        self.metadata.end.unwrap_or_else(|| {
            let last = self.sample_times().fold(f64::NEG_INFINITY, f64::max);
            if last.is_finite() { last } else { 0.0 }
        })
    }

    fn sample_times(&self) -> impl Iterator<Item = f64> + '_ {
        self.prims.iter().flat_map(|prim| prim.attributes.values()).flat_map(|attribute| attribute.times())
    }

    /// Returns the map from a prim's own space to that of the stage, at a time code.
    ///
    /// # Errors
    /// If an operation of the prim or of one above it cannot be used; the error names the prim.
    pub fn local_to_world(&self, prim: &Prim, time: f64) -> Result<DMat4> {
        let mut map = DMat4::IDENTITY;
        for prim in self.upwards(prim) {
            let local = xform::local(prim, time).map_err(|e| e.inside(format!("prim {}", prim.path)).at(&self.path))?;
            map = local.matrix * map;
            if local.resets {
                break;
            }
        }
        Ok(map)
    }

    /// True if a prim's place in the stage changes over time.
    pub(crate) fn is_moving(&self, prim: &Prim) -> bool {
        self.upwards(prim).any(|prim| {
            let operations = prim.attributes.values().filter(|a| a.name.starts_with("xformOp"));
            operations.into_iter().any(|a| a.is_animated())
        })
    }

    /// True if a prim and all above it are visible at a time code and meant for rendering: their purpose is neither
    /// `guide` nor `proxy`. What lies beneath a `PointInstancer` is not rendered, since it is there for its instances
    /// alone.
    pub fn is_rendered(&self, prim: &Prim, time: f64) -> bool {
        // The purpose stated nearest to the prim counts, `default` as well.
        let purpose = self.upwards(prim).filter(|p| p.is_typed()).find_map(|prim| prim.text("purpose", time));
        let meant = purpose.is_none_or(|purpose| purpose == "render" || purpose == "default");
        meant && self.is_visible(prim, time) && !self.is_prototype(prim)
    }

    /// True if neither a prim nor one above it is made invisible at a time code. Prims without a type have no
    /// visibility.
    pub(crate) fn is_visible(&self, prim: &Prim, time: f64) -> bool {
        let hides = |prim: &Prim| prim.is_typed() && prim.text("visibility", time).is_some_and(|v| v == "invisible");
        !self.upwards(prim).any(hides)
    }

    /// True if a prim lies beneath a `PointInstancer`, which shows it at the places of its instances alone.
    pub(crate) fn is_prototype(&self, prim: &Prim) -> bool {
        self.upwards(prim).skip(1).any(|prim| prim.type_name == "PointInstancer")
    }

    /// Returns the path of an asset's file. Files in packages are written to a temporary folder first, which lives as
    /// long as the stage.
    ///
    /// # Errors
    /// If the path is empty, or a file in a package cannot be read. A file that does not exist is no error.
    pub fn file(&self, asset: &Asset) -> Result<PathBuf> {
        if asset.path.as_os_str().is_empty() {
            return Err(Error::invalid(format!("the path @{}@ names no file", asset.authored))
                .at(&self.path)
                .hint("state the path itself: variable expressions in backticks are not evaluated"));
        }
        if asset.packaged().is_none() {
            return Ok(asset.path.clone());
        }
        let mut unpacked = self.unpacked.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        unpacked.file(asset, &self.display_path(asset), self.limits.max_memory)
    }

    /// Returns the path of an asset's file for messages: `PACKAGE.usdz[PATH]` within a package.
    pub(crate) fn display_path(&self, asset: &Asset) -> PathBuf {
        match asset.packaged() {
            Some((package, inner)) if is_same(package, &self.path) => {
                PathBuf::from(format!("{}[{inner}]", self.path.display()))
            }
            _ => asset.path.clone(),
        }
    }

    /// Reads an asset's file, whose place `read` is given. Errors name it as [`Stage::display_path`] does.
    ///
    /// # Errors
    /// If [`Stage::file`] or `read` fails.
    pub(super) fn read<T>(&self, asset: &Asset, read: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
        let place = self.file(asset)?;
        read(&place).map_err(|e| e.known_as(&place, &self.display_path(asset)))
    }

    /// True if the file of an asset exists and can be opened.
    pub fn exists(&self, asset: &Asset) -> bool {
        self.absence(asset).is_none()
    }

    /// Says why the file of an asset is not there to be read, as in "does not exist" or "cannot be read: this is a
    /// folder"; `None` if it can be opened.
    pub(crate) fn absence(&self, asset: &Asset) -> Option<String> {
        let refused = |e: Error| match e.io_kind() {
            Some(std::io::ErrorKind::NotFound) => "does not exist".to_owned(),
            _ => format!("cannot be read: {}", e.what()),
        };
        match asset.packaged() {
            Some((package, inner)) => match resolver::open_package(package) {
                Ok(archive) => archive.index_for_name(inner).is_none().then(|| "is not in the package".to_owned()),
                Err(error) => Some(refused(error)),
            },
            None => input::open(&asset.path).err().map(refused),
        }
    }

    /// Returns the files that pictures need beside those of fields, textures of domes and transfer functions, each with
    /// the prim and the attribute that name it.
    pub(crate) fn other_files(&self) -> impl Iterator<Item = (&Prim, &'static str, &Asset)> {
        let named = self.prims.iter().filter_map(|prim| match prim.type_name.as_str() {
            "DomeLight" | "DomeLight_1" => Some((prim, "inputs:texture:file")),
            "Volume" => Some((prim, "cumulo:transfer")),
            _ => None,
        });
        let stated = named.filter_map(|(prim, name)| Some((prim, name, prim.attribute(name)?)));
        stated.flat_map(|(prim, name, attribute)| {
            let assets = attribute.values().filter_map(|value| value.asset()).filter(|a| !a.authored.is_empty());
            assets.map(move |asset| (prim, name, asset))
        })
    }
}

fn is_same(a: &Path, b: &Path) -> bool {
    a == b || a.canonicalize().ok().is_some_and(|a| b.canonicalize().is_ok_and(|b| a == b))
}
