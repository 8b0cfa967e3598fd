//! The examples do what they say.
//!
//! They are compiled into this test, so that running them needs no build of their own.

#[allow(dead_code, reason = "an example's own `main` is not called")]
#[path = "../examples/gradient_of_a_picture.rs"]
mod gradient_of_a_picture;
#[allow(dead_code, reason = "an example's own `main` is not called")]
#[path = "../examples/load_and_render.rs"]
mod load_and_render;
#[allow(dead_code, reason = "an example's own `main` is not called")]
#[path = "../examples/reconstruct.rs"]
mod reconstruct;

use crate::common::work::{self, Work, fixture};

#[test]
fn load_and_render_writes_the_picture_it_returns() {
    let work = Work::new();
    let film = load_and_render::run(&fixture("plume.vdb"), &work.path("view.exr")).unwrap();
    assert_eq!((film.width, film.height), (128, 128));
    assert_eq!(work.picture("view.exr").rgba, film.rgba);
    let alphas: Vec<f32> = film.rgba.iter().map(|p| p[3]).collect();
    assert!(alphas.iter().any(|a| *a > 0.5) && alphas.contains(&0.0), "the plume stands before the background");
}

#[test]
fn gradient_of_a_picture_has_a_derivative_for_every_voxel() {
    let (loss, by_voxel) = gradient_of_a_picture::run(&fixture("plume.vdb")).unwrap();
    // No difference of two values from 0 to 1 is more than 1.
    assert!(loss > 0.0 && loss < 1.0, "{loss}");
    assert!(by_voxel.iter().all(|d| d.is_finite()));
    // More density darkens a pixel: where that is wanted the derivative is negative, elsewhere positive.
    assert!(by_voxel.iter().any(|d| *d < 0.0) && by_voxel.iter().any(|d| *d > 0.0));
}

#[test]
fn reconstruct_finds_a_volume_that_looks_like_its_pictures() {
    let work = Work::new();
    work.json("render @plume.vdb --views 12 --size 48x48 --density-scale auto -o shots");
    let outcome = reconstruct::run(&work.path("shots"), &work.path("found.vdb")).unwrap();
    // The program reaches 33 dB with 12 voxels along the longest edge, which is half of what is asked for here.
    assert!(outcome.held_out_psnr_db.unwrap() > 30.0, "{:?}", outcome.held_out_psnr_db);
    assert!(work::density(&work.path("found.vdb")).leaves.len() > 1);
}
