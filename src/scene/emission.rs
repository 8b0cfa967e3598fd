//! Emission by grids of its own: fire, whose light does not depend on the density of the smoke around it.

use crate::error::{Error, Result};
use crate::scene::bricks::{BRICK, Bricks, Topology};
use glam::{DMat3, DVec3, Vec3, Vec4};
use rayon::prelude::*;
use std::f64::consts::PI;
use std::sync::{Arc, OnceLock};

/// How the values of a grid emit light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Emission {
    /// The radiance emitted per world length is this times the value.
    Linear(Vec3),
    /// The value is a temperature, and the medium emits as a black body.
    Blackbody {
        /// Kelvin per unit of the grid.
        kelvin: f64,
        /// Factor of the light, by channel.
        color: Vec3,
    },
}

impl Emission {
    /// Returns the emission if its numbers can be used.
    ///
    /// # Errors
    /// If a factor is negative or not finite.
    pub fn checked(self) -> Result<Self> {
        let (Self::Linear(color) | Self::Blackbody { color, .. }) = self;
        let kelvin = if let Self::Blackbody { kelvin, .. } = self { kelvin } else { 1.0 };
        if !(color.is_finite() && color.min_element() >= 0.0 && kelvin.is_finite() && kelvin >= 0.0) {
            return Err(Error::invalid(format!(
                "emission of {color}, {kelvin} K a unit must be finite and not negative"
            ))
            .hint("correct the color, the intensity or the kelvins per unit"));
        }
        Ok(self)
    }

    /// Returns the radiance emitted per world length where the grid has a value.
    pub fn at(&self, value: f32) -> Vec3 {
        match self {
            Self::Linear(color) => *color * value,
            Self::Blackbody { kelvin, color } => *color * blackbody(kelvin * f64::from(value)).as_vec3(),
        }
    }
}

/// Emission of a volume by grids.
#[derive(Debug, Clone)]
pub struct Emitted {
    grid: Bricks<Vec4>,
    strength: OnceLock<Bricks<f32>>,
}

impl Emitted {
    /// Creates the emission of a volume from the radiance emitted per world length in red, green and blue, and the
    /// extinction per world length, as [`volume`] returns them.
    pub fn new(grid: Bricks<Vec4>) -> Self {
        Self { grid, strength: OnceLock::new() }
    }

    /// Returns the radiance emitted per world length, in red, green and blue, with the extinction per world length.
    pub fn grid(&self) -> &Bricks<Vec4> {
        &self.grid
    }

    /// Returns the mean of the emitted channels; the first call computes it.
    pub fn strength(&self) -> &Bricks<f32> {
        self.strength.get_or_init(|| Bricks {
            topology: self.grid.topology.clone(),
            values: self.grid.values.par_iter().map(|v| v.truncate().element_sum() / 3.0).collect(),
            background: 0.0,
            reference: 0.0,
            transform: self.grid.transform,
            domain: self.grid.domain,
        })
    }
}

/// Returns a volume's emission and extinction at its voxels: the sum of the emission of all grids in red, green and
/// blue, and `extinction` times the density. The grids lie on the lattice of the density.
///
/// # Errors
/// If there are too many bricks, or a radiance is too large.
pub fn volume(density: &Bricks<f32>, extinction: f64, grids: &[(Bricks<f32>, Emission)]) -> Result<Bricks<Vec4>> {
    let fields = grids.iter().map(|(field, _)| field).chain([density]);
    let bricks = fields.flat_map(|field| field.topology.bricks().iter().copied());
    let topology = Arc::new(Topology::new(bricks)?);
    let mut volume = Bricks::<Vec4>::zeros(topology.clone(), density.transform);
    volume.values.par_chunks_mut(BRICK).zip(topology.bricks().par_iter()).for_each(|(out, brick)| {
        if let Some(values) = density.brick(*brick) {
            out.iter_mut().zip(values).for_each(|(v, d)| v.w = (extinction * f64::from(*d)) as f32);
        }
        for (field, emission) in grids {
            if let Some(values) = field.brick(*brick) {
                out.iter_mut().zip(values).for_each(|(v, value)| *v += emission.at(*value).extend(0.0));
            }
        }
    });
    if volume.values.par_iter().all(|v| v.is_finite()) {
        return Ok(volume);
    }
    Err(Error::invalid("emission or extinction is too large for single precision")
        .hint("correct the temperatures, the kelvins per unit or the intensity"))
}

/// Temperature in K below which black bodies keep the color of this temperature, as in Blender.
const COOLEST: f64 = 800.0;

/// Returns what a black body of a temperature in K emits per world length: 1e-6 of its radiance `σ T⁴ / π` in W m⁻²
/// sr⁻¹ (Stefan-Boltzmann) in the color of its spectrum, whose luminance is 1. These are Blender's units. Colors
/// outside of the gamut of Rec. 709 are moved to its border.
pub fn blackbody(temperature: f64) -> DVec3 {
    const STEFAN_BOLTZMANN: f64 = 5.670_374_419e-8;
    color(temperature.max(COOLEST)) * (1e-6 * STEFAN_BOLTZMANN / PI * temperature.powi(4))
}

