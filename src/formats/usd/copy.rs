//! Copying of composed stages from the crate `openusd`.

use super::attribute::Attribute;
use super::convert;
use super::inherits::Inherits;
use super::metadata::{StageMetadata, UpAxis};
use super::own;
use super::prim::Prim;
use super::targets::{self, Absent};
use super::value::Value;
use crate::error::{Error, Result};
use openusd::pcp;
use openusd::sdf;
use openusd::usd::{self, PrimStatus};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// Largest number of prims.
const MOST_PRIMS: usize = 1_000_000;
/// Largest sum over all prims of the squared number of sites, the prims of layers that a prim is composed of. Where
/// references lead to prims that reference further ones, the prims multiply and each has a site for every one of them.
const MOST_WORK: usize = 2_000_000;
/// Greatest depth of prims.
const MOST_DEPTH: usize = 256;
/// Attributes of meshes that are kept beside their placement.
const OF_MESHES: [&str; 8] = [
    "points",
    "faceVertexCounts",
    "faceVertexIndices",
    "subdivisionScheme",
    "primvars:displayColor",
    own::ALBEDO,
    own::EMISSION,
    own::HOLDOUT,
];
/// Attributes of subsets of faces that are kept.
const OF_SUBSETS: [&str; 2] = ["indices", "elementType"];
/// Types of prims of whose attributes only a few are kept: the others are large and say nothing of a volume.
const GEOMETRY: [&str; 10] = [
    "Mesh",
    "Points",
    "BasisCurves",
    "NurbsCurves",
    "HermiteCurves",
    "NurbsPatch",
    "TetMesh",
    "PointInstancer",
    "GeomSubset",
    "SkelAnimation",
];

/// Sites after which the composition is let go of. It takes some kilobytes a site, and is made anew where prims above
/// those to come are needed again.
const KEPT_SITES: usize = 16_384;

/// Copies a composed stage.
pub(super) struct Copier {
    stage: usd::Stage,
    /// Paths of the attributes that are splines.
    splines: RefCell<Vec<String>>,
    /// Paths of the prims whose values come from value clips.
    clips: RefCell<Vec<String>>,
    /// Errors of what was let go of, as they are shown so that each is kept once.
    errors: RefCell<BTreeMap<String, pcp::Error>>,
    /// Paths of the prims that are not active.
    inactive: RefCell<BTreeSet<String>>,
    /// Arcs that lead to no prim.
    absent: RefCell<Vec<Absent>>,
}

impl Copier {
    pub(super) fn new(stage: usd::Stage) -> Self {
        Self {
            stage,
            splines: RefCell::default(),
            clips: RefCell::default(),
            errors: RefCell::default(),
            inactive: RefCell::default(),
            absent: RefCell::default(),
        }
    }

    /// Returns the errors of the composition of the prims that were read.
    pub(super) fn composition_errors(&self) -> Vec<pcp::Error> {
        self.keep_errors();
        self.errors.borrow().values().cloned().collect()
    }

    fn keep_errors(&self) {
        let found = self.stage.composition_errors();
        self.errors.borrow_mut().extend(found.into_iter().map(|error| (error.to_string(), error)));
    }

    /// Lets go of the composition of all prims; layers stay.
    fn forget(&self) {
        self.keep_errors();
        // The crate drops what it has composed when other payloads are to be loaded.
        let rules = self.stage.load_rules();
        self.stage.set_load_rules(pcp::LoadRules::none());
        self.stage.set_load_rules(rules);
    }

    /// Returns the paths of the attributes met so far that are splines.
    pub(super) fn splines(&self) -> Vec<String> {
        self.splines.borrow().clone()
    }

    /// Returns the metadata of the stage.
    pub(super) fn metadata(&self) -> StageMetadata {
        let field = |name: &str| {
            let value = self.stage.stage_metadata(name).ok().flatten()?;
            convert::value(value, &self.root())
        };
        let number = |name: &str| field(name)?.number().filter(|v| v.is_finite());
        let positive = |name: &str| number(name).filter(|v| *v > 0.0);
        let up_axis = field("upAxis").and_then(|axis| match axis.text()? {
            "Y" => Some(UpAxis::Y),
            "Z" => Some(UpAxis::Z),
            _ => None,
        });
        let default_prim = field("defaultPrim").and_then(|name| name.text().map(absolute));
        StageMetadata {
            default_prim,
            up_axis,
            meters_per_unit: positive("metersPerUnit"),
            time_codes_per_second: positive("timeCodesPerSecond"),
            frames_per_second: positive("framesPerSecond"),
            start: number("startTimeCode"),
            end: number("endTimeCode"),
            documentation: field("documentation").and_then(|doc| doc.text().map(str::to_owned)),
            custom_data: field("customLayerData"),
        }
    }

