//! Volumes of labels along straight rays: every voxel has the optics of its label up to its faces, and nothing is
//! interpolated, since a label between two others is another one.
//!
//! Extinction and source are constant within a voxel, so that a length `l` of it adds `T c (1 - e^{-σ l})` in closed
//! form: there is no quadrature, and no error of one.

use super::composited::Composited;
use super::curve::Curve;
use super::emission_absorption::{EmissionAbsorption, Radiance};
use super::gradient::gradient;
use super::march::{IndexRay, Span, spans};
use crate::error::{Error, Result};
use crate::math::{Aabb, Affine, Ray};
use crate::scene::bricks::{BRICK, Bricks, CELLS, NONE, Topology, slot};
use crate::scene::medium::Medium;
use crate::scene::shading::Shading;
use glam::{DMat4, DVec3};

/// Part of a ray within voxels of one label.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Segment {
    /// Label, as the field stores it.
    pub label: f32,
    /// World length from the ray's origin to the entry.
    pub start: f64,
    /// World length from the ray's origin to the exit.
    pub end: f64,
    /// Extinction per world length, above 0.
    pub extinction: f64,
}

impl Segment {
    /// Returns the optical depth of the segment.
    pub(crate) fn depth(&self) -> f64 {
        self.extinction * (self.end - self.start)
    }
}

/// Surfaces at which the opacity changes, and how they are shaded.
#[derive(Debug, Clone)]
struct Surfaces {
    shading: Shading,
    /// Opacity of each voxel, whose gradient is the surface's normal.
    opacity: Bricks<f32>,
    /// Standard deviation in voxels of the filter that gradients are taken through.
    scale: f64,
}

/// A volume of labels with the colors and extinctions of a function of labels.
#[derive(Debug)]
pub struct Labels<'a> {
    field: &'a Bricks<f32>,
    /// Map to world space from an index space in which a voxel lies between its own coordinates and the next ones.
    transform: Affine,
    /// Box of the voxels in that index space.
    domain: Aabb,
    /// Bricks in which anything is seen.
    visible: Topology,
    curve: Curve<f32, 3>,
    /// Brightest source of the function.
    brightest: f64,
    depth_limit: f64,
    surfaces: Option<Box<Surfaces>>,
}

/// Optical depth of the shortest edge of a voxel from which on it counts as opaque: collisions of paths lie so near to
/// its face then that positions do not tell them apart.
const OPAQUE: f64 = 1e9;

/// Returns the error of who asks for derivatives of pictures of labels.
pub fn not_differentiated() -> Error {
    Error::unsupported("labels are looked up at the nearest voxel: their pictures have no derivatives")
        .hint("give a function that is none of labels")
}

/// Returns the standard deviation in voxels of the filter of surfaces' gradients where `stated` is asked for; of 0 it
/// is 2, since the gradients of single voxels are steps.
pub(crate) fn gradient_scale(stated: f64) -> f64 {
    if stated > 0.0 { stated } else { 2.0 }
}

