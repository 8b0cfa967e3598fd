//! Transfer functions from density to color and extinction.
//!
//! Every kind is converted to a [`Table`]. [`Transfer::chain`] converts derivatives with respect to the table to those
//! with respect to the kind's parameters.

use crate::error::{Error, Result};
use crate::scene::table::{Rgbs, Table, TableGradient};
use serde::{Deserialize, Serialize};

/// A transfer function with its parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Transfer {
    /// Texels over a range of densities, texel i of R at `low + (i + 1/2) (high - low) / R`. The function is linear
    /// between texels and constant outside the outermost.
    Texture {
        /// Range of densities, `low` and `high`.
        domain: [f64; 2],
        /// Values of the texels, from low to high density.
        texels: Vec<Rgbs>,
    },
    /// Piecewise linear between points of ascending density, constant outside. Two points at one density are a step.
    Piecewise {
        /// Control points: density, then red, green, blue and extinction.
        points: Vec<[f64; 5]>,
    },
    /// A sum of Gaussian lobes, tabulated over a range of densities and constant outside.
    Gaussians {
        /// Range of densities, `low` and `high`.
        domain: [f64; 2],
        /// Lobes of the sum.
        lobes: Vec<Lobe>,
    },
    /// One color, with an extinction equal to the density inside the domain and constant outside.
    Identity {
        /// Range of densities, `low` and `high`.
        domain: [f64; 2],
        /// Red, green and blue radiance of the source.
        #[serde(alias = "colour")]
        color: [f64; 3],
    },
    /// One color and extinction for each of some labels, which are whole numbers; all other labels are clear. Volumes
    /// are looked up at the nearest voxel.
    Labels {
        /// Classes of ascending labels.
        classes: Vec<Class>,
    },
}

/// A class of voxels with one label.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Class {
    /// Label of the class.
    pub label: i32,
    /// Name of the class; empty if it has none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// Red, green, blue and extinction.
    pub rgbs: Rgbs,
}

/// A Gaussian lobe, `rgbs · exp(-(d - mean)² / (2 e^{2 ln_width}))`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Lobe {
    /// Density at the lobe's peak.
    pub mean: f64,
    /// Logarithm of the lobe's standard deviation, so that no step makes the deviation negative.
    pub ln_width: f64,
    /// Values at the lobe's peak.
    pub rgbs: Rgbs,
}

/// Number of cells of a tabulated sum of Gaussians. Lobes narrower than half a cell are widened to that.
const GAUSSIAN_CELLS: usize = 512;
/// Largest number of texels, points or lobes: two for each 16-bit value.
const MOST: usize = 1 << 17;
/// Largest label, to either side of 0, between which and the next single precision knows a half.
pub const MOST_LABEL: u32 = 1 << 22;

impl Lobe {
    /// Value of the lobe at a density relative to its peak, and the derivatives with respect to mean and logarithmic
    /// width. A standard deviation below `floor` is raised to it.
    fn at(&self, density: f64, floor: f64) -> (f64, f64, f64) {
        let own = self.ln_width.exp();
        let width = own.max(floor);
        let u = (density - self.mean) / width;
        let value = (-0.5 * u * u).exp();
        (value, value * u / width, if own > floor { value * u * u } else { 0.0 })
    }
}

