//! Surfaces that reflect: a specular lobe over a diffuse one.
//!
//! The specular lobe is `F D G / (4 µ µ')` times µ' (Cook & Torrance 1982), with the GGX distribution D of microfacets
//! (Walter et al. 2007), the height-correlated masking and shadowing G of Smith (Heitz 2014), and the reflectance F of
//! Schlick (1994). What it does not reflect, `1 - E(µ)` by its directional albedo E, is left to the diffuse lobe, which
//! is `(1 - E(µ)) (1 - E(µ')) / (π (1 - Ē))` with the mean Ē of E by cosine (Kelemen & Szirmay-Kalos 2001): it is
//! reciprocal, and both together reflect all light where the albedo is 1. Directions are drawn by the visible normals
//! (Heitz 2018, as Dupuy & Benyoub 2023 draw them).

use super::phase::{Mixed, PhaseFunction, Phases, Shaded};
use crate::scene::bricks::Bricks;
use crate::scene::directions::around;
use crate::scene::medium::{Scattering, Specular};
use glam::{DVec3, Vec3};
use std::f64::consts::{FRAC_1_PI, PI, TAU};

/// Pieces of the table of directional albedos, which is linear in the root of the cosine.
const PIECES: usize = 64;
/// Directions along each edge by which an entry is integrated.
const DIRECTIONS: u32 = 64;
/// Least share of a surface's directions that are drawn from the specular lobe: it may be brighter than a dark diffuse
/// one.
const LEAST: f64 = 0.25;

/// A specular lobe.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lobe {
    reflectance: f64,
    roughness: f64,
    /// Directional albedos.
    albedos: [f32; PIECES + 1],
    /// Mean of the directional albedos, weighted by the cosine.
    mean: f64,
}

impl Lobe {
    /// Prepares the lobe of a surface.
    pub(crate) fn new(Specular { reflectance, roughness }: Specular) -> Self {
        let mut lobe = Self { reflectance, roughness, albedos: [0.0; PIECES + 1], mean: 0.0 };
        for (i, albedo) in (0_u32..).zip(&mut lobe.albedos.clone()) {
            let root = f64::from(i) / PIECES as f64;
            *albedo = lobe.integrated(root * root) as f32;
            lobe.albedos[i as usize] = *albedo;
        }
        // 2 ∫ E µ dµ is 4 ∫ E r³ dr with the root r; Simpson's rule is exact for lines times cubes of each piece.
        let at = |root: f64| lobe.albedo(root * root) * root.powi(3);
        let width = 1.0 / PIECES as f64;
        let piece = |i: usize| {
            let low = i as f64 * width;
            width / 6.0 * (at(low) + 4.0 * at(low + 0.5 * width) + at(low + width))
        };
        lobe.mean = 4.0 * (0..PIECES).map(piece).sum::<f64>();
        lobe
    }

    /// Returns the directional albedo for a cosine of incidence, by quadrature over the visible normals.
    fn integrated(&self, cosine: f64) -> f64 {
        let incident = DVec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine);
        let even = |i: u32| (f64::from(i) + 0.5) / f64::from(DIRECTIONS);
        let mut sum = 0.0;
        for i in 0..DIRECTIONS * DIRECTIONS {
            let half = self.visible_normal(incident, [even(i % DIRECTIONS), even(i / DIRECTIONS)]);
            let reflected = 2.0 * incident.dot(half) * half - incident;
            let density = self.density(incident.z, half.z);
            if reflected.z > 0.0 && density > 0.0 {
                sum += self.value([incident.z, reflected.z], half.z, incident.dot(half)) / density;
            }
        }
        sum / f64::from(DIRECTIONS * DIRECTIONS)
    }

    /// Returns the directional albedo for a cosine of incidence.
    #[inline(always)]
    fn albedo(&self, cosine: f64) -> f64 {
        let place = cosine.clamp(0.0, 1.0).sqrt() * PIECES as f64;
        let piece = (place as usize).min(PIECES - 1);
        let [low, high] = [piece, piece + 1].map(|i| f64::from(self.albedos[i]));
        low + (place - piece as f64) * (high - low)
    }

    /// Draws a normal that is visible from a direction, both in the frame of the surface, by two numbers in [0, 1).
    #[inline(always)]
    fn visible_normal(&self, incident: DVec3, [u, v]: [f64; 2]) -> DVec3 {
        let wide = DVec3::new(self.roughness, self.roughness, 1.0);
        let from = (incident * wide).normalize();
        let height = (1.0 - u) * (1.0 + from.z) - from.z;
        let (sine, cosine) = (TAU * v).sin_cos();
        let across = (1.0 - height * height).max(0.0).sqrt();
        let half = DVec3::new(across * cosine, across * sine, height) + from;
        (half * wide).normalize_or(DVec3::Z)
    }

    /// Returns the distribution of the microfacets' normals for the cosine of one.
    #[inline(always)]
    fn distribution(&self, cosine: f64) -> f64 {
        let square = self.roughness * self.roughness;
        let root = cosine * cosine * (square - 1.0) + 1.0;
        square * FRAC_1_PI / (root * root)
    }

    /// Returns `√(α² + (1 - α²) µ²)`, of which Smith's masking of GGX is made.
    #[inline(always)]
    fn smith_root(&self, cosine: f64) -> f64 {
        let square = self.roughness * self.roughness;
        (square + (1.0 - square) * cosine * cosine).sqrt()
    }

    /// Returns the density of reflected directions that [`Lobe::visible_normal`] draws, by the cosines of incidence and
    /// of the normal.
    #[inline(always)]
    fn density(&self, cosine: f64, normal: f64) -> f64 {
        self.distribution(normal) / (2.0 * (cosine + self.smith_root(cosine)))
    }

    /// Returns the lobe times the cosine of reflection, by the cosines of incidence and reflection, of the normal, and
    /// of the incidence on it.
    #[inline(always)]
    fn value(&self, [incident, reflected]: [f64; 2], normal: f64, on_normal: f64) -> f64 {
        let fresnel = self.reflectance + (1.0 - self.reflectance) * (1.0 - on_normal).max(0.0).powi(5);
        let visible = 0.5 / (reflected * self.smith_root(incident) + incident * self.smith_root(reflected));
        fresnel * self.distribution(normal) * visible * reflected
    }
}