impl<'a> Labels<'a> {
    /// Creates the integrator of a medium with a function of labels, whose rays end once at most 1e-6 of the light from
    /// behind could reach the eye.
    ///
    /// # Errors
    /// If the medium's numbers cannot be used, it has no function of labels, or has an extinction by channel.
    pub fn new(field: &'a Bricks<f32>, medium: &Medium) -> Result<Self> {
        let medium = medium.clone().checked()?.relative_to(field.reference);
        let Some(table) = medium.labels() else {
            return Err(Error::unsupported("a volume of labels needs a function of labels")
                .hint("give ⟨tf⟩ a function of the kind 'labels'"));
        };
        if medium.is_chromatic() {
            return Err(Error::unsupported("labels have one extinction for all channels, the medium has three")
                .hint("leave ⟨extinction_color⟩ out"));
        }
        if table.at(field.background.into())[3] > 0.0 && !field.is_filled() {
            return Err(Error::invalid("the function shows the label of the background, and bricks are missing there")
                .hint("fill the field first: `Bricks::filled`"));
        }
        let most = OPAQUE / field.transform.voxel_size().min_element() / medium.extinction;
        let values = table.values().iter().map(|[r, g, b, extinction]| [*r, *g, *b, extinction.min(most)]);
        let curve = Curve::new(&table.with_values(values.collect())?, medium.extinction);
        let half = DMat4::from_translation(DVec3::splat(-0.5));
        let transform = Affine::new(field.transform.matrix() * half)?;
        // The bricks may hold what lies beyond the last voxels of the data: background.
        let Aabb { min, max } = field.domain;
        let domain =
            if field.domain.is_empty() { field.domain } else { Aabb { min: min.round(), max: max.round() + 1.0 } };
        let seen = |brick: usize| {
            let values = &field.values[brick * BRICK..][..BRICK];
            own_slots().any(|slot| extinction(&curve, values[slot]) > 0.0)
        };
        let visible = field.topology.masked(seen);
        let brightest = table.peak()[..3].iter().fold(0.0_f64, |most, v| most.max(*v));
        let labels = Self { field, transform, domain, visible, curve, brightest, depth_limit: 0.0, surfaces: None };
        Ok(labels.early_stop(1e-6))
    }

    /// Composites the volume over a constant background.
    pub fn over(self, background: [f32; 3]) -> Composited<Self> {
        Composited { medium: self, background }
    }

    /// Ends a ray once its transmittance is below `transmittance` (0: never).
    #[must_use]
    pub fn early_stop(self, transmittance: f64) -> Self {
        Self { depth_limit: -transmittance.ln(), ..self }
    }

    /// Shades the surfaces of what is seen by a light at the camera; their normals are gradients of the opacity of
    /// single voxels, through a filter of this standard deviation in voxels, of 2 for 0.
    ///
    /// # Errors
    /// If a number of the shading cannot be used.
    pub fn shaded(self, (shading, stated): (Shading, f64)) -> Result<Self> {
        let (opacity, scale) = (self.opacity(), gradient_scale(stated));
        let surfaces = Surfaces { shading: shading.checked()?, opacity, scale };
        Ok(Self { surfaces: Some(Box::new(surfaces)), ..self })
    }

    /// Returns the opacity of each voxel, over the length of its shortest edge.
    pub(crate) fn opacity(&self) -> Bricks<f32> {
        let Bricks { topology, values, background, transform, domain, .. } = self.field;
        let edge = transform.voxel_size().min_element();
        let of = |label: &f32| -(-f64::from(extinction(&self.curve, *label)) * edge).exp_m1() as f32;
        Bricks {
            topology: topology.clone(),
            values: values.iter().map(of).collect(),
            background: of(background),
            reference: 0.0,
            transform: *transform,
            domain: *domain,
        }
    }

    /// Returns the part of a world ray of unit direction within the box of the voxels.
    pub(crate) fn index_ray(&self, ray: &Ray) -> Option<IndexRay> {
        IndexRay::new(&self.domain, &self.transform, ray)
    }

    /// Returns label and extinction at a world position; `None` where nothing is seen.
    pub(crate) fn at(&self, position: DVec3) -> Option<(f32, f32)> {
        let index = self.transform.to_index(position);
        if !(index.cmpge(self.domain.min) & index.cmple(self.domain.max)).all() {
            return None;
        }
        let voxel = index.floor().as_ivec3();
        let brick = self.field.topology.find(voxel >> 3);
        if brick == NONE {
            return None;
        }
        let at = slot((voxel.x & 7) as usize, (voxel.y & 7) as usize, (voxel.z & 7) as usize);
        let label = self.field.values[brick as usize * BRICK + at];
        let extinction = extinction(&self.curve, label);
        (extinction > 0.0).then_some((label, extinction))
    }

