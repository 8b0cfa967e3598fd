//! The report: one file, nothing from outside, whatever the names are.

use base64::Engine;
use cumulo::math::Affine;
use cumulo::report::{CompanionVolume, MOST_SLICES, Page, Plot, Series, Thumbnail, ViewRow};
use cumulo::scene::bricks::{BRICK, Bricks, EDGE, Topology};
use cumulo::scene::film::Film;
use glam::{DMat4, DVec3, IVec3};
use sha2::{Digest, Sha256};
use std::sync::Arc;

const HOSTILE: &str = r#"</title><script>alert("1")</script><img src='x' onerror=a> & 'b' "c""#;

/// A ball of radius 11 voxels around (20, 16, 12) in 40 x 32 x 24 voxels, denser towards its middle.
fn ball(transform: Affine, density: f64) -> Bricks<f32> {
    let cells = (0..5).flat_map(|x| (0..4).flat_map(move |y| (0..3).map(move |z| IVec3::new(x, y, z))));
    let topology = Arc::new(Topology::new(cells).unwrap());
    let mut field = Bricks::zeros(topology.clone(), transform);
    for (brick, values) in topology.bricks().iter().zip(field.values.chunks_exact_mut(BRICK)) {
        for (i, v) in values.iter_mut().enumerate() {
            let at = 8 * *brick + IVec3::new((i / EDGE / EDGE) as i32, (i / EDGE % EDGE) as i32, (i % EDGE) as i32);
            let r = (at.as_dvec3() - DVec3::new(20.0, 16.0, 12.0)).length() / 11.0;
            *v = (density * (1.0 - r * r).max(0.0)) as f32;
        }
    }
    field
}

/// A white picture with a soft dark spot.
fn spot(width: usize, height: usize, x: f64, depth: f64) -> Film {
    let mut film = Film::new(width, height);
    for (i, p) in film.rgba.iter_mut().enumerate() {
        let (u, v) = ((i % width) as f64 / width as f64, (i / width) as f64 / height as f64);
        let t = (-depth * (-((u - x).powi(2) + (v - 0.5).powi(2)) / 0.03).exp()).exp() as f32;
        *p = [t, t, t, 1.0 - t];
    }
    film
}

fn rows(count: usize, name: impl Fn(usize) -> String) -> Vec<ViewRow> {
    let row = |i: usize| {
        let x = 0.3 + 0.4 * i as f64 / count as f64;
        let extra = i.is_multiple_of(2).then(|| ("Cycles".to_string(), spot(96, 96, x, 2.5)));
        ViewRow {
            name: name(i),
            picture: spot(96, 96, x, 3.0),
            render: spot(96, 96, x + 0.002, 3.0),
            extra,
            held_out: i == 3,
            psnr_db: (i != 2).then_some(51.25 + i as f64),
            note: if i == 3 { "the view that decides when to stop".into() } else { String::new() },
        }
    };
    (0..count).map(row).collect()
}

/// Steps from a coarse level to the finest: (seconds, PSNR, level).
fn steps() -> Vec<(f64, Option<f64>, u32)> {
    let mut all = Vec::new();
    let (mut seconds, mut psnr) = (0.0, 18.0);
    for (level, cost, goal) in [(3, 0.04, 33.0), (2, 0.2, 40.0), (1, 0.9, 47.0), (0, 3.5, 55.0)] {
        for _ in 0..8 {
            seconds += cost;
            psnr += (goal - psnr) * 0.4;
            all.push((seconds, Some(psnr), level));
        }
    }
    all
}

