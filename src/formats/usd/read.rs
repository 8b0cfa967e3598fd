//! Composition of stages by the crate `openusd`, and copying of what it composes.
//!
//! The crate's handles live on one thread and may panic on damaged input. All work with them is done on a thread of its
//! own, whose panics become errors.

use super::attribute::Attribute;
use super::convert;
use super::metadata::{StageMetadata, UpAxis};
use super::prim::Prim;
use super::resolver::{self, Bounded, Met};
use super::value::Value;
use crate::error::{Error, Result};
use crate::formats::input;
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use openusd::sdf;
use openusd::usd::{self, PrimStatus};
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Once;

/// Stack of the thread, in bytes.
const STACK: usize = 32 << 20;
/// Largest number of prims.
const MOST_PRIMS: usize = 1_000_000;
/// Greatest depth of prims.
const MOST_DEPTH: usize = 256;
/// Name of the thread.
const THREAD: &str = "cumulo-usd";
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

/// Composed content of a stage.
pub(super) struct Composed {
    pub metadata: StageMetadata,
    pub layers: Vec<PathBuf>,
    pub faults: Vec<String>,
    pub prims: Vec<Prim>,
}

/// Composes a stage.
///
/// # Errors
/// If the root layer cannot be read, or the stage is empty or too large.
pub(super) fn stage(path: &Path, limits: Limits) -> Result<Composed> {
    let _reading = Reading::begin(path);
    // The error of a file that does not exist is the system's.
    drop(input::open(path)?);
    let absolute = std::path::absolute(path).map_err(|e| Error::io(path, e))?;
    silence();
    let compose = || composed(&absolute, limits).map_err(|e| e.at(path));
    let result = std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().name(THREAD.into()).stack_size(STACK);
        thread.spawn_scoped(scope, compose).map(|thread| thread.join())
    });
    match result.map_err(|e| Error::io(path, e))? {
        Ok(result) => result,
        Err(_) => Err(Error::invalid("the stage is damaged, or beyond what its reader can compose")
            .at(path)
            .hint("write the stage again where it was made, or flatten it with a tool for USD")),
    }
}

/// Keeps panics of the thread off the terminal; they become errors.
fn silence() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if std::thread::current().name() != Some(THREAD) {
                before(panic);
            }
        }));
    });
}

fn composed(path: &Path, limits: Limits) -> Result<Composed> {
    let met = Rc::new(RefCell::new(Met::default()));
    let mut root = path.to_string_lossy().into_owned();
    if path.extension().is_some_and(|suffix| suffix.eq_ignore_ascii_case("usdz")) {
        root = format!("{root}[{}]", resolver::root_layer(path)?);
    }
    let builder = usd::Stage::builder().resolver(Bounded::new(limits.max_memory / 4, Rc::clone(&met)));
    let opened = builder.open(&root).map_err(|e| {
        // The first fault of a layer says more than what became of it.
        let fault = met.borrow_mut().faults.pop();
        fault.unwrap_or_else(|| damaged(&e))
    })?;
    let reader = Reader { stage: opened };
    let prims = reader.prims()?;
    if prims.is_empty() {
        return Err(Error::invalid("the stage has no prims").hint("export it again with the objects it is to hold"));
    }
    let mut faults: Vec<String> = met.borrow().faults.iter().map(|e| e.to_string().replace("\n  ", "; ")).collect();
    for error in reader.stage.composition_errors() {
        let text = error.to_string();
        // A layer that cannot be read has been named with the place of its fault.
        if !text.starts_with("malformed") && !text.contains("failed to read") && !faults.contains(&text) {
            faults.push(text);
        }
    }
    faults.extend(
        prims
            .iter()
            .filter(|prim| reader.has_clips(prim))
            .map(|prim| format!("prim {}: its value clips are not read; samples within them are missing", prim.path)),
    );
    let layers = met.borrow().files.iter().cloned().collect();
    Ok(Composed { metadata: reader.metadata(), layers, faults, prims })
}

fn damaged(error: &anyhow::Error) -> Error {
    Error::invalid(format!("the stage cannot be read: {error:#}")).hint("write the stage again where it was made")
}

struct Reader {
    stage: usd::Stage,
}

impl Reader {
    fn metadata(&self) -> StageMetadata {
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

    /// Returns the prims in order.
    fn prims(&self) -> Result<Vec<Prim>> {
        let wanted = PrimStatus::ACTIVE | PrimStatus::LOADED | PrimStatus::DEFINED;
        let mut prims = Vec::new();
        let mut open = vec![(sdf::Path::abs_root(), 0, false)];
        let mut seen = 0_usize;
        while let Some((path, depth, instanced)) = open.pop() {
            let mut within = instanced;
            if depth > 0 {
                let inside = |e: anyhow::Error| damaged(&e).part(format!("prim {path}"));
                let status = self.stage.prim_status(path.clone()).map_err(inside)?;
                if !status.contains(wanted) || status.contains(PrimStatus::ABSTRACT) {
                    continue;
                }
                prims.push(self.prim(&path, instanced).map_err(inside)?);
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

    fn prim(&self, path: &sdf::Path, instanced: bool) -> anyhow::Result<Prim> {
        let prim = self.stage.prim(path.clone());
        let type_name = prim.type_name()?.map(|name| name.as_str().to_owned()).unwrap_or_default();
        let all = !GEOMETRY.contains(&type_name.as_str());
        let placed = |name: &str| name.starts_with("xformOp") || ["visibility", "purpose"].contains(&name);
        let mut read = Prim {
            path: path.as_str().to_owned(),
            type_name,
            schemas: prim.api_schemas()?.iter().map(|name| name.as_str().to_owned()).collect(),
            attributes: Default::default(),
            relationships: Default::default(),
            custom_data: prim.custom_data()?.and_then(|data| convert::value(data, &self.layer_of(&prim, "customData"))),
            instanced,
        };
        for attribute in prim.attributes()? {
            let name = attribute.path().property_suffix().trim_start_matches('.').to_owned();
            if all || placed(&name) {
                read.attributes.insert(name.clone(), self.attribute(name, &attribute)?);
            }
        }
        for relationship in prim.relationships()? {
            let name = relationship.path().property_suffix().trim_start_matches('.').to_owned();
            let targets = relationship.targets()?.iter().map(|target| target.as_str().to_owned()).collect();
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
            let sampled = layer.data().has_field(&path, "timeSamples");
            if sampled || layer.data().has_field(&path, "default") {
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

    fn has_clips(&self, prim: &Prim) -> bool {
        sdf::path(&prim.path).is_ok_and(|path| self.stage.prim(path).has_clips().unwrap_or_default())
    }
}

/// Returns the path of a default prim, which layers state by its name.
fn absolute(name: &str) -> String {
    if name.starts_with('/') { name.to_owned() } else { format!("/{name}") }
}
