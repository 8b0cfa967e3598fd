//! `cumulo convert` from VDB to VDB: forms, lattices, vectors and names. Each grid that comes out is held against what its
//! definition says.

use crate::common::work::{self, Work, density, errors};
use cumulo::error::Code;
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::{Codec, File, NativeGrid, RawLeaf, write_native};
use cumulo::math::Affine;
use cumulo::scene::grid::{Grid, GridClass, Leaf, voxel_offset};
use glam::{DVec3, IVec3};
use std::collections::BTreeMap;
use std::path::Path;

/// Edge of the voxels of generated grids in world units.
const VOXEL: f64 = 0.5;

/// A fog volume of leaves from `-n` to `n` along each axis with the given values; what is not 0 is active.
fn volume(name: &str, n: i32, value: impl Fn(DVec3) -> f32) -> Grid {
    let mut leaves = Vec::new();
    let blocks = || (-n..n).map(|b| 8 * b);
    for origin in blocks().flat_map(|x| blocks().flat_map(move |y| blocks().map(move |z| [x, y, z]))) {
        let mut leaf = Leaf { origin, values: [0.0; 512], active: [0; 8] };
        for i in 0..512_usize {
            let local = IVec3::new((i >> 6) as i32, (i >> 3 & 7) as i32, (i & 7) as i32);
            leaf.values[i] = value((IVec3::from_array(origin) + local).as_dvec3());
            if leaf.values[i] != 0.0 {
                leaf.active[i >> 6] |= 1 << (i & 63);
            }
        }
        leaves.push(leaf);
    }
    Grid {
        name: name.into(),
        class: GridClass::FogVolume,
        transform: Affine::uniform(VOXEL, DVec3::new(1.0, -2.0, 3.0)).unwrap(),
        background: 0.0,
        leaves,
        tiles: vec![],
        metadata: BTreeMap::new(),
    }
}

fn write(path: &Path, grids: &[&NativeGrid]) {
    write_native(path, grids, None, &BTreeMap::new(), Codec::Blosc).unwrap();
}

/// Value of a voxel with a leaf, and whether it is active.
fn at(grid: &Grid, p: [i32; 3]) -> Option<(f32, bool)> {
    let leaf = grid.leaves.iter().find(|leaf| leaf.origin == p.map(|c| c & !7))?;
    let i = voxel_offset(p.map(|c| (c & 7) as usize));
    Some((leaf.values[i], leaf.active[i >> 6] >> (i & 63) & 1 == 1))
}

/// Indices, values and states of all voxels in leaves.
fn voxels(grid: &Grid) -> impl Iterator<Item = (DVec3, f32, bool)> + '_ {
    grid.leaves.iter().flat_map(|leaf| {
        (0..512_usize).map(move |i| {
            let local = IVec3::new((i >> 6) as i32, (i >> 3 & 7) as i32, (i & 7) as i32);
            let index = (IVec3::from_array(leaf.origin) + local).as_dvec3();
            (index, leaf.values[i], leaf.active[i >> 6] >> (i & 63) & 1 == 1)
        })
    })
}

/// Sum of value times volume.
fn mass(grid: &Grid) -> f64 {
    let sum: f64 = voxels(grid).map(|(_, v, _)| f64::from(v)).sum();
    let tiles: f64 = grid.tiles.iter().map(|t| f64::from(t.value) * f64::from(t.dim).powi(3)).sum();
    (sum + tiles) * grid.transform.voxel_size().element_product()
}

