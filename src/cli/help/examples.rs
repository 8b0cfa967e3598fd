//! Examples at the end of `--help`, by the words of the command.

type Examples = (&'static str, &'static [&'static str]);

/// Examples of each command; a test parses them.
const TABLE: &[Examples] = &[
    (
        "",
        &[
            "cumulo info smoke.vdb                                  # what is in a file",
            "cumulo render smoke.vdb --views 16 --density-scale auto -o shots",
            "cumulo reconstruct density shots -o found.vdb          # a volume from pictures",
            "cumulo diff smoke.vdb found.vdb                        # exit code 1 if they differ",
        ],
    ),
    (
        "capture convert",
        &[
            "cumulo capture convert nerfstudio.json -o flat         # without lens distortion",
            "cumulo capture convert flat -o model --to colmap",
            "cumulo capture convert stage.usda --pictures 'shot/view_%03d.exr' -o capture",
        ],
    ),
    (
        "capture new",
        &[
            "cumulo capture new smoke.vdb --views 24 --layout ring -o turn.json",
            "cumulo render smoke.vdb --cameras turn.json --frames 1-24 --camera-offset=-1 -o frames",
        ],
    ),
    (
        "compare",
        &[
            "cumulo compare render.exr reference.exr --tolerance 0.01",
            "cumulo compare render.exr reference.exr --heatmap difference.png --flip",
            "cumulo compare 'a/frame.####.exr' 'b/frame.####.exr' --frames 1-24 --report page",
            "cumulo compare --statistical noisy.exr reference.exr   # does only the noise differ?",
        ],
    ),
    ("completions", &["cumulo completions bash > ~/.local/share/bash-completion/completions/cumulo"]),
    (
        "convert",
        &[
            "cumulo convert smoke.vdb small.vdb --half --grid density",
            "cumulo convert 'in.####.vdb' 'out.####.vdb' --frames 1-24 --repair",
            "cumulo convert smoke.vdb heat.vdb both.vdb             # the grids of both files",
            "cumulo convert smoke.vdb smoke.npy                     # array[x, y, z]",
            "cumulo convert smoke.npy smoke.vdb --voxel-size 0.1",
            "cumulo convert head.nii.gz head.vdb --map -1024,3071",
            "cumulo convert maya.vdb blender.vdb --names blender --up z   # Houdini's: Blender's import turns them",
        ],
    ),
    (
        "denoise",
        &[
            "cumulo denoise 'noisy/frame.%04d.exr' -o 'quiet/frame.%04d.exr'",
            "cumulo denoise noisy.exr -o quiet.exr",
            "cumulo denoise 'noisy.####.exr' -o 'quiet.####.exr' --motion 'files:motion.####.exr'",
        ],
    ),
    (
        "diff",
        &[
            "cumulo diff smoke.vdb found.vdb --tolerance 1e-4",
            "cumulo diff 'a.####.vdb' 'b.####.vdb' --frames 1-24 --json",
        ],
    ),
    (
        "figure",
        &[
            "cumulo figure bone.png -o figure.svg --title 'Skull' --tf ct-bone --legend-label Density --unit HU",
            "cumulo figure a.exr b.exr c.exr -o figure.pdf --label A,B,C --scale-bar --length-unit mm --width 180mm",
            "cumulo figure head.exr -o head.png --orientation anatomical --scale-bar=50 --width 1200px",
        ],
    ),
    (
        "gradient",
        &[
            "cumulo gradient smoke.vdb --wrt density --loss l2 --target shots -o slopes.vdb",
            "cumulo gradient smoke.vdb --wrt camera --loss mean --views 1 --check",
        ],
    ),
    ("info", &["cumulo info smoke.vdb shots view.exr", "cumulo info 'smoke.####.vdb' --frames 1-24 --json"]),
    ("man", &["cumulo man render", "cumulo man -o ~/.local/share/man/man1"]),
    (
        "merge",
        &[
            "cumulo merge part-0.exr part-1.exr -o whole.exr",
            "cumulo merge farm/part-*.exr --confidence 0.99 -o whole.exr",
        ],
    ),
    ("motion", &["cumulo motion smoke.vdb --cameras path --frames 0-23 -o 'motion/frame.%04d.exr'"]),
    (
        "plan",
        &[
            "cumulo plan smoke.vdb --density-scale auto --albedo 0.9 --sun 1,1,2",
            "cumulo plan smoke.vdb --albedo 0.9 --max-omitted 0.1 --json",
            "cumulo plan shots --resolution 256 --machines 1,4,16",
        ],
    ),
    (
        "pose",
        &[
            "cumulo pose shots --volume smoke.vdb -o posed.json",
            "cumulo pose shots --volume smoke.vdb -o refined.json --solve-focal --init posed.json",
        ],
    ),
    (
        "reconstruct color",
        &["cumulo reconstruct color scans -o shaded.vdb", "cumulo reconstruct color scans -o shaded.vdb --report page"],
    ),
    (
        "reconstruct density",
        &[
            "cumulo reconstruct density shots -o found.vdb --report page",
            "cumulo reconstruct density scans --tf bone.tf.json -o densities.vdb",
        ],
    ),
    ("reconstruct tf", &["cumulo reconstruct tf scans --volume head.vdb -o found.tf.json"]),
    (
        "render",
        &[
            "cumulo render smoke.vdb --views 16 --density-scale auto -o shots",
            "cumulo render smoke.vdb --views 1 --albedo 0.9 --sun 1,1,2 --sky 0.1 --samples 64 -o lit",
            "cumulo render 'smoke.####.vdb' --frames 1-24 --views 1 --density-scale auto -o frames",
            "cumulo render smoke.vdb --frames 0-47 --orbit 48 --density-scale auto -o turntable",
            "cumulo render 'smoke.####.vdb' --frames 1-24 --views 1 -o frames --openjd job       # a job for a farm",
            "cumulo render found.vdb --cameras shots -o again",
            "cumulo render ct.vdb --tf ct-bone --tf-range 0,1 --from anterior,left -o bone",
        ],
    ),
    ("report", &["cumulo report page --reference smoke.vdb"]),
    ("schema", &["cumulo schema scene", "cumulo schema diff > diff.schema.json"]),
    ("selftest", &["cumulo selftest", "cumulo selftest dvr thin-free-paths       # an area and a case"]),
    (
        "study denoise",
        &[
            "cumulo study denoise 'noisy.####.exr' --reference 'true.####.exr' -o page",
            "cumulo study denoise 'few.####.exr' 'many.####.exr' --reference 'true.####.exr' --knobs method -o page",
        ],
    ),
    (
        "study gradient",
        &[
            "cumulo study gradient smoke.vdb --density-scale 4 -o page",
            "cumulo study gradient smoke.vdb --loss l2 --target shots --knobs quadrature,step -o page",
        ],
    ),
    (
        "study reconstruct",
        &[
            "cumulo study reconstruct shots -o page",
            "cumulo study reconstruct shots --knobs noise,iterations --resolution 32 -o page",
        ],
    ),
    (
        "study render",
        &[
            "cumulo study render smoke.vdb --density-scale auto -o page",
            "cumulo study render smoke.vdb --albedo 0.9 --sun 1,1,2 --knobs samples --wanted-error 0.05 -o page",
        ],
    ),
    (
        "transfer",
        &[
            "cumulo transfer preset.json -o warm.tf.json",
            "cumulo transfer preset.json --range 0,0.5 -o thin.tf.json",
            "cumulo transfer --suggest head.nii.gz --sheet sheet.png -o head.tf.json",
            "cumulo transfer --list                                 # color maps and presets by name",
        ],
    ),
    (
        "usd author",
        &[
            "cumulo usd author smoke.vdb -o smoke.usda",
            "cumulo usd author 'smoke.%04d.vdb' --albedo 0.9 --sun=-1,0.6,0.7 -o smoke.usda",
        ],
    ),
    ("usd lint", &["cumulo usd lint smoke.usda", "cumulo usd lint broken.usda --fix fixed.usda"]),
    (
        "validate",
        &[
            "cumulo validate smoke.vdb view.exr shots",
            "cumulo validate 'smoke.####.vdb' --json                # missing frames and outliers, too",
        ],
    ),
    (
        "view",
        &[
            "cumulo view smoke.vdb                                  # in the terminal",
            "cumulo view 'smoke.####.vdb' -o frames.png",
            "cumulo view shots view.exr -o sheets",
        ],
    ),
    ("viewpoint", &["cumulo viewpoint smoke.vdb --density-scale auto -o best.json"]),
];

/// Returns the examples of a command, such as `reconstruct density`, or of the program for no words.
pub(super) fn of(path: &str) -> Option<&'static [&'static str]> {
    TABLE.iter().find(|(name, _)| *name == path).map(|(_, lines)| *lines)
}

/// Returns all examples.
#[cfg(test)]
pub(super) fn all() -> impl Iterator<Item = &'static str> {
    TABLE.iter().flat_map(|(_, lines)| lines.iter().copied())
}
