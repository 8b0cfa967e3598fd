//! Binary layers, checked before the crate `openusd` reads them.
//!
//! The crate trusts what a file states: a damaged one makes it allocate any amount, follow jumps in circles or nest
//! dictionaries without end. Checked is what makes its work finite: that counts have the bytes they speak of, that the
//! tree of paths is walked once, and how much lies in dictionaries and samples (USD Core Specification 1.0.1, section
//! 16.3).

use crate::error::{Code, Error, Result};
use std::collections::HashMap;

/// Bytes for which a byte of a block of LZ4 stands at most.
const MOST_EXPANDED: u64 = 255;
/// Greatest depth of dictionaries in dictionaries.
const MOST_NESTED: u32 = 64;
/// Greatest depth of paths.
const MOST_DEPTH: u32 = 4096;
/// Paths that may be stated beyond those that the tree has.
const MOST_UNNAMED: u64 = 1024;
/// Length from which arrays may be compressed.
const LEAST_COMPRESSED: u64 = 4;

/// Types of values, as files number them.
mod kinds {
    pub(super) const STRING: u8 = 10;
    pub(super) const ASSET: u8 = 12;
    pub(super) const DICTIONARY: u8 = 31;
    pub(super) const REFERENCES: u8 = 35;
    pub(super) const PATHS: u8 = 40;
    pub(super) const TOKENS: u8 = 41;
    pub(super) const VARIANTS: u8 = 45;
    pub(super) const SAMPLES: u8 = 46;
    pub(super) const DOUBLES: u8 = 48;
    pub(super) const OFFSETS: u8 = 49;
    pub(super) const STRINGS: u8 = 50;
    pub(super) const PAYLOADS: u8 = 55;
    pub(super) const EXPRESSION: u8 = 57;
    pub(super) const RELOCATES: u8 = 58;
}

/// Checks a binary layer, of which each array and all paths together may take `most` bytes. Returns it as the crate
/// reads it. At its end lie empty arrays of text, of which the file states no place and which the crate looks for at
/// the beginning, and arrays of 64-bit integers without compression, for which the crate takes too little memory to
/// unpack them.
///
/// # Errors
/// If a count, a jump or a place in the file cannot be true, or an array is too large. The error names the place.
pub(super) fn checked(bytes: Vec<u8>, most: u64) -> Result<Vec<u8>> {
    let version = [8, 9, 10].map(|at| bytes.get(at).copied().unwrap_or_default());
    let mut file = Reader::new(&bytes, version, most);
    file.at = 16;
    file.at = file.word()? as usize;
    let mut sections = Vec::new();
    for _ in 0..file.count(32)? {
        let name = file.take::<16>()?;
        sections.push(Section { name, stated: file.at, start: file.word()? as usize });
        file.word()?;
    }
    let section = |name: &[u8]| sections.iter().find(|section| section.is_named(name));
    let mut lengths = Vec::new();
    if let Some(section) = section(b"TOKENS") {
        file.at = section.start;
        let [_, size] = [file.word()?, file.word()?];
        lengths = file.expanded(size)?.split(|byte| *byte == 0).map(|token| token.len() as u64).collect();
    }
    if let Some(section) = section(b"STRINGS") {
        file.at = section.start;
        file.count(4)?;
    }
    if let Some(section) = section(b"FIELDSETS") {
        file.at = section.start;
        file.integers()?;
    }
    if let Some(section) = section(b"SPECS") {
        file.at = section.start;
        let count = file.word()?;
        (0..3).try_for_each(|_| file.encoded(count).map(drop))?;
    }
    if let Some(section) = section(b"PATHS") {
        file.at = section.start;
        file.paths(&lengths)?;
    }
    let Some(section) = section(b"FIELDS") else { return Ok(bytes) };
    file.at = section.start;
    let count = file.integers()?;
    let names = section.start..file.at;
    let mut values: Vec<u64> = file.expanded(count.saturating_mul(8))?.as_chunks().0.iter().map(word).collect();
    for value in &values {
        if file.value(*value, 0)? > bytes.len() as u64 {
            return Err(file.damaged());
        }
    }
    let Reader { moved, nested, tail, .. } = file;
    if moved.is_empty() {
        return Ok(bytes);
    }
    let mut mended = [&bytes[..], &tail].concat();
    for at in nested {
        let value = word(&std::array::from_fn(|i| bytes[at + i]));
        let value = moved.get(&value).unwrap_or(&value);
        mended[at..at + 8].copy_from_slice(&value.to_le_bytes());
    }
    values.iter_mut().for_each(|value| *value = *moved.get(value).unwrap_or(value));
    let start = mended.len();
    let values: Vec<u8> = values.into_iter().flat_map(u64::to_le_bytes).collect();
    let block = [&[0][..], &lz4_flex::block::compress(&values)].concat();
    mended.extend_from_slice(&bytes[names]);
    mended.extend((block.len() as u64).to_le_bytes());
    mended.extend(block);
    let size = mended.len() - start;
    for (at, stated) in [(section.stated, start), (section.stated + 8, size)] {
        mended[at..at + 8].copy_from_slice(&(stated as u64).to_le_bytes());
    }
    Ok(mended)
}

