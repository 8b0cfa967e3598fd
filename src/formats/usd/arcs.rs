//! Composition arcs that lead nowhere: layers and prims that references, payloads and sublayers name and that are not
//! there, or are something else.

use super::convert;
use super::fault::Fault;
use super::resolver::{OpenedLayers, is_layer, is_stage_name};
use super::targets::Absent;
use crate::error::Error;
use crate::formats::format::FileKind;
use crate::formats::{input, registry};
use openusd::ar;
use openusd::pcp;
use openusd::sdf;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Translator of the composition's errors for one stage.
pub(super) struct Arcs<'m> {
    /// Root layer as the composition knows it.
    root: &'m Path,
    met: &'m OpenedLayers,
    /// Paths of prims that are not active, which need no layers.
    inactive: BTreeSet<String>,
    /// Layers, as they are shown, that inactive prims name.
    unneeded: BTreeSet<String>,
    /// Faults so far by what is missing, those without which the stage is whole last.
    found: BTreeMap<(bool, String), Fault>,
}

impl<'m> Arcs<'m> {
    pub(super) fn new(root: &'m Path, met: &'m OpenedLayers, inactive: BTreeSet<String>) -> Self {
        Self { root, met, inactive, unneeded: BTreeSet::new(), found: BTreeMap::new() }
    }

    /// Returns the faults that errors of the composition stand for. Of several arcs to one layer or prim the first is
    /// named.
    pub(super) fn faults(mut self, errors: &[pcp::Error], absent: &[Absent]) -> Vec<Fault> {
        errors.iter().for_each(|error| self.add(error));
        for Absent { site, arc, stated_by, layer, target } in absent {
            let layer = self.display_path(Path::new(layer));
            let fault = self.no_prim(arc, &layer, target);
            let fault = self.stated_by(stated_by, fault).of_prim(site);
            self.found.entry((false, format!("{layer}<{target}>"))).or_insert(fault);
        }
        // A layer that no arc's error names is told as well.
        for error in &self.met.faults {
            let place = error.path().map(|path| self.display_path(path)).unwrap_or_default();
            let told = self.found.values().any(|fault| fault.what.contains(&format!("@{place}@")));
            if !told && !self.unneeded.contains(&place) {
                let what = format!("the layer @{place}@ cannot be read: {}", cause(error));
                self.found.insert((false, place), Fault::missing(what, remedy(error)));
            }
        }
        self.found.into_values().collect()
    }

    fn add(&mut self, error: &pcp::Error) {
        use pcp::Error as E;
        let (target, fault) = match error {
            E::UnresolvedLayer { asset_path, arc, introduced_by, site_path }
            | E::MalformedLayer { asset_path, arc, introduced_by, site_path, .. } => {
                let name = format!("its {}", word(arc));
                let fault = self.layer(&name, Path::new(asset_path), reason(error));
                (asset_path.clone(), self.stated_by(introduced_by, fault).of_prim(prim(site_path)))
            }
            E::UnresolvedSublayer { asset_path, introduced_by }
            | E::MalformedSublayer { asset_path, introduced_by, .. } => {
                let path = convert::asset(asset_path, Path::new(introduced_by)).path;
                let fault = self.layer("its sublayer", &path, reason(error));
                (path.to_string_lossy().into_owned(), self.stated_by(introduced_by, fault))
            }
            E::UnresolvedPrimPath { arc, target_layer, prim_path, introduced_by, site_path } => {
                let target = self.display_path(Path::new(target_layer));
                let fault = self.no_prim(&word(arc), &target, prim_path.as_str());
                (format!("{target}<{prim_path}>"), self.stated_by(introduced_by, fault).of_prim(prim(site_path)))
            }
            E::MissingDefaultPrim { layer_id, arc, site_path } | E::InvalidDefaultPrim { layer_id, arc, site_path } => {
                let target = self.display_path(Path::new(layer_id));
                let what = format!("its {} to @{target}@ names no prim, and that layer has no defaultPrim", word(arc));
                let remedy = "name the prim, as in @layer.usda@</World>, or state defaultPrim in that layer";
                (format!("{target}<>"), Fault::missing(what, remedy).of_prim(prim(site_path)))
            }
            E::InvalidExpression { .. } | E::InvalidPrimPath { .. } | E::ProhibitedRelocationSource { .. } => {
                (String::new(), Fault::missing(error.to_string(), LAYER))
            }
            other => (other.to_string(), Fault::remark(other.to_string(), LAYER)),
        };
        if fault.prim.as_ref().is_some_and(|prim| self.inactive.contains(prim)) {
            self.unneeded.insert(self.display_path(Path::new(&target)));
            return;
        }
        let key = (!fault.incomplete, if target.is_empty() { fault.what.clone() } else { target });
        self.found.entry(key).or_insert(fault);
    }

    /// Returns the fault of a prim that an arc leads to and its layer lacks.
    fn no_prim(&self, arc: &str, layer: &str, prim: &str) -> Fault {
        let what = format!("its {arc} leads to <{prim}> of @{layer}@, where no such prim is");
        Fault::missing(what, "correct the path of the prim, or add the prim to that layer")
    }

