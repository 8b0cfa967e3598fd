//! Participating media: what a volume's density d does to light.
//!
//! The extinction coefficient is `σ_t = extinction · d` per world length, or `extinction · τ(d)` with a transfer
//! function; a chromatic medium has a share of it in each color channel. Of it the albedo ϖ is scattered, `σ_s = ϖ
//! σ_t`, and the rest absorbed, `σ_a = (1 - ϖ) σ_t`; the medium emits the radiance `σ_a c` per world length. The albedo
//! is one color, or that color times a function of the density.

use crate::error::{Error, Result};
use crate::scene::albedo::{AlbedoFunction, TransferColor};
use crate::scene::phase::Phase;
use crate::scene::table::Table;
use std::sync::Arc;

/// Source radiance `c` as a function of the density `d`, per color channel.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// Constant radiance: `c` is independent of the density, and absorption alone is `c = 0`. Without scattering
    /// the picture depends only on the optical depth: `L = c (1 - T) + T · background`.
    Grey([f32; 3]),
    /// Radiance proportional to the density, `c = color · d`.
    Linear([f32; 3]),
    /// Color and extinction as a piecewise linear function of the density, which is any value in the data's own units.
    /// Where the field has no voxels the density is its background; outside its domain the medium is empty.
    Transfer(Arc<Table>),
}

/// How a medium scatters light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scattering {
    /// Share of the extinction that is scattered, by channel: 0 to 1.
    pub albedo: [f32; 3],
    /// Distribution of the scattered directions.
    pub phase: Phase,
    /// Gradient shading: the gradient of the density per world length at which half of the scattering is that of a
    /// Lambertian surface across the gradient. Of a gradient of `r` times that much, the share is `r² / (1 + r²)`.
    /// `None` for scattering by the phase function alone.
    pub gradient_shading: Option<f64>,
    /// Standard deviation in voxels, 0 or more, of the filter that the gradients of gradient shading are taken through.
    pub gradient_scale: f64,
    /// Specular reflection of the surfaces of gradient shading; `None` for surfaces that are matt.
    pub specular: Option<Specular>,
}

/// Specular reflection of a rough surface: microfacets of the GGX distribution, whose light is white whatever the
/// albedo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Specular {
    /// Reflectance at normal incidence, above 0 and at most 1.
    pub reflectance: f64,
    /// Width α of the distribution of the microfacets' slopes, 0.05 to 1.
    pub roughness: f64,
}

impl Specular {
    /// Least and greatest roughness.
    pub const ROUGHNESS: [f64; 2] = [0.05, 1.0];
    /// Roughness unless stated.
    pub const USUAL_ROUGHNESS: f64 = 0.3;

    /// Returns the reflection of what settings and files state; `None` for a reflectance of 0.
    pub fn of(reflectance: f64, roughness: Option<f64>) -> Option<Self> {
        let roughness = roughness.unwrap_or(Self::USUAL_ROUGHNESS);
        (reflectance != 0.0).then_some(Self { reflectance, roughness })
    }

    /// Refuses numbers out of their ranges.
    fn check(self) -> Result<()> {
        let Self { reflectance, roughness } = self;
        let [least, most] = Self::ROUGHNESS;
        if !(reflectance > 0.0 && reflectance <= 1.0) {
            return Err(Error::invalid(format!("specular reflectance {reflectance} must lie between 0 and 1"))
                .hint("it is the share of the light that a surface reflects at normal incidence: 0.04 of plastic"));
        }
        if !(least..=most).contains(&roughness) {
            return Err(Error::invalid(format!("roughness {roughness} must lie between {least} and {most}"))
                .hint("it is the width of the distribution of the microfacets' slopes"));
        }
        Ok(())
    }
}

impl Scattering {
    /// Creates scattering by a phase function.
    pub const fn new(albedo: [f32; 3], phase: Phase) -> Self {
        Self { albedo, phase, gradient_shading: None, gradient_scale: 0.0, specular: None }
    }
}

/// A participating medium.
#[derive(Debug, Clone, PartialEq)]
pub struct Medium {
    /// Extinction per world length and unit of density, or per unit of the transfer function's extinction.
    pub extinction: f64,
    /// Share of that extinction by channel, 0 to 1; the largest is 1.
    pub color: [f32; 3],
    /// Radiance of the source.
    pub source: Source,
    /// Scattering; `None` for a medium that absorbs all it does not let through.
    pub scattering: Option<Scattering>,
    /// Color of the albedo by density, the factor of the albedo of `scattering`; `None` for 1 at every density.
    pub albedo_function: Option<Arc<AlbedoFunction>>,
}

impl Medium {
    /// Creates a medium that absorbs and emits.
    pub const fn new(extinction: f64, source: Source) -> Self {
        Self { extinction, color: [1.0; 3], source, scattering: None, albedo_function: None }
    }

    /// Creates a medium that only absorbs.
    pub fn absorbing(extinction: f64) -> Self {
        Self::new(extinction, Source::Grey([0.0; 3]))
    }

