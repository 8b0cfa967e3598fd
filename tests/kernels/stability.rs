//! Hard cases, area by area: this crate's formulas stay below their bounds, and naive formulas in their place do not.

use cumulo::hard_cases::{Area, Case, Formula, Naive, cases};
use std::collections::BTreeSet;

fn check(area: Area) {
    let all: Vec<&Case> = cases().filter(|case| case.area == area).collect();
    assert!(all.len() >= 4, "{area}: {} cases", all.len());
    for case in all {
        let [error, naive] = [Formula::Cumulo, Formula::Naive].map(|formula| case.measure(formula));
        println!("{area} {}: {error:.2e} of {:.1e}, naive {naive:.2e}", case.name, case.bound);
        assert!(case.passes(error), "{}: {error:e} is above {:e}", case.name, case.bound);
        match case.naive {
            Naive::Fails(least) => {
                assert!(!case.passes(naive), "{}: the naive formula's {naive:e} passes", case.name);
                assert!(naive >= least, "{}: the naive formula's {naive:e} is below {least:e}", case.name);
            }
            Naive::Holds(_) => assert!(case.passes(naive), "{}: the naive formula's {naive:e} fails", case.name),
        }
    }
}

#[test]
fn light_along_straight_rays() {
    check(Area::Dvr);
}

#[test]
fn transfer_functions() {
    check(Area::TransferFunction);
}

#[test]
fn path_tracing() {
    check(Area::PathTracing);
}

#[test]
fn denoising() {
    check(Area::Denoising);
}

#[test]
fn reconstruction() {
    check(Area::Reconstruction);
}

#[test]
fn geometry() {
    check(Area::Geometry);
}

/// Names are those of cases alone, and figures come out the same again.
#[test]
fn cases_are_named_and_repeatable() {
    let mut names: BTreeSet<&str> = Area::ALL.map(Area::name).into();
    for case in cases() {
        let plain = case.name.chars().all(|c| c.is_ascii_lowercase() || c == '-');
        assert!(plain && names.insert(case.name), "{}", case.name);
        assert!(!matches!(case.naive, Naive::Fails(least) if least <= case.bound), "{}", case.name);
        let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let [one, three] = [1, 3].map(|threads| pool(threads).install(|| case.measure(Formula::Cumulo)));
        assert_eq!(one.to_bits(), three.to_bits(), "{}: {one:e} {three:e}", case.name);
    }
}