/// Returns the color of Planck's spectrum at a temperature in K in linear Rec. 709, of luminance 1.
pub fn color(temperature: f64) -> DVec3 {
    /// Second radiation constant in nm K.
    const RADIATION: f64 = 1.438_776_877e7;
    let mut xyz = DVec3::ZERO;
    for (step, observer) in (0_u8..).zip(OBSERVER) {
        let wavelength = 380.0 + 10.0 * f64::from(step);
        // Relative to 560 nm, so that no temperature overflows.
        let exponent = |wavelength: f64| RADIATION / (wavelength * temperature);
        let (here, middle) = (exponent(wavelength), exponent(560.0));
        let ratio = (middle - here).exp() * -(-middle).exp_m1() / -(-here).exp_m1();
        xyz += DVec3::from_array(observer) * ((560.0 / wavelength).powi(5) * ratio);
    }
    let rec709 = DMat3::from_cols(
        DVec3::new(3.240_454_2, -0.969_266, 0.055_643_4),
        DVec3::new(-1.537_138_5, 1.876_010_8, -0.204_025_9),
        DVec3::new(-0.498_531_4, 0.041_556, 1.057_225_2),
    );
    (rec709 * (xyz / xyz.y)).max(DVec3::ZERO)
}

/// Color matching functions of the CIE 1931 standard observer from 380 nm on in steps of 10 nm (CIE 015).
const OBSERVER: [[f64; 3]; 41] = [
    [0.001368, 3.9e-05, 0.00645],
    [0.004243, 0.00012, 0.02005],
    [0.01431, 0.000396, 0.06785],
    [0.04351, 0.00121, 0.2074],
    [0.13438, 0.004, 0.6456],
    [0.2839, 0.0116, 1.3856],
    [0.34828, 0.023, 1.74706],
    [0.3362, 0.038, 1.77211],
    [0.2908, 0.06, 1.6692],
    [0.19536, 0.09098, 1.28764],
    [0.09564, 0.13902, 0.81295],
    [0.03201, 0.20802, 0.46518],
    [0.0049, 0.323, 0.272],
    [0.0093, 0.503, 0.1582],
    [0.06327, 0.71, 0.07825],
    [0.1655, 0.862, 0.04216],
    [0.2904, 0.954, 0.0203],
    [0.43345, 0.99495, 0.00875],
    [0.5945, 0.995, 0.0039],
    [0.7621, 0.952, 0.0021],
    [0.9163, 0.87, 0.00165],
    [1.0263, 0.757, 0.0011],
    [1.0622, 0.631, 0.0008],
    [1.0026, 0.503, 0.00034],
    [0.85445, 0.381, 0.00019],
    [0.6424, 0.265, 5e-05],
    [0.4479, 0.175, 2e-05],
    [0.2835, 0.107, 0.0],
    [0.1649, 0.061, 0.0],
    [0.0874, 0.032, 0.0],
    [0.04677, 0.017, 0.0],
    [0.0227, 0.00821, 0.0],
    [0.011359, 0.004102, 0.0],
    [0.00579, 0.002091, 0.0],
    [0.002899, 0.001047, 0.0],
    [0.00144, 0.00052, 0.0],
    [0.00069, 0.000249, 0.0],
    [0.000332, 0.00012, 0.0],
    [0.000166, 6e-05, 0.0],
    [8.3e-05, 3e-05, 0.0],
    [4.2e-05, 1.5e-05, 0.0],
];

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// A black body of 5000 K sends out 16 times the light of one of 2500 K; those that are hot beyond measure are
    /// blue.
    #[test]
    fn black_bodies_have_their_colors() {
        // The colors that Blender's node has, where none of them is negative.
        for (temperature, expected) in [
            (2500.0, DVec3::new(2.068, 0.7695, 0.1395)),
            (4000.0, DVec3::new(1.4143, 0.9238, 0.5338)),
            (6504.0, DVec3::new(1.0424, 0.9842, 1.0361)),
        ] {
            let found = color(temperature);
            assert!((found - expected).abs().max_element() < 0.003, "{temperature} K: {found}");
        }
        let luminance = |c: DVec3| c.dot(DVec3::new(0.212_6, 0.715_2, 0.072_2));
        let ratio = luminance(blackbody(5000.0)) / luminance(blackbody(2500.0));
        assert!((ratio - 16.0).abs() < 0.05, "{ratio}");
        let hot = color(1e9);
        assert!(hot.is_finite() && hot.z > 1.5 && hot.x < 0.9, "{hot}");
        assert_eq!(blackbody(0.0), DVec3::ZERO);
        assert!((blackbody(600.0) / 16.0).abs_diff_eq(blackbody(300.0), 1e-12));
    }

    #[test]
    fn factors_are_checked() {
        assert!(Emission::Linear(Vec3::ONE).checked().is_ok());
        assert!(Emission::Linear(Vec3::new(-1.0, 0.0, 0.0)).checked().is_err());
        for kelvin in [-1.0, f64::NAN] {
            assert!(Emission::Blackbody { kelvin, color: Vec3::ONE }.checked().is_err());
        }
    }
}