fn word(bytes: &[u8; 8]) -> u64 {
    u64::from_le_bytes(*bytes)
}

/// True of arrays of text without an element, of which no place is stated.
fn is_empty_text(value: u64) -> bool {
    value >> 63 == 1
        && value & ((1 << 48) - 1) == 0
        && matches!((value >> 48) as u8, kinds::STRING | kinds::ASSET | kinds::EXPRESSION)
}

/// A section of a file.
struct Section {
    name: [u8; 16],
    /// Place of the statement where it starts.
    stated: usize,
    start: usize,
}

impl Section {
    fn is_named(&self, name: &[u8]) -> bool {
        self.name.split(|byte| *byte == 0).next() == Some(name)
    }
}

/// A file, read from where a section or a value begins.
struct Reader<'b> {
    bytes: &'b [u8],
    at: usize,
    version: [u8; 3],
    most: u64,
    /// Numbers of values in those that were checked.
    works: HashMap<u64, u64>,
    /// Values that lie elsewhere in what the crate reads, by what the file states.
    moved: HashMap<u64, u64>,
    /// Places where such values are stated among others.
    nested: Vec<usize>,
    /// Bytes behind the file.
    tail: Vec<u8>,
}

impl<'b> Reader<'b> {
    fn new(bytes: &'b [u8], version: [u8; 3], most: u64) -> Self {
        let (works, moved) = (HashMap::new(), HashMap::new());
        // An empty array, wherever one is looked for.
        Self { bytes, at: 0, version, most, works, moved, nested: Vec::new(), tail: vec![0; 8] }
    }

    fn damaged(&self) -> Error {
        Error::invalid(format!("no valid USD: what is stated before byte {} cannot be", self.at))
            .hint("write the stage again where it was made")
    }