/// A page with every kind of section.
fn example(name: impl Fn(usize) -> String) -> Page {
    let transform = Affine::uniform(0.1, DVec3::new(5.0, 0.0, -2.0)).unwrap();
    let mut page = Page::new("Density of gaffer_smoke", "64 views of 256 x 256 pixels, reconstructed in 37.2 s.");
    page.figures(&[
        ("Held-out views", "52.31 dB"),
        ("Used views", "53.04 dB"),
        ("Time", "37.2 s"),
        ("Memory", "612 MiB"),
    ])
    .views("Views", &rows(12, name), 64)
    .unwrap()
    .slices("Slices", "density", &ball(transform, 2.0), Some(&ball(transform, 2.02)))
    .unwrap()
    .plot("Convergence", &Plot::convergence(steps()))
    .unwrap()
    .stages(&[("read pictures", 0.8), ("visual hull", 1.4), ("level 2", 2.9), ("finest level", 30.1), ("write", 0.3)])
    .provenance(&[("Version", "0.1.0"), ("Command", "cumulo reconstruct density views -o out.vdb --report report")]);
    page
}

/// The tags of a page, `<` to `>`, with quotes respected. Panics on what no writer of HTML would leave: a
/// quote that does not end, or a `<` inside a tag.
fn tags(html: &str) -> Vec<&str> {
    let mut tags = Vec::new();
    let mut rest = html;
    while let Some(start) = rest.find('<') {
        let mut quoted = false;
        let end = rest[start..]
            .char_indices()
            .find_map(|(i, c)| {
                quoted ^= c == '"';
                assert!(quoted || i == 0 || c != '<', "'<' inside a tag: {}", &rest[start..][..i]);
                (!quoted && c == '>').then_some(i)
            })
            .expect("a tag that does not end");
        tags.push(&rest[start..=start + end]);
        rest = &rest[start + end + 1..];
    }
    tags
}

fn name_of(tag: &str) -> &str {
    tag.trim_start_matches(['<', '/']).split([' ', '>', '/', '\n']).next().unwrap()
}

fn attribute<'a>(tag: &'a str, name: &str) -> Option<&'a str> {
    let start = tag.find(&format!(" {name}=\""))? + name.len() + 3;
    tag[start..].split('"').next()
}

/// Every tag that is opened is closed, in order; every picture has a text and lies in the page.
fn check(html: &str) {
    const VOID: [&str; 5] = ["!DOCTYPE", "meta", "link", "img", "input"];
    let mut open = Vec::new();
    for tag in tags(html) {
        let name = name_of(tag);
        if tag.starts_with("</") {
            assert_eq!(open.pop(), Some(name), "closed out of order");
        } else if !VOID.contains(&name) && !tag.ends_with("/>") {
            open.push(name);
        }
        // The page's own script has no attribute; its hash is in the policy.
        assert!(name != "script" || tag == "<script>" || tag == "</script>", "{tag}");
        assert!(!tag.contains("onerror=a>"), "{tag}");
        if name == "img" {
            assert!(attribute(tag, "alt").is_some_and(|a| !a.is_empty()), "no alt: {}", &tag[tag.len() - 80..]);
        }
        for address in ["src", "href", "xlink:href"].iter().filter_map(|a| attribute(tag, a)) {
            assert!(address.starts_with("data:"), "{tag}");
        }
    }
    assert!(open.is_empty(), "left open: {open:?}");
    assert_eq!(tags(html).iter().filter(|t| name_of(t) == "script").count(), 2, "one script, opened and closed");
    for outside in ["http:", "https:", "file:", "url(", "@import", "//"] {
        // A PNG in base 64 may hold two slashes.
        let text = html.split("base64,").map(|part| part.split_once('"').map_or(part, |p| p.1));
        assert!(!text.clone().any(|t| t.contains(outside)), "{outside} in the page");
    }
}

/// The embedded pictures: width, height, RGB.
fn pictures(html: &str) -> Vec<(u32, u32, Vec<u8>)> {
    let sources = tags(html).into_iter().filter(|t| name_of(t) == "img").filter_map(|t| attribute(t, "src"));
    let decode = |source: &str| {
        let data = source.strip_prefix("data:image/png;base64,").unwrap();
        let bytes = base64::engine::general_purpose::STANDARD.decode(data).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut rgb).unwrap();
        (info.width, info.height, rgb)
    };
    sources.map(decode).collect()
}

