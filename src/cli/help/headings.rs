//! Headings of options in `--help`, by the option's name.

const OUTPUT: &str = "Output";
const FRAMES: &str = "Frames";
const CAMERAS: &str = "Cameras and pictures";
const MEDIUM: &str = "Medium and light";
const GRIDS: &str = "Grids and layers";
const SCANS: &str = "Scans and arrays";
const ACCURACY: &str = "Accuracy and cost";
const SOLVER: &str = "Solver";
const TRANSFER: &str = "Transfer function";
const COMPARISON: &str = "Comparison";
const FIGURE: &str = "Figure";
const FARMS: &str = "Farms";
const GENERAL: &str = "General";

/// Options under each heading, by their identifiers.
const TABLE: [(&str, &[&str]); 13] = [
    (
        FARMS,
        &[
            "openjd",
            "openjd_chunk",
            "openjd_seconds",
            "openjd_reference",
            "openjd_tolerance",
            "machines",
            "network_bandwidth",
            "latency",
            "delay",
        ],
    ),
    (
        FIGURE,
        &[
            "title",
            "label",
            "columns",
            "width",
            "font_size",
            "legend",
            "legend_label",
            "unit",
            "scale_bar",
            "length_unit",
            "orientation",
        ],
    ),
    (
        OUTPUT,
        &[
            "output",
            "overwrite",
            "resume",
            "checkpoint",
            "report",
            "sheet",
            "heatmap",
            "fix",
            "to",
            "half",
            "compression",
            "format",
            "codec",
            "aov",
            "png",
            "exposure",
            "deep",
            "terminal",
        ],
    ),
    (FRAMES, &["frames", "frame", "fps", "velocity", "motion", "cuts", "chunk", "overlap", "direction"]),
    (
        CAMERAS,
        &[
            "views",
            "from",
            "azimuth",
            "elevation",
            "distance",
            "eye",
            "orthographic",
            "layout",
            "size",
            "fov",
            "crop",
            "cameras",
            "camera",
            "camera_offset",
            "orbit",
            "aperture",
            "focus",
            "shutter",
            "holdout",
            "holdout_layer",
            "holdout_depth",
            "camera_path",
            "pictures",
            "target",
            "color_space",
            "masked",
            "recenter",
            "up",
            "view",
            "hemisphere",
            "solve_focal",
        ],
    ),
    (
        MEDIUM,
        &[
            "model",
            "density_scale",
            "background",
            "emission",
            "emission_model",
            "albedo",
            "anisotropy",
            "gradient_shading",
            "gradient_scale",
            "specular",
            "roughness",
            "tf_color",
            "shade",
            "extinction_color",
            "sun",
            "sun_color",
            "sun_angle",
            "sky",
            "renderer",
        ],
    ),
    (
        GRIDS,
        &[
            "grid",
            "layer",
            "layers",
            "flatten",
            "rename",
            "resample",
            "prune",
            "repair",
            "voxel_size",
            "density",
            "up_from",
            "filter",
            "iso",
            "half_width",
            "adaptivity",
            "split",
            "eval",
            "merge",
            "names",
            "map",
            "threshold",
            "meters_per_unit",
        ],
    ),
    (
        SCANS,
        &[
            "time_point",
            "channel",
            "level",
            "series",
            "array",
            "grid_type",
            "axes",
            "voxel_edge",
            "spacing",
            "origin",
            "transform",
            "dims",
            "sample",
            "endian",
            "skip",
        ],
    ),
    (
        ACCURACY,
        &[
            "quadrature",
            "early_stop",
            "supersample",
            "denoise",
            "halves",
            "target_error",
            "time_limit",
            "replicates",
            "confidence_level",
            "samples",
            "seed",
            "max_bounces",
            "clamp",
            "max_omitted",
            "force",
            "resolution",
            "bounds",
            "largest",
            "voxels",
            "knobs",
            "repeats",
            "budget",
            "wanted_error",
            "wanted_seconds",
        ],
    ),
    (
        SOLVER,
        &[
            "solver",
            "held_out",
            "iterations",
            "smoothing",
            "smooth",
            "prior",
            "loss",
            "init",
            "rays",
            "texels",
            "domain",
            "starts",
            "wrt",
            "huber_delta",
            "transmittance_floor",
            "mode",
            "adjoint",
            "volume",
            "method",
            "guide",
            "alpha",
            "confidence",
            "history",
            "bandwidth",
            "forgetting",
            "spread",
            "likeness",
        ],
    ),
    (
        TRANSFER,
        &[
            "tf",
            "tf_preset",
            "tf_range",
            "tf_unit_distance",
            "tf_extinction",
            "suggest",
            "candidate",
            "preset",
            "range",
            "unit_distance",
            "extinction",
        ],
    ),
    (
        COMPARISON,
        &[
            "tolerance",
            "reference",
            "beside",
            "display",
            "flip",
            "statistical",
            "repeat_a",
            "repeat_b",
            "noiseless",
            "variance_layer",
            "false_alarm",
            "tile",
            "check",
            "all",
        ],
    ),
    (GENERAL, &["json", "threads", "quiet", "verbose", "max_memory", "scratch"]),
];

/// Returns the heading of an option; `None` leaves it among the options without one.
pub(super) fn of(id: &str) -> Option<&'static str> {
    TABLE.iter().find(|(_, ids)| ids.contains(&id)).map(|(heading, _)| *heading)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_option_has_one_heading() {
        let all: Vec<&str> = TABLE.iter().flat_map(|(_, ids)| ids.iter().copied()).collect();
        for id in &all {
            assert_eq!(all.iter().filter(|other| *other == id).count(), 1, "{id}");
        }
        assert_eq!((of("density_scale"), of("nonsense")), (Some(MEDIUM), None));
    }
}