impl Transfer {
    /// Returns the function if every number can be used.
    ///
    /// # Errors
    /// Names the first number that cannot be used.
    pub fn checked(self) -> Result<Self> {
        let count = match &self {
            Self::Texture { texels, .. } => texels.len(),
            Self::Piecewise { points } => points.len(),
            Self::Gaussians { lobes, .. } => lobes.len(),
            Self::Identity { .. } => 1,
            Self::Labels { classes } => classes.len(),
        };
        if !(1..=MOST).contains(&count) {
            return Err(Error::invalid(format!("a transfer function of {count} entries: 1 to {MOST} can be used")));
        }
        if let Self::Texture { domain: [low, high], .. }
        | Self::Gaussians { domain: [low, high], .. }
        | Self::Identity { domain: [low, high], .. } = &self
            && !(low.is_finite() && high.is_finite() && low < high && (high - low).is_finite())
        {
            return Err(Error::invalid(format!("domain {low}..{high} of the transfer function must ascend")));
        }
        if let Self::Identity { domain: [low, _], .. } = &self
            && *low < 0.0
        {
            return Err(Error::invalid(format!("an identity from density {low} on: extinction cannot be negative")));
        }
        if let Self::Labels { classes } = &self {
            if let Some(pair) = classes.windows(2).find(|pair| pair[1].label <= pair[0].label) {
                let [before, after] = [pair[0].label, pair[1].label];
                return Err(Error::invalid(format!("label {after} comes after {before}: labels must ascend")));
            }
            let unusable = |class: &Class| class.rgbs.iter().copied().find(|v| !(v.is_finite() && *v >= 0.0));
            if let Some((label, bad)) = classes.iter().find_map(|class| Some((class.label, unusable(class)?))) {
                return Err(Error::invalid(format!(
                    "of label {label} a value is {bad}: colors and extinction must be finite and not negative"
                )));
            }
            let far = |class: &&Class| class.label.unsigned_abs() > MOST_LABEL;
            if let Some(class) = classes.iter().find(far) {
                let error = format!("label {} is beyond {MOST_LABEL}: single precision cannot tell it", class.label);
                return Err(Error::unsupported(error));
            }
        }
        if let Self::Gaussians { lobes, .. } = &self
            && let Some(lobe) = lobes.iter().find(|l| !(l.mean.is_finite() && l.ln_width.abs() < 100.0))
        {
            return Err(Error::invalid(format!(
                "a lobe of mean {} and logarithmic width {} cannot be used",
                lobe.mean, lobe.ln_width
            )));
        }
        self.table()?;
        Ok(self)
    }

    /// True if the function is one of labels.
    pub fn is_of_labels(&self) -> bool {
        matches!(self, Self::Labels { .. })
    }

    /// Piecewise linear form of the function, which renderers use.
    ///
    /// # Errors
    /// The conditions are those of [`Table::new`].
    pub fn table(&self) -> Result<Table> {
        let (knots, values) = match self {
            Self::Texture { domain, texels } => (Self::centres(*domain, texels.len()), texels.clone()),
            Self::Piecewise { points } => points.iter().map(|[d, r, g, b, s]| (*d, [*r, *g, *b, *s])).unzip(),
            Self::Gaussians { domain, lobes } => {
                let (knots, floor) = gaussian_knots(*domain);
                let sum = |d: &f64| {
                    let mut value = [0.0; 4];
                    for lobe in lobes {
                        let (share, ..) = lobe.at(*d, floor);
                        value.iter_mut().zip(lobe.rgbs).for_each(|(v, top)| *v += share * top);
                    }
                    value
                };
                let values = knots.iter().map(sum).collect();
                (knots, values)
            }
            Self::Identity { domain, color: [r, g, b] } => (domain.to_vec(), domain.map(|d| [*r, *g, *b, d]).to_vec()),
            Self::Labels { classes } => {
                let value = |class: Option<usize>| class.map_or([0.0; 4], |class| classes[class].rgbs);
                let (knots, values) = label_knots(classes).map(|(knot, class)| (knot, value(class))).unzip();
                return Ok(Table::new(knots, values)?.of_labels());
            }
        };
        Table::new(knots, values)
    }

    /// Densities of the centres of `count` texels over a domain.
    pub fn centres([low, high]: [f64; 2], count: usize) -> Vec<f64> {
        (0..count).map(|i| low + (i as f64 + 0.5) * (high - low) / count as f64).collect()
    }

    /// All parameters with their names, in the order of the derivatives of [`Transfer::chain`].
    pub fn parameters(&self) -> Vec<(String, f64)> {
        const CHANNELS: [&str; 4] = ["red", "green", "blue", "extinction"];
        let four = |what: &str, i: usize, v: &[f64]| {
            v.iter().zip(CHANNELS).map(|(v, c)| (format!("{what}[{i}].{c}"), *v)).collect::<Vec<_>>()
        };
        match self {
            Self::Texture { texels, .. } => texels.iter().enumerate().flat_map(|(i, t)| four("texel", i, t)).collect(),
            Self::Piecewise { points } => {
                let one = |(i, p): (usize, &[f64; 5])| {
                    let mut all = vec![(format!("point[{i}].density"), p[0])];
                    all.extend(four("point", i, &p[1..]));
                    all
                };
                points.iter().enumerate().flat_map(one).collect()
            }
            Self::Gaussians { lobes, .. } => {
                let one = |(i, l): (usize, &Lobe)| {
                    let mut all =
                        vec![(format!("lobe[{i}].mean"), l.mean), (format!("lobe[{i}].ln_width"), l.ln_width)];
                    all.extend(four("lobe", i, &l.rgbs));
                    all
                };
                lobes.iter().enumerate().flat_map(one).collect()
            }
            Self::Identity { color, .. } => four("color", 0, color),
            Self::Labels { classes } => {
                classes.iter().enumerate().flat_map(|(i, class)| four("class", i, &class.rgbs)).collect()
            }
        }
    }

