//! What the caller says of a file that the file does not say itself, and which part of it is wanted.

use super::placement;
use super::text::excerpt;
use crate::error::{Error, Result};
use crate::formats::sample::{Endian, Sample};
use crate::math::Affine;
use glam::{DMat4, DVec3};

/// Order of the axes of an array, the slowest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axes {
    /// `array[x, y, z]`.
    #[default]
    Xyz,
    /// `array[z, y, x]`, as imaging libraries of Python have it.
    Zyx,
}

/// Layout of a file that has no header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RawLayout {
    /// Number of voxels along x (the fastest), y and z.
    pub size: [usize; 3],
    /// Type of the numbers.
    pub sample: Sample,
    /// Order of their bytes.
    pub endian: Endian,
    /// Number of bytes before the first number.
    pub skip: u64,
}

/// An option, or several that belong together, which the readers of some formats alone heed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ReadOption {
    /// Places of the voxels: the files do not state them, or not always.
    Placement,
    /// One of several points in time.
    Time,
    /// One of several channels.
    Channel,
    /// One of several resolutions.
    Level,
    /// One of several series.
    Series,
    /// One of several named arrays.
    Array,
    /// Order of the axes.
    Axes,
}

/// Options of the readers of images.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Number of the point in time to read, from 0; the first one if none.
    pub time: Option<usize>,
    /// Number of the channel to read, from 0, of an image with several; the first one if none.
    pub channel: Option<usize>,
    /// Number of the resolution to read, from 0 for the finest; the finest that fits into memory if none.
    pub level: Option<usize>,
    /// UID of the series to read, of a folder with several.
    pub series: Option<String>,
    /// Name of the only array to read, of a file with several.
    pub array: Option<String>,
    /// Distance of neighboring voxels along x, y and z, for files that do not state it.
    pub spacing: Option<DVec3>,
    /// World position of the first voxel's centre, for files that do not state it.
    pub origin: Option<DVec3>,
    /// Map from indices to the world, for files that do not state it.
    pub transform: Option<Affine>,
    /// Order of the axes of NumPy's arrays.
    pub axes: Axes,
    /// Layout of a file without a header.
    pub raw: Option<RawLayout>,
    /// True to refuse a file of several points in time or channels of which none is chosen, in the place of taking the
    /// first one.
    pub unambiguous: bool,
}

impl Options {
    /// Map from indices to the world that the options state; none if they state no spacing.
    ///
    /// # Errors
    /// If a spacing is 0 or not finite.
    pub fn placement(&self) -> Result<Option<Affine>> {
        if self.transform.is_some() {
            return Ok(self.transform);
        }
        let Some(spacing) = self.spacing else { return Ok(None) };
        let origin = self.origin.unwrap_or(DVec3::ZERO);
        Affine::new(DMat4::from_translation(origin) * DMat4::from_scale(spacing)).map(Some)
    }

    /// Map of a file with the first voxel at the origin that the options state, if they state one.
    ///
    /// # Errors
    /// If the position is not finite.
    pub fn moved(&self, map: &Affine) -> Result<Affine> {
        let Some(origin) = self.origin else { return Ok(*map) };
        let mut moved = map.matrix();
        moved.w_axis = origin.extend(1.0);
        placement::checked(moved)
    }

    /// Chooses one of `count` points in time, and notes that there are others.
    ///
    /// # Errors
    /// If the time that is asked for is not among them.
    pub(crate) fn choose_time(&self, count: usize, notes: &mut Vec<String>) -> Result<usize> {
        let time = self.time.unwrap_or(0);
        if time >= count {
            return Err(Error::invalid(format!("there is no time {time}; the file has {count}"))
                .hint(format!("give ⟨time_point=0⟩ to {}", count.saturating_sub(1))));
        }
        if count > 1 && self.time.is_none() && self.unambiguous {
            return Err(Error::invalid(format!("the file has {count} points in time, 0 to {}", count - 1))
                .hint("choose one of them with ⟨time_point=N⟩"));
        }
        if count > 1 && self.time.is_none() {
            notes.push(format!("the first of {count} points in time was read; ⟨time_point=N⟩ reads another"));
        }
        Ok(time)
    }

    /// Says whether an array of this name is wanted.
    pub fn wants(&self, name: &str) -> bool {
        self.array.as_deref().is_none_or(|wanted| wanted == name)
    }

    /// Error that no array has the name that was asked for.
    pub(super) fn no_array(&self, names: &[String]) -> Error {
        let names = if names.is_empty() { "none that can be read".to_owned() } else { listed(names) };
        match &self.array {
            Some(wanted) => Error::invalid(format!("no array '{}'; the file has {names}", excerpt(wanted)))
                .hint("name one of these with ⟨array⟩"),
            None => Error::unsupported("the file holds no array of numbers with a voxel at each point")
                .hint("write scalars or vectors of three with the volume where it was made"),
        }
    }
}

/// Names between commas; of many the first ones.
fn listed(names: &[String]) -> String {
    const MOST: usize = 12;
    let more = if names.len() > MOST { ", and others" } else { "" };
    format!("{}{more}", names.iter().take(MOST).map(|n| excerpt(n)).collect::<Vec<_>>().join(", "))
}
