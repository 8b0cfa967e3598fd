//! Every command that writes, with the files that it reads and those that it writes: none of the former may become one of
//! the latter.

use super::work::{Work, errors, fixture};
use std::os::unix::fs::symlink;
use std::path::Path;

/// A command that reads files of the folder `in` and writes into the folder `out`.
pub struct Case {
    pub words: &'static str,
    /// Files that its options lead to.
    pub inputs: &'static [&'static str],
    /// Files that it writes.
    pub outputs: &'static [&'static str],
}

const fn case(words: &'static str, inputs: &'static [&'static str], outputs: &'static [&'static str]) -> Case {
    Case { words, inputs, outputs }
}

const CAPTURE: &[&str] = &["in/cap/transforms.json", "in/cap/view_000.exr", "in/cap/view_003.exr"];

pub const ALL: [Case; 50] = [
    case(
        "render in/cube.vdb --cameras in/cap --tf in/two.tf.json --view 0 --size 4x4 --holdout in/z.exr --png --overwrite -o out",
        &[
            "in/cube.vdb",
            "in/two.tf.json",
            "in/z.exr",
            "in/cap/transforms.json",
            "in/cap/view_000.exr",
            "in/cap/view_003.exr",
        ],
        &["out/transforms.json", "out/view_000.exr", "out/view_000.png"],
    ),
    case(
        "render in/cube.vdb --views 1 --size 4x4 --albedo 0.9 --samples 1 --sky in/sky.exr --overwrite -o out/p.exr",
        &["in/sky.exr", "in/cube.vdb"],
        &["out/p.exr"],
    ),
    case(
        "render in/s.####.vdb --cameras in/cap --frames 0-1 --albedo 0.9 --samples 1 --sky in/sky.exr --overwrite -o out",
        &["in/s.0001.vdb", "in/sky.exr", "in/cap/transforms.json", "in/cap/view_003.exr"],
        &["out/frame.0000.exr", "out/transforms.json", "out/frame.0001.exr"],
    ),
    case(
        "render in/scene.json --views 1 --size 4x4 --samples 1 --frames 0-1 --overwrite -o out",
        &["in/scene.json", "in/s.0000.vdb", "in/s.0001.vdb", "in/two.tf.json", "in/sky.exr"],
        &["out/frame.0000.exr", "out/transforms.json"],
    ),
    case(
        "render in/scene.json --views 1 --size 4x4 --samples 1 --frames 0 --overwrite -o out/p.png",
        &["in/sky.exr"],
        &["out/p.png"],
    ),
    case(
        "render in/stage.usda --views 1 --size 4x4 --samples 1 --overwrite -o out",
        &["in/stage.usda", "in/cube.vdb", "in/sky.exr"],
        &["out/view_000.exr", "out/transforms.json"],
    ),
    case(
        "render in/cube.vdb --cameras in/cap --tf in/two.tf.json --size 4x4 --overwrite -o out/x --openjd out/job --openjd-reference in/cap",
        &["in/cube.vdb", "in/two.tf.json", "in/cap/transforms.json", "in/cap/view_001.exr"],
        &["out/job/template.json", "out/job/parameters.json", "out/job/asset_references.json"],
    ),
    case(
        "denoise in/cap/view_%03d.exr -o out/q_%03d.exr --overwrite --openjd out/job --openjd-reference in/bright",
        &["in/cap/view_001.exr", "in/bright/view_003.exr"],
        &["out/job/template.json", "out/job/parameter_values.json"],
    ),
    case(
        "reconstruct density in/cap -o out/f.vdb --openjd out/job",
        &["in/cap/transforms.json"],
        &["out/job/template.json"],
    ),
    case(
        "reconstruct color in/bright -o out/f.vdb --openjd out/job",
        &["in/bright/transforms.json"],
        &["out/job/template.json"],
    ),
    case(
        "reconstruct tf in/bright --volume in/cube.vdb -o out/f.tf.json --openjd out/job",
        &["in/cube.vdb", "in/bright/view_003.exr"],
        &["out/job/template.json"],
    ),
    case(
        "capture new in/cube.vdb --cameras in/cap --tf in/two.tf.json --overwrite -o out/c.json",
        &["in/cube.vdb", "in/two.tf.json", "in/cap/transforms.json", "in/cap/view_003.exr"],
        &["out/c.json"],
    ),
    case(
        "capture new in/cube.vdb --views 2 --albedo 0.9 --sky in/sky.exr --overwrite -o out",
        &["in/cube.vdb", "in/sky.exr"],
        &["out/transforms.json"],
    ),
    case(
        "figure in/cap/view_000.exr in/sky.exr --tf in/two.tf.json --overwrite -o out/f.svg",
        &["in/cap/view_000.exr", "in/sky.exr", "in/two.tf.json"],
        &["out/f.svg"],
    ),
    case(
        "figure in/cap/view_000.exr --camera in/cap#0 --scale-bar --distance 3 --overwrite -o out/f.png",
        &["in/cap/view_000.exr", "in/cap/transforms.json"],
        &["out/f.png"],
    ),
    case("merge in/d.exr in/d.exr --overwrite -o out/d.exr", &["in/d.exr"], &["out/d.exr"]),
    case("merge in/n0.exr in/n1.exr --overwrite -o out/n.exr", &["in/n0.exr", "in/n1.exr"], &["out/n.exr"]),
    case(
        "denoise in/cap/view_%03d.exr -o out/q_%03d.exr --motion files:in/m_###.exr --overwrite",
        &["in/m_000.exr", "in/m_003.exr", "in/cap/view_001.exr"],
        &["out/q_000.exr", "out/q_003.exr"],
    ),
    case(
        "denoise in/cap/view_%03d.exr -o out/q_%03d.exr --motion vdb:in/cube.vdb,in/cap --overwrite",
        &["in/cube.vdb", "in/cap/transforms.json"],
        &["out/q_000.exr"],
    ),
    case(
        "motion in/cube.vdb --cameras in/cap --tf in/two.tf.json --samples 1 --overwrite -o out/m_%03d.exr",
        &["in/cube.vdb", "in/two.tf.json", "in/cap/transforms.json", "in/cap/view_002.exr"],
        &["out/m_000.exr", "out/m_003.exr"],
    ),
    case(
        "capture convert in/cap -o out --to colmap --overwrite",
        CAPTURE,
        &[
            "out/sparse/0/images.txt",
            "out/images/view_000.exr",
            "out/sparse/0/cameras.txt",
            "out/sparse/0/points3D.txt",
        ],
    ),
    case(
        "capture convert in/cap --pictures in/bright -o out --overwrite",
        &["in/bright/view_001.exr", "in/cap/transforms.json"],
        &["out/transforms.json"],
    ),
    case(
        "compare in/cap/view_000.exr in/cap/view_001.exr --heatmap out/h.png",
        &["in/cap/view_000.exr"],
        &["out/h.png"],
    ),
    case(
        "compare in/n0.exr in/n1.exr --statistical --repeat-a in/n2.exr --repeat-b in/n3.exr --heatmap out/h.png",
        &["in/n2.exr", "in/n3.exr", "in/n0.exr", "in/n1.exr"],
        &["out/h.png"],
    ),
    case(
        "compare in/cap/view_%03d.exr in/bright/view_%03d.exr --beside in/m_###.exr --report out",
        &["in/m_000.exr", "in/cap/view_001.exr", "in/bright/view_003.exr"],
        &["out/index.html"],
    ),
    case("convert in/cube.vdb out/o.vdb --tf in/two.tf.json", &["in/cube.vdb", "in/two.tf.json"], &["out/o.vdb"]),
    case("convert in/cube.vdb out/o.npy", &["in/cube.vdb"], &["out/o.npy"]),
    case("convert in/cube.vdb out/o.mhd", &["in/cube.vdb"], &["out/o.raw", "out/o.mhd"]),
    case("convert in/cube.vdb out/o.nvdb", &["in/cube.vdb"], &["out/o.nvdb"]),
    case("convert in/cube.vdb out/o.ply --iso 1", &["in/cube.vdb"], &["out/o.ply"]),
    case("convert in/o.ply out/o.vdb --voxel-size 0.1", &["in/o.ply"], &["out/o.vdb"]),
    case("convert in/o.nvdb out/o.vdb", &["in/o.nvdb"], &["out/o.vdb"]),
    case("convert in/o.mhd out/o.vdb", &["in/o.mhd", "in/o.raw"], &["out/o.vdb"]),
    case("convert in/d.exr out/o.exr --flatten --holdout in/z.exr", &["in/d.exr", "in/z.exr"], &["out/o.exr"]),
    case("convert in/sky.exr out/o.npy", &["in/sky.exr"], &["out/o.npy"]),
    case("convert in/sky.npy out/o.exr", &["in/sky.npy"], &["out/o.exr"]),
    case("convert in/s.####.vdb out", &["in/s.0000.vdb", "in/s.0001.vdb"], &["out/s.0000.vdb", "out/s.0001.vdb"]),
    case(
        "gradient in/cube.vdb --wrt density --loss l2 --target in/cap --largest 1 -o out/g.vdb --report out/page",
        &["in/cube.vdb", "in/cap/transforms.json", "in/cap/view_003.exr"],
        &["out/g.vdb", "out/page/index.html"],
    ),
    case(
        "gradient in/cube.vdb --wrt density --loss mean --views 1 --size 4x4 --largest 1 --tf in/two.tf.json -o out/g.vdb",
        &["in/two.tf.json"],
        &["out/g.vdb"],
    ),
    case(
        "pose in/bright --volume in/cube.vdb --tf in/two.tf.json --init in/cap --iterations 1 -o out/p.json --report out/page",
        &[
            "in/cap/transforms.json",
            "in/bright/transforms.json",
            "in/bright/view_003.exr",
            "in/cube.vdb",
            "in/two.tf.json",
        ],
        &["out/p.json", "out/page/index.html"],
    ),
    case(
        "reconstruct density in/bright --tf in/two.tf.json --init in/slab.vdb -o out/f.vdb --resolution 8 --iterations 1 --report out/page",
        &["in/slab.vdb", "in/two.tf.json", "in/bright/transforms.json", "in/bright/view_003.exr"],
        &["out/f.vdb", "out/page/index.html", "out/page/run.json"],
    ),
    case(
        "reconstruct density in/cap --refine-cameras --cameras out/c.json -o out/f.vdb --resolution 8 --iterations 1",
        &["in/cap/transforms.json", "in/cap/view_003.exr"],
        &["out/f.vdb", "out/c.json"],
    ),
    case(
        "reconstruct color in/bright --init in/shaded.vdb -o out/f.vdb --resolution 8 --iterations 1 --report out/page",
        &["in/shaded.vdb", "in/bright/transforms.json", "in/bright/view_003.exr"],
        &["out/f.vdb", "out/page/index.html"],
    ),
    case(
        "reconstruct tf in/bright --volume in/cube.vdb --init in/two.tf.json --texels 4 --rays 128 --iterations 1 -o out/f.tf.json --report out/page",
        &["in/two.tf.json", "in/cube.vdb", "in/bright/transforms.json", "in/bright/view_003.exr"],
        &["out/f.tf.json", "out/page/index.html"],
    ),
    case("transfer in/two.tf.json -o out/t.tf.json", &["in/two.tf.json"], &["out/t.tf.json"]),
    case(
        "transfer --suggest in/plume.vdb -o out/u.tf.json --sheet out/u.png",
        &["in/plume.vdb"],
        &["out/u.tf.json", "out/u.png"],
    ),
    case(
        "usd author in/cube.vdb --tf in/two.tf.json --sky in/sky.exr --camera in/cap --overwrite -o out/s.usda",
        &["in/sky.exr", "in/cube.vdb", "in/two.tf.json", "in/cap/transforms.json"],
        &["out/s.usda"],
    ),
    case("usd lint in/bare.usda --fix out/f.usda --overwrite", &["in/bare.usda", "in/cube.vdb"], &["out/f.usda"]),
    case(
        "view in/cube.vdb in/cap --tf in/two.tf.json -o out",
        &["in/cube.vdb", "in/two.tf.json", "in/cap/view_002.exr"],
        &["out/cube.vdb.png", "out/cap.png"],
    ),
    case(
        "viewpoint in/cube.vdb --tf in/two.tf.json --init in/cap --starts 2 --iterations 1 --size 8x8 --overwrite --pictures out/best -o out/best.json --report out/page",
        &["in/cube.vdb", "in/two.tf.json", "in/cap/transforms.json"],
        &["out/best.json", "out/best/view_000.exr", "out/page/index.html"],
    ),
];

/// Command that makes a page again, in the folder that it reads.
pub const REPORT: Case = case(
    "report out/page --reference in/cube.vdb --beside other=in/cap",
    &["in/cube.vdb", "in/cap/transforms.json", "in/cap/view_003.exr"],
    &["out/page/index.html"],
);

/// A folder with the inputs of all commands.
pub fn prepared() -> Work {
    let work = Work::new();
    std::fs::create_dir(work.path("in")).unwrap();
    for (from, to) in [
        ("cube.vdb", "cube.vdb"),
        ("slab.vdb", "slab.vdb"),
        ("plume.vdb", "plume.vdb"),
        ("cube.vdb", "s.0000.vdb"),
        ("slab.vdb", "s.0001.vdb"),
    ] {
        std::fs::copy(fixture(from), work.path(&format!("in/{to}"))).unwrap();
    }
    let tf = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise",
                 "points": [[0.0, 1, 1, 1, 0.0], [1.0, 0.2, 0.5, 0.9, 2.0]]}}"#;
    std::fs::write(work.path("in/two.tf.json"), tf).unwrap();
    let scene = r#"{"volumes": [{"file": "s.####.vdb", "medium": {"transfer": "two.tf.json"}}],
                    "lights": [{"type": "DomeLight", "texture": "sky.exr"}]}"#;
    std::fs::write(work.path("in/scene.json"), scene).unwrap();
    let bare = "#usda 1.0\ndef Volume \"v\" {\n rel field:density = </v/density>\n def OpenVDBAsset \"density\" {\n  \
                token fieldName = \"density\"\n  asset filePath = @./cube.vdb@\n }\n}\n";
    std::fs::write(work.path("in/bare.usda"), bare).unwrap();
    work.json("render in/cube.vdb --views 4 --size 12x12 -o in/cap");
    work.json("render in/cube.vdb --views 4 --size 12x12 --tf in/two.tf.json -o in/bright");
    work.json("render in/cube.vdb --views 1 --size 8x4 --albedo 0.9 --samples 2 -o in/sky.exr");
    work.json("render in/cube.vdb --views 1 --size 4x4 --albedo 0.9 --samples 2 --aov depth -o in/z.exr");
    work.json("render in/cube.vdb --views 1 --size 4x4 --deep 0.1 -o in/d.exr");
    for seed in 0..4 {
        work.json(&format!(
            "render in/cube.vdb --views 1 --size 16x16 --albedo 0.9 --samples 2 --seed {seed} -o in/n{seed}.exr"
        ));
    }
    work.json("motion in/cube.vdb --cameras in/cap --samples 1 -o in/m_%03d.exr");
    work.json("usd author in/cube.vdb --sky in/sky.exr --albedo 0.9 -o in/stage.usda");
    work.json("convert in/cube.vdb in/o.nvdb");
    work.json("convert in/cube.vdb in/o.ply --iso 1");
    work.json("convert in/cube.vdb in/o.mhd");
    work.json("convert in/sky.exr in/sky.npy");
    work.json("reconstruct density in/cap -o in/found.vdb --resolution 8 --iterations 1 --report in/page");
    work.json("reconstruct color in/bright -o in/shaded.vdb --resolution 8 --iterations 1");
    work
}