    /// Returns the medium with the extinctions and colors of a transfer function, whose albedo is `own` if it states
    /// one.
    ///
    /// # Errors
    /// If colors are to be an albedo and lie above 1.
    pub fn with_function(
        self,
        transfer: Table,
        own: Option<Arc<AlbedoFunction>>,
        color: TransferColor,
    ) -> Result<Self> {
        let bright = |e: Error| {
            e.part("the transfer function")
                .instead("⟨tf_color=emission⟩ takes the colors for radiances; or scale them to 0..1")
        };
        let albedo_function = match (color, own) {
            (TransferColor::Emission, _) => None,
            (_, Some(own)) => Some(own),
            (_, None) => Some(Arc::new(AlbedoFunction::of_colors(&transfer).map_err(bright)?)),
        };
        let dark = color == TransferColor::Albedo;
        let source = Source::Transfer(Arc::new(if dark { transfer.without_color() } else { transfer }));
        Ok(Self { source, albedo_function, ..self })
    }

    /// Returns the transfer function if it is one of labels.
    pub fn labels(&self) -> Option<&Table> {
        match &self.source {
            Source::Transfer(table) if table.is_categorical() => Some(table),
            _ => None,
        }
    }

    /// Returns the medium without the knots of its transfer function that change it by at most `tolerance` times each
    /// channel's peak.
    #[must_use]
    pub fn simplified(&self, tolerance: f64) -> Self {
        match &self.source {
            Source::Transfer(table) => {
                Self { source: Source::Transfer(Arc::new(table.simplified(tolerance))), ..self.clone() }
            }
            Source::Grey(_) | Source::Linear(_) => self.clone(),
        }
    }

    /// Returns the medium for densities that are stored as differences to a reference.
    #[must_use]
    pub(crate) fn relative_to(self, reference: f64) -> Self {
        match &self.source {
            Source::Transfer(table) if reference != 0.0 => {
                Self { source: Source::Transfer(Arc::new(table.relative_to(reference))), ..self }
            }
            _ => self,
        }
    }

    /// Returns the medium with extinctions by channel in place of the one extinction, `extinction` times `by`.
    ///
    /// # Errors
    /// If a factor is negative or not finite, or all are 0.
    pub fn chromatic(self, by: [f32; 3]) -> Result<Self> {
        let most = by.into_iter().fold(0.0, f32::max);
        if by.iter().any(|v| !(v.is_finite() && *v >= 0.0)) || most == 0.0 {
            return Err(Error::invalid(format!(
                "extinction color {by:?} must be finite and not negative, and not black"
            ))
            .hint("it multiplies the extinction in red, green and blue: 1,1,1 leaves it as it is"));
        }
        Ok(Self { extinction: self.extinction * f64::from(most), color: by.map(|v| v / most), ..self })
    }

    /// True if the extinction differs between channels.
    pub(crate) fn is_chromatic(&self) -> bool {
        self.color != [1.0; 3]
    }

    /// Returns the medium that absorbs in every channel what this one takes from a ray in the channel of most
    /// extinction.
    pub(crate) fn densest_channel(&self) -> Self {
        Self { color: [1.0; 3], scattering: None, albedo_function: None, ..self.clone() }
    }

    /// Returns the medium if its numbers can be used.
    ///
    /// # Errors
    /// If the extinction is not positive and finite, shares of channels are not as stated, a source radiance is
    /// negative or not finite, or scattering is not physical.
    pub fn checked(self) -> Result<Self> {
        if !(self.extinction > 0.0 && self.extinction.is_finite()) {
            return Err(Error::invalid(format!("extinction {} must be positive and finite", self.extinction))
                .hint("correct ⟨density_scale⟩, or the capture's density_scale"));
        }
        if self.color.iter().any(|v| !(0.0..=1.0).contains(v)) || !self.color.contains(&1.0) {
            return Err(Error::invalid(format!(
                "extinction color {:?} must have 1 as its largest channel",
                self.color
            ))
            .hint("let `Medium::chromatic` take the largest into the extinction"));
        }
        if let Source::Grey(c) | Source::Linear(c) = &self.source
            && c.iter().any(|v| !(v.is_finite() && *v >= 0.0))
        {
            return Err(Error::invalid(format!("source radiance {c:?} must be finite and not negative"))
                .hint("correct ⟨emission⟩, or the capture's emission"));
        }
        if let Some(Scattering { albedo, phase, gradient_shading, gradient_scale, specular }) = self.scattering {
            if !(gradient_scale >= 0.0 && gradient_scale.is_finite()) {
                return Err(Error::invalid(format!("gradient scale {gradient_scale} must be finite and not negative"))
                    .hint("it is the width in voxels of the filter that gradients are taken through"));
            }
            if albedo.iter().any(|v| !(0.0..=1.0).contains(v)) {
                return Err(Error::invalid(format!("albedo {albedo:?} must lie between 0 and 1"))
                    .hint("the albedo is the share of the extinction that is scattered; more would make light"));
            }
            phase.check()?;
            if let Some(half) = gradient_shading.filter(|half| !(*half > 0.0 && half.is_finite())) {
                return Err(Error::invalid(format!("gradient shading at {half} must be positive and finite")).hint(
                    "it is the change of the density per world length at which half of the scattering is a surface's",
                ));
            }
            if let Some(specular) = specular {
                specular.check()?;
                if gradient_shading.is_none() {
                    return Err(Error::invalid("a specular reflection without surfaces")
                        .hint("⟨gradient_shading⟩ makes surfaces where the density changes"));
                }
            }
        }
        Ok(self)
    }

