//! Samples of one chunk.

use super::header::{Channel, Component, Place};
use super::unpack::{unpacked, unpacked_table};
use super::{DeepLine, DeepSample};
use crate::error::Result;
use crate::formats::exr::fault::damaged;
use exr::meta::attribute::{Compression, SampleType};

/// Bytes of a chunk as they stand in the file: the packed table, then the packed samples.
#[derive(Debug)]
pub(super) struct Packed {
    pub place: Place,
    pub bytes: Vec<u8>,
}

impl Packed {
    /// Returns the chunk's rows, from top to bottom.
    ///
    /// # Errors
    /// If the bytes cannot be unpacked, or the counts are not those of the samples.
    pub(super) fn lines(&self, compression: Compression, channels: &[Channel]) -> Result<Vec<DeepLine>> {
        let (table, samples) = self.bytes.split_at(self.place.packed_table);
        let table = unpacked_table(compression, table, (4 * self.place.pixels(), self.place.whole_table))?;
        let width = self.place.columns[1] - self.place.columns[0];
        let mut lines: Vec<DeepLine> = table.chunks_exact(4 * width).map(counted).collect::<Result<_>>()?;
        // A table may state more samples than memory holds, so that they are counted before they are made.
        let counts = lines.iter().map(|line| line.counts.iter().map(|&n| u64::from(n)).sum::<u64>());
        if counts.sum::<u64>() != self.place.samples {
            return Err(damaged("the counts of a deep chunk are not those of its samples"));
        }
        let bytes = unpacked(compression, samples, self.place.unpacked_samples)?;
        let mut rest = &bytes[..];
        for line in &mut lines {
            let count = line.counts.iter().map(|&n| n as usize).sum();
            line.samples = vec![DeepSample::default(); count];
            for (component, kind) in channels {
                let (values, behind) = rest.split_at(count * kind.bytes_per_sample());
                fill(&mut line.samples, *component, *kind, values);
                rest = behind;
            }
            if !channels.iter().any(|channel| channel.0 == Component::ZBack) {
                line.samples.iter_mut().for_each(|sample| sample.z_back = sample.z);
            }
        }
        Ok(lines)
    }
}

/// Returns a row without samples from its part of the table, which holds for each pixel the number of samples up to
/// and with its own.
fn counted(table: &[u8]) -> Result<DeepLine> {
    let mut before = 0;
    let count = |total: u32| {
        let count = total.checked_sub(before);
        before = total;
        count.ok_or_else(|| damaged("the counts of a deep chunk do not grow from pixel to pixel"))
    };
    let totals = table.as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes));
    Ok(DeepLine { counts: totals.map(count).collect::<Result<_>>()?, samples: Vec::new() })
}

/// Converts the values of a channel.
fn fill(samples: &mut [DeepSample], component: Component, kind: SampleType, bytes: &[u8]) {
    let place = |sample: &mut DeepSample, value: f32| match component {
        Component::Z => sample.z = value,
        Component::ZBack => sample.z_back = value,
        Component::Rgba(number) => sample.rgba[number] = value,
        Component::Other => {}
    };
    match kind {
        SampleType::F16 => {
            let values = bytes.as_chunks::<2>().0.iter().map(|b| half::f16::from_le_bytes(*b).to_f32());
            samples.iter_mut().zip(values).for_each(|(sample, value)| place(sample, value));
        }
        SampleType::F32 => {
            let values = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b));
            samples.iter_mut().zip(values).for_each(|(sample, value)| place(sample, value));
        }
        SampleType::U32 => {
            let values = bytes.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b) as f32);
            samples.iter_mut().zip(values).for_each(|(sample, value)| place(sample, value));
        }
    }
}