/// Phase functions by place of a medium with surfaces that reflect, or without.
#[derive(Clone, Copy)]
pub(super) struct Glossy {
    shaded: Shaded,
    lobe: Option<Lobe>,
}

impl Glossy {
    /// Returns the phase functions of a medium.
    pub(crate) fn new(shaded: Shaded, scattering: Option<Scattering>) -> Self {
        Self { shaded, lobe: scattering.and_then(|scattering| scattering.specular).map(Lobe::new) }
    }
}

impl Phases for Glossy {
    type At = Glossed;

    #[inline(always)]
    fn at(self, field: &Bricks<f32>, position: DVec3) -> Glossed {
        Glossed { mixed: self.shaded.at(field, position), lobe: self.lobe }
    }
}

/// A share of the scattering by a surface that may reflect, the rest by a phase function.
#[derive(Clone, Copy)]
pub(super) struct Glossed {
    mixed: Mixed,
    lobe: Option<Lobe>,
}

/// Densities per steradian of what scatters in a direction.
struct Parts {
    /// Density of the phase function and the diffuse lobe, of which the albedo is left.
    matt: f64,
    /// Density of the specular lobe.
    specular: f64,
    /// Density with which the direction is drawn.
    drawn: f64,
}

impl Glossed {
    /// Returns the share of a surface's directions that are drawn from the lobe.
    #[inline(always)]
    fn chance(albedo: f64) -> f64 {
        albedo.max(LEAST)
    }

    #[inline(always)]
    fn parts(&self, from: DVec3, to: DVec3) -> Parts {
        let Some(lobe) = &self.lobe else {
            let value = self.mixed.value(from, to);
            return Parts { matt: value, specular: 0.0, drawn: value };
        };
        let share = self.mixed.share();
        let phase = (1.0 - share) * self.mixed.phase().value(from.dot(to));
        let normal = self.mixed.facing(from);
        let [incident, reflected] = [-normal.dot(from), normal.dot(to)];
        let half = (to - from).normalize_or_zero();
        let (on_half, on_normal) = (normal.dot(half), -from.dot(half));
        let (albedo, mut drawn) = (lobe.albedo(incident), 0.0);
        let chance = Self::chance(albedo);
        if on_half > 0.0 {
            drawn += chance * lobe.density(incident, on_half);
        }
        if reflected <= 0.0 {
            return Parts { matt: phase, specular: 0.0, drawn: phase + share * drawn };
        }
        drawn += (1.0 - chance) * reflected * FRAC_1_PI;
        let left = (1.0 - albedo) * (1.0 - lobe.albedo(reflected)) / (1.0 - lobe.mean).max(f64::EPSILON);
        let specular = if on_half > 0.0 { lobe.value([incident, reflected], on_half, on_normal) } else { 0.0 };
        Parts {
            matt: phase + share * left * reflected * FRAC_1_PI,
            specular: share * specular,
            drawn: phase + share * drawn,
        }
    }
}

impl PhaseFunction for Glossed {
    const COLORED: bool = true;