/// How an output is made an input.
#[derive(Debug, Clone, Copy)]
pub enum Spelling {
    Symbolic,
    Hard,
}

/// Makes the folder `out` anew.
pub fn fresh(work: &Work, case: &Case) {
    let out = work.path("out");
    let _ = std::fs::remove_dir_all(&out);
    std::fs::create_dir(&out).unwrap();
    if case.words.starts_with("report") {
        std::fs::create_dir(out.join("page")).unwrap();
        std::fs::copy(work.path("in/page/run.json"), out.join("page/run.json")).unwrap();
    }
}

/// The command works where it replaces no input, and writes what the case says.
pub fn works(work: &Work, case: &Case) {
    fresh(work, case);
    let out = work.command(case.words).output().unwrap();
    assert!(matches!(out.status.code(), Some(0 | 1)), "{}: {}", case.words, errors(&out));
    for output in case.outputs {
        assert!(
            work.path(output).is_file(),
            "{}: {output} was not written: {:?}",
            case.words,
            work.files("out").keys()
        );
    }
}

/// The command is refused where one of its outputs is one of its inputs, which stays as it is.
pub fn refused(work: &Work, case: &Case, input: &str, output: &str, spelling: Spelling) {
    fresh(work, case);
    let before = std::fs::read(work.path(input)).unwrap();
    let (from, to) = (work.path(input), work.path(output));
    std::fs::create_dir_all(to.parent().unwrap_or(Path::new("."))).unwrap();
    match spelling {
        Spelling::Symbolic => symlink(&from, &to).unwrap(),
        Spelling::Hard => std::fs::hard_link(&from, &to).unwrap(),
    }
    let out = work.command(case.words).output().unwrap();
    let place = format!("{}\n{output} is {input} ({spelling:?})\n{}", case.words, errors(&out));
    assert!(std::fs::read(&from).unwrap() == before, "replaced: {place}");
    assert!(std::fs::read(&to).unwrap() == before, "the link was replaced: {place}");
    assert_eq!(out.status.code(), Some(2), "{place}");
    assert!(errors(&out).contains("is an input of this command"), "{place}");
}
