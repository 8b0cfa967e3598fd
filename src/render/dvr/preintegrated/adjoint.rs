//! The gradient of pre-integration: the recursion of [`super::super::adjoint`] for stretches that share their ends.
//!
//! Nodes are visited near to far, also the second time: what arrives from beyond a visit is what arrives in all less
//! what the visits so far have added, in `f64` and from the very numbers that were summed up. Within a visit the
//! recursion runs from its far end, so that nothing cancels.

use super::super::adjoint::{Pass, Weighted};
use super::super::kernel::over;
use super::super::sinks::{Adjoint, Loss};
use super::super::{Optics, Radiance};
use super::light::Front;
use super::nodes::{Nodes, Queue, Sites, nodes};
use super::row::{ROOM, Row, share_slopes};
use super::{Preintegrated, Scratch};
use crate::lanes::{LANES, Lanes};
use crate::real::Real;

/// Visits that replay keeps, the nearest ones: it walks again, and looks up again, what is behind them.
const KEPT: usize = 6;

/// Nodes that were visited together, and the stretches that end at them.
#[derive(Debug, Clone, Default)]
pub(in super::super) struct Visit<R: Real> {
    nodes: Vec<Nodes<R>>,
    row: Box<Row<R>>,
    /// Light of all visits up to this one.
    emitted: [f64; 3],
}

impl<R: Real> Preintegrated<R> {
    /// One ray's forward and backward pass.
    #[inline(always)]
    pub fn gradient(
        &self,
        pass: &mut Pass<'_, '_, R>,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        optics: &Optics<R, 3>,
        scratch: &mut Scratch<R>,
    ) -> Radiance<R> {
        let Scratch { queue, row, by_row, tape, spare } = scratch;
        spare.append(tape);
        let (dvr, ray) = (pass.dvr, pass.ray);
        let values = &dvr.field.values;
        let sites = Sites { topology: pass.topology(), density: &self.density, gaps: false };
        let keep = if adjoint == Adjoint::Replay { KEPT } else { usize::MAX };
        let mut front = Front::new(&self.tables, &optics.curve);
        // Where visits are no longer kept.
        let mut rest = None;
        nodes(
            sites,
            &ray,
            queue,
            #[inline(always)]
            |queue, fours| {
                if tape.len() < keep {
                    let mut visit = spare.pop().unwrap_or_default();
                    visit.record(&mut front, values, queue, fours);
                    tape.push(visit);
                } else {
                    rest.get_or_insert(front);
                    front.add(values, queue, fours, row);
                }
                front.depth < dvr.depth_limit
            },
        );
        let (emitted, depth) = (front.emitted, front.depth);
        let seen = over(emitted, depth, dvr.background);
        let weighted = pass.shared(loss(&seen), &emitted, depth, &optics.tint);
        let behind = (-depth).exp() * weighted.background;
        let mut back = Backward { own: self, optics, emitted, behind, weighted, last: None };
        // Not `for_each`: its closure would be compiled for the oldest instruction set.
        for visit in tape.iter() {
            back.visit(pass, visit, by_row);
        }
        if let Some(mut front) = rest {
            let mut visit = spare.pop().unwrap_or_default();
            let mut kept = tape.len();
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
                    visit.record(&mut front, values, queue, fours);
                    back.visit(pass, &visit, by_row);
                    front.depth < dvr.depth_limit
                },
            );
            spare.push(visit);
        }
        seen
    }
}

impl<R: Real> Visit<R> {
    #[inline(always)]
    fn record(&mut self, front: &mut Front<'_, R>, values: &[R], queue: &Queue<R>, fours: usize) {
        self.nodes.clear();
        self.nodes.extend((0..fours).map(|i| queue.four(i)));
        front.add(values, queue, fours, &mut self.row);
        self.emitted = front.emitted;
    }
}

/// State of the second pass.
struct Backward<'a, R: Real> {
    own: &'a Preintegrated<R>,
    optics: &'a Optics<R, 3>,
    /// Light of the whole ray.
    emitted: [f64; 3],
    /// What arrives from the background, loss-weighted.
    behind: f64,
    weighted: Weighted<3>,
    /// The last nodes of the visit before.
    last: Option<Nodes<R>>,
}

