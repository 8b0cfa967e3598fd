//! A file whole, to be written again with some of its channels changed.

use super::decode::{self, Source};
use super::header::{self, Header, LayerInfo};
use super::picture;
use super::{encode, fault, write};
use crate::error::{Error, Result};
use crate::formats::atomic;
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use exr::block::UncompressedBlock;
use exr::image::write::WritableImage;
use exr::image::{AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Image, Layer};
use exr::meta::attribute::{AttributeValue, Compression, SampleType, Text};
use exr::meta::header::ImageAttributes;
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::SmallVec;
use half::f16;
use std::borrow::Cow;
use std::path::Path;

/// All parts of a file with their channels as they are stored, and their attributes.
#[derive(Debug)]
pub struct Document {
    header: Header,
    image: Image<SmallVec<[Layer<AnyChannels<FlatSamples>>; 2]>>,
}

impl Document {
    /// Reads a file. Its samples, and the chunks being decoded, must fit into `limits`.
    ///
    /// # Errors
    /// The conditions are those of [`read_within`](super::read_within), and attributes that a file may not have.
    pub fn read(path: &Path, limits: Limits) -> Result<Self> {
        let _reading = Reading::begin(path);
        let (reader, header) = header::open(path)?;
        let parts = header.parts.iter().enumerate();
        let sources: Vec<Source> =
            parts.flat_map(|(part, p)| (0..p.channels.len()).map(move |channel| Source { part, channel })).collect();
        let bytes = |h: &exr::meta::header::Header| {
            (h.layer_size.area() as u64).saturating_mul(h.channels.bytes_per_pixel as u64)
        };
        let held = reader.headers().iter().map(bytes).fold(0, u64::saturating_add);
        let metas = reader.headers().to_vec();
        let mut image = None;
        decode::blocks(path, reader, &header, &sources, (held, limits), |block, meta| {
            store(image.get_or_insert_with(|| blank(&metas)), block, meta);
        })?;
        let image = image.unwrap_or_else(|| blank(&metas));
        // What could not be written again is the input's fault, and is said before there is work in it.
        fault::translated(path, || MetaData::validate(&image.write().infer_meta_data(), true))?;
        Ok(Self { header, image })
    }

    /// Returns the header that the file had.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Returns a layer by its name, or the one that is plainly the picture.
    ///
    /// # Errors
    /// If there is none; the error lists the layers.
    pub fn layer(&self, name: Option<&str>) -> Result<LayerInfo> {
        let layers = self.header.layers();
        match name {
            Some(name) => picture::named(&layers, name).cloned(),
            None => picture::default(&self.header, &layers).cloned(),
        }
    }

    /// Returns the numbers of the three channels of a layer's color within its part; `None` if it has fewer.
    pub fn colors(&self, layer: &LayerInfo) -> Option<[usize; 3]> {
        picture::colors(&self.header, layer).and_then(|channels| channels.first_chunk().copied())
    }

    /// Returns the number of a channel of a layer by the name of its component.
    pub fn component(&self, layer: &LayerInfo, name: &str) -> Option<usize> {
        let named = |channel: &&usize| self.header.parts[layer.part].channels[**channel].component == name;
        layer.channels.iter().find(named).copied()
    }

    /// Returns columns and rows of a part.
    pub(crate) fn size(&self, part: usize) -> [usize; 2] {
        self.header.parts[part].data_window.size
    }

    /// Returns the bytes of all samples.
    pub(crate) fn bytes(&self) -> u64 {
        let channels = self.image.layer_data.iter().flat_map(|layer| &layer.channel_data.list);
        let bytes = channels.map(|channel| match &channel.sample_data {
            FlatSamples::F16(samples) => size_of_val(&samples[..]),
            FlatSamples::F32(samples) => size_of_val(&samples[..]),
            FlatSamples::U32(samples) => size_of_val(&samples[..]),
        });
        bytes.sum::<usize>() as u64
    }

