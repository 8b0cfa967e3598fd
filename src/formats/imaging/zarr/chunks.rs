//! Slices of an array, from the chunks of one layer at a time.

use super::array::{Array, Shards};
use super::axes::Axes;
use super::codec;
use super::document::wrong;
use crate::error::{Code, Error, Result};
use crate::formats::imaging::image::Slices;
use crate::formats::input;
use crate::formats::limits::Limits;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Reads chunks, layer by layer of the third index.
pub(crate) struct Chunks {
    folder: PathBuf,
    array: Array,
    axes: Axes,
    /// Indices along the axes that are no space.
    point: Vec<u64>,
    size: [usize; 3],
    /// Bytes of the values of a layer: `layer[(z * size[1] + y) * size[0] + x]`, z from the layer's first slice on.
    layer: Vec<u8>,
    /// Slices of the layer.
    depth: usize,
    next: usize,
    chunk_bytes: usize,
    /// Bytes of a layer of chunks, and of one chunk beside it, packed and unpacked.
    held: u64,
}

impl Chunks {
    /// Prepares to read the array.
    ///
    /// # Errors
    /// If a layer of chunks, and one chunk beside it, packed and unpacked, would not fit into the limits.
    pub(crate) fn new(folder: &Path, array: Array, axes: Axes, point: Vec<u64>, limits: Limits) -> Result<Self> {
        let size = axes.size(&array)?;
        let deep = axes.space[2].map_or(1, |axis| array.chunk[axis]);
        let depth = usize::try_from(deep).unwrap_or(usize::MAX).min(size[2]);
        let layer =
            [size[0], size[1], depth].iter().try_fold(array.sample.bytes() as u64, |p, n| p.checked_mul(*n as u64));
        let chunk = array.chunk_bytes();
        let needed = layer.zip(chunk).and_then(|(layer, chunk)| layer.checked_add(chunk.checked_mul(3)?));
        let held = needed.filter(|needed| *needed <= limits.max_memory);
        let held = held.ok_or_else(|| {
            let what = format!(
                "a layer of chunks of {:?} in {} x {} x {} voxels needs {} bytes, {} are allowed",
                array.chunk,
                size[0],
                size[1],
                size[2],
                needed.map_or_else(|| "more than 2⁶⁴".to_owned(), |n| n.to_string()),
                limits.max_memory
            );
            Error::unsupported(what).coded(Code::MemoryLimit).hint("raise ⟨max_memory⟩, or choose a coarser ⟨level⟩")
        })?;
        let chunk_bytes =
            chunk.and_then(|n| usize::try_from(n).ok()).ok_or_else(|| wrong("chunks too large to count"))?;
        let layer = Vec::new();
        Ok(Self { folder: folder.to_path_buf(), array, axes, point, size, layer, depth, next: 0, chunk_bytes, held })
    }

    /// Length of the chunks along x, y or z.
    fn chunk(&self, axis: usize) -> usize {
        self.axes.space[axis].map_or(1, |axis| usize::try_from(self.array.chunk[axis]).unwrap_or(usize::MAX))
    }

    /// Reads the layer that begins with slice `first`.
    fn read_layer(&mut self, first: usize) -> Result<()> {
        let bytes = self.array.sample.bytes();
        let slices = self.depth.min(self.size[2] - first);
        self.layer.clear();
        self.layer.resize(slices * self.size[0] * self.size[1] * bytes, 0);
        let [nx, ny] = [0, 1].map(|axis| self.chunk(axis));
        for y in (0..self.size[1]).step_by(ny) {
            for x in (0..self.size[0]).step_by(nx) {
                self.place([x, y, first], slices)?;
            }
        }
        Ok(())
    }

    /// Copies the chunk at index `at` into the layer.
    fn place(&mut self, at: [usize; 3], slices: usize) -> Result<()> {
        let mut number: Vec<u64> = self.point.iter().zip(&self.array.chunk).map(|(i, n)| i / n).collect();
        for (axis, start) in self.axes.space.iter().zip(at) {
            if let Some(axis) = *axis {
                number[axis] = start as u64 / self.array.chunk[axis];
            }
        }
        let values = self.read(&number)?;
        // Step in the chunk along each axis, in values.
        let mut steps = vec![0; self.array.chunk.len()];
        let mut step = 1;
        for axis in self.array.order.iter().rev() {
            steps[*axis] = step;
            step *= self.array.chunk[*axis] as usize;
        }
        let bytes = self.array.sample.bytes();
        let within = self.point.iter().zip(&self.array.chunk).map(|(i, n)| (i % n) as usize);
        let start: usize = within.zip(&steps).map(|(i, step)| i * step).sum();
        let [sx, sy, sz] = self.axes.space.map(|axis| axis.map_or(0, |axis| steps[axis]));
        let [wide, high] = [0, 1].map(|axis| self.chunk(axis).min(self.size[axis] - at[axis]));
        for z in 0..slices {
            for y in 0..high {
                let mut to = ((z * self.size[1] + at[1] + y) * self.size[0] + at[0]) * bytes;
                let row = start + z * sz + y * sy;
                for x in 0..wide {
                    let from = (row + x * sx) * bytes;
                    self.layer[to..to + bytes].copy_from_slice(&values[from..from + bytes]);
                    to += bytes;
                }
            }
        }
        Ok(())
    }

