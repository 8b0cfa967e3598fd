//! Axes of an array: which are space, which time and channel.

use super::array::{Array, text};
use super::document::{Document, wrong};
use crate::error::{Error, Result};
use crate::formats::imaging::options::Options;
use serde_json::Value;

/// Place of each axis among those of the array; none where the array has no such axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Axes {
    /// Axes x, y and z. An array without z is one slice.
    pub space: [Option<usize>; 3],
    time: Option<usize>,
    channel: Option<usize>,
}

/// Letter of an axis by its name.
fn letter(name: &str) -> Option<char> {
    let mut letters = name.chars().map(|c| c.to_ascii_lowercase());
    match (letters.next(), letters.next()) {
        (Some(letter), None) => Some(letter),
        _ if name.eq_ignore_ascii_case("time") => Some('t'),
        _ if name.eq_ignore_ascii_case("channel") => Some('c'),
        _ => None,
    }
}

impl Axes {
    /// Finds the axes by their names, the slowest first.
    ///
    /// # Errors
    /// If x or y is missing, two axes have one name, or an axis is none of x, y, z, t and c.
    pub(crate) fn of_names(names: &[String]) -> Result<Self> {
        let mut axes = Self { space: [None; 3], time: None, channel: None };
        for (place, name) in names.iter().enumerate() {
            let slot = match letter(name) {
                Some('x') => &mut axes.space[0],
                Some('y') => &mut axes.space[1],
                Some('z') => &mut axes.space[2],
                Some('t') => &mut axes.time,
                Some('c') => &mut axes.channel,
                _ => {
                    return Err(Error::unsupported(format!("the axis '{name}' is none of x, y, z, t and c"))
                        .hint("write the array with these axes alone where it was made"));
                }
            };
            if slot.replace(place).is_some() {
                return Err(wrong(format!("two axes are named '{name}'")));
            }
        }
        if axes.space[0].is_none() || axes.space[1].is_none() {
            return Err(wrong(format!("the axes {} lack x or y", names.join(", "))));
        }
        Ok(axes)
    }

    /// Finds the axes of a bare array: by the names of its dimensions, else its last three are z, y, x.
    ///
    /// # Errors
    /// If the names are of no use, or the array has less than two axes or more than five.
    pub(crate) fn of_array(document: &Document, array: &Array, notes: &mut Vec<String>) -> Result<Self> {
        let list = match document.version {
            3 => document.metadata.get("dimension_names"),
            _ => document.attributes.get("_ARRAY_DIMENSIONS"),
        };
        let named = list.and_then(Value::as_array);
        let names: Option<Vec<String>> =
            named.and_then(|list| list.iter().map(|n| n.as_str().map(str::to_owned)).collect());
        if let Some(axes) = names.filter(|n| n.len() == array.shape.len()).and_then(|n| Self::of_names(&n).ok()) {
            return Ok(axes);
        }
        let axes = array.shape.len();
        let Some(names) = ["y x", "z y x", "c z y x", "t c z y x"].get(axes.wrapping_sub(2)) else {
            return Err(Error::unsupported(format!("an array of {axes} axes, 2 to 5 are read"))
                .hint("write the array as [z, y, x] where it was made"));
        };
        notes.push(format!("the axes are taken for {}", names.replace(' ', ", ")));
        let names: Vec<String> = names.split(' ').map(str::to_owned).collect();
        Self::of_names(&names)
    }

    /// Finds the axes of NGFF's metadata; versions before 0.4 have names alone, or five fixed axes.
    ///
    /// # Errors
    /// If [`Axes::of_names`] fails, or there are not as many as the array has.
    pub(crate) fn of_image(list: Option<&Value>, array: &Array) -> Result<(Self, Vec<String>)> {
        let names: Vec<String> = match list.and_then(Value::as_array) {
            Some(list) => {
                let name = |axis: &Value| axis.as_str().or_else(|| text(axis, "name")).unwrap_or_default().to_owned();
                list.iter().map(name).collect()
            }
            None => ["t", "c", "z", "y", "x"].map(str::to_owned).to_vec(),
        };
        if names.len() != array.shape.len() {
            return Err(wrong(format!("{} axes are named, the array has {}", names.len(), array.shape.len())));
        }
        Ok((Self::of_names(&names)?, names))
    }

    /// Number of voxels along x, y and z.
    ///
    /// # Errors
    /// If one of them is 0 or too large to count.
    pub(crate) fn size(&self, array: &Array) -> Result<[usize; 3]> {
        let length = |axis: Option<usize>| axis.map_or(1, |axis| array.shape[axis]);
        let [x, y, z] = self.space.map(|axis| usize::try_from(length(axis)).ok().filter(|n| *n > 0));
        match (x, y, z) {
            (Some(x), Some(y), Some(z)) => Ok([x, y, z]),
            _ => Err(wrong(format!("an array of {:?} has no voxels, or too many", array.shape))),
        }
    }

    /// Indices along all axes, of which those of space are 0: the point in time and the channel that the options
    /// choose.
    ///
    /// # Errors
    /// If one of them is not there.
    pub(crate) fn choose(&self, array: &Array, options: &Options, notes: &mut Vec<String>) -> Result<Vec<u64>> {
        let mut point = vec![0; array.shape.len()];
        let length = |axis: usize| usize::try_from(array.shape[axis]).unwrap_or(usize::MAX);
        if let Some(axis) = self.time {
            point[axis] = options.choose_time(length(axis), notes)? as u64;
        } else if options.time.is_some_and(|t| t > 0) {
            options.choose_time(1, notes)?;
        }
        let channel = options.channel.unwrap_or(0);
        let channels = self.channel.map_or(1, length);
        if channel >= channels {
            return Err(Error::invalid(format!("there is no channel {channel}; the image has {channels}"))
                .hint(format!("give ⟨channel=0⟩ to {}", channels.saturating_sub(1))));
        }
        if let Some(axis) = self.channel {
            point[axis] = channel as u64;
            if channels > 1 && options.channel.is_none() && options.unambiguous {
                return Err(Error::invalid(format!("the image has {channels} channels, 0 to {}", channels - 1))
                    .hint("choose one of them with ⟨channel=N⟩"));
            }
            if channels > 1 && options.channel.is_none() {
                notes.push(format!("the first of {channels} channels was read; ⟨channel=N⟩ reads another"));
            }
        }
        Ok(point)
    }
}