    /// Returns the density with which directions are drawn.
    #[inline(always)]
    fn value(self, from: DVec3, to: DVec3) -> f64 {
        self.parts(from, to).drawn
    }

    #[inline(always)]
    fn sample(self, from: DVec3, [u, v]: [f64; 2]) -> (DVec3, f64) {
        let share = self.mixed.share();
        let Some(lobe) = self.lobe.as_ref().filter(|_| u < share) else {
            let (to, _) = self.mixed.sample(from, [u, v]);
            return (to, self.value(from, to));
        };
        let normal = self.mixed.facing(from);
        let cosine = -normal.dot(from);
        let (u, chance) = (u / share, Self::chance(lobe.albedo(cosine)));
        let to = if u < chance {
            let (x, y) = normal.any_orthonormal_pair();
            let incident = DVec3::new(-x.dot(from), -y.dot(from), cosine);
            let half = lobe.visible_normal(incident, [u / chance, v]);
            let half = x * half.x + y * half.y + normal * half.z;
            (from - 2.0 * from.dot(half) * half).normalize()
        } else {
            let square = ((u - chance) / (1.0 - chance)).clamp(0.0, 1.0);
            around(normal, square.sqrt(), (1.0 - square).max(0.0).sqrt(), v)
        };
        (to, self.value(from, to))
    }

    #[inline(always)]
    fn total(self, albedo: Vec3, from: DVec3) -> Vec3 {
        let Some(lobe) = &self.lobe else { return albedo };
        let reflected = (self.mixed.share() * lobe.albedo(-self.mixed.facing(from).dot(from))) as f32;
        albedo + (Vec3::ONE - albedo) * reflected
    }

    #[inline(always)]
    fn color(self, albedo: Vec3, from: DVec3, to: DVec3) -> Vec3 {
        let Parts { matt, specular, .. } = self.parts(from, to);
        albedo * matt as f32 + Vec3::splat(specular as f32)
    }

    #[inline(always)]
    fn tint(self, albedo: Vec3, from: DVec3, to: DVec3) -> Vec3 {
        let Parts { matt, specular, drawn } = self.parts(from, to);
        if drawn <= 0.0 {
            return Vec3::ZERO;
        }
        let total = self.total(albedo, from);
        let relative = (albedo * (matt / drawn) as f32 + Vec3::splat((specular / drawn) as f32)) / total;
        Vec3::select(total.cmpgt(Vec3::ZERO), relative, Vec3::ZERO)
    }
}

