//! Loads a fog volume from a VDB, renders one view of it and writes the picture as an EXR.
//!
//! `cargo run --release --example load_and_render -- fixtures/plume.vdb view.exr`

use cumulo::cancel::Cancel;
use cumulo::formats::exr;
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::File;
use cumulo::render::dvr::Dvr;
use cumulo::render::film::{self, Sampling};
use cumulo::scene::bricks::Bricks;
use cumulo::scene::film::Film;
use cumulo::scene::medium::Medium;
use cumulo::scene::orbit::{self, Layout};
use cumulo::scene::up::Up;
use cumulo::{Error, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Renders the volume with an extinction of 3 per unit of density and world length, on white.
///
/// # Errors
/// If the volume cannot be read or the picture cannot be written.
pub fn run(volume: &Path, picture: &Path) -> Result<Film> {
    let limits = Limits::default();
    let grid = File::open(volume, limits)?.read_fog(None)?;
    let field: Bricks<f32> = Bricks::from_grid(&grid, limits.max_memory)?;

    // One camera, 128 x 128 pixels, so far away that the volume takes 40 degrees.
    let cameras = orbit::cameras(&field.outline(), 1, Layout::Sphere, 128, 128, 40.0, Up::Z);
    let renderer = Dvr::new(&field, Medium::absorbing(3.0))?.over([1.0; 3]);
    let never = Cancel::NEVER;
    let film = film::render(&renderer, &cameras[0], Sampling::grid(1), &[], &never).ok_or_else(Error::cancelled)?.film;
    exr::write_picture(picture, &film, &BTreeMap::new(), exr::Half::None)?;
    Ok(film)
}

fn main() -> Result<()> {
    let mut paths = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(volume), Some(picture)) = (paths.next(), paths.next()) else {
        return Err(Error::invalid("two paths are expected").hint("load_and_render VOLUME.vdb PICTURE.exr"));
    };
    let film = run(&volume, &picture)?;
    eprintln!("{}: {} x {} pixels", picture.display(), film.width, film.height);
    Ok(())
}
