//! Codecs of chunks.

use crate::error::{Error, Result};
use crate::formats::blosc;
use libdeflater::Decompressor;
use ruzstd::decoding::FrameDecoder;

/// A codec of bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Codec {
    /// One member of gzip.
    Gzip,
    /// A stream of zlib.
    Zlib,
    /// Frames of Zstandard.
    Zstd,
    /// A frame of Blosc 1.
    Blosc,
    /// A block of LZ4 behind its length in 4 bytes, as numcodecs writes it.
    Lz4,
    /// A checksum of 4 bytes at the end.
    Crc32c,
}

impl Codec {
    /// The codec of a name in the metadata.
    ///
    /// # Errors
    /// If it is not read.
    pub(crate) fn parse(name: &str) -> Result<Self> {
        // Zarr 3 names the codecs of the library numcodecs with a prefix.
        Ok(match name.strip_prefix("numcodecs.").unwrap_or(name) {
            "gzip" => Self::Gzip,
            "zlib" => Self::Zlib,
            "zstd" => Self::Zstd,
            "blosc" => Self::Blosc,
            "lz4" => Self::Lz4,
            "crc32c" => Self::Crc32c,
            _ => {
                return Err(Error::unsupported(format!("the codec '{name}' is not read"))
                    .hint("write the array with gzip, zlib, zstd, lz4 or blosc (lz4, zlib, zstd)"));
            }
        })
    }

    fn unpack(self, packed: &[u8], bytes: usize) -> Result<Vec<u8>> {
        let mut out = vec![0; bytes];
        let done = match self {
            Self::Gzip => Decompressor::new().gzip_decompress(packed, &mut out).map_err(|e| e.to_string()),
            Self::Zlib => Decompressor::new().zlib_decompress(packed, &mut out).map_err(|e| e.to_string()),
            Self::Zstd => FrameDecoder::new().decode_all(packed, &mut out).map_err(|e| e.to_string()),
            Self::Lz4 => {
                let block = packed.get(4..).unwrap_or_default();
                lz4_flex::block::decompress_into(block, &mut out).map_err(|e| e.to_string())
            }
            Self::Blosc => {
                out.clear();
                blosc::decompress(packed, bytes, &mut out)?;
                Ok(out.len())
            }
            Self::Crc32c => {
                return Err(Error::unsupported("a checksum before the bytes are packed is not read")
                    .hint("write the array with the checksum as the last codec"));
            }
        };
        match done {
            Ok(n) if n == bytes => Ok(out),
            Ok(n) => Err(damaged(format!("a chunk of {n} bytes, {bytes} are expected"))),
            Err(e) => Err(damaged(format!("the packed bytes are damaged: {e}"))),
        }
    }
}

fn damaged(what: impl Into<String>) -> Error {
    Error::invalid(what).hint("the file is damaged or incomplete: copy it again, or write it again where it was made")
}

/// CRC-32C (Castagnoli) of bytes.
pub(crate) fn crc32c(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0; 256];
        let mut i = 0;
        while i < 256 {
            let mut crc = i as u32;
            let mut bit = 0;
            while bit < 8 {
                crc = if crc & 1 == 1 { crc >> 1 ^ 0x82f6_3b78 } else { crc >> 1 };
                bit += 1;
            }
            table[i] = crc;
            i += 1;
        }
        table
    };
    !bytes.iter().fold(!0, |crc, byte| TABLE[usize::from(crc as u8 ^ byte)] ^ crc >> 8)
}

/// Takes the checksum off the end of bytes.
///
/// # Errors
/// If it is not there or disagrees.
pub(crate) fn checked(bytes: &[u8]) -> Result<&[u8]> {
    match bytes.split_last_chunk::<4>() {
        Some((content, stated)) if crc32c(content) == u32::from_le_bytes(*stated) => Ok(content),
        _ => Err(damaged("the checksum disagrees")),
    }
}

/// Undoes the codecs of a chunk, in this order, to `bytes` bytes.
///
/// # Errors
/// If the chunk is damaged or of another length, or two codecs follow each other that both pack.
pub(crate) fn decode(codecs: &[Codec], mut packed: Vec<u8>, bytes: usize) -> Result<Vec<u8>> {
    let mut left = codecs;
    while let [Codec::Crc32c, rest @ ..] = left {
        let content = checked(&packed)?.len();
        packed.truncate(content);
        left = rest;
    }
    match left {
        [] if packed.len() == bytes => Ok(packed),
        [] => Err(damaged(format!("a chunk of {} bytes, {bytes} are expected", packed.len()))),
        [one] => one.unpack(&packed, bytes),
        _ => Err(Error::unsupported("chunks that are packed twice are not read")
            .hint("write the array with one codec that packs")),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn checksums_are_those_of_the_standard() {
        // RFC 3720, B.4: 32 bytes of zeros, and of ones.
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&[0xff; 32]), 0x62a8_ab43);
        let whole = [&[1, 2, 3][..], &crc32c(&[1, 2, 3]).to_le_bytes()].concat();
        assert_eq!(decode(&[Codec::Crc32c], whole.clone(), 3).unwrap(), [1, 2, 3]);
        assert!(decode(&[Codec::Crc32c], whole[1..].to_vec(), 2).is_err());
    }

    #[test]
    fn damage_and_other_lengths_are_named() {
        let mut packed = vec![0; 64];
        let n = libdeflater::Compressor::new(libdeflater::CompressionLvl::default())
            .gzip_compress(&[7; 40], &mut packed)
            .unwrap();
        packed.truncate(n);
        assert_eq!(decode(&[Codec::Gzip], packed.clone(), 40).unwrap(), [7; 40]);
        for codec in [Codec::Gzip, Codec::Zlib, Codec::Zstd, Codec::Blosc, Codec::Lz4] {
            for n in 0..packed.len() {
                assert!(decode(&[codec], packed[..n].to_vec(), 40).is_err(), "{codec:?} {n}");
            }
        }
        assert!(decode(&[Codec::Gzip], packed, 41).is_err());
        assert!(Codec::parse("bz2").unwrap_err().to_string().contains("'bz2'"));
    }
}
