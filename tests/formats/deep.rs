//! Deep OpenEXR pictures: round trips, what overlapping samples show, and damaged files.

use crate::common::random::Random;
use crate::common::refusal;
use cumulo::error::Code;
use cumulo::formats::exr::deep::{self, Compression, DeepLine, DeepPicture, DeepSample, Encoding, Layout, TidyPixel};
use cumulo::formats::exr::{self, Attributes, Window};
use cumulo::formats::limits::Limits;
use std::path::{Path, PathBuf};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/exr").join(name)
}

fn uniform(random: &mut Random) -> f32 {
    random.below(1 << 20) as f32 / (1 << 20) as f32
}

/// A sample whose numbers half floats hold.
fn sample(random: &mut Random) -> DeepSample {
    let eighths = |random: &mut Random, n: usize| random.below(n) as f32 / 8.0;
    let z = 1.0 + uniform(random);
    let z_back = if random.below(3) == 0 { z } else { z + uniform(random) };
    let alpha = eighths(random, 9);
    let rgba = [alpha * eighths(random, 16), alpha * eighths(random, 16), alpha * eighths(random, 16), alpha];
    DeepSample { z, z_back, rgba }
}

fn lines(random: &mut Random, [width, height]: [usize; 2], most: usize) -> Vec<DeepLine> {
    let mut line = || {
        let mut line = DeepLine::default();
        for _ in 0..width {
            let samples: Vec<DeepSample> = (0..random.below(most + 1)).map(|_| sample(random)).collect();
            line.push(&samples);
        }
        line
    };
    (0..height).map(|_| line()).collect()
}

fn write(path: &Path, layout: &Layout, encoding: Encoding, lines: &[DeepLine]) {
    let attributes: Attributes = [("owner", "me"), ("cumulo:plan", "all")].map(|(k, v)| (k.into(), v.into())).into();
    deep::write(path, layout, &attributes, encoding, |writer| {
        lines.iter().try_for_each(|line| writer.push(line.clone()))
    })
    .unwrap();
}

fn offset_layout(size: [usize; 2]) -> Layout {
    Layout {
        display_window: Window { min: [-2, 3], size: [40, 50] },
        data_window: Window { min: [-5, 7], size },
        pixel_aspect: 2.0,
    }
}

#[test]
fn pictures_are_read_as_they_were_written() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("deep.exr");
    let mut random = Random(5);
    // More rows than are packed at a time.
    let size = [23, 70];
    for (case, most) in [(0, 5), (1, 0), (2, 40)] {
        let written = lines(&mut random, size, most);
        for compression in [Compression::None, Compression::Zips] {
            for (half, volumes, colors) in [(false, true, true), (true, true, true), (true, false, false)] {
                let encoding = Encoding { compression, half, volumes, colors };
                write(&path, &offset_layout(size), encoding, &written);
                let picture = deep::read(&path).unwrap();
                assert_eq!(picture.data_window, offset_layout(size).data_window);
                assert_eq!(picture.display_window, offset_layout(size).display_window);
                assert_eq!(picture.attributes["owner"], "me");
                let mut expected = written.clone();
                for sample in expected.iter_mut().flat_map(|line| &mut line.samples) {
                    if !volumes {
                        sample.z_back = sample.z;
                    }
                    if !colors {
                        sample.rgba[..3].fill(0.0);
                    }
                }
                assert_eq!(picture.lines, expected, "{case} {encoding:?}");
            }
        }
    }
    // The same input gives the same bytes.
    let bytes = std::fs::read(&path).unwrap();
    let written = deep::read(&path).unwrap().lines;
    let encoding = Encoding { half: true, volumes: false, colors: false, ..Encoding::default() };
    write(&path, &offset_layout(size), encoding, &written);
    assert_eq!(bytes, std::fs::read(&path).unwrap());
    assert_eq!(exr::header(&path).unwrap().pixel_aspect, 2.0);
    let limits = Limits { max_memory: 100_000 };
    refusal::is(&deep::read_within(&path, limits).unwrap_err(), Code::MemoryLimit, &["deep samples", "allowed"]);
}

