//! Writing of deep pictures: one part of scan lines.

use super::{DeepLine, DeepSample};
use crate::error::{Error, Result};
use crate::formats::atomic::{self, Draft};
use crate::formats::exr::encode::Packer;
use crate::formats::exr::write::{entry_length, layer_attributes};
use crate::formats::exr::{Attributes, Window, fault};
use crate::ordered;
use exr::meta::attribute::{
    ChannelDescription, ChannelList, Compression as ExrCompression, IntegerBounds, LineOrder, SampleType, Text,
};
use exr::meta::header::{Header, ImageAttributes};
use exr::meta::{BlockDescription, Requirements, magic_number};
use half::f16;
use rayon::prelude::*;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

/// Number of rows that are packed side by side before they are written.
const BATCH_ROWS: usize = 64;
/// Number of samples of rows that are held before they are written; a single row may have more.
const BATCH_SAMPLES: usize = 1 << 21;

/// Size and place of a deep picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    /// Window that the picture is meant to cover.
    pub display_window: Window,
    /// Window of the pixels that are stored.
    pub data_window: Window,
    /// Width over height of a pixel.
    pub pixel_aspect: f32,
}

impl Layout {
    /// A picture of square pixels, all of which are stored.
    pub fn whole(width: usize, height: usize) -> Self {
        let window = Window { min: [0, 0], size: [width, height] };
        Self { display_window: window, data_window: window, pixel_aspect: 1.0 }
    }
}

/// Compression of deep pictures.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Compression {
    /// None.
    None,
    /// Deflate, row by row.
    #[default]
    Zips,
}

/// How samples become numbers of a file. Depths are always 32-bit floats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Encoding {
    /// Compression of counts and samples.
    pub compression: Compression,
    /// True for colors and opacities as 16-bit floats, false for 32-bit floats.
    pub half: bool,
    /// True to write ZBack; false if all samples are points.
    pub volumes: bool,
    /// True to write R, G and B; false for opacity alone.
    pub colors: bool,
}

impl Default for Encoding {
    fn default() -> Self {
        Self { compression: Compression::Zips, half: false, volumes: true, colors: true }
    }
}

