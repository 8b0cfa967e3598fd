//! Conversion of a ParaView preset to points of a transfer function.

use super::color::{Space, linear};
use super::opacity::{self, OpacityKnot};
use super::{Loaded, Options, Source};
use crate::error::{Error, Result};
use crate::scene::table::{Rgbs, Table};
use crate::scene::transfer::Transfer;

/// Largest opacity; greater ones count as this, an optical depth of 10 ln 2, about 6.9, per unit distance.
pub(crate) const MOST_OPACITY: f64 = 1.0 - 1.0 / 1024.0;

/// Number of samples over the whole range of densities.
const SAMPLES: f64 = 1024.0;
/// Least number of samples between two knots.
const FEWEST: f64 = 16.0;
/// Tolerance, as a share of the piece's peak, within which a line may pass samples that are left out.
const TOLERANCE: f64 = 1.0 / 65_536.0;
/// Largest number of knots of a preset.
const MOST_KNOTS: usize = 1 << 16;

const EXPORT: &str = "export the preset again from ParaView's color map editor";

/// A color knot: density, then display-referred red, green and blue.
pub(super) type ColorKnot = [f64; 4];

/// A preset as a file states it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Preset {
    pub space: Space,
    pub colors: Vec<ColorKnot>,
    /// Opacity knots; `None` if the file states no opacities.
    pub opacities: Option<Vec<OpacityKnot>>,
    /// Without opacities: true if extinction rises from the middle to both ends, false from the first color to the
    /// last.
    pub diverging: bool,
}

/// Converts preset number `index` of a file to a transfer function.
pub(super) fn loaded(
    preset: Preset,
    names: Vec<String>,
    index: usize,
    source: Source,
    options: &Options,
) -> Result<Loaded> {
    let name = names.get(index).cloned();
    let part = |e: Error| e.part(format!("preset '{}'", name.as_deref().unwrap_or_default()));
    let (transfer, notes) = preset.transfer(options).map_err(part)?;
    Ok(Loaded { transfer, albedo: None, source, name, presets: names, notes })
}

impl Preset {
    /// Points with the preset's colors and opacities, and remarks on what was assumed.
    fn transfer(self, options: &Options) -> Result<(Transfer, Vec<String>)> {
        let curves = Curves::new(self, options)?;
        let transfer = Transfer::Piecewise { points: curves.points()? }
            .checked()
            .map_err(|e| e.hint("simplify the preset in ParaView, and export it again"))?;
        Ok((transfer, curves.notes))
    }
}

/// Dependence of extinction on the density.
enum Extinction {
    /// Extinction from the opacities of a layer of thickness `distance`.
    Opacity { knots: Vec<OpacityKnot>, distance: f64 },
    /// Linear rise of extinction from 0 at `low` to `most` at `high`.
    Rise { low: f64, high: f64, most: f64 },
    /// Linear rise of extinction from 0 at `zero` to `most` at a distance of `half` to both sides.
    Diverging { zero: f64, half: f64, most: f64 },
}

/// A preset with checked numbers and ascending knots.
struct Curves {
    space: Space,
    colors: Vec<ColorKnot>,
    extinction: Extinction,
    notes: Vec<String>,
}