#[test]
fn a_level_set_becomes_the_fog_of_its_definition() {
    let work = Work::new();
    let report = work.json("convert @sphere_level_set.vdb fog.vdb --to fog");
    assert_eq!(report["grids"][0]["formed"]["form"], "fog");
    let file = File::open(work.path("fog.vdb"), Limits::default()).unwrap();
    let name = file.entries()[0].name.clone();
    assert_eq!(report["grids"][0]["from"], name, "the grid keeps its name");
    let fog = file.read_grid(&name).unwrap();
    let set = File::open(work::fixture("sphere_level_set.vdb"), Limits::default()).unwrap().read_grid(&name).unwrap();
    assert_eq!((fog.class, fog.background), (GridClass::FogVolume, 0.0));
    let mut ramp = 0;
    for (index, distance, active) in voxels(&set).filter(|v| v.2) {
        let expected = (-distance / set.background).clamp(0.0, 1.0);
        let found = at(&fog, index.as_ivec3().to_array()).map_or(0.0, |v| v.0);
        // One division in single precision.
        assert!((found - expected).abs() < 1e-6, "{index} {active}: {found} for {distance}");
        ramp += usize::from(expected > 0.0);
    }
    assert!(ramp > 100);
    // A fog volume stays what it is, and this is said.
    let out = work.command("convert @plume.vdb same.vdb --to fog").output().unwrap();
    assert!(out.status.success() && errors(&out).contains("no grid could become a fog volume"), "{}", errors(&out));
}

#[test]
fn fog_becomes_the_level_set_of_one_density_and_cavities_stay_open() {
    let work = Work::new();
    // A shell between radii 5 and 10 voxels: the density rises and falls with slope 1/8 to a half on both.
    let (inner, outer) = (5.0, 10.0);
    let shell = |p: DVec3| {
        let r = p.length();
        let depth = (r - inner).min(outer - r);
        (0.5 + depth / 8.0).clamp(0.0, 1.0) as f32
    };
    write(&work.path("shell.vdb"), &[&NativeGrid::from_grid(&volume("density", 2, shell)).unwrap()]);
    let report = work.json("convert shell.vdb set.vdb --to level-set --iso 0.5");
    assert_eq!(report["grids"][0]["formed"], serde_json::json!({"form": "level-set", "iso": 0.5}));
    let set = File::open(work.path("set.vdb"), Limits::default()).unwrap().read_grid("density").unwrap();
    assert_eq!(set.class, GridClass::LevelSet);
    assert!((f64::from(set.background) - 3.0 * VOXEL).abs() < 1e-6, "half a band of three voxels");
    let mut band = 0;
    for (index, distance, active) in voxels(&set) {
        let r = index.length();
        let exact = -VOXEL * (r - inner).min(outer - r);
        // Farther than two voxels away the nearest quad is sought among those of neighbours alone, and may be missed.
        if active && exact.abs() < 1.9 * VOXEL {
            band += 1;
            // The surface is one of flat quads. Their points, means of crossings of a cell's edges, lie within its inner
            // surface's curve by 0.7² / (2·5) = 0.05 voxels, and quads of edge 1 sag as much again; where the density is
            // not linear (near its clamps) nothing crosses.
            assert!((f64::from(distance) - exact).abs() < 0.12 * VOXEL, "{index}: {distance} for {exact}");
        }
        if exact.abs() > 0.2 * VOXEL {
            assert_eq!(distance < 0.0, exact < 0.0, "{index}");
        }
    }
    assert!(band > 1000);
    assert!(at(&set, [0, 0, 0]).is_none_or(|v| v.0 > 0.0), "the cavity is outside");
    // And back: the fog's half density lies where it was.
    work.json("convert set.vdb back.vdb --to fog");
    let back = density(&work.path("back.vdb"));
    assert!(at(&back, [7, 0, 0]).unwrap().0 > 0.6 && at(&back, [0, 0, 0]).is_none_or(|v| v.0 == 0.0));
    work.refused(
        "convert shell.vdb none.vdb --to level-set --iso 2",
        Code::Invalid,
        &["--iso 2", "largest density is 0.8"],
    );
    work.refused("convert shell.vdb none.vdb --to level-set --iso 0", Code::Invalid, &["not below --iso 0"]);
    work.refused("convert @blob_stretched.vdb none.vdb --to level-set", Code::Unsupported, &["cubes", "--resample"]);
    work.refused(
        "convert shell.vdb none.vdb --to level-set --max-memory 112M --resample 0.02",
        Code::MemoryLimit,
        &["--max-memory"],
    );
    work.refused("convert shell.vdb none.vdb --iso 0.5", Code::Invalid, &["--iso", "--to"]);
}