/// Name and type of a channel, and the number of a sample that it holds.
type Channel = (&'static str, SampleType, fn(&DeepSample) -> f32);

impl Encoding {
    /// Channels in the order of the file.
    fn channels(self) -> Vec<Channel> {
        let kind = if self.half { SampleType::F16 } else { SampleType::F32 };
        let mut channels: Vec<Channel> = vec![("A", kind, |s| s.rgba[3])];
        if self.colors {
            channels.push(("B", kind, |s| s.rgba[2]));
            channels.push(("G", kind, |s| s.rgba[1]));
            channels.push(("R", kind, |s| s.rgba[0]));
        }
        channels.push(("Z", SampleType::F32, |s| s.z));
        if self.volumes {
            channels.push(("ZBack", SampleType::F32, |s| s.z_back));
        }
        channels
    }
}

/// Writes a deep picture, row by row as `lines` hands them to the writer, from top to bottom. The file appears whole or
/// not at all, and equal input gives equal bytes. About 64 rows are held at a time.
///
/// `attributes` become attributes of the header as those of [`write_picture`](crate::formats::exr::write_picture) do.
/// The attribute `deepImageState` is left out, which OpenEXR's Python package 3.5 refuses to read.
///
/// # Errors
/// If a window is empty or reaches out of 32-bit coordinates, an attribute cannot be written, rows are too few, too
/// many or of another width, a depth is NaN, or a finite color does not fit into half floats; errors of `lines`; and if
/// the operating system reports an error.
pub fn write(
    path: &Path,
    layout: &Layout,
    attributes: &Attributes,
    encoding: Encoding,
    lines: impl FnOnce(&mut LineWriter<'_>) -> Result<()>,
) -> Result<()> {
    let header = fault::translated(path, || Ok(header(layout, attributes, encoding)))??;
    let bytes = fault::translated(path, || header_bytes(&header))?;
    atomic::write(path, |draft| {
        let [width, rows] = layout.data_window.size;
        draft.write(&bytes)?;
        draft.write(&vec![0; 8 * rows])?;
        let place = bytes.len() as u64 + 8 * rows as u64;
        let first_row = layout.data_window.min[1];
        let (batch, table) = (Vec::new(), Vec::with_capacity(rows));
        let mut writer = LineWriter { draft, encoding, width, rows, first_row, batch, table, place, most_samples: 0 };
        lines(&mut writer)?;
        writer.finish(&bytes)
    })
}

fn header(layout: &Layout, attributes: &Attributes, encoding: Encoding) -> Result<Header> {
    let Layout { display_window, data_window, pixel_aspect } = *layout;
    let far = |w: &Window| (0..2).any(|axis| w.end(axis) > i64::from(i32::MAX));
    if [display_window, data_window].iter().any(|w| w.pixels() == 0 || far(w)) {
        return Err(Error::invalid(format!(
            "a deep picture with display window {display_window} and data window {data_window} cannot be written"
        ))
        .hint("give windows of at least one pixel, within 32-bit coordinates"));
    }
    let bounds = |w: Window| IntegerBounds::new((w.min[0], w.min[1]), (w.size[0], w.size[1]));
    let mut own = layer_attributes(attributes)?;
    own.layer_position = exr::math::Vec2(data_window.min[0], data_window.min[1]);
    let mut shared = ImageAttributes::new(bounds(display_window));
    shared.pixel_aspect = pixel_aspect;
    let channels = encoding.channels().into_iter().map(|(name, kind, _)| ChannelDescription {
        name: Text::from(name),
        sample_type: kind,
        quantize_linearly: false,
        sampling: exr::math::Vec2(1, 1),
    });
    Ok(Header {
        channels: ChannelList::new(channels.collect()),
        compression: match encoding.compression {
            Compression::None => ExrCompression::Uncompressed,
            Compression::Zips => ExrCompression::ZIP1,
        },
        blocks: BlockDescription::ScanLines,
        line_order: LineOrder::Increasing,
        layer_size: exr::math::Vec2(data_window.size[0], data_window.size[1]),
        deep: true,
        deep_data_version: Some(1),
        chunk_count: data_window.size[1],
        max_samples_per_pixel: Some(0),
        shared_attributes: shared,
        own_attributes: own,
    })
}

/// Bytes from the magic number to the end of the header, with the attributes sorted: the `exr` crate writes them in a
/// random order, and gives flat parts' types alone.
fn header_bytes(header: &Header) -> exr::error::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    magic_number::write(&mut bytes)?;
    let name_length = |(name, _): &(&Text, _)| name.as_slice().len();
    let requirements = Requirements {
        file_format_version: 2,
        is_single_layer_and_tiled: false,
        has_long_names: header.own_attributes.other.iter().map(|entry| name_length(&entry)).any(|length| length > 31),
        has_deep_data: true,
        has_multiple_layers: false,
    };
    requirements.write(&mut bytes)?;
    let mut list = Vec::new();
    header.write(&mut list)?;
    let mut entries = Vec::new();
    let mut rest = &list[..];
    while let Some(length) = entry_length(rest) {
        let (entry, behind) = rest.split_at(length);
        rest = behind;
        entries.push(match entry.starts_with(b"type\0") {
            true => b"type\0string\0\x0c\0\0\0deepscanline".to_vec(),
            false => entry.to_vec(),
        });
    }
    entries.sort();
    bytes.extend(entries.concat());
    bytes.push(0);
    Ok(bytes)
}

/// Takes the rows of a deep picture that is being written.
#[derive(Debug)]
pub struct LineWriter<'a> {
    draft: &'a mut Draft,
    encoding: Encoding,
    width: usize,
    rows: usize,
    first_row: i32,
    batch: Vec<DeepLine>,
    /// Places of the chunks that were written.
    table: Vec<u64>,
    /// Place of the next chunk.
    place: u64,
    most_samples: u32,
}

