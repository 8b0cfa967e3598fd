//! Contradictions of the pixels with what a capture states, and with each other.

use super::{Emission, Finding};
use crate::inverse::observation::photo::Photo;
use crate::scene::capture::{Capture, EmissionModel, Model};

/// Difference of two colors that roundings of half-precision files and denoisers leave, absolute and relative.
const SAME: [f64; 2] = [0.01, 0.02];
/// Alpha below which a pixel is transparent.
const TRANSPARENT: f32 = 2e-6;
/// Radiance beyond which a sample is no light of a picture.
const BRIGHTEST: f32 = 1e20;

/// Colors and counts of one picture, which are compared with the capture and with those of other pictures.
#[derive(Debug, Clone)]
pub struct PictureFacts {
    name: String,
    pixels: usize,
    /// Pixels that are finite.
    finite: usize,
    range: Option<Finding>,
    /// True if alpha says something: it is not 1 everywhere.
    has_alpha: bool,
    /// Number of pixels of alpha 0, and the colors of some of them.
    transparent: usize,
    behind: Vec<[f32; 3]>,
    /// Colors of the outermost pixels.
    border: Vec<[f32; 3]>,
    emitted: Emitted,
    /// Pixels of colors that a grey medium cannot have.
    impossible: usize,
    /// Samples, those that lie on steps of eight bits, and those of them that are neither black nor bright.
    steps: [usize; 3],
}

/// Colors of pixels of alpha 0 that one picture keeps, about.
const BEHIND: usize = 1 << 16;

impl PictureFacts {
    /// Gathers them. `emission` tells whether the pictures must show the one that the capture states.
    pub fn new(photo: &Photo, capture: &Capture, emission: Emission) -> Self {
        let background = capture.background.map(f64::from);
        let color = |p: &[f32; 4]| [p[0], p[1], p[2]];
        let transparent = || finite(photo).filter(|p| p[3].abs() < TRANSPARENT);
        let count = transparent().count();
        let (w, h) = (photo.film.width, photo.film.height);
        let outer = |i: &usize| [0, w - 1].contains(&(i % w)) || [0, h - 1].contains(&(i / w));
        let outermost = (0..w * h).filter(outer).map(|i| &photo.film.rgba[i]);
        let is_impossible = |source: [f64; 3], p: &[f32; 4]| {
            let (off, transmittance) = between(color(p).map(f64::from), source, background);
            off > 0.1 || !(-0.1..=1.1).contains(&transmittance)
        };
        let source = grey(capture).filter(|_| emission == Emission::Stated);
        Self {
            name: photo.name.clone(),
            pixels: photo.film.rgba.len(),
            finite: finite(photo).count(),
            range: range(photo),
            has_alpha: finite(photo).any(|p| p[3] != 1.0),
            transparent: count,
            behind: transparent().step_by(count.div_ceil(BEHIND).max(1)).map(color).collect(),
            border: outermost.filter(|p| p.iter().all(|v| v.is_finite())).map(color).collect(),
            emitted: Emitted::of(photo, background),
            impossible: source.map_or(0, |source| finite(photo).filter(|p| is_impossible(source, p)).count()),
            steps: steps(photo),
        }
    }
}

/// Contradictions of the pictures' pixels with the capture and with each other. `emission` tells whether they must show
/// the one that the capture states.
pub(crate) fn pictures(all: &[PictureFacts], capture: &Capture, emission: Emission) -> Vec<Finding> {
    if let Some(first) = all.first().filter(|_| all.iter().all(|picture| picture.finite == 0)) {
        return vec![Finding::certain(
            Some(&first.name),
            "no pixel of this or any other picture has finite values: all are NaN or infinite",
            "render the views again; `cumulo validate` says which samples are not finite",
        )];
    }
    let mut findings: Vec<Finding> = all.iter().filter_map(|picture| picture.range.clone()).collect();
    findings.sort_by_key(|f| !f.certain);
    // One picture speaks for all that are alike.
    findings.truncate(1);
    if findings.iter().any(|f| f.certain) {
        return findings;
    }
    let source = grey(capture).filter(|_| emission == Emission::Stated);
    let background = background_color(all, capture, source);
    // What alpha and colors imply rests on the background.
    let sound = background.iter().all(|f| !f.certain);
    let opacity = source.filter(|_| sound).and_then(|source| opacity(all, capture, source));
    findings.extend(background);
    findings.extend(opacity);
    findings.extend(quantised(all));
    findings
}

