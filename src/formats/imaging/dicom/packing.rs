//! Packed pixels: fragments of a file, and their decoding.

use super::element::damaged;
use super::file::{File, Pixels};
use super::jpeg2000;
use super::syntax::Packing;
use crate::error::{Error, Result};
use std::io::Read;

/// Most fragments of a file.
const MOST_FRAGMENTS: usize = 1 << 20;

/// A packed part of the pixels.
#[derive(Debug, Clone, Copy)]
struct Fragment {
    /// Position of its bytes in the data set.
    at: u64,
    length: u32,
}

/// Packed frames of a file.
#[derive(Debug, Clone)]
pub(crate) struct Frames {
    /// For each frame, its fragments.
    frames: Vec<Vec<Fragment>>,
}

impl Frames {
    /// Finds the frames of a file.
    ///
    /// # Errors
    /// If the fragments are damaged, or cannot be told apart into frames.
    pub(crate) fn find(file: &File) -> Result<Self> {
        let mut source = file.source()?;
        source.skip(file.pixel_data.0).map_err(Error::system)?;
        let mut at = file.pixel_data.0;
        let (mut offsets, mut fragments) = (Vec::new(), Vec::new());
        let mut first = None;
        loop {
            let mut head = [0; 8];
            source.read_exact(&mut head).map_err(|e| damaged(format!("the packed pixels end early ({e})")))?;
            let length = u32::from_le_bytes([head[4], head[5], head[6], head[7]]);
            match head[..4] {
                [0xfe, 0xff, 0xdd, 0xe0] => break,
                [0xfe, 0xff, 0x00, 0xe0] if length != u32::MAX => {}
                _ => return Err(damaged("a part of the packed pixels is no item")),
            }
            if let Some(first) = first {
                fragments.push((at - first, Fragment { at: at + 8, length }));
                source.skip(length.into()).map_err(Error::system)?;
            } else {
                // The first item lists where frames begin, or is empty.
                if length as usize / 4 > MOST_FRAGMENTS {
                    return Err(damaged(format!("a list of {} frames", length / 4)));
                }
                let mut table = vec![0; length as usize];
                source.read_exact(&mut table).map_err(|e| damaged(format!("the packed pixels end early ({e})")))?;
                offsets = table.as_chunks::<4>().0.iter().map(|b| u64::from(u32::from_le_bytes(*b))).collect();
                first = Some(at + 8 + u64::from(length));
            }
            at += 8 + u64::from(length);
            if fragments.len() > MOST_FRAGMENTS {
                return Err(damaged("more than a million parts of packed pixels"));
            }
        }
        Self::split(file.frames, &offsets, &fragments)
    }

    fn split(count: usize, offsets: &[u64], fragments: &[(u64, Fragment)]) -> Result<Self> {
        let all = |parts: &[(u64, Fragment)]| parts.iter().map(|(_, fragment)| *fragment).collect::<Vec<_>>();
        let frames = if count == 1 {
            vec![all(fragments)]
        } else if fragments.len() == count {
            fragments.iter().map(|(_, fragment)| vec![*fragment]).collect()
        } else if offsets.len() == count && offsets.is_sorted() {
            let end = |i: usize| offsets.get(i + 1).copied().unwrap_or(u64::MAX);
            // Fragments are in ascending order of position.
            let from = |offset: u64| fragments.partition_point(|(at, _)| *at < offset);
            (0..count).map(|i| all(&fragments[from(offsets[i])..from(end(i))])).collect()
        } else {
            return Err(damaged(format!("{} parts of packed pixels for {count} frames", fragments.len())));
        };
        Ok(Self { frames })
    }

    /// Unpacks a frame to the bytes of its pixels, least significant first.
    ///
    /// # Errors
    /// If the frame is damaged or has another size than the file says.
    pub(crate) fn unpack(&self, file: &File, frame: usize) -> Result<Vec<u8>> {
        let parts = self.frames.get(frame).map_or(&[][..], |parts| parts);
        let length = parts.iter().map(|part| u64::from(part.length)).sum::<u64>();
        // What does not become smaller by packing becomes larger by a little.
        let most = 2 * file.frame_bytes() as u64 + (1 << 16);
        if length > most {
            return Err(damaged(format!("{length} packed bytes for a frame of {}", file.frame_bytes())));
        }
        let mut packed = Vec::with_capacity(length as usize);
        for part in parts {
            let mut source = file.source()?;
            source.skip(part.at).map_err(Error::system)?;
            source.take(part.length.into()).read_to_end(&mut packed).map_err(Error::system)?;
        }
        if packed.len() as u64 != length {
            return Err(damaged("the packed pixels end early"));
        }
        match file.syntax.packing {
            Packing::Rle => rle(&packed, file),
            Packing::Jpeg2000 => jpeg2000::unpack(&packed, file),
            _ => jpeg(&packed, file),
        }
    }
}

