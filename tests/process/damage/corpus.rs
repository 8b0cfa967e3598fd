//! Sound inputs of every kind, and the commands that read each.

use super::mutate::Syntax;
use crate::common::shapes::gltf;
use crate::common::{images, stages};
use base64::Engine;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A sound input: the files it needs, one of which is to be damaged.
pub struct Sample {
    /// For people: `scalar volume plume.vdb`.
    pub name: String,
    /// Path and content of every file, relative to the folder of the case.
    pub files: BTreeMap<PathBuf, Vec<u8>>,
    /// The one that is damaged.
    pub damaged: PathBuf,
    pub syntax: Syntax,
    /// Command lines that read it: `{}` is the damaged file, `@name` a sound file, `>name` an output.
    pub commands: Vec<&'static str>,
}

/// Kinds of inputs, each with as large a share of the cases as every other.
pub struct Corpus {
    pub kinds: Vec<(&'static str, Vec<Sample>)>,
    /// Folder of the sound files that commands need beside the damaged one.
    pub sound: PathBuf,
}

const VOLUME: [&str; 14] = [
    "info {}",
    "view {} --size 16 -o >sheet.png",
    "validate {}",
    "convert {} >out.vdb --half --repair",
    "convert {} >out.vdb --resample 0.1 --codec none",
    "convert {} >out.vdb --crop=0,0,0,1,1,1 --prune 0.01",
    "diff {} @plume.vdb",
    "render {} --views 1 --size 8x8 -o >out",
    "render {} --views 1 --size 6x6 --albedo 0.9 --sun 1,1,1 --samples 2 -o >out",
    "gradient {} --views 1 --size 6x6 --loss mean --wrt density,camera -o >gradient.vdb",
    "viewpoint {} --starts 1 --iterations 1 --size 8x8 -o >best.json",
    "reconstruct density @capture --init {} --resolution 8 --iterations 1 -o >found.vdb",
    "reconstruct tf @glow --volume {} --texels 8 --rays 128 --iterations 1 -o >found.tf.json",
    "pose @capture --volume {} --iterations 1 -o >posed.json",
];

/// For volumes that most commands refuse.
const OTHER_VOLUME: [&str; 7] = [
    "info {}",
    "view {} --size 16 -o >sheet.png",
    "validate {}",
    "convert {} >out.vdb",
    "convert {} >out.vdb --half --codec none --repair",
    "diff {} {}",
    "render {} --views 1 --size 8x8 -o >out",
];

const SHADED: [&str; 6] = [
    "info {}",
    "validate {}",
    "convert {} >out.vdb --half",
    "diff @shaded.vdb {}",
    "render {} --model pre-shaded --views 1 --size 8x8 -o >out",
    "gradient {} --model pre-shaded --views 1 --size 6x6 --loss mean --wrt emission -o >gradient.vdb",
];

const CARRIED: [&str; 5] = [
    "info {}",
    "validate {}",
    "transfer {} -o >out.tf.json",
    "render {} --tf {} --views 1 --size 8x8 -o >out",
    "convert {} >out.vdb",
];

const PICTURE: [&str; 5] = [
    "info {}",
    "validate {}",
    "compare {} {}",
    "compare {} @view.exr --heatmap >heat.png",
    "view {} --size 16 -o >sheet.png",
];

const DEEP: [&str; 6] = [
    "info {}",
    "validate {}",
    "convert {} >flat.exr --flatten",
    "convert {} >flat.png --flatten",
    "compare {} {}",
    "view {} --size 16 -o >sheet.png",
];

/// Numbered, so that what works on sequences reads it, too.
const NUMBERED: [&str; 5] = [
    "info {}",
    "denoise numbered.####.exr -o quiet.####.exr",
    "denoise numbered.####.exr -o quiet.####.exr --method svgf --alpha --confidence",
    "denoise numbered.####.exr -o quiet.####.exr --motion layer:Vector",
    "compare numbered.####.exr numbered.####.exr --flip",
];

const CAPTURE: [&str; 9] = [
    "info capture",
    "view capture --size 16 -o >sheet.png",
    "validate capture",
    "denoise capture/view_%03d.exr -o quiet_%03d.exr",
    "motion @plume.vdb --cameras capture --samples 1 -o motion.####.exr",
    "render @plume.vdb --cameras capture -o >out",
    "reconstruct density capture --resolution 8 --iterations 1 -o >found.vdb",
    "pose capture --volume @plume.vdb --iterations 1 -o >posed.json",
    "gradient @plume.vdb --target capture --loss l2 --wrt camera,extinction",
];

const GLOW: [&str; 6] = [
    "info capture",
    "validate capture",
    "reconstruct color capture --resolution 8 --iterations 1 -o >found.vdb",
    "reconstruct tf capture --volume @plume.vdb --texels 8 --rays 128 --iterations 1 -o >found.tf.json",
    "reconstruct density capture --resolution 8 --iterations 1 -o >found.vdb",
    "gradient @plume.vdb --target capture --loss l2 --wrt tf",
];

const TRANSFER: [&str; 8] = [
    "transfer {}",
    "transfer {} --range 0,1 -o >out.tf.json",
    "render @plume.vdb --tf {} --views 1 --size 8x8 -o >out",
    "convert @plume.vdb >out.vdb --tf {}",
    "gradient @plume.vdb --tf {} --views 1 --size 4x4 --loss mean --wrt tf",
    "viewpoint @plume.vdb --tf {} --starts 1 --iterations 1 --size 8x8 -o >best.json",
    "reconstruct density @glow --tf {} --resolution 8 --iterations 1 -o >found.vdb",
    "reconstruct tf @glow --volume @plume.vdb --init {} --rays 128 --iterations 1 -o >found.tf.json",
];

const MESH: [&str; 2] =
    ["convert {} >out.vdb --voxel-size 0.1", "convert {} >out.vdb --voxel-size 0.02 --half-width 2 --to fog --half"];

const NANO: [&str; 3] = ["info {}", "validate {}", "convert {} >out.vdb"];

/// Metadata of an OME-Zarr of 4 x 3 x 2 voxels in one chunk, by the file's path.
fn zarr() -> BTreeMap<PathBuf, Vec<u8>> {
    let axis = |name: &str| json!({"name": name, "type": "space", "unit": "micrometer"});
    let scale = json!([{"type": "scale", "scale": [2.0, 1.0, 0.5]}]);
    let axes = ["z", "y", "x"].map(axis);
    let datasets = json!([{"path": "0", "coordinateTransformations": scale}]);
    let multiscales = json!([{"axes": axes, "datasets": datasets}]);
    let attributes = json!({"ome": {"version": "0.5", "multiscales": multiscales}});
    let array = json!({"zarr_format": 3, "node_type": "array", "shape": [2, 3, 4], "data_type": "uint8",
        "fill_value": 0, "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [2, 3, 4]}},
        "chunk_key_encoding": {"name": "default"}, "codecs": [{"name": "bytes"}, {"name": "gzip"}]});
    let files = [
        ("zarr.json", json!({"zarr_format": 3, "node_type": "group", "attributes": attributes}).to_string().into()),
        ("0/zarr.json", array.to_string().into()),
        ("0/c/0/0/0", images::gzip(&Vec::from_iter(0..24))),
    ];
    files.map(|(name, bytes)| (Path::new("image.zarr").join(name), bytes)).into()
}

/// A DICOM file of one slice of 2 x 2 bytes.
fn dicom() -> Vec<u8> {
    let mut bytes = [&[0; 128][..], b"DICM"].concat();
    let mut element = |tag: u32, kind: &[u8; 2], value: &[u8]| {
        bytes.extend(((tag >> 16) as u16).to_le_bytes());
        bytes.extend((tag as u16).to_le_bytes());
        bytes.extend(kind);
        if kind == b"OB" {
            bytes.extend([0; 2]);
            bytes.extend((value.len() as u32).to_le_bytes());
        } else {
            bytes.extend((value.len() as u16).to_le_bytes());
        }
        bytes.extend(value);
    };
    element(0x0002_0010, b"UI", b"1.2.840.10008.1.2.1\0");
    element(0x0020_000e, b"UI", b"1.2\0");
    element(0x0020_0032, b"DS", b"0\\0\\0 ");
    element(0x0020_0037, b"DS", b"1\\0\\0\\0\\1\\0 ");
    let words = [(0x0028_0010, 2), (0x0028_0011, 2), (0x0028_0100, 8), (0x0028_0101, 8), (0x0028_0102, 7)];
    element(0x0028_0030, b"DS", b"1\\1 ");
    words.iter().for_each(|(tag, value)| element(*tag, b"US", &u16::to_le_bytes(*value)));
    element(0x7fe0_0010, b"OB", &[1, 2, 3, 4]);
    bytes
}

const STAGE: [&str; 4] = ["info {}", "validate {}", "plan {} --size 6x6", "render {} --size 6x6 --samples 2 -o >out"];

/// A stage of a volume and a mesh with a light and a camera that moves, as text, binary or package.
fn stage(name: &str, volume: &[u8]) -> Vec<u8> {
    let text = r#"
def Xform "World" {
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 2: (1, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Volume "smoke" {
        rel field:density = </World/smoke/density>
        custom double cumulo:densityScale = 2
        def OpenVDBAsset "density" {
            token fieldName = "density"
            asset filePath = @./cube.vdb@
        }
    }
    def Camera "camera" {
        float focalLength.timeSamples = { 1: 30, 2: 50 }
        quatf xformOp:orient = (1, 0, 0, 0)
        double3 xformOp:translate = (0, 0, 5)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
    }
    def SphereLight "lamp" (
        kind = "component"
        customData = { string note = "a" }
    ) {
        color3f inputs:color = (1, 0.5, 0.25)
        bool inputs:normalize = 1
    }
    def Mesh "floor" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    ) {
        point3f[] points = [(-2, 0, 0), (2, 0, 0), (2, 3, 0), (-2, 3, 0), (0, 1, 1)]
        int[] faceVertexCounts = [4, 3, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 0, 1, 4, 2, 3, 4]
        color3f[] primvars:displayColor = [(0.5, 0.5, 0.25)]
        custom color3f cumulo:emission = (0.5, 0.25, 0.125)
        double3 xformOp:translate.timeSamples = { 1: (0, 0, -1), 2: (0, 0, -0.5) }
        uniform token[] xformOpOrder = ["xformOp:translate"]
        rel material:binding = </World/grey>
        def GeomSubset "half" (
            prepend apiSchemas = ["MaterialBindingAPI"]
        ) {
            uniform token elementType = "face"
            int[] indices = [1, 2]
            rel material:binding = </World/grey>
        }
    }
    def Material "grey" {
        token outputs:surface.connect = </World/grey/shader.outputs:surface>
        def Shader "shader" {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0.25, 0.5, 0.5)
            token outputs:surface
        }
    }
}
"#;
    match name {
        "stage.usda" => format!("#usda 1.0\n{text}").into_bytes(),
        "stage.usdc" => stages::binary(text),
        _ => stages::package(&[("root.usdc", &stages::binary(text)), ("cube.vdb", volume)]),
    }
}

