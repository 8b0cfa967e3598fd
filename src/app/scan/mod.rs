//! Scans, images and arrays as inputs: which part of a file is read, where its voxels lie, and the grids that it holds.

pub(crate) mod grids;
pub(crate) mod values;

use crate::error::{Error, Result};
use crate::formats::format::{FileKind, Format};
use crate::formats::imaging::options::{Axes, Options, ReadOption};
use crate::formats::imaging::volume::GridType;
use crate::math::Affine;
use glam::{DMat4, DVec3, DVec4};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Part of a scan, an image or an array that is read, and where its voxels lie.
///
/// VDBs state all of that themselves, and so do most scans. Of a file with several points in time or channels one has
/// to be chosen.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ScanSettings {
    /// Number of the point in time, from 0, of a file with several.
    pub time_point: Option<usize>,
    /// OME-Zarr: number of the channel, from 0, of an image with several.
    pub channel: Option<usize>,
    /// OME-Zarr: number of the resolution, 0 for the finest; none for the finest that fits into memory.
    pub level: Option<usize>,
    /// DICOM: UID of the series, of a folder with several.
    pub series: Option<String>,
    /// Name of the array, of a file with several; none for all.
    pub array: Option<String>,
    /// Type of the grid's values; none for integers of images of integers, except NumPy's, else floats.
    #[serde(rename = "as")]
    pub grid_type: Option<GridType>,
    /// Order of the axes of NumPy's arrays, the slowest first; none for xyz.
    pub axes: Option<Axes>,
    /// Edge of a voxel in world units, for arrays, stacks and raw files.
    pub voxel_size: Option<f64>,
    /// Edges of a voxel along x, y and z in world units, in the place of `voxel_size`.
    pub spacing: Option<[f64; 3]>,
    /// World position of the centre of the first voxel, for arrays, stacks and raw files; none for the origin.
    pub origin: Option<[f64; 3]>,
    /// First three rows of the matrix from indices to the world, acting on columns, in the place of the three above.
    pub transform: Option<[[f64; 4]; 3]>,
}

impl ScanSettings {
    /// Settings as the readers take them.
    ///
    /// # Errors
    /// If the transform is singular.
    pub(crate) fn reading(&self) -> Result<Options> {
        Ok(Options {
            time: self.time_point,
            channel: self.channel,
            level: self.level,
            series: self.series.clone(),
            array: self.array.clone(),
            spacing: self.spacing.map(DVec3::from_array).or(self.voxel_size.map(DVec3::splat)),
            origin: self.origin.map(DVec3::from_array),
            transform: self.transform.map(|rows| Affine::new(matrix(rows))).transpose()?,
            axes: self.axes(),
            raw: None,
            unambiguous: false,
        })
    }

    /// Order of the axes of an array.
    pub(crate) fn axes(&self) -> Axes {
        self.axes.unwrap_or_default()
    }

    /// Type of the grid; arrays of NumPy make floats unless told otherwise.
    pub(crate) fn grid_type(&self, array: bool) -> GridType {
        match self.grid_type {
            Some(stated) => stated,
            None if array => GridType::Float,
            None => GridType::Auto,
        }
    }

