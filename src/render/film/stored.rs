//! Sums over replicates as planes of a picture: what pictures are joined by, and go on from.

use super::replicates::PixelSums;
use super::sum::Sum;
use crate::error::{Error, Result};
use crate::scene::film::{Film, Plane};

/// Layer of the planes.
const LAYER: &str = "replicates";
/// Planes of a sum, from its largest part on.
const PARTS: usize = 3;
/// Planes of the number of paths, which single precision does not hold.
const PATHS: usize = 2;

/// Planes of all.
pub(super) const PLANES: u64 = (1 + PATHS + 4 * (2 * PARTS + 1)) as u64;

/// Returns the names of the planes: the number of replicates, that of paths in two parts; and of red, green, blue and
/// alpha the sum in three parts, that of squares in three, and the largest mean of a replicate.
fn names() -> impl Iterator<Item = String> {
    let colors = ["R", "G", "B", "A"].into_iter().flat_map(|c| {
        let sum = (0..PARTS).map(move |part| format!("{c}{part}"));
        let squares = (0..PARTS).map(move |part| format!("{c}{c}{part}"));
        sum.chain(squares).chain([format!("{c}max")])
    });
    let paths = (0..PATHS).map(|part| format!("paths{part}"));
    ["count".to_owned()].into_iter().chain(paths).chain(colors).map(|name| format!("{LAYER}.{name}"))
}

/// Returns the power of two by which the sums of a channel are divided, so that no part of them overflows or is lost:
/// the one below its largest value.
fn unit(largest: f32) -> f64 {
    let largest = f64::from(largest);
    if largest > 0.0 && largest.is_finite() { largest.log2().floor().exp2() } else { 1.0 }
}

impl PixelSums {
    /// Returns the sums of a picture's pixels as planes of the layer `replicates`, whose parts hold them to 72 bits.
    pub fn planes(sums: &[Self]) -> Vec<Plane> {
        let mut planes: Vec<Plane> =
            names().map(|name| Plane { name, samples: Vec::with_capacity(sums.len()) }).collect();
        for sums in sums {
            let paths = Sum::of([sums.paths as f64]).parts();
            let colors = (0..4).flat_map(|c| {
                let unit = unit(sums.largest[c]);
                let sum = sums.first[c].times(1.0 / unit).parts();
                let squares = sums.second[c].times(1.0 / (unit * unit)).parts();
                sum.into_iter().chain(squares).chain([sums.largest[c]])
            });
            let values = [sums.replicates as f32].into_iter().chain(paths.into_iter().take(PATHS)).chain(colors);
            planes.iter_mut().zip(values).for_each(|(plane, v)| plane.samples.push(v));
        }
        planes
    }

    /// Takes the sums of a picture's pixels out of its planes, row-major; `None` if it has none.
    ///
    /// # Errors
    /// If planes are missing, or hold what no sum is.
    pub fn take(film: &mut Film) -> Result<Option<Vec<Self>>> {
        let of_sums = |plane: &Plane| plane.name.split_once('.').is_some_and(|(layer, _)| layer == LAYER);
        let (sums, others): (Vec<Plane>, Vec<Plane>) =
            std::mem::take(&mut film.planes).into_iter().partition(|plane| of_sums(plane));
        film.planes = others;
        if sums.is_empty() {
            return Ok(None);
        }
        let find = |name: String| match sums.iter().find(|plane| plane.name == name) {
            Some(plane) if plane.samples.len() == film.rgba.len() => Ok(&plane.samples[..]),
            _ => Err(invalid(format!("the plane '{name}' is missing"))),
        };
        let planes = names().map(find).collect::<Result<Vec<_>>>()?;
        let pixel = |i: usize| {
            let values: Vec<f32> = planes.iter().map(|plane| plane[i]).collect();
            Self::read(&values).ok_or_else(|| {
                let at = [i % film.width.max(1), i / film.width.max(1)];
                invalid(format!("the planes '{LAYER}' of pixel {}, {} hold no sums", at[0], at[1]))
            })
        };
        (0..film.rgba.len()).map(pixel).collect::<Result<Vec<_>>>().map(Some)
    }

    /// True if a channel's sums can be those of the means of its replicates, none of which is larger than the largest:
    /// n Σ nᵢ xᵢ² is at least (Σ nᵢ xᵢ)² (Cauchy and Schwarz), and Σ nᵢ xᵢ² at most the largest times Σ nᵢ xᵢ.
    fn holds(&self, channel: usize) -> bool {
        let (n, largest) = (self.paths as f64, f64::from(self.largest[channel]));
        let [first, second] = [self.first[channel].value(), self.second[channel].value()];
        let rounded = 1.0 + 1e-9;
        let at_most = |a: f64, b: f64| a <= b * rounded;
        // Estimates of the transmittance may be below 0 by rounding.
        let negative = first < 0.0 || largest < 0.0;
        negative || at_most(first * first, n * second) && at_most(second, largest * first)
    }