#[test]
fn the_page_is_written_whole_and_alone() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("new/report");
    let path = example(|i| format!("view_{i:03}")).write(&folder).unwrap();
    assert_eq!(path, folder.join("index.html"));
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1);
    let html = std::fs::read_to_string(path).unwrap();
    check(&html);
    // Eight views with three pictures, four of them with a fourth, three rows of three slices, three bars.
    // Rows 3, 0, 1, 4, 6, 7, 9, 11 of 12 are shown; 0, 4 and 6 are even.
    assert_eq!(pictures(&html).len(), 8 * 3 + 3 + 9 + 3);
    for word in ["8 of 64 views", "held out", "view_003", "54.25 dB", "finest level", "30.10 s", "84.8 %"] {
        assert!(html.contains(word), "{word}");
    }
    assert!(!html.contains("view_002"), "more views than fit");
}

#[test]
fn hostile_names_stay_text() {
    let mut page = Page::new(HOSTILE, HOSTILE);
    let mut views = rows(2, |_| HOSTILE.into());
    views[0].note = HOSTILE.into();
    views[0].extra = Some((HOSTILE.into(), spot(4, 4, 0.5, 1.0)));
    let volume = ball(Affine::uniform(1.0, DVec3::ZERO).unwrap(), 1.0);
    let series = vec![Series { label: HOSTILE.into(), points: vec![(0.0, 1.0), (1.0, 2.0)], dashed: true }];
    page.figures(&[(HOSTILE, HOSTILE)]).views(HOSTILE, &views, 2).unwrap();
    page.slices(HOSTILE, HOSTILE, &volume, Some(&volume)).unwrap();
    page.plot(HOSTILE, &Plot { x: HOSTILE.into(), y: HOSTILE.into(), series }).unwrap();
    page.stages(&[(HOSTILE, 1.0)]).provenance(&[(HOSTILE, HOSTILE)]);
    check(&page.html());
}

#[test]
fn pictures_show_what_they_were_given() {
    let mut row = rows(1, |_| "one".into()).remove(0);
    row.extra = None;
    (row.picture, row.render) = (Film::new(1025, 2), Film::new(1025, 2));
    // One pixel of blocks of three: its mean darkens in the picture, its largest stays in the difference.
    row.picture.rgba[4] = [1.0; 4];
    let mut page = Page::new("t", "s");
    page.views("Views", &[row], 1).unwrap();
    let all = pictures(&page.html());
    let (given, difference) = (&all[1], &all[3]);
    assert_eq!((given.0, given.1), (342, 1));
    // A sixth of white is 0.1667 linear, sRGB 0.4452, byte 113.5; f32 may round to either side.
    assert!((113..=114).contains(&given.2[3]), "{}", given.2[3]);
    assert_eq!(difference.2[3..6], [254, 242, 175]);
    assert_eq!(difference.2[..3], [7, 7, 17]);
}

#[test]
fn views_of_two_sizes_are_refused_by_name() {
    let mut all = rows(2, |i| format!("view_{i}"));
    all[1].render = Film::new(95, 96);
    let fault = Page::new("t", "s").views("Views", &all, 2).unwrap_err().to_string();
    assert!(fault.contains("view_1") && fault.contains("95 x 96"), "{fault}");
    all[1].picture = Film::new(0, 0);
    all[1].render = Film::new(0, 0);
    let fault = Page::new("t", "s").views("Views", &all, 2).unwrap_err().to_string();
    assert!(fault.contains("view_1"), "{fault}");
}