    fn skip(&mut self, length: u64) -> Result<&'b [u8]> {
        let end = usize::try_from(length).ok().and_then(|length| self.at.checked_add(length));
        let skipped = end.and_then(|end| self.bytes.get(self.at..end)).ok_or_else(|| self.damaged())?;
        self.at += skipped.len();
        Ok(skipped)
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        let bytes = self.skip(N as u64)?;
        bytes.try_into().map_err(|_| self.damaged())
    }

    fn word(&mut self) -> Result<u64> {
        self.take().map(u64::from_le_bytes)
    }

    /// Returns a count if the bytes behind it suffice for that many things of `each` bytes or more.
    fn fitting(&self, count: u64, each: u64) -> Result<u64> {
        let left = self.bytes.len().saturating_sub(self.at) as u64;
        let fits = count.checked_mul(each).is_some_and(|size| size <= left);
        if fits { Ok(count) } else { Err(self.damaged()) }
    }

    /// Reads the count of things of `each` bytes or more, which follow.
    fn count(&mut self, each: u64) -> Result<u64> {
        let count = self.word()?;
        self.fitting(count, each)
    }

    /// Reads the count of things of `each` bytes, and leaves them behind.
    fn list(&mut self, each: u64) -> Result<()> {
        let count = self.count(each)?;
        self.skip(count * each).map(drop)
    }

    /// Reads a compressed block that stands for `least` bytes or more, for which memory for `room` bytes is taken.
    fn block(&mut self, least: u64, room: u64) -> Result<&'b [u8]> {
        let length = self.count(1)?;
        if least > MOST_EXPANDED.saturating_mul(length + 1) {
            return Err(self.damaged());
        }
        self.affordable(room)?;
        self.skip(length)
    }

    /// Refuses what takes more memory than there may be.
    fn affordable(&self, size: u64) -> Result<()> {
        if size <= self.most {
            return Ok(());
        }
        Err(Error::unsupported(format!("what is stated before byte {} takes {size} bytes or more", self.at))
            .coded(Code::MemoryLimit)
            .hint("raise ⟨max_memory⟩, of which layers may take a quarter, if the stage is to be trusted"))
    }

    /// Reads a compressed block of `size` bytes, and returns what it stands for.
    fn expanded(&mut self, size: u64) -> Result<Vec<u8>> {
        let block = self.block(0, size)?;
        self.decompressed(block, size)
    }

    fn decompressed(&self, block: &[u8], room: u64) -> Result<Vec<u8>> {
        // Its first byte is the number of parts that it is cut into, 0 for one.
        let Some((0, block)) = block.split_first() else { return Err(self.damaged()) };
        let mut bytes = vec![0; room as usize];
        let length = lz4_flex::block::decompress_into(block, &mut bytes).map_err(|_| self.damaged())?;
        bytes.truncate(length);
        Ok(bytes)
    }

    /// Reads a block of that many integers, which take a quarter of a byte or more, and returns its bytes.
    fn encoded(&mut self, count: u64) -> Result<&'b [u8]> {
        self.block(count / 4, count.saturating_mul(5).saturating_add(8))
    }

    /// Reads the count of integers and their block.
    fn integers(&mut self) -> Result<u64> {
        let count = self.word()?;
        self.encoded(count)?;
        Ok(count)
    }

    /// Reads that many integers of 32 bits.
    fn decoded(&mut self, count: u64) -> Result<Vec<i32>> {
        let block = self.encoded(count)?;
        let bytes = self.decompressed(block, 8 + 5 * count)?;
        let decoded = decoded(&bytes, count as usize, [4, 1, 2, 4]).ok_or_else(|| self.damaged())?;
        Ok(decoded.into_iter().map(|v| v as i32).collect())
    }

    /// Walks the tree of paths: the first child of a path is the next one, and its sibling stands somewhere behind.
    fn paths(&mut self, lengths: &[u64]) -> Result<()> {
        let [stated, count] = [self.word()?, self.word()?];
        if stated > count.saturating_mul(2).saturating_add(MOST_UNNAMED) {
            return Err(self.damaged());
        }
        self.encoded(count)?;
        let (tokens, jumps) = (self.decoded(count)?, self.decoded(count)?);
        let (mut walked, mut size) = (0, 0_u64);
        let mut open = vec![(0, 0, 0)];
        while let Some((mut at, mut depth, mut length)) = open.pop() {
            while let (Some(token), Some(jump)) = (tokens.get(at), jumps.get(at)) {
                walked += 1;
                let own: u64 = length + 1 + lengths.get(token.unsigned_abs() as usize).copied().unwrap_or_default();
                size = size.saturating_add(own);
                if walked > count || depth > MOST_DEPTH {
                    return Err(self.damaged());
                }
                self.affordable(size)?;
                if *jump > 0 {
                    open.push((at + *jump as usize, depth, length));
                }
                match *jump {
                    0 => {}
                    -1 | 1.. => (depth, length) = (depth + 1, own),
                    _ => break,
                }
                at += 1;
            }
        }
        Ok(())
    }

    /// Follows a jump, which is stated from where it stands and leads forwards.
    fn jump(&mut self) -> Result<()> {
        let by = self.word()?.checked_sub(8).ok_or_else(|| self.damaged())?;
        self.skip(by).map(drop)
    }

    /// Checks a value and those in it, and returns their number.
    fn value(&mut self, value: u64, nested: u32) -> Result<u64> {
        if let Some(work) = self.works.get(&value) {
            return Ok(*work);
        }
        if nested > MOST_NESTED {
            return Err(self.damaged());
        }
        let [is_array, is_inlined, is_compressed] = [63, 62, 61].map(|bit| value >> bit & 1 == 1);
        let (kind, place) = ((value >> 48) as u8, value & ((1 << 48) - 1));
        // The crate does not heed what other types say of it.
        let is_array = is_array && matches!(kind, ..kinds::DICTIONARY | 56 | kinds::EXPRESSION);
        if is_empty_text(value) {
            self.moved.insert(value, value | self.bytes.len() as u64);
        }
        if is_array && place == 0 || is_inlined && !is_array && kind != kinds::PAYLOADS {
            return Ok(1);
        }
        self.at = place as usize;
        let mut work = 1;
        match (kind, is_array) {
            (kinds::STRING | kinds::ASSET | kinds::EXPRESSION, true) => self.list(4)?,
            (_, true) | (kinds::DOUBLES, _) => {
                if let Some(place) = self.array(kind, is_compressed)? {
                    let kind = value & !(1 << 61) & !((1 << 48) - 1);
                    self.moved.insert(value, kind | place);
                }
            }
            (kinds::PATHS | kinds::TOKENS | kinds::STRINGS, _) => self.list(4)?,
            (kinds::VARIANTS | kinds::RELOCATES, _) => self.list(8)?,
            (kinds::OFFSETS, _) => self.list(16)?,
            (kinds::DICTIONARY, _) => work = self.dictionary(nested)?,
            (kinds::SAMPLES, _) => work = self.samples(nested)?,
            (32..=39 | 54 | kinds::PAYLOADS, _) => work = self.edits(kind, nested)?,
            // One number or a few.
            _ => {}
        }
        self.works.insert(value, work);
        Ok(work)
    }

    /// Checks an array of numbers or tokens. Returns the place of one of 64-bit integers that was unpacked.
    fn array(&mut self, kind: u8, is_compressed: bool) -> Result<Option<u64>> {
        if self.version < [0, 5, 0] {
            self.skip(4)?;
        }
        let count = if self.version < [0, 7, 0] { u32::from_le_bytes(self.take()?).into() } else { self.word()? };
        let (size, since) = match kind {
            1 | 2 => (1, None),
            // Integers.
            3 | 4 => (4, Some([0, 5, 0])),
            5 | 6 => (8, Some([0, 5, 0])),
            // Numbers with fractions; time codes.
            7 => (2, Some([0, 6, 0])),
            8 => (4, Some([0, 6, 0])),
            9 | kinds::DOUBLES | 56 => (8, Some([0, 6, 0])),
            // Tokens.
            11 => (4, None),
            13 => (32, None),
            14 => (72, None),
            15 => (128, None),
            // Quaternions and vectors, which begin with doubles and go on with floats, halves and integers.
            16 => (32, None),
            17 => (16, None),
            18 => (8, None),
            19..=30 => {
                let each = [8, 4, 2, 4][usize::from(kind - 19) % 4];
                (each * (2 + u64::from(kind - 19) / 4), None)
            }
            // The crate reads no arrays of others.
            _ => return Ok(None),
        };
        if !is_compressed || count < LEAST_COMPRESSED || since.is_none_or(|since| self.version < since) {
            return self.fitting(count, size).map(|_| None);
        }
        if since == Some([0, 6, 0]) {
            match self.take()? {
                [b'i'] => {}
                [b't'] => {
                    let table = self.take().map(u32::from_le_bytes)?;
                    self.fitting(table.into(), size)?;
                    self.skip(u64::from(table) * size)?;
                }
                _ => return Err(self.damaged()),
            }
        }
        let unpacked = count.saturating_mul(size);
        self.affordable(unpacked)?;
        let block = self.encoded(count)?;
        if !matches!(kind, 5 | 6) {
            return Ok(None);
        }
        self.affordable(unpacked.saturating_add(self.tail.len() as u64))?;
        let bytes = self.decompressed(block, 16 + 9 * count)?;
        let integers = decoded(&bytes, count as usize, [8, 2, 4, 8]).ok_or_else(|| self.damaged())?;
        let place = (self.bytes.len() + self.tail.len()) as u64;
        let length = if self.version < [0, 7, 0] { 4 } else { 8 };
        self.tail.extend(&count.to_le_bytes()[..length]);
        self.tail.extend(integers.into_iter().flat_map(i64::to_le_bytes));
        Ok(Some(place))
    }

    /// Checks a dictionary, and returns the number of values in it.
    fn dictionary(&mut self, nested: u32) -> Result<u64> {
        let mut work = 1_u64;
        for _ in 0..self.count(20)? {
            self.skip(4)?;
            self.jump()?;
            work = work.saturating_add(self.aside(nested)?);
        }
        Ok(work)
    }

    /// Checks a value that is stated here but lies elsewhere, and goes on behind the statement.
    fn aside(&mut self, nested: u32) -> Result<u64> {
        let value = self.word()?;
        let here = self.at;
        let work = self.value(value, nested + 1)?;
        if self.moved.contains_key(&value) {
            self.nested.push(here - 8);
        }
        self.at = here;
        Ok(work)
    }

    /// Checks samples over time, and returns the number of values in them.
    fn samples(&mut self, nested: u32) -> Result<u64> {
        self.jump()?;
        let mut work = self.aside(nested)?;
        self.jump()?;
        for _ in 0..self.count(8)? {
            work = work.saturating_add(self.aside(nested)?);
        }
        Ok(work)
    }

    /// Checks edits of a list, and returns the number of values in them.
    fn edits(&mut self, kind: u8, nested: u32) -> Result<u64> {
        let [held] = self.take::<1>()?;
        let mut work = 1_u64;
        // The first bit says that the list replaces those before.
        for _ in 0..(held >> 1).count_ones() {
            match kind {
                kinds::REFERENCES => {
                    for _ in 0..self.count(32)? {
                        // An asset, a prim, and an offset and scale of time.
                        self.skip(4 + 4 + 16)?;
                        work = work.saturating_add(self.dictionary(nested + 1)?);
                    }
                }
                kinds::PAYLOADS => self.list(if self.version < [0, 8, 0] { 8 } else { 24 })?,
                37 | 39 => self.list(8)?,
                _ => self.list(4)?,
            }
        }
        Ok(work)
    }
}

