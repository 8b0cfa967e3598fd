//! Elements of a data set, read one after another. Only what is wanted is kept, within a budget.

use super::syntax::Syntax;
use crate::error::{Code, Error, Result};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};

/// A stream of bytes, of which parts can be skipped.
pub(crate) trait Source: Read {
    /// Skips bytes. Skipping behind the end is no error; reading there is.
    fn skip(&mut self, count: u64) -> std::io::Result<()>;
}

impl Source for BufReader<File> {
    fn skip(&mut self, count: u64) -> std::io::Result<()> {
        self.seek_relative(i64::try_from(count).unwrap_or(i64::MAX))
    }
}

impl Source for flate2::read::DeflateDecoder<BufReader<File>> {
    fn skip(&mut self, count: u64) -> std::io::Result<()> {
        std::io::copy(&mut self.take(count), &mut std::io::sink()).map(|_| ())
    }
}

/// Largest value that is kept, in bytes.
const MOST_VALUE: u32 = 1 << 16;
/// Deepest nesting of sequences.
const MOST_DEPTH: u32 = 32;

/// Item of a sequence.
const ITEM: u32 = 0xfffe_e000;
/// End of an item of undefined length.
const ITEM_END: u32 = 0xfffe_e00d;
/// End of a sequence of undefined length.
const SEQUENCE_END: u32 = 0xfffe_e0dd;

/// Value of an element.
#[derive(Debug, Clone)]
pub(crate) enum Value {
    /// Bytes as they are.
    Bytes(Vec<u8>),
    /// Items of a sequence.
    Items(Vec<Item>),
}

/// Elements by tag: `0xggggeeee` for group `gggg`, element `eeee`.
pub(crate) type Item = BTreeMap<u32, Value>;

/// An element before its value.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Head {
    /// Tag of the element.
    pub tag: u32,
    /// Type, if stated.
    pub vr: [u8; 2],
    /// Bytes of the value; none if undefined.
    pub length: Option<u32>,
}

/// Error about a file whose elements contradict each other.
pub(crate) fn damaged(what: impl Into<String>) -> Error {
    Error::invalid(what).hint("the file is damaged or incomplete: export the series again")
}

/// Tag in the standard's notation.
pub(crate) fn tag_text(tag: u32) -> String {
    format!("({:04x},{:04x})", tag >> 16, tag & 0xffff)
}

/// Reader of elements.
pub(crate) struct Elements {
    source: Box<dyn Source>,
    syntax: Syntax,
    /// Bytes read so far.
    at: u64,
    /// Bytes of values that may still be kept.
    budget: u64,
}

impl Elements {
    /// Reads a data set from its first byte on, and keeps at most `budget` bytes of it.
    pub(crate) fn new(source: Box<dyn Source>, syntax: Syntax, budget: u64) -> Self {
        Self { source, syntax, at: 0, budget }
    }

    /// Bytes read so far.
    pub(crate) fn position(&self) -> u64 {
        self.at
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        self.source.read_exact(&mut bytes).map_err(|e| self.ended(&e))?;
        self.at += N as u64;
        Ok(bytes)
    }

    fn ended(&self, error: &std::io::Error) -> Error {
        damaged(format!("the file cannot be read on after {} bytes of its data set ({error})", self.at))
    }

