//! Compiles the C++ shim over OpenVDB and derives its Rust declarations from the C header. With `DOCS_RS` set, as where
//! documentation alone is built, it takes the declarations that are kept beside the header.

use std::path::{Path, PathBuf};
use std::process::{Command, exit};

const PACKAGES: &str = "libopenvdb-dev libboost-dev libclang-dev g++";

/// Parts of the shim.
const SOURCES: [&str; 9] = [
    "shim_io.cpp",
    "shim_grid.cpp",
    "shim_load.cpp",
    "shim_edit.cpp",
    "shim_box.cpp",
    "shim_dense.cpp",
    "shim_convert.cpp",
    "shim_vectors.cpp",
    "shim_mesh.cpp",
];

/// A build that lacks its libraries says what to install, not that a header is missing.
fn stop(what: &str) -> ! {
    eprintln!("cumulo: {what}\n  On Debian and Ubuntu: apt-get install {PACKAGES}");
    exit(1)
}

fn main() {
    let shim = Path::new("src/formats/vdb");
    for file in ["shim.h", "shim.hpp"].iter().chain(&SOURCES) {
        println!("cargo:rerun-if-changed={}", shim.join(file).display());
    }
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-env-changed=OPENVDB_INCLUDE_DIR");
    println!("cargo:rerun-if-env-changed=OPENVDB_LIB_DIR");

    println!("cargo:rerun-if-env-changed=DOCS_RS");
    // `cumulo --version` states them.
    let compiler = std::env::var_os("RUSTC").and_then(|rustc| Command::new(rustc).arg("--version").output().ok());
    let compiler = compiler.map(|out| String::from_utf8_lossy(&out.stdout).trim().to_owned()).unwrap_or_default();
    println!("cargo:rustc-env=CUMULO_COMPILER={compiler}");
    println!("cargo:rustc-env=CUMULO_TARGET={}", std::env::var("TARGET").unwrap_or_default());
    let out = std::env::var_os("OUT_DIR").map(PathBuf::from).unwrap_or_default().join("vdb_ffi.rs");
    if std::env::var_os("DOCS_RS").is_some() {
        // The documentation links nothing, and is built where no OpenVDB is.
        if let Err(error) = std::fs::copy(shim.join("bindings.rs"), &out) {
            stop(&format!("{}: {error}", out.display()));
        }
        return;
    }

    let mut includes: Vec<PathBuf> = vec!["/usr/include".into(), "/usr/local/include".into()];
    let own = std::env::var_os("OPENVDB_INCLUDE_DIR").map(PathBuf::from);
    includes.extend(own.clone());
    for header in ["openvdb/openvdb.h", "boost/any.hpp"] {
        if !includes.iter().any(|dir| dir.join(header).exists()) {
            stop(&format!("the header {header} was not found"));
        }
    }

    let mut build = cc::Build::new();
    // Warnings of OpenVDB's own headers are not ours to mend; never -fvisibility=hidden, which links
    // and then crashes in openvdb::initialize() as its registries get duplicated.
    build.cpp(true).std("c++17").opt_level(2).debug(false).warnings(false).flag_if_supported("-Wno-deprecated");
    build.files(SOURCES.map(|f| shim.join(f)));
    if let Some(dir) = &own {
        build.include(dir);
    }
    if let Err(error) = build.try_compile("cumulo_vdb") {
        stop(&format!("the OpenVDB shim did not compile: {error}"));
    }
    if let Some(dir) = std::env::var_os("OPENVDB_LIB_DIR") {
        println!("cargo:rustc-link-search=native={}", Path::new(&dir).display());
    }
    for library in ["openvdb", "tbb", "Imath"] {
        println!("cargo:rustc-link-lib={library}");
    }

    let header = shim.join("shim.h");
    let bindings = bindgen::Builder::default()
        .header(header.to_string_lossy())
        .allowlist_function("cumulo_vdb_.*")
        .allowlist_type("cumulo_vdb_.*")
        .allowlist_var("CUMULO_VDB_.*")
        .layout_tests(false)
        .derive_default(true)
        .generate();
    let bindings = match bindings {
        Ok(b) => b,
        Err(error) => stop(&format!("bindgen could not read {}: {error}", header.display())),
    };
    if let Err(error) = bindings.write_to_file(&out) {
        stop(&format!("{}: {error}", out.display()));
    }
}