/// Returns an upper bound of what a surface scatters per steradian, whatever the directions.
pub(crate) fn peak(specular: Specular) -> f64 {
    let lobe = Lobe::new(specular);
    let least = lobe.albedos.iter().copied().fold(1.0, f32::min);
    let diffuse = (1.0 - f64::from(least)).powi(2) * FRAC_1_PI / (1.0 - lobe.mean).max(f64::EPSILON);
    // Of the distribution on its axis, and of the rest at grazing incidence.
    diffuse + 1.0 / (2.0 * PI * specular.roughness.powi(3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::phase::Phase;

    const LOBES: [Specular; 5] = [
        Specular { reflectance: 0.04, roughness: 0.05 },
        Specular { reflectance: 0.04, roughness: 0.3 },
        Specular { reflectance: 0.5, roughness: 0.2 },
        Specular { reflectance: 1.0, roughness: 0.6 },
        Specular { reflectance: 0.2, roughness: 1.0 },
    ];

    fn surface(specular: Specular, share: f64) -> Glossed {
        let mixed = Mixed::new(Phase::HenyeyGreenstein(0.4), DVec3::Z, share);
        Glossed { mixed, lobe: Some(Lobe::new(specular)) }
    }

    /// Directions towards a surface, from straight on to grazing.
    fn incident() -> impl Iterator<Item = DVec3> {
        [1.0_f64, 0.9, 0.6, 0.3, 0.1, 0.02].into_iter().map(|cosine| {
            let across = (1.0 - cosine * cosine).sqrt();
            DVec3::new(0.6 * across, -0.8 * across, -cosine)
        })
    }

    /// Sums over even numbers what `visit` tells of them.
    fn over<const N: usize>(edge: u32, mut visit: impl FnMut([f64; 2]) -> [f64; N]) -> [f64; N] {
        let mut sum = [0.0; N];
        for i in 0..edge * edge {
            let even = |i: u32| (f64::from(i) + 0.5) / f64::from(edge);
            let found = visit([even(i % edge), even(i / edge)]);
            sum.iter_mut().zip(found).for_each(|(sum, v)| *sum += v / f64::from(edge * edge));
        }
        sum
    }

    /// A white furnace: with albedo 1 all light is scattered, with albedo 0 what the specular lobe reflects.
    #[test]
    fn surfaces_reflect_all_light_and_no_more() {
        for specular in LOBES {
            for share in [0.4, 1.0] {
                let at = surface(specular, share);
                for from in incident() {
                    let [white, black, tinted] = over(300, |numbers| {
                        let (to, density) = at.sample(from, numbers);
                        let color = |albedo: f32| f64::from(at.color(Vec3::splat(albedo), from, to).x) / density;
                        let albedo = Vec3::splat(0.3);
                        let tinted = at.total(albedo, from) * at.tint(albedo, from, to);
                        [color(1.0), color(0.0), f64::from(tinted.x)]
                    });
                    let total = |albedo: f32| f64::from(at.total(Vec3::splat(albedo), from).x);
                    assert!((white - 1.0).abs() < 3e-3, "{specular:?} {share} {from}: {white}");
                    assert!((black - total(0.0)).abs() < 3e-3, "{specular:?} {share} {from}: {black}");
                    assert!((tinted - total(0.3)).abs() < 3e-3, "{specular:?} {share} {from}: {tinted}");
                    assert!(total(1.0) == 1.0 && total(0.0) < total(0.3));
                }
            }
        }
    }

    /// The density of directions integrates to 1 over the sphere, and is that by which they are drawn.
    #[test]
    fn directions_are_drawn_by_their_density() {
        for specular in LOBES.into_iter().skip(1) {
            for from in incident() {
                let at = surface(specular, 0.7);
                let of_sphere = over(1200, |[u, v]| {
                    let cosine = 2.0 * u - 1.0;
                    let to = around(DVec3::Z, cosine, (1.0 - cosine * cosine).sqrt(), v);
                    let value = at.value(from, to) * 4.0 * PI;
                    [value, value * to.x, value * to.y, value * to.z]
                });
                let drawn = over(400, |numbers| {
                    let (to, density) = at.sample(from, numbers);
                    assert!((density - at.value(from, to)).abs() < 1e-9 * density && density > 0.0);
                    [1.0, to.x, to.y, to.z]
                });
                for (a, b) in of_sphere.into_iter().zip(drawn) {
                    assert!((a - b).abs() < 6e-3, "{specular:?} {from}: {of_sphere:?} {drawn:?}");
                }
            }
        }
    }

    /// Light goes both ways alike, over the cosines; all of it is below the bound.
    #[test]
    fn surfaces_are_reciprocal_and_bounded() {
        let towards: Vec<DVec3> =
            incident().map(|from| DVec3::new(-from.y, 0.3 * from.x, -from.z).normalize()).collect();
        for specular in LOBES {
            let (at, bound) = (surface(specular, 1.0), peak(specular));
            for from in incident() {
                for to in &towards {
                    for albedo in [Vec3::ZERO, Vec3::new(0.9, 0.5, 0.1)] {
                        let there = at.color(albedo, from, *to) / to.z as f32;
                        let back = at.color(albedo, -*to, -from) / -from.z as f32;
                        assert!(
                            (there - back).abs().max_element() <= 1e-5 * (1.0 + there.max_element()),
                            "{there} {back}"
                        );
                    }
                }
                over(60, |numbers| {
                    let (to, _) = at.sample(from, numbers);
                    assert!(f64::from(at.color(Vec3::ONE, from, to).x) <= 1.0001 * bound);
                    [0.0]
                });
            }
        }
    }

    /// The lobe at normal incidence is that of the closed form: all of F, G and D are known on the axis.
    #[test]
    fn the_axis_has_a_closed_form() {
        for specular @ Specular { reflectance, roughness } in LOBES {
            let found = surface(specular, 1.0).color(Vec3::ZERO, -DVec3::Z, DVec3::Z).x;
            let expected = reflectance / (4.0 * PI * roughness * roughness);
            assert!((f64::from(found) / expected - 1.0).abs() < 1e-5, "{specular:?}: {found} {expected}");
        }
    }

    /// Directional albedos are those of a finer quadrature.
    #[test]
    fn tables_hold_the_directional_albedo() {
        for specular in LOBES {
            let lobe = Lobe::new(specular);
            for i in 0..40 {
                let cosine = (f64::from(i) + 0.5) / 40.0;
                let [found, expected] = [lobe.albedo(cosine), lobe.integrated(cosine)];
                assert!((found - expected).abs() < 1e-3, "{specular:?} {cosine}: {found} {expected}");
            }
            let mean = over(200, |[u, _]| [2.0 * u * lobe.albedo(u)])[0];
            assert!((lobe.mean - mean).abs() < 1e-3, "{specular:?}: {} {mean}", lobe.mean);
        }
    }
}
