//! Forward mode of pre-integration: the rows of the Jacobian, one for each channel and the optical depth, by reverse
//! mode, times the directions.
//!
//! The four passes cost less than the derivatives of every table lookup along several directions would, and the
//! derivatives are those of the computed value, as in reverse mode.

use super::super::adjoint::Pass;
use super::super::tape::Tape;
use super::super::{CompiledCurve, Dvr, Precision};
use super::batch::at;
use super::deviation::Deviations;
use super::visit::{BatchGradient, Visit};
use super::{Nodes, Preintegrated};
use crate::dual::Dual;
use crate::real::{LANES, Lanes, Real};
use crate::render::differentiable::TangentRadiance;
use crate::render::differentiable::{Accumulators, Adjoint, Cotangent, Loss, ParameterGradient, RayGradient, Seeds};
use crate::render::emission_absorption::Radiance;
use crate::render::march::IndexRay;

/// Changes of the stored values along several directions, and the derivatives of the loss along them.
pub(in super::super) struct VoxelSeeds<'s, R> {
    seeds: &'s [Option<&'s [R]>],
    derivatives: &'s mut [f64],
}

impl<R: Real> VoxelSeeds<'_, R> {
    /// Adds the derivatives by the densities at a visit's nodes, and at the last node before them. No stored value's
    /// own derivative is needed: a density changes by the interpolated change of the stored values.
    #[inline(never)]
    pub(super) fn add(
        &mut self,
        visit: &Visit<R>,
        (before, deviations): (Option<Nodes<R>>, &Deviations<R>),
        by: &BatchGradient<R>,
    ) {
        for (seed, sum) in self.seeds.iter().zip(self.derivatives.iter_mut()) {
            let Some(seed) = seed else { continue };
            for (n, nodes) in visit.nodes.first(visit.fours).enumerate() {
                let (corners, i) = (nodes.corners(seed), LANES * n);
                let deviation = deviations.cubic(&nodes).deviation(&corners);
                let along = nodes.densities(&corners) * at(&by.density, i + 1) + deviation * at(&by.deviation, i);
                *sum += along.sum().f64();
            }
            if let Some(nodes) = before {
                let density = nodes.densities(&nodes.corners(seed));
                *sum += (density * R::Lanes::ZERO.before(by.density[0])).sum().f64();
            }
        }
    }
}

/// Derivatives of one channel, or of the optical depth, along `P` directions.
type Row<const P: usize> = [f64; P];

impl<R: Precision> Preintegrated<R> {
    /// Returns the radiance along a ray with its derivatives; `None` if the ray's error may exceed the tolerance.
    pub(crate) fn jvp<const P: usize>(
        &self,
        dvr: &Dvr<'_, R>,
        ray: IndexRay,
        compiled: &CompiledCurve<R, 3>,
        seeds: &Seeds<'_, R, P>,
        tape: &mut Tape<R>,
    ) -> Option<TangentRadiance<P>> {
        let channel = |c: usize| {
            move |_: &Radiance| {
                let mut rgb = [R::ZERO; 3];
                rgb[c] = R::ONE;
                Cotangent { rgb, transmittance: 0.0 }
            }
        };
        // Of the optical depth, not the transmittance, which may be 0: `dT = -T dx`.
        let depth = |radiance: &Radiance| {
            let transmittance = radiance.transmittance();
            let by_transmittance = if transmittance > 0.0 { -1.0 / transmittance } else { 0.0 };
            Cotangent { rgb: [R::ZERO; 3], transmittance: by_transmittance }
        };
        let mut row = |loss: Loss<'_, R>| self.row((dvr, compiled), ray, loss, seeds, tape);
        let (red, radiance) = row(&mut channel(0))?;
        let rgb = [red, row(&mut channel(1))?.0, row(&mut channel(2))?.0];
        let depth = Dual { value: radiance.depth, tangent: row(&mut { depth })?.0 };
        Some(TangentRadiance { rgb: std::array::from_fn(|c| Dual { value: radiance.rgb[c], tangent: rgb[c] }), depth })
    }

    /// Returns the derivatives of a loss along the directions.
    fn row<const P: usize>(
        &self,
        (dvr, compiled): (&Dvr<'_, R>, &CompiledCurve<R, 3>),
        ray: IndexRay,
        loss: Loss<'_, R>,
        seeds: &Seeds<'_, R, P>,
        tape: &mut Tape<R>,
    ) -> Option<(Row<P>, Radiance)> {
        let (mut by_ray, mut shared, mut by_voxels) = (RayGradient::default(), ParameterGradient::default(), [0.0; P]);
        let by_table = &mut tape.by_table;
        let knots = seeds.table.iter().flatten().next().map(|table| table.steps.len());
        if let Some(knots) = knots {
            by_table.reset(knots);
        }
        let to = Accumulators {
            voxels: None,
            table: knots.is_some().then_some(&mut *by_table),
            ray: seeds.ray.iter().any(|by| *by != RayGradient::default()).then_some(&mut by_ray),
            shared: &mut shared,
        };
        let mut pass = Pass::new(dvr, ray, to);
        if seeds.voxels.iter().any(Option::is_some) {
            pass.voxel_seeds = Some(VoxelSeeds { seeds: &seeds.voxels, derivatives: &mut by_voxels });
        }
        let radiance = self.whole(&mut pass, loss, compiled, &mut tape.preintegrated)?;
        let row = std::array::from_fn(|p| {
            let (seed, shared_seed) = (&seeds.ray[p], &seeds.shared[p]);
            by_voxels[p]
                + by_ray.origin.dot(seed.origin)
                + by_ray.direction.dot(seed.direction)
                + shared.extinction * shared_seed.extinction
                + seeds.table[p].map_or(0.0, |seed| by_table.dot(seed))
        });
        Some((row, radiance))
    }

    /// Runs one reverse pass; compiled once for all numbers of directions.
    #[inline(never)]
    pub(in super::super) fn whole(
        &self,
        pass: &mut Pass<'_, '_, R>,
        loss: Loss<'_, R>,
        compiled: &CompiledCurve<R, 3>,
        scratch: &mut super::Scratch<R>,
    ) -> Option<Radiance> {
        self.gradient(pass, loss, Adjoint::Tape, compiled, scratch)
    }
}
