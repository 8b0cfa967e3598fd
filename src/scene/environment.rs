//! Light from infinitely far away, from all directions.

use crate::error::{Error, Result};
use crate::scene::film::Film;
use crate::scene::light::{Arrival, LightBounds};
use glam::{DMat3, DVec3, Vec3};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Radiance that arrives from infinitely far away: a constant, and a picture of all directions.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Environment {
    /// Radiance in red, green and blue that is the same from all directions.
    pub radiance: [f32; 3],
    /// Radiance by direction, which adds to it.
    pub map: Option<Arc<EnvironmentMap>>,
}

impl Environment {
    /// Creates an environment that is the same in all directions.
    pub fn constant(radiance: [f32; 3]) -> Self {
        Self { radiance, map: None }
    }

    /// Returns upper bounds of the light that arrives anywhere.
    pub fn bounds(&self) -> LightBounds {
        let constant = Vec3::from_array(self.radiance);
        let map =
            self.map.as_ref().map_or(LightBounds { radiance: Vec3::ZERO, fluence: Vec3::ZERO }, |map| map.bounds());
        LightBounds { radiance: constant + map.radiance, fluence: (4.0 * PI) as f32 * constant + map.fluence }
    }

    /// Returns the radiance that arrives from a direction, given by a unit vector towards it.
    #[inline]
    pub fn towards(&self, direction: DVec3) -> Vec3 {
        let constant = Vec3::from_array(self.radiance);
        self.map.as_ref().map_or(constant, |map| constant + map.towards(direction))
    }
}

/// An equirectangular picture of the radiance from all directions, with a distribution by which directions are drawn.
///
/// Unless it is turned, the top row is towards +Z. The middle of the picture is towards +X, and directions turn from +X
/// to -Y to the right, as in Blender's *Environment Texture*.
#[derive(Debug, Clone, PartialEq)]
pub struct EnvironmentMap {
    size: [usize; 2],
    /// Radiance, row-major from the top left.
    pixels: Vec<Vec3>,
    /// Cells of the distribution along both edges.
    cells: [usize; 2],
    /// Rotation, or one with a reflection, from the picture's axes to those of the world.
    axes: DMat3,
    /// Cumulative probabilities of the rows of cells; the last is 1.
    rows: Vec<f64>,
    /// Cumulative probabilities of the cells within each row; the last of each row is 1.
    columns: Vec<f64>,
}

/// Message of the error that an environment has no light.
pub const BLACK: &str = "the environment is black everywhere";

/// Most cells of the distribution along both edges: pictures of the sky are smooth in between, but for the sun, which
/// takes a few of them.
const MOST_CELLS: [usize; 2] = [1024, 512];

impl EnvironmentMap {
    /// Creates the environment that a picture shows, its radiance times `factor`.
    ///
    /// # Errors
    /// If the picture has no pixels, or a radiance is negative or not finite.
    pub fn new(film: &Film, factor: [f32; 3]) -> Result<Self> {
        let (size, factor) = ([film.width, film.height], Vec3::from_array(factor));
        let pixels: Vec<Vec3> = film.rgba.iter().map(|[r, g, b, _]| factor * Vec3::new(*r, *g, *b)).collect();
        if pixels.is_empty() {
            return Err(Error::invalid("an environment without pixels"));
        }
        if let Some(bad) = pixels.iter().position(|v| !(v.is_finite() && v.min_element() >= 0.0)) {
            let (x, y) = (bad % size[0], bad / size[0]);
            return Err(Error::invalid(format!("the environment's pixel ({x}, {y}) is {}", pixels[bad]))
                .hint("every radiance must be finite and not negative; write the picture again without such pixels"));
        }
        let cells = [0, 1].map(|axis| size[axis].min(MOST_CELLS[axis]));
        let (mut rows, mut columns) = (Vec::with_capacity(cells[1]), Vec::with_capacity(cells[0] * cells[1]));
        for row in 0..cells[1] {
            let sine = (PI * (row as f64 + 0.5) / cells[1] as f64).sin();
            let weights = (0..cells[0]).map(|column| sine * mean(&pixels, size, cells, [column, row]));
            rows.push(cumulate(&mut columns, weights));
        }
        let all = rows.clone();
        rows.clear();
        if cumulate(&mut rows, all.into_iter()) <= 0.0 {
            return Err(Error::invalid(BLACK).hint("leave it out"));
        }
        Ok(Self { size, pixels, cells, axes: DMat3::IDENTITY, rows, columns })
    }

    /// Returns the environment turned by a rotation of the world, or one with a reflection.
    #[must_use]
    pub fn turned(self, rotation: DMat3) -> Self {
        Self { axes: rotation * self.axes, ..self }
    }