impl Corpus {
    /// Makes the sound files with the program itself, and with OpenVDB's tools what it does not make: volumes of
    /// points, and one of large tiles.
    pub fn new(folder: &Path) -> Self {
        let made = Maker { folder: folder.to_path_buf() };
        made.volumes();
        made.functions();
        made.captures();
        let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
        let fixture =
            |name: &str| std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)).unwrap();
        let single = |kind: &str, name: &str, bytes: Vec<u8>, syntax, commands: &[&'static str]| {
            let damaged = PathBuf::from(Path::new(name).file_name().unwrap());
            Sample {
                name: format!("{kind} {name}"),
                files: BTreeMap::from([(damaged.clone(), bytes)]),
                damaged,
                syntax,
                commands: commands.to_vec(),
            }
        };
        let volume = |kind, name: &str, bytes, commands| single(kind, name, bytes, Syntax::Binary, commands);

        let mut scalar: Vec<Sample> = ["cube.vdb", "plume.vdb", "blob_sheared.vdb", "tiles.vdb"]
            .map(|name| volume("scalar volume", name, fixture(name), &VOLUME))
            .into();
        scalar.extend(
            ["half.vdb", "plain.vdb", "tiny.vdb", "wide.vdb"].map(|n| volume("scalar volume", n, read(n), &VOLUME)),
        );
        let mut other: Vec<Sample> = ["kinds.vdb", "sphere_level_set.vdb"]
            .map(|name| volume("other volume", name, fixture(name), &OTHER_VOLUME))
            .into();
        other.push(volume("points", "points.vdb", read("points.vdb"), &OTHER_VOLUME));
        other.push(volume("points", "points.vdb", read("points.vdb"), &OTHER_VOLUME));
        other.push(volume("pre-shaded volume", "shaded.vdb", read("shaded.vdb"), &SHADED));
        other.push(volume("volume with a function", "carried.vdb", read("carried.vdb"), &CARRIED));

        let mut pictures: Vec<PathBuf> = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/exr"))
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.extension().is_some_and(|e| e == "exr"))
            .collect();
        pictures.sort();
        let exr = pictures.iter().flat_map(|path| {
            let name = path.file_name().unwrap().to_str().unwrap();
            let bytes = std::fs::read(path).unwrap();
            let mut numbered = single("picture", "numbered.0001.exr", bytes.clone(), Syntax::Binary, &NUMBERED);
            numbered.name = format!("numbered {name}");
            let commands: &[_] = if name.starts_with("deep") { &DEEP } else { &PICTURE };
            [single("picture", name, bytes, Syntax::Binary, commands), numbered]
        });

        let mut captures = Vec::new();
        for (name, commands) in [("capture", &CAPTURE[..]), ("flat", &CAPTURE[..]), ("glow", &GLOW[..])] {
            captures.push(capture(folder, name, "transforms.json", Syntax::Json, commands));
            captures.push(capture(folder, name, "transforms.json", Syntax::Json, commands));
            captures.push(capture(folder, name, "view_001.exr", Syntax::Binary, commands));
        }

        let function = |name: &str, syntax| single("function", name, read(name), syntax, &TRANSFER);
        let functions = vec![
            function("texture.tf.json", Syntax::Json),
            function("piecewise.tf.json", Syntax::Json),
            function("gaussians.tf.json", Syntax::Json),
            function("identity.tf.json", Syntax::Json),
        ];
        let presets = vec![
            function("presets.json", Syntax::Json),
            function("presets.xml", Syntax::Xml),
            function("categories.json", Syntax::Json),
        ];

        // Each is read by `--init`, and judged by `--resume`, which refuses it: it was made elsewhere.
        let resumed = |name: &str, syntax, commands: [&'static str; 2]| {
            single("resumed output", name, read(name), syntax, &commands)
        };
        let outputs = vec![
            resumed(
                "density.vdb",
                Syntax::Binary,
                [
                    "reconstruct density @capture --resolution 8 --iterations 1 --init {} -o >found.vdb",
                    "reconstruct density @capture --resolution 8 --iterations 1 --resume -o >{}",
                ],
            ),
            resumed(
                "shaded.vdb",
                Syntax::Binary,
                [
                    "reconstruct color @glow --resolution 8 --iterations 1 --init {} -o >found.vdb",
                    "reconstruct color @glow --resolution 8 --iterations 1 --resume -o >{}",
                ],
            ),
            resumed(
                "found.tf.json",
                Syntax::Json,
                [
                    "reconstruct tf @glow --volume @plume.vdb --texels 8 --rays 128 --iterations 1 --init {} -o >o.tf.json",
                    "reconstruct tf @glow --volume @plume.vdb --texels 8 --rays 128 --iterations 1 --resume -o >{}",
                ],
            ),
            resumed(
                "best.json",
                Syntax::Json,
                [
                    "viewpoint @plume.vdb --starts 1 --iterations 1 --size 8x8 --init {} -o >found.json",
                    "viewpoint @plume.vdb --starts 1 --iterations 1 --size 8x8 --resume -o >{}",
                ],
            ),
            resumed(
                "posed.json",
                Syntax::Json,
                [
                    "pose @capture --volume @plume.vdb --iterations 1 --init {} -o >found.json",
                    "pose @capture --volume @plume.vdb --iterations 1 --resume -o >{}",
                ],
            ),
        ];

        let record = |name: &str, commands: &[&'static str]| {
            let damaged = PathBuf::from("page/run.json");
            let mut files = BTreeMap::new();
            for file in ["run.json", "index.html"] {
                files.insert(Path::new("page").join(file), read(&format!("{name}/{file}")));
            }
            let name = format!("record {name}");
            Sample { name, files, damaged, syntax: Syntax::Json, commands: commands.to_vec() }
        };
        let records = vec![
            record("density-page", &["report page", "report page --reference @density.vdb --beside other=@capture"]),
            record("tf-page", &["report page", "report page --reference @piecewise.tf.json"]),
        ];

        let scenes = ["scene.json", "fire.json", "plume.vdb", "sky.exr"].map(|damaged| {
            let files = ["scene.json", "fire.json", "plume.vdb", "sky.exr", "piecewise.tf.json"];
            Sample {
                name: format!("scene {damaged}"),
                files: files.map(|name| (PathBuf::from("scene").join(name), read(&scene_file(name)))).into(),
                damaged: PathBuf::from("scene").join(damaged),
                syntax: if damaged.ends_with(".json") { Syntax::Json } else { Syntax::Binary },
                commands: match damaged {
                    "fire.json" => vec!["render scene/fire.json --views 1 --size 6x6 --samples 2 -o >out"],
                    _ => vec!["render scene/scene.json --views 1 --size 6x6 --samples 2 -o >out"],
                },
            }
        });

        let stages = ["stage.usda", "stage.usdc", "stage.usdz"].map(|name| {
            let bytes = stage(name, &fixture("cube.vdb"));
            let mut sample = single("stage", name, bytes, Syntax::Binary, &STAGE);
            sample.files.insert("cube.vdb".into(), fixture("cube.vdb"));
            sample
        });

        let nano = ["cube.nvdb", "kinds.nvdb"].map(|name| volume("NanoVDB", name, read(name), &NANO));
        let meshes = ["plume.ply", "text.ply", "plume.obj", "scene.glb", "scene.gltf"]
            .map(|name| volume("mesh", name, read(name), &MESH));
        let zarr = zarr();
        let zarrs = zarr.keys().map(|damaged| Sample {
            name: format!("OME-Zarr {}", damaged.display()),
            files: zarr.clone(),
            damaged: damaged.clone(),
            syntax: if damaged.ends_with("zarr.json") { Syntax::Json } else { Syntax::Binary },
            commands: vec!["convert image.zarr >out.vdb"],
        });

        let slice = single("image", "slice.dcm", dicom(), Syntax::Binary, &["convert {} >out.vdb"]);
        let kinds = vec![
            ("NanoVDB", nano.into()),
            ("meshes", meshes.into()),
            ("OME-Zarr", zarrs.collect()),
            ("images", images::samples().iter().map(image).chain([slice]).collect()),
            ("stages", stages.into()),
            ("scenes", scenes.into()),
            ("scalar volumes", scalar),
            ("other volumes", other),
            ("pictures", exr.collect()),
            ("captures", captures),
            ("transfer functions", functions),
            ("presets", presets),
            ("resumed outputs", outputs),
            ("records of runs", records),
        ];
        Self { kinds, sound: folder.to_path_buf() }
    }
}