/// Unpacks runs: a stream of all first bytes of the pixels, the most significant, then of all second ones, and so on.
fn rle(packed: &[u8], file: &File) -> Result<Vec<u8>> {
    let word =
        |at: usize| packed.get(4 * at..4 * at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let bytes = file.pixels.bytes();
    if word(0) != Some(bytes) {
        return Err(damaged(format!("{:?} streams of runs for pixels of {bytes} bytes", word(0))));
    }
    let count = file.rows * file.columns;
    let mut out = vec![0; count * bytes];
    for stream in 0..bytes {
        let end = if stream + 1 < bytes { word(stream + 2) } else { Some(packed.len()) };
        let range = word(stream + 1).zip(end).and_then(|(start, end)| packed.get(start..end));
        let mut runs = range.ok_or_else(|| damaged("a stream of runs lies outside its frame"))?;
        let place = bytes - 1 - stream;
        let mut done = 0;
        let mut put = |values: &mut dyn Iterator<Item = u8>| {
            for value in values {
                if let Some(to) = out.get_mut(done * bytes + place).filter(|_| done < count) {
                    *to = value;
                }
                done += 1;
            }
            done < count
        };
        let mut open = true;
        while open {
            let Some((control, rest)) = runs.split_first() else { break };
            runs = rest;
            match control.cast_signed() {
                -128 => {}
                n @ 0.. => {
                    let literal = runs.split_at_checked(n as usize + 1);
                    let (literal, rest) = literal.ok_or_else(|| damaged("a run is longer than its stream"))?;
                    open = put(&mut literal.iter().copied());
                    runs = rest;
                }
                n => {
                    let (value, rest) = runs.split_first().ok_or_else(|| damaged("a run without a value"))?;
                    open = put(&mut std::iter::repeat_n(*value, 1 + usize::from(n.unsigned_abs())));
                    runs = rest;
                }
            }
        }
        if open {
            return Err(damaged(format!("{done} of {count} pixels are packed")));
        }
    }
    Ok(out)
}

/// Unpacks JPEG.
fn jpeg(packed: &[u8], file: &File) -> Result<Vec<u8>> {
    let failed = |e: jpeg_decoder::Error| damaged(format!("the JPEG of a frame cannot be read: {e}"));
    let mut decoder = jpeg_decoder::Decoder::new(packed);
    decoder.read_info().map_err(failed)?;
    let info = decoder.info().ok_or_else(|| damaged("the JPEG of a frame does not say how large it is"))?;
    if (usize::from(info.width), usize::from(info.height)) != (file.columns, file.rows) {
        let what =
            format!("a JPEG of {} x {} pixels in a file of {} x {}", info.width, info.height, file.columns, file.rows);
        return Err(damaged(what));
    }
    let bytes = info.pixel_format.pixel_bytes();
    let grey = matches!(info.pixel_format, jpeg_decoder::PixelFormat::L8 | jpeg_decoder::PixelFormat::L16);
    if !grey || bytes != file.pixels.bytes() || matches!(file.pixels, Pixels::Float) {
        let what = format!("a JPEG of {:?} for pixels of {} bytes", info.pixel_format, file.pixels.bytes());
        return Err(damaged(what));
    }
    let mut pixels = decoder.decode().map_err(failed)?;
    if pixels.len() != file.frame_bytes() {
        return Err(damaged(format!("a JPEG of {} bytes; {} are expected", pixels.len(), file.frame_bytes())));
    }
    if bytes == 2 {
        // 16-bit pixels come in the machine's order.
        for pair in pixels.as_chunks_mut::<2>().0 {
            *pair = u16::from_ne_bytes(*pair).to_le_bytes();
        }
    }
    Ok(pixels)
}
