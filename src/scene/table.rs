//! Piecewise linear functions of the density, the only form of transfer function that renderers know. Knots are split
//! points of the quadrature.

use crate::error::{Error, Result};

/// Red, green and blue source radiance, and extinction per world unit.
pub type Rgbs = [f64; 4];

/// A piecewise linear function of the density, constant below the first knot and above the last.
/// Two knots at one density are a step, at which the function takes the upper knot's value.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    knots: Vec<f64>,
    values: Vec<Rgbs>,
    /// True if densities are labels, between which there are none.
    categorical: bool,
}

/// Derivatives of a loss with respect to a table's pieces, or a tangent of the pieces ([`Table::tangent`]).
/// A table of n knots has n + 1 pieces, the constant ones outside included.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TableGradient {
    /// Component for the values at the lower and at the upper end of each piece. The outermost pieces have one end: the
    /// first its upper, the last its lower.
    pub pieces: Vec<[Rgbs; 2]>,
    /// Component for the densities of knots at steps, by knot: the jump itself lies on no piece. For other knots the
    /// pieces suffice.
    pub steps: Vec<f64>,
}

impl Table {
    /// A table of ascending densities `knots` with one value each.
    ///
    /// # Errors
    /// If there is no knot, if the counts differ, if a number is not finite or a value is negative, or if the knots do
    /// not ascend (two may share a density, three may not).
    pub fn new(knots: Vec<f64>, values: Vec<Rgbs>) -> Result<Self> {
        if knots.is_empty() || knots.len() != values.len() {
            return Err(Error::invalid(format!(
                "{} knots with {} values: one each is needed",
                knots.len(),
                values.len()
            )));
        }
        if let Some(bad) = knots.iter().find(|k| !k.is_finite()) {
            return Err(Error::invalid(format!("a point lies at density {bad}: finite numbers are needed")));
        }
        if let Some(pair) = knots.windows(2).find(|k| k[1] < k[0]) {
            return Err(Error::invalid(format!("density {} comes after {}: points must ascend", pair[1], pair[0])));
        }
        if let Some(three) = knots.windows(3).find(|k| k[0] == k[2]) {
            return Err(Error::invalid(format!("three points at density {}: two make a step", three[0])));
        }
        for (knot, value) in knots.iter().zip(&values) {
            if let Some(bad) = value.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
                return Err(Error::invalid(format!(
                    "at density {knot} a value is {bad}: colors and extinction must be finite and not negative"
                )));
            }
        }
        Ok(Self { knots, values, categorical: false })
    }

    /// Returns the function as one of labels: volumes are looked up at the nearest voxel, and not interpolated.
    #[must_use]
    pub fn of_labels(self) -> Self {
        Self { categorical: true, ..self }
    }

    /// True if densities are labels.
    pub fn is_categorical(&self) -> bool {
        self.categorical
    }

    /// Returns the function with other values at its knots.
    ///
    /// # Errors
    /// If there is not one for each knot, or one cannot be used.
    pub fn with_values(&self, values: Vec<Rgbs>) -> Result<Self> {
        Ok(Self { categorical: self.categorical, ..Self::new(self.knots.clone(), values)? })
    }

    /// Returns the same function of densities that are differences to a reference.
    #[must_use]
    pub(crate) fn relative_to(&self, reference: f64) -> Self {
        Self { knots: self.knots.iter().map(|knot| knot - reference).collect(), ..self.clone() }
    }

    /// Densities of the knots, ascending.
    pub fn knots(&self) -> &[f64] {
        &self.knots
    }

    /// Values at the knots, in the order of [`Table::knots`].
    pub fn values(&self) -> &[Rgbs] {
        &self.values
    }

    /// Number of the piece that contains a density, which is the number of knots at or below it.
    pub fn piece(&self, density: f64) -> usize {
        self.knots.partition_point(|k| *k <= density)
    }

    /// Densities (infinite outside) and values at the lower and upper end of a piece.
    pub fn ends(&self, piece: usize) -> ([f64; 2], [Rgbs; 2]) {
        let last = self.knots.len() - 1;
        match piece {
            0 => ([f64::NEG_INFINITY, self.knots[0]], [self.values[0]; 2]),
            p if p > last => ([self.knots[last], f64::INFINITY], [self.values[last]; 2]),
            p => ([self.knots[p - 1], self.knots[p]], [self.values[p - 1], self.values[p]]),
        }
    }

    /// Value at a density.
    #[inline]
    pub fn at(&self, density: f64) -> Rgbs {
        let ([low, high], [a, b]) = self.ends(self.piece(density));
        if !(high - low).is_finite() {
            return a;
        }
        let f = (density - low) / (high - low);
        std::array::from_fn(|c| a[c] + f * (b[c] - a[c]))
    }

    /// Derivative with respect to the density: the one from above at knots, zero outside them.
    pub fn slope(&self, density: f64) -> Rgbs {
        self.slope_of(self.piece(density))
    }

    /// Derivative with respect to the density within a piece; zero where the piece is a step or lies outside the knots.
    pub(crate) fn slope_of(&self, piece: usize) -> Rgbs {
        let ([low, high], [a, b]) = self.ends(piece);
        let width = high - low;
        if width > 0.0 && width.is_finite() { std::array::from_fn(|c| (b[c] - a[c]) / width) } else { [0.0; 4] }
    }

    /// Returns the slope of a piece between knots that are rounded by `round`: of narrow pieces rounding changes it,
    /// and the values at the ends stay. Where the knots coincide it is 0, as no density lies between them.
    pub(crate) fn slope_between(&self, piece: usize, round: impl Fn(f64) -> f64) -> Rgbs {
        let (knots, [lower, upper]) = self.ends(piece);
        let [low, high] = knots.map(round);
        let width = high - low;
        if !width.is_finite() {
            return self.slope_of(piece);
        }
        let slope = |c: usize| if width > 0.0 { (upper[c] - lower[c]) / width } else { 0.0 };
        [slope(0), slope(1), slope(2), slope(3)]
    }

    /// Change of the values at the pieces' ends under a change of the knots' densities and values: the transpose of
    /// [`TableGradient::by_knot`] and [`TableGradient::by_value`].
    pub fn tangent(&self, knots: &[f64], values: &[Rgbs]) -> TableGradient {
        let last = self.knots.len() - 1;
        // A knot that moves takes its value along, so the value at the old density changes by the negative slope.
        let end = |piece: usize, knot: usize| -> Rgbs {
            let slope = self.slope_of(piece);
            std::array::from_fn(|c| values[knot][c] - slope[c] * knots[knot])
        };
        let pieces = (0..=last + 1).map(|p| [end(p, p.saturating_sub(1)), end(p, p.min(last))]);
        TableGradient { pieces: pieces.collect(), steps: knots.to_vec() }
    }

    /// Componentwise least and greatest value over a range of densities.
    pub fn bounds(&self, low: f64, high: f64) -> (Rgbs, Rgbs) {
        let mut least = self.at(low);
        let mut most = least;
        let inner = self.knots.partition_point(|k| *k < low)..self.knots.partition_point(|k| *k <= high);
        for value in self.values[inner].iter().chain([&self.at(high)]) {
            for c in 0..4 {
                least[c] = least[c].min(value[c]);
                most[c] = most[c].max(value[c]);
            }
        }
        (least, most)
    }

    /// Returns a density that is greater by next to nothing, in the unit of the table's knots.
    pub(crate) fn above(&self, density: f64) -> f64 {
        let (first, last) = (self.knots[0], self.knots[self.knots.len() - 1]);
        density + 1e-9 * (last - first).max(density.abs())
    }

    /// Returns the steepest slope over a range of densities, of the extinction and of the extinction times the color in
    /// units of `brightest`; infinite across a step.
    pub(crate) fn steepest(&self, low: f64, high: f64, brightest: f64) -> f64 {
        let steep = |piece: usize| {
            let ([from, to], [a, b]) = self.ends(piece);
            if to <= from {
                return if a == b { 0.0 } else { f64::INFINITY };
            }
            let slope = self.slope_of(piece);
            let color = slope[..3].iter().fold(0.0, |most: f64, slope| most.max(slope.abs())) / brightest;
            slope[3].abs().max(a[3].max(b[3]) * color)
        };
        (self.piece(low)..=self.piece(high)).map(steep).fold(0.0, f64::max)
    }

    /// Componentwise greatest value over all densities.
    pub fn peak(&self) -> Rgbs {
        self.bounds(self.knots[0], self.knots[self.knots.len() - 1]).1
    }

    /// The integral `∫ (σ r, σ g, σ b, σ) dd` over a range of densities, as pre-integration needs it; negative if the
    /// range runs downward.
    pub fn integral(&self, from: f64, to: f64) -> Rgbs {
        if to < from {
            return self.integral(to, from).map(|v| -v);
        }
        let mut sum = [0.0; 4];
        for piece in self.piece(from)..=self.piece(to) {
            let ([low, high], _) = self.ends(piece);
            let (a, b) = (from.max(low), to.min(high));
            if b <= a {
                continue;
            }
            // The integrand is a product of two linear functions, for which Simpson's rule is exact. The middle lies
            // inside the piece.
            let middle = self.at(0.5 * (a + b));
            let slope = self.slope_of(piece);
            let half = 0.5 * (b - a);
            let at = |offset: f64| -> Rgbs { std::array::from_fn(|c| middle[c] + offset * slope[c]) };
            let (near, far) = (at(-half), at(half));
            for c in 0..3 {
                sum[c] += half / 3.0 * (near[3] * near[c] + 4.0 * middle[3] * middle[c] + far[3] * far[c]);
            }
            sum[3] += 2.0 * half * middle[3];
        }
        sum
    }

    /// Returns the same extinctions without color.
    #[must_use]
    pub fn without_color(&self) -> Self {
        let values = self.values.iter().map(|[.., extinction]| [0.0, 0.0, 0.0, *extinction]).collect();
        Self { values, ..self.clone() }
    }

    /// Removes knots that change the table by at most `tolerance` times each channel's peak.
    /// The search is greedy: each piece is made as long as the knots that it skips allow. A tolerance of 0 removes only
    /// knots that lie on a line.
    #[must_use]
    pub fn simplified(&self, tolerance: f64) -> Self {
        let allowed = self.peak().map(|p| tolerance.max(4.0 * f64::EPSILON) * p);
        let n = self.knots.len();
        let (mut kept, mut from) = (vec![0], 0);
        while from + 1 < n {
            // Range of slopes, by channel, that pass all knots since `from` within the tolerance.
            let (mut least, mut most) = ([f64::NEG_INFINITY; 4], [f64::INFINITY; 4]);
            let mut to = from + 1;
            for next in from + 1..n {
                let width = self.knots[next] - self.knots[from];
                let rise: Rgbs = std::array::from_fn(|c| self.values[next][c] - self.values[from][c]);
                let passes = |c: usize| width > 0.0 && (least[c]..=most[c]).contains(&(rise[c] / width));
                if next > from + 1 && !(0..4).all(passes) {
                    // A piece may end only at a knot that its own line passes.
                    if width == 0.0 || (0..4).any(|c| least[c] > most[c]) {
                        break;
                    }
                } else {
                    to = next;
                }
                if width == 0.0 {
                    break;
                }
                for c in 0..4 {
                    least[c] = least[c].max((rise[c] - allowed[c]) / width);
                    most[c] = most[c].min((rise[c] + allowed[c]) / width);
                }
            }
            kept.push(to);
            from = to;
        }
        Self {
            knots: kept.iter().map(|i| self.knots[*i]).collect(),
            values: kept.iter().map(|i| self.values[*i]).collect(),
            ..*self
        }
    }
}

