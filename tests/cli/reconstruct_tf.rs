//! `cumulo reconstruct tf`: the function that pictures were made with, and how runs end.

use crate::common::work::{Work, number};
use cumulo::error::Code;
use cumulo::formats::transfer::{Options, load};
use cumulo::scene::table::Table;
use serde_json::json;

/// Two peaks with a gap between, colors of their own; plume.vdb has densities up to 1.
fn with_pictures(views: u32, size: u32) -> Work {
    let work = Work::new();
    let function = json!({"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "gaussians",
        "domain": [0.0, 1.0], "lobes": [
            {"mean": 0.25, "ln_width": -2.7, "rgbs": [0.9, 0.5, 0.1, 3.0]},
            {"mean": 0.65, "ln_width": -2.3, "rgbs": [0.1, 0.4, 0.9, 12.0]}]}});
    std::fs::write(work.path("truth.tf.json"), function.to_string()).unwrap();
    let size = format!("{size}x{size}");
    work.json(&format!(
        "render @plume.vdb --tf truth.tf.json --views {views} --size {size} --background 0.2,0.1,0.3 -o cap"
    ));
    work
}

fn table(work: &Work, name: &str) -> Table {
    load(&work.path(name), &Options::default()).unwrap().transfer.table().unwrap()
}

/// Measured: 63 dB; extinctions within 1 % of the peak.
#[test]
fn the_function_comes_back() {
    let work = with_pictures(6, 64);
    let report = work.json("reconstruct tf cap --volume @plume.vdb -o found.tf.json --texels 48 --rays 12000 --quadrature exact --report page");
    assert!(number(&report, "held_out_psnr_db") > 52.0, "{report}");
    assert!(number(&report, "held_out_ssim") > 0.999, "{report}");
    let (truth, found) = (table(&work, "truth.tf.json"), table(&work, "found.tf.json"));
    for i in 5..70 {
        let d = f64::from(i) / 100.0;
        let (t, f) = (truth.at(d), found.at(d));
        assert!((t[3] - f[3]).abs() < 0.04 * 12.0, "extinction at {d}: {t:?} {f:?}");
        // Colors mean something where there is extinction.
        let off = (0..3).fold(0.0_f64, |m, c| m.max((t[c] - f[c]).abs()));
        assert!(t[3] < 1.5 || off < 0.05, "color at {d}: {t:?} {f:?}");
    }
    let confidence = report["confidence"].as_array().unwrap();
    assert_eq!(confidence.len(), 48);
    let page = std::fs::read_to_string(work.path("page/index.html")).unwrap();
    assert!(page.contains("Extinction") && page.contains("What the pictures say") && page.contains("held out"));
}

/// The paper's recipe on the same pictures: a function like it, farther off.
#[test]
fn the_published_descent_is_there_to_compare_with() {
    let work = with_pictures(6, 48);
    let words = "reconstruct tf cap --volume @plume.vdb --texels 32 --rays 4000";
    let report = work.json(&format!("{words} --solver weiss2021 --iterations 60 --smooth 0.01 -o paper.tf.json"));
    assert_eq!((report["solver"].as_str(), report["iterations"].as_u64()), (Some("weiss2021"), Some(60)));
    let rms: Vec<f64> = report["history"].as_array().unwrap().iter().map(|s| s["rms"].as_f64().unwrap()).collect();
    assert!(rms[59] < 0.2 * rms[0], "{} {}", rms[0], rms[59]);
    let ours = work.json(&format!("{words} -o ours.tf.json"));
    let [theirs, ours] = [&report, &ours].map(|r| number(r, "held_out_psnr_db"));
    assert!(theirs > 20.0 && ours > theirs + 3.0, "{theirs} {ours}");
    let on = work.json(&format!("{words} --solver weiss2021 --iterations 5 --smooth 0.01 --resume -o paper.tf.json"));
    assert!(on["history"][0]["rms"].as_f64().unwrap() < 2.0 * rms[59], "goes on from where it was: {on}");
    assert!(number(&on, "held_out_psnr_db") > theirs - 0.3, "and is no worse: {on}");
    let smooth = work.json(&format!("{words} --solver weiss2021 --iterations 60 --smooth 50 -o smooth.tf.json"));
    assert!(number(&smooth, "held_out_psnr_db") < theirs, "{smooth}");
    let roughness = |name: &str| -> f64 {
        table(&work, name).values().windows(2).map(|pair| (pair[1][0] - pair[0][0]).powi(2)).sum()
    };
    assert!(roughness("smooth.tf.json") < 0.2 * roughness("paper.tf.json"));
}

