//! Stages whose arcs lead to layers, to files of other kinds, folders, devices and pipes, to each other and nowhere.

use super::Dice;
use super::corpus::Sample;
use super::mutate::Syntax;
use crate::common::stages;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Commands that read a stage.
pub const COMMANDS: [&str; 5] =
    ["info {}", "plan {} --size 6x6", "render {} --size 6x6 --samples 1 -o >out", "validate {}", "usd lint {}"];

/// Layers whose arcs are drawn.
const LAYERS: [&str; 3] = ["stage.usda", "a.usda", "b.usda"];
/// Targets that are layers.
const SOUND: [&str; 4] = ["./sound.usda", "./sound.usdc", "./sound.usdz", "./sound.usdz[root.usdc]"];
/// Targets that are none. `PIPE` is a pipe.
const BAD: [&str; 15] = [
    "./cube.vdb",
    "./text.geom",
    "./text.txt",
    "./empty.usda",
    "./noise.usdc",
    "./noise.usdz",
    "./sound.usdz[gone.usda]",
    "./gone.usda",
    "./gone/sound.usda",
    ".",
    "/dev/null",
    "/dev/zero",
    "/dev/zero[x.usda]",
    "PIPE",
    "PIPEz[x.usda]",
];

/// Inherits of a class that lies in the prim which layers reference.
const WITHIN: &str = "inherits within";

/// Whether all arcs of a stage lead to layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arcs {
    Whole,
    /// One leads to something else.
    Broken,
    /// Some lead in circles, or to classes where the composition looks for them in a circle.
    Circular,
}

/// Draws a stage. `pipe` is the path of a pipe that ends in `.usd`, beside which another ends in `.usdz`.
pub fn sample(dice: &mut Dice, pipe: &Path, cube: &[u8]) -> (Sample, Arcs) {
    let mut files = sound_files(cube);
    let mut leads: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    let mut within = BTreeSet::new();
    for layer in LAYERS {
        let arcs: Vec<(&str, String)> = (0..1 + dice.below(2)).map(|_| arc(dice)).collect();
        if arcs.iter().any(|(kind, _)| *kind == WITHIN) {
            within.insert(layer);
        }
        leads.insert(layer, arcs.iter().map(|(_, target)| target.clone()).collect());
        files.insert(layer.into(), text(layer, &arcs, pipe).into_bytes());
    }
    let mut reached = BTreeSet::from([LAYERS[0]]);
    let mut open = vec![LAYERS[0]];
    let mut circular = false;
    while let Some(layer) = open.pop() {
        for next in LAYERS.into_iter().filter(|next| leads[layer].iter().any(|to| to.strip_prefix("./") == Some(*next)))
        {
            circular |= !reached.insert(next);
            if !circular {
                open.push(next);
            }
        }
    }
    // A circle closes among the layers that were reached, all of whose arcs count.
    if circular {
        let further =
            LAYERS.into_iter().filter(|next| leads.values().flatten().any(|to| to.strip_prefix("./") == Some(*next)));
        reached.extend(further);
    }
    circular |= reached.iter().any(|layer| within.contains(layer));
    let broken = |layer: &&str| leads[*layer].iter().any(|to| BAD.contains(&to.as_str()));
    let arcs = match (circular, reached.iter().any(broken)) {
        (false, false) => Arcs::Whole,
        (false, true) => Arcs::Broken,
        (true, _) => Arcs::Circular,
    };
    let name = format!("stage of references {leads:?}");
    let sample = Sample { name, files, damaged: LAYERS[0].into(), syntax: Syntax::Binary, commands: COMMANDS.to_vec() };
    (sample, arcs)
}

fn arc(dice: &mut Dice) -> (&'static str, String) {
    let kind = *dice.choose(&["references", "payload", "subLayers", "inherits", WITHIN]);
    let target = match dice.below(5) {
        0 | 1 => (*dice.choose(&BAD)).to_owned(),
        2 => format!("./{}", dice.choose(&LAYERS)),
        _ => (*dice.choose(&SOUND)).to_owned(),
    };
    (kind, target)
}

/// The text of a layer with its arcs; the root layer has a volume and a camera beside them.
fn text(layer: &str, arcs: &[(&str, String)], pipe: &Path) -> String {
    let path = |target: &str| target.replace("PIPE", pipe.to_str().unwrap());
    let sublayers: Vec<String> =
        arcs.iter().filter(|(kind, _)| *kind == "subLayers").map(|(_, to)| format!("@{}@", path(to))).collect();
    let mut text = format!(
        "#usda 1.0\n(\n defaultPrim = \"World\"\n metersPerUnit = 1\n upAxis = \"Z\"\n subLayers = [{}]\n)\ndef Xform \"World\" {{\n",
        sublayers.join(", ")
    );
    for (number, (kind, target)) in arcs.iter().enumerate() {
        let target = path(target);
        text += &match *kind {
            "subLayers" => String::new(),
            "inherits" => format!(" def Xform \"m{number}\" (inherits = </_c{number}>) {{}}\n"),
            WITHIN => format!(
                " class Xform \"_c{number}\" (references = @{target}@</World>) {{}}\n def Xform \"m{number}\" (inherits = \
                 </World/_c{number}>) {{}}\n"
            ),
            kind => format!(" def Xform \"m{number}\" ({kind} = @{target}@</World>) {{}}\n"),
        };
    }
    text += "}\n";
    for (number, (_, target)) in arcs.iter().enumerate().filter(|(_, (kind, _))| *kind == "inherits") {
        text += &format!("class Xform \"_c{number}\" (references = @{}@</World>) {{}}\n", path(target));
    }
    if layer == LAYERS[0] {
        text += "def Volume \"v\" {\n rel field:density = </v/density>\n def OpenVDBAsset \"density\" {\n token fieldName = \
                 \"density\"\n asset filePath = @./cube.vdb@\n }\n}\ndef Camera \"c\" {\n double3 xformOp:translate = (0, 0, \
                 5)\n uniform token[] xformOpOrder = [\"xformOp:translate\"]\n}\n";
    }
    text
}

fn sound_files(cube: &[u8]) -> BTreeMap<PathBuf, Vec<u8>> {
    let body = "(\n defaultPrim = \"World\"\n)\ndef Xform \"World\" {\n def Scope \"s\" {}\n}\n";
    let binary = stages::binary(body);
    let files = [
        ("cube.vdb", cube.to_vec()),
        ("text.geom", format!("#usda 1.0\n{body}").into_bytes()),
        ("text.txt", b"smoke".to_vec()),
        ("empty.usda", Vec::new()),
        ("noise.usdc", b"PXR-USDC and nothing else".to_vec()),
        ("noise.usdz", b"PK".to_vec()),
        ("sound.usda", format!("#usda 1.0\n{body}").into_bytes()),
        ("sound.usdz", stages::package(&[("root.usdc", &binary)])),
        ("sound.usdc", binary),
    ];
    files.map(|(name, bytes)| (PathBuf::from(name), bytes)).into()
}
