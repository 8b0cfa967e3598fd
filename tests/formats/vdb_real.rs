//! Files from Houdini, Bifrost and others, where a folder of them is at hand.

use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::{File, NativeGrid, helper, write_native};
use std::collections::BTreeMap;

#[test]
#[ignore = "needs a folder of VDB files in CUMULO_REAL_DATA"]
fn every_real_file_opens_and_passes_through_or_is_refused_with_a_hint() {
    helper::set_program(env!("CARGO_BIN_EXE_cumulo").into());
    let folder = std::env::var("CUMULO_REAL_DATA").expect("CUMULO_REAL_DATA names a folder");
    let mut seen = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let is = |e: &str| path.extension().is_some_and(|x| x == e);
        if is("nvdb") {
            let text = File::open(&path, Limits::default()).unwrap_err().to_string();
            assert!(text.contains("NanoVDB") && text.contains("cumulo convert"), "{text}");
        } else if is("vdb") {
            let file = File::open(&path, Limits::default()).unwrap();
            let grids: Vec<NativeGrid> = file.entries().iter().map(|e| file.read(&e.name).unwrap()).collect();
            let dir = tempfile::tempdir().unwrap();
            let copy = dir.path().join("copy.vdb");
            write_native(&copy, &grids.iter().collect::<Vec<_>>(), Some(&file), &BTreeMap::new(), Default::default())
                .unwrap();
            let back = File::open(&copy, Limits::default()).unwrap();
            assert_eq!(back.metadata().unwrap(), file.metadata().unwrap());
            for (a, b) in file.entries().iter().zip(back.entries()) {
                let (a, b) = (file.read(&a.name).unwrap(), back.read(&b.name).unwrap());
                let (ai, bi) = (a.info().unwrap(), b.info().unwrap());
                assert_eq!(ai, bi, "{}", path.display());
                if ai.components == 1 {
                    assert_eq!(a.to_raw().unwrap(), b.to_raw().unwrap());
                }
                // Points carry attributes beyond their topology; every other grid is bounded by it.
                let entry = back.find(b.name()).unwrap();
                let estimate = entry.topology.filter(|_| entry.fully_checked).map_or(u64::MAX, |t| t.memory);
                assert!(bi.memory <= estimate, "{}: {} > {estimate}", path.display(), bi.memory);
            }
        } else {
            continue;
        }
        seen += 1;
    }
    assert!(seen > 0, "no .vdb or .nvdb file in the folder");
}
