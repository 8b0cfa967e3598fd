//! Slices of numbers that lie in a stream of bytes or words.

use super::image::Slices;
use super::text::excerpt;
use crate::error::{Error, Result};
use crate::formats::sample::{Endian, Sample};
use std::io::{ErrorKind, Read};

/// Numbers that are decoded at a time.
const CHUNK: usize = 8192;

/// Slices of binary numbers, the components of a voxel together.
pub(crate) struct Binary {
    reader: Box<dyn Read>,
    sample: Sample,
    endian: Endian,
    /// Factor and offset that stored numbers are multiplied by and added to.
    scale: Option<(f64, f64)>,
    bytes: Vec<u8>,
    /// Numbers that have been read.
    done: u64,
}

impl Binary {
    /// Slices of the numbers that `reader` gives.
    pub(crate) fn new(reader: Box<dyn Read>, sample: Sample, endian: Endian) -> Self {
        Self { reader, sample, endian, scale: None, bytes: Vec::new(), done: 0 }
    }

    /// Applies a factor and an offset to every number, if there are any.
    pub(crate) fn scaled(self, scale: Option<(f64, f64)>) -> Self {
        Self { scale, ..self }
    }

    /// The stream that the numbers come from.
    pub(crate) fn into_reader(self) -> Box<dyn Read> {
        self.reader
    }

    fn fill(&mut self, values: &mut [f64]) -> Result<()> {
        self.bytes.resize(CHUNK.min(values.len()) * self.sample.bytes(), 0);
        let mut out = Vec::with_capacity(CHUNK);
        for chunk in values.chunks_mut(CHUNK) {
            let bytes = &mut self.bytes[..chunk.len() * self.sample.bytes()];
            self.reader.read_exact(bytes).map_err(|e| failed(e, self.done))?;
            out.clear();
            self.sample.decode(self.endian, bytes, &mut out);
            chunk.copy_from_slice(&out);
            self.done += chunk.len() as u64;
        }
        if let Some((factor, offset)) = self.scale {
            values.iter_mut().for_each(|v| *v = *v * factor + offset);
        }
        Ok(())
    }
}

impl Slices for Binary {
    fn next_slice(&mut self, values: &mut [f64]) -> Result<()> {
        self.fill(values)
    }
}

/// Error that a stream of numbers cannot be read on.
pub(crate) fn failed(error: std::io::Error, done: u64) -> Error {
    let what = match error.kind() {
        ErrorKind::UnexpectedEof => format!("the values end after {done}, before the last slice"),
        // Decoders of compressed data report damage so.
        ErrorKind::InvalidData | ErrorKind::InvalidInput | ErrorKind::Other => {
            format!("the compressed values are damaged after {done} of them: {error}")
        }
        _ => return Error::system(error),
    };
    Error::invalid(what).hint("the file is incomplete or damaged: copy it, or write it, again")
}

/// Slices of which each component has a stream of its own.
pub(crate) struct Planar {
    parts: Vec<Box<dyn Slices>>,
    plane: Vec<f64>,
}

impl Planar {
    /// Slices whose component `c` is that of `parts[c]`.
    pub(crate) fn new(parts: Vec<Box<dyn Slices>>) -> Self {
        Self { parts, plane: Vec::new() }
    }
}

impl Slices for Planar {
    fn next_slice(&mut self, values: &mut [f64]) -> Result<()> {
        let components = self.parts.len();
        self.plane.resize(values.len() / components.max(1), 0.0);
        for (component, part) in self.parts.iter_mut().enumerate() {
            part.next_slice(&mut self.plane)?;
            let own = values.iter_mut().skip(component).step_by(components);
            own.zip(&self.plane).for_each(|(to, from)| *to = *from);
        }
        Ok(())
    }
}

/// Longest text of a number.
const LONGEST: usize = 400;

/// Slices of numbers as text, between blanks.
pub(crate) struct Words {
    reader: Box<dyn Read>,
    buffer: Vec<u8>,
    at: usize,
    done: u64,
    /// Byte that ends the text before the end of the file, as `<` does in XML.
    end: Option<u8>,
}

impl Words {
    /// Slices of the numbers that `reader` gives as text.
    pub(crate) fn new(reader: Box<dyn Read>, end: Option<u8>) -> Self {
        Self { reader, buffer: Vec::new(), at: 0, done: 0, end }
    }

    fn byte(&mut self) -> Result<Option<u8>> {
        if self.at == self.buffer.len() {
            self.buffer.clear();
            (&mut self.reader).take(1 << 16).read_to_end(&mut self.buffer).map_err(|e| failed(e, self.done))?;
            self.at = 0;
        }
        let byte = self.buffer.get(self.at).copied().filter(|b| Some(*b) != self.end);
        self.at += usize::from(byte.is_some());
        Ok(byte)
    }

    fn number(&mut self) -> Result<f64> {
        let mut word = Vec::with_capacity(32);
        while let Some(byte) = self.byte()? {
            match (byte.is_ascii_whitespace() || byte == b',', word.is_empty()) {
                (true, true) => {}
                (true, false) => break,
                (false, _) if word.len() < LONGEST => word.push(byte),
                (false, _) => break,
            }
        }
        let text = String::from_utf8_lossy(&word);
        if word.is_empty() {
            return Err(failed(ErrorKind::UnexpectedEof.into(), self.done));
        }
        text.parse().map_err(|_| {
            Error::invalid(format!("value {} is '{}', which is no number", self.done, excerpt(&text)))
                .hint("the file is damaged: copy it, or write it, again")
        })
    }
}

impl Slices for Words {
    fn next_slice(&mut self, values: &mut [f64]) -> Result<()> {
        for value in values {
            *value = self.number()?;
            self.done += 1;
        }
        Ok(())
    }
}

/// Leaves values before the first slice out.
///
/// # Errors
/// If the values end before.
pub(crate) fn skip_values(slices: &mut dyn Slices, mut count: u64) -> Result<()> {
    let mut values = vec![0.0; CHUNK];
    while count > 0 {
        let n = count.min(CHUNK as u64);
        slices.next_slice(&mut values[..n as usize])?;
        count -= n;
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use std::io::Cursor;

    #[test]
    fn components_come_together_and_words_are_numbers() {
        let part = |bytes: &'static [u8]| -> Box<dyn Slices> {
            Box::new(Binary::new(Box::new(Cursor::new(bytes)), Sample::U8, Endian::Little).scaled(Some((2.0, 1.0))))
        };
        let mut planar = Planar::new(vec![part(&[1, 2, 3, 4]), part(&[5, 6, 7, 8]), part(&[9, 9, 9, 9])]);
        let mut values = [0.0; 6];
        planar.next_slice(&mut values).unwrap();
        assert_eq!(values, [3.0, 11.0, 19.0, 5.0, 13.0, 19.0]);
        planar.next_slice(&mut values).unwrap();
        assert!(planar.next_slice(&mut values).unwrap_err().to_string().contains("after 4"));
        let mut words = Words::new(Box::new(Cursor::new(" 1 -2.5e1\n3,4<5 6")), Some(b'<'));
        let mut values = [0.0; 2];
        skip_values(&mut words, 1).unwrap();
        words.next_slice(&mut values).unwrap();
        assert_eq!(values, [-25.0, 3.0]);
        assert!(words.next_slice(&mut values).unwrap_err().to_string().contains("after 4"));
        let mut words = Words::new(Box::new(Cursor::new("x")), None);
        assert!(words.next_slice(&mut values[..1]).unwrap_err().to_string().contains("'x'"));
    }
}