#[test]
fn slices_lie_on_voxels_and_the_reference_at_the_same_place() {
    // The reference has the same values on a lattice that is turned by half a turn about y and moved, so
    // that only a look-up by world position finds them.
    let turn = DMat4::from_rotation_y(std::f64::consts::PI);
    let lattice = Affine::uniform(0.5, DVec3::ZERO).unwrap();
    let volume = ball(lattice, 1.0);
    let moved = DMat4::from_translation(DVec3::new(20.0, 0.0, 12.0)) * turn * lattice.matrix();
    let turned = ball(Affine::new(moved).unwrap(), 1.0);
    let mut page = Page::new("t", "s");
    page.slices("Slices", "density", &volume, Some(&turned)).unwrap();
    let html = page.html();
    for place in ["z = 12", "y = 16", "x = 20"] {
        assert!(html.contains(place), "{place}");
    }
    let all = pictures(&html);
    // Two bars, then rows of volume, reference, difference. Non-zero voxels: 21 along each axis.
    let (width, height, rgb) = &all[2];
    assert_eq!((*width, *height), (21, 21));
    assert_eq!(rgb[3 * (10 * 21 + 10)], 255, "the middle is the densest");
    // r² = 5² / 11², so (1 - 25/121) · 255 = 202.3, up and to the right alike.
    assert_eq!((rgb[3 * (5 * 21 + 10)], rgb[3 * (10 * 21 + 15)]), (202, 202));
    for row in 0..3 {
        let (own, theirs) = (&all[2 + 3 * row].2, &all[3 + 3 * row].2);
        // Positions agree to rounding, bytes to one.
        let apart = own.iter().zip(theirs).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(apart <= Some(1), "row {row}: {apart:?}");
    }
    let bare = Bricks::zeros(volume.topology.clone(), lattice);
    let mut page = Page::new("t", "s");
    page.slices("Slices", "density", &bare, None).unwrap();
    assert!(page.html().contains("Zero everywhere"));
}

#[test]
fn the_plot_has_its_series() {
    let plot = Plot::convergence(steps());
    let labels: Vec<&str> = plot.series.iter().map(|s| s.label.as_str()).collect();
    assert_eq!(labels, ["level 3", "level 2", "level 1", "finest level"]);
    // A level goes on where the one before it ended.
    assert_eq!(plot.series[0].points.last(), plot.series[1].points.first());
    assert_eq!(plot.series.iter().map(|s| s.points.len()).collect::<Vec<_>>(), [8, 9, 9, 9]);
    let mut page = Page::new("t", "s");
    page.plot("Convergence", &plot).unwrap();
    let html = page.html();
    check(&html);
    let svg = &html[html.find("<svg").unwrap()..html.find("</svg>").unwrap()];
    for color in ["#1F5FBF", "#C25500", "#0B7A5E", "#A02B8C"] {
        let line = format!("stroke=\"{color}\"");
        assert!(tags(svg).iter().any(|t| name_of(t) == "polyline" && t.contains(&line)), "{color}");
    }
    assert_eq!(tags(svg).iter().filter(|t| name_of(t) == "circle").count(), 8 + 9 + 9 + 9);
    assert!(svg.contains("PSNR of held-out views (dB)") && svg.contains("seconds"));
}

#[test]
fn empty_and_odd_histories_are_no_fault() {
    let odd = [vec![], vec![(0.5, None, 0)], vec![(0.5, Some(f64::INFINITY), 0)]];
    for history in odd {
        let mut page = Page::new("t", "s");
        page.plot("Convergence", &Plot::convergence(history)).unwrap();
        assert!(page.html().contains("no points"));
    }
    let series = |points: Vec<(f64, f64)>| Plot {
        x: "x".into(),
        y: "y".into(),
        series: vec![
            Series { label: "one".into(), points: points.clone(), dashed: false },
            Series { label: "two".into(), points, dashed: true },
        ],
    };
    let plots = [
        vec![(0.0, 0.0)],
        vec![(1e300, -1e300), (f64::NAN, 1.0), (-1e300, 1e300)],
        vec![(1.0, 40.0), (2.0, 40.0)],
        vec![(-3.0, 1e-310), (2.0, 0.0)],
        vec![(1e17, 1.0), (1e17, 2.0)],
        vec![(f64::MAX, f64::MIN), (f64::MIN, f64::MAX)],
    ];
    for points in plots {
        let mut page = Page::new("t", "s");
        page.plot("Plot", &series(points)).unwrap();
        check(&page.html());
    }
    let none: [(&str, f64); 0] = [];
    let mut page = Page::new("t", "s");
    page.views("Views", &[], 0).unwrap().stages(&none).stages(&[("a", 0.0), ("b", f64::NAN), ("c", -1.0)]);
    check(&page.html());
}