impl TableGradient {
    /// A zero gradient for the pieces and knots of a table.
    pub fn zeros(table: &Table) -> Self {
        Self::of_knots(table.knots.len())
    }

    /// A zero gradient for a table of `knots` knots.
    pub fn of_knots(knots: usize) -> Self {
        Self { pieces: vec![[[0.0; 4]; 2]; knots + 1], steps: vec![0.0; knots] }
    }

    /// Sets all derivatives to zero, for a table of so many knots.
    pub fn reset(&mut self, knots: usize) {
        self.pieces.clear();
        self.pieces.resize(knots + 1, [[0.0; 4]; 2]);
        self.steps.clear();
        self.steps.resize(knots, 0.0);
    }

    /// Returns the sum of the products of all derivatives with those of another of the same table.
    pub fn dot(&self, other: &Self) -> f64 {
        let pieces = self.pieces.iter().flatten().flatten().zip(other.pieces.iter().flatten().flatten());
        let steps = self.steps.iter().zip(&other.steps);
        pieces.chain(steps).map(|(a, b)| a * b).sum()
    }

    /// Adds another gradient of the same table.
    pub fn add(&mut self, other: &Self) {
        for (a, b) in self.pieces.iter_mut().flatten().flatten().zip(other.pieces.iter().flatten().flatten()) {
            *a += b;
        }
        for (a, b) in self.steps.iter_mut().zip(&other.steps) {
            *a += b;
        }
    }