    /// A copy of the function with new parameters, in the order of [`Transfer::parameters`]. Parameters beyond the end
    /// of `new` are kept.
    #[must_use]
    pub fn with_parameters(&self, new: &[f64]) -> Self {
        let mut all = self.clone();
        let mut new = new.iter();
        let mut set = |v: &mut f64| *v = new.next().copied().unwrap_or(*v);
        match &mut all {
            Self::Texture { texels, .. } => texels.iter_mut().flatten().for_each(&mut set),
            Self::Piecewise { points } => points.iter_mut().flatten().for_each(&mut set),
            Self::Gaussians { lobes, .. } => lobes.iter_mut().for_each(|l| {
                set(&mut l.mean);
                set(&mut l.ln_width);
                l.rgbs.iter_mut().for_each(&mut set);
            }),
            Self::Identity { color, .. } => color.iter_mut().for_each(&mut set),
            Self::Labels { classes } => classes.iter_mut().flat_map(|class| &mut class.rgbs).for_each(&mut set),
        }
        all
    }

    /// Change of the table under a change `by` of the parameters, in the order of [`Transfer::parameters`]: the
    /// transpose of [`Transfer::chain`]. Parameters beyond the end of `by` do not change.
    ///
    /// # Errors
    /// The conditions are those of [`Table::new`].
    pub fn push(&self, by: &[f64]) -> Result<TableGradient> {
        let table = self.table()?;
        let mut by = by.iter().copied().chain(std::iter::repeat(0.0));
        let mut next = || by.next().unwrap_or(0.0);
        let mut knots = vec![0.0; table.knots().len()];
        let mut values = vec![[0.0; 4]; knots.len()];
        match self {
            Self::Texture { .. } => values.iter_mut().flatten().for_each(|v| *v = next()),
            Self::Piecewise { .. } => {
                for (knot, value) in knots.iter_mut().zip(&mut values) {
                    *knot = next();
                    value.iter_mut().for_each(|v| *v = next());
                }
            }
            Self::Gaussians { domain, lobes } => {
                let (at, floor) = gaussian_knots(*domain);
                for lobe in lobes {
                    let (mean, width) = (next(), next());
                    let top: Rgbs = std::array::from_fn(|_| next());
                    for (knot, value) in at.iter().zip(&mut values) {
                        let (share, by_mean, by_width) = lobe.at(*knot, floor);
                        let moved = by_mean * mean + by_width * width;
                        (0..4).for_each(|c| value[c] += share * top[c] + moved * lobe.rgbs[c]);
                    }
                }
            }
            Self::Identity { .. } => {
                let [r, g, b] = std::array::from_fn(|_| next());
                values.fill([r, g, b, 0.0]);
            }
            Self::Labels { classes } => {
                let by: Vec<Rgbs> = classes.iter().map(|_| std::array::from_fn(|_| next())).collect();
                for (value, (_, class)) in values.iter_mut().zip(label_knots(classes)) {
                    *value = class.map_or([0.0; 4], |class| by[class]);
                }
            }
        }
        Ok(table.tangent(&knots, &values))
    }

    /// Derivatives of a loss with respect to the parameters, in the order of [`Transfer::parameters`], from those with
    /// respect to the table.
    ///
    /// # Errors
    /// The conditions are those of [`Table::new`].
    pub fn chain(&self, gradient: &TableGradient) -> Result<Vec<f64>> {
        let by_value = gradient.by_value();
        Ok(match self {
            Self::Texture { .. } => by_value.into_iter().flatten().collect(),
            Self::Piecewise { .. } => {
                let by_knot = gradient.by_knot(&self.table()?);
                by_knot.into_iter().zip(by_value).flat_map(|(d, [r, g, b, s])| [d, r, g, b, s]).collect()
            }
            Self::Gaussians { domain, lobes } => {
                let (knots, floor) = gaussian_knots(*domain);
                let of = |lobe: &Lobe| {
                    let mut all = [0.0; 6];
                    for (knot, by_value) in knots.iter().zip(&by_value) {
                        let (share, by_mean, by_width) = lobe.at(*knot, floor);
                        let pull: f64 = lobe.rgbs.iter().zip(by_value).map(|(top, g)| top * g).sum();
                        all[0] += pull * by_mean;
                        all[1] += pull * by_width;
                        all[2..].iter_mut().zip(by_value).for_each(|(a, g)| *a += share * g);
                    }
                    all
                };
                lobes.iter().flat_map(of).collect()
            }
            Self::Identity { .. } => (0..3).map(|c| by_value.iter().map(|v| v[c]).sum()).collect(),
            Self::Labels { classes } => {
                let mut all = vec![0.0; 4 * classes.len()];
                for (by, (_, class)) in by_value.iter().zip(label_knots(classes)) {
                    let Some(class) = class else { continue };
                    all[4 * class..][..4].iter_mut().zip(by).for_each(|(all, by)| *all += by);
                }
                all
            }
        })
    }
}

