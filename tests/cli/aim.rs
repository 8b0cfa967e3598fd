//! Cameras by the names of sides, by angles and by positions.

use crate::common::images;
use crate::common::work::Work;
use cumulo::error::Code;
use cumulo::formats::transforms;
use cumulo::scene::camera::{Camera, Projection};
use glam::DVec3;

fn cameras(work: &Work, folder: &str) -> Vec<Camera> {
    transforms::load(&work.path(folder)).unwrap().frames.into_iter().map(|frame| frame.camera).collect()
}

#[test]
fn sides_angles_and_positions_are_views_of_a_capture() {
    let work = Work::new();
    let report = work.json("render @plume.vdb --from front,left,top --size 16x12 -o sides");
    assert_eq!(report["views"], 3);
    let sides = cameras(&work, "sides");
    let expected = [DVec3::NEG_Y, DVec3::NEG_X, DVec3::Z];
    for (camera, expected) in sides.iter().zip(expected) {
        assert!((camera.forward() + expected).length() < 1e-12, "{camera:?}");
        assert_eq!((camera.focal, camera.projection), (sides[0].focal, Projection::Perspective));
    }
    work.json("render @plume.vdb --azimuth -90 --size 16x12 -o angle");
    assert!((cameras(&work, "angle")[0].camera_to_world.x_axis - sides[1].camera_to_world.x_axis).length() < 1e-12);
    work.json("render @plume.vdb --elevation 30 --distance 9 --size 16x12 --up y -o near");
    let near = cameras(&work, "near")[0];
    assert!((near.forward().y + 0.5).abs() < 1e-12 && near.forward().x.abs() < 1e-12, "{near:?}");
    work.json("render @plume.vdb --eye 9,-9,4 --target=-1,0,1 --orthographic --size 16x12 -o eye");
    let eye = cameras(&work, "eye")[0];
    assert_eq!((eye.position(), eye.projection), (DVec3::new(9.0, -9.0, 4.0), Projection::Orthographic));
    // They are cameras like any other.
    work.json("render @plume.vdb --cameras eye -o again");
    assert_eq!(work.picture("again/view_000.exr"), work.picture("eye/view_000.exr"));
    assert!(work.text("plan @plume.vdb --from iso --size 8x8 --albedo 0.5 --samples 1").contains("1 view"));
    std::fs::copy(crate::common::work::fixture("plume.vdb"), work.path("s.0003.vdb")).unwrap();
    work.json("render s.####.vdb --from iso --size 8x8 -o frames");
    work.json("render @plume.vdb --from iso --size 8x8 -o one");
    assert_eq!(work.picture("frames/frame.0003.exr"), work.picture("one/view_000.exr"));
}

/// A volume of which one voxel is bright lies on the patient's left, behind and above, as its file places it. Pictures
/// from the front show it at the right and at the top, those from above at the left and at the bottom.
#[test]
fn anatomical_names_are_those_of_the_file() {
    let work = Work::new();
    // The columns of the sform: x runs to the right by 0.5, y to the front by 0.75, z to the head by 1.25.
    let header = images::nifti1(2, 1, (Some(images::straight()), false), false, false);
    let [nx, ny, nz] = images::SIZE;
    let bright = |i: usize| i.is_multiple_of(nx) && (i / nx).is_multiple_of(ny) && i / nx / ny == nz - 1;
    let values = (0..nx * ny * nz).map(|i| if bright(i) { 200 } else { 1 });
    std::fs::write(work.path("scan.nii"), [header, values.collect()].concat()).unwrap();
    work.json("convert scan.nii scan.vdb --as float");
    work.json(
        "render scan.vdb --from anterior,posterior,left,right,superior,inferior --orthographic --size 32x32 \
         --density-scale 0.1 -o sides",
    );
    // Rightwards and downwards from the middle of the picture.
    let places = [[1, -1], [-1, -1], [1, -1], [-1, -1], [-1, 1], [1, 1]];
    for (view, [right, down]) in places.into_iter().enumerate() {
        let film = work.picture(&format!("sides/view_{view:03}.exr"));
        let darkest = (0..film.rgba.len()).min_by(|a, b| film.rgba[*a][0].total_cmp(&film.rgba[*b][0])).unwrap();
        let from_middle = |at: usize| if at < 16 { -1 } else { 1 };
        let found = [from_middle(darkest % 32), from_middle(darkest / 32)];
        assert_eq!(found, [right, down], "view {view}");
    }
}

#[test]
fn contradictions_are_refused() {
    let work = Work::new();
    for (options, facts) in [
        ("--from left --views 2", &["--from", "--views"][..]),
        ("--from left --cameras x", &["--from", "--cameras"]),
        ("--from left --azimuth 3", &["--from", "--azimuth"]),
        ("--azimuth 3 --layout ring", &["--azimuth", "--layout"]),
        ("--eye 1,2,3 --elevation 3", &["--eye", "--elevation"]),
        ("--target 1,2,3", &["--eye"]),
        ("--distance 3", &["--from", "--azimuth"]),
        ("--eye 1,2,3 --distance 3", &["--eye", "--distance"]),
        ("--views 1 --orthographic", &["--from"]),
        ("--from sideways", &["sideways", "anterior"]),
        ("--elevation 91", &["90"]),
        ("--eye 1,2", &["three"]),
        ("--eye 1,2,3 --target 1,2,3", &["--eye", "--target"]),
    ] {
        work.refused(&format!("render @plume.vdb {options} --size 8x8 -o out"), Code::Usage, facts);
    }
    std::fs::copy(crate::common::work::fixture("plume.vdb"), work.path("s.0003.vdb")).unwrap();
    work.refused("render s.####.vdb --from left,top --size 8x8 -o out", Code::Invalid, &["one picture", "--from"]);
}
