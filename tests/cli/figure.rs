//! `cumulo figure`: what figures hold, in each format, and what is refused.

use crate::common::work::Work;
use cumulo::error::Code;
use cumulo::formats::{exr, picture, png};
use quick_xml::Reader;
use quick_xml::events::Event;
use serde_json::json;

/// A folder with pictures from four sides, one of them by parallel rays.
fn pictures() -> Work {
    let work = Work::new();
    work.json("render @plume.vdb --from front,left,top --density-scale auto --size 60x45 -o sides");
    work.json("render @plume.vdb --from iso --orthographic --density-scale auto --size 60x45 -o iso.exr");
    work.json("render @plume.vdb --from iso --orthographic --density-scale auto --size 60x45 -o iso.png");
    work
}

/// Elements of an SVG by name, and its texts.
fn parts(svg: &str) -> (Vec<String>, Vec<String>) {
    let (mut elements, mut texts) = (Vec::new(), Vec::new());
    let mut reader = Reader::from_str(svg);
    loop {
        match reader.read_event().unwrap() {
            Event::Start(start) | Event::Empty(start) => {
                elements.push(start.name().as_ref().to_owned());
            }
            Event::Text(text) if elements.last().is_some_and(|name| name == "text") => {
                texts.push(text.to_string());
            }
            Event::End(_) => elements.push(String::new()),
            Event::Eof => break,
            _ => {}
        }
    }
    (elements, texts.into_iter().filter(|text| !text.trim().is_empty()).collect())
}

#[test]
fn an_svg_holds_pictures_and_texts() {
    let work = pictures();
    let report = work.json(
        "figure sides/view_000.exr sides/view_001.exr sides/view_002.exr iso.exr -o f.svg --title Plume&Co \
         --label A,B,C,D --columns 2 --scale-bar --length-unit mm --orientation anatomical --tf viridis \
         --tf-range -100,300 --legend-label Density --unit HU --width 90mm",
    );
    let svg = std::fs::read_to_string(work.path("f.svg")).unwrap();
    let (elements, texts) = parts(&svg);
    let count = |name: &str| elements.iter().filter(|element| *element == name).count();
    // Four pictures, and the colors of the legend.
    assert_eq!((count("image"), svg.matches("data:image/png;base64,").count()), (5, 5));
    assert!(svg.starts_with("<svg ") && svg.contains("width=\"90mm\""), "{}", &svg[..300]);
    assert!(svg.contains("cumulo:settings=") && svg.contains("cumulo:command="));
    for text in ["A", "B", "C", "D", "Density (HU)", "−100", "0", "300"] {
        assert!(texts.iter().any(|t| t == text), "{text}: {texts:?}");
    }
    assert!(svg.contains(">Plume&amp;Co</text>"));
    // The faces that the cameras see: patient's back, left and head, and three from the corner.
    let letters: Vec<_> = texts.iter().filter(|t| ["R", "L", "A", "P", "S", "I"].contains(&t.as_str())).collect();
    assert_eq!(letters.len(), 7, "{letters:?}");
    assert_eq!(report["legend"]["ticks"], json!([-100.0, 0.0, 100.0, 200.0, 300.0]));
    assert_eq!((&report["columns"], report["panels"].as_array().map(Vec::len)), (&json!(2), Some(4)));
    assert!((report["millimetres"][0].as_f64().unwrap() - 90.0).abs() < 1e-9);
    // The same settings write it again, to the bit; other ones do not replace it.
    let words = "figure iso.exr -o g.svg --scale-bar";
    work.json(words);
    let first = std::fs::read(work.path("g.svg")).unwrap();
    work.json(words);
    assert_eq!(std::fs::read(work.path("g.svg")).unwrap(), first);
    work.refused("figure iso.exr -o g.svg", Code::OutputExists, &["g.svg", "--overwrite"]);
    work.json("figure iso.exr -o g.svg --overwrite");
}

