//! Histograms of the values of volumes, as lines of steps.

use super::plot::{Plot, Series};
use crate::scene::bricks::{BRICK, Bricks, CELLS, slot};

/// Number of bins.
const BINS: usize = 64;

/// Plot of how many voxels have which value, zeros left out, of a volume and, dashed, of a reference; `None` if no
/// voxel of either has a value. Voxels of a reference are counted in volumes of the first one's voxels, so that
/// lattices of different voxels can be compared.
pub(crate) fn plot(quantity: &str, volume: &Bricks<f32>, reference: Option<&Bricks<f32>>) -> Option<Plot> {
    let fields: Vec<(&str, &Bricks<f32>)> =
        [("volume", volume)].into_iter().chain(reference.map(|reference| ("reference", reference))).collect();
    let all = fields.iter().flat_map(|(_, field)| values(field));
    let (low, high) = all.fold((0.0_f64, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if high <= low {
        return None;
    }
    let width = (high - low) / BINS as f64;
    let edge = |field: &Bricks<f32>| field.transform.voxel_size().element_product();
    let series = fields.iter().map(|(label, field)| {
        let mut counts = [0.0_f64; BINS];
        for v in values(field) {
            counts[(((v - low) / width) as usize).min(BINS - 1)] += edge(field) / edge(volume);
        }
        let level = |count: f64| (1.0 + count).log10();
        let step = |(i, count): (usize, &f64)| {
            let x = low + i as f64 * width;
            [(x, level(*count)), (x + width, level(*count))]
        };
        let points = counts.iter().enumerate().flat_map(step).collect();
        Series { label: (*label).into(), points, dashed: *label == "reference" }
    });
    Some(Plot { x: quantity.into(), y: "log10 of 1 + voxels".into(), series: series.collect() })
}

/// Values of the voxels that are not zero and finite.
fn values(volume: &Bricks<f32>) -> impl Iterator<Item = f64> + '_ {
    let own = (0..CELLS * CELLS * CELLS).map(|i| slot(i / (CELLS * CELLS), i / CELLS % CELLS, i % CELLS));
    let own: Vec<usize> = own.collect();
    volume.values.chunks_exact(BRICK).flat_map(move |brick| {
        let values: Vec<f64> =
            own.iter().map(|i| f64::from(brick[*i])).filter(|v| *v != 0.0 && v.is_finite()).collect();
        values
    })
}
