//! The gradient of pre-integration: the recursion of [`super::super::adjoint`] for segments that share their ends.
//!
//! Nodes are visited near to far, also in the second pass: the radiance that arrives from behind a visit is the total
//! minus the contributions so far, in `f64` and from the very numbers that were summed. Within a visit the recursion
//! runs from its far end, so that nothing cancels.

use super::super::CompiledCurve;
use super::super::adjoint::{Pass, Weighted};
use super::batch::{SegmentBatch, at, share_slopes};
use super::bound::ATTEMPTS;
use super::deviation::Deviations;
use super::front::Front;
use super::nodes::{Nodes, ROOM, Sites, nodes};
use super::ray::{NodeCotangent, follow, note};
use super::visit::{BatchGradient, Visit};
use super::{Preintegrated, Scratch};
use crate::real::Real;
use crate::real::{LANES, Lanes};
use crate::render::differentiable::{Adjoint, Loss};
use crate::render::emission_absorption::Radiance;

/// Groups of nodes that replay keeps, the nearest ones; it walks and samples the rest of the ray a second time.
const KEPT: usize = 6;

impl<R: Real> Preintegrated<R> {
    /// Runs one ray's forward and backward pass; `None`, with nothing done, if the ray's error may exceed the
    /// tolerance.
    #[inline(always)]
    pub(crate) fn gradient(
        &self,
        pass: &mut Pass<'_, '_, R>,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        compiled: &CompiledCurve<R, 3>,
        scratch: &mut Scratch<R>,
    ) -> Option<Radiance> {
        let Scratch { queue, divided, batch, gradient, tape, spare, cotangents } = scratch;
        cotangents.clear();
        let (dvr, ray) = (pass.dvr, pass.ray);
        let values = &dvr.field.values;
        let sites = Sites { topology: pass.topology(), spacing: &self.spacing, gaps: false };
        let keep = if adjoint == Adjoint::Replay { KEPT } else { usize::MAX };
        let start = |attempt: usize| Front::new(&self.tables, &compiled.curve, (&ray, dvr.depth_limit), attempt);
        // The state where groups are no longer kept.
        let (mut front, mut rest) = (start(0), None);
        for attempt in 0..ATTEMPTS {
            spare.append(tape);
            (front, rest) = (start(attempt), None);
            let mut groups = 0;
            nodes(
                sites,
                &ray,
                queue,
                #[inline(always)]
                |queue, fours| {
                    let kept = groups < keep;
                    groups += 1;
                    if !kept {
                        rest.get_or_insert(front);
                    }
                    front.add(
                        values,
                        (queue, fours),
                        divided,
                        batch,
                        #[inline(always)]
                        |front, queue, fours, batch| {
                            if kept {
                                let mut visit = spare.pop().unwrap_or_default();
                                visit.record(front, queue, fours, batch);
                                tape.push(visit);
                            }
                        },
                    );
                    front.goes_on() && front.is_accurate()
                },
            );
            if front.is_accurate() {
                break;
            }
        }
        if !front.is_accurate() {
            return None;
        }
        let (emitted, depth) = (front.emitted, front.depth);
        let radiance = Radiance { rgb: emitted, depth };
        let weighted = pass.add_color(loss(&radiance), &emitted, &compiled.tint);
        let background = (-depth).exp() * weighted.transmittance;
        let deviations = front.deviations;
        let mut back =
            Backward { own: self, compiled, deviations, emitted, background, weighted, last: None, cotangents };
        // Not `for_each`: its closure would be compiled for the oldest instruction set.
        for visit in tape.iter() {
            back.visit(pass, visit, gradient);
        }
        if let Some(mut front) = rest {
            let mut visit = spare.pop().unwrap_or_default();
            let mut kept = keep;
            nodes(
                sites,
                &ray,
                queue,
                #[inline(always)]
                |queue, fours| {
                    if kept > 0 {
                        kept -= 1;
                        return true;
                    }
                    front.add(
                        values,
                        (queue, fours),
                        divided,
                        batch,
                        #[inline(always)]
                        |front, queue, fours, batch| {
                            visit.record(front, queue, fours, batch);
                            back.visit(pass, &visit, gradient);
                        },
                    );
                    front.goes_on()
                },
            );
            spare.push(visit);
        }
        if pass.to.ray.is_some() {
            follow(sites, &ray, &dvr.field.domain, cotangents, &mut pass.by_ray);
            pass.finish_ray();
        }
        Some(radiance)
    }
}

