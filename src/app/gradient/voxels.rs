//! Derivatives by voxel as a grid.

use super::GradientSettings;
use crate::differentiate::study::subject::Subject;
use crate::differentiate::study::{Study, StudyGradient};
use crate::scene::bricks::Topology;
use crate::scene::grid::{Grid, GridClass, LEAF_VOXELS, Leaf};
use std::collections::BTreeMap;

impl GradientSettings {
    /// Returns the derivatives by voxel as grids, one a channel; none if they are not to be written.
    pub(super) fn as_grids<V: Subject>(&self, study: &Study<V>, gradient: &StudyGradient) -> Vec<Grid> {
        let channels = self.channels::<V>();
        let grid = |(at, channel): (usize, &usize)| Grid {
            name: match V::CHANNELS[*channel] {
                "density" => "gradient".into(),
                other => format!("gradient_{}", other.replace('.', "_")),
            },
            class: GridClass::Unknown,
            transform: study.field.transform,
            background: 0.0,
            leaves: {
                let own: Vec<f64> = gradient.by_voxel.iter().skip(at).step_by(channels.len()).copied().collect();
                leaves(&study.field.topology, &own)
            },
            tiles: Vec::new(),
            metadata: BTreeMap::new(),
        };
        channels.iter().enumerate().filter(|_| self.output.is_some()).map(grid).collect()
    }
}

/// Returns the leaves of the bricks in which a derivative is not zero; the voxels of such derivatives are active.
fn leaves(topology: &Topology, by_voxel: &[f64]) -> Vec<Leaf> {
    let leaf = |(brick, values): (&glam::IVec3, &[f64])| {
        let mut leaf = Leaf { origin: (8 * *brick).to_array(), values: [0.0; LEAF_VOXELS], active: [0; 8] };
        for (i, v) in values.iter().enumerate().filter(|(_, v)| **v != 0.0) {
            leaf.values[i] = *v as f32;
            leaf.active[i >> 6] |= 1 << (i & 63);
        }
        (leaf.active != [0; 8]).then_some(leaf)
    };
    topology.bricks().iter().zip(by_voxel.chunks(LEAF_VOXELS)).filter_map(leaf).collect()
}
