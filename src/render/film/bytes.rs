//! Memory of the planes of a picture.

use super::aov::Aov;
use super::halves::VARIANCE_BYTES;
use super::stored::PLANES as STORED;

/// Returns the bytes of memory per pixel that planes take: as they are rendered, as they are kept, and as they are
/// written.
pub fn bytes_per_pixel(aovs: &[Aov]) -> u64 {
    let of = |aov: &Aov| match aov {
        Aov::Variance => VARIANCE_BYTES + 2 * 4 * 4,
        Aov::Replicates => 2 * 4 * STORED,
        _ => 3 * 4 * aov.layers().iter().map(|layer| layer.channels.len() as u64).sum::<u64>(),
    };
    aovs.iter().map(of).sum()
}