    /// Derivatives with respect to the knots' values.
    pub fn by_value(&self) -> Vec<Rgbs> {
        self.pieces.windows(2).map(|p| std::array::from_fn(|c| p[0][1][c] + p[1][0][c])).collect()
    }

    /// Derivatives with respect to the knots' densities.
    /// At a step the two knots coincide; the derivatives given are those of separating them, and their sum is that of
    /// moving the step.
    pub fn by_knot(&self, table: &Table) -> Vec<f64> {
        let pull = |piece: usize, end: usize| -> f64 {
            table.slope_of(piece).iter().zip(self.pieces[piece][end]).map(|(s, g)| s * g).sum()
        };
        (0..table.knots.len()).map(|k| self.steps[k] - pull(k, 1) - pull(k + 1, 0)).collect()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn table() -> Table {
        let value = |v: f64| [v, 2.0 * v, 0.5, 1.0 + v];
        Table::new(vec![0.0, 0.25, 0.5, 0.5, 1.0], [0.0, 1.0, 0.5, 2.0, 0.0].map(value).to_vec()).unwrap()
    }

    #[test]
    fn values_are_linear_between_knots_and_clamped_outside() {
        let t = table();
        assert_eq!(t.at(-1.0), [0.0, 0.0, 0.5, 1.0]);
        assert_eq!(t.at(0.125), [0.5, 1.0, 0.5, 1.5]);
        assert_eq!(t.at(0.5), [2.0, 4.0, 0.5, 3.0], "the upper side of a step");
        assert_eq!(t.at(7.0), [0.0, 0.0, 0.5, 1.0]);
        assert_eq!((t.slope(-1.0), t.slope(7.0), t.slope(0.1)), ([0.0; 4], [0.0; 4], [4.0, 8.0, 0.0, 4.0]));
    }

    #[test]
    fn bounds_hold_and_are_met() {
        let t = table();
        let (least, most) = t.bounds(0.2, 0.6);
        assert_eq!((least[0], most[0]), (0.5, 2.0));
        assert_eq!(t.bounds(0.5, 0.5).0[0], 0.5, "a step's lower side counts");
        assert_eq!(t.peak()[3], 3.0);
    }

    #[test]
    fn what_is_no_function_is_refused() {
        let one = [[0.0; 4]; 3].to_vec();
        for (knots, values, word) in [
            (vec![], vec![], "0 knots"),
            (vec![0.0, 2.0, 1.0], one.clone(), "ascend"),
            (vec![1.0; 3], one.clone(), "step"),
            (vec![0.0, f64::NAN, 1.0], one, "finite"),
            (vec![0.0], vec![[0.0, 0.0, 0.0, -1.0]], "negative"),
        ] {
            assert!(Table::new(knots, values).unwrap_err().to_string().contains(word), "{word}");
        }
    }

    proptest! {
        #[test]
        fn integrals_add_up(a in -0.5..1.5_f64, b in -0.5..1.5_f64) {
            let t = table();
            let n = 20_000;
            let mut sum = [0.0; 4];
            for i in 0..n {
                let v = t.at(a + (b - a) * (f64::from(i) + 0.5) / f64::from(n));
                for c in 0..4 {
                    sum[c] += (b - a) / f64::from(n) * v[3] * if c < 3 { v[c] } else { 1.0 };
                }
            }
            let exact = t.integral(a, b);
            for c in 0..4 {
                prop_assert!((exact[c] - sum[c]).abs() < 1e-3, "{exact:?} {sum:?}");
            }
        }

        #[test]
        fn a_simplified_table_stays_within_the_tolerance(
            values in prop::collection::vec(0.0..1.0_f64, 2..40), tolerance in 0.0..0.3_f64, step in any::<bool>(),
        ) {
            let mut knots: Vec<f64> = (0..values.len()).map(|i| i as f64).collect();
            if step {
                knots[1] = 0.0;
            }
            let t = Table::new(knots, values.iter().map(|v| [*v, 1.0 - v, 0.0, v * v]).collect()).unwrap();
            let s = t.simplified(tolerance);
            let peak = t.peak();
            for (k, v) in t.knots.iter().zip(&t.values) {
                let (least, most) = s.bounds(*k, *k);
                for c in 0..4 {
                    let off = (v[c] - least[c]).abs().min((v[c] - most[c]).abs());
                    prop_assert!(off <= tolerance * peak[c] + 1e-12, "{off}");
                }
            }
        }
    }

    #[test]
    fn knots_on_a_line_are_dropped() {
        let line = |i: usize| [i as f64, 2.0, 0.0, 3.0 * i as f64];
        let t = Table::new((0..256).map(|i| i as f64 / 255.0).collect(), (0..256).map(line).collect()).unwrap();
        assert_eq!(t.simplified(0.0).knots(), [0.0, 1.0]);
        assert_eq!(table().simplified(0.0), table());
    }
}