    /// Visits the segments of a world ray of unit direction that are not clear, near to far; `visit` returns false to
    /// stop.
    pub(crate) fn segments(&self, ray: &Ray, mut visit: impl FnMut(&Segment) -> bool) {
        let Some(index) = self.index_ray(ray) else { return };
        let mut open: Option<Segment> = None;
        let mut more = true;
        spans(&self.visible, &index, false, |span: Span<f64>| {
            more = self.voxels(&span, |label, start, end| match &mut open {
                Some(segment) if segment.label == label && segment.end == start => {
                    segment.end = end;
                    true
                }
                _ => {
                    let before = open.take();
                    let extinction = extinction(&self.curve, label);
                    open = (extinction > 0.0).then_some(Segment { label, start, end, extinction: extinction.into() });
                    before.is_none_or(|segment| visit(&segment))
                }
            });
            more
        });
        if more && let Some(segment) = open {
            visit(&segment);
        }
    }

    /// Visits the voxels of a span (Amanatides & Woo 1987) with their labels and the world lengths from the ray's
    /// origin at which the ray enters and leaves them. Returns false if it was stopped.
    fn voxels(&self, span: &Span<f64>, mut visit: impl FnMut(f32, f64, f64) -> bool) -> bool {
        const LAST: f64 = (CELLS - 1) as f64;
        let mut voxel = span.entry.map(|entry| entry.floor().clamp(0.0, LAST));
        let crossing = |axis: usize, voxel: f64| match span.direction[axis] {
            0.0 => f64::INFINITY,
            direction => (voxel + f64::from(u8::from(direction > 0.0)) - span.entry[axis]) * span.inverse[axis],
        };
        let mut next: [f64; 3] = std::array::from_fn(|axis| crossing(axis, voxel[axis]));
        let mut now = 0.0;
        loop {
            let until = next[0].min(next[1]).min(next[2]).min(span.length);
            if until > now {
                let [x, y, z] = voxel.map(|v| v as usize);
                // The last length is that of the span, so that segments meet between spans.
                let end = if until < span.length { span.start + until } else { span.end };
                if !visit(self.field.values[span.base + slot(x, y, z)], span.start + now, end) {
                    return false;
                }
                now = until;
            }
            if until >= span.length {
                return true;
            }
            for axis in 0..3 {
                if next[axis] <= until {
                    voxel[axis] = (voxel[axis] + span.direction[axis].signum()).clamp(0.0, LAST);
                    // Beyond the last voxel there is no plane to be crossed within the span.
                    let further = crossing(axis, voxel[axis]);
                    next[axis] = if further > next[axis] { further } else { f64::INFINITY };
                }
            }
        }
    }

    /// Returns the radiance of the source of a label.
    fn source(&self, label: f32) -> DVec3 {
        let piece = self.curve.piece(self.curve.find(label));
        DVec3::from_array(piece.source.map(|[value, _]| value.into()))
    }
}

/// Returns the extinction of a label.
fn extinction(curve: &Curve<f32, 3>, label: f32) -> f32 {
    curve.piece(curve.find(label)).extinction[0]
}

/// Returns the places, among the values of a brick, of the voxels that it owns.
fn own_slots() -> impl Iterator<Item = usize> {
    (0..CELLS * CELLS * CELLS).map(|i| slot(i / (CELLS * CELLS), i / CELLS % CELLS, i % CELLS))
}

impl EmissionAbsorption for Labels<'_> {
    type Real = f32;
    type Scratch = ();

    fn integrate(&self, ray: &Ray, (): &mut ()) -> Radiance {
        let (mut rgb, mut depth) = (DVec3::ZERO, 0.0_f64);
        let mut add = |segment: &Segment, source: DVec3| {
            rgb += (-depth).exp() * -(-segment.depth()).exp_m1() * source;
            depth += segment.depth();
            depth < self.depth_limit
        };
        match &self.surfaces {
            None => self.segments(ray, |segment| add(segment, self.source(segment.label))),
            Some(surfaces) => self.segments(ray, |segment| {
                // The surface is where the ray enters; within, there is none.
                let index = surfaces.opacity.transform.to_index(ray.at(segment.start));
                let slope = gradient(&surfaces.opacity, index, surfaces.scale);
                let length = slope.length();
                let cosine = (length > 0.0).then(|| (slope.dot(ray.direction) / length).abs().min(1.0));
                let [factor, highlight] = surfaces.shading.factors(cosine);
                add(segment, self.source(segment.label) * factor + highlight)
            }),
        }
        Radiance { rgb: rgb.to_array(), depth }
    }
}