impl Curves {
    fn new(preset: Preset, options: &Options) -> Result<Self> {
        let Preset { space, mut colors, opacities, diverging } = preset;
        ascending(&mut colors, "color")?;
        for knot in &mut colors {
            for (value, channel) in knot[1..].iter_mut().zip(["red", "green", "blue"]) {
                *value = share(*value, channel)
                    .map_err(|e| e.instead("colors go from 0 to 1: divide those that go to 255 by it"))?;
            }
        }
        let mut notes = Vec::new();
        let extinction = match opacities {
            Some(mut knots) => {
                ascending(&mut knots, "opacity")?;
                for knot in &mut knots {
                    for (value, what) in knot[1..].iter_mut().zip(["an opacity", "a midpoint", "a sharpness"]) {
                        *value = share(*value, what)?;
                    }
                }
                if let Some(given) = options.extinction {
                    return Err(Error::invalid(format!(
                        "an extinction of {given} was given, but the preset has opacities"
                    ))
                    .hint("leave it out, or give the unit distance that the opacities are for"));
                }
                let distance = above_zero(options.unit_distance.unwrap_or(1.0), "unit distance")?;
                let capped = knots.iter().filter(|k| k[1] > MOST_OPACITY).count();
                if capped > 0 {
                    notes.push(format!(
                        "{capped} of {} opacities exceed {MOST_OPACITY} and count as that: extinction {}",
                        knots.len(),
                        of_opacity(1.0, distance)
                    ));
                }
                Extinction::Opacity { knots, distance }
            }
            None => {
                if let Some(given) = options.unit_distance {
                    return Err(Error::invalid(format!(
                        "a unit distance of {given} was given, but the preset has no opacities"
                    ))
                    .hint("give the extinction that it ends with instead"));
                }
                let most = above_zero(options.extinction.unwrap_or(1.0), "extinction")?;
                let (low, high) = (colors[0][0], colors[colors.len() - 1][0]);
                let half = 0.5 * (high - low);
                if diverging && half > 0.0 {
                    let zero = low + half;
                    notes.push(format!("extinction rises from 0 at density {zero} to {most} at both ends"));
                    return Ok(Self { space, colors, extinction: Extinction::Diverging { zero, half, most }, notes });
                }
                notes.push(format!(
                    "the preset states no opacities: extinction rises from 0 at the first color to {most} at the last"
                ));
                Extinction::Rise { low, high, most }
            }
        };
        Ok(Self { space, colors, extinction, notes })
    }

    /// Densities at which a curve may have a kink or a step, ascending.
    fn knots(&self) -> Vec<f64> {
        let mut all: Vec<f64> = self.colors.iter().map(|k| k[0]).collect();
        for pair in self.colors.windows(2) {
            let [from, to] = [&pair[0], &pair[1]];
            let kinks = self.space.kinks(rgb(from), rgb(to));
            all.extend(kinks.into_iter().map(|s| (1.0 - s) * from[0] + s * to[0]));
        }
        if let Extinction::Opacity { knots, .. } = &self.extinction {
            all.extend(knots.iter().map(|k| k[0]));
            let kink = |k: &[OpacityKnot]| opacity::kink(&k[0]).map(|s| (1.0 - s) * k[0][0] + s * k[1][0]);
            all.extend(knots.windows(2).filter_map(kink));
        }
        if let Extinction::Diverging { zero, .. } = &self.extinction {
            all.push(*zero);
        }
        all.sort_by(f64::total_cmp);
        // -0 and 0 are one density.
        all.dedup_by(|a, b| *a == *b);
        all
    }

    fn points(&self) -> Result<Vec<[f64; 5]>> {
        let knots = self.knots();
        let (first, last) = (knots[0], knots[knots.len() - 1]);
        if !(last - first).is_finite() {
            return Err(Error::invalid(format!("densities from {first} to {last} are too wide a range"))
                .hint("rescale the preset to the range of the data in ParaView, and export it again"));
        }
        let mut points: Vec<[f64; 5]> = Vec::new();
        let mut push = |d: f64, [r, g, b, s]: Rgbs| {
            let point = [d, r, g, b, s];
            if points.last() != Some(&point) {
                points.push(point);
            }
        };
        // Constant outside: below the first knot and above the last the curves may begin with a step.
        push(first, self.at(first, f64::NEG_INFINITY));
        for pair in knots.windows(2) {
            let [low, high] = [pair[0], pair[1]];
            let middle = 0.5 * low + 0.5 * high;
            let count = (SAMPLES * (high - low) / (last - first)).ceil().clamp(FEWEST, SAMPLES);
            let inner = (1..count as u32).map(|i| low + f64::from(i) / count * (high - low));
            let mut densities = vec![low];
            // Knots may be so close that no number lies between them.
            densities.extend(inner.filter(|d| low < *d && *d < high));
            densities.dedup();
            densities.push(high);
            let values = densities.iter().map(|d| self.at(*d, middle)).collect();
            // Knots are kept, so that a function that is empty up to a knot stays exactly empty there.
            let piece = Table::new(densities, values).map_err(|e| e.hint(EXPORT))?.simplified(TOLERANCE);
            piece.knots().iter().zip(piece.values()).for_each(|(d, v)| push(*d, *v));
        }
        push(last, self.at(last, f64::INFINITY));
        Ok(points)
    }