/// Pictures that OpenImageIO wrote: scan lines of one sample a pixel, and tiles of up to three volumes.
#[test]
fn pictures_of_other_programs_are_read() {
    let picture = deep::read(&fixture("deep.exr")).unwrap();
    let clear = DeepSample { z: 1.0, z_back: 1.0, rgba: [0.0; 4] };
    assert_eq!(picture.lines, vec![DeepLine { counts: vec![1; 4], samples: vec![clear; 4] }; 4]);

    let tiles = deep::read(&fixture("deep_tiles.exr")).unwrap();
    assert_eq!(tiles.data_window, Window { min: [-3, 2], size: [13, 9] });
    assert_eq!(tiles.lines.len(), 9);
    for (y, x) in (0..9).flat_map(|y| (0..13).map(move |x| (y, x))) {
        let [column, row] = [x as i32 - 3, y as i32 + 2];
        let expected = (0..(column + row).rem_euclid(4)).map(|k| {
            let (alpha, z) = ((k + 1) as f32 / 4.0, (k + 1) as f32);
            let z_back = z + 0.75 + column.rem_euclid(2) as f32;
            DeepSample { z, z_back, rgba: [alpha, alpha / 2.0, alpha / 4.0, alpha] }
        });
        assert_eq!(tiles.samples(x, y), expected.collect::<Vec<_>>(), "{column} {row}");
    }
    let summary = deep::summary_within(&fixture("deep_tiles.exr"), Limits::default()).unwrap();
    assert!(summary.tiled && summary.sorted && !summary.tidy, "{summary:?}");
}

/// Rows that do not suit the picture are refused, and nothing is written.
#[test]
fn rows_that_do_not_fit_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("deep.exr");
    let sample = DeepSample { z: 1.0, z_back: 2.0, rgba: [0.5; 4] };
    let row = |samples: Vec<DeepSample>| DeepLine { counts: vec![1, 0], samples };
    let refused = |rows: Vec<DeepLine>, encoding: Encoding, words: &[&str]| {
        let error = deep::write(&path, &Layout::whole(2, 2), &Attributes::new(), encoding, |writer| {
            rows.iter().try_for_each(|row| writer.push(row.clone()))
        });
        refusal::is(&error.unwrap_err(), Code::Invalid, words);
        assert!(!path.exists());
    };
    let plain = Encoding::default();
    refused(vec![row(vec![sample])], plain, &["1 of 2 rows"]);
    refused(vec![row(vec![sample]); 3], plain, &["row 2"]);
    refused(vec![row(vec![])], plain, &["2 counts and 0 samples"]);
    refused(vec![DeepLine::default()], plain, &["0 counts"]);
    refused(vec![row(vec![DeepSample { z: f32::NAN, ..sample }])], plain, &["NaN"]);
    let bright = DeepSample { rgba: [1e6, 0.0, 0.0, 1.0], ..sample };
    refused(vec![row(vec![bright])], Encoding { half: true, ..plain }, &["65504"]);
}

fn close(found: f64, expected: f64, tolerance: f64, what: &str) {
    assert!((found - expected).abs() <= tolerance * expected.abs().max(1.0), "{what}: {found}, not {expected}");
}

fn volume(z: f32, z_back: f32, rgba: [f32; 4]) -> DeepSample {
    DeepSample { z, z_back, rgba }
}

/// Rounding of a few operations in double precision.
const ROUNDING: f64 = 1e-14;