/// Values that no light has.
fn range(photo: &Photo) -> Option<Finding> {
    let name = Some(photo.name.as_str());
    let finite: Vec<&[f32; 4]> = photo.film.rgba.iter().filter(|p| p.iter().all(|v| v.is_finite())).collect();
    let all = photo.film.rgba.len();
    if finite.is_empty() {
        return Some(Finding::doubtful(
            name,
            format!("all of {all} pixels are NaN or infinite: the view says nothing"),
            "render the view again, or take it out of the capture",
        ));
    }
    if let Some(pixel) = finite.iter().find(|p| p[..3].iter().any(|v| v.abs() > BRIGHTEST)) {
        return Some(Finding::certain(
            name,
            format!("a pixel has the radiance {:e}; scene-linear radiance is expected", pixel[0]),
            "check that the layer holds colors, and choose it with ⟨layer⟩",
        ));
    }
    let (mut negative, mut sum) = (0.0_f64, 0.0_f64);
    for value in finite.iter().flat_map(|p| &p[..3]) {
        sum += f64::from(value.abs());
        negative += f64::from(value.min(0.0).abs());
    }
    if negative > 0.5 * sum {
        return Some(Finding::certain(
            name,
            format!("the radiance is negative: {:.0} % of all of it", 100.0 * negative / sum),
            "check that the layer holds colors (no depth, vector or difference), and choose it with ⟨layer⟩",
        ));
    }
    let outliers = finite.iter().filter(|p| p[3] < -0.01 || p[3] > 1.01).count();
    if 2 * outliers > finite.len() {
        return Some(Finding::certain(
            name,
            format!("alpha lies outside of 0 to 1 in {outliers} of {all} pixels"),
            "alpha is 1 - transmittance: check the layer, or leave its alpha out",
        ));
    }
    if negative > 0.05 * sum {
        return Some(Finding::doubtful(
            name,
            format!("{:.0} % of the radiance is negative", 100.0 * negative / sum),
            "check the layer, and that filters and denoisers do not undershoot",
        ));
    }
    if outliers > 0 {
        return Some(Finding::doubtful(
            name,
            format!("alpha lies outside of 0 to 1 in {outliers} of {all} pixels"),
            "alpha is 1 - transmittance: clamp it, or check the layer",
        ));
    }
    None
}

fn finite(photo: &Photo) -> impl Iterator<Item = &[f32; 4]> {
    photo.film.rgba.iter().filter(|p| p.iter().all(|v| v.is_finite()))
}

/// True if the pictures have an alpha that says something.
fn has_alpha(all: &[PictureFacts]) -> bool {
    all.iter().any(|picture| picture.has_alpha)
}

/// The color on which nine of ten samples agree, if there is one.
fn common(samples: &mut [[f32; 3]]) -> Option<[f64; 3]> {
    if samples.len() < 16 {
        return None;
    }
    let middle = samples.len() / 2;
    let median: [f64; 3] = std::array::from_fn(|c| {
        let (_, value, _) = samples.select_nth_unstable_by(middle, |a, b| a[c].total_cmp(&b[c]));
        f64::from(value[c])
    });
    let agreed = samples.iter().filter(|s| same(s.map(f64::from), median)).count();
    (10 * agreed >= 9 * samples.len()).then_some(median)
}

fn same(a: [f64; 3], b: [f64; 3]) -> bool {
    (0..3).all(|c| (a[c] - b[c]).abs() <= SAME[0] + SAME[1] * a[c].abs().max(b[c].abs()))
}

/// A color as it is written in transforms.json.
fn json(color: [f64; 3]) -> String {
    let number = |v: f64| (1e4 * v).round() / 1e4 + 0.0;
    format!("[{}, {}, {}]", number(color[0]), number(color[1]), number(color[2]))
}

