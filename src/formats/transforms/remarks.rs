//! Remarks on keys of other programs that have no effect here.

use serde_json::{Map, Value};

/// Keys at the top or in frames, and what is said of the first that is there.
const WITHOUT_EFFECT: [(&[&str], &str); 7] = [
    (&["depth_file_path", "depth_path"], "depth pictures are not used: cameras and colors tell the volume"),
    (
        &["aabb_scale", "scale", "offset"],
        "another program's unit cube: cameras stay where 'transform_matrix' puts them, and the region is found from \
         the pictures or given with ⟨bounds⟩",
    ),
    (
        &["applied_transform", "applied_scale"],
        "what was done to the cameras before: they stay as they are, and results lie in the same world as they do",
    ),
    (&["ply_file_path"], "points are not used"),
    (
        &["train_filenames", "val_filenames", "test_filenames"],
        "a split of the views: all of them are used; ⟨held_out⟩ keeps some for tests",
    ),
    (&["rotation", "sharpness"], "a note of the program that wrote the file"),
    (&["enable_depth_loading", "integer_depth_scale"], "about depth pictures, which are not used"),
];

/// Returns a remark for each group of keys of which the file has one.
pub(super) fn remarks(root: &Map<String, Value>) -> Vec<String> {
    let frames = root.get("frames").and_then(Value::as_array);
    let there = |key: &&&str| {
        let set = |map: &Map<String, Value>| map.get(**key).is_some_and(|v| !v.is_null());
        set(root) || frames.is_some_and(|frames| frames.iter().filter_map(Value::as_object).any(set))
    };
    let remark = |(keys, what): &(&[&str], &str)| {
        let named: Vec<String> = keys.iter().filter(there).map(|key| format!("'{key}'")).collect();
        (!named.is_empty()).then(|| format!("{} has no effect: {what}", named.join(", ")))
    };
    WITHOUT_EFFECT.iter().filter_map(remark).collect()
}