/// Lengths of bars are those of the cameras: of parallel rays the picture's width in world units, else that at the
/// distance of the volume's middle.
#[test]
fn scale_bars_are_true() {
    let work = pictures();
    let panel = |report: &serde_json::Value| report["panels"][0].clone();
    let parallel = panel(&work.json("figure iso.exr -o a.svg --scale-bar"));
    let stated = exr::header(&work.path("iso.exr")).unwrap().attributes();
    let camera: serde_json::Value = serde_json::from_str(&stated["cumulo:camera"]).unwrap();
    let per_unit = camera["focal"][0].as_f64().unwrap();
    let bar = &parallel["scale_bar"];
    let [length, pixels] = ["length", "pixels"].map(|key| bar[key].as_f64().unwrap());
    assert!((pixels - length * per_unit).abs() < 1e-9 && pixels < 18.1 && pixels > 6.0, "{bar}");
    assert!(bar["distance"].is_null());
    let digit = length / 10_f64.powf(length.log10().floor());
    assert!([1.0, 2.0, 5.0].iter().any(|d| (d - digit).abs() < 1e-9), "{length}");
    // The standard matrices are there, sixteen numbers each.
    for name in ["worldToCamera", "worldToNDC"] {
        assert_eq!(stated[name].split(' ').count(), 16, "{name}");
    }
    // A PNG by render states its camera, too; and the capture has those of its pictures, but not what they look at.
    let of_png = panel(&work.json("figure iso.png -o b.svg --scale-bar"));
    assert_eq!(of_png["scale_bar"], parallel["scale_bar"]);
    let own = panel(&work.json("figure sides/view_001.exr -o c.svg --scale-bar"));
    let distance = own["scale_bar"]["distance"].as_f64().unwrap();
    let of_capture = panel(
        &work.json(&format!("figure sides/view_001.exr -o d.svg --scale-bar --camera sides --distance {distance}")),
    );
    assert_eq!(of_capture["scale_bar"], own["scale_bar"]);
    let by_number =
        panel(&work.json(&format!(
            "figure sides/view_002.exr -o e.svg --scale-bar=0.2 --camera sides#1 --distance {distance}"
        )));
    assert_eq!(by_number["camera"]["position"], own["camera"]["position"]);
    assert_eq!(by_number["scale_bar"]["length"], json!(0.2));
    let text = work.text("figure sides/view_001.exr -o c.svg --scale-bar");
    assert!(text.contains("true at the center"), "{text}");
    // A part of a picture in a file of its own has the scale of the whole.
    work.json(
        "render @plume.vdb --from iso --orthographic --density-scale auto --size 60x45 --crop 10,10,40,40 -o p.exr",
    );
    let part = panel(&work.json("figure p.exr -o p.svg --scale-bar"));
    assert_eq!(part["scale_bar"], parallel["scale_bar"]);
}

#[test]
fn pngs_and_pdfs_are_what_they_say() {
    let work = pictures();
    let options = "--title Plume --label A,B --scale-bar --orientation axes --tf viridis";
    let report = work.json(&format!("figure iso.exr sides/view_000.exr -o f.png --width 600px {options}"));
    assert_eq!(report["pixels"][0], json!(600));
    let header = picture::header(&work.path("f.png")).unwrap();
    assert_eq!(json!(header.size), report["pixels"]);
    assert!(png::texts(&work.path("f.png")).unwrap().contains_key("cumulo:settings"));
    work.json(&format!("figure iso.exr sides/view_000.exr -o f.pdf --width 80mm {options}"));
    let pdf = std::fs::read(work.path("f.pdf")).unwrap();
    let has = |text: &str| pdf.windows(text.len()).any(|window| window == text.as_bytes());
    assert!(pdf.starts_with(b"%PDF-1.") && pdf.ends_with(b"%%EOF"), "{}", pdf.len());
    assert!(has("/FontFile2") && has("/ToUnicode") && has("cumulo:settings="));
    assert_eq!(pdf.windows(14).filter(|w| *w == b"/Subtype /Imag").count(), 3);
    // Pages without a background, and pictures over another one than they were rendered over.
    work.json("figure iso.exr -o clear.png --background transparent");
    let film = picture::read(&work.path("clear.png"), &picture::Options::default()).unwrap().film;
    assert!(film.rgba[0][3] == 0.0 && film.rgba.iter().any(|pixel| pixel[3] > 0.9), "{:?}", film.rgba[0]);
    work.json("figure iso.exr -o black.png --background black");
    let film = picture::read(&work.path("black.png"), &picture::Options::default()).unwrap().film;
    assert_eq!(film.rgba[0], [0.0, 0.0, 0.0, 1.0], "white light behind the volume is gone");
}