/// Radiance of the source, where it is the same everywhere.
fn grey(capture: &Capture) -> Option<[f64; 3]> {
    match (capture.model, &capture.transfer, capture.emission_model) {
        (Model::Absorption, ..) => Some([0.0; 3]),
        (Model::EmissionAbsorption, None, EmissionModel::Grey) => Some(capture.emission.map(f64::from)),
        _ => None,
    }
}

/// A background other than the color of pixels without opacity, or of the border where there is no alpha.
fn background_color(all: &[PictureFacts], capture: &Capture, source: Option<[f64; 3]>) -> Option<Finding> {
    let stated = capture.background.map(f64::from);
    let sum = |of: fn(&PictureFacts) -> usize| all.iter().map(of).sum::<usize>();
    if has_alpha(all) {
        let mut samples: Vec<[f32; 3]> = all.iter().flat_map(|picture| picture.behind.iter().copied()).collect();
        let enough = 100 * sum(|picture| picture.transparent) >= sum(|picture| picture.pixels);
        let observed = enough.then(|| common(&mut samples)).flatten()?;
        return (!same(observed, stated)).then(|| {
            Finding::certain(
                None,
                format!(
                    "pixels of alpha 0 show the background: theirs is {}, the capture says {}",
                    json(observed),
                    json(stated)
                ),
                format!(
                    "state \"background\": {} in transforms.json{}",
                    json(observed),
                    if observed == [0.0; 3] { ": the pictures were rendered with a transparent film" } else { "" }
                ),
            )
        });
    }
    let mut samples: Vec<[f32; 3]> = all.iter().flat_map(|picture| picture.border.iter().copied()).collect();
    let observed = common(&mut samples)?;
    if same(observed, stated) || source.is_some_and(|source| same(observed, source)) {
        return None;
    }
    let what = format!(
        "the borders of all pictures have the color {}, the capture's background is {}",
        json(observed),
        json(stated)
    );
    let photographs = "of photographs ⟨capture.convert.photographs⟩ states model and background";
    let remedy =
        format!("state \"background\": {} in transforms.json, or render with alpha; {photographs}", json(observed));
    // Between background and source a medium that fills all pictures evenly could have it.
    let (off, transmittance) = source.map_or((0.0, 0.5), |source| between(observed, source, stated));
    let possible = off < 0.05 && (-0.05..1.0).contains(&transmittance);
    Some(if possible { Finding::doubtful(None, what, remedy) } else { Finding::certain(None, what, remedy) })
}

/// Distance of a color from the line between source and background, relative to the largest of all three, and the
/// transmittance of the point next to it.
fn between(color: [f64; 3], source: [f64; 3], background: [f64; 3]) -> (f64, f64) {
    let contrast: [f64; 3] = std::array::from_fn(|c| background[c] - source[c]);
    let power: f64 = contrast.iter().map(|c| c * c).sum();
    let transmittance =
        if power > 1e-12 { (0..3).map(|c| (color[c] - source[c]) * contrast[c]).sum::<f64>() / power } else { 0.5 };
    let off = (0..3).map(|c| (color[c] - source[c] - transmittance * contrast[c]).abs()).fold(0.0, f64::max);
    let scale = (0..3).map(|c| color[c].abs().max(source[c]).max(background[c])).fold(1e-12, f64::max);
    (off / scale, transmittance)
}