    /// Returns upper bounds of the light that arrives anywhere.
    fn bounds(&self) -> LightBounds {
        let [width, height] = self.size;
        let pixel = TAU / width as f64 * PI / height as f64;
        let (mut radiance, mut fluence) = (Vec3::ZERO, DVec3::ZERO);
        for (row, pixels) in self.pixels.chunks(width).enumerate() {
            // Interpolation carries a pixel's radiance to the centres of its neighbours, at the poles to the edge.
            let sine = |rows: f64| (PI * rows / height as f64).sin();
            let (top, bottom) = (row as f64 - 0.5, row as f64 + 1.5);
            let equator = 0.5 * height as f64;
            let widest = if top < equator && equator < bottom { 1.0 } else { sine(top).max(sine(bottom)) };
            let spread = if row == 0 || row + 1 == height { 1.5 } else { 1.0 };
            for v in pixels {
                radiance = radiance.max(*v);
                fluence += spread * widest * pixel * v.as_dvec3();
            }
        }
        LightBounds { radiance, fluence: fluence.as_vec3() * (1.0 + 1e-6) }
    }

    /// Returns the radiance that arrives from a direction, interpolated between the centres of pixels.
    #[inline]
    pub fn towards(&self, direction: DVec3) -> Vec3 {
        let [u, v] = coordinates(self.axes.transpose() * direction);
        let [width, height] = self.size;
        let (x, y) = (u * width as f64 - 0.5, (v * height as f64 - 0.5).clamp(0.0, (height - 1) as f64));
        let (left, up) = (x.floor(), y.floor());
        let (s, t) = ((x - left) as f32, (y - up) as f32);
        let pixel = |dx: f64, dy: usize| {
            let column = (left + dx).rem_euclid(width as f64) as usize;
            self.pixels[(up as usize + dy).min(height - 1) * width + column.min(width - 1)]
        };
        pixel(0.0, 0).lerp(pixel(1.0, 0), s).lerp(pixel(0.0, 1).lerp(pixel(1.0, 1), s), t)
    }

    /// Returns light from a direction that is drawn by two numbers in [0, 1), the brighter the likelier.
    #[inline]
    pub fn sample(&self, [choice, across]: [f64; 2]) -> Arrival {
        let (row, v) = drawn(&self.rows, choice);
        let (column, u) = drawn(&self.columns[row * self.cells[0]..(row + 1) * self.cells[0]], across);
        let [u, v] = [(column as f64 + u) / self.cells[0] as f64, (row as f64 + v) / self.cells[1] as f64];
        let (elevation, turn) = (PI * v, TAU * (0.5 - u));
        let direction =
            DVec3::new(elevation.sin() * turn.cos(), elevation.sin() * turn.sin(), elevation.cos()).normalize();
        let direction = self.axes * direction;
        Arrival {
            direction,
            distance: f64::INFINITY,
            radiance: self.towards(direction),
            density: self.density(direction),
        }
    }

    /// Returns the density per steradian with which a direction is drawn.
    #[inline]
    pub fn density(&self, direction: DVec3) -> f64 {
        let direction = self.axes.transpose() * direction;
        let [u, v] = coordinates(direction);
        let place = |share: f64, axis: usize| ((share * self.cells[axis] as f64) as usize).min(self.cells[axis] - 1);
        let (column, row) = (place(u, 0), place(v, 1));
        let columns = &self.columns[row * self.cells[0]..(row + 1) * self.cells[0]];
        let per_area = probability(&self.rows, row) * probability(columns, column);
        let sine = (1.0 - direction.z * direction.z).max(1e-12).sqrt();
        per_area * (self.cells[0] * self.cells[1]) as f64 / (TAU * PI * sine)
    }
}

/// Returns the coordinates of a direction in the picture, each from 0 to 1.
#[inline]
fn coordinates(direction: DVec3) -> [f64; 2] {
    [0.5 - direction.y.atan2(direction.x) / TAU, direction.z.clamp(-1.0, 1.0).acos() / PI]
}

/// Returns the mean brightness of the pixels of a cell.
fn mean(pixels: &[Vec3], size: [usize; 2], cells: [usize; 2], cell: [usize; 2]) -> f64 {
    let range = |axis: usize| cell[axis] * size[axis] / cells[axis]..(cell[axis] + 1) * size[axis] / cells[axis];
    let (mut sum, mut count) = (0.0, 0.0);
    for y in range(1) {
        for x in range(0) {
            sum += f64::from(pixels[y * size[0] + x].element_sum());
            count += 1.0;
        }
    }
    sum / count
}

/// Appends the cumulative shares of the weights, equal ones if all are 0, and returns their sum.
fn cumulate(to: &mut Vec<f64>, weights: impl Iterator<Item = f64>) -> f64 {
    let first = to.len();
    let mut sum = 0.0;
    for weight in weights {
        sum += weight;
        to.push(sum);
    }
    let count = (to.len() - first) as f64;
    for (i, share) in to[first..].iter_mut().enumerate() {
        *share = if sum > 0.0 { *share / sum } else { (i + 1) as f64 / count };
    }
    sum
}

