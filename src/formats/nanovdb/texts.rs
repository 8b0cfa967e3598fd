//! Texts with names behind the tree of a grid, which NanoVDB calls blind data: programs that do not know them pass over
//! them. They hold what NanoVDB has no field for, and the name of a grid that is too long for the header.

use super::bytes::Bytes;
use super::layout::{self, ALIGNMENT, GRID_NAME_BYTES};
use super::memory::Memory;
use super::volume::Volume;
use crate::error::Result;
use std::collections::BTreeMap;

/// Bytes of the description of a text.
const DESCRIPTION: usize = 288;
/// Offset of the name in a description.
const NAME: usize = 32;
/// Bytes of that name, its NUL included.
const NAME_BYTES: usize = 256;
/// NanoVDB's number for a text that is the grid's name.
const GRID_NAME: u32 = 3;

/// A text that is written.
struct Text<'v> {
    name: &'v str,
    class: u32,
    value: &'v str,
}

/// Texts of a grid; its long name is the last one, as NanoVDB expects.
fn of(volume: &Volume) -> Vec<Text<'_>> {
    let texts = volume.texts.iter().map(|(name, value)| Text { name, class: 0, value });
    let long = volume.name.len() >= GRID_NAME_BYTES;
    texts.chain(long.then_some(Text { name: "grid name", class: GRID_NAME, value: &volume.name })).collect()
}

/// Bytes of a text with its NUL, up to the place of the next one.
fn room(text: &Text<'_>) -> usize {
    (text.value.len() + 1).next_multiple_of(ALIGNMENT)
}

/// Bytes that the texts of a grid take behind its tree.
pub(super) fn size(volume: &Volume) -> usize {
    of(volume).iter().map(|text| DESCRIPTION + room(text)).sum()
}

/// Writes the texts of a grid behind its tree, from byte `start` on, and says in the header where they are.
pub(super) fn write(memory: &mut Memory, start: usize, volume: &Volume) {
    let texts = of(volume);
    if texts.is_empty() {
        return;
    }
    memory.u64(layout::GRID_TEXTS as usize, start as u64);
    memory.u32(layout::GRID_TEXT_COUNT as usize, texts.len() as u32);
    let mut at = start + DESCRIPTION * texts.len();
    for (i, text) in texts.iter().enumerate() {
        let description = start + DESCRIPTION * i;
        // Offsets count from the description. Values are characters, of type and meaning unknown (0).
        memory.u64(description, (at - description) as u64);
        memory.u64(description + 8, text.value.len() as u64 + 1);
        memory.u32(description + 16, 1);
        memory.u32(description + 24, text.class);
        let name = &text.name.as_bytes()[..text.name.len().min(NAME_BYTES - 1)];
        memory.0[description + NAME..][..name.len()].copy_from_slice(name);
        memory.0[at..][..text.value.len()].copy_from_slice(text.value.as_bytes());
        at += room(text);
    }
}

/// Reads the texts of a grid that have one of the names `wanted`.
///
/// # Errors
/// If a description or a text lies outside the grid.
pub(super) fn read(memory: Bytes, wanted: &[&str]) -> Result<BTreeMap<String, String>> {
    let mut texts = BTreeMap::new();
    let start = memory.u64(layout::GRID_TEXTS, "the place of the texts")?;
    let count = memory.u32(layout::GRID_TEXT_COUNT, "the number of texts")?;
    for i in 0..u64::from(count) {
        let at = start.saturating_add(i * DESCRIPTION as u64);
        let description = Bytes(memory.slice(at, DESCRIPTION, "the description of a text")?);
        let name = terminated(description.slice(NAME as u64, NAME_BYTES, "its name")?);
        let type_number = description.u32(28, "its type")?;
        if type_number != 0 || !wanted.contains(&name.as_str()) {
            continue;
        }
        let value = at.saturating_add_signed(description.i64(0, "its place")?);
        let length = usize::try_from(description.u64(8, "its length")?).unwrap_or(usize::MAX);
        texts.insert(name, terminated(memory.slice(value, length, "a text")?));
    }
    Ok(texts)
}

/// Text up to the first NUL.
pub(super) fn terminated(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}