/// Colors of a grey medium are `α c + (1 - α) b`: the emission c that alpha and colors imply against the one stated.
fn opacity(pictures: &[PictureFacts], capture: &Capture, stated: [f64; 3]) -> Option<Finding> {
    let background = capture.background.map(f64::from);
    if !has_alpha(pictures) {
        return impossible_colors(pictures, stated, background);
    }
    let views: Vec<Emitted> = pictures.iter().map(|picture| picture.emitted).collect();
    let all = views.iter().fold(Emitted::default(), Emitted::plus);
    if all.alpha < 1.0 {
        return None;
    }
    let implied = all.emission();
    let scale = (0..3).map(|c| stated[c].max(implied[c].abs()).max(background[c])).fold(1e-12, f64::max);
    let apart = (0..3).map(|c| (implied[c] - stated[c]).abs()).fold(0.0, f64::max);
    let brightest = implied.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    let varies = varies(&views, (VARIED * brightest).max(SAME[1] * scale));
    let misfit = all.misfit(implied);
    if apart < 0.1 * scale && !varies && misfit < MISFIT * scale {
        return None;
    }
    let one = !varies && misfit < MISFIT * scale && implied.iter().all(|v| *v > -0.05);
    let contradicts = format!(
        "alpha and colors contradict each other: together they imply the emission {}, the capture says {}",
        json(implied),
        if capture.model == Model::Absorption { "absorption alone".to_owned() } else { json(stated) },
    );
    let (what, remedy) = if one && brightest < SAME[1] * scale {
        (contradicts, "state \"model\": \"absorption\" in transforms.json: densities follow from it".to_owned())
    } else if one {
        let emission = json(implied.map(|v| v.max(0.0)));
        let state = format!("state \"model\": \"emission-absorption\" and \"emission\": {emission} in transforms.json");
        (contradicts, format!("{state}: densities follow from it"))
    } else if implied.iter().any(|v| *v <= -0.05) && !varies {
        let check = "check model, emission and background in transforms.json; if alpha is a mask and not 1 - \
                     transmittance, leave it out of the pictures";
        (contradicts, check.to_owned())
    } else {
        let place = if varies { "another one in each view" } else { "one that differs from pixel to pixel" };
        (
            format!(
                "alpha and colors contradict each other: no one emission explains both; they imply {place}, {} on \
                 average (off by {:.1} %)",
                json(implied),
                100.0 * misfit / scale
            ),
            SCATTERED.to_owned(),
        )
    };
    Some(Finding::doubtful(None, what, remedy))
}

/// Remedy for light that no one emission explains.
const SCATTERED: &str = "if the medium scatters light, state \"model\": \"scattering\" in transforms.json: densities \
                         then follow from alpha alone, and `cumulo reconstruct color` finds the light as emission, as \
                         it finds volumes of several colors; if alpha is a mask and not 1 - transmittance, leave it \
                         out of the pictures";

/// Share of the implied emission by which that of single views may differ.
const VARIED: f64 = 0.2;
/// Share of the largest color by which what one emission explains may be off, in pixels that lie beside each other
/// alike: where little light comes through, the optical depth is off by many times that.
const MISFIT: f64 = 0.005;
/// Pixels from one to that beside it whose noise is another: filters of pictures are not wider.
const BESIDE: usize = 2;

/// Sums over pixels by which alpha α and the medium's own light L imply an emission: `L = α c`.
#[derive(Debug, Clone, Copy, Default)]
struct Emitted {
    /// Σ α².
    alpha: f64,
    /// Σ α L and Σ L², by channel.
    light: [f64; 3],
    squares: [f64; 3],
    /// Over pairs of pixels: Σ α α', their number, and by channel Σ (α L' + α' L) and Σ L L'.
    pairs: f64,
    count: f64,
    mixed: [f64; 3],
    products: [f64; 3],
}

impl Emitted {
    fn of(photo: &Photo, background: [f64; 3]) -> Self {
        let mut sums = Self::default();
        let own = |p: &[f32; 4]| {
            let alpha = f64::from(p[3]);
            let light: [f64; 3] = std::array::from_fn(|c| f64::from(p[c]) - (1.0 - alpha) * background[c]);
            (p.iter().all(|v| v.is_finite()) && alpha > 0.02).then_some((alpha, light))
        };
        for row in photo.film.rgba.chunks(photo.film.width.max(1)) {
            for (x, (alpha, light)) in row.iter().enumerate().filter_map(|(x, p)| Some((x, own(p)?))) {
                sums.alpha += alpha * alpha;
                for c in 0..3 {
                    sums.light[c] += alpha * light[c];
                    sums.squares[c] += light[c] * light[c];
                }
                let Some((beside, other)) = row.get(x + BESIDE).and_then(own) else { continue };
                sums.pairs += alpha * beside;
                sums.count += 1.0;
                for c in 0..3 {
                    sums.mixed[c] += alpha * other[c] + beside * light[c];
                    sums.products[c] += light[c] * other[c];
                }
            }
        }
        sums
    }

