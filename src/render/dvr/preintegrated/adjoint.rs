//! The gradient of pre-integration: the recursion of [`super::super::adjoint`] for stretches that share their ends.
//!
//! Nodes are visited near to far, also the second time: what arrives from beyond a visit is what arrives in all less
//! what the visits so far have added, in `f64` and from the very numbers that were summed up. Within a visit the
//! recursion runs from its far end, so that nothing cancels.

use super::super::adjoint::{Pass, Weighted};
use super::super::kernel::over;
use super::super::sinks::{Adjoint, Loss};
use super::super::{Optics, Radiance};
use super::light::{Front, Lit, shares};
use super::nodes::{Nodes, Sites, nodes};
use super::{Preintegrated, Scratch};
use crate::lanes::{LANES, Lanes};
use crate::real::Real;

/// Nodes that were visited together, and the stretches that end at them.
#[derive(Debug, Clone, Default)]
pub(in super::super) struct Visit<R: Real> {
    nodes: Vec<Nodes<R>>,
    /// With the number of the four that they end at, and the fours that these were cut into, if they were.
    lit: Vec<(usize, Lit<R>, usize)>,
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
        let Scratch { queue, tape, spare } = scratch;
        spare.append(tape);
        let (dvr, ray) = (pass.dvr, pass.ray);
        let values = &dvr.field.values;
        let sites = Sites { topology: pass.topology(), density: &self.density, gaps: false };
        let mut front = Front::new(&self.tables, &optics.curve);
        nodes(
            sites,
            &ray,
            queue,
            #[inline(always)]
            |queue, fours| {
                if adjoint == Adjoint::Replay {
                    front.add(values, queue, fours, |_, _, _| ());
                } else {
                    let mut visit = spare.pop().unwrap_or_default();
                    visit.record(&mut front, values, queue, fours);
                    tape.push(visit);
                }
                front.depth < dvr.depth_limit
            },
        );
        let (emitted, depth) = (front.emitted, front.depth);
        let seen = over(emitted, depth, dvr.background);
        let weighted = pass.shared(loss(&seen), &emitted, depth, &optics.tint);
        let behind = (-depth).exp() * weighted.background;
        let mut back = Backward { own: self, optics, emitted, behind, weighted, last: None };
        if adjoint == Adjoint::Replay {
            let mut visit = spare.pop().unwrap_or_default();
            let mut front = Front::new(&self.tables, &optics.curve);
            nodes(
                sites,
                &ray,
                queue,
                #[inline(always)]
                |queue, fours| {
                    visit.record(&mut front, values, queue, fours);
                    back.visit(pass, &visit);
                    front.depth < dvr.depth_limit
                },
            );
            spare.push(visit);
        } else {
            tape.iter().for_each(|visit| back.visit(pass, visit));
        }
        seen
    }
}

impl<R: Real> Visit<R> {
    #[inline(always)]
    fn record(&mut self, front: &mut Front<'_, R>, values: &[R], queue: &super::nodes::Queue<R>, fours: usize) {
        self.nodes.clear();
        self.lit.clear();
        self.nodes.extend((0..fours).map(|i| queue.four(i)));
        let lit = &mut self.lit;
        front.add(values, queue, fours, |i, light, parts| lit.push((i, light, parts)));
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

impl<R: Real> Backward<'_, R> {
    #[inline(always)]
    fn visit(&mut self, pass: &mut Pass<'_, '_, R>, visit: &Visit<R>) {
        let beyond = |c: usize| self.weighted.colour[c] * (self.emitted[c] - visit.emitted[c]);
        let mut arriving = self.behind + (beyond(0) + beyond(1) + beyond(2));
        // What a stretch asks of the node that it begins at, which is the last one of the four before.
        let mut carried = R::ZERO;
        let mut lit = visit.lit.as_slice();
        while let Some((i, light, fours)) = lit.last() {
            let [begin, end] = if *fours == 0 {
                lit = &lit[..lit.len() - 1];
                self.slopes(pass, light, &mut arriving)
            } else {
                let (rest, cut) = lit.split_at(lit.len() - LANES * fours);
                lit = rest;
                self.slopes_of_cut(pass, cut, *fours, &mut arriving)
            };
            if let Some(voxels) = pass.sinks.voxels.as_deref_mut() {
                visit.nodes[*i].scatter(voxels, end + begin.before(carried));
            }
            carried = begin.store()[0];
        }
        if let (Some(nodes), Some(voxels)) = (self.last, pass.sinks.voxels.as_deref_mut()) {
            nodes.scatter(voxels, R::Lanes::ZERO.before(carried));
        }
        self.last = visit.nodes.last().copied();
    }

    /// Derivatives with respect to the densities where four stretches begin and end.
    #[inline(always)]
    fn slopes(&self, pass: &mut Pass<'_, '_, R>, lit: &Lit<R>, arriving: &mut f64) -> [R::Lanes; 2] {
        let all = |v: f64| R::Lanes::splat(R::of(v));
        let weights = self.weighted.colour.map(all);
        let Lit { stretches, length, depth, before, shares } = lit;
        let (mean, change) = (&stretches.mean, stretches.drift());
        let emitted = *length * (weights[0] * mean[0] + weights[1] * mean[1] + weights[2] * mean[2]);
        let drifted = weights[0] * change[0] + weights[1] * change[1] + weights[2] * change[2];
        let light = *before * (shares.mixed * emitted + shares.drift * drifted);
        // From beyond each: that of those behind it in the four, and of all behind the four.
        let behind = light.before(R::ZERO);
        let pairs = behind + behind.before(R::ZERO);
        let behind = pairs + pairs.before(R::ZERO).before(R::ZERO);
        let [by_mixed, by_drift] = shares.slopes(*depth);
        let by_depth = *before * (by_mixed * emitted + by_drift * drifted) - (all(*arriving) + behind);
        *arriving += light.sum().f64();
        let (mixed, drift) = (*before * shares.mixed, *before * shares.drift);
        let extinction = pass.dvr.medium.extinction;
        // Light that is mixed is proportional to the extinction as well.
        pass.sinks.shared.extinction += (mixed * emitted + by_depth * *depth).sum().f64() / extinction;
        let share = mixed * *length;
        let by_mean = [share * weights[0], share * weights[1], share * weights[2], *length * by_depth];
        let by_drift = weights.map(|w| w * drift);
        if let Some(table) = pass.sinks.table.as_deref_mut() {
            stretches.by_table(&self.own.tables, &self.optics.curve, extinction, by_mean, by_drift, table);
        }
        stretches.slopes(&self.own.tables, by_mean, by_drift)
    }

    /// The same for four that were cut.
    #[inline(never)]
    fn slopes_of_cut(
        &self,
        pass: &mut Pass<'_, '_, R>,
        cut: &[(usize, Lit<R>, usize)],
        fours: usize,
        arriving: &mut f64,
    ) -> [R::Lanes; 2] {
        let part = R::Lanes::splat(R::of(1.0 / (LANES * fours) as f64));
        let (mut begins, mut ends) = ([R::ZERO; LANES], [R::ZERO; LANES]);
        for (number, (_, lit, _)) in cut.iter().enumerate().rev() {
            let [begin, end] = self.slopes(pass, lit, arriving);
            let share = shares::<R>(number % fours, fours);
            let by_end = begin * (share - part) + end * share;
            let i = number / fours;
            ends[i] += by_end.sum();
            begins[i] += (begin + end - by_end).sum();
        }
        [R::Lanes::load(begins), R::Lanes::load(ends)]
    }
}
