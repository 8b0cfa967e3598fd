//! Kitty's graphics protocol: a PNG in base 64, in chunks of at most 4096 bytes.

use crate::error::Result;
use crate::formats::png;
use crate::report::sheet::Canvas;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// Largest number of characters of a chunk.
const CHUNK: usize = 4096;

/// Escape sequences that transmit and show a picture; the terminal does not answer them.
///
/// # Errors
/// If the picture has no pixels.
pub(super) fn encode(canvas: &Canvas) -> Result<Vec<u8>> {
    let data = STANDARD.encode(png::encode_rgb8(canvas.width, canvas.height, &canvas.rgb)?);
    let mut out = Vec::new();
    let chunks = data.as_bytes().chunks(CHUNK);
    let last = chunks.len().saturating_sub(1);
    for (i, chunk) in chunks.enumerate() {
        let first = if i == 0 { "a=T,f=100,q=2," } else { "" };
        out.extend(format!("\x1b_G{first}m={};", u8::from(i < last)).into_bytes());
        out.extend(chunk);
        out.extend(b"\x1b\\");
    }
    out.push(b'\n');
    Ok(out)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn chunks_make_up_the_picture() {
        // Noise does not compress, and so takes several chunks.
        let noise = |i: u64| (i.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ i << 7).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 56;
        let rgb: Vec<u8> = (0..3 * 90 * 90).map(|i| noise(i) as u8).collect();
        let canvas = Canvas::of(90, 90, rgb);
        let text = String::from_utf8(encode(&canvas).unwrap()).unwrap();
        let chunks: Vec<&str> = text.trim_end().split("\x1b_G").skip(1).collect();
        assert!(chunks.len() > 2 && chunks[0].starts_with("a=T,f=100,q=2,m=1;"));
        assert!(chunks[1].starts_with("m=1;") && chunks[chunks.len() - 1].starts_with("m=0;"));
        let data = chunks.iter().map(|c| c.split_once(';').unwrap().1.trim_end_matches("\x1b\\")).collect::<String>();
        assert_eq!(STANDARD.decode(data).unwrap(), png::encode_rgb8(90, 90, &canvas.rgb).unwrap());
        assert!(chunks.iter().all(|c| c.len() <= CHUNK + 32));
    }
}