    /// Returns the samples of a channel over its part's data window.
    pub fn samples(&self, part: usize, channel: usize) -> Cow<'_, [f32]> {
        match &self.image.layer_data[part].channel_data.list[channel].sample_data {
            FlatSamples::F16(samples) => samples.iter().map(|v| v.to_f32()).collect(),
            FlatSamples::F32(samples) => samples.into(),
            FlatSamples::U32(samples) => samples.iter().map(|v| *v as f32).collect(),
        }
    }

    /// Replaces the samples of a channel, in the type that it has; numbers beyond half floats become the largest.
    pub fn replace(&mut self, part: usize, channel: usize, samples: impl Iterator<Item = f32>) {
        let half = |v: f32| f16::from_f32(v.clamp(-65504.0, 65504.0));
        let data = &mut self.image.layer_data[part].channel_data.list[channel].sample_data;
        *data = match data {
            FlatSamples::F16(_) => FlatSamples::F16(samples.map(half).collect()),
            _ => FlatSamples::F32(samples.collect()),
        };
    }

    /// Adds a channel of 32-bit floats to a part; one of that name is replaced.
    pub(crate) fn add(&mut self, part: usize, name: &str, samples: Vec<f32>) {
        let channels = &mut self.image.layer_data[part].channel_data;
        let others = channels.list.drain(..).filter(|channel| !channel.name.eq(name));
        let mut list: SmallVec<[AnyChannel<FlatSamples>; 4]> = others.collect();
        list.push(AnyChannel::new(name, FlatSamples::F32(samples)));
        *channels = AnyChannels::sort(list);
    }

    /// Sets a text attribute of the first part.
    pub(crate) fn set_attribute(&mut self, name: &str, value: &str) {
        if let Some(layer) = self.image.layer_data.first_mut() {
            let text = Text::from_slice_unchecked(value.as_bytes());
            layer.attributes.other.insert(Text::from_slice_unchecked(name.as_bytes()), AttributeValue::Text(text));
        }
    }

    /// Writes the file. Parts keep their compression where it is lossless, and else get ZIP: what passes through is as
    /// it was. The file appears whole or not at all.
    ///
    /// # Errors
    /// If the operating system reports one.
    pub fn write(&self, path: &Path) -> Result<()> {
        let mut bytes = fault::translated(path, || encode::file(&self.image)).map_err(|e: Error| e.at(path))?;
        write::sort_attributes(&mut bytes);
        atomic::write_bytes(path, &bytes)
    }
}

/// Returns the parts of a file with all samples 0.
fn blank(headers: &[exr::meta::header::Header]) -> Image<SmallVec<[Layer<AnyChannels<FlatSamples>>; 2]>> {
    let layer = |header: &exr::meta::header::Header| {
        let compression = match header.compression {
            kept @ (Compression::Uncompressed | Compression::RLE | Compression::ZIP1 | Compression::PIZ) => kept,
            _ => Compression::ZIP16,
        };
        let blocks = match header.blocks {
            BlockDescription::ScanLines => Blocks::ScanLines,
            BlockDescription::Tiles(tiles) => Blocks::Tiles(tiles.tile_size),
        };
        let count = header.layer_size.area();
        let channels = header.channels.list.iter().map(|channel| AnyChannel {
            name: channel.name.clone(),
            sample_data: match channel.sample_type {
                SampleType::F16 => FlatSamples::F16(vec![f16::ZERO; count]),
                SampleType::F32 => FlatSamples::F32(vec![0.0; count]),
                SampleType::U32 => FlatSamples::U32(vec![0; count]),
            },
            quantize_linearly: channel.quantize_linearly,
            sampling: channel.sampling,
        });
        Layer {
            channel_data: AnyChannels { list: channels.collect() },
            attributes: header.own_attributes.clone(),
            size: header.layer_size,
            encoding: Encoding { compression, blocks, line_order: header.line_order },
        }
    };
    let attributes = match headers.first() {
        Some(header) => header.shared_attributes.clone(),
        None => ImageAttributes::with_size((0, 0)),
    };
    Image { attributes, layer_data: headers.iter().map(layer).collect() }
}

/// Takes the samples of a block.
fn store(
    image: &mut Image<SmallVec<[Layer<AnyChannels<FlatSamples>>; 2]>>,
    block: &UncompressedBlock,
    meta: &MetaData,
) {
    let part = block.index.layer;
    let layer = &mut image.layer_data[part];
    for line in block.lines(&meta.headers[part].channels) {
        let at = line.location;
        let start = at.position.1 * layer.size.0 + at.position.0;
        let bytes = line.value;
        match &mut layer.channel_data.list[at.channel].sample_data {
            FlatSamples::F16(samples) => {
                for (to, from) in samples[start..start + at.sample_count].iter_mut().zip(bytes.as_chunks().0) {
                    *to = f16::from_ne_bytes(*from);
                }
            }
            FlatSamples::F32(samples) => {
                for (to, from) in samples[start..start + at.sample_count].iter_mut().zip(bytes.as_chunks().0) {
                    *to = f32::from_ne_bytes(*from);
                }
            }
            FlatSamples::U32(samples) => {
                for (to, from) in samples[start..start + at.sample_count].iter_mut().zip(bytes.as_chunks().0) {
                    *to = u32::from_ne_bytes(*from);
                }
            }
        }
    }
}
