//! Composition of stages by the crate `openusd`.
//!
//! The crate's handles live on one thread and may panic on damaged input. All work with them is done on a thread of its
//! own, whose panics become errors.

use super::arcs::Arcs;
use super::copy::{Copier, damaged};
use super::fault::Fault;
use super::metadata::StageMetadata;
use super::prim::Prim;
use super::resolver::{self, Bounded, OpenedLayers};
use super::xform;
use crate::error::{Error, Result};
use crate::formats::input;
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use openusd::usd;
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Once;

/// Stack of the thread, in bytes.
const STACK: usize = 32 << 20;
/// Name of the thread.
const THREAD: &str = "cumulo-usd";
/// Composed content of a stage.
pub(super) struct Composed {
    pub metadata: StageMetadata,
    pub layers: Vec<PathBuf>,
    pub faults: Vec<Fault>,
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
    let met = Rc::new(RefCell::new(OpenedLayers::default()));
    let mut root = path.to_string_lossy().into_owned();
    if resolver::is_package(path) {
        root = format!("{root}[{}]", resolver::root_layer(path)?);
    }
    let builder = usd::Stage::builder().resolver(Bounded::new(limits.max_memory / 4, Rc::clone(&met)));
    let opened = builder.open(&root).map_err(|e| {
        // The first fault of a layer says more than what became of it.
        let fault = met.borrow_mut().faults.pop();
        fault.unwrap_or_else(|| damaged(&e))
    })?;
    let copier = Copier::new(opened);
    let prims = copier.prims()?;
    if prims.is_empty() {
        return Err(Error::invalid("the stage has no prims").hint("export it again with the objects it is to hold"));
    }
    let faults = faults(&copier, Path::new(&root), &met.borrow(), &prims);
    let layers = met.borrow().files.iter().cloned().collect();
    Ok(Composed { metadata: copier.metadata(), layers, faults, prims })
}

/// Returns the faults of the composition, and what of the stage is not read.
fn faults(copier: &Copier, root: &Path, met: &OpenedLayers, prims: &[Prim]) -> Vec<Fault> {
    let mut faults = Arcs::new(root, met, copier.inactive()).faults(&copier.composition_errors(), &copier.absent());
    faults.extend(copier.clips().into_iter().map(|path| {
        let what = "its value clips are not read; samples within them are missing";
        Fault::remark(what, "write the samples into a layer, as flattening the stage does").of_prim(path)
    }));
    faults.extend(copier.splines().into_iter().map(|path| {
        let what = format!("attribute {path}: splines are not read; it has no value");
        Fault::remark(what, "write the curve as time samples")
    }));
    faults.extend(prims.iter().filter_map(without_effect));
    faults
}

/// Returns what a prim states that its type does not have.
fn without_effect(prim: &Prim) -> Option<Fault> {
    let unused = |names: &[&'static str]| names.iter().copied().find(|name| prim.attribute(name).is_some());
    let (kind, name) = match prim.type_name.as_str() {
        "" => ("without a type", unused(&["xformOpOrder", "visibility", "purpose"])?),
        _ if !xform::is_transformable(prim) => ("of type Scope", unused(&["xformOpOrder"])?),
        _ => return None,
    };
    let what = format!("its '{name}' has no effect, since prims {kind} have none");
    Some(Fault::remark(what, "give the prim the type Xform, or remove the attribute").of_prim(&prim.path))
}