/// An image, whose first file is damaged.
fn image(sample: &images::Sample) -> Sample {
    let words = format!("convert {{}} >out.vdb {}", images::options(sample).join(" "));
    Sample {
        name: format!("image {}", sample.name),
        files: sample.files.iter().map(|(name, bytes)| (PathBuf::from(name), bytes.clone())).collect(),
        damaged: PathBuf::from(sample.files[0].0),
        syntax: Syntax::Binary,
        commands: vec![words.leak()],
    }
}

/// The name in the corpus of a file of the scene.
fn scene_file(name: &str) -> String {
    if name == "sky.exr" { "capture/view_001.exr".into() } else { name.into() }
}

/// A capture of which one file is damaged.
fn capture(folder: &Path, name: &str, damaged: &str, syntax: Syntax, commands: &[&'static str]) -> Sample {
    let files = std::fs::read_dir(folder.join(name)).unwrap().map(|entry| {
        let path = entry.unwrap().path();
        (Path::new("capture").join(path.file_name().unwrap()), std::fs::read(&path).unwrap())
    });
    // What reads a picture, and what looks at cameras alone.
    let picture = syntax == Syntax::Binary;
    let commands = commands.iter().filter(|words| !picture || !words.contains("--cameras"));
    Sample {
        name: format!("capture {name}/{damaged}"),
        files: files.collect(),
        damaged: Path::new("capture").join(damaged),
        syntax,
        commands: commands.copied().collect(),
    }
}

/// Makes sound files in a folder.
struct Maker {
    folder: PathBuf,
}

impl Maker {
    fn cumulo(&self, words: &str) {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cumulo"));
        let out = command.current_dir(&self.folder).args(words.split_whitespace()).output().unwrap();
        assert!(out.status.success(), "cumulo {words}: {}", String::from_utf8_lossy(&out.stderr));
    }

    fn write(&self, name: &str, content: &str) {
        std::fs::write(self.folder.join(name), content).unwrap();
    }

    fn volumes(&self) {
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
        std::fs::copy(fixtures.join("plume.vdb"), self.folder.join("plume.vdb")).unwrap();
        std::fs::copy(fixtures.join("cube.vdb"), self.folder.join("cube.vdb")).unwrap();
        std::fs::copy(fixtures.join("kinds.vdb"), self.folder.join("kinds.vdb")).unwrap();
        self.cumulo("convert cube.vdb cube.nvdb");
        self.cumulo("convert kinds.vdb kinds.nvdb");
        self.meshes();
        std::fs::copy(fixtures.join("exr/zip.exr"), self.folder.join("view.exr")).unwrap();
        self.cumulo("convert plume.vdb half.vdb --half --resample 0.1");
        self.cumulo("convert plume.vdb plain.vdb --codec none --resample 0.1");
        self.cumulo("convert cube.vdb tiny.vdb --prune 0.001");
        // A billion voxels in tiles of 128³.
        let wide = "import pyopenvdb as v\n\
            g = v.FloatGrid()\n\
            g.name, g.gridClass = 'density', v.GridClass.FOG_VOLUME\n\
            g.transform = v.createLinearTransform(0.001)\n\
            g.fill((0, 0, 0), (1023, 1023, 1023), 0.5)\n\
            v.write('wide.vdb', grids=[g])\n";
        let made = Command::new("/usr/bin/python3").args(["-c", wide]).current_dir(&self.folder).output().unwrap();
        assert!(made.status.success(), "pyopenvdb: {}", String::from_utf8_lossy(&made.stderr));
        let made = Command::new("vdb_tool")
            .args(["-sphere", "dim=16", "-scatter", "count=40", "-points2vdb", "-write", "points.vdb"])
            .current_dir(&self.folder)
            .output()
            .unwrap();
        assert!(made.status.success(), "vdb_tool: {}", String::from_utf8_lossy(&made.stderr));
    }

    /// The surface of a volume as binary PLY and as OBJ, and a tetrahedron as PLY in text.
    fn meshes(&self) {
        self.cumulo("convert plume.vdb plume.ply --iso 0.3");
        self.cumulo("convert plume.vdb plume.obj --iso 0.3");
        let header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                      element face 4\nproperty list uchar int vertex_indices\nend_header\n";
        let body = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
        self.write("text.ply", &format!("{header}{body}"));
        let (scene, buffer) = gltf(None);
        std::fs::write(self.folder.join("scene.glb"), scene).unwrap();
        let data = base64::engine::general_purpose::STANDARD.encode(buffer);
        let (scene, _) = gltf(Some(&format!("data:application/octet-stream;base64,{data}")));
        std::fs::write(self.folder.join("scene.gltf"), scene).unwrap();
    }

    fn functions(&self) {
        let texel = |i: usize| [0.1 * i as f64, 0.5, 1.0 - 0.1 * i as f64, 0.4 * i as f64];
        let texels: Vec<[f64; 4]> = (0..8).map(texel).collect();
        let lobe = |mean: f64| json!({"mean": mean, "ln_width": -2.0, "rgbs": [0.9, 0.5, 0.2, 3.0]});
        for (name, transfer) in [
            ("texture", json!({"kind": "texture", "domain": [0.0, 1.0], "texels": texels})),
            (
                "piecewise",
                json!({"kind": "piecewise", "points":
                [[0.0, 0.9, 0.4, 0.1, 0.0], [0.3, 0.9, 0.4, 0.1, 3.0], [1.0, 0.1, 0.4, 0.9, 6.0]]}),
            ),
            ("gaussians", json!({"kind": "gaussians", "domain": [0.0, 1.0], "lobes": [lobe(0.3), lobe(0.8)]})),
            ("identity", json!({"kind": "identity", "domain": [0.0, 1.0], "color": [0.9, 0.6, 0.3]})),
        ] {
            let document = json!({"format": "cumulo-transfer-function", "version": 1, "name": name,
                "transfer": transfer});
            self.write(&format!("{name}.tf.json"), &serde_json::to_string_pretty(&document).unwrap());
        }
        let presets = json!([
            {"Name": "two tone", "ColorSpace": "RGB", "Creator": "a test", "NanColor": [1, 1, 0],
                "RGBPoints": [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.5, 0.25],
                "Points": [0.0, 0.0, 0.5, 0.0, 0.5, 0.25, 0.5, 0.0, 1.0, 0.75, 0.5, 0.0]},
            {"Name": "plain", "ColorSpace": "Lab", "RGBPoints": [-2, 0, 0, 0.5, 6, 1, 1, 0]},
        ]);
        self.write("presets.json", &serde_json::to_string_pretty(&presets).unwrap());
        let categories = json!([
            {"Name": "warm", "ColorSpace": "HSV", "HSVWrap": 1, "RGBPoints": [0.0, 1.0, 0.0, 0.1, 1.0, 1.0, 0.1, 0.0]},
            {"Name": "kinds of rock", "IndexedColors": [1, 0, 0, 0, 1, 0]},
        ]);
        self.write("categories.json", &serde_json::to_string_pretty(&categories).unwrap());
        self.write(
            "presets.xml",
            r#"<?xml version="1.0"?>
<ColorMaps>
  <!-- both kinds of opacity -->
  <ColorMap name="hot &amp; cold" space="Diverging" indexedLookup="false">
    <Point x="0" o="1" r="0.1" g="0.2" b="0.8"/>
    <Point x="1" o="1" r="0.8" g="0.2" b="0.1"></Point>
    <NaN r="1" g="1" b="0"/>
  </ColorMap>
  <ColorMap name="veil" space="HSV">
    <Point x="0" o="0" r="1" g="0" b="0.1"/>
    <Point x="4" o="0.5" r="1" g="0.1" b="0"/>
  </ColorMap>
</ColorMaps>
"#,
        );
        let scene = json!({
            "volumes": [
                {"file": "plume.vdb", "medium": {
                    "density_scale": 4, "albedo": [0.9, 0.8, 0.7], "anisotropy": 0.5, "extinction_color": [1, 0.8, 0.6]}},
                {"file": "plume.vdb", "grid": "density", "medium": {"transfer": "piecewise.tf.json"}},
            ],
            "lights": [
                {"type": "DistantLight", "direction": [1, 1, 2], "irradiance": [3, 3, 3], "angle": 0.5},
                {"type": "SphereLight", "centre": [3, 0, 1], "radius": 0.2, "radiance": [20, 15, 10]},
                {"type": "RectLight", "corner": [0, 0, 4], "edges": [[0, 1, 0], [1, 0, 0]], "radiance": [4, 4, 4]},
                {"type": "PointLight", "position": [3, 3, 3], "intensity": [4, 4, 4]},
                {"type": "DomeLight", "radiance": [1, 1, 1], "texture": "sky.exr"},
            ],
        });
        self.write("scene.json", &serde_json::to_string_pretty(&scene).unwrap());
        let fire = json!({"volumes": [{"file": "plume.vdb", "medium": {
            "albedo": [0.5, 0.5, 0.5],
            "emission_grid": {"grid": "density", "radiance": [3, 2, 1]},
            "blackbody": {"grid": "density", "kelvin": 1500, "intensity": 2, "tint": [1, 1, 0.5]}}}]});
        self.write("fire.json", &serde_json::to_string_pretty(&fire).unwrap());
        self.cumulo("convert plume.vdb carried.vdb --resample 0.1 --tf piecewise.tf.json");
    }

    fn captures(&self) {
        self.cumulo("render plume.vdb --views 4 --size 12x12 --density-scale auto -o capture");
        self.cumulo("render cube.vdb --views 3 --layout ring --size 9x7 --density-scale 2 -o flat");
        self.cumulo("render plume.vdb --views 4 --size 12x12 --tf piecewise.tf.json -o glow");
        self.cumulo("reconstruct density capture --resolution 8 --iterations 1 -o density.vdb --report density-page");
        self.cumulo("reconstruct color glow --resolution 8 --iterations 1 -o shaded.vdb");
        self.cumulo(
            "reconstruct tf glow --volume plume.vdb --texels 8 --rays 128 --iterations 1 -o found.tf.json --report tf-page",
        );
        self.cumulo("viewpoint plume.vdb --starts 1 --iterations 1 --size 8x8 -o best.json");
        self.cumulo("pose capture --volume plume.vdb --iterations 1 -o posed.json");
    }
}
