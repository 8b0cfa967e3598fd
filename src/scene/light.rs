//! Lights: what sends light into a scene beside its environment and its emitting media.
//!
//! Lights are not seen by cameras and cast no shadows themselves; only media attenuate them.

use super::ball::{Ball, Towards};
use super::cone::Cone;
use super::directions::{in_cone, solid_angle, towards};
use crate::error::{Error, Result};
use crate::math::{Aabb, Ray};
use glam::{DVec3, Vec3};
use std::f64::consts::{PI, TAU};

/// A light, with radiances and intensities in red, green and blue.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Light {
    /// A light infinitely far away: a disc on the sky, or a direction if its angle is 0.
    Sun {
        /// Unit vector towards the middle of the disc.
        direction: DVec3,
        /// Irradiance on a surface that faces the sun.
        irradiance: Vec3,
        /// Angle across the disc in radians, 0 to π.
        angle: f64,
    },
    /// A point that sends out light in all directions.
    Point {
        /// Position in world space.
        position: DVec3,
        /// Radiant intensity, power per solid angle.
        intensity: Vec3,
    },
    /// A sphere that emits outwards, the same in all directions.
    Sphere {
        /// Centre in world space.
        centre: DVec3,
        /// Radius in world units.
        radius: f64,
        /// Radiance that leaves the sphere.
        radiance: Vec3,
    },
    /// A disc that turns to whatever it lights and emits the same in all directions: Blender's point light with Soft
    /// Falloff. It lights from inside its radius as well.
    Disc {
        /// Centre in world space.
        centre: DVec3,
        /// Radius in world units.
        radius: f64,
        /// Radiance that leaves the disc.
        radiance: Vec3,
    },
    /// A point, a sphere or a turning disc whose light leaves in a cone.
    Spot {
        /// Position, or centre, in world space.
        position: DVec3,
        /// Radius in world units, 0 of a point.
        radius: f64,
        /// True of a disc as [`Light::Disc`], false of a sphere.
        soft: bool,
        /// Radiant intensity along the axis of the cone, as seen from far away.
        intensity: Vec3,
        /// Cone that light leaves in.
        cone: Cone,
    },
    /// A parallelogram that emits to one side, the same in all directions.
    Rectangle {
        /// Corner in world space.
        corner: DVec3,
        /// Edges from the corner. Light leaves to the side of `edges[0] × edges[1]`.
        edges: [DVec3; 2],
        /// Radiance that leaves the front.
        radiance: Vec3,
    },
}

/// Light that arrives at a point from a direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrival {
    /// Unit vector towards the light.
    pub direction: DVec3,
    /// World length to the light; infinite for a sun.
    pub distance: f64,
    /// Radiance along the direction; for lights without extent, irradiance on a surface that faces them.
    pub radiance: Vec3,
    /// Probability density per steradian with which [`Light::sample`] takes the direction; infinite for lights without
    /// extent, which no other direction meets.
    pub density: f64,
}

/// Upper bounds of the light that arrives anywhere in a box from one source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightBounds {
    /// Radiance from any direction; infinite for lights without extent.
    pub radiance: Vec3,
    /// Fluence rate, the integral of the radiance over all directions.
    pub fluence: Vec3,
}