#[test]
fn the_box_filter_keeps_the_mass_and_is_the_default_where_voxels_grow() {
    let work = Work::new();
    let mass_of = |name: &str| mass(&density(&work.path(name)));
    // In single precision: as half, each voxel would be rounded to 2⁻¹¹.
    let lump = volume("density", 2, |p| (-(p - DVec3::new(1.3, 0.2, -2.1)).length_squared() / 20.0).exp() as f32);
    write(&work.path("lump.vdb"), &[&NativeGrid::from_grid(&lump).unwrap()]);
    let original = mass(&lump);
    for size in ["0.5", "0.75", "1", "3.3"] {
        let report = work.json(&format!("convert lump.vdb box.vdb --resample {size}"));
        assert_eq!(report["grids"][0]["filter"], "box");
        // Each voxel is rounded once, to 2⁻²⁴ of itself.
        let found = mass_of("box.vdb");
        assert!((found / original - 1.0).abs() < 1e-6, "{size}: {found} for {original}");
    }
    let report = work.json("convert lump.vdb linear.vdb --resample 3.3 --filter trilinear");
    assert_eq!(report["grids"][0]["filter"], "trilinear");
    assert!((mass_of("linear.vdb") / original - 1.0).abs() > 1e-4, "interpolation does not keep it");
    let finer = work.json("convert lump.vdb finer.vdb --resample 0.4");
    assert_eq!(finer["grids"][0]["filter"], "trilinear");
    // Where a cube of ones has only ones, means are ones.
    work.json("convert @cube.vdb cube.vdb --resample 0.25");
    let cube = density(&work.path("cube.vdb"));
    let ones = voxels(&cube).filter(|v| v.1 == 1.0).count() + cube.tiles.iter().filter(|t| t.value == 1.0).count();
    assert!(ones > 0 && voxels(&cube).all(|v| (0.0..=1.0).contains(&v.1)));
    assert!((mass(&cube) - 8.0).abs() < 1e-6, "two units along each edge: {}", mass(&cube));
    // Tiles are averaged as their voxels would be.
    work.json("convert @tiles.vdb tiles.vdb --resample 1 --filter box");
    let tiles = density(&work::fixture("tiles.vdb"));
    assert!((mass_of("tiles.vdb") / mass(&tiles) - 1.0).abs() < 1e-6);
    work.refused(
        "convert @sphere_level_set.vdb no.vdb --resample 1 --filter box",
        Code::Unsupported,
        &["distances", "--to fog"],
    );
    let set = work.json("convert @sphere_level_set.vdb set.vdb --resample 0.2");
    assert_eq!(set["grids"][0]["filter"], "trilinear");
    work.refused("convert @plume.vdb no.vdb --filter box", Code::Usage, &["--resample"]);
}

#[test]
fn vectors_are_split_and_merged_without_loss() {
    let work = Work::new();
    let report = work.json("convert @kinds.vdb parts.vdb --grid velocity --split velocity");
    let names: Vec<&str> = report["grids"].as_array().unwrap().iter().map(|g| g["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["velocity.x", "velocity.y", "velocity.z"]);
    let report = work.json("convert parts.vdb whole.vdb --merge velocity=velocity.x,velocity.y,velocity.z");
    assert_eq!((report["grids"].as_array().unwrap().len(), &report["grids"][0]["name"]), (1, &"velocity".into()));
    let out = work.command("diff @kinds.vdb whole.vdb --grid velocity").output().unwrap();
    assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stdout));
    // Components by hand.
    let read = |path: &Path, name: &str| File::open(path, Limits::default()).unwrap().read(name).unwrap();
    let vectors = read(&work::fixture("kinds.vdb"), "velocity").to_raw().unwrap();
    let z = read(&work.path("parts.vdb"), "velocity.z").to_raw().unwrap();
    assert_eq!(vectors.leaves.len(), z.leaves.len());
    for (v, z) in vectors.leaves.iter().zip(&z.leaves) {
        assert!(v.origin == z.origin && v.active == z.active);
        assert!((0..512).all(|i| v.values[3 * i + 2] == z.values[i]));
    }
    work.refused("convert @plume.vdb no.vdb --split density", Code::Unsupported, &["hold no vectors"]);
    work.refused(
        "convert @kinds.vdb no.vdb --merge v=velocity,pressure,label",
        Code::Unsupported,
        &["make no vectors"],
    );
    work.refused("convert @kinds.vdb no.vdb --merge v=a,b,c", Code::NoSuchGrid, &["'a'"]);
    work.refused(
        "convert @kinds.vdb no.vdb --split velocity --merge v=velocity,pressure,label",
        Code::Invalid,
        &["twice"],
    );
    work.refused("convert @kinds.vdb no.vdb --grid label --split velocity", Code::Invalid, &["--grid"]);
}

