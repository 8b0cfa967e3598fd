//! Reconstructs the density of a volume from absorption pictures and writes it as a VDB.
//!
//! `cargo run --release --example reconstruct -- shots found.vdb`

use cumulo::cancel::Cancel;
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::{Codec, write_grids};
use cumulo::formats::{exr, transforms};
use cumulo::inverse::density::multilevel;
use cumulo::inverse::density::{Outcome, Request};
use cumulo::inverse::observation::Observation;
use cumulo::inverse::observation::photo::Photo;
use cumulo::inverse::region::hull::Hull;
use cumulo::inverse::region::lattice;
use cumulo::{Error, Result};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// Reconstructs 24 voxels along the longest edge; the first view is held out.
///
/// # Errors
/// If the pictures cannot be read or used, or the volume cannot be written.
pub fn run(folder: &Path, volume: &Path) -> Result<Outcome> {
    let capture = transforms::load(&transforms::json_path(folder))?;
    let mut photos = Vec::new();
    for frame in &capture.frames {
        let film = exr::read_picture(&frame.picture, None)?;
        let name = frame.picture.display().to_string();
        photos.push(Photo { camera: frame.camera, film, name, photograph: false });
    }
    let observation = Observation::new(&photos, capture.background, [0.0; 3])?;
    let bounds = Hull::new(&observation).bounds()?;
    let request = Request {
        lattice: lattice::choose(None, Some(lattice::divided(&bounds, 24)?))?,
        bounds,
        medium: capture.medium()?,
        background: capture.background,
        rays_per_edge: 1,
        held_out: vec![0],
        iterations: 24,
        smoothing: None,
        prior: None,
        robust: true,
        init: None,
        max_memory: Limits::default().max_memory,
        cancel: Cancel::NEVER,
        checkpoint: None,
        closing: Cancel::NEVER,
    };
    let outcome = multilevel::reconstruct(&observation, &request, |_| ControlFlow::Continue(()))?;
    write_grids(volume, &[&outcome.field.to_grid("density")], &BTreeMap::new(), Codec::default(), false)?;
    Ok(outcome)
}

fn main() -> Result<()> {
    let mut paths = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(folder), Some(volume)) = (paths.next(), paths.next()) else {
        return Err(Error::invalid("two paths are expected").hint("reconstruct CAPTURE VOLUME.vdb"));
    };
    eprintln!("held-out view: {:?} dB", run(&folder, &volume)?.held_out_psnr_db);
    Ok(())
}