impl Light {
    /// Returns the light if its numbers can be used; directions are normalised.
    ///
    /// # Errors
    /// If a radiance is negative, a number is not finite, or an extent is zero or negative.
    pub fn checked(self) -> Result<Self> {
        let bad = |what: String, hint: &str| Err(Error::invalid(what).hint(hint));
        let (Self::Sun { irradiance: power, .. }
        | Self::Point { intensity: power, .. }
        | Self::Sphere { radiance: power, .. }
        | Self::Disc { radiance: power, .. }
        | Self::Spot { intensity: power, .. }
        | Self::Rectangle { radiance: power, .. }) = self;
        if !(power.is_finite() && power.min_element() >= 0.0) {
            return bad(format!("light of {power} must be finite and not negative"), "correct the light's color");
        }
        match self {
            Self::Sun { direction, angle, .. } if !(direction.is_finite() && direction.length() > 0.0) => bad(
                format!("sun from {direction}, {angle} rad wide, has no direction"),
                "give a vector towards the sun",
            ),
            Self::Sun { angle, .. } if !(0.0..=PI).contains(&angle) => bad(
                format!("a sun {} degrees wide is not possible", angle.to_degrees()),
                "give an angle from 0 to 180 degrees (the sun's is 0.53)",
            ),
            Self::Sun { direction, irradiance, angle } => {
                Ok(Self::Sun { direction: direction.normalize(), irradiance, angle })
            }
            Self::Point { position, .. } if !position.is_finite() => {
                bad(format!("point light at {position}"), "give finite coordinates")
            }
            Self::Sphere { centre, radius, .. } | Self::Disc { centre, radius, .. }
                if !(centre.is_finite() && radius > 0.0 && radius.is_finite()) =>
            {
                bad(
                    format!("sphere light at {centre} with radius {radius}"),
                    "give finite coordinates and a positive radius, or use a point light",
                )
            }
            Self::Spot { position, radius, .. } if !(position.is_finite() && radius >= 0.0 && radius.is_finite()) => {
                bad(
                    format!("spot light at {position} with radius {radius}"),
                    "give finite coordinates and a radius from 0 on",
                )
            }
            Self::Rectangle { corner, edges: [u, v], .. }
                if !(corner.is_finite() && u.cross(v).is_finite() && u.cross(v).length() > 0.0) =>
            {
                bad(
                    format!("rectangle light at {corner} with edges {u} and {v}"),
                    "give finite coordinates and edges that are neither 0 nor parallel",
                )
            }
            light => Ok(light),
        }
    }