    /// Names the layer that states an arc, unless it is the root layer.
    fn stated_by(&self, identifier: &str, fault: Fault) -> Fault {
        let stated = Path::new(identifier);
        let other = !identifier.is_empty() && canonical(stated) != canonical(self.root);
        Fault { layer: other.then(|| PathBuf::from(self.display_path(stated))), ..fault }
    }

    /// Returns the fault of a layer that an arc, such as `its reference`, leads to.
    fn layer(&self, arc: &str, path: &Path, reason: Option<&str>) -> Fault {
        let shown = self.display_path(path);
        let fault = |cause: &dyn Display, remedy: &str| Fault::missing(format!("{arc} @{shown}@ {cause}"), remedy);
        let known =
            self.met.faults.iter().find(|error| error.path().is_some_and(|at| canonical(at) == canonical(path)));
        if let Some(error) = known {
            return fault(&format!("cannot be read: {}", cause(error)), &remedy(error));
        }
        let text = path.to_string_lossy();
        let (file, inner) = match ar::split_package_relative_path_outer(&text) {
            Some((package, inner)) => (PathBuf::from(package), Some(inner)),
            None => (path.to_path_buf(), None),
        };
        if let Err(error) = input::open(&file) {
            return match error.io_kind() {
                Some(std::io::ErrorKind::NotFound) => fault(&"does not exist", GONE),
                _ => fault(&format!("cannot be read: {}", cause(&error)), &remedy(&error)),
            };
        }
        match inner.as_deref() {
            Some(inner) if reason.is_none() => fault(&format!("does not exist: the package has no '{inner}'"), GONE),
            Some(inner) if !is_layer(Path::new(inner)) => fault(&format!("is no USD layer: {ENDINGS}"), EXPORT),
            None if !is_stage_name(&file) => other_kind(&file, &fault),
            _ => fault(&format!("cannot be read: {}", reason.unwrap_or("it is no USD layer")), EXPORT),
        }
    }

    /// Returns the path of a layer from the stage's folder where it lies in it.
    fn display_path(&self, path: &Path) -> String {
        let folder = self.root.to_string_lossy();
        let folder = folder.split(".usdz[").next().and_then(|root| Path::new(root).parent());
        let folders = folder.into_iter().flat_map(|folder| [folder.to_path_buf(), canonical(folder)]);
        let inside = folders.into_iter().find_map(|folder| path.strip_prefix(folder).ok().map(Path::to_path_buf));
        let inside = inside.filter(|inside| !inside.as_os_str().is_empty());
        inside.as_deref().unwrap_or(path).to_string_lossy().into_owned()
    }
}

const ENDINGS: &str = "the names of layers end in .usda, .usdc, .usd or .usdz";
const EXPORT: &str = "name a USD layer there, or write it again where it was made";
const GONE: &str = "correct the path, or copy the layer there";
/// Advice on a layer that states what cannot be composed.
pub(super) const LAYER: &str = "correct the layer that states it, or write it again where it was made";

/// Says what a file is that an arc takes for a layer and whose name is none of a layer.
fn other_kind(file: &Path, fault: &dyn Fn(&dyn Display, &str) -> Fault) -> Fault {
    let format = match registry::sniff(file) {
        Ok(format) => format,
        Err(error) => return fault(&format!("cannot be read: {}", cause(&error)), &remedy(&error)),
    };
    match format.kind {
        FileKind::Usd => fault(&format!("has no layer's name: {ENDINGS}"), "rename it, and correct the path"),
        FileKind::Vdb => fault(
            &"is an OpenVDB file, not a USD layer",
            "name it as the filePath of an OpenVDBAsset; `cumulo usd author` writes a stage of a VDB",
        ),
        _ => fault(&format!("is {}, not a USD layer: {ENDINGS}", format.phrase), EXPORT),
    }
}

/// Returns the path of the prim of a site, which may lie in a variant of the prim.
fn prim(site: &sdf::Path) -> String {
    site.strip_all_variant_selections().as_str().to_owned()
}

/// Returns the name of an arc's kind: `reference`, `payload`.
fn word(arc: &pcp::ArcType) -> String {
    format!("{arc:?}").to_lowercase()
}

fn reason(error: &pcp::Error) -> Option<&str> {
    match error {
        pcp::Error::MalformedLayer { reason, .. } | pcp::Error::MalformedSublayer { reason, .. } => Some(reason),
        _ => None,
    }
}

/// Returns the message of an error with its place, without its file.
fn cause(error: &Error) -> String {
    error.place().map_or_else(|| error.what().into_owned(), |place| format!("{place}: {}", error.what()))
}

fn remedy(error: &Error) -> Cow<'_, str> {
    error.remedy().unwrap_or(EXPORT.into())
}

/// Returns the canonical path of a file, or of a package with the path within it.
fn canonical(path: &Path) -> PathBuf {
    let text = path.to_string_lossy();
    match ar::split_package_relative_path_outer(&text) {
        Some((package, inner)) => {
            let package = Path::new(&package);
            let package = package.canonicalize().unwrap_or_else(|_| package.to_path_buf());
            PathBuf::from(format!("{}[{inner}]", package.display()))
        }
        None => path.canonicalize().unwrap_or_else(|_| path.to_path_buf()),
    }
}