#[test]
fn a_volume_hides_exponentially() {
    let (alpha, [z, back]) = (0.75_f32, [2.0, 6.0]);
    let tidy = TidyPixel::new(&[volume(z, back, [0.3, 0.6, 0.9, alpha])]);
    for (depth, share) in [(1.0, 0.0), (2.0, 0.0), (3.0, 0.25), (4.0, 0.5), (5.5, 0.875), (6.0, 1.0), (9.0, 1.0)] {
        let expected = 1.0 - 0.25_f64.powf(share);
        close(tidy.alpha_before(depth), expected, ROUNDING, "alpha");
        let color = tidy.color_before(depth);
        close(color[0], f64::from(0.3_f32) * expected / 0.75, ROUNDING, "color");
    }
    assert_eq!(tidy.depth(), Some(2.0));
    // Without opacity color grows with length, with full opacity all of it is at the front.
    let clear = TidyPixel::new(&[volume(0.0, 8.0, [4.0, 0.0, 0.0, 0.0])]);
    assert_eq!(clear.rgba_before(2.0), [1.0, 0.0, 0.0, 0.0]);
    assert_eq!(clear.depth(), None);
    let wall = TidyPixel::new(&[volume(1.0, 2.0, [0.5, 0.25, 0.0, 1.0]), volume(3.0, 4.0, [9.0, 9.0, 9.0, 1.0])]);
    assert_eq!(wall.rgba_before(1.25), [0.5, 0.25, 0.0, 1.0]);
    assert_eq!(wall.rgba_before(1.0), [0.0; 4]);
    assert_eq!(wall.rgba(), [0.5, 0.25, 0.0, 1.0]);
    // The opacity of thin volumes keeps its digits.
    let thin = TidyPixel::new(&[volume(0.0, 1.0, [0.0, 0.0, 0.0, 1e-20])]);
    close(thin.alpha_before(0.5) * 1e20, 0.5 * f64::from(1e-20_f32) * 1e20, ROUNDING, "thin");
    assert_eq!(TidyPixel::new(&[]).rgba(), [0.0; 4]);
}

/// "Over" in the order of depth, whatever the order in the file; points of one depth are merged, not stacked.
#[test]
fn points_are_composited_by_depth() {
    let [near, far] = [volume(1.0, 1.0, [0.25, 0.0, 0.0, 0.5]), volume(2.0, 2.0, [0.0, 1.0, 0.0, 1.0])];
    for samples in [[near, far], [far, near]] {
        let tidy = TidyPixel::new(&samples);
        assert_eq!(tidy.rgba(), [0.25, 0.5, 0.0, 1.0]);
        assert_eq!(tidy.alpha_before(1.0), 0.0);
        assert_eq!(tidy.alpha_before(1.0 + 1e-9), 0.5);
        assert_eq!(tidy.color_before(2.0), [0.25, 0.0, 0.0]);
    }
    // Two points at one depth: opacities 0.5 and 0.75 hide as 0.875, in either order.
    let other = volume(1.0, 1.0, [0.0, 0.75, 0.0, 0.75]);
    let [u, v] = [2_f64.ln(), 4_f64.ln()];
    for samples in [[near, other], [other, near]] {
        let [r, g, b, a] = TidyPixel::new(&samples).rgba();
        close(a, 0.875, ROUNDING, "alpha");
        close(r, 0.25 / 0.5 * u * 0.875 / (u + v), ROUNDING, "red");
        close(g, v * 0.875 / (u + v), ROUNDING, "green");
        assert_eq!(b, 0.0);
    }
    let opaque = [volume(1.0, 1.0, [1.0, 0.0, 0.0, 1.0]), volume(1.0, 1.0, [0.0, 1.0, 0.0, 1.0]), near];
    assert_eq!(TidyPixel::new(&opaque).rgba(), [0.5, 0.5, 0.0, 1.0]);
}

/// Cutting a volume anywhere, into pieces of the opacity and color that the format gives them, changes nothing.
#[test]
fn volumes_may_be_cut_anywhere() {
    let mut random = Random(3);
    for _ in 0..200 {
        let all: Vec<DeepSample> = (0..4).map(|_| sample(&mut random)).collect();
        let whole = TidyPixel::new(&all);
        let intervals = whole.intervals();
        for (a, b) in intervals.iter().zip(&intervals[1..]) {
            assert!(a.z_back <= b.z && a.z <= a.z_back, "{intervals:?}");
        }
        let at = 1.0 + 2.0 * f64::from(uniform(&mut random));
        let [r, g, b, alpha] = whole.rgba_before(at);
        // What is before and what is behind together show the whole.
        let behind: Vec<f64> = remainder(&whole, at).to_vec();
        let rgba = whole.rgba();
        for (c, before) in [r, g, b, alpha].into_iter().enumerate() {
            close(before + (1.0 - alpha) * behind[c], rgba[c], 1e-12, "component");
        }
    }
}

