//! Front-to-back blending of a pre-shaded volume's segments.

use super::Preshaded;
use super::segment::{Footprint, Segment};
use crate::real::{LANES, Lanes, Real};
use crate::render::compositing::Compositing;
use crate::render::emission_absorption::Radiance;
use crate::render::march::Span;
use crate::render::quadrature::cells::{Cell, cells};

/// Optical depth above which a cell is cut.
const THICK: f64 = 0.5;
/// The most parts of a cell. Behind the first 25 of them no light arrives.
const MOST_PARTS: f64 = 64.0;

/// Visits the segments in a batch of bricks, near to far.
#[inline(always)]
pub(super) fn segments<R: Real>(values: &[R::Lanes], spans: &[Span<R>], mut visit: impl FnMut(&mut Segment<R>)) {
    cells(
        spans,
        #[inline(always)]
        |four: [Cell<R>; LANES], from: R::Lanes, until: R::Lanes| {
            let (from, length) = (from.store(), (until - from).store());
            for i in (0..LANES).filter(|i| length[*i] > R::ZERO) {
                let mut segment = Segment::new(values, &four[i], from[i], length[i]);
                let depth = segment.depth();
                let parts = if depth > R::of(THICK) { (depth.f64() / THICK).ceil().min(MOST_PARTS) as i32 } else { 1 };
                for k in 0..parts {
                    if parts > 1 {
                        segment = Segment::part(values, &four[i], from[i], length[i], k, parts);
                    }
                    visit(&mut segment);
                }
            }
        },
    );
}

/// State of front-to-back blending within a batch of bricks.
pub(super) struct Front<R: Real> {
    /// Radiance of the batch; the last lane has no meaning.
    radiance: R::Lanes,
    /// Transmittance from the eye.
    transmittance: R,
    /// Optical depth from the eye.
    depth: f64,
}

impl<R: Real> Front<R> {
    /// Creates the state at the beginning of a batch of bricks, at an optical depth from the eye.
    #[inline(always)]
    pub(crate) fn at(depth: f64) -> Self {
        Self { radiance: R::Lanes::default(), transmittance: R::of((-depth).exp()), depth }
    }

    /// Blends a segment, and notes the transmittances to its points in it.
    #[inline(always)]
    pub(crate) fn add(&mut self, segment: &mut Segment<R>) {
        let ([first, second], depth) = (segment.depths(), segment.depth());
        let transmittances =
            R::Lanes::splat(self.transmittance) * R::Lanes::load([-first, -second, -depth, R::ZERO]).exp();
        let [first, second, after, _] = transmittances.store();
        segment.transmittances = [first, second];
        for (share, value) in segment.shares().into_iter().zip(segment.values) {
            self.radiance += R::Lanes::splat(share) * value;
        }
        self.transmittance = after;
        self.depth += depth.f64();
    }
}

/// State of front-to-back blending along a ray.
pub(super) struct Blend<'b, R: Real> {
    values: &'b [R::Lanes],
    depth_limit: f64,
    emitted: [f64; 3],
    /// Optical depth from the eye.
    depth: f64,
}

impl<'b, R: Real> Blend<'b, R> {
    /// Creates the state at the eye.
    #[inline(always)]
    pub(crate) fn new(renderer: &Preshaded<'b, R>) -> Self {
        Self { values: &renderer.field.values, depth_limit: renderer.depth_limit, emitted: [0.0; 3], depth: 0.0 }
    }

    /// Returns the radiance of all segments blended so far.
    #[inline(always)]
    pub(crate) fn radiance(&self) -> Radiance {
        Radiance { rgb: self.emitted, depth: self.depth }
    }

    /// Blends the segments of a batch of spans, and visits each with the transmittances to its points. Returns false if
    /// the ray ends here.
    #[inline(always)]
    fn blend(&mut self, spans: &[Span<R>], mut visit: impl FnMut(&Segment<R>)) -> bool {
        let mut front = Front::at(self.depth);
        segments(
            self.values,
            spans,
            #[inline(always)]
            |segment| {
                front.add(segment);
                visit(segment);
            },
        );
        self.emitted.iter_mut().zip(front.radiance.store()).for_each(|(e, l)| *e += l.f64());
        self.depth = front.depth;
        self.depth < self.depth_limit
    }
}

impl<R: Real> Compositing<R> for Blend<'_, R> {
    type Entry = Segment<R>;

    #[inline(always)]
    fn composite<const KEEP: bool>(&mut self, spans: &[Span<R>], tape: &mut Vec<Segment<R>>) -> bool {
        self.blend(
            spans,
            #[inline(always)]
            |segment| {
                if KEEP {
                    tape.push(*segment);
                }
            },
        )
    }
}

/// Blending that keeps of each segment the weights of the emissions in the picture.
pub(super) struct Footprints<'b, R: Real>(pub Blend<'b, R>);

impl<R: Real> Compositing<R> for Footprints<'_, R> {
    type Entry = Footprint<R>;

    #[inline(always)]
    fn composite<const KEEP: bool>(&mut self, spans: &[Span<R>], tape: &mut Vec<Footprint<R>>) -> bool {
        self.0.blend(
            spans,
            #[inline(always)]
            |segment| {
                if KEEP {
                    tape.push(segment.footprint());
                }
            },
        )
    }
}