/// Returns the number of the part that a number in [0, 1) falls into, and its place within, from 0 to 1.
#[inline]
fn drawn(cumulative: &[f64], u: f64) -> (usize, f64) {
    let part = cumulative.partition_point(|share| *share <= u).min(cumulative.len() - 1);
    let below = if part == 0 { 0.0 } else { cumulative[part - 1] };
    let place = (u - below) / (cumulative[part] - below);
    (part, if place.is_finite() { place.clamp(0.0, 1.0 - f64::EPSILON) } else { 0.5 })
}

#[inline]
fn probability(cumulative: &[f64], part: usize) -> f64 {
    cumulative[part] - if part == 0 { 0.0 } else { cumulative[part - 1] }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// A sky with a sun of a few pixels, half of it black.
    fn sky(width: usize, height: usize) -> EnvironmentMap {
        let pixel = |i: usize| {
            let (x, y) = (i % width, i / width);
            let sun = if x == width / 3 && y == height / 4 { 500.0 } else { 0.0 };
            let v = if y > height / 2 { 0.0 } else { 0.2 + 0.1 * (x as f32 / width as f32) + sun };
            [v, 0.5 * v, 0.25 * v, 1.0]
        };
        EnvironmentMap::new(&Film::of(width, height, (0..width * height).map(pixel).collect()), [1.0; 3]).unwrap()
    }

    /// The density is that with which directions come: the mean of its reciprocal over drawn directions is the solid
    /// angle that is drawn at all, and the mean of radiance over density the integral of the radiance.
    #[test]
    fn directions_are_drawn_by_their_density() {
        for (width, height) in [(64, 32), (1500, 700), (5, 3)] {
            let map = sky(width, height);
            let (side, mut light) = (800, 0.0);
            for i in 0..side * side {
                let u = [i % side, i / side].map(|k| (f64::from(k) + 0.5) / f64::from(side));
                let drawn = map.sample(u);
                assert!(drawn.density > 0.0 && (drawn.direction.length() - 1.0).abs() < 1e-12);
                light += f64::from(drawn.radiance.x) / drawn.density / f64::from(side * side);
            }
            let (mut expected, mut whole) = (0.0, 0.0);
            // As many in each pixel.
            let steps = [width as u32, height as u32].map(|n| n * 400_u32.div_ceil(n).max(2));
            for j in 0..steps[1] {
                let (elevation, sine) = {
                    let elevation = PI * (f64::from(j) + 0.5) / f64::from(steps[1]);
                    (elevation, elevation.sin())
                };
                for i in 0..steps[0] {
                    let turn = TAU * (f64::from(i) + 0.5) / f64::from(steps[0]);
                    let direction = DVec3::new(sine * turn.cos(), sine * turn.sin(), elevation.cos());
                    let area = sine * TAU * PI / f64::from(steps[0]) / f64::from(steps[1]);
                    expected += area * f64::from(map.towards(direction).x);
                    whole += area * map.density(direction);
                }
            }
            assert!((whole - 1.0).abs() < 5e-3, "{width}x{height}: densities sum to {whole}");
            // Light is interpolated from bright pixels into cells beside them that are drawn rarely, or never.
            assert!((light / expected - 1.0).abs() < 0.2, "{width}x{height}: {light} {expected}");
        }
    }

    #[test]
    fn the_picture_lies_as_blenders() {
        let mut film = Film::new(8, 4);
        film.rgba[4] = [1.0; 4];
        film.rgba[8 + 6] = [2.0; 4];
        let map = EnvironmentMap::new(&film, [1.0; 3]).unwrap();
        // Just right of the middle in the top row, and further right and down.
        let towards = |turn: f64, elevation: f64| {
            DVec3::new(elevation.sin() * turn.cos(), elevation.sin() * turn.sin(), elevation.cos())
        };
        assert!((map.towards(towards(-TAU / 16.0, PI / 8.0)).x - 1.0).abs() < 1e-6);
        assert!((map.towards(towards(-5.0 * TAU / 16.0, 3.0 * PI / 8.0)).x - 2.0).abs() < 1e-6);
    }

    #[test]
    fn skies_that_cannot_be_are_refused() {
        let of = |v: f32| EnvironmentMap::new(&Film::of(2, 1, vec![[1.0; 4], [v, 0.0, 0.0, 1.0]]), [1.0; 3]);
        assert!(of(0.5).is_ok());
        assert!(of(-1.0).unwrap_err().to_string().contains("(1, 0)") && of(f32::NAN).is_err());
        assert!(EnvironmentMap::new(&Film::new(0, 0), [1.0; 3]).is_err());
        assert!(EnvironmentMap::new(&Film::new(2, 2), [1.0; 3]).unwrap_err().to_string().contains("black"));
    }
}
