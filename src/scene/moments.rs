//! A scene while the shutter of a camera is open: its volumes go with their velocities, and its objects move.
//!
//! What is at a place `x` at a time `t` was, at that of the frame, at `x - t u(x - t u(x))`, where `u` are the
//! velocities of the frame: two steps backwards (semi-Lagrangian advection; Kim & Ko 2007), as Cycles takes them.

use crate::error::{Code, Error, Result};
use crate::math::Affine;
use crate::scene::bricks::{BRICK, Bricks, Topology, Voxel};
use crate::scene::emission::Emitted;
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::motion::{Motion, Object};
use crate::scene::scene::Scene;
use crate::scene::topology::table_entries;
use crate::scene::velocity::Velocity;
use crate::scene::volume::Volume;
use glam::{DMat4, DVec3, IVec3};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::ops::{Add, Mul};
use std::sync::Arc;

/// Largest coordinate of bricks whose voxels have coordinates of 32 bits.
const MOST_BRICK: i32 = 1 << 27;
/// Fewest and most moments at which a scene that moves is seen.
const MOMENTS: [usize; 2] = [4, 16];

impl Scene {
    /// Puts the moments into a scene that moves while the shutter is open, `open` being the times in frames after that
    /// of the scene at which it opens and closes. There are as many as volumes move voxels by their velocities, from 4
    /// to 16, and 16 where objects move. Returns whether anything moves.
    ///
    /// # Errors
    /// If the volumes of all moments do not fit into `max_memory` bytes.
    pub fn opened(&mut self, open: [f64; 2], max_memory: u64) -> Result<bool> {
        let displacement = |(number, velocity): &(usize, Velocity)| {
            let density = self.volumes.get(*number).and_then(Volume::density);
            density.map_or(0.0, |(field, _)| field.displacement(velocity))
        };
        let furthest = self.velocities.iter().map(displacement).fold(0.0, f64::max) * (open[1] - open[0]);
        let moves = !self.motions.is_empty();
        if !(moves || furthest > 0.0 && furthest.is_finite()) {
            return Ok(false);
        }
        let count = if moves { MOMENTS[1] } else { (furthest.ceil() as usize).clamp(MOMENTS[0], MOMENTS[1]) };
        let each = max_memory / count as u64;
        let at = |moment: usize| {
            let share = (moment as f64 + 0.5) / count as f64;
            let time = open[0] + (open[1] - open[0]) * share;
            let mut scene = Self { velocities: Vec::new(), cameras: Vec::new(), ..self.clone() };
            for (number, velocity) in &self.velocities {
                scene.volumes[*number] = self.volumes[*number].advected(velocity, time, each)?;
            }
            scene.moved(&self.motions, share)?;
            Ok(scene)
        };
        self.moments = (0..count).map(at).collect::<Result<_>>()?;
        Ok(true)
    }
}

impl Scene {
    /// Moves volumes and meshes to where they are at a time from 0, as the shutter opens, to 1, as it closes.
    fn moved(&mut self, motions: &[Motion], time: f64) -> Result<()> {
        let mut meshes = Vec::new();
        for motion in motions {
            let map = motion.at(time);
            match motion.object {
                Object::Volume(number) => {
                    if let Some(volume) = self.volumes.get_mut(number) {
                        volume.place(map)?;
                    }
                }
                Object::Mesh(number) => meshes.push((number, map)),
            }
        }
        if let Some(still) = self.meshes.as_ref().filter(|_| !meshes.is_empty()) {
            self.meshes = Some(Arc::new(still.moved(&meshes)?));
        }
        self.motions.clear();
        Ok(())
    }
}

impl Volume {
    /// Moves the volume by a map of world points.
    fn place(&mut self, map: DMat4) -> Result<()> {
        match self {
            Self::Density(field, _) => field.transform = field.transform.then(&Affine::new(map)?)?,
            Self::PreShaded(volume) => volume.transform = volume.transform.then(&Affine::new(map)?)?,
            Self::Emissive { density, emission, .. } => {
                let map = Affine::new(map)?;
                density.transform = density.transform.then(&map)?;
                let grid = emission.grid();
                let transform = grid.transform.then(&map)?;
                **emission = Emitted::new(Bricks { transform, ..grid.clone() });
            }
        }
        Ok(())
    }

    /// Returns the volume at a time in frames after its own.
    fn advected(&self, velocity: &Velocity, time: f64, max_memory: u64) -> Result<Self> {
        Ok(match self {
            Self::Density(field, medium) => Self::Density(field.advected(velocity, time, max_memory)?, medium.clone()),
            Self::PreShaded(volume) => Self::PreShaded(volume.advected(velocity, time, max_memory)?),
            Self::Emissive { density, medium, emission } => {
                let grid = emission.grid().advected(velocity, time, max_memory / 2)?;
                Self::Emissive {
                    density: density.advected(velocity, time, max_memory / 2)?,
                    medium: medium.clone(),
                    emission: Box::new(Emitted::new(grid)),
                }
            }
        })
    }
}