/// Derivatives with respect to what a row holds, and what goes into them.
#[derive(Debug, Clone)]
pub(super) struct ByRow<R> {
    /// By stretch: with respect to its means, its drift, its optical depth; its light.
    mean: [[R; ROOM]; 4],
    drift: [[R; ROOM]; 3],
    depth: [R; ROOM],
    light: [R; ROOM],
    /// Slopes of colours and extinction at the ends.
    slopes: [[R; ROOM + 1]; 4],
    /// With respect to the densities at the ends; in `behind` that of the stretches that end there alone, and before
    /// that what arrives from behind each stretch.
    density: [R; ROOM + 1],
    behind: [R; ROOM + 1],
}

impl<R: Real> Default for ByRow<R> {
    fn default() -> Self {
        let (stretch, ends) = ([R::ZERO; ROOM], [R::ZERO; ROOM + 1]);
        Self {
            mean: [stretch; 4],
            drift: [stretch; 3],
            depth: stretch,
            light: stretch,
            slopes: [ends; 4],
            density: ends,
            behind: ends,
        }
    }
}

impl<R: Real> Backward<'_, R> {
    #[inline(always)]
    fn visit(&mut self, pass: &mut Pass<'_, '_, R>, visit: &Visit<R>, by: &mut ByRow<R>) {
        let beyond = |c: usize| self.weighted.colour[c] * (self.emitted[c] - visit.emitted[c]);
        let arriving = self.behind + (beyond(0) + beyond(1) + beyond(2));
        let row = &*visit.row;
        let extinction = pass.dvr.medium.extinction;
        pass.sinks.shared.extinction += self.by_stretch(row, arriving, by) / extinction;
        if let Some(table) = pass.sinks.table.as_deref_mut() {
            for i in 0..row.count {
                let by_mean = [0, 1, 2, 3].map(|c| by.mean[c][i].f64());
                let by_drift = [0, 1, 2].map(|c| by.drift[c][i].f64());
                row.by_table(i, &self.own.tables, &self.optics.curve, extinction, by_mean, by_drift, table);
            }
        }
        if let Some(voxels) = pass.sinks.voxels.as_deref_mut() {
            self.by_density(row, by);
            if !row.cut.is_empty() {
                by.density = row.by_nodes(&by.density);
            }
            let by_density = &by.density;
            for (four, nodes) in visit.nodes.iter().enumerate() {
                let n = (LANES * four).min(ROOM - LANES) + 1;
                let by = [by_density[n], by_density[n + 1], by_density[n + 2], by_density[n + 3]];
                nodes.scatter(voxels, R::Lanes::load(by));
            }
            if let Some(nodes) = self.last {
                nodes.scatter(voxels, R::Lanes::ZERO.before(by_density[0]));
            }
        }
        self.last = visit.nodes.last().copied();
    }

    /// Derivatives by means and drifts; returns that by the extinction's logarithm.
    #[inline(always)]
    fn by_stretch(&self, row: &Row<R>, mut arriving: f64, by: &mut ByRow<R>) -> f64 {
        let count = row.count.min(ROOM);
        let weights = self.weighted.colour.map(R::of);
        let [red, green, blue, _] = &row.values;
        for i in 0..count {
            let (mean, length, before) = (&row.mean, row.length[i], row.before[i]);
            let emitted = length * (weights[0] * mean[0][i] + weights[1] * mean[1][i] + weights[2] * mean[2][i]);
            let drifted = weights[0] * (red[i + 1] - red[i])
                + weights[1] * (green[i + 1] - green[i])
                + weights[2] * (blue[i + 1] - blue[i]);
            let (mixed, drift) = (before * row.mixed[i], before * row.drift[i]);
            let [by_mixed, by_drift] = share_slopes(row.depth[i], row.open[i], row.mixed[i]);
            by.light[i] = mixed * emitted + drift * drifted;
            by.depth[i] = before * (by_mixed * emitted + by_drift * drifted);
            by.mean[0][i] = mixed * length * weights[0];
            by.mean[1][i] = mixed * length * weights[1];
            by.mean[2][i] = mixed * length * weights[2];
            // What is mixed is proportional to the extinction as well; its share is kept here until it is added up.
            by.mean[3][i] = mixed * emitted;
            by.drift[0][i] = drift * weights[0];
            by.drift[1][i] = drift * weights[1];
            by.drift[2][i] = drift * weights[2];
        }
        // What arrives from behind each stretch.
        for (behind, light) in by.behind[..count].iter_mut().zip(&by.light[..count]).rev() {
            *behind = R::of(arriving);
            arriving += light.f64();
        }
        // Light is no longer needed: in its place comes what is asked of the extinction's logarithm.
        for i in 0..count {
            let by_depth = by.depth[i] - by.behind[i];
            by.light[i] = by.mean[3][i] + by_depth * row.depth[i];
            by.mean[3][i] = row.length[i] * by_depth;
        }
        let by_extinction =
            by.light[..count].chunks_exact(LANES).map(|four| R::Lanes::load([four[0], four[1], four[2], four[3]]));
        by_extinction.fold(R::Lanes::ZERO, |sum, four| sum + four).sum().f64()
    }

    /// Derivatives with respect to the densities where stretches begin and end.
    #[inline(always)]
    fn by_density(&self, row: &Row<R>, by: &mut ByRow<R>) {
        let tables = &self.own.tables;
        let count = row.count.min(ROOM);
        let (sixth, half) = (R::of(1.0 / 6.0), R::of(0.5));
        let slope = |i: usize| tables.piece(row.piece[i]).slope;
        let first = slope(0).store();
        for c in 0..4 {
            by.slopes[c][0] = first[c];
        }
        for four in 0..count / LANES {
            let n = (LANES * four).min(ROOM - LANES) + 1;
            let slopes = R::Lanes::transpose([slope(n), slope(n + 1), slope(n + 2), slope(n + 3)]);
            for c in 0..4 {
                by.slopes[c][n..n + LANES].copy_from_slice(&slopes[c].store());
            }
        }
        let extinction = &row.values[3];
        by.density[count] = R::ZERO;
        by.behind[0] = R::ZERO;
        let slopes = &by.slopes;
        for i in 0..count {
            let (begin, end) = (extinction[i], extinction[i + 1]);
            let (near_begin, near_end) = (sixth * (begin + begin + end), sixth * (begin + end + end));
            let inverse = R::ONE / (row.density[i + 1] - row.density[i]);
            let (mut colours, mut extinctions) = ([R::ZERO; 2], [half * by.mean[3][i]; 2]);
            let mut off = [begin - row.mean[3][i], end - row.mean[3][i]].map(|off| off * by.mean[3][i]);
            let mut drift = [R::ZERO; 2];
            for c in 0..3 {
                let (v, mean, by_mean) = (&row.values[c], row.mean[c][i], by.mean[c][i]);
                colours[0] += by_mean * near_begin * slopes[c][i];
                colours[1] += by_mean * near_end * slopes[c][i + 1];
                extinctions[0] += by_mean * sixth * (v[i] + v[i] + v[i + 1]);
                extinctions[1] += by_mean * sixth * (v[i] + v[i + 1] + v[i + 1]);
                off[0] += by_mean * (begin * v[i] - mean);
                off[1] += by_mean * (end * v[i + 1] - mean);
                drift[0] += by.drift[c][i] * slopes[c][i];
                drift[1] += by.drift[c][i] * slopes[c][i + 1];
            }
            // Of a difference of sums, divided by that of the densities; or of Simpson's rule.
            let summed = row.is_summed(tables, i);
            let at_begin = if summed { -(off[0] * inverse) } else { colours[0] + extinctions[0] * slopes[3][i] };
            let at_end = if summed { off[1] * inverse } else { colours[1] + extinctions[1] * slopes[3][i + 1] };
            by.density[i] = at_begin - drift[0];
            by.behind[i + 1] = at_end + drift[1];
        }
        // Not to the last but one and one more: that would be a loop without vectors.
        for (density, behind) in by.density[..count + 1].iter_mut().zip(&by.behind[..count + 1]) {
            *density += *behind;
        }
    }
}