/// The only script that runs is the one that the page was written with: the policy has its hash.
#[test]
fn the_policy_names_the_script_by_its_hash() {
    let html = Page::new("t", "s").html();
    let script = html.split("<script>").nth(1).unwrap().split("</script>").next().unwrap();
    let hash = base64::engine::general_purpose::STANDARD.encode(Sha256::digest(script.as_bytes()));
    let policy = format!("default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{hash}'");
    assert!(html.contains(&policy), "{policy}");
}

#[test]
fn warnings_are_a_banner_above_all_sections() {
    let mut page = Page::new("t", "s");
    page.figures(&[("Time", "1 s")]).warnings(&[("Pictures contradict each other.", "Check their exposure.")]);
    let html = page.html();
    check(&html);
    let banner = html.find("id=\"warnings\"").unwrap();
    assert!(banner < html.find("<section").unwrap() && html.contains("A warning"));
    assert!(html.contains("Pictures contradict each other.") && html.contains("Check their exposure."));
    let none: [(&str, &str); 0] = [];
    assert!(!Page::new("t", "s").warnings(&none).html().contains("id=\"warnings\""));
}

/// Slices of a slider in the page: data of a pane's slices along an axis, by the text of their `alt`.
fn slices<'a>(html: &'a str, label: &str, axis: &str) -> Vec<&'a str> {
    let alt = format!("{label}, slice at {axis} = ");
    let is = |tag: &&str| name_of(tag) == "img" && attribute(tag, "alt").is_some_and(|a| a.starts_with(&alt));
    tags(html).into_iter().filter(is).filter(|tag| attribute(tag, "data-slice").is_some()).collect()
}

#[test]
fn sliders_have_every_slice_of_every_quantity_and_show_one_without_a_script() {
    let lattice = Affine::uniform(0.5, DVec3::ZERO).unwrap();
    let (volume, reference) = (ball(lattice, 1.0), ball(lattice, 1.1));
    let beside = [CompanionVolume { label: "confidence", volume: &reference, top: Some(1.0) }];
    let mut page = Page::new("t", "s");
    page.browse("Slice by slice", "density", &volume, Some(&reference), &beside).unwrap();
    let html = page.html();
    check(&html);
    // The ball has 21 voxels that are not zero along each axis; its middle is at (20, 16, 12).
    for (axis, middle) in [("x", 20), ("y", 16), ("z", 12)] {
        assert!(html.contains(&format!("id=\"browse-{axis}\" data-slices=\"21\"")), "{axis}");
        for label in ["density", "reference", "difference", "confidence"] {
            let all = slices(&html, label, axis);
            assert_eq!(all.len(), 21, "{label} along {axis}");
            let shown: Vec<_> = all.iter().filter(|tag| !tag.contains(" hidden")).collect();
            assert_eq!(shown.len(), 1, "one slice is shown without a script");
            assert_eq!(attribute(shown[0], "data-place"), Some(&format!("{axis} = {middle}")[..]));
        }
    }
    // The slider is hidden until the script finds it, and says which slices there are.
    assert_eq!(html.matches("class=\"control\" hidden").count(), 3);
    assert_eq!(html.matches("max=\"20\"").count(), 3);
    let bare = Bricks::zeros(volume.topology.clone(), lattice);
    let mut page = Page::new("t", "s");
    page.browse("Slices", "density", &bare, None, &[]).unwrap();
    assert!(page.html().contains("Zero everywhere"));
}