impl<V: Voxel + Add<Output = V> + Mul<f32, Output = V>> Bricks<V> {
    /// Returns the steps in voxels that a brick's voxels take in a frame, from the least to the greatest by axis.
    fn steps(&self, velocity: &Velocity, brick: IVec3) -> [DVec3; 2] {
        let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for voxel in 0..LEAF_VOXELS as i32 {
            let index = (8 * brick + IVec3::new(voxel >> 6, voxel >> 3 & 7, voxel & 7)).as_dvec3();
            let world = self.transform.to_world(index);
            let step = self.transform.to_index(world + velocity.per_frame(world)) - index;
            (least, most) = (least.min(step), most.max(step));
        }
        [least, most]
    }

    /// Returns the most voxels that the field moves in a frame, along an axis.
    fn displacement(&self, velocity: &Velocity) -> f64 {
        let most = |(brick, _): (IVec3, u32)| {
            let [least, most] = self.steps(velocity, brick);
            least.abs().max(most.abs()).max_element()
        };
        let places: Vec<_> = self.topology.places().collect();
        places.into_par_iter().map(most).reduce(|| 0.0, f64::max)
    }

    /// Returns the field at a time in frames after its own.
    ///
    /// # Errors
    /// If its bricks then take more than `max_memory` bytes.
    fn advected(&self, velocity: &Velocity, time: f64, max_memory: u64) -> Result<Self> {
        let places: Vec<_> = self.topology.places().collect();
        let reached = |(brick, _): &(IVec3, u32)| {
            let [a, b] = self.steps(velocity, *brick).map(|step| time * step);
            let low = (8 * *brick).as_dvec3() + a.min(b) - 1.0;
            let high = (8 * *brick + 8).as_dvec3() + a.max(b) + 1.0;
            [low, high].map(|at| (at / 8.0).floor())
        };
        let boxes: Vec<[DVec3; 2]> = places.par_iter().map(reached).collect();
        let too_large = || {
            Error::unsupported("a volume that moves is too large for its motion to be blurred")
                .coded(Code::MemoryLimit)
                .hint("raise ⟨max_memory⟩, or give ⟨shutter=0⟩ for pictures without motion")
        };
        let each = 2 * (BRICK * size_of::<V>()) as u64;
        let most = max_memory / each;
        // Boxes overlap. Far more bricks than there is memory for are refused before one of them is counted.
        let visited: f64 = boxes.iter().map(|[low, high]| (*high - *low + 1.0).element_product()).sum();
        let furthest = boxes.iter().flatten().fold(0.0, |most: f64, corner| most.max(corner.abs().max_element()));
        if visited.is_nan() || visited > 64.0 * most as f64 || furthest > f64::from(MOST_BRICK) {
            return Err(too_large());
        }
        let mut needed = BTreeSet::new();
        for [low, high] in boxes.into_iter().map(|ends| ends.map(|at| at.as_ivec3())) {
            for x in low.x..=high.x {
                for y in low.y..=high.y {
                    needed.extend((low.z..=high.z).map(|z| [x, y, z]));
                }
            }
            if needed.len() as u64 > most {
                return Err(too_large());
            }
        }
        let corner = |[a, b]: [IVec3; 2], brick: &[i32; 3]| [a.min((*brick).into()), b.max((*brick).into())];
        let [low, high] = needed.iter().fold([IVec3::MAX, IVec3::MIN], corner);
        let table = if needed.is_empty() { 0 } else { table_entries(low, high)? };
        if (table * size_of::<u32>()) as u64 > max_memory {
            return Err(too_large());
        }
        let topology = Arc::new(Topology::new(needed.into_iter().map(IVec3::from_array))?);
        let mut owned = vec![self.background; topology.len() * LEAF_VOXELS];
        owned.par_chunks_mut(LEAF_VOXELS).zip(topology.bricks().par_iter()).for_each(|(values, brick)| {
            for (voxel, value) in (0..).zip(values) {
                let index = (8 * *brick + IVec3::new(voxel >> 6, voxel >> 3 & 7, voxel & 7)).as_dvec3();
                let world = self.transform.to_world(index);
                let half = world - time * velocity.per_frame(world);
                *value = self.trilinear(self.transform.to_index(world - time * velocity.per_frame(half)));
            }
        });
        let mut values = vec![self.background; topology.len() * BRICK];
        topology.fill_apron(&owned, &mut values);
        let domain = if self.domain == self.topology.bounds() { topology.bounds() } else { self.domain };
        Ok(Self { topology, values, domain, ..self.clone() })
    }