/// What is seen where something holds a pixel out is what its thin slices show, each through what stands before it.
#[test]
fn pixels_are_held_out_slice_by_slice() {
    let mut random = Random(11);
    const SLICES: u32 = 20_000;
    for number in 0..60 {
        let [own, other] = [4, 3].map(|count| {
            let all: Vec<DeepSample> = (0..count).map(|_| sample(&mut random)).collect();
            TidyPixel::new(&all)
        });
        let at = |slice: u32| 0.999 + 2.01 * f64::from(slice) / f64::from(SLICES);
        let (mut expected, mut before) = ([0.0; 4], own.rgba_before(at(0)));
        for slice in 0..SLICES {
            let behind = own.rgba_before(at(slice + 1));
            let open = 1.0 - other.alpha_before(0.5 * (at(slice) + at(slice + 1)));
            (0..4).for_each(|c| expected[c] += open * (behind[c] - before[c]));
            before = behind;
        }
        for (found, expected) in own.rgba_held_out(&other).into_iter().zip(expected) {
            close(found, expected, 1e-3, &format!("pixel {number}"));
        }
        // Nothing stands there, or all is hidden.
        for (found, expected) in own.rgba_held_out(&TidyPixel::default()).into_iter().zip(own.rgba()) {
            close(found, expected, 1e-12, "without a holdout");
        }
        let wall = |z: f32| TidyPixel::new(&[DeepSample { z, z_back: z, rgba: [0.0, 0.0, 0.0, 1.0] }]);
        assert_eq!(own.rgba_held_out(&wall(0.5)), [0.0; 4]);
        for z in [1.25_f32, 1.5, 2.0] {
            for (found, expected) in own.rgba_held_out(&wall(z)).into_iter().zip(own.rgba_before(z.into())) {
                close(found, expected, 1e-12, "before a wall");
            }
        }
    }
    // A haze of half the opacity within one of the same: closed form.
    let haze = |rgba| TidyPixel::new(&[DeepSample { z: 1.0, z_back: 2.0, rgba }]);
    let [r, .., a] = haze([0.25, 0.0, 0.0, 0.5]).rgba_held_out(&haze([0.0, 0.0, 0.0, 0.5]));
    close(a, 0.5 * 0.75, 1e-12, "alpha");
    close(r, 0.25 * 0.75, 1e-12, "red");
}

/// Color and opacity of what lies behind a depth, composited backwards.
fn remainder(pixel: &TidyPixel, at: f64) -> [f64; 4] {
    let mut rgba = [0.0; 4];
    for interval in pixel.intervals().iter().rev().filter(|i| i.z_back > at || i.z >= at) {
        let share = if interval.z >= at { 1.0 } else { (interval.z_back - at) / (interval.z_back - interval.z) };
        let alpha = 1.0 - (1.0 - interval.alpha).powf(share);
        let factor = if interval.alpha == 0.0 { share } else { alpha / interval.alpha };
        let [r, g, b] = interval.color.map(|c| c * if interval.alpha == 1.0 { 1.0 } else { factor });
        for (sum, term) in rgba.iter_mut().zip([r, g, b, alpha]) {
            *sum = term + (1.0 - alpha) * *sum;
        }
    }
    rgba
}