#[test]
fn long_volumes_have_a_bound_number_of_slices() {
    let bricks = (0..20).map(|x| IVec3::new(x, 0, 0));
    let topology = Arc::new(Topology::new(bricks).unwrap());
    let mut volume = Bricks::zeros(topology, Affine::uniform(1.0, DVec3::ZERO).unwrap());
    let owned: Vec<f32> = (0..20 * 512).map(|i| 1.0 + (i as f32 * 12.9898).sin()).collect();
    let topology = volume.topology.clone();
    topology.fill_apron(&owned, &mut volume.values);
    let mut page = Page::new("t", "s");
    page.browse("Slice by slice", "density", &volume, None, &[]).unwrap();
    let html = page.html();
    // 160 voxels along x, of which 64 slices are shown, the first and the last among them.
    let along_x = slices(&html, "density", "x");
    assert_eq!(along_x.len(), MOST_SLICES);
    let places: Vec<_> = [0, MOST_SLICES - 1].map(|i| attribute(along_x[i], "data-place").unwrap()).to_vec();
    assert_eq!(places, ["x = 0", "x = 159"]);
    // Slices along z are reduced to 96 pixels; one byte a pixel, and a third more in base 64, with a PNG's frame.
    let along_z = slices(&html, "density", "z");
    assert_eq!((along_z.len(), attribute(along_z[0], "width")), (8, Some("96")));
    assert!(attribute(along_z[0], "src").unwrap().len() < (96 * 5 + 200) * 4 / 3);
}

#[test]
fn histograms_count_voxels_and_dash_the_reference() {
    let lattice = Affine::uniform(0.5, DVec3::ZERO).unwrap();
    let (volume, reference) = (ball(lattice, 1.0), ball(lattice, 0.5));
    let mut page = Page::new("t", "s");
    page.histogram("Histogram of densities", "density", &volume, Some(&reference)).unwrap();
    let html = page.html();
    check(&html);
    assert!(html.contains("Histogram of densities") && html.contains("reference") && html.contains("swatch c1 dashed"));
    // Windows of two widths have a drawing each, which scale with the window.
    assert_eq!((html.matches("<svg").count(), html.matches("viewBox").count()), (2, 2));
    assert!(html.contains("wide-only") && html.contains("narrow-only"));
    let bare = Bricks::zeros(volume.topology.clone(), lattice);
    let mut page = Page::new("t", "s");
    page.histogram("Histogram of densities", "density", &bare, None).unwrap();
    assert!(!page.html().contains("Histogram of densities"), "nothing to count");
}

#[test]
fn thumbnails_and_wipes_show_their_pictures() {
    let mut page = Page::new("t", "s");
    let film = spot(192, 96, 0.4, 2.0);
    let all: Vec<Thumbnail> = (0..3).map(|i| Thumbnail::new(format!("view_{i}"), &film, i == 1)).collect();
    page.thumbnails("Cameras", &all, 40).unwrap().wipe("A wipe", ["a", "b"], [&film, &film]).unwrap();
    let html = page.html();
    check(&html);
    let found = pictures(&html);
    assert_eq!(found.len(), 3 + 2);
    assert_eq!((found[0].0, found[0].1), (96, 48), "thumbnails are reduced");
    assert!(html.contains("3 of 40 views") && html.contains("held out"));
    // A wipe of its own shows both halves without a script; that of a table of views waits for the script.
    assert!(html.contains("<figure class=\"wipe\"><div class=\"frame\"><img"));
    let mut page = Page::new("t", "s");
    page.views("Views", &rows(3, |i| format!("view_{i}")), 3).unwrap();
    let html = page.html();
    check(&html);
    assert!(html.contains("<figure class=\"wipe\" hidden>") && html.matches("<option>").count() == 3);
}