    fn plus(self, other: &Self) -> Self {
        let sum = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|c| a[c] + b[c]);
        Self {
            alpha: self.alpha + other.alpha,
            light: sum(self.light, other.light),
            squares: sum(self.squares, other.squares),
            pairs: self.pairs + other.pairs,
            count: self.count + other.count,
            mixed: sum(self.mixed, other.mixed),
            products: sum(self.products, other.products),
        }
    }

    /// Emission that explains most of the light.
    fn emission(&self) -> [f64; 3] {
        self.light.map(|light| light / self.alpha)
    }

    /// Deviation of the light from that of an emission, without noise, which pixels that lie beside each other do not
    /// share: of few pixels the noise may agree by chance, three standard deviations of which are taken off.
    fn misfit(&self, emission: [f64; 3]) -> f64 {
        let square = |c: usize| {
            let e = emission[c];
            let shared = (self.products[c] - e * self.mixed[c] + e * e * self.pairs) / self.pairs.max(1e-12);
            let all = (self.squares[c] - 2.0 * e * self.light[c] + e * e * self.alpha) / self.alpha;
            shared - 3.0 * all / self.count.sqrt()
        };
        (0..3).map(square).fold(0.0, f64::max).sqrt()
    }
}

/// True if the emissions that views imply lie further apart than `most`.
fn varies(views: &[Emitted], most: f64) -> bool {
    let of = |c: usize| views.iter().filter(|view| view.alpha >= 1.0).map(move |view| view.emission()[c]);
    (0..3).any(|c| of(c).fold(f64::NEG_INFINITY, f64::max) - of(c).fold(f64::INFINITY, f64::min) > most)
}

/// Colors that a grey medium cannot have.
fn impossible_colors(pictures: &[PictureFacts], source: [f64; 3], background: [f64; 3]) -> Option<Finding> {
    let sum = |of: fn(&PictureFacts) -> usize| pictures.iter().map(of).sum::<usize>();
    let (all, outliers) = (sum(|picture| picture.finite), sum(|picture| picture.impossible));
    (4 * outliers > all).then(|| {
        Finding::doubtful(
            None,
            format!(
                "{} % of the pixels have colors that do not lie between background {} and emission {}",
                100 * outliers / all.max(1),
                json(background),
                json(source)
            ),
            "check model, background and emission in transforms.json; volumes of many colors are found by `cumulo \
             reconstruct color`",
        )
    })
}

/// Numbers of samples, of those that lie on steps of eight bits, and of those of them that are neither black nor
/// bright.
fn steps(photo: &Photo) -> [usize; 3] {
    finite(photo).flat_map(|v| &v[..3]).fold([0_usize; 3], |[all, on, shades], value| {
        let steps = f64::from(*value) * 255.0;
        // Half-precision files round by 2⁻¹¹.
        let off = (steps - steps.round()).abs();
        let on_step = (0.0..=255.2).contains(&steps) && off <= 1e-3 + steps * 4.9e-4;
        [all + 1, on + usize::from(on_step), shades + usize::from(on_step && steps > 0.5 && steps < 128.5)]
    })
}

/// Samples that all lie on steps of eight bits.
fn quantised(pictures: &[PictureFacts]) -> Option<Finding> {
    let [all, on, shades] =
        pictures.iter().map(|picture| picture.steps).fold([0; 3], |a, b| std::array::from_fn(|k| a[k] + b[k]));
    (on == all && shades >= 64).then(|| {
        Finding::doubtful(
            None,
            "all samples lie on steps of 1/255: the pictures seem to be display-referred, and scene-linear radiance is \
             expected",
            "write the pictures as scene-linear EXR, without a view transform (in Blender: view transform Raw, or \
             multilayer EXR)",
        )
    })
}