/// State of the backward pass.
struct Backward<'a, R: Real> {
    own: &'a Preintegrated<R>,
    compiled: &'a CompiledCurve<R, 3>,
    deviations: Deviations<R>,
    /// Emitted radiance of the whole ray.
    emitted: [f64; 3],
    /// Loss-weighted radiance that arrives from the background.
    background: f64,
    weighted: Weighted<3>,
    /// The last four nodes of the previous visit.
    last: Option<Nodes<R>>,
    /// Cotangents of the nodes so far, if the gradient with respect to the ray is requested.
    cotangents: &'a mut Vec<NodeCotangent>,
}

impl<R: Real> Backward<'_, R> {
    #[inline(always)]
    fn visit(&mut self, pass: &mut Pass<'_, '_, R>, visit: &Visit<R>, by: &mut BatchGradient<R>) {
        let farther = |c: usize| self.weighted.color[c] * (self.emitted[c] - visit.emitted[c]);
        let incoming = self.background + (farther(0) + farther(1) + farther(2));
        let batch = &*visit.batch;
        let extinction = pass.dvr.medium.extinction;
        pass.to.shared.extinction += self.by_segment(batch, incoming, by) / extinction;
        if let Some(table) = pass.to.table.as_deref_mut() {
            let [r, g, b] = self.weighted.color;
            for i in 0..batch.count {
                let (mixed, drift) = (by.mixed[i].f64(), by.drift[i].f64());
                let by_mean = [mixed * r, mixed * g, mixed * b, by.extinction[i].f64()];
                let by_drift = [drift * r, drift * g, drift * b];
                batch.by_table(i, &self.own.tables, &self.compiled.curve, extinction, (by_mean, by_drift), table);
            }
        }
        let follows = pass.to.ray.is_some();
        if pass.to.voxels.is_some() || pass.voxel_seeds.is_some() || follows {
            self.by_density(batch, by);
        }
        if follows {
            note(self.cotangents, (&pass.dvr.field.values, &self.deviations), visit, by);
        }
        if let Some(seeds) = &mut pass.voxel_seeds {
            seeds.add(visit, (self.last, &self.deviations), by);
        }
        if let Some(voxels) = pass.to.voxels.as_deref_mut() {
            for (n, nodes) in visit.nodes.first(visit.fours).enumerate() {
                let i = LANES * n;
                let by_corners = self.deviations.cubic(&nodes).by_corners(at(&by.deviation, i));
                nodes.scatter(voxels, at(&by.density, i + 1), &by_corners);
            }
            if let Some(nodes) = self.last {
                let zero = R::Lanes::ZERO;
                nodes.scatter(voxels, zero.before(by.density[0]), &[[zero; LANES]; 2]);
            }
        }
        self.last = visit.nodes.first(visit.fours).next_back();
    }

    /// Computes the derivatives with respect to means, drift and depth; returns that with respect to the extinction's
    /// logarithm.
    #[inline(always)]
    fn by_segment(&self, batch: &SegmentBatch<R>, mut incoming: f64, by: &mut BatchGradient<R>) -> f64 {
        let count = batch.count.min(ROOM);
        let [r, g, b] = self.weighted.color.map(R::of);
        let source = |i: usize| r * batch.values[0][i] + g * batch.values[1][i] + b * batch.values[2][i];
        for i in 0..count {
            by.source[i] = source(i);
        }
        by.source[count] = source(count);
        for i in 0..count {
            let (length, before) = (batch.length[i], batch.before[i]);
            let mean = r * batch.mean[0][i] + g * batch.mean[1][i] + b * batch.mean[2][i];
            let (emitted, drifted) = (length * mean, by.source[i + 1] - by.source[i]);
            let (mixed, drift) = (before * batch.mixed[i], before * batch.drift[i]);
            let [by_mixed, by_drift] =
                share_slopes(batch.depth[i], [batch.transmittance[i], batch.mixed[i], batch.drift[i]]);
            by.mean[i] = mean;
            by.mixed[i] = mixed * length;
            by.drift[i] = drift;
            // What is mixed is proportional to the extinction as well; its share is kept here until it is added up.
            by.extinction[i] = mixed * emitted;
            by.light[i] = mixed * emitted + drift * drifted;
            by.depth[i] = before * (by_mixed * emitted + by_drift * drifted);
        }
        // What arrives from behind each segment.
        for (behind, light) in by.incoming[..count].iter_mut().zip(&by.light[..count]).rev() {
            *behind = R::of(incoming);
            incoming += light.f64();
        }
        // The light is no longer needed: its place takes the derivatives with respect to the extinction's logarithm.
        for i in 0..count {
            let by_depth = by.depth[i] - by.incoming[i];
            by.light[i] = by.extinction[i] + by_depth * batch.depth[i];
            by.extinction[i] = batch.length[i] * by_depth;
        }
        let by_extinction =
            by.light[..count].chunks_exact(LANES).map(|four| R::Lanes::load([four[0], four[1], four[2], four[3]]));
        by_extinction.fold(R::Lanes::ZERO, |sum, four| sum + four).sum().f64()
    }

    /// Computes the derivatives with respect to the densities at which segments begin and end.
    #[inline(always)]
    fn by_density(&self, batch: &SegmentBatch<R>, by: &mut BatchGradient<R>) {
        let tables = &self.own.tables;
        let count = batch.count.min(ROOM);
        let (sixth, half) = (R::of(1.0 / 6.0), R::of(0.5));
        let [r, g, b] = self.weighted.color.map(R::of);
        for i in 0..=count {
            let [red, green, blue, _] = &batch.slopes;
            by.source_slope[i] = r * red[i] + g * green[i] + b * blue[i];
        }
        let (extinction, source_slope, extinction_slope) = (&batch.values[3], &by.source_slope, &batch.slopes[3]);
        by.incoming[0] = R::ZERO;
        for i in 0..count {
            let (begin, end) = (extinction[i], extinction[i + 1]);
            let (near, far) = (by.source[i], by.source[i + 1]);
            let (by_mean, by_drift, by_extinction) = (by.mixed[i], by.drift[i], by.extinction[i]);
            // Of a difference of sums, divided by that of the densities; or of Simpson's rule.
            let inverse = R::ONE / (batch.density[i + 1] - batch.density[i]);
            let one_piece = batch.piece[i] == batch.piece[i + 1];
            // The slope that the means have a mean deviation's share of.
            let (deviation, steep) = (batch.deviation[i], extinction_slope[i + 1]);
            let inside =
                by_extinction * steep + half * by_mean * (steep * (near + far) + (begin + end) * source_slope[i + 1]);
            let across = (by_extinction * (end - begin) + by_mean * (end * far - begin * near)) * inverse;
            let slope = if one_piece { inside } else { across };
            let corrected = batch.corrected[i] > R::ZERO;
            let slope = if corrected { slope } else { R::ZERO };
            let over = deviation * slope;
            let (mean, mean_extinction) = (by.mean[i], batch.mean[3][i]);
            let along_line = by_extinction * mean_extinction + by_mean * mean - over;
            let difference =
                |extinction: R, source: R| by_extinction * extinction + by_mean * (extinction * source) - along_line;
            let sixths = by_mean * sixth;
            let (spread, both) = (sixths * (begin + end), sixths * (near + far) + half * by_extinction);
            let simpson = |extinction: R, source: R, i: usize| {
                (spread + sixths * extinction) * source_slope[i] + (both + sixths * source) * extinction_slope[i]
            };
            // Both, and then a choice: with a branch the loop is not compiled to vectors.
            let summed = batch.is_summed(tables, i);
            let by_sums = [-(difference(begin, near) * inverse), difference(end, far) * inverse];
            let by_simpson = [simpson(begin, near, i), simpson(end, far, i + 1)];
            let [at_begin, at_end] = if summed { by_sums } else { by_simpson };
            let tangent = |extinction: R, source: R, i: usize| {
                let emitted = extinction * source_slope[i] + source * extinction_slope[i];
                (by_extinction * extinction_slope[i] + by_mean * emitted - slope) * inverse
            };
            let bent = by_mean * steep * source_slope[i + 1];
            let across = [-tangent(begin, near, i), tangent(end, far, i + 1)];
            let turned = if one_piece { [bent; 2] } else { across };
            let more = if corrected { [deviation * turned[0], deviation * turned[1]] } else { [R::ZERO; 2] };
            by.deviation[i] = slope;
            by.density[i] = at_begin + more[0] - by_drift * source_slope[i];
            by.incoming[i + 1] = at_end + more[1] + by_drift * source_slope[i + 1];
        }
        for i in 0..count {
            by.density[i] += by.incoming[i];
        }
        by.density[count] = by.incoming[count];
    }
}
