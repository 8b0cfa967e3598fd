//! Slices of a series, read frame by frame.

use super::element::damaged;
use super::file::{File, Pixels};
use super::packing::Frames;
use super::placement::{Plane, name};
use super::syntax::Packing;
use crate::error::{Error, Result};
use crate::formats::imaging::image::Slices;
use std::io::Read;

/// The slices of a series.
pub(crate) struct Planes {
    files: Vec<File>,
    planes: Vec<Plane>,
    next: usize,
    /// Packed frames of the file that was read last, with its number.
    packed: Option<(usize, Frames)>,
    /// For each slice that was read, the rows at its end of which every byte is 0.
    zeros: Vec<usize>,
}

impl Planes {
    /// Slices in the order of `planes`.
    pub(crate) fn new(files: Vec<File>, planes: Vec<Plane>) -> Self {
        Self { files, planes, next: 0, packed: None, zeros: Vec::new() }
    }

    /// Slices in words: one, or how many and the first of them; none for none.
    fn listed(&self, slices: &[usize]) -> Option<String> {
        let first = *slices.first()?;
        let file = name(&self.files, *self.planes.get(first)?);
        let one = format!("slice {} of {} ({file})", first + 1, self.planes.len());
        Some(if slices.len() == 1 { one } else { format!("{} slices, the first of them {one},", slices.len()) })
    }

    fn bytes(&mut self, plane: Plane) -> Result<Vec<u8>> {
        let file = &self.files[plane.file];
        if file.syntax.packing == Packing::Plain {
            return plain(file, plane.frame);
        }
        if file.pixel_data.1.is_some() {
            return Err(damaged("packed pixels without parts"));
        }
        if self.packed.as_ref().is_none_or(|(number, _)| *number != plane.file) {
            self.packed = Some((plane.file, Frames::find(file)?));
        }
        match &self.packed {
            Some((_, frames)) => frames.unpack(file, plane.frame),
            None => Err(damaged("no packed pixels")),
        }
    }
}

/// Bytes of a frame that is not packed, least significant first.
fn plain(file: &File, frame: usize) -> Result<Vec<u8>> {
    let size = file.frame_bytes();
    let length = file.pixel_data.1.ok_or_else(|| damaged("pixels of undefined length that are not packed"))?;
    let (at, needed) = (frame as u64 * size as u64, (frame as u64 + 1) * size as u64);
    if needed > length.into() {
        return Err(damaged(format!("{length} bytes of pixels; frame {} ends at byte {needed}", frame + 1)));
    }
    let mut source = file.source()?;
    source.skip(file.pixel_data.0 + at).map_err(Error::system)?;
    let mut bytes = Vec::new();
    source.take(size as u64).read_to_end(&mut bytes).map_err(Error::system)?;
    if bytes.len() != size {
        return Err(damaged(format!("the file ends after {} of {size} bytes of a frame", bytes.len())));
    }
    if file.syntax.big {
        // 8-bit pixels are swapped in pairs where they are stored as words.
        let number =
            if file.words && size.is_multiple_of(2) { file.pixels.bytes().max(2) } else { file.pixels.bytes() };
        bytes.chunks_exact_mut(number).for_each(<[u8]>::reverse);
    }
    Ok(bytes)
}

/// Value of a pixel, before it is rescaled.
fn value(pixels: Pixels, bytes: &[u8]) -> f64 {
    let word = |n: usize| bytes.iter().take(n).rev().fold(0_u64, |word, byte| word << 8 | u64::from(*byte));
    match pixels {
        Pixels::Float => f32::from_bits(word(4) as u32).into(),
        Pixels::Double => f64::from_bits(word(8)),
        Pixels::Integer { allocated, stored, shift, signed } => {
            let bits = word(allocated as usize / 8) >> shift & ((1 << stored) - 1);
            let sign = if signed { 1_i64 << (stored - 1) } else { 0 };
            // The sign bit counts negative.
            ((bits.cast_signed() ^ sign) - sign) as f64
        }
    }
}

impl Slices for Planes {
    fn next_slice(&mut self, values: &mut [f64]) -> Result<()> {
        let plane = *self.planes.get(self.next).ok_or_else(|| damaged("a slice behind the last one is asked for"))?;
        let path = self.files[plane.file].path.clone();
        let bytes = self.bytes(plane).map_err(|e| e.at(&path))?;
        let file = &self.files[plane.file];
        let tail = bytes.iter().rev().take_while(|byte| **byte == 0).count();
        self.zeros.push(tail / (file.columns * file.pixels.bytes()).max(1));
        let (slope, intercept) = file.frame(plane.frame).rescale;
        let numbers = bytes.chunks_exact(file.pixels.bytes()).map(|b| value(file.pixels, b));
        values.iter_mut().zip(numbers).for_each(|(to, v)| *to = v * slope + intercept);
        self.next += 1;
        Ok(())
    }

    /// Copies that were broken off leave zeros where the rest of a file belongs. Air may be 0, too: this is no error.
    fn notes(&self) -> Vec<String> {
        let rows = self.files.first().map_or(0, |file| file.rows);
        let all = 0..self.zeros.len();
        let empty: Vec<usize> = all.clone().filter(|i| self.zeros[*i] == rows).collect();
        // What is 0 beside an object is so in the next slice as well; a row or two may be an accident.
        let few = (rows / 64).max(2);
        let is_cut = |i: &usize| {
            let beside = [i.checked_sub(1), Some(i + 1)].into_iter().flatten().filter_map(|at| self.zeros.get(at));
            let beside: Vec<usize> = beside.copied().filter(|zeros| *zeros < rows).collect();
            (few..rows).contains(&self.zeros[*i]) && !beside.is_empty() && beside.iter().all(|zeros| *zeros == 0)
        };
        let cut: Vec<usize> = all.filter(is_cut).collect();
        let lost = "values may be lost: compare the file with the one that it was copied from";
        let mut notes = Vec::new();
        if let Some(slices) = self.listed(&empty).filter(|_| empty.len() < self.zeros.len()) {
            notes.push(format!("every pixel of {slices} is stored as 0, and those of other slices are not; {lost}"));
        }
        if let Some((slices, first)) = self.listed(&cut).zip(cut.first()) {
            let count = self.zeros[*first];
            notes.push(format!(
                "the last {count} rows of {slices} are stored as 0, and those of the slices beside are not; {lost}"
            ));
        }
        notes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stored_bits_are_cut_out_and_signed() {
        let pixels = |allocated, stored, shift, signed| Pixels::Integer { allocated, stored, shift, signed };
        assert_eq!(value(pixels(16, 12, 0, true), &[0xff, 0xff]), -1.0);
        assert_eq!(value(pixels(16, 12, 0, false), &[0xff, 0xff]), 4095.0);
        assert_eq!(value(pixels(16, 12, 4, true), &[0x0f, 0x80]), -2048.0);
        assert_eq!(value(pixels(8, 8, 0, true), &[0x80]), -128.0);
        assert_eq!(value(pixels(32, 32, 0, true), &[0, 0, 0, 0x80]), -2_147_483_648.0);
        assert_eq!(value(pixels(32, 32, 0, false), &[0xff; 4]), 4_294_967_295.0);
        assert_eq!(value(Pixels::Float, &1.5_f32.to_le_bytes()), 1.5);
        assert_eq!(value(Pixels::Double, &(-0.1_f64).to_le_bytes()), -0.1);
    }
}
