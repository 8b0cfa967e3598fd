//! Tags of an XML file with their places, found without holding the text between them: arrays may be larger than
//! memory.

use crate::error::{Error, Result};
use crate::formats::input;
use quick_xml::events::BytesStart;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

const AGAIN: &str = "the file is damaged: copy it, or write it, again";
/// Longest tag.
const LONGEST: u64 = 1 << 16;

/// A tag that begins an element, or ends one.
#[derive(Debug)]
pub(crate) struct Tag {
    element: BytesStart<'static>,
    /// True for `</name>`.
    pub ends: bool,
    /// Place of the first byte behind it.
    pub end: u64,
}

impl Tag {
    /// Name of the element.
    pub(crate) fn name(&self) -> String {
        self.element.name().as_ref().to_owned()
    }

    /// Value of an attribute, none if there is none or it is damaged.
    pub(crate) fn get(&self, key: &str) -> Option<String> {
        let found = self.element.try_get_attribute(key).ok()??;
        quick_xml::escape::unescape(&found.value).ok().map(|t| t.into_owned())
    }
}

/// Reader of tags.
pub(crate) struct Tags {
    reader: BufReader<File>,
    at: u64,
}

impl Tags {
    /// Begins at the first byte of a file.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        Ok(Self { reader: BufReader::with_capacity(1 << 16, input::open(path)?), at: 0 })
    }

    /// The next tag; none at the end of the file. Comments and declarations are passed over.
    ///
    /// # Errors
    /// If the file cannot be read, or a tag does not end.
    pub(crate) fn next_tag(&mut self) -> Result<Option<Tag>> {
        loop {
            self.at += self.reader.skip_until(b'<').map_err(Error::system)? as u64;
            let mut text = Vec::new();
            let ended = self.until_bracket(&mut text)?;
            if text.starts_with(b"!--") {
                while !text.ends_with(b"--") {
                    if !self.until_bracket(&mut text)? {
                        return Err(Error::invalid("a comment does not end").hint(AGAIN));
                    }
                }
                continue;
            }
            if !ended {
                return if text.is_empty() { Ok(None) } else { Err(Error::invalid("a tag does not end").hint(AGAIN)) };
            }
            if text.starts_with(b"?") || text.starts_with(b"!") {
                continue;
            }
            let text = String::from_utf8(text).map_err(|_| Error::invalid("a tag is no text").hint(AGAIN))?;
            let ends = text.starts_with('/');
            let content = text.trim_start_matches('/').trim_end_matches('/').trim().to_owned();
            let length = content.find(|c: char| c.is_whitespace()).unwrap_or(content.len());
            return Ok(Some(Tag { element: BytesStart::from_content(content, length), ends, end: self.at }));
        }
    }

    /// Appends what comes before the next `>` to `text`; false if there is none.
    fn until_bracket(&mut self, text: &mut Vec<u8>) -> Result<bool> {
        let n = (&mut self.reader).take(LONGEST).read_until(b'>', text).map_err(Error::system)?;
        self.at += n as u64;
        if text.len() as u64 > 2 * LONGEST || (n as u64 == LONGEST && text.last() != Some(&b'>')) {
            return Err(Error::invalid(format!("a tag of more than {LONGEST} bytes")).hint(AGAIN));
        }
        Ok(n > 0 && text.pop_if(|b| *b == b'>').is_some())
    }

    /// Place behind the next `_`, where appended values begin.
    ///
    /// # Errors
    /// If there is none.
    pub(crate) fn underscore(mut self) -> Result<u64> {
        let n = self.reader.skip_until(b'_').map_err(Error::system)? as u64;
        if n == 0 {
            return Err(Error::invalid("the appended values are missing").hint(AGAIN));
        }
        Ok(self.at + n)
    }
}