/// Returns the knots of the steps between classes, each with the number of the class whose values it has; `None`
/// between labels that do not follow each other.
fn label_knots(classes: &[Class]) -> impl Iterator<Item = (f64, Option<usize>)> {
    let follows = |i: usize| {
        let [this, next] = [classes.get(i), classes.get(i + 1)].map(|class| class.map(|class| class.label));
        next.is_some() && next == this.map(|label| label + 1)
    };
    classes.iter().enumerate().flat_map(move |(i, class)| {
        let [low, high] = [-0.5, 0.5].map(|half| f64::from(class.label) + half);
        // A step is two knots: that above the last of two labels in turn is the one below the next.
        let begin = [(!(i > 0 && follows(i - 1))).then_some((low, None)), Some((low, Some(i)))];
        let end = [Some((high, Some(i))), (!follows(i)).then_some((high, None))];
        begin.into_iter().chain(end).flatten()
    })
}

/// Knots of a tabulated sum of Gaussians over a domain, and the least standard deviation of a lobe.
fn gaussian_knots([low, high]: [f64; 2]) -> (Vec<f64>, f64) {
    let cell = (high - low) / GAUSSIAN_CELLS as f64;
    ((0..=GAUSSIAN_CELLS).map(|i| low + i as f64 * cell).collect(), 0.5 * cell)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    fn all() -> Vec<Transfer> {
        let rgbs = |v: f64| [v, 1.0 - v, 0.5 * v, 2.0 * v];
        vec![
            Transfer::Texture { domain: [0.0, 2.0], texels: [0.1, 0.9, 0.4, 0.7].map(rgbs).to_vec() },
            Transfer::Piecewise {
                points: [(0.1, 0.2), (0.5, 0.9), (1.5, 0.3)].map(|(d, v)| [d, v, 0.5, 1.0 - v, 3.0 * v]).to_vec(),
            },
            Transfer::Gaussians {
                domain: [0.0, 2.0],
                lobes: vec![
                    Lobe { mean: 0.6, ln_width: -2.0, rgbs: [1.0, 0.2, 0.1, 3.0] },
                    Lobe { mean: 1.4, ln_width: -1.0, rgbs: [0.1, 0.5, 0.9, 1.0] },
                ],
            },
            Transfer::Identity { domain: [0.0, 2.0], color: [0.3, 0.6, 0.9] },
            Transfer::Labels { classes: vec![class(-1), class(0), class(2)] },
        ]
    }

    fn class(label: i32) -> Class {
        let v = 0.3 + 0.2 * f64::from(label);
        Class { label, name: String::new(), rgbs: [v, 0.5 * v, 1.0 - v, 2.0 + v] }
    }

    #[test]
    fn labels_have_their_values_and_others_are_clear() {
        let transfer = Transfer::Labels { classes: vec![class(-1), class(0), class(2)] }.checked().unwrap();
        let table = transfer.table().unwrap();
        assert!(table.is_categorical() && table.simplified(0.0).is_categorical());
        assert_eq!(table.knots(), [-1.5, -1.5, -0.5, -0.5, 0.5, 0.5, 1.5, 1.5, 2.5, 2.5]);
        for label in -3..5 {
            let wanted = if [-1, 0, 2].contains(&label) { class(label).rgbs } else { [0.0; 4] };
            assert_eq!(table.at(f64::from(label)), wanted, "{label}");
            assert_eq!(table.at(f64::from(label) + 0.4), wanted, "{label}");
        }
        for bad in [vec![class(2), class(2)], vec![class(3), class(-7)], vec![class(1 << 23)], vec![]] {
            assert!(Transfer::Labels { classes: bad }.checked().is_err());
        }
    }

    /// A loss with known derivatives with respect to the pieces: a weighted sum of samples of the table.
    fn loss(t: &Transfer) -> (f64, TableGradient) {
        let table = t.table().unwrap();
        let mut gradient = TableGradient::zeros(&table);
        let mut sum = 0.0;
        for i in 0..57 {
            let d = -0.1 + 0.041 * f64::from(i);
            let piece = table.piece(d);
            let ([low, high], _) = table.ends(piece);
            let f = ((d - low) / (high - low)).clamp(0.0, 1.0);
            let f = if f.is_finite() { f } else { f64::from(u8::from(piece == 0)) };
            for c in 0..4 {
                let w = (f64::from(i) + 1.3 * c as f64).sin();
                sum += w * table.at(d)[c];
                gradient.pieces[piece][0][c] += w * (1.0 - f);
                gradient.pieces[piece][1][c] += w * f;
            }
        }
        (sum, gradient)
    }

    #[test]
    fn the_chain_rule_matches_central_differences() {
        for t in all() {
            let chained = t.chain(&loss(&t).1).unwrap();
            let parameters = t.parameters();
            assert_eq!(chained.len(), parameters.len());
            for (i, (name, value)) in parameters.iter().enumerate() {
                let at = |h: f64| {
                    let mut p: Vec<f64> = parameters.iter().map(|p| p.1).collect();
                    p[i] = value + h;
                    loss(&t.with_parameters(&p)).0
                };
                let difference = (at(1e-6) - at(-1e-6)) / 2e-6;
                assert!(
                    (difference - chained[i]).abs() < 1e-6 * (1.0 + difference.abs()),
                    "{name} {difference} {}",
                    chained[i]
                );
            }
        }
    }

    /// Push and chain are transposes: `⟨J v, w⟩ = ⟨v, Jᵀ w⟩`; the outermost pieces have one end alone.
    #[test]
    fn the_chain_is_the_transpose_of_the_push() {
        for t in all() {
            let w = loss(&t).1;
            let v: Vec<f64> = (0..t.parameters().len()).map(|i| (1.7 * i as f64).sin()).collect();
            let pushed = t.push(&v).unwrap();
            assert_eq!(pushed.pieces.len(), w.pieces.len());
            let pairs = pushed.pieces.iter().flatten().flatten().zip(w.pieces.iter().flatten().flatten());
            let left: f64 = pairs.map(|(a, b)| a * b).sum();
            let right: f64 = t.chain(&w).unwrap().iter().zip(&v).map(|(a, b)| a * b).sum();
            assert!((left - right).abs() < 1e-11 * (1.0 + left.abs()), "{t:?} {left} {right}");
        }
    }

    #[test]
    fn texels_lie_in_the_middle_of_their_shares() {
        let t = &all()[0];
        assert_eq!(t.table().unwrap().knots(), [0.25, 0.75, 1.25, 1.75]);
        assert_eq!(t.table().unwrap().at(1.0)[0], 0.65);
    }

    #[test]
    fn a_narrow_lobe_stays_visible_and_finite() {
        let t = Transfer::Gaussians {
            domain: [0.0, 1.0],
            lobes: vec![Lobe { mean: 0.5, ln_width: -90.0, rgbs: [1.0; 4] }],
        };
        let table = t.clone().checked().unwrap().table().unwrap();
        assert_eq!(table.peak(), [1.0; 4]);
        assert!(t.chain(&loss(&t).1).unwrap().iter().all(|v| v.is_finite()));
    }

    #[test]
    fn json_has_one_form_a_kind_and_unknown_words_are_refused() {
        for t in all() {
            let text = serde_json::to_string(&t).unwrap();
            assert_eq!(serde_json::from_str::<Transfer>(&text).unwrap(), t);
        }
        assert!(
            serde_json::from_str::<Transfer>(r#"{"kind":"identity","domain":[0,1],"color":[1,1,1],"x":1}"#).is_err()
        );
    }

    #[test]
    fn what_cannot_be_used_is_refused() {
        for (t, word) in [
            (Transfer::Texture { domain: [1.0, 1.0], texels: vec![[0.0; 4]] }, "ascend"),
            (Transfer::Texture { domain: [0.0, 1.0], texels: vec![] }, "0 entries"),
            (Transfer::Identity { domain: [-1.0, 1.0], color: [1.0; 3] }, "negative"),
            (
                Transfer::Gaussians {
                    domain: [0.0, 1.0],
                    lobes: vec![Lobe { mean: f64::NAN, ln_width: 0.0, rgbs: [0.0; 4] }],
                },
                "mean",
            ),
        ] {
            assert!(t.checked().unwrap_err().to_string().contains(word), "{word}");
        }
    }
}