    fn root(&self) -> PathBuf {
        PathBuf::from(self.stage.root_layer().identifier())
    }

    /// Returns the prims, parents before their children and siblings in their order.
    ///
    /// # Errors
    /// If a prim cannot be composed, or there are too many.
    pub(super) fn prims(&self) -> Result<Vec<Prim>> {
        let wanted = PrimStatus::ACTIVE | PrimStatus::LOADED | PrimStatus::DEFINED;
        let mut prims = Vec::new();
        let mut open = vec![(sdf::Path::abs_root(), 0, false)];
        let (mut seen, mut work, mut kept) = (0_usize, 0_usize, 0_usize);
        let mut inherits = Inherits::default();
        while let Some((path, depth, instanced)) = open.pop() {
            let mut within = instanced;
            if depth > 0 {
                let inside = |e: anyhow::Error| damaged(&e).part(format!("prim {path}"));
                let composed = self.shared(&path, instanced).map_err(inside)?;
                inherits.follow(&self.stage, &composed).map_err(|e| e.part(format!("prim {path}")))?;
                let status = self.stage.prim_status(path.clone()).map_err(inside)?;
                if !status.contains(PrimStatus::ACTIVE) {
                    self.inactive.borrow_mut().insert(path.as_str().to_owned());
                }
                if !status.contains(wanted) || status.contains(PrimStatus::ABSTRACT) {
                    continue;
                }
                let sites = self.sites(&path, instanced).map_err(inside)?;
                (work, kept) = (work + sites * sites, kept + sites);
                if work > MOST_WORK {
                    return Err(Error::unsupported(format!(
                        "references that lead to further references multiply its prims, of which {} were composed so \
                         far",
                        prims.len()
                    ))
                    .part(format!("prim {path}"))
                    .hint(
                        "reference each prim once, or give a stage of the volume with its cameras and lights alone",
                    ));
                }
                prims.push(self.prim(&path, instanced).map_err(inside)?);
                if kept > KEPT_SITES {
                    self.forget();
                    kept = 0;
                }
                within |= status.contains(PrimStatus::INSTANCE);
            }
            let names = self.stage.prim(path.clone()).child_names().map_err(|e| damaged(&e))?;
            seen += names.len();
            if seen > MOST_PRIMS || depth > MOST_DEPTH {
                return Err(Error::unsupported(format!(
                    "more than {MOST_PRIMS} prims, or prims more than {MOST_DEPTH} levels deep"
                ))
                .hint("give a stage of the volume with its cameras and lights alone"));
            }
            let children = names.iter().rev().filter_map(|name| path.append_path(name.as_str()).ok());
            open.extend(children.map(|child| (child, depth + 1, within)));
        }
        Ok(prims)
    }

    /// Returns the path at which a prim is composed: that in the prototype for prims in instances.
    fn shared(&self, path: &sdf::Path, instanced: bool) -> anyhow::Result<sdf::Path> {
        let prim = if instanced { self.stage.prim(path.clone()).prim_in_prototype()? } else { None };
        Ok(prim.map_or_else(|| path.clone(), |prim| prim.path().clone()))
    }

    /// Returns the number of sites that a prim is composed of, and keeps what its arcs lack. Those of prims in
    /// instances are the prototype's.
    fn sites(&self, path: &sdf::Path, instanced: bool) -> anyhow::Result<usize> {
        if instanced {
            return Ok(1);
        }
        let index = self.stage.prim_index(path.clone()).graph()?;
        self.absent.borrow_mut().extend(targets::absent(&self.stage, path, &index));
        Ok(index.all_nodes().count())
    }