#[test]
fn merged_grids_are_active_where_a_part_is() {
    let work = Work::new();
    let part = |name: &str, at: i32| {
        let leaf = RawLeaf { origin: [at, 0, 0], values: vec![at as f32 + 1.0; 3 * 512], active: [1; 8] };
        let map = Affine::uniform(1.0, DVec3::ZERO).unwrap();
        NativeGrid::from_vectors("v", GridClass::Unknown, &map, &[leaf]).unwrap().component(0, name).unwrap()
    };
    let parts = [part("a", 0), part("b", 8), part("c", 8)];
    write(&work.path("parts.vdb"), &parts.each_ref());
    work.json("convert parts.vdb v.vdb --merge v=a,b,c");
    let merged = File::open(work.path("v.vdb"), Limits::default()).unwrap().read("v").unwrap().to_raw().unwrap();
    let values: Vec<[f32; 3]> = merged.leaves.iter().map(|l| l.values[..3].try_into().unwrap()).collect();
    assert_eq!(values, [[1.0, 0.0, 0.0], [0.0, 9.0, 9.0]]);
    assert!(merged.leaves.iter().all(|leaf| leaf.active == [1; 8]));
}

#[test]
fn names_follow_programs_and_renames_come_first() {
    let work = Work::new();
    let scalar = |name: &str| NativeGrid::from_grid(&volume(name, 1, |p| p.x as f32)).unwrap();
    let map = Affine::uniform(VOXEL, DVec3::ZERO).unwrap();
    let vel = NativeGrid::from_vectors("vel", GridClass::Unknown, &map, &[]).unwrap();
    let grids = [scalar("density"), scalar("heat"), scalar("flames"), scalar("fuel"), vel];
    write(&work.path("in.vdb"), &grids.each_ref());
    let names = |options: &str| -> Vec<String> {
        let report = work.json(&format!("convert in.vdb out.vdb {options}"));
        let grids = report["grids"].as_array().unwrap().clone();
        grids.iter().map(|grid| grid["name"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(names("--names blender"), ["density", "flame", "flames", "fuel", "velocity"]);
    assert_eq!(names("--names houdini"), ["density", "flame", "flames", "fuel", "vel"]);
    assert_eq!(names("--names arnold"), ["density", "heat", "flames", "fuel", "vel"]);
    assert_eq!(names("--names karma --rename vel=v"), ["density", "flame", "flames", "fuel", "v"]);
    let out = work.command("convert in.vdb out.vdb --names blender").output().unwrap();
    assert!(errors(&out).contains("'flames' keeps its name"), "{}", errors(&out));
}

#[test]
fn a_crop_that_leaves_nothing_says_so() {
    let work = Work::new();
    let out = work.command("convert @plume.vdb out.vdb --crop 50,50,50,60,60,60").output().unwrap();
    assert!(
        out.status.success() && errors(&out).contains("no active voxel lies in the box of --crop"),
        "{}",
        errors(&out)
    );
}

/// Grids of several files become those of one, at their places.
#[test]
fn files_are_joined() {
    let work = Work::new();
    let native = |name: &str, edge: f64| {
        let transform = Affine::uniform(edge, DVec3::new(1.0, -2.0, 3.0)).unwrap();
        NativeGrid::from_grid(&Grid { transform, ..volume(name, 1, |p| if p.x > 0.0 { 1.0 } else { 0.0 }) }).unwrap()
    };
    let [density, heat, other] = [native("density", 0.5), native("heat", 0.25), native("density", 2.0)];
    write(&work.path("a.vdb"), &[&density]);
    write(&work.path("b.vdb"), &[&heat]);
    write(&work.path("c.vdb"), &[&other, &heat]);
    let report = work.json("convert a.vdb b.vdb both.vdb --half");
    assert_eq!(report["more"], serde_json::json!(["b.vdb"]));
    let file = File::open(work.path("both.vdb"), Limits::default()).unwrap();
    let names: Vec<&str> = file.entries().iter().map(|e| e.name.as_str()).collect();
    assert_eq!(names, ["density", "heat"]);
    for (name, grid) in [("density", &density), ("heat", &heat)] {
        let found = file.read(name).unwrap();
        assert!(found.same_values(grid).unwrap());
        assert_eq!(found.info().unwrap().transform, grid.info().unwrap().transform);
    }
    work.refused(
        "convert a.vdb c.vdb d.vdb",
        Code::Invalid,
        &["grid 'density'", "a.vdb", "c.vdb", "--rename density=NAME"],
    );
    work.refused("convert a.vdb c.vdb d.vdb --grid density", Code::Invalid, &["'density'", "which of them is meant"]);
    work.refused("convert a.vdb b.vdb d.vdb --grid smoke", Code::NoSuchGrid, &["'smoke'", "'density', 'heat'"]);
    work.refused("convert a.vdb b.vdb d.vdb --up z", Code::Invalid, &["--up edits the grids of one file"]);
    work.refused("convert a.vdb b.vdb d.nvdb", Code::Unsupported, &["b.vdb", "one VDB"]);
    work.refused("convert a.vdb b.vdb a.vdb", Code::OutputIsInput, &["a.vdb"]);
    assert!(!work.path("d.vdb").exists());
    work.json("convert a.vdb c.vdb d.vdb --grid heat --names blender");
    let file = File::open(work.path("d.vdb"), Limits::default()).unwrap();
    assert_eq!(file.entries().iter().map(|e| e.name.as_str()).collect::<Vec<_>>(), ["flame"]);
}

#[test]
fn files_of_other_up_axes_are_not_joined() {
    let work = Work::new();
    let text = |value: &str| cumulo::scene::grid::MetaValue::Text(value.into());
    for (name, grid, creator) in
        [("a", "density", "Houdini 20"), ("b", "heat", "Blender/OpenVDBWriter"), ("c", "fuel", "me")]
    {
        let native = NativeGrid::from_grid(&volume(grid, 1, |_| 1.0)).unwrap();
        let metadata = BTreeMap::from([("creator".to_owned(), text(creator)), (format!("of_{name}"), text(name))]);
        write_native(&work.path(&format!("{name}.vdb")), &[&native], None, &metadata, Codec::Blosc).unwrap();
    }
    work.refused("convert a.vdb b.vdb d.vdb", Code::Invalid, &["b.vdb", "Houdini 20", "--up z"]);
    let warnings = work.json("convert a.vdb c.vdb d.vdb")["warnings"].to_string();
    assert!(warnings.contains("c.vdb does not state its up axis") && warnings.contains("'creator'"), "{warnings}");
    let metadata = File::open(work.path("d.vdb"), Limits::default()).unwrap().metadata().unwrap();
    assert_eq!(
        (&metadata["creator"], &metadata["of_a"], &metadata["of_c"]),
        (&text("Houdini 20"), &text("a"), &text("c"))
    );
}

#[test]
fn a_grid_that_is_named_twice_counts_once() {
    let work = Work::new();
    let scalar = |name: &str| NativeGrid::from_grid(&volume(name, 1, |p| p.x as f32)).unwrap();
    let grids = [scalar("density"), scalar("heat")];
    write(&work.path("in.vdb"), &grids.each_ref());
    let grids = |words: &str| work.json(words)["grids"].as_array().unwrap().len();
    assert_eq!(grids("convert in.vdb out.vdb --grid density --grid density"), 1);
    let file = File::open(work.path("out.vdb"), Limits::default()).unwrap();
    assert_eq!(file.entries().iter().map(|e| e.name.as_str()).collect::<Vec<_>>(), ["density"]);
    assert_eq!(grids("convert in.vdb two.vdb --grid heat --grid density --grid heat"), 2);
    assert_eq!(grids("convert in.vdb out.nvdb --grid density --grid density"), 1);
    assert_eq!(grids("convert out.nvdb back.vdb --grid density --grid density"), 1);
    work.json("convert in.vdb out.npy --grid density --grid density");
}

/// Values of a grid that is computed are those of the expression in each voxel, and so is the value outside.
#[test]
fn grids_are_computed_voxel_by_voxel() {
    let work = Work::new();
    let native = |grid: &Grid| NativeGrid::from_grid(grid).unwrap();
    let density = volume("density", 1, |p| if p.length() < 7.0 { (0.1 * p.x + 1.0) as f32 } else { 0.0 });
    // On one side alone, with a value outside.
    let warm = |p: DVec3| if p.y < -2.0 { 300.0 - p.z as f32 } else { 20.0 };
    let mut heat = Grid { background: 20.0, ..volume("heat", 1, warm) };
    heat.leaves.retain(|leaf| leaf.origin[0] < 0);
    let tile = cumulo::scene::grid::Tile { origin: [16, 0, 0], dim: 8, value: 400.0, active: true };
    heat.tiles.push(tile);
    write(&work.path("in.vdb"), &[&native(&density), &native(&heat)]);
    let report = work.json(
        "convert in.vdb out.vdb --eval density=max(density-0.5,0)*heat --eval warm=if(heat>25,1,0)*z --grid density",
    );
    let names: Vec<&str> = report["grids"].as_array().unwrap().iter().map(|g| g["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["density", "warm"]);
    assert_eq!(report["grids"][0]["from"], "max(density-0.5,0)*heat");
    let file = File::open(work.path("out.vdb"), Limits::default()).unwrap();
    let [found, found_warm] = ["density", "warm"].map(|name| file.read_grid(name).unwrap());
    assert_eq!((found.class, found.background), (GridClass::FogVolume, 0.0));
    let value = |grid: &Grid, p: [i32; 3]| {
        let inside =
            |t: &&cumulo::scene::grid::Tile| (0..3).all(|a| (t.origin[a]..t.origin[a] + t.dim).contains(&p[a]));
        let tile = grid.tiles.iter().find(inside).map(|t| (t.value, t.active));
        at(grid, p).or(tile).unwrap_or((grid.background, false))
    };
    let mut checked = 0;
    for x in -8..24 {
        for (y, z) in (-8..8).flat_map(|y| (-8..8).map(move |z| (y, z))) {
            let p = [x, y, z];
            let [(d, of_density), (h, of_heat)] = [value(&density, p), value(&heat, p)];
            let [product, warm] = [value(&found, p), value(&found_warm, p)];
            assert!((product.0 - (d - 0.5).max(0.0) * h).abs() <= 1e-6 * product.0.abs(), "{p:?}: {product:?}");
            let world = found.transform.to_world(DVec3::new(x.into(), y.into(), z.into()));
            let expected = if h > 25.0 { world.z as f32 } else { 0.0 };
            assert_eq!((warm.0, warm.1), (expected, of_heat), "{p:?}");
            assert_eq!(product.1, of_density || of_heat, "{p:?}");
            checked += usize::from(product.1);
        }
    }
    assert!(checked > 1000, "{checked}");
    // What is outside becomes what the expression makes of it; a level set keeps its inside.
    work.json("convert in.vdb out.vdb --eval heat=heat/10-4");
    let cold = File::open(work.path("out.vdb"), Limits::default()).unwrap().read_grid("heat").unwrap();
    assert_eq!((cold.background, cold.class), (-2.0, GridClass::Unknown));
    work.json("convert @sphere_level_set.vdb grown.vdb --eval {surface}={surface}-0.1");
}

#[test]
fn components_of_vectors_and_names_in_braces_are_values() {
    let work = Work::new();
    work.json("convert @kinds.vdb out.vdb --eval speed=sqrt(velocity.x^2+velocity.y^2+{velocity.z}^2)");
    let file = File::open(work.path("out.vdb"), Limits::default()).unwrap();
    let speed = file.read_grid("speed").unwrap();
    let vectors = file.read("velocity").unwrap().to_raw().unwrap();
    let mut checked = 0;
    for leaf in &vectors.leaves {
        for (i, v) in leaf.values.chunks_exact(3).enumerate() {
            let p = [(i >> 6) as i32, (i >> 3 & 7) as i32, (i & 7) as i32];
            let Some((found, active)) = at(&speed, std::array::from_fn(|a| leaf.origin[a] + p[a])) else { continue };
            let expected = v.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt() as f32;
            assert_eq!((found, active), (expected, leaf.active[i >> 6] >> (i & 63) & 1 == 1));
            checked += 1;
        }
    }
    assert!(checked >= 512, "{checked}");
}

#[test]
fn grids_that_cannot_be_computed_are_refused() {
    let work = Work::new();
    let native = NativeGrid::from_grid(&volume("density", 1, |p| if p.x > 0.0 { 1.0 } else { 0.0 })).unwrap();
    write(&work.path("a.vdb"), &[&native]);
    work.json("convert a.vdb b.vdb --resample 0.3 --rename density=fine");
    work.json("convert a.vdb b.vdb two.vdb");
    let refused = |words: &str, code: Code, facts: &[&str]| {
        work.refused(&format!("convert {words}"), code, facts);
        assert!(!work.path("no.vdb").exists());
    };
    refused("a.vdb no.vdb --eval d=ash*2", Code::NoSuchGrid, &["--eval d=ash*2", "no grid 'ash'", "'density'"]);
    refused("a.vdb no.vdb --eval d=1+x", Code::Invalid, &["names no grid"]);
    refused("a.vdb no.vdb --eval d=ln(density)", Code::Invalid, &["outside", "-inf", "max(density, 1e-6)"]);
    refused("a.vdb no.vdb --eval d=1/(density-1)", Code::Invalid, &["voxel [", "inf", "density = 1"]);
    refused("a.vdb no.vdb --eval d=density+x", Code::Invalid, &["depends on the place", "density * z"]);
    refused("two.vdb no.vdb --eval d=density+fine", Code::Unsupported, &["'fine'", "different lattices", "--resample"]);
    refused("@kinds.vdb no.vdb --eval d=velocity*2", Code::Unsupported, &["velocity", "velocity.x"]);
    refused("a.vdb no.vdb --eval d=density --eval d=density*2", Code::Invalid, &["twice"]);
    refused(
        "@kinds.vdb no.vdb --eval d=label.x",
        Code::Invalid,
        &["'label' holds scalars", "no component 'x'", "name the grid alone"],
    );
    refused("a.vdb no.vdb --eval d=min(density)", Code::Usage, &["--eval", "'min' takes 2 numbers, 1 given"]);
    refused("a.vdb no.vdb --eval d=density+", Code::Usage, &["--eval", "ends where"]);
    refused("a.vdb no.vdb --eval density", Code::Usage, &["NAME=EXPRESSION"]);
    refused("a.vdb b.vdb no.vdb --eval d=density", Code::Invalid, &["--eval edits the grids of one file"]);
    refused("a.vdb no.npy --eval d=density", Code::Invalid, &["--eval has no effect"]);
}