    /// Unpacked bytes of a chunk; its fill value where its file is missing.
    fn read(&self, number: &[u64]) -> Result<Vec<u8>> {
        let path = self.folder.join(self.array.file(number));
        let packed = match &self.array.shards {
            None => input_of(&path, self.largest_chunk())?,
            Some(shards) => self.part_of_shard(&path, shards, number).map_err(|e| e.at(&path))?,
        };
        let Some(packed) = packed else {
            let mut fill = Vec::new();
            self.array.sample.encode(&[self.array.fill], &mut fill);
            if self.array.endian == crate::formats::sample::Endian::Big {
                fill.reverse();
            }
            return Ok(fill.repeat(self.chunk_bytes / fill.len().max(1)));
        };
        codec::decode(&self.array.codecs, packed, self.chunk_bytes).map_err(|e| e.at(&path))
    }

    /// Largest number of packed bytes of a chunk: what does not become smaller may become a little larger.
    fn largest_chunk(&self) -> u64 {
        (self.chunk_bytes as u64).saturating_add(self.chunk_bytes as u64 / 4).saturating_add(1 << 16)
    }

    /// Packed bytes of a chunk that lies in a shard; none if it is missing.
    fn part_of_shard(&self, path: &Path, shards: &Shards, number: &[u64]) -> Result<Option<Vec<u8>>> {
        if !path.is_file() {
            return Ok(None);
        }
        let mut file = input::open(path)?;
        let length = file.metadata().map_err(Error::system)?.len();
        let per: Vec<u64> = shards.shape.iter().zip(&self.array.chunk).map(|(shard, chunk)| shard / chunk).collect();
        let count = per.iter().try_fold(1_u64, |product, n| product.checked_mul(*n));
        let index = count.and_then(|n| n.checked_mul(16)?.checked_add(if shards.checksum { 4 } else { 0 }));
        let short = || wrong(format!("a shard of {length} bytes is shorter than its index"));
        let index = index.filter(|n| *n <= length && *n <= self.largest_chunk().max(1 << 24)).ok_or_else(short)?;
        let start = if shards.at_end { length - index } else { 0 };
        file.seek(SeekFrom::Start(start)).map_err(Error::system)?;
        let mut bytes = vec![0; usize::try_from(index).map_err(|_| short())?];
        file.read_exact(&mut bytes).map_err(Error::system)?;
        let entries = if shards.checksum { codec::checked(&bytes)? } else { &bytes[..] };
        let at = number.iter().zip(&per).fold(0, |at, (n, per)| at * per + n % per) as usize * 16;
        let word = |at: usize| {
            let mut word = [0; 8];
            word.copy_from_slice(&entries[at..at + 8]);
            u64::from_le_bytes(word)
        };
        let (from, count) = (word(at), word(at + 8));
        if from == u64::MAX && count == u64::MAX {
            return Ok(None);
        }
        let inside = from.checked_add(count).is_some_and(|end| end <= length) && count <= self.largest_chunk();
        let (true, Ok(count)) = (inside, usize::try_from(count)) else {
            return Err(wrong(format!(
                "a chunk of {count} bytes at byte {from} lies outside its shard of {length} bytes"
            )));
        };
        file.seek(SeekFrom::Start(from)).map_err(Error::system)?;
        let mut packed = vec![0; count];
        file.read_exact(&mut packed).map_err(Error::system)?;
        Ok(Some(packed))
    }
}

/// Content of a chunk's file; none if it is missing.
fn input_of(path: &Path, most: u64) -> Result<Option<Vec<u8>>> {
    match input::bytes(path, most, "a chunk of this array") {
        Err(e) if e.io_kind() == Some(std::io::ErrorKind::NotFound) => Ok(None),
        found => found.map(Some),
    }
}

impl Slices for Chunks {
    fn next_slice(&mut self, values: &mut [f64]) -> Result<()> {
        let within = self.next % self.depth;
        if within == 0 {
            if self.next >= self.size[2] {
                return Err(wrong(format!("slice {} of {} is asked for", self.next, self.size[2])));
            }
            self.read_layer(self.next)?;
        }
        let bytes = self.size[0] * self.size[1] * self.array.sample.bytes();
        let slice = self.layer.get(within * bytes..(within + 1) * bytes);
        let slice = slice.ok_or_else(|| wrong(format!("slice {} of {} is asked for", self.next, self.size[2])))?;
        let mut decoded = Vec::with_capacity(values.len());
        self.array.sample.decode(self.array.endian, slice, &mut decoded);
        values.copy_from_slice(&decoded);
        self.next += 1;
        Ok(())
    }

    fn working_bytes(&self) -> u64 {
        self.held
    }
}