    /// Settings by name, whether each is given, and what a format's reader must heed for it to have an effect; none for
    /// what concerns all images.
    pub(crate) fn stated(&self) -> [(&'static str, bool, Option<ReadOption>); 11] {
        [
            ("⟨time_point⟩", self.time_point.is_some(), Some(ReadOption::Time)),
            ("⟨channel⟩", self.channel.is_some(), Some(ReadOption::Channel)),
            ("⟨level⟩", self.level.is_some(), Some(ReadOption::Level)),
            ("⟨series⟩", self.series.is_some(), Some(ReadOption::Series)),
            ("⟨array⟩", self.array.is_some(), Some(ReadOption::Array)),
            ("⟨as⟩", self.grid_type.is_some(), None),
            ("⟨axes⟩", self.axes.is_some(), Some(ReadOption::Axes)),
            ("⟨voxel_size⟩", self.voxel_size.is_some(), Some(ReadOption::Placement)),
            ("⟨spacing⟩", self.spacing.is_some(), Some(ReadOption::Placement)),
            ("⟨origin⟩", self.origin.is_some(), Some(ReadOption::Placement)),
            ("⟨transform⟩", self.transform.is_some(), Some(ReadOption::Placement)),
        ]
    }

    /// True if a setting applies to a format.
    fn applies(format: &Format, option: Option<ReadOption>) -> bool {
        match option {
            Some(option) => format.kind.heeds(option),
            None => matches!(format.kind, FileKind::Image(_)),
        }
    }

    /// Refuses settings that have no effect on a file of a format.
    ///
    /// # Errors
    /// If there is one; the error names it.
    pub(crate) fn check(&self, format: &Format, path: &Path) -> Result<()> {
        match self.stated().into_iter().find(|(_, given, option)| *given && !Self::applies(format, *option)) {
            Some((name, ..)) => Err(Error::invalid(format!("{name} has no effect on {}", format.phrase))
                .at(path)
                .hint(format!("leave {name} out: it is for scans and arrays that do not state it themselves"))),
            None => Ok(()),
        }
    }

    /// Refuses settings that have an effect on none of several files.
    ///
    /// # Errors
    /// If there is one; the error names it.
    pub(crate) fn check_any(&self, formats: &[&Format], path: &Path) -> Result<()> {
        let idle = |option| !formats.iter().any(|format| Self::applies(format, option));
        match self.stated().into_iter().find(|(_, given, option)| *given && idle(*option)) {
            Some(_) => formats.first().map_or(Ok(()), |format| self.check(format, path)),
            None => Ok(()),
        }
    }

    /// Returns the settings that have an effect on files of a format.
    pub(crate) fn of(&self, format: &Format) -> Self {
        let keep = |option| Self::applies(format, option);
        Self {
            time_point: self.time_point.filter(|_| keep(Some(ReadOption::Time))),
            channel: self.channel.filter(|_| keep(Some(ReadOption::Channel))),
            level: self.level.filter(|_| keep(Some(ReadOption::Level))),
            series: self.series.clone().filter(|_| keep(Some(ReadOption::Series))),
            array: self.array.clone().filter(|_| keep(Some(ReadOption::Array))),
            grid_type: self.grid_type.filter(|_| keep(None)),
            axes: self.axes.filter(|_| keep(Some(ReadOption::Axes))),
            voxel_size: self.voxel_size.filter(|_| keep(Some(ReadOption::Placement))),
            spacing: self.spacing.filter(|_| keep(Some(ReadOption::Placement))),
            origin: self.origin.filter(|_| keep(Some(ReadOption::Placement))),
            transform: self.transform.filter(|_| keep(Some(ReadOption::Placement))),
        }
    }
}

/// Returns the matrix with these first three rows.
fn matrix(rows: [[f64; 4]; 3]) -> DMat4 {
    let [x, y, z] = rows.map(DVec4::from_array);
    DMat4::from_cols(x, y, z, DVec4::W).transpose()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::formats::registry::{NPY, VDB};

    #[test]
    fn settings_without_effect_are_refused_by_name() {
        let path = Path::new("a");
        let sized = ScanSettings { voxel_size: Some(2.0), ..ScanSettings::default() };
        assert!(sized.check(&NPY, path).is_ok() && ScanSettings::default().check(&VDB, path).is_ok());
        assert!(sized.check(&VDB, path).unwrap_err().to_string().contains("`voxel_size` has no effect"));
        let timed = ScanSettings { time_point: Some(0), ..sized.clone() };
        assert!(timed.check(&NPY, path).unwrap_err().to_string().contains("`time_point`"));
        assert!(sized.check_any(&[&VDB, &NPY], path).is_ok() && sized.check_any(&[&VDB, &VDB], path).is_err());
        assert_eq!((timed.of(&NPY), timed.of(&VDB)), (sized, ScanSettings::default()));
    }

    #[test]
    fn settings_are_options_of_the_readers() {
        let rows = [[2.0, 0.0, 0.0, 5.0], [0.0, 3.0, 0.0, 6.0], [0.0, 0.0, 4.0, 7.0]];
        let settings = ScanSettings { transform: Some(rows), ..ScanSettings::default() };
        let map = settings.reading().unwrap().placement().unwrap().unwrap();
        assert_eq!(map.to_world(DVec3::ONE), DVec3::new(7.0, 9.0, 11.0));
        let settings =
            ScanSettings { spacing: Some([1.0, 2.0, 3.0]), voxel_size: Some(9.0), ..ScanSettings::default() };
        assert_eq!(settings.reading().unwrap().spacing, Some(DVec3::new(1.0, 2.0, 3.0)));
        assert_eq!(settings.grid_type(true), GridType::Float);
    }
}