    /// True if light is scattered at all.
    pub fn scatters(&self) -> bool {
        self.albedo_bounds()[1] != [0.0; 3]
    }

    /// Returns the least and the greatest share that is scattered, over all densities and directions, by channel.
    pub(crate) fn albedo_bounds(&self) -> [[f32; 3]; 2] {
        let [least, most] = self.matt_albedo_bounds();
        // At grazing incidence all may be reflected.
        let shines = self.scattering.is_some_and(|scattering| scattering.specular.is_some());
        [least, if shines { [1.0; 3] } else { most }]
    }

    /// Returns the least and the greatest albedo over all densities, by channel.
    fn matt_albedo_bounds(&self) -> [[f32; 3]; 2] {
        let albedo = self.scattering.map_or([0.0; 3], |scattering| scattering.albedo);
        let times = |color: [f64; 3]| [0, 1, 2].map(|c| albedo[c] * color[c] as f32);
        self.albedo_function.as_ref().map_or([albedo; 2], |function| function.bounds().map(times))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn media_that_make_light_are_refused() {
        let of = |albedo, phase| Medium { scattering: Some(Scattering::new(albedo, phase)), ..Medium::absorbing(1.0) };
        assert!(of([1.0, 0.5, 0.0], Phase::Isotropic).checked().unwrap().scatters());
        assert!(!of([0.0; 3], Phase::Isotropic).checked().unwrap().scatters());
        for albedo in [[1.01, 0.0, 0.0], [0.0, -0.1, 0.0], [0.0, 0.0, f32::NAN]] {
            assert!(of(albedo, Phase::Isotropic).checked().unwrap_err().to_string().contains("albedo"));
        }
        assert!(of([0.5; 3], Phase::HenyeyGreenstein(1.0)).checked().unwrap_err().to_string().contains("anisotropy"));
        assert!(Medium::absorbing(f64::NAN).checked().is_err() && Medium::absorbing(0.0).checked().is_err());
        let red = Medium::absorbing(2.0).chromatic([0.5, 0.25, 0.0]).unwrap();
        assert_eq!((red.extinction, red.color), (1.0, [1.0, 0.5, 0.0]));
        assert!(red.is_chromatic() && !red.densest_channel().is_chromatic() && red.clone().checked().is_ok());
        for color in [[0.0; 3], [1.0, -0.1, 0.0], [f32::INFINITY, 0.0, 0.0]] {
            assert!(Medium::absorbing(1.0).chromatic(color).unwrap_err().to_string().contains("extinction color"));
        }
        assert!(Medium { color: [0.5; 3], ..Medium::absorbing(1.0) }.checked().is_err());
        let shaded = |half| Scattering { gradient_shading: Some(half), ..Scattering::new([0.5; 3], Phase::Isotropic) };
        for half in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let medium = Medium { scattering: Some(shaded(half)), ..Medium::absorbing(1.0) };
            assert!(medium.checked().unwrap_err().to_string().contains("gradient shading"));
        }
        let function = Some(Arc::new(AlbedoFunction::new(&[[0.0, 0.0, 0.25, 0.0], [1.0, 0.5, 0.75, 0.0]]).unwrap()));
        let colored = Medium { albedo_function: function, ..of([0.5, 1.0, 1.0], Phase::Isotropic) };
        assert_eq!(colored.albedo_bounds(), [[0.0, 0.25, 0.0], [0.25, 0.75, 0.0]]);
        assert!(colored.scatters() && colored.densest_channel() == Medium::absorbing(1.0));
        assert!(!Medium { scattering: Some(Scattering::new([0.0, 0.0, 1.0], Phase::Isotropic)), ..colored }.scatters());
        for (reflectance, roughness, word) in [(0.0, 0.3, "reflectance"), (1.1, 0.3, "1.1"), (0.5, 0.01, "0.01")] {
            let specular = Some(Specular { reflectance, roughness });
            let medium = Medium { scattering: Some(Scattering { specular, ..shaded(1.0) }), ..Medium::absorbing(1.0) };
            assert!(medium.checked().unwrap_err().to_string().contains(word));
        }
        let specular = Some(Specular { reflectance: 0.04, roughness: 0.3 });
        let shiny = |half| Medium {
            scattering: Some(Scattering {
                specular,
                gradient_shading: half,
                ..Scattering::new([0.0; 3], Phase::Isotropic)
            }),
            ..Medium::absorbing(1.0)
        };
        assert!(shiny(Some(1.0)).checked().unwrap().scatters());
        assert!(shiny(None).checked().unwrap_err().to_string().contains("without surfaces"));
        let dark = Medium::new(1.0, Source::Linear([-1.0, 0.0, 0.0]));
        assert!(dark.checked().unwrap_err().to_string().contains("not negative"));
    }
}