    /// Color and extinction at a density, in the piece around `middle`. An infinite `middle` selects the constants
    /// outside.
    fn at(&self, density: f64, middle: f64) -> Rgbs {
        let [r, g, b] = match piece(&self.colors, middle) {
            Piece::Outside(knot) => rgb(knot),
            Piece::Between(from, to) => self.space.between((density - from[0]) / (to[0] - from[0]), rgb(from), rgb(to)),
        }
        .map(linear);
        let extinction = match &self.extinction {
            Extinction::Opacity { knots, distance } => {
                let opacity = match piece(knots, middle) {
                    Piece::Outside(knot) => knot[1],
                    Piece::Between(from, to) => {
                        let share = |d: f64| (d - from[0]) / (to[0] - from[0]);
                        opacity::between(share(density), share(middle), from, to)
                    }
                };
                of_opacity(opacity, *distance)
            }
            Extinction::Rise { low, high, most } if low < high => {
                most * ((density - low) / (high - low)).clamp(0.0, 1.0)
            }
            Extinction::Rise { most, .. } => *most,
            Extinction::Diverging { zero, half, most } => most * ((density - zero).abs() / half).min(1.0),
        };
        [r, g, b, extinction]
    }
}

fn rgb([_, r, g, b]: &ColorKnot) -> [f64; 3] {
    [*r, *g, *b]
}

/// Extinction of a layer of the given opacity and thickness.
fn of_opacity(opacity: f64, distance: f64) -> f64 {
    // The maximum avoids -0 for an opacity of 0.
    (-(-opacity.min(MOST_OPACITY)).ln_1p() / distance).max(0.0)
}

enum Piece<'a> {
    Outside(&'a [f64; 4]),
    Between(&'a [f64; 4], &'a [f64; 4]),
}

/// Knots around a density that is not itself a knot.
fn piece(knots: &[[f64; 4]], density: f64) -> Piece<'_> {
    match knots.partition_point(|k| k[0] <= density) {
        0 => Piece::Outside(&knots[0]),
        n if n == knots.len() => Piece::Outside(&knots[n - 1]),
        n => Piece::Between(&knots[n - 1], &knots[n]),
    }
}

/// Sorts knots by density, as ParaView does; knots of equal density keep their order. No knots, too many or densities
/// that are not finite are errors.
fn ascending(knots: &mut [[f64; 4]], what: &str) -> Result<()> {
    if knots.is_empty() {
        return Err(Error::invalid(format!("no {what} points; at least one is needed")).hint(EXPORT));
    }
    if knots.len() > MOST_KNOTS {
        return Err(Error::invalid(format!("{} {what} points; {MOST_KNOTS} can be used", knots.len()))
            .hint("simplify the preset in ParaView, and export it again"));
    }
    if let Some((i, _)) = knots.iter().enumerate().find(|(_, k)| !k[0].is_finite()) {
        return Err(Error::invalid(format!(
            "{what} point {i} lies at density {}; a finite number is expected",
            knots[i][0]
        ))
        .hint("correct that point, or rescale the preset in ParaView and export it again"));
    }
    knots.sort_by(|a, b| a[0].total_cmp(&b[0]));
    Ok(())
}