/// Overlapping media add up their extinction and emission: the equation of transfer, solved in steps by the midpoint
/// rule. 20000 steps of 1e-4 leave an error of the order of (extinction x step)² = 1e-6.
#[test]
fn overlapping_volumes_are_the_equation_of_transfer() {
    let mut random = Random(11);
    for _ in 0..20 {
        let volumes: Vec<DeepSample> = (0..6)
            .map(|_| {
                let [z, length, alpha] =
                    [uniform(&mut random), 0.1 + 0.9 * uniform(&mut random), 0.9 * uniform(&mut random)];
                let rgba =
                    [alpha * uniform(&mut random), alpha * uniform(&mut random), 0.1 * uniform(&mut random), alpha];
                volume(z, z + length, rgba)
            })
            .collect();
        let tidy = TidyPixel::new(&volumes);
        let (mut transmittance, mut color, step) = (1.0_f64, [0.0; 3], 1e-4);
        for k in 0..20_000 {
            let z = (k as f64 + 0.5) * step;
            let (mut extinction, mut emission) = (0.0, [0.0; 3]);
            for v in volumes.iter().filter(|v| f64::from(v.z) < z && z < f64::from(v.z_back)) {
                let alpha = f64::from(v.rgba[3]);
                let own = -(-alpha).ln_1p() / (f64::from(v.z_back) - f64::from(v.z));
                extinction += own;
                (0..3).for_each(|c| emission[c] += f64::from(v.rgba[c]) * own / alpha);
            }
            let half = (-0.5 * step * extinction).exp();
            (0..3).for_each(|c| color[c] += transmittance * half * emission[c] * step);
            transmittance *= half * half;
            if k == 9_999 {
                close(tidy.alpha_before(1.0), 1.0 - transmittance, 2e-3, "alpha before 1");
                (0..3).for_each(|c| close(tidy.color_before(1.0)[c], color[c], 2e-3, "color before 1"));
            }
        }
        let rgba = tidy.rgba();
        close(rgba[3], 1.0 - transmittance, 2e-3, "alpha");
        (0..3).for_each(|c| close(rgba[c], color[c], 2e-3, "color"));
    }
}

/// Samples of hostile numbers neither stop the program nor take its time.
#[test]
fn odd_samples_are_taken_as_they_are() {
    let odd = [f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, f32::MIN_POSITIVE, 1e-45, 3e38, -3e38, f32::NAN];
    let mut random = Random(17);
    for _ in 0..2000 {
        let mut value = || odd[random.below(odd.len())];
        let samples: Vec<DeepSample> = (0..4)
            .map(|_| {
                let [z, z_back] = [value(), value()].map(|z| if z.is_nan() { 1.0 } else { z });
                volume(z, z_back, [value(), value(), value(), value()])
            })
            .collect();
        let tidy = TidyPixel::new(&samples);
        let _ = (tidy.rgba(), tidy.rgba_before(0.5), tidy.depth());
    }
    // Backs before fronts make points; opacities are clamped.
    let inverted = TidyPixel::new(&[volume(2.0, 1.0, [0.5, 0.5, 0.5, 7.0])]);
    assert_eq!((inverted.rgba(), inverted.depth()), ([0.5, 0.5, 0.5, 1.0], Some(2.0)));
    // All overlap all: a step for each would take hours.
    let begun = std::time::Instant::now();
    let count = 200_000;
    let nested: Vec<DeepSample> =
        (0..count).map(|i| volume(i as f32, (2 * count - i) as f32, [0.0, 0.0, 0.0, 1e-6])).collect();
    let alpha = TidyPixel::new(&nested).rgba()[3];
    close(alpha, 1.0 - (1.0 - f64::from(1e-6_f32)).powi(count), 1e-9, "nested");
    assert!(begun.elapsed().as_secs() < 20, "{:?}", begun.elapsed());
}