#[test]
fn legends_of_captures() {
    let work = Work::new();
    work.json("render @plume.vdb --from left --tf viridis --tf-range 0,0.5 --size 32x32 -o cap");
    let report = work.json("figure cap/view_000.exr --legend --camera cap -o f.svg");
    assert_eq!(report["legend"]["range"], json!([0.0, 0.5]));
    work.json("render @plume.vdb --from left --size 32x32 -o plain");
    work.refused("figure cap/view_000.exr --legend --camera plain -o g.svg", Code::Invalid, &["--legend", "--tf"]);
    work.refused("figure cap/view_000.exr --legend -o g.svg", Code::Invalid, &["--legend", "--tf"]);
    work.refused("figure cap/view_000.exr --unit HU -o g.svg", Code::Usage, &["--unit", "--tf"]);
}

#[test]
fn what_cannot_be_drawn_is_refused() {
    let work = pictures();
    std::fs::copy(crate::common::work::fixture("exr/blender.exr"), work.path("other.exr")).unwrap();
    work.refused("figure other.exr -o f.svg --scale-bar", Code::Invalid, &["other.exr", "--camera", "--scale-bar"]);
    work.refused("figure other.exr -o f.svg --orientation axes", Code::Invalid, &["other.exr", "--camera"]);
    work.refused("figure iso.exr -o f.svg --scale-bar=1e9", Code::Invalid, &["iso.exr", "pixels"]);
    work.refused("figure iso.exr -o f.tiff", Code::OutputName, &[".svg", ".pdf", ".png"]);
    work.refused("figure iso.exr -o iso.png", Code::OutputExists, &["iso.png", "--overwrite"]);
    work.refused("figure iso.png -o iso.png --overwrite", Code::OutputIsInput, &["iso.png"]);
    work.refused("figure none.exr -o f.svg", Code::NotFound, &["none.exr"]);
    work.refused("figure iso.exr sides/view_000.exr -o f.svg --label A", Code::Usage, &["--label", "2 pictures"]);
    work.refused("figure iso.exr -o f.svg --camera sides,sides --scale-bar", Code::Usage, &["--camera", "2 cameras"]);
    work.refused("figure iso.exr -o f.svg --camera sides#7 --scale-bar", Code::Invalid, &["sides", "3 views"]);
    work.refused("figure iso.exr -o f.svg --camera sides --scale-bar", Code::Invalid, &["sides", "iso.exr"]);
    work.refused("figure sides/view_000.exr -o f.svg --camera sides --scale-bar", Code::Invalid, &["--distance"]);
    work.refused("figure iso.exr -o f.svg --width 5", Code::Usage, &["85mm"]);
    work.refused("figure iso.exr -o f.svg --width 3mm", Code::Invalid, &["--width", "--font-size"]);
    work.refused("figure iso.exr -o f.svg --font-size 999", Code::Usage, &["--font-size"]);
    work.refused("figure iso.exr -o f.png --width 5000mm --max-memory 200MiB", Code::MemoryLimit, &["--width"]);
    work.refused("figure iso.exr -o f.svg --distance 3", Code::Usage, &["--scale-bar"]);
    work.refused("figure iso.exr -o f.svg --tf none.tf.json", Code::NotFound, &["none.tf.json"]);
}
