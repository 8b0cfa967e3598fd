//! What the parts cost. `cargo bench --bench kernels` prints a table; `python/bench.py` asks for
//! `-- --json FILE --vdb VOLUME PEER FOLDER` and puts the rows beside those of whole reconstructions. `-- --paths` compares
//! the specialised kernels of path tracing with the one that serves any scene, `-- --denoise` is about denoisers.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a bench stops at the first fault and prints its figures")]

mod denoise;
mod dvr;
#[allow(dead_code, reason = "the tests use the rest")]
#[path = "../common/fields.rs"]
mod fields;
mod paths;
mod rays;
mod row;
mod turns;
mod vdb;

use std::path::Path;

fn main() {
    // `cargo bench` appends `--bench`.
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let after = |name: &str| arguments.iter().position(|a| a == name).map(|i| &arguments[i + 1..]);
    if let Some([input, output, ..]) = after(vdb::OWN_SIDE) {
        return vdb::own_side(Path::new(input), Path::new(output));
    }
    let threads = |text: &String| text.parse().unwrap();
    if let Some([volume, count, folder, shape, ..]) = after(dvr::PICTURES) {
        let shape: [f64; 3] = serde_json::from_str(shape).unwrap();
        return dvr::pictures(Path::new(volume), threads(count), Path::new(folder), shape.into());
    }
    if let Some([volume, count, rule, pixels, ..]) = after(dvr::GRADIENT) {
        return dvr::gradient(Path::new(volume), threads(count), rule.parse().unwrap(), pixels.parse().unwrap());
    }
    if after(paths::PATHS).is_some() {
        return print!("{}", row::table(&paths::rows()));
    }
    if after(denoise::DENOISE).is_some() {
        return print!("{}", row::table(&denoise::rows()));
    }
    let mut rows = rays::rows();
    if let Some([volume, peer, folder, ..]) = after("--vdb") {
        rows.extend(vdb::rows(Path::new(volume), Path::new(peer), Path::new(folder)));
    }
    match after("--json") {
        Some([path, ..]) => std::fs::write(path, serde_json::to_string_pretty(&rows).unwrap()).unwrap(),
        _ => print!("{}", row::table(&rows)),
    }
}
