//! Base64 as it stands in VTK's files: amid blanks, up to a tag, and in pieces that may each end in padding.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::io::{Error, ErrorKind, Read, Result};

/// Characters that are decoded at a time, a multiple of 4.
const CHUNK: usize = 1 << 14;

/// Bytes that a stream of characters stands for.
pub(crate) struct Base64<R> {
    text: R,
    /// Characters that were read and not decoded: fewer than 4, or a piece that waits behind padding.
    waiting: Vec<u8>,
    decoded: Vec<u8>,
    at: usize,
    ended: bool,
}

impl<R: Read> Base64<R> {
    /// Decodes up to the first `<`, or to the end of the stream.
    pub(crate) fn new(text: R) -> Self {
        Self { text, waiting: Vec::new(), decoded: Vec::new(), at: 0, ended: false }
    }

    /// Reads characters until there are enough, or the text ends.
    fn fetch(&mut self) -> Result<()> {
        let mut raw = vec![0; CHUNK];
        while !self.ended && self.waiting.len() < 4 {
            let n = self.text.read(&mut raw)?;
            let end = raw[..n].iter().position(|b| *b == b'<');
            self.ended = n == 0 || end.is_some();
            let text = &raw[..end.unwrap_or(n)];
            self.waiting.extend(text.iter().filter(|b| !b.is_ascii_whitespace()));
        }
        Ok(())
    }

    /// Decodes whole groups of four, up to padding.
    fn decode(&mut self) -> Result<()> {
        self.fetch()?;
        let whole = self.waiting.len() / 4 * 4;
        let padded = self.waiting[..whole].iter().position(|b| *b == b'=').map(|at| at / 4 * 4 + 4);
        let length = padded.unwrap_or(whole);
        self.decoded.clear();
        self.at = 0;
        let decoded = STANDARD.decode_vec(&self.waiting[..length], &mut self.decoded);
        decoded.map_err(|e| Error::new(ErrorKind::InvalidData, format!("no base64: {e}")))?;
        self.waiting.drain(..length);
        Ok(())
    }
}

impl<R: Read> Read for Base64<R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        if self.at == self.decoded.len() {
            self.decode()?;
        }
        let n = out.len().min(self.decoded.len() - self.at);
        out[..n].copy_from_slice(&self.decoded[self.at..self.at + n]);
        self.at += n;
        Ok(n)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn pieces_follow_their_padding() {
        let mut out = Vec::new();
        let text = b" QUI=\n Q0RF\nRg==  R0hJ</DataArray>QUJD";
        Base64::new(&text[..]).read_to_end(&mut out).unwrap();
        assert_eq!(out, b"ABCDEFGHI");
        assert!(Base64::new(&b"QU!D"[..]).read_to_end(&mut out).is_err());
        let long: Vec<u8> = (0..100_000_u32).map(|i| (i % 251) as u8).collect();
        let text = STANDARD.encode(&long);
        out.clear();
        Base64::new(text.as_bytes()).read_to_end(&mut out).unwrap();
        assert!(out == long);
    }
}