    /// Reads the sums of a pixel; `None` if the values are not those of sums.
    fn read(values: &[f32]) -> Option<Self> {
        let (head, colors) = values.split_at_checked(1 + PATHS)?;
        let whole = |v: f64| v >= 0.0 && v.fract() == 0.0 && v <= MOST_PATHS;
        let of = |parts: &[f32]| Sum::of(parts.iter().copied().map(f64::from));
        let (count, paths) = (f64::from(head[0]), of(&head[1..]).value());
        let finite = values.iter().all(|v| v.is_finite());
        if !(finite && whole(count) && whole(paths) && count <= paths) || (count == 0.0) != (paths == 0.0) {
            return None;
        }
        let mut sums = Self { replicates: count as u32, paths: paths as u64, ..Self::default() };
        let of_color = |c: usize| &colors[c * (2 * PARTS + 1)..][..2 * PARTS + 1];
        sums.largest = std::array::from_fn(|c| of_color(c)[2 * PARTS]);
        let units = sums.largest.map(unit);
        sums.first = std::array::from_fn(|c| of(&of_color(c)[..PARTS]).times(units[c]));
        sums.second = std::array::from_fn(|c| of(&of_color(c)[PARTS..2 * PARTS]).times(units[c] * units[c]));
        (0..4).all(|c| sums.holds(c)).then_some(sums)
    }
}

/// Most paths of a pixel: counts up to it are exact.
const MOST_PATHS: f64 = (1_u64 << 40) as f64;

fn invalid(what: String) -> Error {
    Error::invalid(what)
        .hint("render the picture again: these planes are as `render` and `merge` write them, or useless")
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    fn film(sums: &[PixelSums]) -> Film {
        let planes = PixelSums::planes(sums);
        Film { planes, ..Film::new(sums.len(), 1) }
    }

    /// Sums of bright, dark and missing pixels come back, so that parts make the picture that the whole makes.
    #[test]
    fn sums_are_kept_to_the_last_bit_of_a_picture() {
        let of = |scale: f32| {
            // Alpha is large where colors are faint.
            let mut sums = PixelSums::default();
            for i in 1..40_u32 {
                sums.merge(&PixelSums::of(i, [scale / i as f32, scale, 0.1 * scale * (i % 7) as f32, 0.7]));
            }
            sums
        };
        let sums = [of(1.0), of(3.1e-15), of(7.7e30), PixelSums::default(), PixelSums::of(1 << 24, [0.0; 4])];
        let mut film = film(&sums);
        film.planes.push(Plane { name: "other.V".into(), samples: vec![0.0; sums.len()] });
        let read = PixelSums::take(&mut film).unwrap().unwrap();
        assert_eq!(film.planes.len(), 1);
        for (read, sums) in read.iter().zip(&sums) {
            assert_eq!((read.replicates, read.paths, read.largest), (sums.replicates, sums.paths, sums.largest));
            assert_eq!(read.mean().map(|v| v as f32), sums.mean().map(|v| v as f32));
            for (read, sums) in read.variance().into_iter().zip(sums.variance()) {
                assert!(read == sums || (read / sums - 1.0).abs() < 1e-12, "{read} {sums}");
            }
        }
        assert_eq!(PixelSums::take(&mut film).unwrap(), None);
    }

    #[test]
    fn planes_that_are_no_sums_are_refused() {
        let good = || film(&[PixelSums::of(4, [0.5; 4])]);
        let plane = |film: &mut Film, name: &str, v: f32| {
            film.planes.iter_mut().find(|plane| plane.name == format!("{LAYER}.{name}")).unwrap().samples[0] = v;
        };
        for (name, v) in [
            ("count", 0.0),
            ("count", 1.5),
            ("paths0", -4.0),
            ("R0", f32::NAN),
            ("Amax", f32::INFINITY),
            ("Gmax", 0.0),
            ("RR0", 0.0),
            ("B0", 9.0),
        ] {
            let mut film = good();
            plane(&mut film, name, v);
            assert!(PixelSums::take(&mut film).is_err(), "{name} {v}");
        }
        let mut film = good();
        film.planes.pop();
        assert!(PixelSums::take(&mut film).is_err());
    }
}