    /// Returns the kind of light in words.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Sun { .. } => "a sun",
            Self::Point { .. } => "a point light",
            Self::Sphere { .. } => "a sphere light",
            Self::Disc { .. } => "a sphere light with soft falloff",
            Self::Spot { .. } => "a spot light",
            Self::Rectangle { .. } => "a rectangle light",
        }
    }

    /// Returns upper bounds of the light that arrives in a box.
    pub fn bounds(&self, within: Aabb) -> LightBounds {
        let distance = |to: DVec3| (to.clamp(within.min, within.max) - to).length();
        let extended = |radiance: Vec3, solid_angle: f64| LightBounds {
            radiance,
            fluence: radiance * solid_angle.min(4.0 * PI) as f32,
        };
        match *self {
            Self::Sun { irradiance, angle, .. } => match half_sine_of_sun(angle) {
                0.0 => LightBounds { radiance: unlimited(irradiance), fluence: irradiance },
                half_sine => extended(irradiance / disc(half_sine) as f32, solid_angle(half_sine)),
            },
            Self::Point { position, intensity } => of_point(intensity, distance(position)),
            Self::Sphere { centre, radius, radiance } => {
                let half_sine = Ball { centre, radius, soft: false }.half_sine(distance(centre));
                extended(radiance, half_sine.map_or(f64::INFINITY, solid_angle))
            }
            Self::Disc { centre, radius, radiance } => {
                let half_sine = Ball { centre, radius, soft: true }.half_sine(distance(centre));
                extended(radiance, half_sine.map_or(f64::INFINITY, solid_angle))
            }
            Self::Spot { position, radius, soft, intensity, cone: shape } => {
                let intensity = intensity * most_towards(&shape, (position, radius), within);
                if radius == 0.0 {
                    return of_point(intensity, distance(position));
                }
                let half_sine = Ball { centre: position, radius, soft }.half_sine(distance(position));
                extended(radiance_of(intensity, radius), half_sine.map_or(f64::INFINITY, solid_angle))
            }
            Self::Rectangle { corner, edges: [u, v], radiance } => {
                let middle = corner + 0.5 * (u + v);
                let nearest = distance(middle) - 0.5 * (u + v).length().max((u - v).length());
                // Seen from one side, a plane takes half of all directions at most.
                let solid_angle = u.cross(v).length() / nearest.max(0.0).powi(2);
                extended(radiance, solid_angle.min(TAU))
            }
        }
    }

    /// Returns light that arrives at a point, from a direction drawn by two numbers in [0, 1); `None` if none arrives.
    #[inline]
    pub fn sample(&self, from: DVec3, [u, v]: [f64; 2]) -> Option<Arrival> {
        match *self {
            Self::Sun { direction, irradiance, angle } => Some(match half_sine_of_sun(angle) {
                0.0 => Arrival { direction, distance: f64::INFINITY, radiance: irradiance, density: f64::INFINITY },
                half_sine => Arrival {
                    direction: in_cone(direction, half_sine, [u, v]),
                    distance: f64::INFINITY,
                    radiance: irradiance / disc(half_sine) as f32,
                    density: 1.0 / solid_angle(half_sine),
                },
            }),
            Self::Point { position, intensity } => from_point(from, position, intensity),
            Self::Sphere { centre, radius, radiance } => {
                Some(Arrival::of(Ball { centre, radius, soft: false }.sample(from, [u, v])?, radiance))
            }
            Self::Disc { centre, radius, radiance } => {
                Some(Arrival::of(Ball { centre, radius, soft: true }.sample(from, [u, v])?, radiance))
            }
            Self::Spot { position, radius, soft, intensity, cone } => {
                let arrival = if radius == 0.0 {
                    from_point(from, position, intensity)?
                } else {
                    let met = Ball { centre: position, radius, soft }.sample(from, [u, v])?;
                    Arrival::of(met, radiance_of(intensity, radius))
                };
                arrival.shaped(&cone)
            }
            Self::Rectangle { corner, edges, radiance } => {
                let (direction, distance) = towards(from, corner + u * edges[0] + v * edges[1])?;
                let normal = edges[0].cross(edges[1]);
                // The area times the cosine.
                let facing = -normal.dot(direction);
                (facing > 0.0).then(|| Arrival { direction, distance, radiance, density: distance * distance / facing })
            }
        }
    }

    /// Returns the light that a ray of unit direction meets; `None` if it meets none. Lights without extent are never
    /// met.
    #[inline]
    pub(crate) fn hit(&self, ray: &Ray) -> Option<Arrival> {
        let direction = ray.direction;
        match *self {
            Self::Sun { direction: axis, irradiance, angle } => {
                let half_sine = half_sine_of_sun(angle);
                // |a - b| = 2 sin(θ / 2) keeps what the cosine of a small angle loses.
                let inside = (axis - direction).length() < 2.0 * half_sine;
                inside.then(|| Arrival {
                    direction,
                    distance: f64::INFINITY,
                    radiance: irradiance / disc(half_sine) as f32,
                    density: 1.0 / solid_angle(half_sine),
                })
            }
            Self::Point { .. } => None,
            Self::Sphere { centre, radius, radiance } => {
                Some(Arrival::of(Ball { centre, radius, soft: false }.hit(ray)?, radiance))
            }
            Self::Disc { centre, radius, radiance } => {
                Some(Arrival::of(Ball { centre, radius, soft: true }.hit(ray)?, radiance))
            }
            Self::Spot { position, radius, soft, intensity, cone } => {
                if radius == 0.0 {
                    return None;
                }
                let met = Ball { centre: position, radius, soft }.hit(ray)?;
                Arrival::of(met, radiance_of(intensity, radius)).shaped(&cone)
            }
            Self::Rectangle { corner, edges: [u, v], radiance } => {
                let normal = u.cross(v);
                let facing = -normal.dot(direction);
                let to = corner - ray.origin;
                let distance = -to.dot(normal) / facing;
                if !(facing > 0.0 && distance > 0.0) {
                    return None;
                }
                let at = distance * direction - to;
                let area = normal.length_squared();
                let inside = |share: f64| (0.0..=1.0).contains(&(share / area));
                (inside(at.cross(v).dot(normal)) && inside(u.cross(at).dot(normal))).then(|| Arrival {
                    direction,
                    distance,
                    radiance,
                    density: distance * distance / facing,
                })
            }
        }
    }
}

impl Arrival {
    /// Returns the light of this radiance that comes from a ball.
    #[inline(always)]
    fn of(met: Towards, radiance: Vec3) -> Self {
        let Towards { direction, distance, density } = met;
        Self { direction, distance, radiance, density }
    }