    fn u16(&mut self) -> Result<u16> {
        let bytes = self.bytes()?;
        Ok(if self.syntax.big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    }

    fn u32(&mut self) -> Result<u32> {
        let bytes = self.bytes()?;
        Ok(if self.syntax.big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    fn tag(&mut self) -> Result<u32> {
        Ok(u32::from(self.u16()?) << 16 | u32::from(self.u16()?))
    }

    /// Reads tag, type and length of the next element; none at the end of the file.
    pub(crate) fn head(&mut self) -> Result<Option<Head>> {
        let mut first = [0];
        if self.source.read(&mut first).map_err(|e| self.ended(&e))? == 0 {
            return Ok(None);
        }
        self.at += 1;
        let [second] = self.bytes()?;
        let pair = [first[0], second];
        let group = if self.syntax.big { u16::from_be_bytes(pair) } else { u16::from_le_bytes(pair) };
        let tag = u32::from(group) << 16 | u32::from(self.u16()?);
        self.head_of(tag).map(Some)
    }

    fn head_of(&mut self, tag: u32) -> Result<Head> {
        let defined = |length: u32| (length != u32::MAX).then_some(length);
        if !self.syntax.explicit || matches!(tag, ITEM | ITEM_END | SEQUENCE_END) {
            return Ok(Head { tag, vr: [0; 2], length: defined(self.u32()?) });
        }
        let vr = self.bytes()?;
        if !vr.iter().all(u8::is_ascii_uppercase) {
            return Err(damaged(format!("element {} has the type {vr:02x?}; two letters are expected", tag_text(tag))));
        }
        let long = matches!(
            &vr,
            b"OB" | b"OD" | b"OF" | b"OL" | b"OV" | b"OW" | b"SQ" | b"SV" | b"UC" | b"UN" | b"UR" | b"UT" | b"UV"
        );
        let length = if long {
            self.bytes::<2>()?;
            defined(self.u32()?)
        } else {
            Some(self.u16()?.into())
        };
        Ok(Head { tag, vr, length })
    }

    fn skip(&mut self, count: u64) -> Result<()> {
        self.source.skip(count).map_err(|e| self.ended(&e))?;
        self.at = self.at.saturating_add(count);
        Ok(())
    }

    fn keep(&mut self, bytes: u64) -> Result<()> {
        self.budget = self.budget.checked_sub(bytes + 128).ok_or_else(|| {
            Error::unsupported("the descriptions of the frames do not fit into the memory allowed")
                .coded(Code::MemoryLimit)
                .hint("raise ⟨max_memory⟩ if the file is to be trusted")
        })?;
        Ok(())
    }

    /// Reads a value as bytes.
    pub(crate) fn value(&mut self, head: Head) -> Result<Vec<u8>> {
        let length = head.length.filter(|n| *n <= MOST_VALUE).ok_or_else(|| {
            damaged(format!("element {} has a value of {:?} bytes, too many for it", tag_text(head.tag), head.length))
        })?;
        self.keep(length.into())?;
        let mut bytes = vec![0; length as usize];
        self.source.read_exact(&mut bytes).map_err(|e| self.ended(&e))?;
        self.at += u64::from(length);
        Ok(bytes)
    }

    /// Reads elements up to one of `stops`, which is returned, or to the end.
    pub(crate) fn data_set(&mut self, wanted: &[u32], stops: &[u32], item: &mut Item) -> Result<Option<Head>> {
        while let Some(head) = self.head()? {
            if stops.contains(&head.tag) {
                return Ok(Some(head));
            }
            self.element(head, wanted, item, 0)?;
        }
        Ok(None)
    }

    /// Keeps or skips an element.
    fn element(&mut self, head: Head, wanted: &[u32], item: &mut Item, depth: u32) -> Result<()> {
        let keeps = wanted.contains(&head.tag);
        let sequence =
            &head.vr == b"SQ" || head.length.is_none() || keeps && super::tags::SEQUENCES.contains(&head.tag);
        match head.length {
            Some(length) if !keeps => self.skip(length.into()),
            None if matches!(&head.vr, b"OB" | b"OW") => self.fragments(),
            _ if sequence => {
                let items = self.sequence(head, wanted, depth)?;
                if keeps {
                    item.insert(head.tag, Value::Items(items));
                }
                Ok(())
            }
            _ => {
                let bytes = self.value(head)?;
                item.insert(head.tag, Value::Bytes(bytes));
                Ok(())
            }
        }
    }

    /// Skips packed pixels of an icon.
    fn fragments(&mut self) -> Result<()> {
        loop {
            let tag = self.tag()?;
            match (tag, self.head_of(tag)?.length) {
                (ITEM, Some(length)) => self.skip(length.into())?,
                (SEQUENCE_END, _) => return Ok(()),
                _ => return Err(damaged(format!("element {} among packed pixels", tag_text(tag)))),
            }
        }
    }

    fn sequence(&mut self, head: Head, wanted: &[u32], depth: u32) -> Result<Vec<Item>> {
        if depth > MOST_DEPTH {
            return Err(damaged(format!("sequences are nested more than {MOST_DEPTH} deep")));
        }
        let syntax = self.syntax;
        if &head.vr == b"UN" {
            // The items of an unknown type are coded without types.
            self.syntax = Syntax { explicit: false, big: false, ..syntax };
        }
        let end = head.length.map(|length| self.at.saturating_add(length.into()));
        let mut items = Vec::new();
        while end.is_none_or(|end| self.at < end) {
            let tag = self.tag()?;
            let Head { length, .. } = self.head_of(tag)?;
            match tag {
                SEQUENCE_END => break,
                ITEM => {
                    self.keep(0)?;
                    items.push(self.item(length, wanted, depth)?);
                }
                _ => {
                    return Err(damaged(format!("element {} in a sequence, where an item is expected", tag_text(tag))));
                }
            }
        }
        self.syntax = syntax;
        Ok(items)
    }

    fn item(&mut self, length: Option<u32>, wanted: &[u32], depth: u32) -> Result<Item> {
        let end = length.map(|length| self.at.saturating_add(length.into()));
        let mut item = Item::new();
        while end.is_none_or(|end| self.at < end) {
            let tag = self.tag()?;
            let head = self.head_of(tag)?;
            if tag == ITEM_END {
                break;
            }
            self.element(head, wanted, &mut item, depth + 1)?;
        }
        Ok(item)
    }
}