/// Bytes of a picture, and where its first chunk stands.
fn written(dir: &Path, compression: Compression) -> (Vec<u8>, usize, DeepPicture) {
    let path = dir.join("whole.exr");
    let encoding = Encoding { compression, ..Encoding::default() };
    write(&path, &Layout::whole(8, 6), encoding, &lines(&mut Random(2), [8, 6], 4));
    let picture = deep::read(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let name = b"worldToNDC";
    assert!(!bytes.windows(name.len()).any(|w| w == name));
    // The header ends with the type and the version of deep data.
    let end = b"version\0int\0\x04\0\0\0\x01\0\0\0\0";
    let table = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
    let chunk = u64::from_le_bytes(bytes[table..table + 8].try_into().unwrap()) as usize;
    (bytes, chunk, picture)
}

#[test]
fn sizes_and_counts_that_lie_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged.exr");
    let refused = |bytes: &[u8], word: &str| {
        std::fs::write(&path, bytes).unwrap();
        let error = deep::read(&path).unwrap_err();
        assert!(error.to_string().contains(word) && error.to_string().contains("damaged.exr"), "{word}: {error}");
        refusal::is(&exr::read(&path).unwrap_err(), Code::Unsupported, &["deep"]);
    };
    let (bytes, chunk, _) = written(dir.path(), Compression::None);
    let changed = |at: usize, value: &[u8]| {
        let mut bytes = bytes.clone();
        bytes[at..at + value.len()].copy_from_slice(value);
        bytes
    };
    refused(&changed(chunk, &7_i32.to_le_bytes()), "table of chunks");
    for size in [0, 1] {
        for lie in [u64::MAX, 1 << 40, 1] {
            refused(&changed(chunk + 4 + 8 * size, &lie.to_le_bytes()), "states");
        }
    }
    // Petabytes of samples, which uncompressed bytes cannot be.
    refused(&changed(chunk + 20, &(24_u64 << 40).to_le_bytes()), "states");
    // The table of counts follows: eight totals of the row.
    refused(&changed(chunk + 28, &u32::MAX.to_le_bytes()), "counts");
    refused(&changed(chunk + 28 + 7 * 4, &u32::MAX.to_le_bytes()), "counts");
    refused(&changed(chunk + 28 + 7 * 4, &0_u32.to_le_bytes()), "counts");
    let window = b"dataWindow\0box2i\0\x10\0\0\0";
    let at = bytes.windows(window.len()).position(|w| w == window).unwrap() + window.len();
    refused(&changed(at, &(-1_000_000_i32).to_le_bytes()), "window");
    refused(&changed(at + 8, &(-9_i32).to_le_bytes()), "damaged or incomplete");
    for length in [bytes.len() - 1, chunk + 30, chunk + 5, chunk - 20, 200, 9] {
        std::fs::write(&path, &bytes[..length]).unwrap();
        assert!(deep::read(&path).is_err(), "{length}");
    }
    let (zipped, chunk, _) = written(dir.path(), Compression::Zips);
    let mut bytes = zipped.clone();
    let packed = u64::from_le_bytes(bytes[chunk + 4..chunk + 12].try_into().unwrap()) as usize;
    bytes[chunk + 28 + packed + 3] ^= 0x55;
    refused(&bytes, "unpack");
}

/// Every damaged file is read or refused, never with a panic.
#[test]
fn flipped_bytes_are_read_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged.exr");
    let mut random = Random(23);
    let wholes = [
        std::fs::read(fixture("deep_tiles.exr")).unwrap(),
        written(dir.path(), Compression::None).0,
        written(dir.path(), Compression::Zips).0,
    ];
    let (mut refused, rounds) = (0, 1500);
    for round in 0..rounds {
        let mut bytes = wholes[round % 3].clone();
        for _ in 0..1 + random.below(3) {
            let at = random.below(bytes.len());
            bytes[at] = if random.below(2) == 0 { random.next() as u8 } else { bytes[at] ^ (1 << random.below(8)) };
        }
        std::fs::write(&path, &bytes).unwrap();
        let limits = Limits { max_memory: 1 << 28 };
        refused += usize::from(deep::read_within(&path, limits).is_err());
        let _ = deep::summary_within(&path, limits);
    }
    assert!(refused > rounds / 10 && refused < rounds, "{refused} of {rounds}");
}