/// Returns integers from the differences that a file holds: the most frequent one, two bits for the length of each, and
/// all others. `lengths` are the bytes of the most frequent one and of the others by their bits. Returns `None` if
/// there are too few.
fn decoded(bytes: &[u8], count: usize, lengths: [usize; 4]) -> Option<Vec<i64>> {
    let (frequent, rest) = bytes.split_at_checked(lengths[0])?;
    let (codes, mut rest) = rest.split_at_checked(count.div_ceil(4))?;
    let mut integers = Vec::with_capacity(count);
    let mut sum = 0_i64;
    for number in 0..count {
        let difference = match codes[number / 4] >> (2 * (number % 4)) & 3 {
            0 => frequent,
            code => {
                let (own, behind) = rest.split_at_checked(lengths[usize::from(code)])?;
                rest = behind;
                own
            }
        };
        // The last byte has the sign.
        let (last, others) = difference.split_last()?;
        let high = i64::from(*last as i8);
        sum = sum.wrapping_add(others.iter().rev().fold(high, |v, byte| v << 8 | i64::from(*byte)));
        integers.push(sum);
    }
    Some(integers)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::error::Code;
    use openusd::sdf::AbstractData;
    use openusd::{usda, usdc};
    use std::io::Cursor;

    const MOST: u64 = 1 << 26;

    /// A layer with values of many types, as the crate writes it.
    fn layer() -> Vec<u8> {
        let text = r#"#usda 1.0
(
    customLayerData = { dictionary deep = { dictionary deeper = { string note = "a" } } double[] times = [1, 2, 3] }
)
def Mesh "mesh" (
    customData = { string note = "a" int count = 3 string[] names = ["x", "y"] }
    references = [@./other.usda@</a> (offset = 2), </b>]
    apiSchemas = ["A", "B"]
)
{
    int[] faceVertexIndices = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20]
    point3f[] points.timeSamples = { 1: [(0, 1, 2), (3, 4, 5)], 2: [(0, 1, 2)], 3: [] }
    double[] weights = [0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5, 8.5, 9.5, 10.5, 11.5, 12.5, 13.5, 14.5, 15.5]
    float[] whole = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18]
    matrix4d xformOp:transform = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 5, 1))
    uniform token[] xformOpOrder = ["xformOp:transform"]
    asset[] files = [@a.vdb@, @b.vdb@]
    rel field:density = [</mesh/a>, </mesh/b>]
    def "child" { quatf turn = (1, 0, 0, 0) def "inner" { int64[] large = [1, 2, 3, 10000000000, 5, 6] } }
    def "sibling" { half3[] colors = [(1, 2, 3)] }
}
"#;
        let data = usda::parse(text).unwrap();
        let mut bytes = Cursor::new(Vec::new());
        usdc::CrateWriter::write(&data, &mut bytes).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn sound_layers_pass() {
        let data = usdc::CrateData::open(Cursor::new(checked(layer(), MOST).unwrap()), true).unwrap();
        let large = data.try_field(&"/mesh/child/inner.large".into(), "default").unwrap();
        assert!(format!("{large:?}").contains("10000000000"), "{large:?}");
    }

    /// Reads all that a layer holds by the crate. Whether it is damaged is not asked.
    fn read(bytes: Vec<u8>) {
        let read = || {
            let Ok(data) = usdc::CrateData::open(Cursor::new(bytes), true) else { return };
            for path in data.spec_paths() {
                for field in data.list_fields(&path).unwrap_or_default() {
                    drop(data.try_field(&path, &field));
                }
            }
        };
        drop(std::panic::catch_unwind(read));
    }

    /// Wherever a word is replaced by one that is too large, or that leads backwards, checks come to an end, and so does
    /// the crate where they pass.
    #[test]
    fn false_words_are_found_or_harmless() {
        let sound = layer();
        let mut refused = 0;
        for at in (24..sound.len() - 8).step_by(3) {
            for word in [1 << 30, 1 << 40, 1 << 58, (-8_i64) as u64, u64::MAX, 0x2020_2020_2020_2020] {
                let mut bytes = sound.clone();
                bytes[at..at + 8].copy_from_slice(&word.to_le_bytes());
                match checked(bytes, MOST) {
                    Ok(bytes) => read(bytes),
                    Err(_) => refused += 1,
                }
            }
        }
        assert!(refused > 1000, "{refused}");
    }

    /// A dictionary of two entries, both of which are the next such dictionary, holds more than any file.
    #[test]
    fn nested_dictionaries_end() {
        let mut bytes = Vec::new();
        let nest = |levels: u64, bytes: &mut Vec<u8>| {
            bytes.clear();
            for level in 0..levels {
                let next = (u64::from(kinds::DICTIONARY) << 48) | (48 * (level + 1));
                bytes.extend(2_u64.to_le_bytes());
                for _ in 0..2 {
                    bytes.extend(0_u32.to_le_bytes());
                    bytes.extend(8_u64.to_le_bytes());
                    bytes.extend(next.to_le_bytes());
                }
            }
            bytes.extend([0; 48]);
        };
        let work = |bytes: &[u8]| {
            let mut file = Reader::new(bytes, [0, 8, 0], MOST);
            file.value(u64::from(kinds::DICTIONARY) << 48, 0)
        };
        nest(10, &mut bytes);
        assert_eq!(work(&bytes).unwrap(), (1 << 11) - 1);
        nest(60, &mut bytes);
        assert_eq!(work(&bytes).unwrap(), (1 << 61) - 1);
        nest(100, &mut bytes);
        assert!(work(&bytes).is_err());
        // One that holds itself.
        bytes[20..28].copy_from_slice(&(u64::from(kinds::DICTIONARY) << 48).to_le_bytes());
        assert!(work(&bytes).is_err());
    }

    /// Each path of the tree is walked by its parent and by the sibling before it alone: jumps that meet would double
    /// the paths again and again.
    #[test]
    fn jumps_that_meet_are_refused() {
        let encoded = |values: &[i32]| {
            let mut plain = 0_i32.to_le_bytes().to_vec();
            plain.extend(vec![0xff; values.len().div_ceil(4)]);
            let mut before = 0;
            for value in values {
                plain.extend((value - before).to_le_bytes());
                before = *value;
            }
            let wide: Vec<i64> = values.iter().map(|v| i64::from(*v)).collect();
            assert_eq!(decoded(&plain, values.len(), [4, 1, 2, 4]).unwrap(), wide);
            let block = [&[0][..], &lz4_flex::block::compress(&plain)].concat();
            [&(block.len() as u64).to_le_bytes()[..], &block].concat()
        };
        let paths = |jumps: &[i32]| {
            let count = jumps.len() as u64;
            let numbers: Vec<i32> = (0..).take(jumps.len()).collect();
            let tokens = vec![0; jumps.len()];
            let words = [count.to_le_bytes(), count.to_le_bytes()].concat();
            let bytes = [words, encoded(&numbers), encoded(&tokens), encoded(jumps)].concat();
            let mut file = Reader::new(&bytes, [0, 8, 0], MOST);
            file.paths(&[3])
        };
        // A root with two children, the first of which has a child.
        paths(&[-1, 2, -2, -2]).unwrap();
        assert!(paths(&[2; 60]).is_err());
        let deep = paths(&[-1; 6000]);
        assert_eq!(deep.unwrap_err().code(), Code::Invalid);
    }
}