#[test]
fn the_page_is_made_again_beside_the_truth() {
    let work = with_pictures(4, 32);
    let words = "reconstruct tf cap --volume @plume.vdb -o found.tf.json --texels 32 --quadrature exact --report page";
    work.json(words);
    let page = || std::fs::read_to_string(work.path("page/index.html")).unwrap();
    assert!(!page().contains("reference"));
    let report = work.json("report page --reference truth.tf.json --beside again=cap");
    assert!(number(&report["transfer"], "extinction_rms") < 0.05, "{report}");
    assert!(number(&report["transfer"], "color_rms") < 0.05, "{report}");
    assert!(page().contains("extinction, reference") && page().contains("again"));
    work.refused("report page --reference none.tf.json", Code::NotFound, &["none.tf.json"]);
    std::fs::remove_file(work.path("found.tf.json")).unwrap();
    work.refused("report page", Code::NotFound, &["found.tf.json"]);
}

#[test]
fn noise_calls_for_smoothness() {
    let work = with_pictures(6, 48);
    let mut state = 1_u64;
    work.edit("cap", |_, film| {
        for value in film.rgba.iter_mut().flatten() {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            *value += 0.1 * ((state >> 40) as f32 / (1_u64 << 24) as f32 - 0.5);
        }
    });
    let run = |words: &str| work.json(&format!("reconstruct tf cap --volume @plume.vdb -o found.tf.json {words}"));
    let auto = run("");
    assert!(number(&auto, "smooth") > 1e-6, "{}", auto["smooth"]);
    // Noise of 0.1/√12 alone leaves 30.8 dB.
    assert!(number(&auto, "held_out_psnr_db") > 30.0, "{auto}");
    let rough = run("--smooth 1e-9");
    assert!(number(&auto, "held_out_psnr_db") > number(&rough, "held_out_psnr_db") - 0.2, "{rough}");
}

#[test]
fn runs_are_the_same_for_any_number_of_threads_and_go_on() {
    let work = with_pictures(4, 32);
    let run = |out: &str, words: &str| {
        work.json(&format!("reconstruct tf cap --volume @plume.vdb -o {out} --texels 16 --iterations 3 {words}"));
        load(&work.path(out), &Options::default()).unwrap().transfer
    };
    let one = run("a.tf.json", "--threads 1");
    assert_eq!(one, run("b.tf.json", "--threads 3"));
    let longer =
        work.json("reconstruct tf cap --volume @plume.vdb -o c.tf.json --texels 16 --init a.tf.json --smooth 1e-6");
    assert!(number(&longer, "held_out_psnr_db") > 40.0, "{longer}");
}

#[test]
fn what_cannot_be_done_is_said() {
    let work = with_pictures(2, 16);
    work.json("render @plume.vdb --views 2 --size 16x16 -o dark");
    work.refused(
        "reconstruct tf dark --volume @plume.vdb -o x.tf.json",
        Code::Unsupported,
        &["absorption alone", "emission-absorption"],
    );
    work.refused("reconstruct tf cap --volume @none.vdb -o x.tf.json", Code::NotFound, &["none.vdb"]);
    work.refused("reconstruct tf cap --volume @plume.vdb -o nowhere/x.tf.json", Code::NotFound, &["nowhere"]);
    work.refused(
        "reconstruct tf cap --volume @plume.vdb -o x.tf.json --held-out 2",
        Code::Invalid,
        &["leaves none of the 2 views"],
    );
    work.refused("reconstruct tf cap --volume @plume.vdb -o x.tf.json --texels 1", Code::Usage, &["2..=1024"]);
    work.refused("reconstruct tf cap --volume @plume.vdb -o x.tf.json --domain 1,0", Code::Usage, &["1,0"]);
    work.edit("cap", |_, film| film.rgba.fill([f32::NAN; 4]));
    work.refused("reconstruct tf cap --volume @plume.vdb -o x.tf.json", Code::Contradiction, &["no pixel", "finite"]);
    assert!(!work.path("x.tf.json").exists());
}
