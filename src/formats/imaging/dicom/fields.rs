//! Elements as numbers and text, and the frames that they describe.

use super::element::{Item, Value, damaged, tag_text};
use super::tags::{
    INTERCEPT, ORIENTATION, PIXEL_MEASURES, PIXEL_SPACING, PLANE_ORIENTATION, PLANE_POSITION, POSITION,
    SLICE_THICKNESS, SLOPE, SPACING_BETWEEN_SLICES, VALUE_TRANSFORMATION,
};
use crate::error::Result;
use glam::DVec3;

/// Place and scale of a frame. What is not stated is none.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Frame {
    /// Position of the centre of the first pixel in the patient's system, in millimetres.
    pub position: Option<DVec3>,
    /// Directions in which columns and rows are counted.
    pub orientation: Option<[DVec3; 2]>,
    /// Distances of neighboring rows and of neighboring columns.
    pub spacing: Option<[f64; 2]>,
    /// Distance of slices, or their thickness, if no positions tell it.
    pub thickness: Option<f64>,
    /// Slope and intercept that stored values are multiplied by and added to.
    pub rescale: (f64, f64),
    /// Whether the file states the slope, and the intercept.
    pub rescaled: [bool; 2],
}

/// An item with the byte order of its numbers.
pub(crate) struct Fields<'a> {
    pub item: &'a Item,
    pub big: bool,
}

impl Fields<'_> {
    fn bytes(&self, tag: u32) -> Option<&[u8]> {
        match self.item.get(&tag)? {
            Value::Bytes(bytes) if !bytes.is_empty() => Some(bytes),
            _ => None,
        }
    }
    /// Text without the blanks around it.
    pub(crate) fn text(&self, tag: u32) -> Option<String> {
        let text = String::from_utf8_lossy(self.bytes(tag)?).trim_matches(['\0', ' ']).to_owned();
        (!text.is_empty()).then_some(text)
    }
    /// 16-bit number.
    pub(crate) fn u16(&self, tag: u32) -> Option<u16> {
        let pair = *self.bytes(tag)?.first_chunk::<2>()?;
        Some(if self.big { u16::from_be_bytes(pair) } else { u16::from_le_bytes(pair) })
    }
    /// Decimal numbers, which backslashes part; none if one of them is no number.
    pub(crate) fn list(text: &str) -> Option<Vec<f64>> {
        text.split('\\').map(|part| part.trim().parse().ok().filter(|n: &f64| n.is_finite())).collect()
    }
    /// As many decimal numbers as the element must have.
    fn numbers<const N: usize>(&self, tag: u32) -> Result<Option<[f64; N]>> {
        let Some(text) = self.text(tag) else { return Ok(None) };
        let numbers = Self::list(&text).and_then(|n| <[f64; N]>::try_from(n).ok());
        numbers.map(Some).ok_or_else(|| {
            let start: String = text.chars().take(40).collect();
            damaged(format!("element {} is '{start}'; {N} numbers are expected", tag_text(tag)))
        })
    }
    /// One decimal number.
    pub(crate) fn number(&self, tag: u32) -> Result<Option<f64>> {
        Ok(self.numbers::<1>(tag)?.map(|[n]| n))
    }
    /// Items of a sequence.
    pub(crate) fn items(&self, tag: u32) -> &[Item] {
        match self.item.get(&tag) {
            Some(Value::Items(items)) => items,
            _ => &[],
        }
    }
    /// Fields of the only item of a sequence.
    pub(crate) fn inner(&self, tag: u32) -> Option<Fields<'_>> {
        self.items(tag).first().map(|item| Fields { item, big: self.big })
    }

    /// Fills what this item states, in itself or in the functional groups it holds.
    pub(crate) fn frame(&self, before: &Frame) -> Result<Frame> {
        let mut frame = before.clone();
        let in_group = |group: u32| self.inner(group);
        let vector = |[x, y, z]: [f64; 3]| DVec3::new(x, y, z);
        for fields in [Some(Fields { item: self.item, big: self.big }), in_group(PLANE_POSITION)].into_iter().flatten()
        {
            frame.position = fields.numbers(POSITION)?.map(vector).or(frame.position);
        }
        for fields in
            [Some(Fields { item: self.item, big: self.big }), in_group(PLANE_ORIENTATION)].into_iter().flatten()
        {
            if let Some([a, b, c, d, e, f]) = fields.numbers::<6>(ORIENTATION)? {
                frame.orientation = Some([DVec3::new(a, b, c), DVec3::new(d, e, f)]);
            }
        }
        for fields in [Some(Fields { item: self.item, big: self.big }), in_group(PIXEL_MEASURES)].into_iter().flatten()
        {
            frame.spacing = fields.numbers(PIXEL_SPACING)?.or(frame.spacing);
            let between = fields.number(SPACING_BETWEEN_SLICES)?.map(f64::abs);
            let thickness = between.or(fields.number(SLICE_THICKNESS)?).filter(|t| *t > 0.0);
            frame.thickness = thickness.or(frame.thickness);
        }
        for fields in
            [Some(Fields { item: self.item, big: self.big }), in_group(VALUE_TRANSFORMATION)].into_iter().flatten()
        {
            let (slope, intercept) = (fields.number(SLOPE)?, fields.number(INTERCEPT)?);
            if slope == Some(0.0) {
                return Err(damaged(format!(
                    "the slope that stored values are multiplied by, element {}, is 0, which leaves nothing of them; \
                     another number is expected",
                    tag_text(SLOPE)
                )));
            }
            frame.rescaled = [frame.rescaled[0] || slope.is_some(), frame.rescaled[1] || intercept.is_some()];
            frame.rescale = (slope.unwrap_or(frame.rescale.0), intercept.unwrap_or(frame.rescale.1));
        }
        Ok(frame)
    }
}