    /// Returns the share of the light that leaves in a cone; `None` if none does.
    #[inline(always)]
    fn shaped(self, cone: &Cone) -> Option<Self> {
        let share = cone.share(-self.direction);
        (share > 0.0).then(|| Self { radiance: share * self.radiance, ..self })
    }
}

/// Returns light that arrives from a point; `None` in it.
#[inline(always)]
fn from_point(from: DVec3, position: DVec3, intensity: Vec3) -> Option<Arrival> {
    let (direction, distance) = towards(from, position)?;
    let radiance = intensity / (distance * distance) as f32;
    Some(Arrival { direction, distance, radiance, density: f64::INFINITY })
}

/// Returns upper bounds of the light of a point at a distance or farther.
fn of_point(intensity: Vec3, nearest: f64) -> LightBounds {
    // From nearby, infinite; from far away, the square must not round to 0.
    let fluence = intensity * (1.0 / (nearest * nearest)) as f32;
    let black = intensity.cmpeq(Vec3::ZERO);
    LightBounds { radiance: unlimited(intensity), fluence: Vec3::select(black, Vec3::ZERO, fluence) }
}

/// Returns the radiance of a ball of that intensity.
#[inline(always)]
fn radiance_of(intensity: Vec3, radius: f64) -> Vec3 {
    intensity / (PI * radius * radius) as f32
}

/// Returns the largest share of a cone's light that leaves a ball towards a box.
fn most_towards(cone: &Cone, (centre, radius): (DVec3, f64), within: Aabb) -> f32 {
    let around = 0.5 * within.size().length() + radius;
    let Some((direction, distance)) = towards(centre, within.centre()) else { return 1.0 };
    // Rays from the ball into the box differ from the axis of both by no more than those between spheres around them.
    if around < distance { cone.largest_share(direction, (around / distance).asin()) } else { 1.0 }
}

/// Returns an infinite radiance in channels that have light.
fn unlimited(light: Vec3) -> Vec3 {
    Vec3::select(light.cmpeq(Vec3::ZERO), Vec3::ZERO, Vec3::INFINITY)
}

/// Returns the sine of half of the angular radius of a sun from its angular diameter; 0 below the width that directions
/// resolve, of which the radiance would overflow.
fn half_sine_of_sun(angle: f64) -> f64 {
    const LEAST: f64 = 1e-12;
    if angle < LEAST { 0.0 } else { (0.25 * angle).sin() }
}