impl LineWriter<'_> {
    /// Appends the next row.
    ///
    /// # Errors
    /// If the picture is complete, the row has not one count for each pixel and as many samples as these say, a depth
    /// is NaN, or a finite color does not fit into half floats; and if the operating system reports an error.
    pub fn push(&mut self, line: DeepLine) -> Result<()> {
        let row = self.table.len() + self.batch.len();
        let counted: u64 = line.counts.iter().map(|&n| u64::from(n)).sum();
        let sound = line.counts.len() == self.width && counted == line.samples.len() as u64;
        if row >= self.rows || !sound || counted > i32::MAX as u64 {
            return Err(Error::invalid(format!(
                "row {row} with {} counts and {} samples cannot be written to a deep picture of {}x{} pixels",
                line.counts.len(),
                line.samples.len(),
                self.width,
                self.rows
            ))
            .hint("give each row one count for each pixel, and as many samples, at most 2³¹, as these say"));
        }
        if line.samples.iter().any(|s| s.z.is_nan() || s.z_back.is_nan()) {
            return Err(Error::invalid(format!("a depth in row {row} is NaN")).hint("give all samples a depth"));
        }
        let lost = |v: &f32| v.is_finite() && !f16::from_f32(*v).is_finite();
        if self.encoding.half && line.samples.iter().any(|s| s.rgba.iter().any(lost)) {
            return Err(Error::invalid(format!("a color in row {row} is beyond 65504, the largest half float"))
                .hint("write 32-bit floats"));
        }
        self.most_samples = line.counts.iter().copied().fold(self.most_samples, u32::max);
        self.batch.push(line);
        let held: usize = self.batch.iter().map(|line| line.samples.len()).sum();
        if self.batch.len() < BATCH_ROWS && held < BATCH_SAMPLES {
            return Ok(());
        }
        self.flush()
    }

    fn flush(&mut self) -> Result<()> {
        let encoding = self.encoding;
        let first = i64::from(self.first_row) + self.table.len() as i64;
        let lines = std::mem::take(&mut self.batch);
        let chunks = ordered::try_map(lines.into_par_iter().enumerate(), |(number, line)| {
            // Windows were checked to be within 32-bit coordinates.
            chunk(&line, (first + number as i64) as i32, encoding)
        })?;
        for chunk in &chunks {
            self.table.push(self.place);
            self.place += chunk.len() as u64;
        }
        self.draft.write(&chunks.concat())
    }

    /// Completes the file behind a header of the given `bytes`.
    fn finish(mut self, bytes: &[u8]) -> Result<()> {
        self.flush()?;
        if self.table.len() != self.rows {
            return Err(Error::invalid(format!("{} of {} rows were written", self.table.len(), self.rows))
                .hint("give all rows of the data window"));
        }
        let table: Vec<u8> = self.table.iter().flat_map(|place| place.to_le_bytes()).collect();
        let name = b"maxSamplesPerPixel\0int\0\x04\0\0\0";
        let most = bytes.windows(name.len()).position(|window| window == name).map(|at| at + name.len());
        let most_samples = self.most_samples.to_le_bytes();
        let patches = [(bytes.len(), &table[..])].into_iter().chain(most.map(|at| (at, &most_samples[..])));
        for (at, value) in patches {
            let file = self.draft.file();
            let written = file.seek(SeekFrom::Start(at as u64)).and_then(|_| file.write_all(value));
            written.map_err(|e| self.draft.unwritten(e, self.place))?;
        }
        Ok(())
    }
}

/// Chunk of a row: its number, three sizes, the table of counts and the samples, channel by channel.
fn chunk(line: &DeepLine, row: i32, encoding: Encoding) -> Result<Vec<u8>> {
    let totals = line.counts.iter().scan(0_u32, |total, count| {
        *total += count;
        Some(*total)
    });
    let table: Vec<u8> = totals.flat_map(u32::to_le_bytes).collect();
    let mut samples = Vec::new();
    for (_, kind, value) in encoding.channels() {
        let values = line.samples.iter().map(value);
        match kind {
            SampleType::F16 => samples.extend(values.flat_map(|v| f16::from_f32(v).to_le_bytes())),
            _ => samples.extend(values.flat_map(f32::to_le_bytes)),
        }
    }
    let unpacked = samples.len() as u64;
    let (table, samples) = match encoding.compression {
        Compression::None => (table, samples),
        Compression::Zips => {
            let mut packer = Packer::default();
            let mut packed = |data| packer.packed(data).map_err(|e| Error::invalid(e.to_string()));
            (packed(table)?, packed(samples)?)
        }
    };
    let mut bytes = Vec::with_capacity(28 + table.len() + samples.len());
    bytes.extend(row.to_le_bytes());
    [table.len() as u64, samples.len() as u64, unpacked].iter().for_each(|size| bytes.extend(size.to_le_bytes()));
    bytes.extend(table);
    bytes.extend(samples);
    Ok(bytes)
}
