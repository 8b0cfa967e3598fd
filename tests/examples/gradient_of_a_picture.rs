//! Differentiates a loss on a picture with respect to every voxel of the volume.
//!
//! `cargo run --release --example gradient_of_a_picture -- fixtures/plume.vdb`

use cumulo::cancel::Cancel;
use cumulo::differentiate::gradient::objective::Objective;
use cumulo::differentiate::gradient::views::ActiveParameters;
use cumulo::differentiate::loss::Loss;
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::File;
use cumulo::render::differentiable::Adjoint;
use cumulo::render::dvr::Dvr;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::grid::LEAF_VOXELS;
use cumulo::scene::medium::Medium;
use cumulo::scene::orbit::{self, Layout};
use cumulo::scene::up::Up;
use cumulo::{Error, Result};
use std::path::{Path, PathBuf};

/// Value of the loss, and its derivatives: 512 voxels of a brick of 8 x 8 x 8, brick by brick.
///
/// # Errors
/// If the volume cannot be read.
pub fn run(volume: &Path) -> Result<(f64, Vec<f32>)> {
    let limits = Limits::default();
    let grid = File::open(volume, limits)?.read_fog(None)?;
    let field: Bricks<f32> = Bricks::from_grid(&grid, limits.max_memory)?;
    let renderer = Dvr::new(&field, Medium::absorbing(3.0))?.over([1.0; 3]);

    // The loss is the mean squared difference from a picture that is grey all over.
    let cameras = orbit::cameras(&field.outline(), 1, Layout::Sphere, 64, 64, 40.0, Up::Z);
    let target = vec![[0.5, 0.5, 0.5, 0.5]; 64 * 64];
    let objective =
        Objective { loss: Loss::L2, cameras: &cameras, targets: &[target], rays_per_edge: 1, cancel: &Cancel::NEVER };
    let gradient =
        objective.adjoint(&renderer, Adjoint::Tape, ActiveParameters { voxels: true, ..ActiveParameters::default() });

    // Bricks store the first voxels of their neighbours too; the derivatives of both copies are added.
    let mut by_voxel = vec![0.0; field.topology.len() * LEAF_VOXELS];
    field.topology.gather_apron(&gradient.voxels, &mut by_voxel);
    Ok((gradient.value, by_voxel))
}

fn main() -> Result<()> {
    let Some(volume) = std::env::args_os().nth(1).map(PathBuf::from) else {
        return Err(Error::invalid("a path is expected").hint("gradient_of_a_picture VOLUME.vdb"));
    };
    let (loss, by_voxel) = run(&volume)?;
    let largest = by_voxel.iter().fold(0.0_f32, |largest, d| largest.max(d.abs()));
    eprintln!("loss {loss:.6}, {} voxels, largest derivative {largest:.3e}", by_voxel.len());
    Ok(())
}