impl Composited<Labels<'_>> {
    /// Returns a bound of the change that ending rays early makes in any channel of a pixel, alpha included.
    pub fn left_out(&self) -> f64 {
        (-self.medium.depth_limit).exp() * self.unit()
    }

    /// Returns the brightest radiance of medium and background, at least the 1 of alpha.
    pub(crate) fn unit(&self) -> f64 {
        let Labels { brightest, surfaces, .. } = &self.medium;
        let brightest = surfaces.as_ref().map_or(*brightest, |surfaces| surfaces.shading.brightest(*brightest));
        brightest.max(self.brightest_background()).max(1.0)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::scene::medium::Source;
    use crate::scene::transfer::{Class, Transfer};
    use glam::IVec3;
    use std::sync::Arc;

    /// Random labels from 0 to 5 of two by two by one bricks, in voxels that are no cubes.
    fn volume() -> Bricks<f32> {
        let places = (0..4).map(|i| IVec3::new(i / 2, i % 2, 0));
        let topology = Arc::new(Topology::new(places).unwrap());
        let label = |p: IVec3| {
            let h = ((p.x * 73_856_093) ^ (p.y * 19_349_663) ^ (p.z * 83_492_791)) as u32;
            ((h ^ (h >> 13)).wrapping_mul(0x5BD1_E995) >> 7) % 6
        };
        let owned = topology.bricks().iter().flat_map(|brick| {
            (0..512).map(move |i| label(*brick * 8 + IVec3::new(i >> 6, (i >> 3) & 7, i & 7)) as f32)
        });
        let owned: Vec<f32> = owned.collect();
        let matrix = DMat4::from_translation(DVec3::new(3.0, -1.0, 0.5)) * DMat4::from_scale(DVec3::new(0.5, 0.8, 1.1));
        let mut field = Bricks::zeros(topology.clone(), Affine::new(matrix).unwrap());
        topology.fill_apron(&owned, &mut field.values);
        field.domain = Aabb { min: DVec3::ZERO, max: DVec3::new(15.0, 15.0, 7.0) };
        field
    }

    fn medium(scale: f64) -> Medium {
        let class = |label: i32| {
            let v = f64::from(label);
            Class {
                label,
                name: String::new(),
                rgbs: [0.2 * v, 1.0 - 0.2 * v, 0.1, [0.0, 0.4, 3.0, 0.1][label as usize % 4]],
            }
        };
        let transfer = Transfer::Labels { classes: vec![class(1), class(2), class(3), class(5)] };
        Medium::new(scale, Source::Transfer(Arc::new(transfer.table().unwrap())))
    }

    fn rays() -> Vec<Ray> {
        let middle = DVec3::new(7.0, 5.0, 4.0);
        let along = [DVec3::X, -DVec3::Y, DVec3::Z, DVec3::new(1.0, 1.0, 0.0), DVec3::new(-0.7, 0.2, 0.4)];
        let from = along.into_iter().map(|direction| {
            let direction = direction.normalize();
            Ray::new(middle - 20.0 * direction + DVec3::new(0.013, 0.027, -0.041), direction)
        });
        from.chain([Ray::new(middle, DVec3::new(0.3, -0.8, 0.1).normalize())]).collect()
    }

    /// Light and depth by many samples of the nearest voxel.
    fn sampled(field: &Bricks<f32>, medium: &Medium, ray: &Ray) -> ([f64; 3], f64) {
        let (count, far) = (400_000, 45.0);
        let (mut rgb, mut depth, step) = ([0.0; 3], 0.0_f64, far / f64::from(count));
        let Source::Transfer(table) = &medium.source else { unreachable!("a function of labels") };
        for i in 0..count {
            let voxel = field.transform.to_index(ray.at((f64::from(i) + 0.5) * step)).round();
            if !(voxel.cmpge(field.domain.min) & voxel.cmple(field.domain.max)).all() {
                continue;
            }
            let [r, g, b, extinction] = table.at(field.sample(voxel).into());
            let own = medium.extinction * extinction * step;
            let weight = (-depth).exp() * -(-own).exp_m1();
            rgb.iter_mut().zip([r, g, b]).for_each(|(sum, v)| *sum += weight * v);
            depth += own;
        }
        (rgb, depth)
    }

    /// Light is that of the labels of the nearest voxels, whatever the direction, and no class between shows.
    #[test]
    fn nearest_voxels_are_seen() {
        let field = volume();
        for scale in [0.1, 2.0] {
            let medium = medium(scale);
            let labels = Labels::new(&field, &medium).unwrap().early_stop(0.0);
            for ray in rays() {
                let found = labels.integrate(&ray, &mut ());
                let (rgb, depth) = sampled(&field, &medium, &ray);
                assert!((found.depth / depth - 1.0).abs() < 1e-3, "{ray:?}: {} {depth}", found.depth);
                for c in 0..3 {
                    assert!((found.rgb[c] - rgb[c]).abs() < 2e-3, "{ray:?}: {:?} {rgb:?}", found.rgb);
                }
                // Parts make up the whole.
                let parts = [[0.0, 17.3], [17.3, 21.9], [21.9, f64::INFINITY]];
                let sum: f64 = parts.map(|part| labels.integrate_part(&ray, part, &mut ()).depth).iter().sum();
                assert!((sum / found.depth - 1.0).abs() < 1e-9, "{sum} {}", found.depth);
            }
        }
    }

    /// Shading darkens what is turned away, and leaves alpha as it is.
    #[test]
    fn surfaces_are_shaded_across_the_opacity() {
        let mut field = volume();
        // A ball of one label.
        let centre = DVec3::new(7.5, 7.5, 3.5);
        let topology = field.topology.clone();
        let owned = topology.bricks().iter().flat_map(|brick| {
            let at = move |i: i32| (*brick * 8 + IVec3::new(i >> 6, (i >> 3) & 7, i & 7)).as_dvec3();
            (0..512).map(move |i| if (at(i) - centre).length() < 3.4 { 2.0 } else { 0.0 })
        });
        topology.fill_apron(&owned.collect::<Vec<f32>>(), &mut field.values);
        field.transform = Affine::uniform(1.0, DVec3::ZERO).unwrap();
        let medium = medium(10.0);
        let plain = Labels::new(&field, &medium).unwrap();
        let shading = Shading { ambient: 0.2, diffuse: 0.8, specular: 0.0, exponent: 1.0 };
        let shaded = Labels::new(&field, &medium).unwrap().shaded((shading, 0.0)).unwrap();
        let factor = |offset: f64| {
            let ray = Ray::new(centre + DVec3::new(-20.0, offset, 0.0), DVec3::X);
            let [a, b] = [plain.integrate(&ray, &mut ()), shaded.integrate(&ray, &mut ())];
            assert!(a.depth == b.depth && a.depth > 10.0, "{a:?} {b:?}");
            b.rgb[0] / a.rgb[0]
        };
        let [front, side] = [factor(0.0), factor(2.6)];
        assert!(front > 0.95 && side < 0.85 && side > 0.4, "{front} {side}");
    }

    #[test]
    fn what_is_no_function_of_labels_is_refused() {
        let field = volume();
        assert!(Labels::new(&field, &Medium::absorbing(1.0)).is_err());
        let mut shown = field.clone();
        (shown.background, shown.domain.max.x) = (2.0, 23.0);
        let refused = Labels::new(&shown, &medium(1.0)).map(|_| ());
        assert!(refused.unwrap_err().to_string().contains("background"));
    }
}