    /// Returns the value at index coordinates.
    fn trilinear(&self, index: DVec3) -> V {
        let Some(corners) = self.corners(index) else { return self.background };
        let mut sum = None;
        for (voxel, weight) in corners {
            let part = self.values[voxel] * weight as f32;
            sum = Some(sum.map_or(part, |sum| sum + part));
        }
        sum.unwrap_or(self.background)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::scene::medium::Medium;
    use glam::Vec3;

    /// A bump about a place in index space, which stays what it is where it is moved by whole voxels.
    fn bump(centre: DVec3) -> Bricks<f32> {
        let topology = Arc::new(Topology::new((0..27).map(|i| IVec3::new(i / 9, i / 3 % 3, i % 3))).unwrap());
        let value = |at: IVec3| (1.0 - 0.3 * (at.as_dvec3() - centre).length()).max(0.0) as f32;
        let owned: Vec<f32> = topology
            .bricks()
            .iter()
            .flat_map(|brick| (0..512).map(move |i| value(8 * *brick + IVec3::new(i >> 6, i >> 3 & 7, i & 7))))
            .collect();
        let mut field = Bricks::zeros(topology.clone(), Affine::uniform(0.5, DVec3::ONE).unwrap());
        topology.fill_apron(&owned, &mut field.values);
        field
    }

    fn wind(by: Vec3) -> Velocity {
        Velocity::new(Affine::uniform(1.0, DVec3::ZERO).unwrap(), by, false, 2.0).unwrap()
    }

    /// An even wind moves all by its speed times the time: world units per second, two frames a second, voxels of half
    /// a world unit.
    #[test]
    fn an_even_wind_moves_all_alike() {
        let field = bump(DVec3::splat(11.0));
        let wind = wind(Vec3::new(3.0, 0.0, -1.0));
        assert!((field.displacement(&wind) - 3.0).abs() < 1e-9);
        for time in [1.0, -2.0, 3.0] {
            let moved = field.advected(&wind, time, 1 << 30).unwrap();
            let expected = bump(DVec3::splat(11.0) + time * DVec3::new(3.0, 0.0, -1.0));
            for (brick, _) in expected.topology.places() {
                for voxel in 0..512 {
                    let at = (8 * brick + IVec3::new(voxel >> 6, voxel >> 3 & 7, voxel & 7)).as_dvec3();
                    let (found, expected) = (moved.trilinear(at), expected.trilinear(at));
                    assert!((found - expected).abs() < 1e-5, "{time} {at}: {found} {expected}");
                }
            }
        }
        assert!(field.advected(&wind, 1.0, 1 << 10).is_err());
    }

    /// A gust that no file should hold is refused at once: its bricks are neither counted nor indexed.
    #[test]
    fn gusts_beyond_memory_are_refused() {
        let field = bump(DVec3::splat(11.0));
        for speed in [1e10, 1e12, 1e30] {
            let wind = wind(Vec3::new(speed, -speed, speed));
            for time in [1.0, -1.0] {
                assert!(field.advected(&wind, time, 1 << 28).is_err(), "{speed} {time}");
            }
        }
        // Far from where it was, an even wind leaves it what it is.
        assert!(field.advected(&wind(Vec3::splat(1e6)), 1.0, 1 << 28).is_ok());
    }

    #[test]
    fn moments_are_spread_over_the_time() {
        let field = bump(DVec3::splat(11.0));
        let mut scene = Scene {
            volumes: vec![Volume::Density(field, Medium::absorbing(1.0))],
            velocities: vec![(0, wind(Vec3::new(3.0, 0.0, 0.0)))],
            ..Scene::default()
        };
        assert!(scene.opened([-1.0, 1.0], 1 << 30).unwrap());
        assert_eq!(scene.moments.len(), 6);
        let middle = |scene: &Scene| {
            let (field, _) = scene.volumes[0].density().unwrap();
            let (mut sum, mut mass) = (0.0, 0.0);
            for (brick, _) in field.topology.places() {
                for voxel in 0..512 {
                    let at = (8 * brick + IVec3::new(voxel >> 6, voxel >> 3 & 7, voxel & 7)).as_dvec3();
                    let value = f64::from(field.trilinear(at));
                    (sum, mass) = (sum + value * at.x, mass + value);
                }
            }
            sum / mass
        };
        for (number, moment) in scene.moments.iter().enumerate() {
            let time = -1.0 + (number as f64 + 0.5) / 3.0;
            assert!((middle(moment) - (11.0 + 3.0 * time)).abs() < 0.02, "{number}");
        }
        let mut still = Scene { velocities: vec![(0, wind(Vec3::ZERO))], moments: Vec::new(), ..scene.clone() };
        assert!(!still.opened([-1.0, 1.0], 1 << 30).unwrap() && still.moments.is_empty());
    }
}