    fn prim(&self, path: &sdf::Path, instanced: bool) -> anyhow::Result<Prim> {
        let prim = self.stage.prim(path.clone());
        let type_name = prim.type_name()?.map(|name| name.as_str().to_owned()).unwrap_or_default();
        let all = !GEOMETRY.contains(&type_name.as_str());
        let of_type: &[&str] = match type_name.as_str() {
            "Mesh" => &OF_MESHES,
            "GeomSubset" => &OF_SUBSETS,
            _ => &[],
        };
        let kept = |name: &str| {
            name.starts_with("xformOp") || ["visibility", "purpose"].contains(&name) || of_type.contains(&name)
        };
        let mut read = Prim {
            path: path.as_str().to_owned(),
            type_name,
            schemas: prim.api_schemas()?.iter().map(|name| name.as_str().to_owned()).collect(),
            attributes: Default::default(),
            relationships: Default::default(),
            custom_data: prim.custom_data()?.and_then(|data| convert::value(data, &self.layer_of(&prim, "customData"))),
            instanced,
        };
        if prim.has_clips().unwrap_or_default() {
            self.clips.borrow_mut().push(read.path.clone());
        }
        for attribute in prim.attributes()? {
            let name = attribute.path().property_suffix().trim_start_matches('.').to_owned();
            if all || kept(&name) {
                read.attributes.insert(name.clone(), Box::new(self.attribute(name, &attribute)?));
            }
        }
        for relationship in prim.relationships()? {
            let name = relationship.path().property_suffix().trim_start_matches('.').to_owned();
            let targets = relationship.forwarded_targets()?.iter().map(|target| target.as_str().to_owned()).collect();
            read.relationships.insert(name, targets);
        }
        Ok(read)
    }

    fn attribute(&self, name: String, attribute: &usd::Attribute) -> anyhow::Result<Attribute> {
        let type_name = attribute.type_name()?.map(|name| name.as_str().to_owned()).unwrap_or_default();
        let (sampled, layer) = self.source(attribute)?;
        let read = |value: sdf::Value| Some(convert::typed(convert::value(value, &layer)?, &type_name, &layer));
        let mut samples: Vec<(f64, Option<Value>)> = Vec::new();
        if sampled {
            let all = attribute.time_samples()?.unwrap_or_default();
            samples
                .extend(all.into_iter().filter(|(time, _)| time.is_finite()).map(|(time, value)| (time, read(value))));
            samples.sort_by(|a, b| a.0.total_cmp(&b.0));
            samples.dedup_by(|later, earlier| later.0 == earlier.0);
        }
        let default = attribute.get::<sdf::Value>()?.and_then(read);
        let connections = attribute.connections()?.iter().map(|path| path.as_str().to_owned()).collect();
        let layer = if type_name.starts_with("asset") { layer } else { PathBuf::new() };
        Ok(Attribute { name, type_name, default, samples, connections, layer })
    }

    /// Returns whether the strongest layer with an opinion has time samples, and that layer's file.
    fn source(&self, attribute: &usd::Attribute) -> anyhow::Result<(bool, PathBuf)> {
        for (identifier, path) in attribute.property_stack()? {
            let Some(layer) = self.stage.layer(&identifier) else { continue };
            let has = |field: &str| layer.data().has_field(&path, field);
            let sampled = has("timeSamples");
            if !sampled && has("spline") {
                self.splines.borrow_mut().push(attribute.path().as_str().to_owned());
                return Ok((false, PathBuf::from(identifier)));
            }
            if sampled || has("default") {
                return Ok((sampled, PathBuf::from(identifier)));
            }
        }
        Ok((false, self.root()))
    }

    /// Returns the file of the strongest layer that has a field of a prim.
    fn layer_of(&self, prim: &usd::Prim, field: &str) -> PathBuf {
        let stack = prim.prim_stack().unwrap_or_default();
        let holds = |(identifier, path): &(String, sdf::Path)| {
            self.stage.layer(identifier).is_some_and(|layer| layer.data().has_field(path, field))
        };
        stack.into_iter().find(holds).map_or_else(|| self.root(), |(identifier, _)| PathBuf::from(identifier))
    }

    /// Returns the arcs of the prims read so far that lead to no prim.
    pub(super) fn absent(&self) -> Vec<Absent> {
        self.absent.borrow().clone()
    }

    /// Returns the paths of the prims met so far that are not active.
    pub(super) fn inactive(&self) -> BTreeSet<String> {
        self.inactive.borrow().clone()
    }

    /// Returns the paths of the prims read so far whose values come from value clips.
    pub(super) fn clips(&self) -> Vec<String> {
        self.clips.borrow().clone()
    }
}

/// Returns the error of a stage that cannot be composed.
pub(super) fn damaged(error: &anyhow::Error) -> Error {
    Error::invalid(format!("the stage cannot be read: {error:#}")).hint("write the stage again where it was made")
}

/// Returns the path of a default prim, which layers state by its name.
fn absolute(name: &str) -> String {
    if name.starts_with('/') { name.to_owned() } else { format!("/{name}") }
}
