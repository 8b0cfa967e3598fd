//! Rows of a deep picture in their order, read as they are needed.

use super::DeepLine;
use super::chunk::Packed;
use super::header::{Place, Source, open, too_large};
use crate::error::{Error, Result};
use crate::formats::exr::fault::damaged;
use crate::formats::limits::Limits;
use crate::ordered;
use rayon::prelude::*;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Number of bands per thread that are unpacked at a time.
const BANDS_PER_THREAD: usize = 8;
/// Bytes of bands that are unpacked at a time; a single band may be larger.
const BATCH_BYTES: u64 = 1 << 28;

/// True if all samples of a deep picture can be read.
pub(in crate::formats::exr) fn is_whole(path: &Path) -> bool {
    let limits = Limits::default();
    open(path, limits).and_then(|mut source| source.lines((0, limits), |_, _| Ok(()))).is_ok()
}

impl Source {
    /// Hands the rows of the data window to `take` with their numbers, from top to bottom.
    ///
    /// `held` is the number of bytes that the caller has allocated, or will. Together with the chunks being unpacked
    /// it must stay below `limits`, which is checked first.
    ///
    /// # Errors
    /// If memory does not suffice, or the file is damaged or cannot be read; and errors of `take`.
    pub(super) fn lines(
        &mut self,
        (held, limits): (u64, Limits),
        mut take: impl FnMut(usize, DeepLine) -> Result<()>,
    ) -> Result<()> {
        let places = std::mem::take(&mut self.places);
        // Tiles side by side make up the same rows.
        let bands: Vec<&[Place]> = places.chunk_by(|a, b| a.rows == b.rows).collect();
        let working = |band: &[Place]| band.iter().map(Place::working).sum::<u64>();
        let largest = bands.iter().map(|band| working(band)).max().unwrap_or(0);
        let needed = held.saturating_add(largest);
        if needed > limits.max_memory {
            let what = format!("{} deep samples", places.iter().map(|place| place.samples).sum::<u64>());
            return Err(too_large(&what, needed, limits).at(&self.path));
        }
        let spare = (limits.max_memory - held).min(BATCH_BYTES);
        let most = BANDS_PER_THREAD * rayon::current_num_threads();
        let (mut rest, mut row) = (&bands[..], 0);
        while !rest.is_empty() {
            let mut bytes = 0;
            let within = |band: &&&[Place]| {
                bytes += working(band);
                bytes <= spare
            };
            let count = rest.iter().take(most).take_while(within).count().max(1);
            let (batch, behind) = rest.split_at(count);
            rest = behind;
            let packed: Vec<Vec<Packed>> = batch.iter().map(|band| self.band(band)).collect::<Result<_>>()?;
            let unpacked = ordered::try_map(packed.into_par_iter(), |band| {
                let tiles = band.iter().map(|tile| tile.lines(self.compression, &self.channels));
                Ok(side_by_side(tiles.collect::<Result<_>>()?))
            });
            for line in unpacked.map_err(|e| e.at(&self.path))?.into_iter().flatten() {
                take(row, line)?;
                row += 1;
            }
        }
        Ok(())
    }

    fn band(&mut self, places: &[Place]) -> Result<Vec<Packed>> {
        places.iter().map(|place| self.packed(*place)).collect()
    }

    fn packed(&mut self, place: Place) -> Result<Packed> {
        let mut bytes = vec![0; place.packed_table + place.packed_samples];
        let read = self.file.seek(SeekFrom::Start(place.at)).and_then(|_| self.file.read_exact(&mut bytes));
        match read {
            Ok(()) => Ok(Packed { place, bytes }),
            Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
                Err(damaged("it became shorter while it was read").at(&self.path))
            }
            Err(e) => Err(Error::io(&self.path, e)),
        }
    }
}

/// Joins the rows of tiles that lie side by side.
fn side_by_side(tiles: Vec<Vec<DeepLine>>) -> Vec<DeepLine> {
    let mut tiles = tiles.into_iter();
    let mut lines = tiles.next().unwrap_or_default();
    for tile in tiles {
        for (line, DeepLine { counts, samples }) in lines.iter_mut().zip(tile) {
            line.counts.extend(counts);
            line.samples.extend(samples);
        }
    }
    lines
}
