//! Primaries of RGB, by which three numbers are a color.

use glam::{DMat3, DVec3};
use std::fmt;

/// CIE 1931 chromaticities x, y of red, green, blue and white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Primaries {
    /// Chromaticity of red.
    pub red: [f64; 2],
    /// Chromaticity of green.
    pub green: [f64; 2],
    /// Chromaticity of blue.
    pub blue: [f64; 2],
    /// Chromaticity of white, the color of equal numbers.
    pub white: [f64; 2],
}

/// Response of the cones in Bradford's model of chromatic adaptation, acting on XYZ (Lam 1985; ICC.1:2022, annex E).
const BRADFORD: DMat3 = DMat3::from_cols_array(&[
    0.8951, -0.7502, 0.0389, //
    0.2664, 1.7135, -0.0685, //
    -0.1614, 0.0367, 1.0296,
]);

/// Largest difference of chromaticities that are those of one space: files hold them rounded to some digits.
const ROUNDING: f64 = 1e-4;

impl Primaries {
    /// Primaries of ITU-R BT.709 and sRGB, which a file without a statement has.
    pub const REC_709: Self = Self { red: [0.64, 0.33], green: [0.3, 0.6], blue: [0.15, 0.06], white: [0.3127, 0.329] };

    /// Creates primaries from x and y of red, green, blue and white.
    pub fn of([rx, ry, gx, gy, bx, by, wx, wy]: [f64; 8]) -> Self {
        Self { red: [rx, ry], green: [gx, gy], blue: [bx, by], white: [wx, wy] }
    }

    fn all(&self) -> [[f64; 2]; 4] {
        [self.red, self.green, self.blue, self.white]
    }

    /// True if both are the same but for the rounding of files.
    pub fn is_same(&self, other: &Self) -> bool {
        let pairs = self.all().into_iter().flatten().zip(other.all().into_iter().flatten());
        pairs.into_iter().all(|(a, b)| (a - b).abs() <= ROUNDING)
    }

    /// Returns the matrix from RGB to XYZ, in which white has a luminance of 1; `None` if the primaries span no space.
    fn to_xyz(self) -> Option<DMat3> {
        let xyz = |[x, y]: [f64; 2]| DVec3::new(x / y, 1.0, (1.0 - x - y) / y);
        let primaries = DMat3::from_cols(xyz(self.red), xyz(self.green), xyz(self.blue));
        let determinant = primaries.determinant();
        let luminances = primaries.inverse() * xyz(self.white);
        let sound = determinant.is_finite() && determinant.abs() > 1e-9 && luminances.is_finite();
        sound.then(|| primaries * DMat3::from_diagonal(luminances))
    }

    /// Returns the matrix from linear RGB of these primaries to that of others. White becomes white, by Bradford's
    /// adaptation. `None` if either primaries span no space.
    pub fn matrix_to(self, other: Self) -> Option<DMat3> {
        let [from, to] = [self.to_xyz()?, other.to_xyz()?];
        let cones = [from, to].map(|matrix| BRADFORD * (matrix * DVec3::ONE));
        let adaptation = BRADFORD.inverse() * DMat3::from_diagonal(cones[1] / cones[0]) * BRADFORD;
        let matrix = to.inverse() * adaptation * from;
        matrix.is_finite().then_some(matrix)
    }
}

impl fmt::Display for Primaries {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_same(&Self::REC_709) {
            return f.write_str("Rec.709");
        }
        for (name, [x, y]) in ["red", ", green", ", blue", ", white"].into_iter().zip(self.all()) {
            write!(f, "{name} {x:.4},{y:.4}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// ACES2065-1 (SMPTE ST 2065-1).
    const ACES: Primaries =
        Primaries { red: [0.7347, 0.2653], green: [0.0, 1.0], blue: [0.0001, -0.077], white: [0.32168, 0.33767] };

    /// IEC 61966-2-1 states the matrix of sRGB to XYZ in four digits, and the Academy that of ACES to Rec.709 with
    /// Bradford's adaptation (OpenColorIO's built-in transform) in seven.
    #[test]
    fn matrices_are_those_of_the_standards() {
        let close = |matrix: DMat3, rows: [[f64; 3]; 3], digits: f64| {
            let expected = DMat3::from_cols_array_2d(&rows).transpose();
            let off = (matrix - expected).to_cols_array().into_iter().fold(0.0, |most: f64, v| most.max(v.abs()));
            assert!(off < digits, "{matrix} {off}");
        };
        let xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]];
        close(Primaries::REC_709.to_xyz().unwrap(), xyz, 6e-5);
        let aces = [[2.52169, -1.13413, -0.38756], [-0.27648, 1.37272, -0.09624], [-0.01538, -0.15298, 1.16835]];
        close(ACES.matrix_to(Primaries::REC_709).unwrap(), aces, 2e-4);
        let there_and_back = ACES.matrix_to(Primaries::REC_709).unwrap() * Primaries::REC_709.matrix_to(ACES).unwrap();
        close(there_and_back, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], 1e-12);
        let white = ACES.matrix_to(Primaries::REC_709).unwrap() * DVec3::ONE;
        assert!((white - DVec3::ONE).abs().max_element() < 1e-12, "{white}");
    }

    #[test]
    fn primaries_that_span_no_space_have_no_matrix() {
        let flat = Primaries { green: [0.64, 0.33], ..Primaries::REC_709 };
        let zero = Primaries::of([0.0; 8]);
        let nan = Primaries { white: [f64::NAN; 2], ..Primaries::REC_709 };
        for odd in [flat, zero, nan] {
            assert_eq!(odd.matrix_to(Primaries::REC_709), None, "{odd}");
            assert_eq!(Primaries::REC_709.matrix_to(odd), None, "{odd}");
        }
        // As an EXR holds them.
        let stored = Primaries::of([0.64_f32, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329].map(f64::from));
        assert!(stored.is_same(&Primaries::REC_709) && !ACES.is_same(&stored) && stored.to_string() == "Rec.709");
    }
}