/// Returns the integral of the cosine over a disc on the sky, `π sin² θ`, from the sine of half of its radius θ.
fn disc(half_sine: f64) -> f64 {
    // 1 - cos θ, which the cosine of a small angle would lose.
    let drop = 2.0 * half_sine * half_sine;
    PI * drop * (2.0 - drop)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::super::directions::around;
    use super::*;

    fn lights() -> [Light; 7] {
        let cone = Cone::new(DVec3::new(-1.0, 0.5, -0.3), 3.0, 0.2).unwrap();
        let radiance = Vec3::new(1.0, 2.0, 3.0);
        [
            Light::Sun { direction: DVec3::new(1.0, 2.0, 2.0), irradiance: radiance, angle: 0.3 },
            Light::Sun { direction: DVec3::Z, irradiance: radiance, angle: 3.0 },
            Light::Sphere { centre: DVec3::new(2.0, -1.0, 0.5), radius: 1.2, radiance },
            Light::Sphere { centre: DVec3::new(1e4, 0.0, 0.0), radius: 1e-2, radiance },
            Light::Disc { centre: DVec3::new(1.0, -1.0, 0.5), radius: 1.8, radiance },
            Light::Spot { position: DVec3::Y, radius: 0.4, soft: false, intensity: radiance, cone },
            Light::Rectangle {
                corner: DVec3::new(-1.0, -2.0, 3.0),
                edges: [DVec3::new(0.3, 2.5, 0.4), DVec3::new(2.0, 0.1, -0.5)],
                radiance,
            },
        ]
        .map(|light| light.checked().unwrap())
    }

    /// Directions drawn meet the light at the same distance, with the same radiance and density.
    #[test]
    fn what_is_drawn_is_met() {
        let from = DVec3::new(0.1, 0.2, -0.3);
        for light in lights() {
            for i in 0..400 {
                let u = [f64::from(i % 20), f64::from(i / 20)].map(|i| (i + 0.5) / 20.0);
                let drawn = light.sample(from, u).unwrap();
                let met = light.hit(&Ray::new(from, drawn.direction)).unwrap();
                let far = drawn.distance.is_infinite() && met.distance.is_infinite();
                assert!(far || (drawn.distance / met.distance - 1.0).abs() < 1e-6, "{light:?} {drawn:?} {met:?}");
                assert!((drawn.density / met.density - 1.0).abs() < 1e-9, "{light:?} {drawn:?} {met:?}");
                assert_eq!(drawn.radiance, met.radiance);
            }
        }
    }

    /// Densities integrate to 1 over the sphere of directions.
    #[test]
    fn densities_are_normalised() {
        let from = DVec3::new(0.1, 0.2, -0.3);
        // The tiny sphere is lost between these directions.
        for light in lights().into_iter().filter(|light| !matches!(light, Light::Sphere { radius: 1e-2, .. })) {
            let (steps, mut sum) = (1200, 0.0);
            for i in 0..steps {
                let cosine = 2.0 * (f64::from(i) + 0.5) / f64::from(steps) - 1.0;
                for j in 0..2 * steps {
                    let turn = (f64::from(j) + 0.5) / f64::from(2 * steps);
                    let direction = around(DVec3::new(0.0, 0.6, 0.8), cosine, (1.0 - cosine * cosine).sqrt(), turn);
                    let met = light.hit(&Ray::new(from, direction));
                    sum += met.map_or(0.0, |met| met.density);
                }
            }
            let integral = sum * 2.0 * TAU / f64::from(2 * steps * steps);
            // The rim of a shape lies between two directions.
            assert!((integral - 1.0).abs() < 5e-3, "{light:?}: {integral}");
        }
    }

    /// The irradiance of a sun is what was asked for, whatever its angle.
    #[test]
    fn a_wide_sun_is_as_bright_as_a_narrow_one() {
        for angle in [1e-9, 0.01, 1.0, 3.1] {
            let sun = Light::Sun { direction: DVec3::Z, irradiance: Vec3::ONE, angle };
            let count = 400;
            let mean = |of: &dyn Fn(Arrival) -> f64| {
                let draws = (0..count).map(|i| [(f64::from(i) + 0.5) / f64::from(count), 0.3]);
                draws.map(|u| of(sun.sample(DVec3::ZERO, u).unwrap())).sum::<f64>() / f64::from(count)
            };
            let irradiance = mean(&|a| f64::from(a.radiance.x) * a.direction.z / a.density);
            assert!((irradiance - 1.0).abs() < 1e-5, "{angle}: {irradiance}");
        }
    }

    #[test]
    fn lights_that_cannot_be_are_refused() {
        let of = |light: Light| light.checked().map(|_| ()).map_err(|e| e.to_string());
        let sun = |direction, angle| of(Light::Sun { direction, irradiance: Vec3::ONE, angle });
        assert_eq!(sun(DVec3::Y, 0.0), Ok(()));
        assert!(sun(DVec3::ZERO, 0.0).unwrap_err().contains("no direction"));
        assert!(sun(DVec3::Y, 4.0).unwrap_err().contains("not possible"));
        let sphere = |radius| of(Light::Sphere { centre: DVec3::ZERO, radius, radiance: Vec3::ONE });
        assert!(sphere(0.0).unwrap_err().contains("radius") && sphere(f64::NAN).is_err());
        let flat = Light::Rectangle { corner: DVec3::ZERO, edges: [DVec3::X, DVec3::X], radiance: Vec3::ONE };
        assert!(of(flat).unwrap_err().contains("edges"));
        let dark = Light::Point { position: DVec3::ZERO, intensity: Vec3::new(-1.0, 0.0, 0.0) };
        assert!(of(dark).unwrap_err().contains("not negative"));
    }
}