/// Checks that a number lies from 0 to 1; small excesses from rounding are clipped.
fn share(value: f64, what: &str) -> Result<f64> {
    if (-1e-3..=1.0 + 1e-3).contains(&value) {
        Ok(value.clamp(0.0, 1.0))
    } else {
        Err(Error::invalid(format!("{what} of {value}; a number from 0 to 1 is expected"))
            .hint("correct that point, or export the preset again from ParaView"))
    }
}

fn above_zero(value: f64, what: &str) -> Result<f64> {
    if value > 0.0 && value.is_finite() {
        Ok(value)
    } else {
        Err(Error::invalid(format!("{what} {value}; a finite number above zero is expected"))
            .hint("give a positive number, or leave it out: it is 1 then"))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points(preset: Preset, options: &Options) -> Vec<[f64; 5]> {
        match preset.transfer(options).unwrap().0 {
            Transfer::Piecewise { points } => points,
            other => panic!("{other:?}"),
        }
    }

    fn grey(space: Space, opacities: Option<Vec<OpacityKnot>>) -> Preset {
        Preset { space, colors: vec![[0.0, 0.5, 0.5, 0.5], [2.0, 0.5, 0.5, 0.5]], opacities, diverging: false }
    }

    #[test]
    fn one_color_and_a_rise_are_two_points() {
        let got = points(grey(Space::Rgb, None), &Options { extinction: Some(5.0), ..Options::default() });
        // sRGB 0.5 is 0.214041 of the light.
        let c = ((0.5_f64 + 0.055) / 1.055).powf(2.4);
        assert!((c - 0.214_041).abs() < 1e-6);
        assert_eq!(got, [[0.0, c, c, c, 0.0], [2.0, c, c, c, 5.0]]);
    }

    #[test]
    fn opacity_is_that_of_the_unit_distance() {
        let flat = grey(Space::Rgb, Some(vec![[0.0, 0.25, 0.5, 0.0]]));
        let got = points(flat, &Options { unit_distance: Some(0.5), ..Options::default() });
        assert_eq!(got.len(), 2);
        // A layer half a unit thick lets 3/4 through.
        assert!(got.iter().all(|p| ((-0.5 * p[4]).exp() - 0.75).abs() < 1e-15), "{got:?}");
    }

    #[test]
    fn full_opacity_is_capped_and_told() {
        let (transfer, notes) = grey(Space::Rgb, Some(vec![[0.0, 0.0, 0.5, 0.0], [2.0, 1.0, 0.5, 0.0]]))
            .transfer(&Options::default())
            .unwrap();
        let peak = transfer.table().unwrap().peak()[3];
        assert!((peak - 1024.0_f64.ln()).abs() < 1e-12, "{peak}");
        assert!(notes[0].starts_with("1 of 2 opacities exceed"), "{notes:?}");
        let table = transfer.table().unwrap();
        assert_eq!(table.at(0.0)[3].to_bits(), 0, "nothing, and not minus nothing");
        // The points follow the curve within the sampling error, except near the last one, where the cap applies.
        for d in [0.1, 0.7, 1.0, 1.5, 1.9] {
            assert!((table.at(d)[3] + (1.0 - d / 2.0_f64).ln()).abs() < 1e-3, "{d}");
        }
    }

    #[test]
    fn steps_stay_steps() {
        let step = Preset {
            space: Space::Step,
            colors: vec![[0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [2.0, 0.0, 1.0, 0.0]],
            opacities: Some(vec![[0.0, 0.0, 0.25, 1.0], [2.0, 0.5, 0.5, 0.0]]),
            diverging: false,
        };
        let s = -(0.5_f64.ln());
        let (black, red, green) = ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        let point = |d: f64, [r, g, b]: [f64; 3], s: f64| [d, r, g, b, s];
        assert_eq!(
            points(step, &Options::default()),
            [
                point(0.0, black, 0.0),
                point(0.0, red, 0.0),
                point(0.5, red, 0.0),
                point(0.5, red, s),
                point(1.0, red, s),
                point(1.0, green, s),
                point(2.0, green, s),
            ]
        );
    }

    #[test]
    fn knots_of_one_density_are_a_step() {
        let twice = vec![[0.5, 0.0, 0.5, 0.0], [0.5, 0.25, 0.5, 0.0], [0.5, 0.75, 0.5, 0.0]];
        let got = points(grey(Space::Rgb, Some(twice)), &Options::default());
        let at: Vec<(f64, f64)> = got.iter().map(|p| (p[0], (1.0 - (-p[4]).exp()) * 100.0)).collect();
        let expected = [(0.0, 0.0), (0.5, 0.0), (0.5, 75.0), (2.0, 75.0)];
        assert!(at.iter().zip(expected).all(|(a, b)| a.0 == b.0 && (a.1 - b.1).abs() < 1e-9), "{at:?}");
        assert_eq!(at.len(), 4);
    }

    #[test]
    fn options_that_do_not_apply_are_refused() {
        let with = Some(vec![[0.0, 0.5, 0.5, 0.0]]);
        for (preset, options, word) in [
            (grey(Space::Rgb, None), Options { unit_distance: Some(1.0), ..Options::default() }, "no opacities"),
            (grey(Space::Rgb, with.clone()), Options { extinction: Some(1.0), ..Options::default() }, "has opacities"),
            (grey(Space::Rgb, with), Options { unit_distance: Some(0.0), ..Options::default() }, "unit distance 0"),
            (grey(Space::Rgb, None), Options { extinction: Some(f64::NAN), ..Options::default() }, "extinction NaN"),
        ] {
            let error = preset.transfer(&options).unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }

    proptest! {
        #[test]
        fn sampled_colors_stay_close_to_the_curve(
            from in prop::array::uniform3(0.0..=1.0_f64), to in prop::array::uniform3(0.0..=1.0_f64),
            space in 0..5_usize,
        ) {
            let space = [
                Space::Rgb, Space::Hsv { wrap: false }, Space::Hsv { wrap: true }, Space::Lab, Space::Diverging,
            ][space];
            let knot = |d: f64, c: [f64; 3]| [d, c[0], c[1], c[2]];
            let preset = Preset { space, colors: vec![knot(-1.0, from), knot(3.0, to)], opacities: None, diverging: false };
            let got = preset.transfer(&Options::default()).unwrap().0.table().unwrap();
            for i in 0..=1000 {
                let s = f64::from(i) / 1000.0;
                let expected = space.between(s, from, to).map(linear);
                let value = got.at(-1.0 + 4.0 * s);
                let off = (0..3).map(|c| (value[c] - expected[c]).abs()).fold(0.0, f64::max);
                // Linear interpolation over h = 1/1024 errs by h²/8 times the second derivative (1e-7 times one below
                // 100 between hues), and by h/4 times the change of slope at a kink at the display's limits.
                let bound = if matches!(space, Space::Lab | Space::Diverging) { 4e-3 } else { 2e-4 };
                prop_assert!(off < bound, "{space:?} at {s}: {off}");
            }
        }

        #[test]
        fn any_preset_is_read_or_refused(
            colors in prop::collection::vec(prop::array::uniform4(0.0..1.0_f64), 1..6),
            opacities in prop::option::of(prop::collection::vec(prop::array::uniform4(0.0..=1.0_f64), 1..6)),
            space in 0..6_usize, coarse in any::<bool>(),
        ) {
            let spaces = [
                Space::Rgb, Space::Hsv { wrap: false }, Space::Hsv { wrap: true }, Space::Lab, Space::Diverging,
                Space::Step,
            ];
            // Coarse densities coincide.
            let near = |mut k: [f64; 4]| { if coarse { k[0] = (3.0 * k[0]).floor(); } k };
            let preset = Preset {
                space: spaces[space],
                colors: colors.into_iter().map(near).collect(),
                opacities: opacities.map(|o| o.into_iter().map(near).collect()),
                diverging: false,
            };
            let (transfer, _) = preset.transfer(&Options::default()).unwrap();
            prop_assert!(transfer.table().unwrap().peak()[3] < 7.0);
        }
    }
}
