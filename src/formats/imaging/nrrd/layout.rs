//! Axes of an array: which are in space, which one has a voxel's components, and which one points in time.

use super::fields::{Fields, directions};
use crate::error::{Error, Result};
use crate::formats::imaging::text::{self, wrong};

/// Largest number of axes in NRRD.
const MOST_AXES: usize = 16;

/// How the axes of the array are understood.
pub(crate) struct Layout {
    /// Axes in space, fastest first.
    pub space: Vec<usize>,
    /// Axis of a voxel's components, first or last of all.
    pub components: Option<usize>,
    /// Axis of points in time or of independent volumes.
    pub list: Option<usize>,
    pub sizes: Vec<usize>,
}

impl Layout {
    pub(crate) fn of(fields: &Fields) -> Result<Self> {
        let sizes = text::counts("sizes", fields.need("sizes")?)?;
        let rank: usize = fields
            .need("dimension")?
            .parse()
            .map_err(|_| wrong("dimension", fields.need("dimension").unwrap_or("")))?;
        if sizes.len() != rank || rank > MOST_AXES || sizes.contains(&0) {
            return Err(wrong("sizes", fields.need("sizes")?));
        }
        let kinds: Vec<String> = fields
            .get(&["kinds"])
            .map(|k| k.split_whitespace().map(str::to_ascii_lowercase).collect())
            .unwrap_or_default();
        let directions = fields.get(&["space directions"]).map(directions).transpose()?;
        let spatial = |axis: usize| match (&directions, kinds.get(axis).map(String::as_str)) {
            (Some(directions), _) => directions.get(axis).is_some_and(Option::is_some),
            (None, Some("space" | "domain")) => true,
            (None, None | Some("???" | "none")) => rank <= 3,
            (None, Some(_)) => false,
        };
        let space: Vec<usize> = (0..rank).filter(|a| spatial(*a)).collect();
        let others: Vec<usize> = (0..rank).filter(|a| !spatial(*a)).collect();
        let vector = |axis: usize| {
            let kind = kinds.get(axis).map_or("", String::as_str);
            sizes[axis] == 3 && !matches!(kind, "list" | "time" | "domain")
        };
        let (components, list) = match others[..] {
            [] => (None, None),
            [a] if sizes[a] > 1 && vector(a) => (Some(a), None),
            [a] => (None, Some(a)),
            [a, b] if vector(a) => (Some(a), Some(b)),
            [a, b] if vector(b) => (Some(b), Some(a)),
            _ => (Some(rank), None),
        };
        let ends = |axis: Option<usize>| axis.is_none_or(|a| a == 0 || a + 1 == rank || others.len() == 2);
        let contiguous = space.windows(2).all(|w| w[1] == w[0] + 1);
        if space.is_empty() || space.len() > 3 || components == Some(rank) || !ends(components) || !contiguous {
            return Err(Error::unsupported(format!(
                "{rank} axes of {sizes:?} entries, of which {} are in space; up to three are read, with components or \
                 points in time before or after them",
                space.len()
            ))
            .hint(
                "set 'kinds' or 'space directions' so that the axes in space can be told, or write one volume of the \
                   file",
            ));
        }
        Ok(Self { space, components, list, sizes })
    }

    pub(crate) fn size(&self) -> [usize; 3] {
        std::array::from_fn(|i| self.space.get(i).map_or(1, |a| self.sizes[*a]))
    }

    /// Length of an axis, 1 if there is none.
    pub(crate) fn length(&self, axis: Option<usize>) -> usize {
        axis.map_or(1, |a| self.sizes[a])
    }

    /// Steps in the array, in numbers, between the entries of an axis.
    pub(crate) fn step(&self, axis: Option<usize>) -> u64 {
        axis.map_or(0, |a| self.sizes[..a].iter().fold(1, |p: u64, n| p.saturating_mul(*n as u64)))
    }
}
